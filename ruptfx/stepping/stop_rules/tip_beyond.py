"""A rupture that reaches a position or a larger one."""

from typing import ClassVar

from ruptfx.stepping.stop_rules._tip import Tip


class TipBeyond(Tip):
    """A rupture that reaches a position or a larger one; `stop_when.tip_beyond` in short."""

    example: ClassVar[str] = '{ kind = "tip_beyond", position = 6.5e-3 }'
