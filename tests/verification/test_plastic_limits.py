"""Static limits of plastic bodies: the largest load that a body without hardening carries, in closed form."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.small_cases import HOMALITE, Given

pytest.importorskip("dolfinx")

from ruptfx.bodies.meshes import RawMesh
from ruptfx.case import Case
from ruptfx.platform import fem, parallel
from ruptfx.run.model import Model

pytestmark = [pytest.mark.fem, pytest.mark.mpi]
COMM = fem.MPI.COMM_WORLD

WIDTH = 1e-3  # m, of the punch
DEPTHS = np.concatenate([[0.0], np.geomspace(5e-4, 0.1, 12)])  # over the width
PRESSURE, COHESION, ANGLE, YIELD = 6e6, 1e6, 0.5, 2e7
METAL = {**HOMALITE, "kind": "von_mises", "yield_stress": YIELD, "relaxation_time": 1e-15}
ROCK = {
    **HOMALITE, "kind": "drucker_prager", "cohesion": COHESION, "friction_angle": ANGLE, "relaxation_time": 1e-15,
    "initial_stress": [-PRESSURE] * 3 + [0.0] * 3,
}  # fmt: skip
COULOMB = {**ROCK, "kind": "mohr_coulomb"}


def body(x: np.ndarray, y: np.ndarray) -> Given:
    """Rectangles between lines of x and y; its top is the punch up to x = WIDTH, and free beyond."""
    number = np.arange(len(x) * len(y)).reshape(len(y), len(x))
    corners = [number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]]
    cut = int(np.argmin(np.abs(x - WIDTH)))
    sides = {"bottom": number[0], "punch": number[-1, : cut + 1], "left": number[:, 0], "right": number[:, -1]}
    points = np.stack([each.ravel() for each in np.meshgrid(x, y)], axis=1)
    cells = np.stack(corners, axis=-1).reshape(-1, 4)
    return Given(RawMesh(
        "quadrilateral", points, cells, bodies=["rock"], cell_body=np.zeros(len(cells), int), interfaces={},
        edges={f"rock.{name}": np.stack([row[:-1], row[1:]], axis=1) for name, row in sides.items()},
    ))  # fmt: skip


def held(side: str, component: str) -> dict[str, Any]:
    return {"kind": "driven", "edge": f"rock.{side}", "component": component, "velocity": 0.0}


def pressed(material: dict[str, Any], mesh: Given, supports: list[dict[str, Any]], depths: np.ndarray) -> np.ndarray:
    """Return the mean pressure under the punch [Pa] at depths of indentation [m], the first of which is zero."""
    times = np.linspace(0, 1, len(depths))
    punch = {"kind": "moved", "edge": "rock.punch", "component": "y", "quantity": "displacement",
             "times": times.tolist(), "values": (-depths).tolist()}  # fmt: skip
    case = Case.model_validate({
        "plane": "strain", "order": 2, "duration": 1.0, "mesh": mesh, "boundaries": [*supports, punch],
        "materials": {"default": material}, "output": {"figures": False}, "stepper": {"kind": "quasi_static"},
    })  # fmt: skip
    model = Model(case, COMM)
    motion, state = case.stepper.bind(model), model.initial_state()
    x, y = model.coordinates[: model.owned_nodes, :2].T
    under = np.isclose(y, parallel.largest(COMM, y.max(initial=-1.0))) & (x < WIDTH * (1 + 1e-9))
    pressures = []
    for dt in np.diff(times):
        motion.take(state, motion.equilibrium.solve(state, dt))
        force = motion.equilibrium.forces.internal(state).reshape(model.nodes, -1)[: model.owned_nodes][under]
        pressures.append(-parallel.total(COMM, float(force[:, 1].sum())) / WIDTH)
    return np.array(pressures)


@pytest.mark.parametrize(
    ("material", "limit"),
    [
        (METAL, 2 / np.sqrt(3) * YIELD),
        (ROCK, 2 * (COHESION * np.cos(ANGLE) + PRESSURE * np.sin(ANGLE)) / (1 - np.sin(ANGLE))),
        pytest.param(
            COULOMB,
            2 * (COHESION * np.cos(ANGLE) + PRESSURE * np.sin(ANGLE)) / (1 - np.sin(ANGLE)),
            marks=pytest.mark.slow,
        ),
    ],
    ids=lambda each: each["kind"] if isinstance(each, dict) else "",
)
def test_a_block_between_free_sides(material: dict[str, Any], limit: float) -> None:
    """In plane strain, flow without change of volume ends where the stress along z is the mean of the others."""
    side = np.linspace(0, WIDTH, 3)
    loads = pressed(material, body(side, side), [held("bottom", "y"), held("left", "x")], WIDTH * DEPTHS)
    assert 0 < loads[0] < 0.9 * limit
    assert loads.max() < limit * (1 + 1e-8)
    assert loads[-1] == pytest.approx(limit, rel=1e-6)


@pytest.mark.slow
def test_a_punch() -> None:
    """The pressure under a stiff rough punch on a deep body of a metal ends at (2 + pi) Y / sqrt(3).

    Finite elements approach the limit from above; the edge of the punch makes that of first order, so that the value
    on cells without size follows from two meshes.
    Source: Prandtl (1920), Nachr. Ges. Wiss. Goettingen, 74-85.
    """
    limit = (2 + np.pi) * YIELD / np.sqrt(3)
    supports = [*(held(side, "x") for side in ("left", "right", "bottom", "punch")), held("bottom", "y")]
    ends = []
    for cells in (4, 8):
        x, y = np.arange(0, 4 * cells + 1) * WIDTH / cells, np.arange(-2 * cells, 1) * WIDTH / cells
        loads = pressed(METAL, body(x, y), supports, WIDTH * DEPTHS)
        assert 0 < loads[0] < 0.5 * limit
        assert loads[-1] < 1.005 * loads[-2]  # nothing hardens
        ends.append(loads[-1])
    coarse, fine = ends
    assert limit < fine < coarse
    assert 2 * fine - coarse == pytest.approx(limit, rel=0.01)
