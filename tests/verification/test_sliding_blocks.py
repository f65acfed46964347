"""Blocks from mesh files whose nodes do not match, on a slope: patch test, sliding, an end that leaves, bad meshes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.sliding_cases import STIFF
from helpers.small_cases import advance

pytest.importorskip("dolfinx")
pytest.importorskip("gmsh")

from helpers.messages import facts

from ruptfx import RuptfxError
from ruptfx.bodies.state import State
from ruptfx.case import Case, parse_case
from ruptfx.run.model import Model

pytestmark = pytest.mark.fem

SLOPE = 0.3  # rad, down to +x
LENGTH = 1e-3
G = 3e7  # m/s2
# A block of 1 on 0.2 mm at `left`, `lift` above a base of 3 mm.
BLOCKS = """
Point(1) = {{0, -0.4e-3, 0}}; Point(2) = {{3e-3, -0.4e-3, 0}}; Point(3) = {{3e-3, 0, 0}}; Point(4) = {{0, 0, 0}};
Point(5) = {{{left}, {lift}, 0}}; Point(6) = {{{left} + 1e-3, {lift}, 0}};
Point(7) = {{{left} + 1e-3, {lift} + 0.2e-3, 0}}; Point(8) = {{{left}, {lift} + 0.2e-3, 0}};
Line(1) = {{1, 2}}; Line(2) = {{2, 3}}; Line(3) = {{3, 4}}; Line(4) = {{4, 1}};
Line(5) = {{5, 6}}; Line(6) = {{6, 7}}; Line(7) = {{7, 8}}; Line(8) = {{8, 5}};
Curve Loop(1) = {{1, 2, 3, 4}}; Curve Loop(2) = {{5, 6, 7, 8}};
Plane Surface(1) = {{1}}; Plane Surface(2) = {{2}};
Rotate {{{{0, 0, 1}}, {{0, 0, 0}}, -{slope}}} {{ Surface{{1, 2}}; }}
Transfinite Curve{{1, 3}} = 18 + 1; Transfinite Curve{{2, 4}} = 2 + 1;
Transfinite Curve{{5, 7}} = {elements} + 1; Transfinite Curve{{6, 8}} = 2 + 1;
Transfinite Surface{{1, 2}}; Recombine Surface{{1, 2}};
Physical Surface("base") = {{1}}; Physical Surface("block") = {{2}};
Physical Curve("main") = {{{interface}}}; Physical Curve("base.bottom") = {{1}}; Physical Curve("block.top") = {{7}};
"""


def blocks(folder: Path, changes: dict[str, Any] | None = None, **mesh: object) -> Case:
    """The base held, the block free."""
    values = {"left": 0.5e-3, "lift": 0.0, "slope": SLOPE, "elements": 7, "interface": "3, 5", **mesh}
    path = folder / "blocks.geo"
    path.write_text(BLOCKS.format(**values))
    made = parse_case({
        "plane": "strain", "order": 3, "duration": 1e-6,
        "mesh": {"kind": "gmsh_file", "file": str(path),
                 "interfaces": {"main": {"plus": "block", "minus": "base", "matching": False}}},
        "materials": {"default": STIFF}, "damping": {"kelvin_voigt": {"fraction": 0.2}},
        "faults": {"main": {
            "sliding": {}, "contact": {"kind": "forward_lagrange"}, "friction": {"kind": "coulomb", "mu_d": 0.1},
            "initial_stress": {"normal": 0.0},
        }},
        "boundaries": [
            {"kind": "driven", "edge": "base.bottom", "component": axis, "velocity": 0.0} for axis in "xy"
        ], "output": {"figures": False}, **(changes or {}),
    })  # fmt: skip
    assert isinstance(made, Case)
    return made


@pytest.mark.parametrize("order", [1, 2, 4])
def test_uniform_stress_passes_a_slope(order: int, tmp_path: Path) -> None:
    """Patch test: a uniform strain in both bodies and its stress on the interface leave no force on any node of it,
    but on the ends of either surface, which have free edges as well."""
    model = Model(blocks(tmp_path, {"order": order}))
    face = model.faults[0].interface
    stress = np.array([[1e6, -0.4e6], [-0.4e6, -3e6]])
    E, nu = STIFF["young_modulus"], STIFF["poisson_ratio"]
    strain = (1 + nu) / E * (stress - nu * np.trace(stress) * np.eye(2))  # Hooke's law in plane strain
    force = model.internal_force((model.coordinates @ strain).ravel())
    normal, tangent = face.frame[:, 0], face.frame[:, 1]
    np.testing.assert_allclose(normal, np.tile([np.sin(SLOPE), np.cos(SLOPE)], (face.total, 1)), atol=1e-12)
    traction = np.stack([np.sum(d * (normal @ stress), axis=1) for d in (normal, tangent)], axis=1)
    face.add_force(force, traction, scale=np.ones_like(force))
    x = (model.coordinates - face.points[0]) @ [np.cos(SLOPE), -np.sin(SLOPE)]  # along the slope, from the upper end
    y = (model.coordinates - face.points[0]) @ [np.sin(SLOPE), np.cos(SLOPE)]
    inside = (np.abs(y) < 1e-9) & (x > 1e-9) & (x < LENGTH - 1e-9)
    # On the base, nodes that face the ends of the block are next to its free top.
    facets = 3e-3 / 18
    block = np.zeros(model.nodes, dtype=bool)
    block[face.plus] = True
    inside &= block | ((x > facets) & (x < LENGTH - facets))
    assert inside.sum() > 6 * order
    largest = 3e6 * face.weight.max()
    np.testing.assert_allclose(force.reshape(-1, 2)[inside], 0.0, atol=1e-9 * largest)


def along_slope(model: Model, state: State, field: str) -> float:
    """Mean of a nodal field of the block, downhill."""
    mass = (model.mass.reshape(-1, 2)[:, 0]) * (model.layout.body == model.bodies.names.index("block"))
    return float(mass @ (getattr(state, field).reshape(-1, 2) @ [np.cos(SLOPE), -np.sin(SLOPE)]) / mass.sum())


def heavy(folder: Path, mu: float, **mesh: object) -> tuple[Model, Any, State]:
    """A heavy block on the base."""
    weight = {"kind": "gravity", "acceleration": [0.0, -G], "ramp": 2e-6}
    held = [{"kind": "driven", "edge": "base.bottom", "component": axis, "velocity": 0.0} for axis in "xy"]
    given = blocks(folder, {
        "boundaries": [*held, weight], "faults": {"main": {
            "sliding": {}, "contact": {"kind": "forward_lagrange"}, "friction": {"kind": "coulomb", "mu_d": mu},
            "initial_stress": {"normal": 0.0},
        }},
    }, **mesh)  # fmt: skip
    model = Model(given)
    return model, given.stepper.bind(model), model.initial_state()


@pytest.mark.parametrize("mu", [0.1, 0.5])
def test_a_block_slides_down(mu: float, tmp_path: Path) -> None:
    """With a = g (sin - mu cos) over six elements of the base; or it stays, where what slides goes 0.3 mm."""
    model, motion, state = heavy(tmp_path, mu)
    advance(motion, state, 4e-6)
    before, began = along_slope(model, state, "velocity"), state.time
    advance(motion, state, 14e-6 if mu < np.tan(SLOPE) else 4e-6)
    gained = (along_slope(model, state, "velocity") - before) / (state.time - began)
    way, face = along_slope(model, state, "displacement"), model.faults[0].interface
    if mu < np.tan(SLOPE):
        np.testing.assert_allclose(gained, G * (np.sin(SLOPE) - mu * np.cos(SLOPE)), rtol=5e-3)
        assert 0.7e-3 < way < 1.5e-3 and face.covered.all()
        np.testing.assert_allclose(state.faults["main"]["slip"].mean(), way, rtol=1e-2)
    else:
        assert abs(gained) < 1e-2 * G and way < 2e-6  # of elastic shear


def test_a_block_leaves_by_its_end(tmp_path: Path) -> None:
    """It begins 0.2 mm from the end of the base: what reaches over carries nothing, the energy budget closes."""
    model, motion, state = heavy(tmp_path, 0.1, left=1.8e-3)
    face, spacing = model.faults[0].interface, LENGTH / 21
    advance(motion, state, 12e-6)
    over = along_slope(model, state, "displacement") - 0.2e-3
    assert 0.1e-3 < over < 0.3e-3
    np.testing.assert_allclose(face.weight[~face.covered].sum(), over, atol=spacing)
    np.testing.assert_allclose(face.weight.sum(), LENGTH, atol=spacing)
    assert not np.any(state.faults["main"]["normal_stress"][~face.covered])
    energy = motion.energies(state)
    work = energy.pop("boundary_work")
    assert energy["frictional_dissipation"] > 0.05 * work and abs(work - sum(energy.values())) < 1e-10 * work


# Three bodies of 1 on 0.3 mm, one on the other, whose elements differ.
STACK = """
Geometry.AutoCoherence = 0;
For k In {{0:2}}
  p = newp; y = 0.3e-3 * k;
  Point(p) = {{0, y, 0}}; Point(p + 1) = {{1e-3, y, 0}}; Point(p + 2) = {{1e-3, y + 0.3e-3, 0}};
  Point(p + 3) = {{0, y + 0.3e-3, 0}};
  Line(4 * k + 1) = {{p, p + 1}}; Line(4 * k + 2) = {{p + 1, p + 2}}; Line(4 * k + 3) = {{p + 2, p + 3}};
  Line(4 * k + 4) = {{p + 3, p}};
  Curve Loop(k + 1) = {{4 * k + 1, 4 * k + 2, 4 * k + 3, 4 * k + 4}}; Plane Surface(k + 1) = {{k + 1}};
  Transfinite Curve{{4 * k + 2, 4 * k + 4}} = 2 + 1;
