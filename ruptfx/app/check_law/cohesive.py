"""The contract of a cohesive law as checks, for `ruptfx check-law`.

A check takes an example law and a seed, and raises `Broken` with values and their position.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable

import numpy as np
import tomli_w
from pydantic import TypeAdapter

from ruptfx.app.check_law.checks import close, require
from ruptfx.laws.cohesion import AnyCohesion, CohesiveLaw
from ruptfx.platform.codegen.tracing import Expression, derivative, record, symbol, to_numpy

N = 20000  # intervals of an integral; a kink between two points costs 1 / N^2
ANGLES = np.linspace(0, np.pi / 2, 91)  # angle of the jump, scaled with those at failure: opening (0) to slip (pi / 2)


def missing(cls: type[CohesiveLaw]) -> list[str]:
    """Return the names of missing attributes of a class."""
    items = [name for name in ("formula", "source") if not getattr(cls, name)]
    return items + ["a docstring"] * (not cls.summary()) + ["area"] * (not hasattr(cls, "area"))


def toml(law: CohesiveLaw, seed: int) -> None:
    """Check that a law is unchanged after it is written to a case and read again."""
    written = tomli_w.dumps({"cohesion": law.model_dump(mode="json", exclude_none=True)})
    again = TypeAdapter(AnyCohesion).validate_python(tomllib.loads(written)["cohesion"])
    require(again == law, "a case with this law reads differently than it was written")


def remaining(law: CohesiveLaw, seed: int) -> None:
    """Check that the remaining strength falls from 1 at damage 0 to 0 at damage 1, with the declared area."""
    damage = np.linspace(0, 1, N + 1)
    values = np.asarray(law.remaining_fraction(damage) + 0 * damage)
    require(np.isfinite(values), "remaining_fraction is not finite", damage=damage)
    close(values[0], 1.0, 1e-12, "remaining_fraction is not 1 at damage 0")
    require(abs(values[-1]) <= 1e-12, f"remaining_fraction is {values[-1]:.6g}, not 0, at damage 1")
    require(np.diff(values) <= 1e-12, "remaining_fraction grows with damage", damage=damage[1:])
    close(np.trapezoid(values, damage), law.area, 1e-6, "area is not the integral of remaining_fraction")


def fracture_energy(law: CohesiveLaw, seed: int) -> None:
    """Check that opening alone dissipates G_Ic until failure, slip alone G_IIc, with the declared jumps."""
    for name, angle, energy in (("opening", 0.0, law.G_Ic), ("slip", np.pi / 2, law.G_IIc)):
        damage, *works = straight_path(law, angle)
        require(damage[0] == 0, f"damage is {damage[0]:.6g} before any {name}")
        close(damage[-1], 1.0, 1e-9, f"damage at the {name} of failure")
        close(sum(works), energy, 1e-6, f"energy of {name} alone")


def damage(law: CohesiveLaw, seed: int) -> None:
    """Check that damage is between 0 and 1 and does not fall while a jump of any mode grows."""
    size = np.linspace(0, 3, 301)
    for angle in ANGLES[::15]:
        opening, slip = jump_at(law, angle, size)
        result = law.damage(opening, slip) + 0 * size
        where = {"opening": opening, "slip": slip}
        require(np.isfinite(result), "damage is not finite", **where)
        require((result >= 0) & (result <= 1), "damage is not between 0 and 1", damage=result, **where)
        require(np.diff(result) >= -1e-12, "damage falls", opening=opening[1:], slip=slip[1:])


def traced(law: CohesiveLaw, seed: int) -> None:
    """Compare the traced formulas with the methods, and their derivatives with finite differences."""
    x, opening, slip = symbol("damage"), symbol("opening"), symbol("slip")
    formula: Expression = record(law.remaining_fraction, x)
    value, slope = to_numpy({"left": formula, "slope": derivative(formula, x)}, ["damage"])(at := ANGLES[1:-1] / 1.6)
    close(value, law.remaining_fraction(at), 1e-12, "traced remaining_fraction differs", damage=at)
    h = 1e-6
    differences = (law.remaining_fraction(at + h) - law.remaining_fraction(at - h)) / (2 * h)
    near = np.abs(slope + 0 * at - differences) <= 1e-5 * (1 + np.abs(differences))
    # Exclude kinks of the curve between the two points of a difference.
    what = "derivative of remaining_fraction differs"
    require(near.mean() > 0.9, what, damage=at, found=slope, differences=differences)
    jumps = [np.outer(np.linspace(0.1, 1.4, 9), each) for each in jump_at(law, ANGLES, np.ones_like(ANGLES))]
    (result,) = to_numpy({"damage": record(law.damage, opening, slip)}, ["opening", "slip"])(*jumps)
    close(result, law.damage(*jumps), 1e-12, "traced damage differs", opening=jumps[0], slip=jumps[1])


CHECKS: dict[str, Callable[[CohesiveLaw, int], None]] = {
    "case file": toml, "remaining strength": remaining, "fracture energy": fracture_energy, "damage": damage,
    "traced derivatives": traced,
}  # fmt: skip


def jump_at(law: CohesiveLaw, angle: np.ndarray | float, size: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return opening and slip [m] of a jump given in units of the jumps at failure."""
    opening, slip = size * np.cos(angle) * law.opening_at_failure, size * np.sin(angle) * law.slip_at_failure
    return np.asarray(opening), np.asarray(slip)


def straight_path(law: CohesiveLaw, angle: float, longest: float = 1.0) -> tuple[np.ndarray, float, float]:
    """Return damage along a straight path of a jump, and the work of opening and of slip on it [J/m2].

    Parameters
    ----------
    angle : float
        Angle of the jump, scaled with the jumps at failure: 0 is opening alone.
    longest : float
        Size of the jump at the end of the path, in these units.
    """
    opening, slip = jump_at(law, angle, np.linspace(0, longest, N + 1))
    damage = np.asarray(law.damage(opening, slip) + 0 * opening)
    remaining = np.where(damage < 1, law.remaining_fraction(damage), 0.0)
    return damage, float(np.trapezoid(law.f_t * remaining, opening)), float(np.trapezoid(law.c * remaining, slip))
