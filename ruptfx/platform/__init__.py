"""The machine and the terminal: ranks, DOLFINx, compiled code, files of a run, clocks, text and progress."""
