"""Other formats: inputs of SEM2DPACK as cases, runs as VTK data and as files of code comparisons (SCEC/USGS, SEAS)."""
