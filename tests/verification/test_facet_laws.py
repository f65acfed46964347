"""Laws of facets that vary from place to place, and friction with rates on cracks."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.crack_cases import HERE, NEVER, RUBS, WEAK, block, case
from helpers.small_cases import march

pytest.importorskip("dolfinx")

from helpers.messages import facts

from ruptfx.app.checks.preflight import preflight
from ruptfx.case import parse_case
from ruptfx.input.schema import CaseError
from ruptfx.run.model import Model

pytestmark = pytest.mark.fem
WEAKENING = {"kind": "velocity_weakening", "mu_s": 0.6, "mu_d": 0.2, "V_w": 5.0}
AGEING = {"kind": "rate_and_state_ageing", "a": 0.01, "b": 0.015, "D_c": 1e-6, "f_0": 0.6, "V_0": 1e-6,
          "theta_initial": 1.0}  # fmt: skip
STEADY = {"velocity_weakening": lambda v: 0.2 + 0.4 * np.exp(-v / 5),
          "rate_and_state_ageing": lambda v: 0.6 - 0.005 * np.log(v / 1e-6)}  # fmt: skip


def balance(energy: dict[str, float]) -> float:
    """Relative error of an energy budget."""
    work = energy["boundary_work"]
    return (2 * work - sum(energy.values())) / work


@pytest.mark.parametrize("law", [WEAKENING, AGEING])
@pytest.mark.parametrize("bonded", [False, True])
def test_a_facet_that_slides_steadily_has_the_steady_strength(law: dict[str, Any], bonded: bool) -> None:
    """Under a given jump that grows by 0.5 m/s: strength of the law, age D_c / V, energies, and G_IIc of the bond."""
    laws = {"friction": law} | ({"cohesion": WEAK} if bonded else {})
    model = Model(case({
        "mesh": {"kind": "triangles", "width": 1e-3, "height": 1e-3, "element_size": 1e-3}, "boundaries": [],
        "fracture.default": laws, "fracture.stiffness_ratio": 100.0,
    }))  # fmt: skip
    state, cracks = model.initial_state(), model.cracks
    pressure, speed, dt, work = 5e6, 0.5, 1e-8, 0.0
    rows, plus = state.displacement.reshape(-1, 2), model.space.dofmap.list[cracks.network.cells[0, 1]]
    for step in range(12_000):
        before = cracks.tractions(state.cracks)[0].sum(axis=0)
        jump = -pressure / cracks.stiffness[0] * cracks.normal[0] + speed * dt * step * cracks.tangent[0]
        moved = jump - rows[cracks.corners[0, 1, 0]]
        rows[plus] = jump
        state.force[:] = 0
        cracks(state, model.mass, dt if step else 0.0)
        work += 0.5 * cracks.weight[0] * float((before + cracks.tractions(state.cracks)[0].sum(axis=0)) @ moved)
    strength = STEADY[law["kind"]](speed) * pressure
    np.testing.assert_allclose(state.cracks["shear_traction"], strength, rtol=1e-6)
    if "theta" in state.cracks:
        np.testing.assert_allclose(state.cracks["theta"], law["D_c"] / speed, rtol=1e-6)
    taken = {name: state.energy[name] for name in ("fracture", "frictional_dissipation", "impact_loss")}
    assert sum(taken.values()) + cracks.stored(state.cracks, 0 * state.displacement) == pytest.approx(work, rel=1e-10)
    length = 2 * cracks.weight[0]
    assert taken["fracture"] == pytest.approx(WEAK["G_IIc"] * length if bonded else 0.0, rel=1e-3)


@pytest.mark.parametrize("law", [WEAKENING, AGEING])
def test_a_block_that_slides_on_a_row_of_facets_reaches_the_steady_strength(law: dict[str, Any]) -> None:
    """Driven at 2 m/s under a given pressure: mean shear over mean normal traction of the row, after many D_c.

    Its vibration is damped; under less damping it goes on, and the mean strength of ends whose slip rates differ is not
    that at the mean rate.
    """
    speed = 2.0
    given = case({
        "mesh.divide": 5e-3, "mesh.turn": 0.0, "duration": 40e-6,
        "fracture": {"kind": "intrinsic", "default": {"cohesion": NEVER, "friction": RUBS},
                     "pairs": {"lower-upper": {"friction": law}}},
        "damping": {"kelvin_voigt": {"fraction": 0.3}, "mass": 1e6},
        "boundaries": [
            {"kind": "driven", "edge": "lower.bottom", "component": "x", "velocity": 0.0},
            {"kind": "driven", "edge": "lower.bottom", "component": "y", "velocity": 0.0},
            {"kind": "driven", "edge": "upper.top", "component": "x", "velocity": speed, "ramp": 2e-6},
            {"kind": "moved", "edge": "upper.top", "component": "y", "quantity": "velocity",
             "times": [0.0, 2e-6, 6e-6, 8e-6, 1.0], "values": [0.0, -0.2, -0.2, 0.0, 0.0]},
        ],
    })  # fmt: skip
    ratios: list[float] = []

    def watch(state: Any) -> None:
        if state.time > 30e-6:
            normal, shear = (state.cracks[name][row].sum() for name in ("normal_traction", "shear_traction"))
            ratios.append(abs(shear / normal))

    model = Model(given)
    row = np.flatnonzero(np.ptp(model.cracks.network.bodies[model.cracks.order], axis=1))
    _, motion, state = march(given, watch=watch)
    assert np.mean(ratios) == pytest.approx(STEADY[law["kind"]](speed), rel=1e-4)
    assert abs(balance(motion.energies(state))) < 1e-9


def test_a_bar_with_a_weak_place_breaks_there_at_that_strength() -> None:
    """Strength 4 MPa, and 2 MPa between y = 11 and 13 mm of 20 mm: the mean stress of the bar peaks at 2 MPa.

    Facets across the bar, a load that takes ten passages of waves, a process zone longer than the bar is wide.
    """
    weak = {"kind": "boxcar", "inside": 2e6, "outside": 4e6, "center": 12e-3, "half_width": 1.1e-3}
    given = case({
        "mesh": {"kind": "triangles", "width": 4e-3, "height": 20e-3, "element_size": 1e-3},
        "fracture.default": {"cohesion": {**WEAK, "f_t": weak}, "friction": RUBS}, "fracture.profiles_along": "y",
        "duration": 70e-6, "damping": {"kelvin_voigt": {"fraction": 0.3}}, "boundaries": [
            {"kind": "driven", "edge": f"rock.{side}", "component": "y", "velocity": sign * 8e-3, "ramp": 10e-6}
            for side, sign in (("top", 1), ("bottom", -1))],
    })  # fmt: skip
    model = Model(given)
    loads: list[float] = []
    assert {float(f"{v:.6g}") for v in np.unique(model.cracks.groups[0].laws.cohesion.f_t)} == {2e6, 4e6}

    ends = model.cracks.network.ends[model.cracks.order]
    across = np.flatnonzero((np.ptp(ends[..., 1], axis=1) < 1e-9) & (np.abs(ends[:, 0, 1] - 6e-3) < 1e-9))
    assert len(across) == 4

    def watch(state: Any) -> None:
        loads.append(float(state.cracks["normal_traction"][across].mean()))

    _, motion, state = march(given, watch=watch)
    yielded = np.isfinite(state.cracks["time_of_yield"])
    assert yielded.any() and np.all(np.abs(ends[yielded].mean(axis=1)[:, 1] - 12e-3) < 1.6e-3)
    assert max(loads) == pytest.approx(2e6, rel=0.05)
    assert abs(balance(motion.energies(state))) < 1e-9


def test_check_takes_the_shortest_process_zone() -> None:
    """That of the strongest place."""
    weak = {"kind": "boxcar", "inside": 2e6, "outside": 4e6, "center": 4e-3, "half_width": 1e-3}
    name = "fracture rock-rock: process zone I"
    found = [
        {row.quantity: row.value for row in preflight(parse_case(
            block({"fracture.default.cohesion": {**WEAK, "f_t": given}}), HERE))}[name] for given in (4e6, weak)
    ]  # fmt: skip
    assert found[0] == found[1]


@pytest.mark.parametrize("changes, said", [
    ({"fracture.kind": "extrinsic", "fracture.default.friction": WEAKENING}, "depends on the slip rate or on time"),
    ({"fracture.default.friction": {**AGEING, "theta_initial": None}}, "give fracture.default.friction.V_initial and"),
    ({"fracture.default.cohesion": {**WEAK, "f_t": {"kind": "boxcar", "inside": 0.0, "outside": 4e6, "center": 4e-3,
      "half_width": 1e-3}}}, "cohesion.f_t is zero somewhere"),
])  # fmt: skip
def test_laws_that_facets_cannot_have_are_refused(changes: dict[str, Any], said: str) -> None:
    friction = changes.get("fracture.default.friction")
    if friction:
        changes = {**changes, "fracture.default.friction": {k: v for k, v in friction.items() if v is not None}}
    with pytest.raises(CaseError, match=facts(said)):
        Model(case(changes))
