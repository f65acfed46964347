"""Symmetric tensors of a point, whose components are numbers, arrays or traced expressions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

COMPONENTS = ("xx", "yy", "zz", "xy", "yz", "xz")
"""Order of the components."""
TWICE = (1.0, 1.0, 1.0, 2.0, 2.0, 2.0)
"""How often a component is in the matrix."""


@dataclass(frozen=True)
class Tensor:
    """A symmetric tensor of second order in three dimensions; the components of a strain are not doubled.

    Attributes
    ----------
    xx, yy, zz, xy, yz, xz : number, ndarray or traced expression
    """

    xx: Any = 0.0
    yy: Any = 0.0
    zz: Any = 0.0
    xy: Any = 0.0
    yz: Any = 0.0
    xz: Any = 0.0

    @property
    def components(self) -> tuple[Any, ...]:
        """The components in the order of `COMPONENTS`."""
        return self.xx, self.yy, self.zz, self.xy, self.yz, self.xz

    def _each(self, other: Any, act: Callable[[Any, Any], Any]) -> Tensor:
        others = other.components if isinstance(other, Tensor) else (other,) * 6
        return Tensor(*(act(x, y) for x, y in zip(self.components, others, strict=True)))

    def __add__(self, other: Tensor) -> Tensor:
        return self._each(other, lambda x, y: x + y) if isinstance(other, Tensor) else NotImplemented

    def __sub__(self, other: Tensor) -> Tensor:
        return self._each(other, lambda x, y: x - y) if isinstance(other, Tensor) else NotImplemented

    def __neg__(self) -> Tensor:
        return Tensor(*(-x for x in self.components))

    def __mul__(self, factor: Any) -> Tensor:
        return NotImplemented if isinstance(factor, Tensor) else self._each(factor, lambda x, y: x * y)

    __rmul__ = __mul__
    __array_ufunc__ = None  # so that an array or an expression times a tensor comes to __rmul__

    def __truediv__(self, divisor: Any) -> Tensor:
        return NotImplemented if isinstance(divisor, Tensor) else self._each(divisor, lambda x, y: x / y)

    def trace(self) -> Any:
        """Return xx + yy + zz."""
        return self.xx + self.yy + self.zz

    def deviator(self) -> Tensor:
        """Return the tensor less its mean normal component."""
        mean = self.trace() / 3
        return Tensor(self.xx - mean, self.yy - mean, self.zz - mean, self.xy, self.yz, self.xz)

    def dot(self, other: Tensor) -> Any:
        """Return the double contraction A : B = sum of A_ij B_ij."""
        return sum(
            twice * (x * y) for twice, x, y in zip(TWICE, self.components, other.components, strict=True)
        )  # fmt: skip


IDENTITY = Tensor(1.0, 1.0, 1.0)
"""The unit tensor."""
