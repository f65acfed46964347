"""Other formats: inputs of SEM2DPACK as cases, runs as VTK data and as files of the SCEC/USGS code comparison."""
