"""A block pressed on another one, damped to rest, and dragged over it; the surfaces are wavy or flat."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from ruptfx import Table
from ruptfx.app.bench._parts import ratio
from ruptfx.bodies.state import State
from ruptfx.case import Case, parse_case
from ruptfx.interfaces.sliding.interface import SlidingInterface
from ruptfx.platform import fem
from ruptfx.run import stages
from ruptfx.run.model import Model

SPEED, PRESSURE, WAVELENGTH = 10.0, 5e6, 0.6e-3


@dataclass(frozen=True)
class Blocks:
    """Two blocks: the upper one measures 1.2 x 0.5 mm, the elements of the lower one are 1.37 times as large.

    Attributes
    ----------
    size, order : float, int
        Size [m] and order of the elements of the upper block.
    way : float
        Sliding distance at full speed [m].
    amplitude : float
        Amplitude of the waves of both surfaces, in opposite phase; 0: flat [m].
    moduli : (float, float)
        Young's moduli of the upper and lower block [Pa].
    friction : float
    press, ramp : float
        Duration of pressing, and of the acceleration to full speed [s].
    damping : (dict, dict)
        Damping during pressing, and during sliding.
    ends : (float, float)
        x of the ends of the lower block [m].
    contact : dict
    follow : float
        Slip, as a fraction of the node spacing, after which the mortar pairing is updated.
    """

    size: float
    order: int
    way: float
    amplitude: float = 10e-6
    moduli: tuple[float, float] = (5.3e9, 3.392e9)
    friction: float = 0.3
    press: float = 15e-6
    ramp: float = 10e-6
    damping: tuple[Table, Table] = ({"mass": 2e5}, {})
    ends: tuple[float, float] = (-0.3e-3, 3.3e-3)
    contact: Table = field(default_factory=lambda: {"kind": "forward_lagrange"})
    follow: float = 0.05

    def case(self) -> Case:
        shear = self.way / SPEED + 0.5 * self.ramp
        left, right = self.ends
        made = parse_case({
            "plane": "strain", "order": self.order, "duration": self.press + shear,
            "mesh": {
                "kind": "rough_plates", "curve_order": self.order if self.amplitude else 1,
                "upper": {"length": 1.2e-3, "height": 0.5e-3, "element_size": self.size, **self._wave(1)},
                "lower": {
                    "length": right - left, "left": left, "height": 0.5e-3, "element_size": 1.37 * self.size,
                    **self._wave(-1),
                },
            },
            "materials": dict(zip(("upper", "lower"), map(_body, self.moduli), strict=True)),
            "faults": {"main": {
                "sliding": {"update_slip": self.follow}, "contact": self.contact,
                "friction": {"kind": "coulomb", "mu_d": self.friction}, "initial_stress": {"normal": 0.0},
            }},
            "stages": [
                {"duration": self.press, "damping": self.damping[0], "boundaries": _edges(0.0, (0.0, 6e-6))},
                {"duration": shear, "damping": self.damping[1], "boundaries": _edges(SPEED, (self.ramp, 0.0))},
            ],
        })  # fmt: skip
        assert isinstance(made, Case)
        return made

    def _wave(self, side: int) -> Table:
        if not self.amplitude:
            return {}
        return {"profile": {
            "kind": "sinusoid", "mean": side * self.amplitude, "amplitude": -side * self.amplitude,
            "wavelength": WAVELENGTH,
        }}  # fmt: skip


def _body(young_modulus: float) -> Table:
    return {"kind": "isotropic_elastic", "young_modulus": young_modulus, "poisson_ratio": 0.25, "density": 1246.0}


def _edges(speed: float, ramps: tuple[float, float]) -> list[Table]:
    held = [{"kind": "driven", "edge": "lower.bottom", "component": axis, "velocity": 0.0} for axis in "xy"]
    return [
        *held, {"kind": "driven", "edge": "upper.top", "component": "x", "velocity": speed, "ramp": ramps[0]},
        {"kind": "traction", "edge": "upper.top", "traction": [0.0, -PRESSURE], "ramp": ramps[1]},
    ]  # fmt: skip


@dataclass(frozen=True)
class Rubbing:
    """Result of a run.

    Attributes
    ----------
    impact : float
        Work of the normal stress over that of friction since sliding began.
    updates : float
        Energy that pairing updates removed from the contact springs since sliding began, over the edge work.
    missing : float
        Unaccounted energy over the edge work.
    """

    impact: float
    updates: float
    missing: float


def rub(blocks: Blocks, comm: fem.MPI.Comm, look: Callable[[State, SlidingInterface], None] | None = None) -> Rubbing:
    """Press, then slide the whole way; call `look` after every step of sliding."""
    case = blocks.case()
    model = Model(case, comm)
    motion, state, face = stages.bind(model), model.initial_state(), model.faults[0].interface
    assert isinstance(face, SlidingInterface)
    while state.time < blocks.press:
        motion.step(state)
    before = motion.energies(state)
    while state.time < case.duration:
        motion.step(state)
        if look is not None:
            look(state, face)
    after = motion.energies(state)
    gained = {name: after[name] - before[name] for name in after}
    missing, work = after.pop("boundary_work") - sum(after.values()), gained["boundary_work"]
    return Rubbing(
        ratio(gained["impact_loss"], gained["frictional_dissipation"]), ratio(gained["pairing_update_loss"], work),
        ratio(abs(missing), work),
    )  # fmt: skip
