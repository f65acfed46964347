"""Blocks that collide, slide and lean on each other: momentum, energy and friction of potential contact.

Head-on and oblique: two elastic blocks of triangles that do not match fly at each other and away again. Momentum and
angular momentum are those of the beginning to rounding. What the finite step takes or adds while faces meet depends on
where in a step they do: the worst of six gaps counts. With it, and with what finite steps take where bodies turn, the
budget closes.

Sliding: without friction a block slides over the foreign cells of a plate under its weight; what holds it up must not
hold it back. Incline: a block lies on a plate that is turned by theta, under gravity; it must stay where tan(theta) is
below mu, and otherwise slide with the acceleration a = (sin(theta) - mu cos(theta)) g. There g is 1e5 m/s^2, so that
fractions of a millisecond are enough (fine: 2e4 and 1 ms); it grows linearly over a time r, so that the block does not
bounce, and it slides by a (t^2 / 2 - r t / 2 + r^2 / 6). The one that stays is damped (100 per ms): undamped, its
vibration unloads some of its cells now and then, and it creeps by 2.5 um in 0.2 ms, 1 % of the way of the other.

Hand-over: a joint without cohesion through a block that rigid ends press with 50 MPa slides ten cells. Its facets know
each other to the 0.3 of their length and are then handed over; over every half cell friction must be mu times the load.
Vibration is damped within some microseconds (1e6 / s): left to themselves both halves excite each other as they slide,
cells lose each other now and then, and friction is less in the mean.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ruptfx.app.bench import Check, Outcome
from ruptfx.case import Case, parse_case
from ruptfx.input.fields import OF_COLLISIONS
from ruptfx.platform import fem
from ruptfx.run import stages
from ruptfx.run.model import Model

DENSITY = 2600.0
RAMP = 5e-5  # s
GAPS = (2e-5, 2.3e-5, 2.6e-5, 3.1e-5, 3.7e-5, 5e-5)  # m
CELLS = 10  # slip, in cells, up to which friction is checked
NEVER = {"kind": "linear", "f_t": 1e12, "c": 1e12, "G_Ic": 1e9, "G_IIc": 1e9}


def pair(bodies: dict[str, Any], mu: float, duration: float, changes: dict[str, Any]) -> Case:
    """Return a case of two unbreakable bodies of triangles of 1 mm."""
    found = parse_case({
        "plane": "strain", "order": 1, "duration": duration, "large_rotations": True,
        "mesh": {"kind": "pieces", "element_size": 1e-3, "bodies": bodies},
        "materials": {"default": {"kind": "isotropic_elastic", "young_modulus": 50e9, "poisson_ratio": 0.25,
                                  "density": DENSITY}},
        "fracture": {"kind": "intrinsic", "default": {"cohesion": NEVER, "friction": {"kind": "coulomb", "mu_d": mu}}},
        "collisions": {"kind": "potential"}, **changes,
    })  # fmt: skip
    assert isinstance(found, Case)
    return found


class Flight:
    """A case that is stepped in memory, with its conserved quantities."""

    def __init__(self, case: Case) -> None:
        self.model = Model(case, fem.MPI.COMM_SELF)
        self.motion, self.state = stages.bind(self.model), self.model.initial_state()
        self.mass, self.x = self.model.mass.reshape(-1, 2), self.model.coordinates[:, :2]
        self._steps = int(np.ceil(case.duration / self.motion.dt))

    def momentum(self) -> np.ndarray:
        """Return momentum along x and y, and angular momentum over a length of 1 mm."""
        v, now = self.state.velocity.reshape(-1, 2), self.x + self.state.at_faults()[1].reshape(-1, 2)
        spin = np.sum(self.mass[:, 0] * (now[:, 0] * v[:, 1] - now[:, 1] * v[:, 0]))
        return np.array([*(self.mass * v).sum(axis=0), spin / 1e-3])

    def fly(self) -> tuple[float, float, float, float]:
        """Return the relative change of the momenta, and the energies lost, taken by rotation and missing, relative."""
        first = self.momentum()
        one, changed = np.abs(self.mass * self.state.velocity.reshape(-1, 2)).sum() / 2, 0.0
        for step in range(self._steps):
            self.motion.step(self.state)
            if one > 0 and (step % 100 == 0 or step == self._steps - 1):
                changed = max(changed, np.abs(self.momentum() - first).max() / one)
        energy = self.motion.energies(self.state)
        given = energy.pop("boundary_work")
        lost, turned = (abs(energy[name]) / given for name in ("collision_loss", "rotation_error"))
        return float(changed), lost, turned, abs(given - sum(energy.values())) / given

    def forces(self, body: str) -> np.ndarray:
        """Return the collision force on a body in every step until the end, shape (steps, 2) [N/m]."""
        nodes = np.unique(self.model.space.dofmap.list[self._cells(body)])
        found = []
        for _ in range(self._steps):
            self.motion.step(self.state)
            found.append(self.state.fields[OF_COLLISIONS].reshape(-1, 2)[nodes].sum(axis=0))
        return np.array(found)

    def over_plane(self) -> np.ndarray:
        """Return shear offset of the ends [m], and forces along and across y = 0 [N/m]; shape (3, samples).

        The forces are those of the facets and of collisions together.
        """
        x, cells, cracks = self.x, self.model.space.dofmap.list, self.model.cracks
        assert cracks is not None
        above = cells[x[cells].mean(axis=1)[:, 1] > 0].ravel()
        ends = [np.argmax(sign * x[:, 1]) for sign in (1, -1)]
        found = []
        for step in range(self._steps):
            self.motion.step(self.state)
            if step % 10 == 0:
                moved = self.state.at_faults()[1]
                force = self.state.fields[OF_COLLISIONS].copy()
                cracks.add_force(self.state.cracks, force, moved)
                top, bottom = moved.reshape(-1, 2)[ends]
                found.append([top[0] - bottom[0], *([-1, 1] * force.reshape(-1, 2)[above].sum(axis=0))])
        return np.array(found).T

    def middle(self, body: str) -> np.ndarray:
        """Return the displacement of the centre of mass of a body since the start [m]."""
        nodes = self.model.space.dofmap.list[self._cells(body)].ravel()
        return np.average(self.state.displacement.reshape(-1, 2)[nodes], axis=0, weights=self.mass[nodes, 0])

    def _cells(self, body: str) -> np.ndarray:
        return np.asarray(self.model.bodies.cell_body == self.model.bodies.names.index(body))


def collide(angle: float, gap: float, friction: float = 0.0) -> tuple[float, float, float, float]:
    """Run two blocks and return the result of `Flight.fly`.

    `angle` [degree] is that of one of the blocks, `gap` [m] the distance before the collision.
    """
    bodies = {
        "a": {"kind": "rectangle", "center": [0.0, 0.0], "width": 4e-3, "height": 3e-3},
        "b": {"kind": "rectangle", "center": [4e-3 + gap, 0.4e-3], "width": 4e-3, "height": 3e-3, "angle": angle},
    }  # fmt: skip
    duration = gap / 10.0 + (1e-5 if angle == 0 else 2e-5)
    flight = Flight(pair(bodies, friction, duration, {"initial_velocity": {"a": [5.0, 0.0], "b": [-5.0, 0.5]}}))
    return flight.fly()


def snag(duration: float) -> tuple[float, float]:
    """Return the largest force along and mean force across a plate on a frictionless sliding block, in weights."""
    g = 1e5
    flight = Flight(pair(
        {"plate": {"kind": "rectangle", "center": [0.0, 0.0], "width": 16e-3, "height": 2e-3},
         "block": {"kind": "rectangle", "center": [-4e-3, 2e-3], "width": 4e-3, "height": 2e-3}},
        0.0, duration,
        {"initial_velocity": {"block": [20.0, 0.0]}, "boundaries": [
            {"kind": "gravity", "acceleration": [0.0, -g], "ramp": RAMP},
            *({"kind": "driven", "edge": "plate.bottom", "component": axis, "velocity": 0.0} for axis in "xy"),
        ]},
    ))  # fmt: skip
    forces = flight.forces("block")
    late = forces[np.arange(len(forces)) * flight.motion.dt > RAMP] / (8e-6 * DENSITY * g)
    return float(np.abs(late[:, 0]).max()), float(late[:, 1].mean())


def slide(theta: float, mu: float, duration: float, gravity: float, damping: float = 0.0) -> tuple[float, float]:
    """Return the way down the incline and that of a rigid block [m]; gravity is rotated instead of the plate."""
    g, c, s = gravity, np.cos(np.deg2rad(theta)), np.sin(np.deg2rad(theta))
    flight = Flight(pair(
        {"plate": {"kind": "rectangle", "center": [0.0, 0.0], "width": 12e-3, "height": 2e-3},
         "block": {"kind": "rectangle", "center": [-2e-3, 2e-3], "width": 4e-3, "height": 2e-3}},
        mu, duration,
        {"damping": {"mass": damping}, "boundaries": [
            {"kind": "gravity", "acceleration": [g * s, -g * c], "ramp": RAMP},
            *({"kind": "driven", "edge": "plate.bottom", "component": axis, "velocity": 0.0} for axis in "xy"),
        ]},
    ))  # fmt: skip
    flight.fly()
    time = flight.state.time
    way = (s - mu * c) * g * (time**2 / 2 - RAMP * time / 2 + RAMP**2 / 6)
    return float(flight.middle("block")[0]), float(way)


def residual(cells: int, high: int, velocity: float) -> float:
    """Return friction over mu times the load of a joint of `cells` cells in a block `high` cells high.

    The value is the mean over half a cell of slip (from a tenth of a cell on) that is farthest from 1.
    """
    size, mu, pressure = 1e-3, 0.6, 50e6
    width, height = cells * size, high * size
    pressing, rest, ramp = 2e-5, 2e-5, 4e-5  # s
    closing = 0.5 * height * pressure / (50e9 / (1 - 0.25**2)) / pressing
    sliding = 0.5 * ramp + (CELLS + 0.15) * size / velocity

    def ends(across: float, along: float) -> list[dict[str, Any]]:
        moved = {"x": (0.5 * along, ramp), "y": (-across, 5e-6)}
        return [
            {"kind": "driven", "edge": f"specimen.{edge}", "component": axis, "velocity": sign * speed, "ramp": ramp}
            for edge, sign in (("top", 1), ("bottom", -1))
            for axis, (speed, ramp) in moved.items()
        ]

    case = parse_case({
        "plane": "strain", "order": 1, "duration": pressing + rest + sliding, "large_rotations": True,
        "mesh": {
            "kind": "specimen", "shape": {"kind": "rectangle", "width": width, "height": height}, "element_size": size,
            "joints": {"plane": [-0.5 * width, 0.0, 0.5 * width, 0.0]},
        },
        "materials": {"default": {
            "kind": "isotropic_elastic", "young_modulus": 50e9, "poisson_ratio": 0.25, "density": DENSITY,
        }},
        "fracture": {
            "kind": "intrinsic", "default": {"cohesion": NEVER, "friction": {"kind": "coulomb", "mu_d": mu}},
            "joints": {"plane": {"friction": {"kind": "coulomb", "mu_d": mu}}},
        },
        "collisions": {"kind": "potential"}, "damping": {"mass": 1e6}, "stages": [
            {"duration": pressing, "boundaries": ends(closing, 0.0)},
            {"duration": rest, "boundaries": ends(0.0, 0.0)},
            {"duration": sliding, "boundaries": ends(0.0, velocity)},
        ],
    })  # fmt: skip
    assert isinstance(case, Case)
    slip, along, across = Flight(case).over_plane()
    slides = slip > 0.1 * size
    part = ((slip[slides] / size - 0.1) / 0.5).astype(int)
    ratio = np.bincount(part, along[slides]) / np.bincount(part, across[slides]) / mu
    assert len(ratio) >= 2 * CELLS
    return float(ratio[np.abs(ratio - 1).argmax()])


def run(fine: bool, comm: fem.MPI.Comm) -> Outcome:
    del comm
    checks = []
    for name, angle, gaps in (("head-on", 0.0, GAPS), ("oblique", 25.0, (5e-4,))):
        momentum, lost, turned, missing = np.max([collide(angle, gap) for gap in gaps], axis=0).tolist()
        checks += [
            Check(f"{name}: change of momentum and angular momentum", 0.0, momentum, 1e-12, "1", "exact"),
            Check(f"{name}: energy lost in the collision", 0.0, lost, 1e-3, "1", "elastic"),
            Check(f"{name}: energy taken by finite steps where bodies turn", 0.0, turned, 1e-5, "1", "second order"),
            Check(f"{name}: energy closure", 0.0, missing, 1e-10, "1", "exact"),
        ]
    along, across = snag(4e-4 if fine else 2e-4)
    checks.append(Check("sliding without friction: force along over weight", 0.0, along, 0.01, "1", "no snagging"))
    checks.append(Check("sliding without friction: mean force across over weight", 1.0, across, 0.01, "1", "balance"))
    duration, gravity = (1e-3, 2e4) if fine else (2e-4, 1e5)
    way, rigid = slide(20.0, 0.2, duration, gravity)
    checks.append(Check("incline, tan = 0.364, mu = 0.2: way", rigid, way, 0.01, "m", "rigid block", relative=True))
    way, _ = slide(20.0, 0.5, duration, gravity, damping=1e5)
    checks.append(Check("incline, mu = 0.5, damped: way over that with 0.2", 0.0, way / rigid, 0.01, "1", "it stays"))
    friction = residual(30, 8, 20.0) if fine else residual(20, 4, 40.0)
    checks.append(Check(f"hand-over: friction over mu times the load, to {CELLS} cells", 1.0, friction, 0.03, "1",
                        "residual strength of the plane"))  # fmt: skip
    return Outcome(checks)
