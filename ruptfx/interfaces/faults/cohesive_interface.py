"""Cohesion of the points of an interface in a step: damage, remaining strength, fracture energy.

The largest opening w and the whole slip s give the damage D, and the damage the remaining strength:

    tension <= f_t remaining(D),   shear strength = c remaining(D) + friction

A point that opens less than before unloads along the secant to the origin, K = f_t remaining(D) / w, at the end of the
step. With the trial tension t and the carried tension T the opening is compliance (t - T), so that

    T = min(f_t remaining(D), t S / (S + w / compliance)),   S = f_t remaining(D),

and the steep secant of a new crack cannot reduce the stable time step. Opening and slip are those at the time of
the traction. Explicit rigid contact knows both before the traction. Where slip ends with the traction (compliant
contact, all implicit steps) both follow from it, w = compliance (t - T), and the damage is solved for together with the
traction (`search_damage` in `return_map.c`): the law is the same in steps of any size. With springs w is the opening
beyond theirs.

The work of a traction is split alike at interfaces and facets (`cohesive_share` in `return_map.c`): cohesion dissipates
its share c remaining(D) of a shear traction first and friction the rest; of the work of tension the part is stored that
the secant gives back.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ruptfx.interfaces.faults.projection import CohesiveStrength, parameters_as_symbols
from ruptfx.laws.cohesion import CohesiveLaw
from ruptfx.platform.codegen.tracing import Expression, derivative, record, substituted, symbol, to_numpy

STATE = {"damage": "1", "largest_opening": "m", "damaging_slip": "m"}
"""Fields of every point, and their units; the slip is the whole way, whatever its direction."""


DAMAGED = 4e-15
"""Error of the damage that is solved for."""


class TracedCohesion:
    """Cohesive law recorded once: damage from opening and slip, and the remaining strength from damage.

    Parameters
    ----------
    law : CohesiveLaw
        With profiles evaluated at the points.

    Attributes
    ----------
    parameters : dict of str to float or ndarray
        By the name of their symbols.
    damage : Expression
        Damage of the symbols `bond_opening` and `bond_slip`.
    tension, shear : Expression
        Remaining strengths of the symbol `bond_damage` [Pa].
    """

    def __init__(self, law: CohesiveLaw) -> None:
        self.law = law
        self.parameters, traced = parameters_as_symbols(law, "b_")
        self.damage: Expression = record(traced.damage, symbol("bond_opening"), symbol("bond_slip"))
        damage: Any = symbol("bond_damage")
        remaining: Any = np.where(damage < 1, record(traced.remaining_fraction, damage), 0.0)
        self.tension, self.shear = traced.f_t * remaining, traced.c * remaining
        items = list(self.parameters)
        self._damage = to_numpy({"damage": self.damage}, ["bond_opening", "bond_slip", *items])
        self._strength = to_numpy({"tension": self.tension, "shear": self.shear}, ["bond_damage", *items])

    def strength_of(self, damage: Expression) -> list[Any]:
        """Return the formulas of tensile and shear strength at a damage."""
        return substituted([self.tension, self.shear], {symbol("bond_damage"): damage})

    def damage_of(self, opening: Expression, slip: Expression) -> Expression:
        """Return the formula of the damage at an opening and a slip."""
        return substituted([self.damage], {symbol("bond_opening"): opening, symbol("bond_slip"): slip})[0]

    def damage_slopes_of(self, opening: Expression, slip: Expression) -> list[Expression]:
        """Return the formulas of the derivatives of the damage by opening and slip."""
        entries = {symbol("bond_opening"): opening, symbol("bond_slip"): slip}
        return substituted([derivative(self.damage, variable) for variable in entries], entries)

    def damage_after(self, before: np.ndarray, opening: np.ndarray, slip: np.ndarray) -> np.ndarray:
        """Return the damage at the largest opening and the whole slip so far [m], not less than before; shapes (n,)."""
        with np.errstate(all="ignore"):
            (result,) = self._damage(opening, slip, *self.parameters.values())
        return np.asarray(np.maximum(before, result))

    def strength_at(self, damage: np.ndarray, opening: np.ndarray, compliance: np.ndarray) -> CohesiveStrength:
        """Return the cohesive strength at a damage and a largest opening [m], shapes (n,)."""
        with np.errstate(all="ignore"):
            tension, shear = self._strength(damage, *self.parameters.values())
        return CohesiveStrength(tension, shear, opening, compliance)


def stored(state: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the energy that open points would release by closing, T w / 2 [J/m2], shape (n,)."""
    return np.asarray(0.5 * np.maximum(-state["normal_stress"], 0.0) * state["opening"])


@dataclass(frozen=True)
class Losses:
    """Energy per area that a step takes where slip ends with the traction [J/m2], shapes (n,).

    Attributes
    ----------
    shear, tension : ndarray
        Taken by cohesion.
    met : ndarray
        Taken by contact that opens or closes within the step.
    """

    shear: np.ndarray
    tension: np.ndarray
    met: np.ndarray
