"""Drawings outside of the figures of a record: the mesh of a case, in the plane and as a solid."""
