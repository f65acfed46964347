"""The elastic bodies: meshes, nodes, operators, boundaries, initial stress, state and highest frequency."""
