"""Two limits of the lumped models in closed form; their published numbers are those of ``ruptfx bench lumped``."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import gamma, jv

from ruptfx.lumped.maxwell_slip import large_number_limit
from ruptfx.lumped.spring_block import SpringBlock


@pytest.mark.parametrize("alpha", [15.0, 22.0, 30.0])
def test_first_harmonic_of_beta_distributed_phases(alpha: float) -> None:
    # The saw-tooth's first harmonic (1 / pi) sin is multiplied by the characteristic function of the phases. For
    # Beta(alpha, alpha) on [-1, 1] it is Gamma(alpha + 1/2) (2 / t)^(alpha - 1/2) J_(alpha - 1/2)(t); the extensions
    # +- mu_s are +- mu_s / drop = +- 2 slip periods, so t = 4 pi. The second harmonic is below 0.001 here.
    t, order = 4 * np.pi, alpha - 0.5
    expected = 2 / np.pi * gamma(alpha + 0.5) * (2 / t) ** order * jv(order, t)
    assert large_number_limit(alpha, 0.3, 0.225)[1] == pytest.approx(expected, abs=2e-3)


@pytest.mark.parametrize("ratio", [1.0, 50.0])
def test_first_rupture_of_the_chain_without_scatter(ratio: float) -> None:
    # Static chain, semi-infinite: K_b (x_(j+1) - 2 x_j + x_(j-1)) = K_s x_j has x_j = x_0 q^j, q + 1/q = 2 + K_s / K_b.
    # Block 0: F = K_b (x_0 - x_1) + K_s x_0. Its contacts break at K_s x_0 = F_s / N, the drive then at F / K_d + x_0.
    K_s, K_b = ratio * 1.56e7, 69 * 1.56e7
    half = 1 + K_s / K_b / 2
    q = half - np.sqrt(half**2 - 1)
    x = 3000 / 70 / K_s
    force = (K_b * (1 - q) + K_s) * x
    found = SpringBlock(scatter=0.0, interface_ratio=ratio, duration=1.05 * (force / 4e6 + x) / 3e-4).run()
    # Viscous drag of the slow approach, N m eta v with v of 0.01 mm/s, is some newtons times 0.01: below 0.1 %.
    assert float(found.first_break_force) == pytest.approx(force, rel=1e-3)
    assert float(found.first_break_time) == pytest.approx((force / 4e6 + x) / 3e-4, rel=1e-3)
    assert found.break_block.values[0] == 0


def test_events_do_not_depend_on_the_time_step() -> None:
    # Until the first detachment of many contacts the motion is not chaotic: halving the step moves it little.
    times = [float(SpringBlock(duration=0.32, step=step).run().event_start[0]) for step in (0.5, 0.25)]
    assert times[0] == pytest.approx(times[1], abs=2e-5)
