"""Unknowns of an objective: which initial tractions and parameters of a law the keys of a case are."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ruptfx.input.profiles import evaluate
from ruptfx.input.quantities import at_least, at_most
from ruptfx.input.schema import CaseError, nearest, unit_of
from ruptfx.interfaces.faults.fault import Fault
from ruptfx.interfaces.faults.fields import FaultFields
from ruptfx.interfaces.mechanisms import mechanisms_of
from ruptfx.laws.friction import FrictionLaw
from ruptfx.laws.friction.in_fields import InFields
from ruptfx.laws.nucleation import Nucleation
from ruptfx.many_runs.adjoint.bodies import constants_of
from ruptfx.platform import parallel
from ruptfx.readings.misfits import Misfit, Unknown

if TYPE_CHECKING:
    from ruptfx.interfaces.faults.interface import Interface
    from ruptfx.interfaces.pore_pressure import PorePressure
    from ruptfx.run.model import Model

Floats = NDArray[np.float64]
INSTANTS = ("begin", "end")
"""Times of a nucleation, which are no unknowns: with its begin its end moves, too."""
STIFFNESS = "Pa/m"
"""Unit of the constants of contact methods by which a run is differentiated."""


@dataclass(frozen=True)
class Place:
    """Place of an unknown among the parameters of the interfaces, or the constants of the bodies.

    Attributes
    ----------
    key, unit : str
    fault : int
        -1 for a constant of bodies, a parameter of a term, and tied keys.
    rows : tuple of (str, float)
        Parameters of `PointMap` and their change by that of the unknown; none for a nucleation.
    nucleation : Nucleation, optional
        Nucleation of unit amplitude, if the unknown is an amplitude.
    """

    key: str
    unit: str
    fault: int
    rows: tuple[tuple[str, float], ...] = ()
    nucleation: Nucleation | None = None
    constant: tuple[str, str] | None = None
    """Material and name of a constant of bodies."""
    term: tuple[int, str] | None = None
    """Number of a term of the objective, and the name of its parameter."""
    tied: tuple[tuple[Place, float], ...] = ()
    """Places of tied keys, each with its factor: what one number for all of them stands for."""

    @property
    def members(self) -> tuple[tuple[Place, float], ...]:
        """Places of all keys with their factors: the place alone if no others are tied to it."""
        return self.tied or ((self, 1.0),)

    @property
    def of_points(self) -> bool:
        """True if the unknown has a value at every point of an interface, and is no single number."""
        return self.fault >= 0

    @property
    def of_constant(self) -> bool:
        """True if it is, or is tied to, a constant of bodies."""
        return any(place.constant is not None for place, _ in self.members)

    @property
    def of_contact(self) -> bool:
        """True for a stiffness of a contact method, on which the stable time step depends."""
        return any(name.startswith("c_") for place, _ in self.members for name, _ in place.rows)


def constants(model: Model) -> dict[str, Place]:
    """Return the constants of the bodies by which a run is differentiated, by key."""
    keys = {f"materials.{name}.{each}": (name, each, unit) for name, each, unit in constants_of(model)}
    return {key: Place(key, unit, -1, constant=(name, each)) for key, (name, each, unit) in keys.items()}


def of_terms(terms: Sequence[Misfit]) -> dict[str, Place]:
    """Return the parameters of the terms of an objective by which it is differentiated, by key.

    `objective.*.time_shift` ties the parameters of all terms.
    """
    known = [(n, name, unit) for n, term in enumerate(terms) for name, unit in term.parameters.items()]
    result = {f"objective.{n}.{name}": Place(f"objective.{n}.{name}", unit, -1, term=(n, name))
              for n, name, unit in known}  # fmt: skip
    for name in dict.fromkeys(name for _, name, _ in known):
        owners = [result[f"objective.{n}.{name}"] for n, other, _ in known if other == name]
        if len({place.unit for place in owners}) == 1:  # an offset of channels of one unit
            key = f"objective.*.{name}"
            result[key] = Place(key, owners[0].unit, -1, tied=tuple((place, 1.0) for place in owners))
    return result


def _tied(unknown: Unknown, known: Mapping[str, Place], number: int) -> Place:
    """Return the place of an unknown with the keys that are tied to it.

    Raises
    ------
    CaseError
        A tied key that is no unknown of the case, or has another unit.
    """
    own = known[unknown.key]
    members = list(own.members)
    for index, (key, factor) in enumerate(unknown.ties):
        name = f"unknowns.{number}.tied.{index} = '{key}'"
        if key not in known:
            raise CaseError(f"{name}: cannot be differentiated, {nearest(key, list(known))}")
        if known[key].unit != own.unit:
            raise CaseError(
                f"{name}: is in {known[key].unit}, and '{unknown.key}' in {own.unit}; tie keys of one unit, or make "
                "each an unknown"
            )
        members += [(place, factor * part) for place, part in known[key].members]
    return replace(own, fault=-1, rows=(), nucleation=None, constant=None, term=None, tied=tuple(members))


def places(model: Model) -> dict[str, Place]:
    """Return all unknowns that the interfaces of a case have, by key."""
    return {place.key: place for number, fault in enumerate(model.faults) for place in _of_fault(model, number, fault)}


def chosen(
    model: Model, unknowns: Sequence[Unknown], terms: Sequence[Misfit] | None = None
) -> list[tuple[Unknown, Place]]:
    """Return the given unknowns, or all of the interfaces, with their places.

    Parameters
    ----------
    terms : sequence of Misfit, optional
        Of the objective; default is that of the case.

    Raises
    ------
    CaseError
        A key that is no unknown of the case, or given twice; tied keys of other units; knots of a single number, on a
        surface, or on which no point depends.
    """
    known = places(model)
    items = list(unknowns) or [Unknown(key=key) for key in known]
    known |= constants(model) | of_terms(model.case.objective if terms is None else terms)
    result: list[tuple[Unknown, Place]] = []
    for number, each in enumerate(items):
        if each.key not in known:
            hint = nearest(each.key, list(known))
            raise CaseError(f"unknowns.{number}.key = '{each.key}': cannot be differentiated, {hint}")
        if each.key in [other.key for other in items[:number]]:
            raise CaseError(f"unknowns.{number}.key = '{each.key}': is given twice; remove one of them")
        result.append((each, _tied(each, known, number) if each.tied else known[each.key]))
        _refuse_repeated(result)
        if not known[each.key].of_points and each.shape == "knots":
            raise CaseError(f"unknowns.{number}.shape = 'knots': '{each.key}' is one number; use shape = 'number'")
        if each.shape == "knots":
            face = model.faults[known[each.key].fault].interface
            hats(each, face, whole(model, face, face.position), f"unknowns.{number}")
    return result


def _refuse_repeated(items: Sequence[tuple[Unknown, Place]]) -> None:
    """Refuse a key of the last unknown that it has twice, or that belongs to another one, too."""
    owners: dict[str, str] = {}
    for unknown, place in items:
        for member, _ in place.members:
            if member.key in owners:
                raise CaseError(
                    f"unknowns.{len(items) - 1}.key = '{items[-1][0].key}': '{member.key}' belongs to "
                    f"'{owners[member.key]}' already; remove one of them"
                )
            owners[member.key] = unknown.key


def whole(model: Model, face: Interface, values: Floats) -> Floats:
    """Return values at all points of an interface in their order, from those of every rank; collective."""
    result = np.zeros(face.total)
    result[face.number[face.owned]] = values[face.owned]
    return parallel.total(model.comm, result)


def at_points(values: Floats, face: Interface) -> Floats:
    """Return values of all points of an interface, or one number, at the points of this rank."""
    return values[face.number] if len(values) > 1 else np.full(len(face.number), values[0])


def untied(changes: Sequence[tuple[Place, Floats]]) -> list[tuple[Place, Floats]]:
    """Return the changes of single keys from those of unknowns."""
    return [(member, factor * values) for place, values in changes for member, factor in place.members]


def single_changes(place: Place, change: float) -> list[tuple[Place, float]]:
    """Return the changes of single keys from that of one unknown by a number."""
    return [(member, factor * change) for member, factor in place.members]


def hats(unknown: Unknown, face: Interface, position: Floats, key: str) -> Floats:
    """Return the linear interpolation from knots to points, constant outside.

    Parameters
    ----------
    position : ndarray, shape (n,)
        All points of the interface [m].
    key : str
        Of the unknown, for messages.

    Returns
    -------
    ndarray, shape (n, knots)

    Raises
    ------
    CaseError
        Knots on a surface, outside of the interface, or on which no point depends.
    """
    assert unknown.knots is not None
    knots = np.array(unknown.knots)
    if face.across is not None:
        raise CaseError(f"{key}.shape = 'knots': knots are along lines, and this is a surface; use 'number'")
    if knots.max() < position.min() or knots.min() > position.max():
        raise CaseError(
            f"{key}.knots = {unknown.knots}: the interface lies from {at_least(position.min())} m to "
            f"{at_most(position.max())} m; place knots there"
        )
    result = np.array([np.interp(position, knots, row) for row in np.eye(len(knots))]).T
    empty = ~result.any(axis=0)
    if empty.any():
        raise CaseError(
            f"{key}.knots: no point of the interface depends on that at {knots[np.argmax(empty)]:g} m; remove it"
        )
    return result


def _of_fault(model: Model, number: int, fault: Fault) -> Iterator[Place]:  # noqa: C901
    of_case = model.placed[fault.name]
    key = f"faults.{fault.name}"
    initial_stress = of_case.initial_stress
    friction = of_case.friction
    if friction is not None and friction.given_slip_rate() is not None and initial_stress.shear is None:
        raise CaseError(
            f"{key}.friction.V_initial: with the state given, too, the initial shear stress follows from the law, and "
            "its derivative is not computed; give initial_stress.shear in its place"
        )
    if initial_stress.of_bodies and fault.tangents > 1:
        # The directions of both tractions vary from point to point.
        raise CaseError(
            f"{key}.initial_stress: derivatives need normal and shear (and rake) there, in place of [initial_stress]"
        )
    angle = np.deg2rad(initial_stress.rake or 0.0)
    directions = (1.0,) if fault.tangents == 1 else (float(np.cos(angle)), float(np.sin(angle)))
    rows = tuple((f"shear_traction_0_{k}", part) for k, part in enumerate(directions))
    yield Place(f"{key}.initial_stress.shear", "Pa", number, rows)
    yield Place(f"{key}.initial_stress.normal", "Pa", number, (("normal_stress_0", 1.0),))
    wrapped = [each for each in fault.nucleation if "weakening" in each.offers]
    law: FrictionLaw = fault.friction
    prefix = "p_"
    for weakening in reversed(wrapped):  # the last one is outside
        index = fault.nucleation.index(weakening)
        for name in type(law).model_fields:
            if name in type(weakening).model_fields and name in _numbers(law) and name not in INSTANTS:
                place = f"{key}.nucleation.{index}.{name}"
                yield Place(place, unit_of(type(weakening), name), number, ((prefix + name, 1.0),))
        law, prefix = law.law, f"{prefix}law_"  # type: ignore[attr-defined]
    path = f"{key}.friction"
    while True:
        if isinstance(law, InFields):  # of no key of the case
            law, prefix = law.law, f"{prefix}law_"
        for name in _numbers(law):
            yield Place(f"{path}.{name}", unit_of(type(law), name), number, ((prefix + name, 1.0),))
        if getattr(law, "law", None) is None:
            break
        law, prefix, path = law.law, f"{prefix}law_", f"{path}.law"  # type: ignore[attr-defined]
    yield from _of_fluids(of_case.pore_pressure, fault.fields, key, number)
    for name in type(fault.contact).model_fields:
        if unit_of(type(fault.contact), name) == STIFFNESS:
            yield Place(f"{key}.contact.{name}", STIFFNESS, number, ((f"c_{name}", 1.0),))
    for index, each in enumerate(fault.nucleation):
        if "extra" in type(each).model_fields:
            one = each.substituted({"extra": 1.0})
            yield Place(f"{key}.nucleation.{index}.extra", unit_of(type(each), "extra"), number, nucleation=one)


def _of_fluids(tables: Sequence[PorePressure], fields: FaultFields, key: str, number: int) -> Iterator[Place]:
    """Yield the parameters of known pore pressures, times only where the pressure rises in a time."""
    for index, (table, each) in enumerate(zip(tables, fields.contributions, strict=False)):  # temperatures come last
        for name, values in each.parameters.items():
            if name == "pressure" or np.all(each.parameters["rise"] > 0):
                row = f"fluid_{index}_{name}"
                assert row in fields.parameters and np.ndim(values) == 1
                yield Place(f"{key}.pore_pressure.{index}.{name}", unit_of(type(table), name), number, ((row, 1.0),))


def _numbers(law: FrictionLaw) -> list[str]:
    numbers = []
    for name in type(law).model_fields:
        value = getattr(law, name)
        if isinstance(value, float | int | np.ndarray) and not isinstance(value, bool):
            numbers.append(name)
    return numbers


def changed_model(model: Model, changes: Sequence[tuple[Place, Floats]]) -> Model:
    """Return a model with changed unknowns; those of terms and bodies change nothing.

    Parameters
    ----------
    changes : sequence of (Place, ndarray)
        Added at all points of the interface of the place in their order, or one number.
    """
    of_rows: dict[tuple[int, str], Floats] = {}
    of_nucleations: dict[tuple[int, int], Floats] = {}
    for place, values in untied(changes):
        if not place.of_points:
            continue
        here = at_points(values, model.faults[place.fault].interface)
        if place.nucleation is not None:
            of_nucleations[place.fault, int(place.key.split(".")[-2])] = here
        for name, part in place.rows:
            of_rows[place.fault, name] = of_rows.get((place.fault, name), 0.0) + part * here
    return perturbed(model, of_rows, of_nucleations)


def perturbed(
    model: Model, changes: Mapping[tuple[int, str], Floats], amplitudes: Mapping[tuple[int, int], Floats] | None = None
) -> Model:
    """Return a model with other initial tractions and parameters.

    Parameters
    ----------
    changes : mapping of (int, str) to ndarray, shape (n,)
        Added to parameters of `PointMap`, by fault and name.
    amplitudes : mapping of (int, int) to ndarray, shape (n,), optional
        Added to `extra` of nucleations, by fault and number.
    """
    view = copy.copy(model)
    view.faults = []
    for number, fault in enumerate(model.faults):
        mine = {name: change for (which, name), change in changes.items() if which == number}
        shear = fault.shear_traction_0.copy()
        for k in range(fault.tangents):
            shear[:, k] += mine.get(f"shear_traction_0_{k}", 0.0)
        fields = fault.fields.with_changes(mine)
        law = _with(fault.friction, "p_", mine, fields)
        normal = fault.normal_stress_0 + mine.get("normal_stress_0", 0.0)
        nucleation = list(fault.nucleation)
        for (which, index), change in (amplitudes or {}).items():
            if which == number:
                places, each = fault.interface.locations, nucleation[index]
                extra = evaluate(each.extra, places) + change  # type: ignore[attr-defined]
                nucleation[index] = each.substituted({"extra": extra})
        view.faults.append(replace(
            fault, friction=law, shear_traction_0=shear, normal_stress_0=normal, nucleation=tuple(nucleation),
            fields=fields,
        ))  # fmt: skip
    view.mechanisms = mechanisms_of(view)
    return view


def _with(part: FrictionLaw, prefix: str, changes: Mapping[str, Floats], fields: FaultFields) -> FrictionLaw:
    """Return a law with changed parameters, and with the initial values of the fields of its interface."""
    new: dict[str, object] = {"initial": fields.initial()} if isinstance(part, InFields) else {}
    for name in type(part).model_fields:
        value = getattr(part, name)
        if isinstance(value, FrictionLaw):
            new[name] = _with(value, f"{prefix}{name}_", changes, fields)
        elif prefix + name in changes:
            new[name] = value + changes[prefix + name]
    return part.substituted(new)
