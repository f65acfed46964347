"""Cost of sliding contact: rigid contact over the whole step, and an update of the mortar pairing.

Two plates of 20 mm in plane strain, elements of order 4, 400 on 390, 0.39 million nodes, 1600 points, Coulomb friction;
all of them closed while waves cross the interface, and then opposed waves pressed so that about an eighth touches.
Processor time of contact over that of complete steps in the same run, and of an update over a step: with 3 us per point
an update takes about two steps. Of the samples the fastest one counts: machines are shared.
"""

from __future__ import annotations

import time
from collections.abc import Callable
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


def measure(touching: bool, comm: fem.MPI.Comm) -> tuple[float, float, float, float]:
    """Return contact over step, update over step, update per point [s], and the part of the points that are closed."""
    given = case(touching)
    model = Model(given, comm)
    motion: Any = given.stepper.bind(model)
    state = model.initial_state()
    while state.time < (1.5e-6 if touching else 0.3e-6):
        motion.step(state)
    (sliding,) = (each for each in motion.mechanisms if isinstance(each, SlidingFaults))
    follower, contact = _Timed(sliding.followers[0]), _Timed(sliding.steps[2][0])
    followers: list[Any] = sliding.followers
    steps: list[Any] = sliding.steps[2]
    followers[0], steps[0] = follower, contact
    samples = []
    for _ in range(SAMPLES):
        follower.seconds = contact.seconds = 0.0
        began = time.process_time()
        for _ in range(STEPS):
            motion.step(state)
        spent = time.process_time() - began
        samples.append((spent / STEPS, (follower.seconds + contact.seconds) / spent))
    face = model.faults[0].interface
    assert isinstance(face, SlidingInterface)
    geometry, n = face.geometry, len(face.plus)
    there, slip = state.displacement[face.dofs].reshape(-1, 2), face.jump(state.displacement)[:, 1].copy()
    updates = []
    for _ in range(SAMPLES):
        began = time.process_time()
        geometry.follow(there, slip)
        contact._refresh()
        updates.append(time.process_time() - began)
    closed = float(np.mean(state.faults["main"]["normal_stress"] > 0))
    step, share = min(samples)  # the least disturbed one
    return share, min(updates) / step, min(updates) / n, closed


def run(fine: bool, comm: fem.MPI.Comm) -> Outcome:
    share, ratio, each, closed = measure(False, comm)
    part, _, _, touching = measure(True, comm)
    return Outcome([
        Check("points closed", 1.0, closed, 0.0, "1", "set-up", "at least"),
        Check("contact / step", 0.15, share, 0.0, "1", SOURCE, "at most"),
        Check("update / step", 2.0, ratio, 0.0, "1", SOURCE, "at most"),
        Check("update per point", 3e-6, each, 0.0, "s", SOURCE, "at most"),
        Check("waves that touch: points closed", 0.125, touching, 0.06, "1", "set-up"),
        Check("waves that touch: contact / step", 0.05, part, 0.0, "1", SOURCE, "at most"),
    ])  # fmt: skip
