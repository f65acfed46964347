"""Cost of sliding contact: rigid contact over the whole step, and an update of the mortar pairing.

Two plates of 20 mm in plane strain, elements of order 4, 400 on 390, 0.39 million nodes, 1600 points, Coulomb friction;
all of them closed while waves cross the interface, and then opposed waves pressed so that about an eighth touches.
Processor time of contact over that of complete steps in the same run, and of an update over a step: with 3 us per point
an update takes about two steps. Of the samples the fastest one counts: machines are shared.

Solids: a ball of order 2 with 5041 points is pressed on a plate and dragged, 223 200 nodes, until a tenth of its points
touch. All steps with those that update the pairing are a second row.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ruptfx.app.bench import Check, Outcome
from ruptfx.case import Case, parse_case
from ruptfx.interfaces.mechanisms.sliding import SlidingFaults
from ruptfx.interfaces.sliding.interface import SlidingInterface
from ruptfx.platform import fem
from ruptfx.run.model import Model

LENGTH, ELEMENTS, HEIGHT = 0.02, 400, 0.02 * 31 / 400
WAVELENGTH, AMPLITUDE = LENGTH / 8, 1e-6
SIDE, ACROSS, LAYERS = 3.5e-3, (35, 32), (12, 11)  # of the ball and the plate [m], and their elements
SAMPLES, STEPS = 9, 20
SOURCE = "aim, one core"


def case(touching: bool) -> Case:
    """Return the case with all points closed, or with opposed waves that touch in part."""
    sides: dict[str, Any] = {}
    for name, side, elements in (("upper", 1, ELEMENTS), ("lower", -1, ELEMENTS - 10)):
        sides[name] = {"length": LENGTH, "height": HEIGHT, "element_size": LENGTH / elements}
        if touching:
            sides[name]["profile"] = {
                "kind": "sinusoid", "mean": side * AMPLITUDE, "amplitude": -side * AMPLITUDE, "wavelength": WAVELENGTH,
            }  # fmt: skip
    edges: list[dict[str, object]] = [
        {"kind": "driven", "edge": "upper.left", "component": "x", "velocity": 3.0, "ramp": 1e-7},
    ]
    if touching:
        edges = [{"kind": "driven", "edge": "lower.bottom", "component": axis, "velocity": 0.0} for axis in "xy"]
        edges.append({"kind": "traction", "edge": "upper.top", "traction": [0.0, -6e5], "ramp": 0.5e-6})
    made = parse_case({
        "plane": "strain", "order": 4, "duration": 2e-6,
        "mesh": {"kind": "rough_plates", "curve_order": 2 if touching else 1, **sides},
        "materials": {"default": {
            "kind": "isotropic_elastic", "young_modulus": 5.3e9, "poisson_ratio": 0.25, "density": 1246.0,
        }},
        "damping": {"mass": 1e6 if touching else 0.0},
        "faults": {"main": {
            "sliding": {}, "contact": {"kind": "forward_lagrange"}, "friction": {"kind": "coulomb", "mu_d": 0.3},
            "initial_stress": {"normal": 0.0} if touching else {"normal": 5e6, "shear": 1e6},
        }},
        "boundaries": edges,
    })  # fmt: skip
    assert isinstance(made, Case)
    return made


def ball() -> Case:
    """Return the case of a ball that is pressed on a plate and dragged."""
    bodies: dict[str, dict[str, object]] = {
        name: {"length": SIDE, "width": SIDE, "left": -SIDE / 2, "front": -SIDE / 2, "element_size": SIDE / elements,
               "height": layers * SIDE / elements}
        for name, elements, layers in zip(("upper", "lower"), ACROSS, LAYERS, strict=True)
    }  # fmt: skip
    bodies["upper"]["profile"] = {"kind": "parabola", "radius": 15e-3, "center": {"x": 0.0, "y": 0.0}}
    edges = [("lower.bottom", "x", 0.0), ("lower.bottom", "y", 0.0), ("lower.bottom", "z", 0.0),
             ("upper.top", "x", 8.0), ("upper.top", "y", 0.0), ("upper.top", "z", -6.0)]  # fmt: skip
    made = parse_case({
        "plane": "solid", "order": 2, "duration": 30e-6, "positions": "x",
        "mesh": {"kind": "rough_plates", "curve_order": 2, **bodies},
        "materials": {"default": {
            "kind": "isotropic_elastic", "young_modulus": 5e9, "poisson_ratio": 0.25, "density": 1200.0,
        }},
        "damping": {"mass": 5e5, "kelvin_voigt": {"fraction": 0.1}},
        "faults": {"main": {
            "sliding": {}, "contact": {"kind": "forward_lagrange"}, "friction": {"kind": "coulomb", "mu_d": 0.3},
            "initial_stress": {"normal": 0.0},
        }},
        "boundaries": [
            {"kind": "driven", "edge": edge, "component": axis, "velocity": velocity, "ramp": 0.5e-6}
            for edge, axis, velocity in edges
        ],
    })  # fmt: skip
    assert isinstance(made, Case)
    return made


@dataclass(frozen=True)
class Cost:
    """Cost of contact in processor time.

    Attributes
    ----------
    share, all_steps : float
        Contact over a step in the fastest sample, and over all steps with updates of the pairing.
    update, per_point : float
        An update over a step, and per point [s].
    closed : float
        Part of the points that are closed at the end.
    """

    share: float
    all_steps: float
    update: float
    per_point: float
    closed: float


class _Timed:
    """A wrapped call that measures its processor time in every step."""

    def __init__(self, inner: Any) -> None:
        self._inner, self.seconds = inner, 0.0

    def _measured(self, call: Callable[..., Any], *arguments: Any) -> Any:
        began = time.process_time()
        try:
            return call(*arguments)
        finally:
            self.seconds += time.process_time() - began

    def __call__(self, *arguments: Any) -> Any:
        return self._measured(self._inner, *arguments)

    def opening_rate(self, *arguments: Any) -> Any:
        return self._measured(self._inner.opening_rate, *arguments)

    def impact_loss(self, *arguments: Any) -> Any:
        return self._measured(self._inner.impact_loss, *arguments)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)


def measure(given: Case, until: float, comm: fem.MPI.Comm) -> Cost:
    """Return the cost of contact after a time of a case [s]."""
    model = Model(given, comm)
    motion: Any = given.stepper.bind(model)
    state = model.initial_state()
    while state.time < until:
        motion.step(state)
    (sliding,) = (each for each in motion.mechanisms if isinstance(each, SlidingFaults))
    follower, contact = _Timed(sliding.followers[0]), _Timed(sliding.steps[2][0])
    followers: list[Any] = sliding.followers
    steps: list[Any] = sliding.steps[2]
    followers[0], steps[0] = follower, contact
    samples, all_steps = [], np.zeros(2)
    for _ in range(SAMPLES):
        follower.seconds = contact.seconds = 0.0
        began = time.process_time()
        for _ in range(STEPS):
            motion.step(state)
        spent = time.process_time() - began
        samples.append((spent / STEPS, (follower.seconds + contact.seconds) / spent))
        all_steps += follower.seconds + contact.seconds, spent
    face = model.faults[0].interface
    assert isinstance(face, SlidingInterface)
    geometry, n = face.geometry, len(face.plus)
    there = state.displacement[face.dofs].reshape(-1, geometry.dim)
    slip = face.jump(state.displacement)[:, 1:].copy()
    updates = []
    for _ in range(SAMPLES):
        began = time.process_time()
        geometry.follow(there, slip)
        contact._refresh()
        updates.append(time.process_time() - began)
    closed = float(np.mean(state.faults["main"]["normal_stress"] > 0))
    step, share = min(samples)  # the least disturbed one
    return Cost(share, float(all_steps[0] / all_steps[1]), min(updates) / step, min(updates) / n, closed)


def run(fine: bool, comm: fem.MPI.Comm) -> Outcome:
    lines, waves = measure(case(False), 0.3e-6, comm), measure(case(True), 1.5e-6, comm)
    solids = measure(ball(), 2.4e-6, comm)
    return Outcome([
        Check("points closed", 1.0, lines.closed, 0.0, "1", "set-up", "at least"),
        Check("contact / step", 0.15, lines.share, 0.0, "1", SOURCE, "at most"),
        Check("update / step", 2.0, lines.update, 0.0, "1", SOURCE, "at most"),
        Check("update per point", 3e-6, lines.per_point, 0.0, "s", SOURCE, "at most"),
        Check("waves that touch: points closed", 0.125, waves.closed, 0.06, "1", "set-up"),
        Check("waves that touch: contact / step", 0.05, waves.share, 0.0, "1", SOURCE, "at most"),
        Check("solids: points closed", 0.1, solids.closed, 0.02, "1", "set-up"),
        Check("solids: contact / step", 0.15, solids.share, 0.0, "1", SOURCE, "at most"),
        Check("solids: contact / step, updates counted", 0.15, solids.all_steps, 0.0, "1", SOURCE, "at most"),
    ])  # fmt: skip
