"""Rows of `ruptfx check`, and the run that they are about."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from ruptfx.bodies.boundaries.loading import Loads


@dataclass(frozen=True)
class Row:
    """One line of the pre-flight table; one that is `early` is said before what it announces is computed."""

    quantity: str
    value: float | str
    unit: str = ""
    note: str = ""
    verdict: Literal["ok", "warning", "error"] = "ok"
    early: bool = False

    @property
    def text(self) -> str:
        return self.value if isinstance(self.value, str) else f"{self.value:.6g}"


@dataclass(frozen=True)
class Plan:
    """Steps and loads of a run, as rows of mechanisms need them.

    Attributes
    ----------
    dt : float
        Time step, or the first one [s].
    steps : int, optional
        Number of steps; None if they vary.
    stable : float
        Stable explicit step [s].
    ends : sequence of (float, Loads)
        End of every stage of loading [s], and its boundaries.
    """

    dt: float
    steps: int | None
    stable: float
    ends: Sequence[tuple[float, Loads]]