EndFor
Transfinite Curve{{1, 3}} = 5 + 1; Transfinite Curve{{5, 7}} = 7 + 1; Transfinite Curve{{9, 11}} = 6 + 1;
Transfinite Surface{{1, 2, 3}}; Recombine Surface{{1, 2, 3}};
Physical Surface("base") = {{1}}; Physical Surface("middle") = {{2}}; Physical Surface("top") = {{3}};
Physical Curve("below") = {{3, 5}}; Physical Curve("above") = {{7, 9}};
Physical Curve("base.bottom") = {{1}}; Physical Curve("top.top") = {{11}};
""".replace("{{", "{").replace("}}", "}")


def test_two_interfaces_that_slide(tmp_path: Path) -> None:
    """A body between two others: the wave of a pressed edge, sigma = rho c v, passes both interfaces; the shear behind
    it, rho c_s v = 0.71 sigma, makes the upper one slide, whose friction of 0.2 the lower one bears with 0.4."""
    (tmp_path / "stack.geo").write_text(STACK)
    mu, speed = {"below": 0.4, "above": 0.2}, 4.0
    c = np.sqrt(STIFF["young_modulus"] / STIFF["density"])  # nu = 0
    sides = {"below": ("middle", "base"), "above": ("top", "middle")}
    interfaces = {name: {"plus": plus, "minus": minus, "matching": False} for name, (plus, minus) in sides.items()}
    given = blocks(tmp_path, {
        "duration": 0.7e-6,
        "mesh": {"kind": "gmsh_file", "file": str(tmp_path / "stack.geo"), "interfaces": interfaces},
        "materials": {"default": {**STIFF, "poisson_ratio": 0.0}},
        "faults": {name: {
            "sliding": {}, "contact": {"kind": "forward_lagrange"}, "friction": {"kind": "coulomb", "mu_d": mu[name]},
            "initial_stress": {"normal": 0.0},
        } for name in interfaces},
        "boundaries": [
            {"kind": "driven", "edge": "top.top", "component": "y", "velocity": -speed, "ramp": 1e-7},
            {"kind": "driven", "edge": "top.top", "component": "x", "velocity": speed, "ramp": 1e-7},
            {"kind": "absorbing", "edge": "base.bottom"},
        ],
    })  # fmt: skip
    model = Model(given)
    motion, state = given.stepper.bind(model), model.initial_state()
    assert [fault.name for fault in model.faults] == list(interfaces) and not model.faults[0].interface.one_sided
    advance(motion, state, 0.7e-6)  # the wave has 1.4 mm behind it
    pressure, slips = STIFF["density"] * c * speed, {}
    for fault in model.faults:
        face, found = fault.interface, state.faults[fault.name]
        middle = np.abs(face.points[:, 0] - 0.5e-3) < 0.25e-3
        mean = np.average(found["normal_stress"][middle], weights=face.weight[middle])
        np.testing.assert_allclose(mean, pressure, rtol=0.05)
        slips[fault.name] = np.abs(found["slip"][middle])
    # Where contact begins it rings: the lower one slips by the bit that the noise of its first pressure allows.
    assert slips["above"].min() > 1e-6 and slips["below"].max() < 1e-4 * slips["above"].min()
    energy = motion.energies(state)
    work = energy.pop("boundary_work")
    assert abs(work - sum(energy.values())) < 1e-10 * work


# -- what is refused -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "mesh, message",
    [
        ({"lift": -1e-5}, r"'main': the bodies overlap by 1e-05 m at \(\S+, \S+\) m before anything moves, at most"),
        ({"interface": "3, 6, 8"}, r"main.plus: 4 facets that are not one line with two ends"),
        ({"interface": "3"}, r"interface 'main' has 0 facets on its plus and 18 on its minus side; name those of both"),
        ({"interface": "5"}, r"interface 'main' has 7 facets on its plus and 0 on its minus side"),
    ],
)
def test_blocks_that_cannot_slide(mesh: dict[str, object], message: str, tmp_path: Path) -> None:
    with pytest.raises(RuptfxError, match=facts(message)):
        Model(blocks(tmp_path, **mesh))


def test_without_the_table_the_remedy_is_named(tmp_path: Path) -> None:
    with pytest.raises(
        RuptfxError, match=facts(r"'main' have meshes of their own; add the table \[faults.main.sliding\]")
    ):
        Model(blocks(tmp_path, {"faults": {"main": {
            "contact": {"kind": "split_node"}, "friction": {"kind": "coulomb", "mu_d": 0.1},
            "initial_stress": {"normal": 0.0},
        }}}))  # fmt: skip
