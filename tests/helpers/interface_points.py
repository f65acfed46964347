"""Points of an interface without a mesh, and what contact does there."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter

from ruptfx.app.check_law.examples import table
from ruptfx.input.schema import alternatives
from ruptfx.interfaces.faults.fault import Fault
from ruptfx.interfaces.faults.interface import Interface, Line
from ruptfx.laws.cohesion import AnyCohesion
from ruptfx.laws.contact import Point

POINTS = 101  # not a multiple of the points that the C code does at a time


def an_interface(components: int, random: np.random.Generator) -> Interface:
    """Points with random frames and weights; no mesh."""
    local = components
    frame = np.linalg.qr(random.normal(size=(POINTS, components, components)))[0]
    nodes = random.permutation(2 * POINTS)
    return Interface(
        points=random.normal(size=(POINTS, max(2, components))),
        position=np.linspace(0, 1, POINTS), number=np.arange(POINTS),
        plus=nodes[:POINTS], minus=nodes[POINTS:], frame=frame.reshape(POINTS, local, components),
        weight=random.uniform(0.5e-4, 1e-4, POINTS), owned=random.random(POINTS) < 0.8, total=POINTS,
        line=Line("x", np.zeros(max(2, components)), 0.0, 1.0),
    )  # fmt: skip


def at_point(random: np.random.Generator | None = None, **changes: Any) -> Point:
    """A point at rest, or one with random values, with changes; bodies of 1e6 Pa s/m and 1e11 Pa/m, steps of 0.1 us."""
    some = (lambda size: random.normal() * size) if random else (lambda size: 0.0)
    values = {
        "normal_stress_0": 1e6 + abs(some(1e6)), "shear_traction_0": [some(1e6)], "opening_jump": some(1e-6),
        "slip_jump": [some(1e-6)], "opening_velocity": some(1.0), "slip_velocity": [some(1.0)], "slip": [some(1e-6)],
        "since": 1e-7, "dt": 1e-7, "normal_impedance": 1e6, "shear_impedance": [1e6], "normal_multiplier": 1e6,
        "shear_multiplier": [some(1e6)], "body_stiffness": 1e11,
    }  # fmt: skip
    return Point(**{**values, **changes})


def compliances(contact: Any, impedance: float, dt: float) -> np.ndarray:
    """How far the interface opens, and slips, per stress that is relieved [m/Pa]: the scale of what happens to it."""
    trial = contact.trial(at_point(normal_impedance=impedance, shear_impedance=[impedance], since=dt, dt=dt))
    return np.array([trial.normal_compliance, dt / trial.impedance[0]])


def sizes(face: Interface, of_each: np.ndarray) -> np.ndarray:
    """Of the normal and every tangential component."""
    return np.array([of_each[0]] * face.has_normal + [of_each[1]] * face.tangents)


def with_cohesion(fault: Fault, kind: str, compliance: np.ndarray, random: np.random.Generator) -> Fault:
    """A fault that is held together, some of it, and less pressed; strengths fall by less than contact stiffens.

    Two components of slip make a path sqrt(2) times as long, which takes as much more energy.
    """
    size = 4e6 * compliance  # of the jumps
    area = alternatives("ruptfx.laws.cohesion")[kind].area
    softer = 6 if fault.contact.traction_ends_slip or fault.contact.implicit else 1  # than springs, however steep
    values = table(alternatives("ruptfx.laws.cohesion")[kind]) | {
        "kind": kind, "G_Ic": 4e6 * area * size[0] / softer, "c": 3e6 / softer,
        "G_IIc": 16e6 * area * min(size[1], 3e-5) / softer * np.sqrt(fault.interface.tangents),
    }  # fmt: skip
    strength = np.where(random.random(POINTS) < 0.1, 0.0, random.uniform(1e6, 3e6, POINTS)) / softer
    law = TypeAdapter(AnyCohesion).validate_python(values).substituted({"f_t": strength})
    return replace(fault, cohesion=law, normal_stress_0=fault.normal_stress_0 - 0.5e6)


def jump_under(contact: Any, normal_stress_0: float, pulled: float, sheared: float) -> tuple[float, float]:
    """Opening and slip of the bodies at which springs carry these tractions [Pa] more; zero where there are none."""
    jump, rigid = np.zeros(2), np.array(contact.stiffness()) == 0
    for _ in range(20):  # Newton's method
        trial = contact.trial(at_point(normal_stress_0=normal_stress_0, opening_jump=jump[0], slip_jump=[jump[1]]))
        missing = np.array([pulled - (normal_stress_0 - trial.normal_stress), sheared - trial.shear_traction[0]])
        jump += np.where(rigid, 0.0, missing * [trial.normal_compliance, 1e-7 / trial.impedance[0]])
    return jump[0], jump[1]


def crossed(methods: Iterable[str], laws: Iterable[tuple[str, int]]) -> list[Any]:
    """Return all pairs of a method and a law with its components; those without the first one of either are slow."""
    methods, laws = list(methods), list(laws)
    return [
        pytest.param(method, *law, marks=[pytest.mark.slow] * (method != methods[0] and law != laws[0]))
        for method in methods for law in laws
    ]  # fmt: skip
