"""What is measured in a run: instruments, and misfits to data."""
