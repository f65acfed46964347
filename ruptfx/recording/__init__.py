"""What a run leaves behind: records, checkpoints, and the directory they are in."""
