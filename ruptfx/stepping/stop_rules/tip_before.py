"""A rupture that reaches a position or a smaller one."""

from typing import ClassVar

from ruptfx.stepping.stop_rules._tip import Tip


class TipBefore(Tip):
    """A rupture that reaches a position or a smaller one; `stop_when.tip_before` in short."""

    example: ClassVar[str] = '{ kind = "tip_before", position = 5.5e-3 }'
    sign: ClassVar[int] = -1
