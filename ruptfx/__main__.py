"""`python -m ruptfx` is the command line."""

from ruptfx.app.cli import program

if __name__ == "__main__":
    program()
