"""From text to checked values: parts and alternatives, units, plug-ins, files of numbers, profiles."""
