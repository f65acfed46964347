"""Rayleigh speed for Poisson's ratio 1/4, where (c_R / c_s)^2 = 2 - 2 / sqrt(3)."""

from __future__ import annotations

from math import sqrt
from typing import TYPE_CHECKING

from ruptfx.plugin import Check, rayleigh_speed

if TYPE_CHECKING:
    from ruptfx.plugin import MPI


def run(fine: bool, comm: MPI.Comm | None) -> list[Check]:
    exact = sqrt(2 - 2 / sqrt(3))
    return [Check("c_R / c_s", exact, rayleigh_speed(sqrt(3), 1.0), 1e-9, source="Rayleigh (1885)")]
