"""`python -m ruptfx` is the command line."""

from ruptfx.cli import app

if __name__ == "__main__":
    app(prog_name="ruptfx")
