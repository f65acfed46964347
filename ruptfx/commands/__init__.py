"""Commands, one per file, which defines a function of its name; `ruptfx.cli` lists them."""
