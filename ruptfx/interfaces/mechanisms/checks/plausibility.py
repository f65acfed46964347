"""Warnings about valid input that is probably a mistake: orders of magnitude, reflections, rare records."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ruptfx.bodies.boundaries.absorbing import Absorbing
from ruptfx.bodies.boundaries.incident_wave import IncidentWave
from ruptfx.bodies.space.closest import closest
from ruptfx.input.quantities import at_most
from ruptfx.input.schema import unit_of
from ruptfx.interfaces.faults.sides import sides_of
from ruptfx.interfaces.mechanisms.checks.table import Row

if TYPE_CHECKING:
    from ruptfx.interfaces.faults.fault import Fault
    from ruptfx.interfaces.mechanisms.system import System

# Soft gels to diamond; aerogels to osmium; gels to diamond; smallest pressure on a laboratory sample.
MODULI = (1e3, 1.3e12)  # Pa
DENSITIES = (10.0, 23e3)  # kg/m3
SPEEDS = (1.0, 20e3)  # m/s
LEAST_STRESS = 100.0  # Pa
BALANCED = 1e-6  # largest resultant of loads over their sum that may be rounding
LARGEST_STRAIN = 0.05  # of the initial stress over the modulus rho c_p^2


@dataclass(frozen=True)
class Doubt:
    """One warning."""

    quantity: str
    value: float
    unit: str
    note: str
    likely_meant: bool = False
    """Only a remark, not a warning."""


def row_of(doubt: Doubt) -> Row:
    """Return the row of `ruptfx check` that shows a doubt."""
    return Row(doubt.quantity, doubt.value, doubt.unit, doubt.note, "ok" if doubt.likely_meant else "warning")


def doubts(model: System) -> Iterator[Doubt]:
    """Yield all warnings about a case on this rank."""
    for name, material in zip(model.bodies.names, model.materials, strict=True):
        for key in type(material).model_fields:
            value = getattr(material, key)
            unit = unit_of(type(material), key)
            bounds = {"Pa": MODULI, "kg/m3": DENSITIES}.get(unit)
            if bounds and isinstance(value, float) and value != 0 and not bounds[0] <= value <= bounds[1]:
                note = f"{_outside(value, bounds)} of any solid; is its exponent lost?"
                yield Doubt(f"{name}: {key}", value, unit, note)
        speeds = material.wave_speeds(model.case.plane)
        for key in ("c_p", "c_s"):
            value = float(getattr(speeds, key))
            if not SPEEDS[0] <= value <= SPEEDS[1]:
                note = f"{_outside(value, SPEEDS)} of any solid; look at the moduli and the density"
                yield Doubt(f"{name}: {key}", value, "m/s", note)
    for fault in model.faults:
        if len(fault.interface.plus):
            yield from _stress(model, fault)
    if "inertia" in model.case.stepper.offers and not model.case.stepper.adaptive:
        yield from _echoes(model)
        yield from _drifts(model)


def slow_records(model: System, label: str, zone: float, c_R: float) -> Iterator[Doubt]:
    """Warn of records further apart than the time in which a process zone passes a point."""
    if "inertia" not in model.case.stepper.offers:
        return
    interval = model.case.intervals["interface"]
    passing = zone / c_R
    if interval > passing and model.case.output.interface_steps is None:
        yield Doubt(
            f"{label}: interval of records", interval, "s",
            f"the process zone passes a point in {at_most(passing, 4)} s: slip rates between records are missed; "
            "reduce output.interface_interval",
        )  # fmt: skip


def _outside(value: float, bounds: tuple[float, float]) -> str:
    return f"less than {bounds[0]:g}, that" if value < bounds[0] else f"more than {bounds[1]:g}, that"


def _stress(model: System, fault: Fault) -> Iterator[Doubt]:
    largest = float(np.max(np.abs(fault.normal_stress_0), initial=0.0))
    label = f"faults.{fault.name}.initial_stress"
    if 0 < largest < LEAST_STRESS:
        yield Doubt(label, largest, "Pa", "hardly pressed together; is the exponent lost ('6 MPa')?")
    sides = sides_of(model, fault.interface)
    # rho c_p^2; of a rigid side infinite
    stiffness = float(np.min(sides.moduli[..., 0, 0] * (sides.along[..., 0] / sides.along[..., 1]) ** 2))
    if largest > LARGEST_STRAIN * stiffness:
        note = f"{100 * largest / stiffness:.3g} % of the stiffness of a body: strains are not small"
        yield Doubt(label, largest, "Pa", note)


def _echoes(model: System) -> Iterator[Doubt]:
    """Warn of reflecting edges away from the interfaces, with the arrival time of reflections."""
    layout, boundaries = model.layout, model.case.boundaries
    silent = {boundary.edge for boundary in boundaries if isinstance(boundary, Absorbing | IncidentWave)}
    silent.update(edge for boundary in boundaries for edge in boundary.tied_edges or ())
    silent.update(model.bodies.mirror_planes.values())
    faces = [fault.interface for fault in model.faults if len(fault.interface.points)]
    if not faces:
        return
    extent = float(np.max(np.ptp(model.coordinates, axis=0)))
    fastest = [material.wave_speeds(model.case.plane).c_p for material in model.materials]
    if model.variation is not None:
        fastest = model.variation.fastest.tolist()
    explained = ""
    for name in model.bodies.edges:
        edge = model.loads.edge(name, "boundaries")
        if name in silent or not len(edge.nodes):
            continue
        group = layout.welded[edge.bodies[0]]
        near = [face.points for face in faces if group in layout.welded[layout.body[face.nodes]]]
        x = model.coordinates[edge.nodes]
        points = near or [face.points for face in faces]
        distance = min(float(closest(x, own)[0].min()) for own in points)
        arrival = 2 * distance / max(fastest[body] for body in np.unique(edge.bodies))
        if distance > 1e-6 * extent and arrival < model.case.duration:
            yield Doubt(
                f"{name}: echo", arrival, "s", f"the same as {explained}" if explained else
                f"the run lasts {model.case.duration:.3g} s: waves that this edge reflects are back at the interface "
                "before its end; make the body larger, or the edge absorbing, unless they belong to the experiment",
                likely_meant=True,
            )  # fmt: skip
            explained = explained or name


def _drifts(model: System) -> Iterator[Doubt]:
    """Warn of bodies that only dashpots hold against a lasting load: they move for ever at the load over the dashpots.

    Loads of entries with dashpots of their own, as incident waves, pass. Interfaces and ties count as connections.
    """
    loads, layout, c, end = model.loads, model.layout, model.components, model.case.duration
    if model.cracks is not None or model.collisions is not None or model.attachments:
        return
    group = layout.welded.copy()
    joined = [face.nodes for face in (fault.interface for fault in model.faults)]
    joined += [np.concatenate([model.loads.edge(name, "boundaries").nodes for name in boundary.tied_edges])
               for boundary in model.case.boundaries if boundary.tied_edges]  # fmt: skip
    for nodes in joined:
        there = group[layout.touches[:, nodes].any(axis=1)]
        group[np.isin(group, there)] = there.min(initial=group.max())
    held = loads.prescribed.reshape(-1, c)
    for support in loads.supports:
        held[support.nodes] |= np.any(support.stiffness, axis=2)
    for fault in model.faults:
        if fault.interface.one_sided:
            held[fault.interface.plus] = True
    lasting = [np.zeros((model.nodes, c)) for _ in range(2)]
    for total, time in zip(lasting, (0.9 * end, end), strict=True):
        for force in loads.lasting_forces:
            total.ravel()[force.dofs] += force.factor(time) * force.values
    dashpot = loads.dashpot.reshape(-1, c)
    for label in np.unique(group):
        nodes = layout.touches[group == label].any(axis=0)
        names = ", ".join(model.bodies.names[body] for body in np.flatnonzero(group == label))
        for i, axis in enumerate("z" if c == 1 else "xyz"[:c]):
            resultant = min((float(total[nodes, i].sum()) for total in lasting), key=abs)
            largest = float(np.abs(lasting[1][nodes, i]).sum())
            if held[nodes, i].any() or abs(resultant) <= BALANCED * largest or not dashpot[nodes, i].any():
                continue
            speed = abs(resultant) / float(dashpot[nodes, i].sum())
            yield Doubt(
                f"{names}: drift along {axis}", speed, "m/s",
                f"only dashpots resist the load along {axis}: the bodies move for ever, {speed * end:.3g} m until the "
                "end; hold an edge (kind = 'driven' with velocity = 0, or 'spring'), or load the other side, too",
            )  # fmt: skip
