"""Reference texts made from the code: kinds and tables of a case, which parts can be combined."""
