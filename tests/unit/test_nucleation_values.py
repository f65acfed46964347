"""Nucleations against their published formulas, written out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from ruptfx.input.schema import alternatives
from ruptfx.laws.friction.coulomb import Coulomb
from ruptfx.laws.nucleation import Nucleation
from ruptfx.laws.nucleation.forced_rupture import ForcedRupture
from ruptfx.laws.nucleation.friction_drop import FrictionDrop
from ruptfx.laws.nucleation.normal_stress_drop import NormalStressDrop
from ruptfx.laws.nucleation.overstress import Overstress
from ruptfx.laws.nucleation.smooth_patch import SmoothPatch


def test_smooth_patch() -> None:
    """TPV101: F(r) = exp(r^2 / (r^2 - R^2)), G(t) = exp((t - T)^2 / (t (t - 2 T))); with R = 1, T = 4.

    At r = R / 2: 0.25 / (0.25 - 1) = -1/3. At t = T / 2: (T / 2)^2 / (T / 2 (-3 T / 2)) = -1/3.
    At t = T / 4: (3 T / 4)^2 / (T / 4 (-7 T / 4)) = -9/7.
    """
    patch = SmoothPatch(extra=2.0, center=0.5, radius=1.0, rise=4.0)
    there = np.array([0.5, 1.0, 0.0, 1.5, 2.0])
    third = np.exp(-1 / 3)
    np.testing.assert_allclose(patch.shear_traction(there, 4.0), [2.0, 2 * third, 2 * third, 0.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(patch.shear_traction(there, 2.0), third * patch.shear_traction(there, 4.0), rtol=1e-12)
    assert patch.shear_traction(there, 1.0)[0] == pytest.approx(2 * np.exp(-9 / 7), rel=1e-12)
    assert not patch.shear_traction(there, 0.0).any()
    assert patch.shear_traction(there, 9.0)[0] == 2.0


def test_overstress_has_its_profile_at_all_times() -> None:
    extra = Overstress(extra=3.0)
    for time in (0.0, 7.0):
        np.testing.assert_array_equal(extra.shear_traction(np.array([0.0, 2.0]), time), [3.0, 3.0])


# Kind: the nucleation, and times with the strengths at 0, 0.5 and 2 m under 1 Pa of a coefficient 0.5. None begins at
# zero or lasts until the end, and none falls at once.
HISTORIES: dict[str, tuple[Nucleation, dict[float, list[float]]]] = {
    # The front leaves 0.25 m at 1 s with 0.5 m/s: at 0 and 0.5 m at 1.5 s. The coefficient falls in 2 s.
    "forced_rupture": (
        ForcedRupture(center=0.25, radius=0.75, speed=0.5, mu_d=0.2, t_w=2.0, start=1.0, end=6.0),
        {1.4: [0.5, 0.5, 0.5], 2.5: [0.35, 0.35, 0.5], 3.6: [0.2, 0.2, 0.5], 5.9: [0.2, 0.2, 0.5],
         6.1: [0.5, 0.5, 0.5]},
    ),
    # Within 0.2 m of 0.5 m; at 2 s half of the fall.
    "friction_drop": (
        FrictionDrop(center=0.5, half_width=0.2, mu_d=0.2, time=1.0, t_w=2.0, end=4.0),
        {0.9: [0.5, 0.5, 0.5], 2.0: [0.5, 0.35, 0.5], 3.1: [0.5, 0.2, 0.5], 3.9: [0.5, 0.2, 0.5], 4.1: [0.5, 0.5, 0.5]},
    ),
    # A pressure of 0.4 Pa takes 0.2 Pa of strength: half of it half a second after its begin, and after its end at 5 s.
    "normal_stress_drop": (
        NormalStressDrop(center=0.0, half_width=0.6, drop=0.4, begin=2.0, duration=3.0, rise=1.0),
        {1.9: [0.5, 0.5, 0.5], 2.5: [0.4, 0.4, 0.5], 4.9: [0.3, 0.3, 0.5], 5.5: [0.4, 0.4, 0.5], 6.1: [0.5, 0.5, 0.5]},
    ),
}  # fmt: skip


def test_every_nucleation_that_weakens_has_a_history_here() -> None:
    weakens = {kind for kind, cls in alternatives("ruptfx.laws.nucleation").items() if "weaken" in vars(cls)}
    assert weakens == set(HISTORIES)


@pytest.mark.parametrize("kind", HISTORIES)
def test_strength_begins_to_fall_and_recovers_at_its_time(kind: str) -> None:
    nucleation, strengths = HISTORIES[kind]
    position, normal = np.array([0.0, 0.5, 2.0]), np.ones(3)
    law = nucleation.weaken(Coulomb(mu_d=0.5), position)
    state = law.initial_state(normal, 0 * normal, 0 * normal)
    for time, expected in strengths.items():
        strength = law.strength(0 * normal, normal, law.advance(state, 0 * normal, normal, time))
        np.testing.assert_allclose(strength, expected, rtol=1e-12, err_msg=f"{time} s")
