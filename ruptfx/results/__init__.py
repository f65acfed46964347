"""Reading a run: records, numbers, figures, movies, cameras; neither DOLFINx nor MPI."""
