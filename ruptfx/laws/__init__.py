"""Formulas point by point, without mesh and MPI: friction, cohesion, contact, nucleation, materials, fracture."""
