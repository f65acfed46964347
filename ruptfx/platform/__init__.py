"""The machine and the terminal: ranks, collective operations, clocks, text and progress."""
