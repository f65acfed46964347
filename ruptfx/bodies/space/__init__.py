"""Mesh and function space: bodies split over ranks, nodes, edges, points inside, bodies of revolution."""
