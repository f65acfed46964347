"""Interfaces of a model from their tables in a case: geometry, laws and initial stress at the points."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from ruptfx import RuptfxError
from ruptfx.bodies.space import axisymmetry
from ruptfx.input.profiles import evaluate
from ruptfx.input.profiles.places import Place, located, parts, patches, positions, shifted
from ruptfx.input.profiles.rim import Patch
from ruptfx.input.schema import CaseError
from ruptfx.interfaces.faults.fault import Fault
from ruptfx.interfaces.faults.fields import FaultFields
from ruptfx.interfaces.faults.interface import Interface, build_interface
from ruptfx.interfaces.faults.nearest import nearest_on_line, nearest_on_surface
from ruptfx.interfaces.faults.prescribed_slip import History, PrescribedSlip
from ruptfx.interfaces.sliding.interface import build_sliding
from ruptfx.laws.nucleation import first_begun
from ruptfx.platform import parallel

if TYPE_CHECKING:
    from ruptfx.case import Case, FaultCase
    from ruptfx.interfaces.mechanisms.system import System


MEETS = 1.5
"""Distance of two interfaces over that of neighbouring points there, below which they meet.

Their common point is one of the first interface only.
"""


def make_fault(model: System, case: Case, name: str, fault: FaultCase) -> tuple[Fault, FaultCase]:
    """Return an interface of a model, and its table with positions instead of points; collective.

    Raises
    ------
    CaseError
        On all ranks.
    """
    if name not in model.bodies.interfaces:
        known = ", ".join(model.bodies.interfaces) or "none"
        raise CaseError(f"faults.{name}: the mesh has no interface of that name; it has: {known}")
    if fault.sliding is None:
        face = build_interface(model.layout, name)
    else:
        face = build_sliding(model.layout, name, fault.sliding)
    if model.section is not None:
        face = model.section.surface(face, name)
    if case.plane == "axisymmetric":
        radius = face.points[:, 1]
        reaches = axisymmetry.on_axis(face.points).any()
        parallel.raise_on_all(model.comm, CaseError(
            f"faults.{name}: the interface reaches the axis, where it has no area; make the bodies hollow"
        ) if reaches else None)  # fmt: skip
        face = replace(face, weight=2 * np.pi * radius * face.weight)
    _check_positions(case, name, face, fault)
    fault = located(fault, lambda key, place: _position_of(model, face, key, place), f"faults.{name}")
    fields = _bound_fields(model, face, name, fault)
    error, deepest = None, 0.0 if face.across is None else float(face.across.max(initial=0.0))
    width = parallel.largest(model.comm, deepest)
    try:
        law, contact = fields.surrounding(fault.law.at(face.locations)), fault.contact.at(face.locations)
        normal, shear = fault.initial_stress.tractions(face, law, case.initial_stress)
        if fault.friction is None:
            normal = np.nan_to_num(normal)  # nothing depends on it
        fields.require_closed(normal, face.position)
        prescribed = _prescribed(case, face, fault, width)
        for nucleation in fault.nucleation:
            nucleation.at(face.locations)  # refuses bad profiles before the first step
            law = nucleation.weaken(law, face.locations)
        cohesion = None if fault.cohesion is None else fault.cohesion.at(face.locations)
        gap = None if fault.gap is None else evaluate(fault.at(face.locations).gap, face.locations)
        if gap is not None and np.any((gap > 0) & (normal > 0)):
            raise CaseError("gap: where it is open, initial_stress.normal must be zero")
    except CaseError as caught:  # of a profile, at the points of this rank
        error = CaseError(f"faults.{name}{_with_key(fault, str(caught))}")
    parallel.raise_on_all(model.comm, error)
    tension = -parallel.largest(model.comm, float(normal.max(initial=-np.inf)))
    if 0 < tension < np.inf and fault.initial_stress.normal is None and fault.cohesion is None:
        key = "initial_stress" if fault.initial_stress.of_bodies else f"faults.{name}.initial_stress"
        raise CaseError(
            f"{key}.tensor: pulls at every point of interface '{name}', with {tension:.6g} Pa or more; tension is "
            "positive in a tensor, give compression a minus sign"
        )
    _check_patches(model, name, face, fault)
    after = case.output.rupture_after
    if after is None:
        after = max(first_begun(fault.nucleation)[0], 0.0)
    direction = fault.initial_stress.directions(normal, shear)
    made = Fault(
        name,
        face,
        contact,
        law,
        normal,
        shear,
        direction,
        tuple(fault.nucleation),
        gap,
        cohesion,
        after,
        prescribed,
        fields,
    )
    try:
        made.require_strength()
    except CaseError as caught:  # the points of a rank may differ
        error = caught
    parallel.raise_on_all(model.comm, error)
    return made, fault


def _beyond_the_ends(case: Case, face: Interface) -> list[History]:
    """Return the slip beyond the ends of a fault in a section that repeats along strike; none without such points."""
    along = case.mesh.along_strike
    if along is None or not along.beyond.any():
        return []
    beyond = np.abs(face.points[:, 2]) > along.half_length
    rate = np.where(beyond, along.creep, 0.0)[:, None] * np.array([1.0, 0.0])
    return [History(beyond, lambda time: rate * time, lambda time: rate, np.abs(rate[:, 0]))]


def _prescribed(case: Case, face: Interface, fault: FaultCase, width: float) -> PrescribedSlip | None:
    """Return the slip that is prescribed at the points of this rank.

    Raises
    ------
    CaseError
        On the rank that meets the error: slip at time zero, and a slip rate that jumps where bodies have inertia.
    """
    histories = _beyond_the_ends(case, face)
    if not (fault.prescribed_slip or histories):
        return None
    for number, each in enumerate(fault.prescribed_slip):
        try:
            histories.append(each.bind(face, width))
        except CaseError as error:
            raise CaseError(f"prescribed_slip.{number}: {error}") from None
    slip = PrescribedSlip(histories, fault.friction is None)
    most, largest = case.output.rupture_threshold, float(np.abs(slip.slip(0.0)).max(initial=0.0))
    if largest > 0:
        raise CaseError(
            f"prescribed_slip: slips {largest:.4g} m at time 0, where nothing has moved; "
            "use a history without slip then"
        )
    if "inertia" in case.stepper.offers and np.any(slip.jump > most):
        point = int(np.argmax(slip.jump))
        raise CaseError(
            f"prescribed_slip: the slip rate jumps by {slip.jump[point]:.4g} m/s at position "
            f"{face.position[point]:.6g} m, "
            f"and by more than output.rupture_threshold = {most:g} m/s steps with inertia excite the mesh; let it "
            "grow in "
            "time (ramp, smoothing, or samples that begin and end at rest), or use a stepper without inertia"
        )
    return slip


def _bound_fields(model: System, face: Interface, name: str, fault: FaultCase) -> FaultFields:
    """Return the fields of an interface from its entries; collective.

    Raises
    ------
    CaseError
        On all ranks.
    """
    contributions = []
    for field in ("pore_pressure", "temperature"):
        for number, entry in enumerate(getattr(fault, field)):
            key, error, table = f"faults.{name}.{field}.{number}", None, entry
            try:
                table = entry.at(face.locations)
            except CaseError as caught:  # of a profile, at the points of this rank
                error = CaseError(f"{key}: {caught}")
            parallel.raise_on_all(model.comm, error)
            contributions.append(table.bind(model, face, key))
    return FaultFields(contributions, len(face.plus))


def require_separate_fluids(model: System) -> None:
    """Refuse interfaces that meet and have fluid that flows along both, which is not exchanged; collective.

    Raises
    ------
    CaseError
        On all ranks.
    """
    flows = [fault for fault in model.faults if any(each.flows for each in fault.fields.contributions)]
    places = {}
    for fault in flows:
        places[fault.name] = parallel.share_rows(model.comm, fault.interface.points[fault.interface.owned])
    for (first, ours), (second, theirs) in combinations(places.items(), 2):
        away = [np.linalg.norm(ours - place, axis=1).min() for place in theirs]
        place = theirs[int(np.argmin(away))]
        row = int(np.argmin(np.linalg.norm(ours - place, axis=1)))
        spacing = np.sort(np.linalg.norm(ours - ours[row], axis=1))[:2][-1]
        if min(away) <= MEETS * spacing:
            where = ", ".join(f"{value:.6g}" for value in ours[row])
            raise CaseError(
                f"faults.{second}.pore_pressure: meets faults.{first} at ({where}) m, where fluid would flow from one "
                f"into the other, which is not computed; use kind = 'given' for one of them, or remove "
                f"faults.{second}.pore_pressure"
            )


def _check_positions(case: Case, name: str, face: Interface, fault: FaultCase) -> None:
    """Refuse positions that were lengths from the left end once and are x now, unless the case says that it knows.

    Raises
    ------
    CaseError
        On all ranks.
    """
    left = face.line.first
    if case.positions is not None or face.line.measure != "x" or abs(left) <= 1e-9 * face.line.length:
        return
    defined = list(positions(fault, f"faults.{name}"))
    if case.stop_when is not None:
        defined += positions(case.stop_when, "stop_when")
    if defined:
        raise CaseError(
            f"positions: faults.{name} is along x from {left:g} m, where positions are x; until ruptfx 0.1 they "
            'were lengths from its left end. Say that they are x: add the line positions = "x" before the first '
            f"table of the case; and if it was written for 0.1, shift them by {left:g} m: {shifted(defined, left)}"
        )


def _check_patches(model: System, name: str, face: Interface, fault: FaultCase) -> None:
    """Refuse patches and strips of a surface in which no point of it lies.

    Raises
    ------
    CaseError
        On all ranks.
    """
    _check_strips(model, name, face, fault)
    for key, patch in parts(fault, f"faults.{name}"):
        if not isinstance(patch, Patch) or face.across is None:
            continue
        share = parallel.largest(model.comm, float(patch.share(face.locations).max(initial=0.0)))
        if share == 0:
            (first, last), (upper, lower) = patch.strike, patch.dip
            deepest = parallel.largest(model.comm, float(face.across.max(initial=0.0)))
            raise CaseError(
                f"{key}: no point of the surface is in the {patch.kind()} with strike = {first:g} to {last:g} m "
                f"and dip = {upper:g} to {lower:g} m; the points have strike from {face.line.first:g} to "
                f"{face.line.last:g} m and dip from 0 to {deepest:g} m: move the patch onto the surface, or reduce "
                "mesh.element_size if it is between points"
            )


def _check_strips(model: System, name: str, face: Interface, fault: FaultCase) -> None:
    """Refuse strips across a surface in which no point of it lies.

    A profile whose strip is beyond the surface is not refused: it has its outer value there, and several
    interfaces may have the same profile.
    """
    if face.across is None:
        return
    for strip in patches(fault, f"faults.{name}"):
        if not strip.has_edge or strip.center is not None:
            continue
        positions = face.across if strip.down_dip else face.position
        first, last = strip.ends
        slack = 1e-9 * (last - first)
        inside = (positions >= first - slack) & (positions <= last + slack)
        if parallel.anywhere(model.comm, bool(inside.any())):
            continue
        lowest = -parallel.largest(model.comm, float((-positions).max(initial=-np.inf)))
        highest = parallel.largest(model.comm, float(positions.max(initial=-np.inf)))
        if (lowest < last and first < highest) or ".nucleation." in strip.key:
            raise CaseError(
                f"{strip.key}: no point of the surface is in the {strip.kind} from {first:g} to {last:g} m "
                f"{'down dip' if strip.down_dip else 'along strike'}; the points are from {lowest:g} to "
                f"{highest:g} m: move it onto the surface, or reduce mesh.element_size if it is between points"
            )


def _position_of(model: System, face: Interface, key: str, place: Place) -> float | np.ndarray:
    """Return the position [m] of the point of an interface that is nearest to a given one; collective."""
    if (place.z is None) != (len(face.line.origin) == 2):
        raise CaseError(f"{key}: give x, y and z of a point of a surface, x and y of one on a line")
    try:
        if place.z is not None:
            return nearest_on_surface(face, model.comm, np.array([place.x, place.y, place.z]))
        return nearest_on_line(face, model.comm, np.array([place.x, place.y]))[0]
    except RuptfxError as error:
        raise CaseError(f"{key} = {error}") from None


def _with_key(fault: FaultCase, message: str) -> str:
    """Return the end of a key and a message, which may begin with the class and the field of a part of a fault."""
    parts = {"friction": fault.law, "contact": fault.contact, "initial_stress": fault.initial_stress,
             **{f"nucleation.{number}": each for number, each in enumerate(fault.nucleation)}}  # fmt: skip
    keys = [key for key, part in parts.items() if message.startswith(f"{type(part).__name__}.")]
    # Two nucleations of one kind are not told apart.
    return f".{keys[0]}.{message.partition('.')[2]}" if len(keys) == 1 else f": {message}"
