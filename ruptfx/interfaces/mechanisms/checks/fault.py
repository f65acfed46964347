"""Rows of `ruptfx check` on a fault: strength, process zones, critical lengths, positions, nucleation."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from ruptfx.input.profiles import evaluate
from ruptfx.input.profiles.constant import Constant
from ruptfx.input.profiles.places import distance, patches
from ruptfx.input.schema import Part, unit_of
from ruptfx.interfaces.faults.projection import TracedLaw
from ruptfx.interfaces.faults.sides import Sides, sides_of
from ruptfx.interfaces.mechanisms.checks.patch import axes_of_positions, surface_patch_rows
from ruptfx.interfaces.mechanisms.checks.plausibility import row_of, slow_records
from ruptfx.interfaces.mechanisms.checks.table import Row
from ruptfx.laws import fracture
from ruptfx.laws.friction import FrictionLaw
from ruptfx.laws.friction.lengths import Breakdown, RateDependence
from ruptfx.laws.materials import WaveSpeeds

if TYPE_CHECKING:
    from ruptfx.interfaces.faults.fault import Fault
    from ruptfx.interfaces.faults.interface import Interface
    from ruptfx.interfaces.mechanisms.system import System
    from ruptfx.laws.nucleation import Nucleation

SUPERSHEAR_LIMIT_3D = 1.19  # largest S ratio on an unbounded fault, Poisson's ratio 0.25 (Dunham 2007)

AnyLengths = TypeVar("AnyLengths", Breakdown, RateDependence)


def place_rows(model: System, fault: Fault) -> Iterator[Row]:
    """Yield the number of points of a fault, their spacing, and the meaning of positions."""
    face, (spacing, down) = fault.interface, _spacings(fault.interface)
    note = f"largest spacing {spacing:.4g} m"
    if face.across is not None:
        note = f"{note} along strike and {down:.4g} m down dip"
    yield Row(f"faults.{fault.name}: points", face.total, "", note)
    yield from _position_rows(model, fault)


def _spacings(face: Interface) -> tuple[float, float]:
    """Return the largest spacings of points along an interface and, on a surface, down dip [m]."""
    return _spacing(face.position), 0.0 if face.across is None else _spacing(face.across)


def fault_rows(model: System, fault: Fault) -> Iterator[Row]:
    """Yield strength, S ratio, process zone and critical lengths of one fault, at its nucleation and weakest place."""
    face, label, spacing = fault.interface, f"faults.{fault.name}", max(_spacings(fault.interface))
    rest, sides = _at_rest(fault), sides_of(model, face)
    beside = [model.materials[model.bodies.names.index(name)] for name in sides.bodies]
    if any(material.lame(model.case.plane) is None for material in beside):
        yield Row(
            f"{label}: lengths and limits", "estimates", "",
            "formulas for isotropic bodies, with the wave speeds along the interface", "warning",
        )  # fmt: skip
    if rest.slips.any() and not isinstance(fault.friction.lengths(fault.normal_stress_0, 1.0), RateDependence):
        ratio = float(np.max(rest.shear[rest.slips] / np.maximum(rest.strength[rest.slips], 1e-300)))
        where = "everywhere" if rest.slips.all() else f"at {np.count_nonzero(rest.slips)} points"
        yield Row(f"{label}: shear / strength", ratio, "", f"it slips from the first step {where}", "warning")
    rate = max(_expected_slip_rate(model, fault, sides), model.case.impact_speed) or 1.0
    lengths = fault.friction.lengths(fault.normal_stress_0, rate)
    start, weakest = _judged_points(model, fault, rest, lengths)
    entries = {row.quantity: row for row in _rows_at(model, fault, sides, rest, lengths, rate, start, spacing)}
    yield from entries.values()
    if weakest == start:
        return
    for row in _rows_at(model, fault, sides, rest, lengths, rate, weakest, spacing):
        same = entries.get(row.quantity)
        if same is None or row.value != same.value:
            yield replace(row, quantity=row.quantity.replace(label, f"{label}, weakest place", 1))


def _spacing(positions: np.ndarray) -> float:
    """Return the largest distance between neighbouring positions [m]."""
    return float(np.max(np.diff(np.sort(positions)), initial=0))


@dataclass(frozen=True)
class _AtRest:
    """Shear stress and strength of the points of a fault before the first step [Pa], and mask of points that slip."""

    shear: np.ndarray
    strength: np.ndarray
    slips: np.ndarray


def _at_rest(fault: Fault) -> _AtRest:
    shear = np.linalg.norm(fault.shear_traction_0, axis=1)
    state = {name: value for name, value in fault.initial_state().items() if name in fault.friction.all_state_fields()}
    zero = np.zeros(len(fault.interface.plus))
    strength = TracedLaw(fault.friction)(zero, np.maximum(fault.normal_stress_0, 0.0), state, 0.0).strength
    if fault.cohesion is not None:
        strength = strength + fault.cohesion.c
    return _AtRest(shear, strength, shear > strength * (1 + 1e-12))


def _judged_points(
    model: System, fault: Fault, rest: _AtRest, lengths: Breakdown | RateDependence | None
) -> tuple[int, int]:
    """Return the indices of the points at which a fault is evaluated, among those that do not slip at once, if any.

    The first is the nearest to the nucleation; without one it is the weakest, too. The weakest has the largest shear
    over strength, where strength depends on the slip rate the largest (b - a) sigma; of several the nearest to the
    nucleation or to the middle.
    """
    face = fault.interface
    begins = _nucleation_position(model, fault, rest)
    middle = 0.5 * (face.line.first + face.line.last) if face.across is None else face.locations.mean(axis=0)
    away = distance(face.locations, middle if begins is None else begins)
    allowed = ~rest.slips if not rest.slips.all() else np.ones(len(away), dtype=bool)
    if isinstance(lengths, RateDependence):
        scores = [np.broadcast_to(lengths.weakening, away.shape)]
    else:
        scores = [rest.shear / np.maximum(rest.strength, 1e-300), -rest.strength]
    best = allowed
    for score in scores:
        best_score = np.max(np.nan_to_num(score[best], nan=-np.inf))
        close = score >= best_score - 1e-9 * abs(best_score)
        best = best & (close if np.any(best & close) else True)  # numbers that overflow tell no point from another
    weakest = int(np.argmin(np.where(best, away, np.inf)))
    start = weakest if begins is None else int(np.argmin(np.where(allowed, away, np.inf)))
    return start, weakest


def _nucleation_position(model: System, fault: Fault, rest: _AtRest) -> float | np.ndarray | None:
    """Return the place where a rupture starts [m]: of a nucleation, or of points that slip at once; else None."""
    places = fault.interface.locations
    for nucleation in fault.nucleation:
        center = getattr(nucleation, "center", None)
        if isinstance(center, float | np.ndarray):
            return center
        added = np.abs(nucleation.shear_traction(places, model.case.duration))
        if added.any():
            return np.asarray(places[added >= added.max() * (1 - 1e-9)].mean(axis=0))
    return np.asarray(places[rest.slips].mean(axis=0)) if rest.slips.any() and not rest.slips.all() else None


def _rows_at(  # noqa: PLR0913
    model: System, fault: Fault, sides: Sides, rest: _AtRest, lengths: Breakdown | RateDependence | None, rate: float,
    point: int, spacing: float,
) -> Iterator[Row]:  # fmt: skip
    """Yield strength, S ratio, process zone and critical lengths at one point of a fault, of its slower side."""
    face, label = fault.interface, f"faults.{fault.name}"
    sigma, tau, peak = (float(values[point]) for values in (fault.normal_stress_0, rest.shear, rest.strength))
    where = f"at {'x' if face.line.measure == 'x' else 'position'} = {face.position[point]:.4g} m"
    if face.across is not None:
        where += f", dip = {face.across[point]:.4g} m"
    yield Row(f"{label}: initial stress", sigma, "Pa", f"shear {tau:.6g} Pa, {where}")
    speeds, modulus = WaveSpeeds(*sides.speeds()[point].tolist()), float(sides.softer()[point])
    if model.case.plane != "antiplane":
        modulus = fracture.effective_modulus(modulus, speeds.c_p, speeds.c_s)
    if fault.cohesion is not None:
        yield from _bond_rows(label, fault, point, sigma, modulus, spacing)
    if isinstance(lengths, RateDependence):
        yield from _rate_rows(label, _at(lengths, point), sigma, modulus, spacing, where)
        return
    yield Row(f"{label}: strength at rest", peak, "Pa", where)
    if lengths is None:
        yield Row(f"{label}: process zone", "none", "", f"{fault.friction.kind()} has no length of its own")
        return
    other, note = fault.friction.lengths(fault.normal_stress_0, 2 * rate), ""
    if isinstance(other, Breakdown) and np.any(other.energy != lengths.energy):
        note = f"over a drop of {_at(lengths, point).drop:.4g} Pa, at a slip rate of {rate:.3g} m/s: it depends on it"
    yield from _breakdown_rows(label, _at(lengths, point), tau, note, modulus, speeds, spacing, fault, model, where)


def _bond_rows(
    label: str, fault: Fault, point: int, sigma: float, modulus: float, spacing: float
) -> Iterator[Row]:  # fmt: skip
    """Yield strength and static process zones of a cohesive interface.

    The process zone is 9 pi / 16 G* G / strength^2, that of linear softening (Source: Palmer and Rice 1973).
    """
    law = fault.cohesion
    assert law is not None
    energies = {"I": (law.f_t, law.G_Ic), "II": (law.c, law.G_IIc)}
    for mode, values in energies.items():
        strength, energy = (float(np.broadcast_to(value, fault.normal_stress_0.shape)[point]) for value in values)
        if strength == 0:
            yield Row(f"{label}: cohesion, mode {mode}", "none", "", "no strength there")
            continue
        zone = 9 * np.pi / 16 * modulus * energy / strength**2
        yield Row(f"{label}: cohesion, process zone {mode}", zone, "m", "at rest; it shrinks as cracks get faster")
        yield _points_row(f"{label}: points in process zone", zone, spacing, 5)
        spring = fault.contact.stiffness()[0 if mode == "I" else 1]
        if spring:  # softer springs have no equilibrium beyond the strength: they release their energy at once
            ratio = spring * energy / (law.area * strength**2)
            note = "softening is the strength over the jump at failure; it must be softer than the springs"
            yield Row(f"{label}: springs / softening {mode}", ratio, "", note, "ok" if ratio > 1 else "warning")
    tension = float(np.broadcast_to(law.f_t, fault.normal_stress_0.shape)[point])
    if -sigma > tension > 0:
        yield Row(f"{label}: tension / strength", -sigma / tension, "", "it breaks in the first step", "warning")


def _chain(law: FrictionLaw) -> list[FrictionLaw]:
    """Return a law and the laws it contains, from the outermost in."""
    chain = [law]
    while hasattr(chain[-1], "law"):
        chain.append(chain[-1].law)
    return chain


def rows_without_effect(model: System, fault: Fault) -> Iterator[Row]:
    """Yield nucleations without effect, such as a patch off the interface, and profiles that do not vary on it."""
    value = model.placed[fault.name]
    position, places, label = fault.interface.position, fault.interface.locations, f"faults.{fault.name}"
    along = f"positions {position.min():.6g} to {position.max():.6g} m"
    law = next(part for _, part in value if isinstance(part, FrictionLaw)).at(places)  # not yet weakened
    for number, nucleation in enumerate(fault.nucleation):
        original, law = law, nucleation.weaken(law, places)
        if not _acts(nucleation, original, law, fault, model.case.duration):
            yield Row(
                f"{label}.nucleation.{number}", "no effect", "", f"{nucleation.kind()} with {_shown(nucleation)}: it "
                f"changes nothing within {model.case.duration:.6g} s at {along}; move it onto the interface", "error",
            )  # fmt: skip
    for key, profile in _profiles(value, label):
        values = evaluate(profile, places)
        if np.ptp(values) == 0:
            yield Row(key, values[0], "", f"at all {along}: {_shown(profile)} varies nowhere there", "warning")


def _acts(nucleation: Nucleation, original: FrictionLaw, weakened: FrictionLaw, fault: Fault, duration: float) -> bool:
    """Return whether a nucleation loads a point, or weakens the law of a point, within the duration."""
    position = fault.interface.locations
    normal = np.where(fault.normal_stress_0 > 0, fault.normal_stress_0, 1.0)
    shear = np.linalg.norm(fault.shear_traction_0, axis=1)

    def strengths(law: FrictionLaw, time: float) -> np.ndarray:
        state = law.advance(law.initial_state(normal, shear, 0 * normal), 0 * normal, normal, time)
        # Laws with a direct effect carry nothing at rest.
        return np.array([law.strength(rate + 0 * normal, normal, state) for rate in (0.0, 1e-9, 1.0)])

    times = np.linspace(0, duration, 21)
    if any(np.any(nucleation.shear_traction(position, time)) for time in times):
        return True
    return weakened is not original and any(np.any(strengths(original, t) != strengths(weakened, t)) for t in times)


def _profiles(part: Part, key: str) -> Iterator[tuple[str, Any]]:
    """Yield every profile of a part and of the parts in its tables, with its key; without those of nucleations."""
    for name, value in part:
        if callable(value):
            if not isinstance(value, Constant):
                yield f"{key}.{name}", value
        elif isinstance(value, Part):
            yield from _profiles(value, f"{key}.{name}")


def _shown(part: Part) -> str:
    """Return the numbers of a part as text, as they are given."""
    items = [(name, value) for name, value in part if name in part.model_fields_set]
    numbers = [f"{name} = {value:.6g}" for name, value in items if isinstance(value, float | int)]
    return ", ".join(numbers + [f"{name} = {{ {_shown(value)} }}" for name, value in items if isinstance(value, Part)])


def shortest_time(model: System, fault: Fault, dt: float) -> Iterator[Row]:
    """Yield the shortest time in which the law changes, against the time step.

    That is a length of the law over the expected slip rate, or the time in which a state relaxes by itself.
    """
    rate = max(_expected_slip_rate(model, fault, sides_of(model, fault.interface)), model.case.impact_speed)
    times = {}
    if rate > 0:
        for law in _chain(fault.friction):
            for name in type(law).model_fields:
                if unit_of(type(law), name) == "m":
                    times[f"{name} / V"] = float(np.min(getattr(law, name))) / rate
    times |= {f"relaxation of {name}": value for name, value in _relaxation_times(fault, dt).items()}
    if not times:
        return
    name, shortest = min(times.items(), key=lambda item: item[1])
    note = f"{name} at V = {rate:.3g} m/s" if name.endswith("V") else name
    long = shortest >= dt
    yield Row(
        f"faults.{fault.name}: shortest time", shortest, "s",
        note if long else f"{note}: shorter than the time step of {dt:.3g} s, which jumps over it; reduce "
        "mesh.element_size or stepper.time_step",
        "ok" if long else "warning",
    )  # fmt: skip


def _expected_slip_rate(model: System, fault: Fault, sides: Sides) -> float:
    """Return stress drop over impedance [m/s], largest of all points.

    It is the slip rate behind a front that radiates S waves into both bodies,
    V = (tau_0 - tau_r) (1 / (rho c_s)+ + 1 / (rho c_s)-), with the residual strength after 1 km of slip at 1 m/s.
    """
    face = fault.interface
    mobility = (sides.along[:, :, 1] / sides.moduli[:, :, 0, 0]).sum(axis=0)  # rho c_s is G / c_s
    normal, law, fast = fault.normal_stress_0, fault.friction, np.ones(len(face.plus))
    state = {name: value for name, value in fault.initial_state().items() if name in law.all_state_fields()}
    residual = law.strength(fast, normal, law.advance(state, fast, normal, 1e3))
    loaded = [np.linalg.norm(fault.driving_shear(time), axis=1) for time in (0.0, model.case.duration)]
    return float(np.max((np.maximum(*loaded) - residual) * mobility))


def _relaxation_times(fault: Fault, dt: float) -> dict[str, float]:
    """Return the relaxation time [s] of each state variable of the law at rest, if it relaxes."""
    law, normal, no_slip = fault.friction, fault.normal_stress_0, np.zeros(len(fault.normal_stress_0))
    state = {name: value for name, value in fault.initial_state().items() if name in law.all_state_fields()}
    later, relaxation_times = law.advance(state, no_slip, normal, dt), {}
    for name, value in state.items():
        step = 1e-6 * np.maximum(np.abs(value), 1e-3)
        slope = np.min((law.advance({**state, name: value + step}, no_slip, normal, dt)[name] - later[name]) / step)
        if slope < 1 - 1e-4:
            relaxation_times[name] = float(-dt / np.log(max(slope, 1e-12)))
    return relaxation_times


def _position_rows(model: System, fault: Fault) -> Iterator[Row]:
    """Yield the meaning of positions, and every patch and barrier of the case in positions and coordinates."""
    face, label = fault.interface, f"faults.{fault.name}"
    yield Row(f"{label}: position", _range(face.line.first, face.line.last), "m", face.line.meaning)
    if face.across is not None:
        dip = axes_of_positions(face)[1]  # of a rough surface not the mean of its tangents
        down = ", ".join(f"{value:.3g}" for value in np.round(dip / np.linalg.norm(dip), 3) + 0.0)
        note = f"down dip along ({down}), from the upper edge"
        yield Row(f"{label}: dip", _range(face.across.min(), face.across.max()), "m", note)
    for patch in patches(model.placed[fault.name], label):
        note = "along strike" if patch.center is not None else "a strip across the interface"
        if patch.down_dip:
            note = "down dip, a strip along strike"
        if face.points.shape[1] == 2:
            note = " to ".join(_coordinates(face, end) for end in patch.ends)
        yield Row(f"{label}: {patch.key.removeprefix(f'{label}.')}, {patch.kind}", _range(*patch.ends), "m", note)
    if face.across is not None:
        yield from surface_patch_rows(face, model.placed[fault.name], label)


def _range(*ends: float) -> str:
    return " to ".join(f"{end:.6g}" for end in ends)


def _coordinates(face: Interface, position: float) -> str:
    """Return the coordinates of a position on a 2D interface, as text."""
    slack = 1e-9 * face.line.length
    if not face.line.first - slack <= position <= face.line.last + slack:
        return "beyond the end"
    return "(" + ", ".join(f"{np.interp(position, face.position, x):.6g}" for x in face.points.T) + ")"


def _at(lengths: AnyLengths, point: int) -> AnyLengths:
    """Return the lengths at one point."""
    numbers = {field.name: np.asarray(getattr(lengths, field.name)) for field in fields(lengths)}
    return replace(lengths, **{name: float(value[point] if value.ndim else value) for name, value in numbers.items()})


def _breakdown_rows(  # noqa: PLR0913
    label: str,
    law: Breakdown,
    tau: float,
    note: str,
    modulus: float,
    speeds: WaveSpeeds,
    spacing: float,
    fault: Fault,
    model: System,
    where: str,
) -> Iterator[Row]:
    """Yield S ratio, critical lengths and process zone of laws that weaken with slip."""
    if law.drop <= 0:
        why = "does not weaken" if law.residual > 0 else "no strength at the start"
        yield Row(f"{label}: strength drop", law.drop, "Pa", f"{why}; {where}")
        return
    yield Row(f"{label}: fracture energy", law.energy, "J/m2", note)
    if tau > law.residual:
        ratio = law.seismic_ratio(tau)
        plane = model.case.plane
        verdict = "antiplane: never supershear"
        if plane != "antiplane":
            limit, source = SUPERSHEAR_LIMIT_3D, "about, in 3D: Dunham 2007"
            if plane != "solid":
                limit, source = fracture.supershear_limit(*speeds), "Burridge 1973; Andrews 1985"
            verdict = "may go supershear" if ratio < limit else "stays sub-Rayleigh"
            verdict += f" (limit {limit:.4g}, {source})"
        yield Row(f"{label}: S", ratio, "", f"{verdict}; {where}")
        critical = fracture.critical_half_length(law.energy, 2 * modulus, tau - law.residual)
        why = "Griffith, under the stress drop (Andrews 1976)"
        yield Row(f"{label}: critical half-length", critical, "m", f"{why}; {where}")
        nucleation = law.nucleation(modulus)
        why = "under slow loading (Uenishi and Rice 2003)"
        yield Row(f"{label}: nucleation half-length", nucleation, "m", f"{why}; {where}")
    zone = law.process_zone(modulus)
    yield Row(f"{label}: static process zone", zone, "m", f"shrinks as 1/A_II with rupture speed; {where}")
    yield _points_row(f"{label}: points in process zone", zone, spacing, 5)
    yield from (row_of(doubt) for doubt in slow_records(model, label, zone, speeds.c_R))
    stiffness = fault.contact.stiffness()[1]
    if stiffness and not note and law.drop > stiffness * law.slip:
        yield Row(
            f"{label}: softening / stiffness", law.drop / law.slip / stiffness, "", "above 1: strength falls faster "
            "with slip than the springs of the contact unload, so that slip jumps within a step; take a stiffer "
            "contact, split_node, or a longer slip weakening", "warning",
        )  # fmt: skip
    if "explicit" in model.case.stepper.time_schemes and not any(fault.contact.stiffness()) and model.viscosity is None:
        yield Row(
            f"{label}: damping", "none", "", "split nodes make grid noise behind a sharp front; "
            "damping.kelvin_voigt = { fraction = 0.2 } takes most of it away (Day et al. 2005)", "warning",
        )  # fmt: skip


def _rate_rows(
    label: str, law: RateDependence, sigma: float, modulus: float, spacing: float, where: str
) -> Iterator[Row]:
    """Yield critical stiffness and lengths of laws that depend on the slip rate."""
    if sigma <= 0:
        yield Row(f"{label}: L_b", "none", "", "the interface is open there")
        return
    weakens = law.weakening > 0
    verdict = "velocity weakening" if weakens else "velocity strengthening: stable"
    yield Row(f"{label}: b - a", law.weakening / sigma, "", f"{verdict}; {where}")
    zone = law.process_zone(modulus)
    yield Row(f"{label}: L_b", zone, "m", "G* D_c / (b sigma), the process zone (Dieterich 1992)")
    yield _points_row(f"{label}: points in L_b", zone, spacing, 3)
    if weakens:
        yield Row(f"{label}: k_c", law.critical_stiffness, "Pa/m", "critical stiffness (Ruina 1983)")
        yield Row(f"{label}: h*", law.wavelength(modulus), "m", "pi G* D_c / ((b - a) sigma), "
                  "wavelength that slides unstably (Rice and Ruina 1983)")  # fmt: skip
        half = law.nucleation(modulus)
        yield Row(f"{label}: nucleation half-length", half, "m", "ageing law, a/b > 0.5 (Rubin and Ampuero 2005)")


def _points_row(quantity: str, zone: float, spacing: float, enough: int) -> Row:
    points = zone / max(spacing, 1e-300)
    if points >= enough:
        return Row(quantity, points)
    return Row(quantity, points, "", f"too few: {enough} or more resolve a front", "warning")
