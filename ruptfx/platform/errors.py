"""The base of all errors that a user can act upon."""

from __future__ import annotations

from typing import ClassVar


class RuptfxError(Exception):
    """Anything the user can act upon: the message says what is wrong, where, and what to do.

    Attributes
    ----------
    exit_code : int
        Exit code of a command that ends with it.
    at_once : bool
        True if a command must end without the clean-up of its libraries.
    """

    exit_code: ClassVar[int] = 1
    at_once: ClassVar[bool] = False
