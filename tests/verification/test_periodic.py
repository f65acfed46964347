"""Periodic edges: waves go through them, a fault that crosses them does not know where they are."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.small_cases import HOMALITE, SPLIT, STRONG, case, march, merged, slip_weakening

pytest.importorskip("dolfinx")

from helpers.messages import facts

from ruptfx import RuptfxError
from ruptfx.bodies.meshes import RawMesh
from ruptfx.bodies.meshes.two_plates import TwoPlates
from ruptfx.bodies.space.bodies import tied_facets
from ruptfx.case import parse_case
from ruptfx.input.schema import CaseError
from ruptfx.platform import fem, parallel
from ruptfx.run.model import Model

pytestmark = [pytest.mark.fem, pytest.mark.mpi]

COMM = fem.MPI.COMM_WORLD
SIDES = [{"kind": "periodic", "first": f"{body}.left", "second": f"{body}.right"} for body in ("upper", "lower")]
DRIVEN = {"kind": "driven", "edge": "upper.top", "component": "x", "velocity": 1.0, "ramp": 1e-6}
SPEED = np.sqrt(HOMALITE["young_modulus"] / (2 * (1 + HOMALITE["poisson_ratio"])) / HOMALITE["density"])


def glued(changes: dict[str, Any]) -> dict[str, Any]:
    """Two plates that do not slip, on nodes of their own, with periodic sides."""
    return {"faults.main.contact": SPLIT, "faults.main.friction": STRONG, "boundaries": SIDES, **changes}


def everywhere(model: Model, field: np.ndarray) -> np.ndarray:
    """Coordinates, body and a nodal field of all ranks in the order of `Nodes.numbering`, on every rank."""
    rows = np.column_stack([model.coordinates, model.layout.body, field.reshape(model.nodes, -1)])
    return parallel.share_rows(COMM, model.layout.collect(rows.ravel()))


def test_a_pulse_goes_through_as_in_a_long_plate() -> None:
    """The same nodes, time step and pulse; the long plate is so long that its ends are never heard of."""
    fields = []
    for length, left, edges in ((12e-3, 0.0, SIDES), (96e-3, -42e-3, [])):
        pulse = case(glued({
            "order": 3, "duration": 7.2e-6, "boundaries": edges, "mesh.length": length, "mesh.left": left,
            "stepper": {"kind": "leapfrog", "time_step": 6e-8},
        }))  # fmt: skip
        model = Model(pulse)
        motion, state = pulse.stepper.bind(model), model.initial_state()
        x = model.coordinates[:, 0]
        # A plane P wave to the right, which is 12 mm wide and starts in the middle of the short plate.
        state.velocity.reshape(-1, 2)[:, 0] = np.where(abs(x - 6e-3) < 6e-3, np.cos(np.pi * (x - 6e-3) / 12e-3) ** 4, 0)
        for _ in range(120):
            motion.step(state)
        fields.append(everywhere(model, state.velocity))
    short, long = fields
    nanometres = [np.round(rows[:, :3] * [1e9, 1e9, 1]).astype(int) for rows in fields]
    folded: dict[tuple[int, ...], np.ndarray] = {}
    for (x, *rest), value in zip(nanometres[1].tolist(), long[:, 3:], strict=True):
        place = (x % 12_000_000, *rest)
        folded[place] = folded.get(place, 0.0) + value
    unrolled = np.array([folded[x % 12_000_000, y, body] for x, y, body in nanometres[0].tolist()])
    np.testing.assert_allclose(short[:, 3:], unrolled, atol=1e-12)
    assert np.abs(short[:, 3:]).max() > 0.3


def test_oblique_waves_against_the_exact_solution() -> None:
    """SH waves at +-45 degrees between free edges: u_z = cos(k y) sin(k x - omega t) with k H = pi;
    order 5, so that the step is what is left of the error: of second order."""
    errors = []
    for steps in (80, 160):
        k = np.pi / 4e-3  # the plates are 4 mm high, 8 mm long
        omega = SPEED * np.sqrt(2) * k
        wave = case(glued({
            "plane": "antiplane", "order": 5, "mesh.length": 8e-3, "duration": 8e-6,
            "stepper": {"kind": "leapfrog", "time_step": 8e-6 / steps},
        }))  # fmt: skip
        model = Model(wave)
        motion, state = wave.stepper.bind(model), model.initial_state()
        x, y = model.coordinates.T
        state.displacement[:] = np.cos(k * y) * np.sin(k * x)
        state.velocity[:] = -omega * np.cos(k * y) * np.cos(k * x)
        for _ in range(steps):
            motion.step(state)
        assert state.time == pytest.approx(8e-6)
        exact = np.cos(k * y) * np.sin(k * x - omega * state.time)
        errors.append(parallel.largest(COMM, np.abs(state.displacement - exact).max()))
    assert errors[1] < 1e-2 and 3.8 < errors[0] / errors[1] < 4.2


def rupture(center: float | None) -> dict[str, Any]:
    """Overstressed around a position, or around the edge."""
    patch = {"inside": 3.7e6, "outside": 2.8e6, "center": 8e-3, "half_width": 3e-3}
    if center is None:  # what is not within 5 mm of the middle is within 3 mm of the edge
        patch = {"inside": 2.8e6, "outside": 3.7e6, "center": 8e-3, "half_width": 5e-3}
    return slip_weakening({
        "mesh.length": 16e-3, "mesh.height": 4e-3, "duration": 5e-6, "boundaries": SIDES,
        "faults.main.initial_stress.shear": {"kind": "boxcar", **patch},
        # The ends of the boxes are at nodes, which are inside or not.
        "stepper": {"kind": "leapfrog", "time_step": 4e-8}, "order": 3,
    })  # fmt: skip


def test_a_rupture_does_not_know_where_the_edge_is() -> None:
    """The patch in the middle, and across the edge: the same but for half a length; energy closes."""
    slips = []
    for center in (8e-3, None):
        ruptured = parse_case(rupture(center))
        model, motion, state = march(ruptured)
        face, fields = model.faults[0].interface, state.faults["main"]
        assert face.total == 8 * 3  # one point less than nodes along 8 elements
        assert face.line.length == pytest.approx(16e-3)
        assert parallel.total(COMM, (face.owned * face.weight).sum()) == pytest.approx(16e-3)
        energy = motion.energies(state)
        lost = energy["boundary_work"] - sum(value for name, value in energy.items() if name != "boundary_work")
        assert abs(lost) < 1e-12 * energy["boundary_work"]
        rows = parallel.share_rows(COMM, np.column_stack([face.number, fields["slip"]])[face.owned])
        slips.append(rows[np.argsort(rows[:, 0]), 1])
    middle, edge = slips
    slid = middle > 0.01 * middle.max()
    assert 0.3 < slid.mean() <= 1 and middle.max() > 1e-6
    np.testing.assert_allclose(np.roll(edge, 12), middle, atol=1e-9 * middle.max())


def test_the_same_on_any_number_of_ranks() -> None:
    fields = []
    for comm in (COMM, fem.MPI.COMM_SELF):
        model = Model(parse_case(merged(rupture(None), {"duration": 3e-6})), comm)
        motion, state = model.case.stepper.bind(model), model.initial_state()
        for _ in range(75):
            motion.step(state)
        fields.append(parallel.share_rows(model.comm, model.layout.collect(state.velocity)))
    np.testing.assert_allclose(fields[0], fields[1], atol=1e-10 * np.abs(fields[1]).max())


# -- what is refused -------------------------------------------------------------------------------------------------


def plates() -> RawMesh:
    return TwoPlates(length=4.0, height=2.0, element_size=1.0).build()


def test_edges_that_do_not_match_are_refused() -> None:
    raw = plates()
    node = raw.edges["upper.right"][0, 1]  # at (4, 1) m
    raw.points[node, 1] += 0.25
    with pytest.raises(RuptfxError, match=(
        facts(r"b: 'upper\.left' \(3 vertices\) and 'upper\.right' \(3\) are not the same edge, \(4, 0\) m: "
        r"vertex of 'upper\.right' at \(4, 1\.25\) m is 0\.25 m from its nearest partner, at most 4e-08 m .*Periodic")
    )):  # fmt: skip
        tied_facets(raw, "b", "upper.left", "upper.right")
    with pytest.raises(RuptfxError, match=facts(r"b\.second = 'upper\.write': no such edge")):
        tied_facets(plates(), "b", "upper.left", "upper.write")


@pytest.mark.parametrize("changes, said", [
    ({"boundaries": SIDES[:1]},
     r"boundaries\.0: the node at \(\S+, 0\) m .*'main' .*boundaries.* kind = 'periodic' .*remove boundaries\.0"),
    ({"boundaries": [DRIVEN, SIDES[1]]}, r"boundaries\.1: the node at \(\S+, 0\) m .*'main' .*remove boundaries\.1"),
    ({"boundaries": SIDES, "stepper": {"kind": "petsc_ts"}},
     r"boundaries\.0\.kind = 'periodic', .*: stepper\.kind = 'petsc_ts' cannot tie nodes; use .*'leapfrog'"),
    ({"boundaries": [*SIDES, {"kind": "periodic", "first": "lower.bottom", "second": "upper.top"}]},
     r"boundaries\.0, boundaries\.1, boundaries\.2: the node at \(.*\) m is tied to two others"),
    ({"boundaries": [SIDES[0], SIDES[1],
                     {"kind": "driven", "edge": "upper.left", "component": "x", "velocity": 1.0, "ramp": 1e-6}]},
     r"one of two nodes that are tied is driven, at \(.*drive both or none"),
], ids=["one side of an interface", "its other side", "steps of PETSc", "two directions", "driven alone"])  # fmt: skip
def test_what_cannot_be_tied_is_refused(changes: dict[str, Any], said: str) -> None:
    with pytest.raises((CaseError, RuptfxError), match=facts(said)):
        Model(
            case(
                {
                    "faults.main.contact": SPLIT
                    if "stepper" not in changes
                    else {"kind": "compliant", "C_n": 3e11, "C_s": 1e11},
                    **changes,
                }
            )
        )
