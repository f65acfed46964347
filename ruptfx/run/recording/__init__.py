"""Output of a run: records, checkpoints, and their directory."""
