"""Small cases that several tests share, as tables: seconds on one core, the physics of the full ones."""

from __future__ import annotations

import copy
import os
from typing import Any

import numpy as np
from pydantic import PrivateAttr

from ruptfx.app.check_law.examples import holds, table
from ruptfx.bodies.meshes import MeshSource
from ruptfx.case import Case, parse_case
from ruptfx.input.schema import alternatives, unit_of

# The default operator, or the one under test everywhere: RUPTFX_TEST_OPERATOR=ufl_form python -m pytest
OPERATOR = os.environ.get("RUPTFX_TEST_OPERATOR", "matrix_free")

HOMALITE = {"kind": "isotropic_elastic", "young_modulus": 5.3e9, "poisson_ratio": 0.35, "density": 1246.0}
SPLIT = {"kind": "split_node"}
COMPLIANT = {"kind": "compliant", "C_n": 300e9, "C_s": 100e9}
STRONG = {"kind": "coulomb", "mu_d": 1e6}

# Two published-loading sets of constants for the power-law rate and state interface.
SETS = {
    "P1": {"mu_s": 0.6, "mu_d": 0.4, "V_0": 100.0, "V_1": 29.0, "p": 1.2, "m": 5.0, "L_0": 10e-6, "L_p": 40e-6},
    "P2": {"mu_s": 0.6, "mu_d": 0.1, "V_0": 100.0, "V_1": 0.5, "p": 1.2, "m": 5.0, "L_0": 2e-6, "L_p": 100e-6},
}


def friction_laws() -> list[tuple[str, str | None]]:
    """Return every law of the folder, wrappers around the simplest law and the one that requires most parameters."""
    laws = alternatives("ruptfx.laws.friction")
    plain = [(sum(field.is_required() for field in cls.model_fields.values()), len(cls.model_fields), kind)
             for kind, cls in laws.items() if not holds(cls)]  # fmt: skip
    held = [min(plain)[2], max(plain)[2]]
    return [(kind, inner) for kind, cls in laws.items() for inner in (held if holds(cls) else [None])]


