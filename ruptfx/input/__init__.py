"""Numbers with units and columns of numbers, from text."""
