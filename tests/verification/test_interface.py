"""Exact solutions of an interface: plane waves on Coulomb friction, opening, steady sliding, memory of the stress."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.small_cases import HOMALITE, SPLIT, advance, case, guided, memory_friction, two_boxes
from scipy.optimize import brentq

pytest.importorskip("dolfinx")

from ruptfx.laws.friction.coulomb import Coulomb
from ruptfx.laws.friction.prakash_clifton import PrakashClifton
from ruptfx.run.model import Model

pytestmark = pytest.mark.fem

SOFT = {"kind": "isotropic_elastic", "young_modulus": 3.392e9, "poisson_ratio": 0.35, "density": 1100.0}
STIFF_SPRINGS = {"kind": "compliant", "C_n": 1e13, "C_s": 1e13}
METHODS = pytest.mark.parametrize("contact", [STIFF_SPRINGS, SPLIT], ids=["compliant", "split_node"])


def strip(contact: dict[str, Any], fixed: str, drive: list[dict[str, Any]], **changes: Any) -> tuple[Any, Any, Any]:
    """One element wide column of two bodies, 12 mm each: `fixed` is the direction in which its sides do not move."""
    column = case({
        "order": 4, "boundaries": guided(fixed) + drive, "faults.main.contact": contact,
        "mesh": {"kind": "two_plates", "length": 1e-3, "height": 12e-3, "element_size": 1e-3}, **changes,
    })  # fmt: skip
    model = Model(column)
    return model, column.stepper.bind(model), model.initial_state()


@METHODS
@pytest.mark.parametrize("lower", [HOMALITE, SOFT], ids=["equal", "unequal"])
@pytest.mark.parametrize("speed", [0.2, 2.0], ids=["stuck", "slipping"])
def test_plane_s_wave_on_coulomb_friction(contact: dict[str, Any], lower: dict[str, Any], speed: float) -> None:
    """A step of shear stress tau_i = Z1 v meets an interface that carries tau_0 and at most f sigma."""
    sigma, f, tau_0 = 4e6, 0.5, 0.5e6
    drive = [
        {"kind": "driven", "edge": "upper.top", "component": "x", "velocity": speed, "ramp": 6e-6},
        {"kind": "absorbing", "edge": "lower.bottom"},
    ]
    _, motion, state = strip(
        contact, "y", drive, **{
            "materials": {"upper": HOMALITE, "lower": lower}, "faults.main.friction": {"kind": "coulomb", "mu_d": f},
            "faults.main.initial_stress": {"normal": sigma, "shear": tau_0},
        },
    )  # fmt: skip
    # The wave is there after H / c_s = 9.6 us, full after 15.6 us, its echo from the driven top after 28.7 us.
    advance(motion, state, 18e-6)
    fault, before, begin = state.faults["main"], state.faults["main"]["slip"].copy(), state.time
    advance(motion, state, 8e-6)
    mean_rate = (fault["slip"] - before) / (state.time - begin)  # of the ringing of single elements
    Z1, Z2 = (np.sqrt(m["young_modulus"] / 2 / (1 + m["poisson_ratio"]) * m["density"]) for m in (HOMALITE, lower))
    # tau_stuck = tau_0 + 2 Z2 / (Z1 + Z2) tau_i; V = (tau_stuck - f sigma) (Z1 + Z2) / (Z1 Z2).
    stuck = tau_0 + 2 * Z2 / (Z1 + Z2) * Z1 * speed
    slip_rate = max(stuck - f * sigma, 0) * (Z1 + Z2) / (Z1 * Z2)
    assert (slip_rate > 0) == (speed == 2.0)
    np.testing.assert_allclose(fault["shear_traction"], min(stuck, f * sigma), rtol=1e-3)
    np.testing.assert_allclose(mean_rate, slip_rate, rtol=1e-3)
    np.testing.assert_allclose(fault["normal_stress"], sigma, rtol=1e-9)


def test_rupture_time_of_an_exact_slip_rate() -> None:
    """Shear traction added to an interface at its strength makes V = 2 load(t) / Z: exact times of passing."""
    sigma, f, extra, rise = 6e6, 0.5, 1e6, 3e-6
    impedance = np.sqrt(HOMALITE["young_modulus"] / 2 / (1 + HOMALITE["poisson_ratio"]) * HOMALITE["density"])
    patch = {"extra": extra, "center": 0.0, "radius": 1e3, "rise": rise}
    late = []
    for threshold in np.linspace(0.05, 0.6, 8):
        _, motion, state = strip(SPLIT, "y", [], **{
            "faults.main.friction": {"kind": "coulomb", "mu_d": f}, "output.rupture_threshold": threshold,
            "faults.main.initial_stress": {"normal": sigma, "shear": f * sigma},
            "faults.main.nucleation": [{"kind": "smooth_patch", **patch}],
        })  # fmt: skip
        advance(motion, state, rise)

        def grown(t: float) -> float:  # TPV101
            return float(np.exp((t - rise) ** 2 / (t * (t - 2 * rise))))

        exact = brentq(lambda t: 2 * extra * grown(t) / impedance - threshold, 0.1 * rise, rise)  # noqa: B023
        late.append((state.faults["main"]["rupture_time"] - exact) / motion.dt)
    # A time is known to the step in which the threshold is passed; over thresholds that spread over a step it is right.
    assert np.abs(late).max() <= 1.1 and abs(np.mean(late)) < 0.75


@METHODS
def test_p_wave_opens_and_closes_the_gap(contact: dict[str, Any]) -> None:
    """A tensile pulse stronger than the compression: the interface carries no tension, opens, closes, loses nothing."""
    sigma, peak, width = 1e6, 3e6, 2e-3
    model, motion, state = strip(contact, "x", [], **{
        "faults.main.friction": {"kind": "coulomb", "mu_d": 0.5}, "faults.main.initial_stress.normal": sigma,
    })  # fmt: skip
    rho, c = HOMALITE["density"], model.wave_speeds().c_p
    y, dt = model.coordinates[:, 1], motion.dt

    def shape(y: np.ndarray) -> np.ndarray:
        # u = f(y + c t), stress rho c^2 f' = peak exp(-((y - y0) / width)^2), tension positive.
        from scipy.special import erf

        return peak / (rho * c**2) * width * np.sqrt(np.pi) / 2 * (1 + erf((y - 6e-3) / width))

    lower = np.zeros(model.nodes, dtype=bool)
    lower[model.space.dofmap.list[model.bodies.cell_body == model.bodies.names.index("lower")]] = True
    state.displacement[1::2] = np.where(lower, 0, shape(y))
    # A centred difference: u(0) and u(dt) are then those of a wave to second order.
    state.velocity[1::2] = np.where(lower, 0, (shape(y + c * dt) - shape(y - c * dt)) / (2 * dt))
    opening, stress, totals = [], [], []

    def total() -> float:
        energy = model.energies(state)
        return sum(energy.values()) - 2 * energy["boundary_work"]

    start = total()
    # The centre is there after 6 mm / c = 2.7 us, the gap closed after 6.4 us; echoes return 24 mm / c = 10.9 us later.
    for _ in range(int(10e-6 / dt)):
        motion.step(state)
        opening.append(state.faults["main"]["opening"].max())
        stress.append(state.faults["main"]["normal_stress"].min())
        totals.append(total())
    assert min(stress) == 0
    # Open, the faces part with 2 (stress - sigma) / Z: from t1 = -width sqrt(ln(peak / sigma)) / c to where it is back.
    times = np.linspace(-4, 4, 20001) * width / c
    rate = 2 * (peak * np.exp(-((c * times / width) ** 2)) - sigma) / (rho * c)
    gap = np.zeros_like(times)
    for i in range(1, len(times)):
        gap[i] = max(gap[i - 1] + (times[i] - times[i - 1]) * rate[i], 0.0)
    assert max(opening) == pytest.approx(gap.max(), rel=0.03)
    # Nothing slips: it ruptures where it opens, with springs a little later.
    later = 0.2 if contact["kind"] == "compliant" else 0.02
    opens = (6e-3 - width * np.sqrt(np.log(peak / sigma))) / c
    np.testing.assert_allclose(state.faults["main"]["rupture_time"], opens, atol=later * width / c + 2 * dt)
    # Closed again under the initial stress, on average over the ringing of single elements.
    last = slice(-int(2e-6 / dt), None)
    assert max(opening[last]) == 0 and np.mean(stress[last]) == pytest.approx(sigma, rel=0.02)
    assert np.max(np.abs(np.array(totals) - start)) < 1e-3 * abs(start)


@METHODS
def test_steady_sliding_returns_the_steady_strength(contact: dict[str, Any]) -> None:
    """mu_ss(V) = mu_d + (mu_s - mu_d) exp(-(V / V_1)^p), in a column dragged at constant speed."""
    friction = memory_friction("P1")
    friction["law"] |= {"mu_s": 0.4, "mu_d": 0.6}  # strengthening: steady sliding is stable
    drive = [
        {"kind": "driven", "edge": "upper.top", "component": "x", "velocity": 10.0, "ramp": 5e-6},
        {"kind": "driven", "edge": "lower.bottom", "component": "x", "velocity": 0.0},
    ]
    _, motion, state = strip(contact, "y", drive, **{
        "faults.main.friction": friction, "faults.main.initial_stress.normal": 6e6, "damping": {"mass": 5e5},
        "mesh.height": 2e-3, "order": 2,
    })  # fmt: skip
    advance(motion, state, 150e-6)
    fault = state.faults["main"]
    V = np.abs(fault["slip_rate"])
    expected = 0.6 - 0.2 * np.exp(-((V / 29.0) ** 1.2))
    assert np.all(V > 1)
    np.testing.assert_allclose(np.abs(fault["shear_traction"]) / fault["normal_stress"], expected, rtol=1e-6)
    np.testing.assert_allclose(fault["theta_p"], 6e6, rtol=1e-6)
    np.testing.assert_allclose(fault["theta_0"], 10e-6 / V, rtol=1e-6)


@pytest.mark.parametrize("steps", [1, 7, 1000])
def test_normal_stress_memory_relaxes_over_slip(steps: int) -> None:
    """dtheta_p/dt = -(theta_p - D sigma) V / L_p: theta_p - D sigma decays as exp(-slip / L_p), whatever the speed."""
    law = PrakashClifton(law=Coulomb(mu_d=0.5), L_p=40e-6, D=0.8, theta_p_ratio=0.02)
    sigma, V = np.full(3, 10e6), np.array([1e-3, 1.0, 50.0])
    slip = 60e-6
    state = law.initial_state(sigma, 0 * sigma, 0 * sigma)
    np.testing.assert_allclose(state["theta_p"], 0.02 * 0.8 * 10e6)
    for _ in range(steps):
        state = law.advance(state, V, sigma, slip / V / steps)
    expected = 8e6 + (0.16e6 - 8e6) * np.exp(-1.5)
    np.testing.assert_allclose(state["theta_p"], expected, rtol=1e-10)


@pytest.mark.parametrize("edge", [
    {"kind": "absorbing"}, {"kind": "driven", "component": "x", "velocity": 0.0},
    {"kind": "driven", "component": "y", "velocity": 0.0},
], ids=["absorbing", "roller", "fixed across"])  # fmt: skip
def test_an_interface_in_3d_meets_an_edge(edge: dict[str, Any]) -> None:
    """Dashpots and rollers differ between the tangents there, and so do their impedances: stable, and nothing is lost.

    The traction has components along both tangents and is above the strength everywhere from the start.
    """
    pressed = case({
        "plane": "solid", "order": 2, "duration": 30e-6, "faults.main.contact": SPLIT,
        "faults.main.friction": {"kind": "linear_slip_weakening", "mu_s": 0.3, "mu_d": 0.2, "D_c": 1e-6},
        "faults.main.initial_stress": {"tensor": [0.0, 0.0, -6e6, 0.0, 1.2e6, 1.7e6]},
        "boundaries": [{**edge, "edge": f"{body}.right"} for body in ("upper", "lower")],
    }).substituted({"mesh": two_boxes()})  # fmt: skip
    model = Model(pressed)
    motion, state, face = pressed.stepper.bind(model), model.initial_state(), model.faults[0].interface
    for _ in range(150):
        motion.step(state)
        mean = model.faults[0].components(state.faults["main"], "mean_slip_rate")
        # What the friction law was asked for is what the bodies do.
        np.testing.assert_allclose(face.split(face.jump(state.velocity))[1], mean, rtol=0, atol=1e-6)
    energy = model.energies(state)
    lost = energy["boundary_work"] - sum(value for name, value in energy.items() if name != "boundary_work")
    # What cannot move has 1e-8 of the mobility of others.
    assert abs(lost) < (1e-10 if edge["kind"] == "absorbing" else 1e-7) * energy["boundary_work"]
    # The boxes are thin: 2 (tau_0 - mu_d sigma) / (rho h) = 0.7 km/s2 for 150 steps, and waves on top of it.
    assert 1 < np.abs(mean).max() < 60


@METHODS
def test_friction_work_of_the_points_is_the_dissipated_energy(contact: dict[str, Any]) -> None:
    """Sum of area and work per area, explicit and, with springs, implicit steps."""
    drive = [{"kind": "driven", "edge": "upper.top", "component": "x", "velocity": 2.0, "ramp": 2e-6}]
    for stepper in ["leapfrog", "generalized_alpha"] if contact["kind"] == "compliant" else ["leapfrog"]:
        model, motion, state = strip(contact, "y", drive, **{
            "faults.main.friction": {"kind": "coulomb", "mu_d": 0.1}, "faults.main.initial_stress.normal": 4e6,
            "mesh.height": 4e-3, "order": 2, "stepper": {"kind": stepper},
        })  # fmt: skip
        advance(motion, state, 12e-6)
        face = model.faults[0].interface
        total = float(np.sum(face.owned * face.weight * state.faults["main"]["friction_work"]))
        assert total > 0 and total == pytest.approx(state.energy["frictional_dissipation"], rel=1e-12)
