"""Commands, one per file, found by its name: a function of that name, and `HEADING`, where `--help` lists it."""
