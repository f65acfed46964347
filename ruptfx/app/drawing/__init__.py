"""Drawings outside of the figures of a record: processes that draw a run, the mesh of a case."""
