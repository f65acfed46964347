"""Rows of `ruptfx check` on a fault with finite sliding: meshes of both sides, reach of the surfaces, roughness."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ruptfx.bodies.spectrum import springs_of, stable_time_step
from ruptfx.interfaces.mechanisms.checks.table import Row
from ruptfx.interfaces.sliding.roughness import largest_slope, mean_frame, welded_nodes
from ruptfx.laws import rough_contact

if TYPE_CHECKING:
    from ruptfx.bodies.boundaries.loading import Loads
    from ruptfx.interfaces.faults.fault import Fault
    from ruptfx.interfaces.mechanisms.system import System
    from ruptfx.interfaces.sliding.interface import SlidingInterface
    from ruptfx.interfaces.sliding.roughness import Roughness

COARSER = 1.5  # ratio of node spacings of the plus side, which carries the points, and the minus side
FAR_COARSER = 4.0  # ratio of node spacings of the minus side and the plus side, which carries the points
STEEP = 0.2
STIFF = 1.5  # ratio of the stable steps without and with the springs of an interface
ROUNDED = 1e-9  # lengths over that of a surface that are caused by rounding
FEWEST_NODES = 8  # least number of nodes across a contact, and along the shortest wave of a surface


def surface_rows(
    model: System, name: str, face: SlidingInterface, stages_end: Sequence[tuple[float, Loads]]
) -> Iterator[Row]:
    """Yield spacing, length and shape of the surfaces of a sliding interface, and its slip by driven edges."""
    label = f"faults.{name}"
    sides = face.geometry.plus, face.geometry.minus
    ratio = sides[0].spacing / sides[1].spacing
    coarse = "; the finer side should carry the points: swap plus and minus" if ratio > COARSER else ""
    if ratio < 1 / FAR_COARSER:
        coarse = (
            f"; the minus side is {1 / ratio:.2g} times coarser: contacts shorter than its elements are not "
            "resolved, refine it"
        )
    spacings = f"{sides[0].spacing:.4g} m and {sides[1].spacing:.4g} m{coarse}"
    yield Row(f"{label}: spacing of nodes, plus / minus", ratio, "", spacings, "warning" if coarse else "ok")
    slope = max(largest_slope(side) for side in sides)
    steep = "; strains and rotations must stay small: contact of steep flanks is less exact" if slope > STEEP else ""
    yield Row(f"{label}: largest slope", slope, "", f"of both surfaces{steep}", "warning" if steep else "ok")
    yield from _reach_rows(model, label, face, stages_end)
    ways = model.case.stepper.time_schemes
    if "implicit" in ways:
        note = "longer steps are repeated as two"
        yield Row(f"{label}: largest slip of an implicit step", face.step_limit, "m", note)
    if "explicit" in ways and model.case.impact_speed > 0:
        yield Row(
            f"{label}: updates of the pairing", model.case.impact_speed * model.case.duration / face.limit, "",
            f"one in {face.limit:.3g} m of slip, at {model.case.impact_speed:.4g} m/s from the beginning to the end",
        )  # fmt: skip


def _reach_rows(
    model: System, label: str, face: SlidingInterface, stages_end: Sequence[tuple[float, Loads]]
) -> Iterator[Row]:
    """Yield the slip until an end leaves along every tangent, and the part of a surface with a partner."""
    sides = face.geometry.plus, face.geometry.minus
    tangents = mean_frame(sides[0])[1:]
    size = float(np.ptp(sides[0].points @ tangents.T, axis=0).max())
    driven = sum((_driven_slip(model, face, time, loads) for time, loads in stages_end), np.zeros(tangents.shape[1]))
    for number, along in enumerate(tangents, 1):
        lows, highs = zip(*((float(place.min()), float(place.max())) for place in (s.points @ along for s in sides)),
                          strict=True)  # fmt: skip
        margins = [0.0 if abs(end) < ROUNDED * size else end for end in (lows[0] - lows[1], highs[1] - highs[0])]
        slip = float(driven @ along)
        leaves = abs(slip) > max(0.0, margins[slip > 0]) + ROUNDED * size
        away = f", but edges drive it by {slip:.4g} m: make the body that it slides on longer" if leaves else ""
        name = "t" if len(tangents) == 1 else f"t{number}"
        yield Row(
            f"{label}: slip until an end leaves" + f" along {name}" * (len(tangents) > 1), max(0.0, min(margins)), "m",
            f"to -{name} {margins[0]:.4g} m, to +{name} {margins[1]:.4g} m; overhanging parts carry no load{away}",
            "warning" if leaves else "ok",
        )  # fmt: skip
    if len(tangents) > 1:
        part = float(face.weight[face.covered].sum() / face.weight.sum())
        yield Row(f"{label}: part of the surface above the opposite one", part, "", "the remainder carries no load")


def spring_rows(model: System, fault: Fault, stable: float) -> Iterator[Row]:
    """Yield whether springs of a sliding interface are so stiff that bodies chatter."""
    damping = [stage.damping for stage in model.case.stages] + [model.case.damping]
    if "explicit" not in model.case.stepper.time_schemes or not any(fault.contact.stiffness()):
        return
    others = [other for other in springs_of(model) if other.text != f"the contact stiffness of faults.{fault.name}"]
    without = stable_time_step(model, others)
    damped = any(each is not None and each.kelvin_voigt is not None for each in damping)
    chatters = without > STIFF * stable and not damped
    note = (
        "bodies that meet chatter on springs as stiff as these, which gain energy or lose it where they close or open "
        "within a step (impact_loss in energy.csv): add damping.kelvin_voigt, reduce stepper.safety or the stiffness, "
        "or use contact.kind = 'forward_lagrange'"
    )
    yield Row(
        f"faults.{fault.name}: stable step without springs / with them", without / stable, "", note * chatters,
        "warning" if chatters else "ok",
    )  # fmt: skip


def _driven_slip(model: System, face: SlidingInterface, time: float, loads: Loads) -> np.ndarray:
    """Return the displacement of the plus side relative to the minus side by driven edges, shape (dim,) [m]."""
    dim = face.geometry.plus.points.shape[1]
    slip = np.zeros(dim)
    for side, sign in ((face.geometry.plus, 1.0), (face.geometry.minus, -1.0)):
        if not len(side.nodes):  # a rigid base
            continue
        own = welded_nodes(model, side)
        ways = np.zeros(dim)
        for motion in loads.motions:
            way = np.broadcast_to(motion.displacement(time), motion.dofs.shape)
            for axis in range(dim):
                there = own[motion.dofs // dim] & (motion.dofs % dim == axis)
                mean = float(way[there].mean()) if there.any() else 0.0
                ways[axis] = mean if abs(mean) > abs(ways[axis]) else ways[axis]
        slip += sign * ways
    return slip


def rough_rows(label: str, roughness: Roughness | None) -> Iterator[Row]:
    """Yield predictions of theory for the contact of rough surfaces, and whether nodes resolve them."""
    if roughness is None:
        return
    if roughness.shortest is not None:
        note = f"shortest wavelength {roughness.shortest:.4g} m"
        yield _nodes_row(f"{label}: nodes along the shortest wave", roughness.shortest / max(roughness.spacing), note)
    yield Row(f"{label}: E*", roughness.modulus, "Pa", "of the two bodies in contact")
    yield Row(f"{label}: root mean square slope", roughness.slope, "", "of the distance of the surfaces")
    if roughness.wave is not None:
        yield from _wave_rows(label, roughness, *roughness.wave)
    if roughness.wave is None and not roughness.random:
        return
    if roughness.pressure is None or roughness.pressure <= 0:
        why = "the motion of edges presses" if roughness.pressure is None else "nothing presses"
        yield Row(f"{label}: contact fraction", "not known", "", why)
    elif roughness.wave is None:
        touch = rough_contact.rough(roughness.pressure, roughness.modulus, roughness.slope)
        yield Row(f"{label}: contact fraction", touch.fraction, "", f"under {roughness.pressure:.4g} Pa (Persson 2001)")
        yield Row(f"{label}: mean pressure of contacts", touch.pressure, "Pa")


def _wave_rows(label: str, roughness: Roughness, amplitude: float, wavelength: float) -> Iterator[Row]:
    full = rough_contact.full_contact_pressure(roughness.modulus, amplitude, wavelength)
    note = f"full contact; the distance of the surfaces has an amplitude of {amplitude:.4g} m over {wavelength:.4g} m"
    yield Row(f"{label}: p*", full, "Pa", note)
    if roughness.pressure is None or roughness.pressure <= 0:
        return
    touch = rough_contact.waves(roughness.pressure, full)
    yield Row(f"{label}: contact fraction", touch.fraction, "", f"under {roughness.pressure:.4g} Pa (Westergaard 1939)")
    yield Row(f"{label}: peak pressure", touch.pressure, "Pa")
    width = touch.fraction * wavelength
    yield _nodes_row(f"{label}: nodes across one contact", width / roughness.spacing[0], f"width {width:.4g} m")


def _nodes_row(quantity: str, nodes: float, note: str) -> Row:
    if nodes > FEWEST_NODES - 0.01:
        return Row(quantity, nodes, "", note)
    return Row(quantity, nodes, "", f"{note}; too few, {FEWEST_NODES} or more resolve it", "warning")
