"""Consistency of the values of a case, beside the compatibility of its parts (`ruptfx.case.support`).

Every check yields messages. Of each only the first counts: the others may follow from the same mistake.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

from ruptfx.laws.materials import IN_PLANE

if TYPE_CHECKING:
    from ruptfx.case import Case
    from ruptfx.input.schema import Part

Messages = Iterator[str]
MOST_RECORDS = 1e7
"""Records of one kind in a run; more are a mistake, a missing unit for example."""


def problems(case: Case) -> list[str]:
    """Return what is inconsistent in a case, at most one message of each check."""
    items = []
    for check in _checks(case):
        try:
            message = next(check, None)
        except ValueError as error:  # of a part that checks itself
            message = str(error)
        if message:
            items.append(message)
    return items


def _checks(case: Case) -> Iterator[Messages]:
    components = {"antiplane": "z", "solid": "xyz"}.get(case.plane, "xy")
    for key, boundary in case.all_boundaries():
        yield _own(boundary.check, key, case.plane, components)
    yield _named(case.attachments, "attachments", "attachment", case.plane, components)
    yield _initial_velocity(case, components)
    yield _stages(case)
    yield _named(case.instruments, "instruments", "instrument", case.plane, components)
    yield _named(case.cameras, "cameras", "camera", case.plane)
    yield _along_strike(case)
    yield _growth(case)
    for check in (_intervals, _forces, _rotations, _fracture, _axisymmetric, _tensors, _body_stress):
        yield check(case)


def _own(check: Callable[..., None], *arguments: object) -> Messages:
    """Let a part check itself, which raises a ValueError."""
    check(*arguments)
    yield from ()


def _named(parts: Sequence[Part], table: str, noun: str, *arguments: object) -> Messages:
    seen = set[str]()
    for number, part in enumerate(parts):
        part.check(f"{table}.{number}", *arguments)  # type: ignore[attr-defined]
        name = part.name  # type: ignore[attr-defined]
        if name in seen:
            yield f"{table}.{number}.name = '{name}': another {noun} has that name; give each one of its own"
        seen.add(name)


def _initial_velocity(case: Case, components: str) -> Messages:
    for name, velocity in case.initial_velocity.items():
        if len(velocity) != len(components):
            yield (
                f"initial_velocity.{name} = {velocity}: plane = '{case.plane}' moves in {', '.join(components)}; "
                f"give {len(components)} components"
            )
        if case.stepper.kind() != "leapfrog":
            yield (
                f"initial_velocity.{name}: steps of stepper.kind = '{case.stepper.kind()}' begin at rest; use "
                "'leapfrog', or leave it out"
            )


def _stages(case: Case) -> Messages:
    if not case.stages:
        return
    together = sum(stage.duration for stage in case.stages)
    if abs(together - case.duration) > 1e-9 * case.duration:
        yield f"duration = {case.duration:g} s: the stages last {together:.12g} s together; give that"
    ties = [boundary for boundary in case.boundaries if boundary.tied_edges is not None]
    for number, stage in enumerate(case.stages):
        if stage.boundaries is not None and [b for b in stage.boundaries if b.tied_edges is not None] != ties:
            yield (
                f"stages.{number}.boundaries: what ties edges (periodic) holds from the beginning to the end; give "
                "the same in [[boundaries]] and in every stage"
            )


def _along_strike(case: Case) -> Messages:
    along = case.mesh.along_strike
    if along is None:
        return
    key = f"mesh.along_strike: points = {along.points} along {along.period:g} m"
    if case.plane != "solid":
        yield f"{key}: slip varies in two directions and bodies move in three, plane = '{case.plane}'; use 'solid'"
    for table in ("instruments", "cameras", "objective"):
        if getattr(case, table):
            yield f"{key}: bodies are known at their interfaces only; remove {table}, or use mesh.kind = 'extruded'"
    if case.output.bulk_interval is not None:
        yield (
            f"output.bulk_interval = {case.output.bulk_interval:g} s: the motion of bodies that repeat along strike is "
            "known at their interfaces only; remove it"
        )


def _intervals(case: Case) -> Messages:
    entries = {f"output.{name}_interval": getattr(case.output, f"{name}_interval") for name in case.intervals}
    entries |= {f"instruments.{number}.interval": each.interval for number, each in enumerate(case.instruments)}
    for key, interval in entries.items():
        if interval is not None and case.duration / interval > MOST_RECORDS:
            yield (
                f"{key} = {interval:g} s: {case.duration / interval:.3g} records in duration = "
                f"{case.duration:g} s, and at most {MOST_RECORDS:g} are made; "
                f"give at least {1.01 * case.duration / MOST_RECORDS:.3g} s"
            )


def _growth(case: Case) -> Messages:
    growth = case.output.interface_growth
    if growth is not None and "inertia" in case.stepper.offers:
        yield (
            f"output.interface_growth = {growth:g}: not for stepper.kind = '{case.stepper.kind()}', whose steps are as "
            "short where slip is slow; remove it, or use 'quasi_dynamic' or 'quasi_static'"
        )


def _forces(case: Case) -> Messages:
    if case.output.forces_interval is not None and all(fault.sliding is None for fault in case.faults.values()):
        yield (
            f"output.forces_interval = {case.output.forces_interval:g} s: forces are recorded where an interface "
            "slides; add the table [faults.NAME.sliding], or remove this key"
        )


def _rotations(case: Case) -> Messages:
    if case.large_rotations and case.faults and case.plane != "solid":  # refused by `support.py`
        yield (
            f"large_rotations: faults.{next(iter(case.faults))} keeps the direction that it has in the mesh; leave "
            'one of them out, or make the interface a contact of two bodies, [fracture.pairs."BODY-OTHER"]'
        )


def _fracture(case: Case) -> Messages:
    if case.plane == "solid":  # [fracture] is refused by `support.py`
        if case.collisions is not None and case.fracture is None:
            yield "collisions, plane = 'solid': in plane stress and strain only; remove [collisions]"
        return
    if case.collisions is not None and (case.fracture is None or not case.large_rotations):
        remedies = ["the table [fracture]"] * (case.fracture is None)
        remedies += ["large_rotations = true before the first table"] * (not case.large_rotations)
        yield f"collisions: what moves far may turn and break; add {', and '.join(remedies)}"
    if case.fracture is None:
        return
    if case.order != 1:
        yield f"order = {case.order}: with [fracture] the cells must be of order 1; set order = 1"
    for name, fault in case.faults.items():
        for key in ("normal", "shear"):
            value = getattr(fault.initial_stress, key)
            if value is not None and (callable(value) or value != 0):
                yield (
                    f"faults.{name}.initial_stress.{key}: with [fracture] the facets of the bodies carry the "
                    "initial stress, too, and need all of it; give initial_stress.tensor, or load the bodies by "
                    "boundaries"
                )


def _axisymmetric(case: Case) -> Messages:
    for name, fault in case.faults.items():
        if case.plane == "axisymmetric" and fault.initial_stress.tensor is not None:
            yield (
                f"faults.{name}.initial_stress.tensor: around an axis no uniform stress is in equilibrium in "
                "general; give the normal and shear stress of the interface"
            )


def _tensors(case: Case) -> Messages:
    tensors = {n: f.initial_stress.tensor for n, f in case.faults.items() if f.initial_stress.tensor is not None}
    for name, tensor in tensors.items():
        key = f"faults.{name}.initial_stress.tensor = {tensor}"
        if case.plane == "antiplane":
            yield f"{key}: not in antiplane; give normal and shear"
        if case.plane == "solid" and len(tensor) == 3:
            xx, yy, xy = tensor
            yield (
                f"{key}: plane = 'solid' needs 6 components, xx, yy, zz, xy, yz, xz; write [{xx:g}, {yy:g}, ZZ, "
                f"{xy:g}, YZ, XZ] with the three that are missing"
            )
        if case.plane != "solid" and len(tensor) == 6:
            yield (
                f"{key}: plane = '{case.plane}' has 3 components, xx, yy, xy; write [{tensor[0]:g}, {tensor[1]:g}, "
                f"{tensor[3]:g}], or all 6 in the table [initial_stress]"
            )
    first = next(iter(tensors), "")
    for name, tensor in tensors.items():
        if tensor != tensors[first]:
            yield (
                f"faults.{name}.initial_stress.tensor = {tensor}: faults.{first} has {tensors[first]}, and the "
                "bodies have one uniform initial stress; give normal and shear where an interface carries another"
            )


def _body_stress(case: Case) -> Messages:
    """Check the table `[initial_stress]`, and that nothing lacks it."""
    value = case.initial_stress
    if value is None:
        yield from _missing_stress(case)
        return
    if case.plane in ("antiplane", "axisymmetric"):
        yield f"initial_stress: not for plane = '{case.plane}'; give normal and shear in faults.NAME.initial_stress"
    value.check(case.plane)
    for name, fault in case.faults.items():
        if fault.initial_stress.tensor is not None:
            yield (
                f"faults.{name}.initial_stress.tensor: [initial_stress] gives the stress of the bodies; remove one "
                "of them"
            )
    yield from _stressed_materials(case)
    if case.fracture is not None and value.everywhere is None:
        yield (
            f"initial_stress.kind = '{value.kind()}': with [fracture] the stress of the bodies is uniform; use "
            "kind = 'uniform'"
        )
    for name in _yielding(case) if value.everywhere is not None else ():
        try:
            case.stressed_materials[name].check_values()
        except ValueError as error:
            yield f"materials.{name}.{error}"


def _yielding(case: Case) -> list[str]:
    """Return the names of the materials with an initial stress, on which yield depends."""
    return [name for name, material in case.materials.items() if "initial_stress" in type(material).model_fields]


def _missing_stress(case: Case) -> Messages:
    for name in _yielding(case):
        material = case.materials[name]
        if getattr(material, "initial_stress", None) is None and type(material).needs_initial_stress:
            yield (
                f"materials.{name}.initial_stress: missing, and yield depends on it; give it, or the stress of "
                "the bodies, [initial_stress]"
            )
    for name, fault in case.faults.items():
        if fault.initial_stress.of_bodies and fault.friction is not None:
            yield (
                f"faults.{name}.initial_stress: missing; give normal (and shear) or tensor, or the stress of "
                "the bodies, [initial_stress]"
            )


def _stressed_materials(case: Case) -> Messages:
    """Check the materials of a case with the table `[initial_stress]`."""
    yields = _yielding(case)
    for name in yields:
        if getattr(case.materials[name], "initial_stress", None) is not None:
            yield (
                f"materials.{name}.initial_stress: [initial_stress] gives the stress of the bodies; remove one of them"
            )
    if yields and case.initial_stress is not None and not case.initial_stress.has_six:
        yield f"initial_stress.tensor: materials.{yields[0]} depends on 6 components; give xx, yy, zz, xy, yz, xz"
    for name, material in case.materials.items():
        if name not in yields and type(material).has_memory() and not type(material).linear:
            yield (
                f"materials.{name}: '{material.kind()}' does not know an initial stress; give its class a field "
                "`initial_stress`, or normal and shear in faults.NAME.initial_stress in place of [initial_stress]"
            )


# -- keys without effect ---------------------------------------------------------------------------


def without_effect(case: Case) -> Messages:
    """Yield messages on keys that change nothing in the case, whatever its parts are."""
    output, stop = case.output, case.stop_when
    if case.plane not in IN_PLANE:
        of_fringes = {
            f"materials.{name}.fringe_constant": (material.fringe_constant, "N/m")
            for name, material in case.materials.items()
        }
        for key, (value, unit) in {"output.plate_thickness": (output.plate_thickness, "m"), **of_fringes}.items():
            if value is not None:
                yield (
                    f"{key} = {value:g} {unit}: without effect, for fringes are of plates, and plane = "
                    f"'{case.plane}'; remove it"
                )
    yield from _edges_named_twice(case)
    if case.faults:
        return
    # A resolved case gives its defaults, too.
    entries = {
        f"output.{name}": getattr(output, name) for name in ("rupture_threshold", "rupture_after")
        if getattr(output, name) != type(output).model_fields[name].default
    }  # fmt: skip
    keys = [f"{key} = {value:g}" for key, value in entries.items()]
    keys += [key for key, rule in (stop.by_key() if stop is not None else {}).items() if rule.of_interfaces]
    for key in keys:
        yield f"{key}: without effect, for there is no interface ([faults.NAME]); remove it"


def _edges_named_twice(case: Case) -> Messages:
    """Yield messages on boundaries that add nothing to an edge on which another one acts."""
    edges: dict[tuple[str, str], list[str]] = {}
    idle = []
    for key, boundary in case.all_boundaries():
        edge = key.rpartition(".")[0], getattr(boundary, "edge", "")
        edges.setdefault(edge, []).append(key)
        if not boundary.acts:
            idle.append((key, boundary.kind(), edge))
    for key, kind, edge in idle:
        others = [other for other in edges[edge] if other != key]
        if others:
            yield (
                f"{key}.kind = '{kind}': without effect, for {others[0]} acts on '{edge[1]}', too, and leaves free "
                "what it does not drive or load; remove this entry"
            )
