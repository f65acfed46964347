"""Other formats: inputs of SEM2DPACK as cases, runs as VTK data."""
