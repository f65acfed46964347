"""Rows of `ruptfx check` about interfaces: what a careful user computes by hand before the first step."""
