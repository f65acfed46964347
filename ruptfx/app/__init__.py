"""The command line and what only it needs: commands, benchmarks, pre-flight checks, conversions, reference texts."""