def merged(table: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """The table with dotted keys changed; a value of None removes the key."""
    result = copy.deepcopy(table)
    for key, value in changes.items():
        *parents, last = key.split(".")
        node = result
        for name in parents:
            node = node.setdefault(name, {})
        if value is None:
            node.pop(last, None)
        else:
            node[last] = value
    return result


# One of every kind, with a filter, a rate of its own, or both.
INSTRUMENTS = [
    {"kind": "receiver", "name": "point", "interval": 1.7e-7, "point": [5.3e-3, 2.2e-3], "bandwidth": 1e6},
    {"kind": "fault_receiver", "name": "fault", "interval": 2.3e-7, "position": 5.3e-3},
    {"kind": "velocimeter", "name": "pair", "interval": 1.7e-7, "point": [5e-3, 5e-4], "relative_to": [5e-3, -5e-4],
     "direction": [1.0, 0.0]},
    {"kind": "load_cell", "name": "cell", "interval": 3.1e-7, "edge": "upper.right", "bandwidth": 2e6},
]  # fmt: skip


def unstressed(points: np.ndarray) -> np.ndarray:
    """Initial stress of bodies that have none."""
    return np.zeros((len(points), 3))


def plates(changes: dict[str, Any] | None = None) -> dict[str, Any]:
    """Two small Homalite plates pressed with 6 MPa, glued by strong Coulomb friction; nothing moves them."""
    table = {
        "plane": "stress", "order": 4, "duration": 5e-6, "operator": OPERATOR,
        "mesh": {"kind": "two_plates", "length": 12e-3, "height": 4e-3, "element_size": 2e-3},
        "materials": {"default": HOMALITE},
        "faults": {"main": {"contact": COMPLIANT, "friction": STRONG, "initial_stress": {"normal": 6e6}}},
        "output": {"figures": False},
    }  # fmt: skip
    return merged(table, changes or {})


def case(changes: dict[str, Any] | None = None) -> Case:
    return parse_case(plates(changes))


def memory_friction(name: str) -> dict[str, Any]:
    """Rate and state with a power-law direct effect and normal-stress memory, constants of set P1 or P2."""
    values = SETS[name]
    law = {key: value for key, value in values.items() if key != "L_p"}
    law |= {"kind": "rate_and_state_power_law", "A_0": 1.0, "theta_0_initial": values["L_0"] / 0.05}
    return {"kind": "prakash_clifton", "L_p": values["L_p"], "D": 1.0, "theta_p_ratio": 0.02, "law": law}


def impact(
    pressure: float, speed: float, constants: str = "P1", changes: dict[str, Any] | None = None
) -> dict[str, Any]:
    """Shear impact on small plates: a quarter of the length of the demo's, coarser elements."""
    table = plates({
        "duration": 18e-6, "mesh.length": 40e-3, "mesh.height": 14e-3,
        "faults.main.friction": memory_friction(constants), "faults.main.initial_stress.normal": pressure,
    })  # fmt: skip
    table["boundaries"] = [
        {"kind": "driven", "edge": "upper.left", "component": "x", "velocity": speed, "ramp": 10e-6},
    ]
    return merged(table, changes or {})


def slip_weakening(changes: dict[str, Any] | None = None) -> dict[str, Any]:
    """Bilateral rupture from an overstressed patch; well-posed, slips on half of the interface."""
    table = plates({
        "duration": 10e-6, "mesh.length": 32e-3, "mesh.height": 8e-3, "faults.main.contact": SPLIT,
        "faults.main.friction": {"kind": "linear_slip_weakening", "mu_s": 0.6, "mu_d": 0.3, "D_c": 5e-6},
        "faults.main.initial_stress.normal": 6e6,
        "faults.main.initial_stress.shear": {
            "kind": "boxcar", "inside": 3.7e6, "outside": 2.8e6, "center": 16e-3, "half_width": 3e-3,
        },
    })  # fmt: skip
    return merged(table, changes or {})


def strike_slip(changes: dict[str, Any] | None = None) -> dict[str, Any]:
    """A small fault that reaches the surface, with a square patch above its strength."""
    table = slip_weakening({"plane": "solid", "order": 2, "duration": 3e-6})
    table["mesh"] = {
        "kind": "box_with_fault", "fault_length": 12e-3, "fault_width": 8e-3, "element_size": 1e-3, "beyond": 2e-3,
        "distance": 3e-3,
    }  # fmt: skip
    table["positions"] = "x"
    table["faults"]["main"]["initial_stress"]["shear"] = {
        "kind": "rectangle", "inside": 3.7e6, "outside": 2.8e6, "strike": [-3e-3, 3e-3], "dip": [1e-3, 5e-3],
    }  # fmt: skip
    return merged(table, changes or {})


def branched(changes: dict[str, Any] | None = None) -> dict[str, Any]:
    """A rupture from x = -4 mm that goes on along the fault and its branch, which begins at x = 0."""
    table = slip_weakening({"plane": "strain", "order": 3, "duration": 8e-6, "positions": "x"})
    table["mesh"] = {
        "kind": "branched_fault", "left": -8e-3, "right": 6e-3, "branch_length": 5e-3, "angle": -35.0,
        "element_size": 1e-3, "beyond": 4e-3, "growth": 1.2,
    }  # fmt: skip
    table["faults"]["main"]["friction"]["D_c"] = 1e-6
    table["faults"]["branch"] = copy.deepcopy(table["faults"]["main"])
    for name, extra in (("main", 0.9e6), ("branch", 0.0)):
        table["faults"][name]["initial_stress"]["shear"] = {
            "kind": "boxcar", "inside": 3e6 + extra, "outside": 3e6, "center": -4e-3, "half_width": 2e-3,
        }  # fmt: skip
    table["stepper"] = {"kind": "leapfrog", "time_step": 1.6e-8}
    return merged(table, changes or {})


def smooth_field(model: Any, seed: int = 0) -> np.ndarray:
    """A displacement that depends on the place only, the same on any number of ranks, shape (nodes * components,)."""
    random = np.random.default_rng(seed)
    waves = random.normal(size=(model.coordinates.shape[1], 7)) * 300
    field = np.sin(model.coordinates @ waves) @ random.normal(size=(7, model.components))
    # A jump at interfaces: other values in other bodies.
    body = np.zeros(model.nodes)
    body[model.space.dofmap.list] = model.bodies.cell_body[: len(model.space.dofmap.list), None]
    return (field * (1 + body[:, None])).ravel()


def march(case: Case, duration: float | None = None, watch: Any = None, comm: Any = None) -> tuple[Any, Any, Any]:
    """Model, motion and state after the duration of the case; `watch(state)` is called after every step."""
    from ruptfx.run.model import Model

    model = Model(case, comm)
    motion, state = case.stepper.bind(model), model.initial_state()
    return model, motion, advance(motion, state, duration or case.duration, watch)


def advance(motion: Any, state: Any, duration: float, watch: Any = None) -> Any:
    """Step on for `duration`."""
    for _ in range(int(np.ceil(duration / motion.dt * (1 - 1e-9)))):
        motion.step(state)
        if watch is not None:
            watch(state)
    return state


# Two blocks that meet along an inclined line; their elements are not parallelograms.
TILTED = """
angle = {angle}; n = {n};
Point(1) = {{0, -3e-3, 0}}; Point(2) = {{10e-3, -5e-3, 0}}; Point(3) = {{10e-3, 0, 0}}; Point(4) = {{0, 0, 0}};
Point(5) = {{10e-3, 4e-3, 0}}; Point(6) = {{0, 6e-3, 0}};
Line(1) = {{1, 2}}; Line(2) = {{2, 3}}; Line(3) = {{3, 4}}; Line(4) = {{4, 1}}; Line(5) = {{3, 5}}; Line(6) = {{5, 6}};
Line(7) = {{6, 4}};
Curve Loop(1) = {{1, 2, 3, 4}}; Curve Loop(2) = {{-3, 5, 6, 7}};
Plane Surface(1) = {{1}}; Plane Surface(2) = {{2}};
Rotate {{{{0, 0, 1}}, {{2e-3, 1e-3, 0}}, angle}} {{ Surface{{1, 2}}; }}
Transfinite Curve{{1, 3, 6}} = 2 * n + 1; Transfinite Curve{{2, 4, 5, 7}} = n + 1;
Transfinite Surface{{1, 2}}; Recombine Surface{{1, 2}};
Physical Surface("lower") = {{1}}; Physical Surface("upper") = {{2}};
Physical Curve("main") = {{3}}; Physical Curve("upper.left") = {{7}}; Physical Curve("upper.right") = {{5}};
Physical Curve("upper.top") = {{6}}; Physical Curve("lower.bottom") = {{1}};
Physical Curve("lower.left") = {{4}}; Physical Curve("lower.right") = {{2}};
"""


def tilted(folder: Any, angle: float = 0.6, n: int = 2) -> dict[str, Any]:
    """Mesh table of two blocks along a line inclined by `angle`; the normal is (-sin, cos)."""
    path = folder / "tilted.geo"
    path.write_text(TILTED.format(angle=angle, n=n))
    return {"kind": "gmsh_file", "file": str(path), "interfaces": {"main": {"plus": "upper", "minus": "lower"}}}


# Four blocks of 6 x 4 mm around (0, 0), two on two; they share their nodes.
BLOCKS = """
d = 1e-3;
For j In {{0:2}}
  For i In {{0:2}}
    Point(1 + i + 3 * j) = {{6 * d * (i - 1), 4 * d * (j - 1), 0}};
  EndFor
EndFor
For j In {{0:2}}
  Line(10 + j) = {{1 + 3 * j, 2 + 3 * j}}; Line(20 + j) = {{2 + 3 * j, 3 + 3 * j}};
EndFor
For i In {{0:2}}
  Line(30 + i) = {{1 + i, 4 + i}}; Line(40 + i) = {{4 + i, 7 + i}};
EndFor
Curve Loop(1) = {{10, 31, -11, -30}}; Curve Loop(2) = {{20, 32, -21, -31}};
Curve Loop(3) = {{11, 41, -12, -40}}; Curve Loop(4) = {{21, 42, -22, -41}};
For k In {{1:4}}
  Plane Surface(k) = {{k}};
EndFor
Transfinite Curve{{10:12, 20:22}} = {n} + 1; Transfinite Curve{{30:32, 40:42}} = {n} + 1;
Transfinite Surface{{1:4}}; Recombine Surface{{1:4}};
Physical Curve("top") = {{12, 22}}; Physical Curve("bottom") = {{10, 20}};
{groups}
"""


EXTRUDED = """
For k In {1:4}
  e[] = Extrude {0, 0, 3 * d} { Surface{k}; Layers{2}; Recombine; };
  block~{k} = e[1]; top~{k} = e[4];
EndFor
Coherence;
"""


def blocks(folder: Any, bodies: dict[str, str], lines: dict[str, str], sides: dict[str, Any], dim: int = 2) -> dict:
    """Mesh table of four blocks: 1 and 2 below, 3 and 4 above; lines 11 and 21 between them, 31 and 41 across. In 3D
    they are called block_1 ..., and the surfaces between them top_1 and top_2."""
    body, line = ("Surface", "Curve") if dim == 2 else ("Volume", "Surface")
    groups = [f'Physical {body}("{name}") = {{{which}}};' for name, which in bodies.items()]
    groups += [f'Physical {line}("{name}") = {{{which}}};' for name, which in lines.items()]
    path = folder / f"blocks_{dim}_{'_'.join([*bodies, *lines])}.geo"
    path.write_text(BLOCKS.format(groups="\n".join([EXTRUDED] * (dim == 3) + groups), n=3))
    return {"kind": "gmsh_file", "file": str(path), "interfaces": sides}


# Two blocks of 4 x 1 mm with their own nodes; on the right half both sides of their common line are edges.
CREEPING = """
d = 1e-3;
Point(1) = {0, -d, 0}; Point(2) = {4 * d, -d, 0}; Point(3) = {4 * d, 0, 0}; Point(4) = {2 * d, 0, 0};
Point(5) = {0, 0, 0}; Point(6) = {0, 0, 0}; Point(7) = {2 * d, 0, 0}; Point(8) = {4 * d, 0, 0};
Point(9) = {4 * d, d, 0}; Point(10) = {0, d, 0};
For k In {1:4}
  Line(k) = {k, k + 1};
EndFor
Line(5) = {5, 1}; Line(10) = {10, 6};
For k In {6:9}
  Line(k) = {k, k + 1};
EndFor
Curve Loop(1) = {1:5}; Curve Loop(2) = {6:10};
Plane Surface(1) = {1}; Plane Surface(2) = {2};
Transfinite Curve{3, 4, 6, 7} = 5; Transfinite Curve{1, 9} = 9; Transfinite Curve{2, 5, 8, 10} = 3;
Transfinite Surface{1} = {1, 2, 3, 5}; Transfinite Surface{2} = {6, 8, 9, 10}; Recombine Surface{1, 2};
Physical Surface("lower") = {1}; Physical Surface("upper") = {2};
Physical Curve("main") = {4, 6}; Physical Curve("lower.creep") = {3}; Physical Curve("upper.creep") = {7};
Physical Curve("lower.left") = {5}; Physical Curve("upper.left") = {10};
"""


class Given(MeshSource):
    """A mesh source that hands out a mesh made by a test."""

    _raw: Any = PrivateAttr()

    def __init__(self, raw: Any) -> None:
        super().__init__()
        self._raw = raw

    def build(self) -> Any:
        return self._raw


def wavy_plates(amplitude: float = 4e-4) -> Given:
    """Two plates that meet along a sine; the vertices of both sides coincide."""
    from ruptfx.bodies.meshes.two_plates import TwoPlates

    raw = TwoPlates(length=12e-3, height=4e-3, element_size=1e-3).build()
    x, y = raw.points.T
    y += amplitude * np.sin(2 * np.pi * x / 6e-3) * (1 - np.abs(y) / 4e-3)
    return Given(raw)


def two_boxes(n: int = 2) -> Given:
    """Two boxes of hexahedra, one on the other, 4 x 3 x 2 mm each."""
    from ruptfx.bodies.meshes import RawMesh

    def grid(z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        axes = np.linspace(0, 4e-3, 2 * n + 1), np.linspace(0, 3e-3, n + 1), z
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        number = np.arange(len(points)).reshape([len(axis) for axis in axes])
        first, last = slice(None, -1), slice(1, None)
        corners = [number[i, j, k].ravel() for k in (first, last) for j in (first, last) for i in (first, last)]
        face = number[:, :, 0 if z[0] == 0 else -1]
        facets = [face[i, j].ravel() for j in (first, last) for i in (first, last)]
        return points, np.stack(corners, axis=1), np.stack(facets, axis=1)

    def right(cells: np.ndarray, points: np.ndarray) -> np.ndarray:
        return cells[:, 1::2][np.all(points[cells[:, 1::2], 0] > 4e-3 * (1 - 1e-9), axis=1)]

    upper, lower = grid(np.linspace(0, 2e-3, n + 1)), grid(np.linspace(-2e-3, 0, n + 1))
    shift = len(upper[0])
    return Given(RawMesh(
        cell="hexahedron", points=np.concatenate([upper[0], lower[0]]),
        cells=np.concatenate([upper[1], lower[1] + shift]),
        bodies=["upper", "lower"], cell_body=np.repeat([0, 1], len(upper[1])),
        edges={"upper.right": right(upper[1], upper[0]), "lower.right": right(lower[1], lower[0]) + shift},
        interfaces={"main": (upper[2], lower[2] + shift)},
    ))  # fmt: skip


ANY_STEPPER = {"kind": "rate_and_state_ageing", "a": 0.01, "b": 0.015, "D_c": 1e-5, "f_0": 0.6, "V_0": 1e-6,
               "theta_initial": 1e3}  # fmt: skip


def guided(component: str) -> list[dict[str, Any]]:
    """Lateral edges that let a plane wave along y pass as in an unbounded body: `component` does not move there."""
    return [
        {"kind": "driven", "edge": f"{body}.{side}", "component": component, "velocity": 0.0}
        for body in ("upper", "lower") for side in ("left", "right")
    ]  # fmt: skip


def required(stepper: str) -> dict[str, Any]:
    """Keys of a stepper that a case must give, with values of an example."""
    cls = alternatives("ruptfx.stepping.steppers")[stepper]
    needed = {name for name, field in cls.model_fields.items() if field.is_required()}
    return {name: value for name, value in (table(cls) if needed else {}).items() if name in needed}


def springs(contact: str, stiffness: float) -> dict[str, Any]:
    """A contact method whose springs, if it has any, all have this stiffness."""
    cls = alternatives("ruptfx.laws.contact")[contact]
    return {"kind": contact, **{name: stiffness for name in cls.model_fields if unit_of(cls, name) == "Pa/m"}}
