"""What a careful user computes by hand before the first time step: `ruptfx check`."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Literal, TypeVar

import numpy as np

from ruptfx import fem, parallel, stages
from ruptfx.analysis import fracture, rough_contact
from ruptfx.boundaries import Boundary, EdgeBoundary
from ruptfx.boundaries._history import Samples
from ruptfx.case import Case, FaultCase
from ruptfx.cost import available, counts, measured, need_memory, rehearse
from ruptfx.cracks import CrackLaws
from ruptfx.cracks._step import CrackStep
from ruptfx.cracks.on_strength import OnStrength
from ruptfx.fault import Fault
from ruptfx.friction import FrictionLaw
from ruptfx.friction._lengths import Breakdown, RateDependence
from ruptfx.inside import Inside
from ruptfx.interface import Interface
from ruptfx.loading import Loads
from ruptfx.materials import Material
from ruptfx.materials.isotropic_elastic import IsotropicElastic
from ruptfx.model import Model
from ruptfx.nucleation import Nucleation
from ruptfx.places import patches
from ruptfx.plausibility import Doubt, doubts, slow_records
from ruptfx.profiles.constant import Constant
from ruptfx.projection import TracedLaw
from ruptfx.schema import Part, unit_of
from ruptfx.sliding.interface import SlidingInterface
from ruptfx.sliding.roughness import Roughness, roughness
from ruptfx.spectrum import springs_of, stable_time_step
from ruptfx.steppers import Motion, leapfrog
from ruptfx.stopping import StopRules

NODES_PER_WAVELENGTH = 5
COARSER = 1.5  # of the spacing of nodes that carry points, over that of those they face
FAR_COARSER = 4.0  # of the spacing of nodes that are faced, over that of those that carry points
STEEP = 0.2
LONG_AFTER = 100  # times the run: where samples end that are hardly in seconds
STIFF = 1.5  # of the stable step without the springs of an interface over that with them
FEWEST_NODES = 8  # across a contact, and along the shortest wave of a surface
RESOLVED, LOST = 2.0, 0.2  # facets that a process zone of a crack should have, and must
LATE = 2.0  # facets that a wave may pass between two looks at the strength
SUPERSHEAR_LIMIT_3D = 1.19  # of S on an unbounded fault, Poisson's ratio 0.25 (Dunham 2007)


@dataclass(frozen=True)
class Row:
    """One line of the pre-flight table."""

    quantity: str
    value: float | str
    unit: str = ""
    note: str = ""
    verdict: Literal["ok", "warning", "error"] = "ok"

    @property
    def text(self) -> str:
        return self.value if isinstance(self.value, str) else f"{self.value:.6g}"


def preflight(case: Case) -> Iterator[Row]:
    """Rows of the table; builds the model on this rank.

    Raises
    ------
    RuptfxError
        Whatever a run would refuse.
    """
    started = time.process_time()
    need_memory(case, fem.MPI.COMM_WORLD)
    model = Model(case, fem.MPI.COMM_WORLD)
    motion = stages.bind(model)
    StopRules(model)
    built = time.process_time()
    yield Row("nodes", model.total_nodes, "", f"{model.components} components, order {case.order}")
    for name, material in zip(model.bodies.names, model.materials, strict=True):
        speeds = material.wave_speeds(case.plane)
        yield Row(f"{name}: c_p", speeds.c_p, "m/s", "plate speed c_l" if case.plane == "stress" else "")
        yield Row(f"{name}: c_s", speeds.c_s, "m/s", f"sqrt(2) c_s = {np.sqrt(2) * speeds.c_s:.6g}")
        yield Row(f"{name}: c_R", speeds.c_R, "m/s")
    own = [name for name in model.bodies.names if name in case.materials]
    if "default" in case.materials and len(own) == len(model.bodies.names):
        note = f"without effect, for every body has its own: {', '.join(own)}; remove it"
        yield Row("materials.default", case.materials["default"].kind(), "", note, "warning")
    if len(model.materials) > 1 and case.plane in ("stress", "strain") and model.faults:
        yield from _pairing(model)
    stable = stable_time_step(model)
    yield Row("stable time step", stable, "s", leapfrog.what_limits(model, stable))
    steps = None if case.stepper.adaptive else int(np.ceil(case.duration / motion.dt))
    if steps is None:
        yield Row("first time step", motion.dt, "s", f"steps vary over {case.duration:.6g} s")
    else:
        yield Row("time step", motion.dt, "s", f"{steps} steps for {case.duration:.6g} s")
    yield from _load_rows(case)
    for fault in model.faults:
        if len(fault.interface.plus):
            yield from _fault_rows(model, fault)
            if isinstance(fault.interface, SlidingInterface):
                ends = motion.ends if isinstance(motion, stages.Staged) else [(case.duration, model.loads)]
                yield from _sliding_rows(model, fault.name, fault.interface, ends)
                yield from _spring_rows(model, fault, stable)
                yield from _rough_rows(f"faults.{fault.name}", roughness(model, fault, ends))
            yield from _without_effect(model, fault)
            if steps is not None:
                yield from _shortest_time(model, fault, motion.dt)
    if case.instruments:
        yield from _instrument_rows(model, motion.dt)
    if model.cracks is not None:
        yield from _crack_rows(model, model.cracks, motion.dt)
    if model.collisions is not None:
        yield Row("collisions: cells that may meet", model.collisions.cells(), "",
                  f"of {model.mesh.topology.index_map(2).size_global}, at the start; every facet that fails adds two")
    yield from (_doubtful(doubt) for doubt in doubts(model))
    yield from _record_rows(case, steps)
    yield from _cost(model, motion, steps, started, built)


def _record_rows(case: Case, steps: int | None) -> Iterator[Row]:
    """Numbers of records and snapshots."""
    for what, number in zip(("interface", "bulk"), counts(case, steps), strict=True):
        interval, key = case.intervals[what], f"output.{what}_interval"
        note = f"every {interval:.6g} s, and at the end" if interval < case.duration else "of the end alone"
        if what == "interface":
            note = note.replace("of the end alone", "of the start and the end alone")
            every = case.output.interface_steps
            note += "" if every is None else f"; also every {every} steps" + ", not counted here" * (steps is None)
        yield Row(f"records: {what}", number, "", f"{note}; {key}")


def _crack_rows(model: Model, cracks: CrackStep, dt: float) -> Iterator[Row]:
    """Lengths of process zones, E G / strength^2, over that of facets, and what springs or late looks cost.

    Source: Hillerborg, Modéer and Petersson (1976).
    """
    fracture = cracks.fracture
    yield Row("fracture: facets", float(parallel.total(model.comm, cracks.owned.sum())), "", "mean length "
              f"{cracks.edge:.4g} m")  # fmt: skip
    young = {name: _young(material) for name, material in zip(model.bodies.names, model.materials, strict=True)}
    moduli = {"-".join(pair): min(young[name] for name in pair) for pair in fracture.laws_by_pair(model.bodies.names)}
    here = {"-".join(sorted(model.bodies.names[body] for body in pair)) for pair in cracks.network.pairs().tolist()}
    of_pairs = {"-".join(pair): laws for pair, laws in fracture.laws_by_pair(model.bodies.names).items()}
    of_pairs = {pair: laws for pair, laws in of_pairs.items() if pair in here}
    for pair, laws in (of_pairs | fracture.laws_of_joints(model.bodies.joints)).items():
        law = laws.cohesion
        if law is None:
            continue
        modulus = moduli.get(pair, min(young.values()))
        for mode, energy, strength in (("I", law.G_Ic, law.f_t), ("II", law.G_IIc, law.c)):
            zone = modulus * energy / strength**2
            cells = zone / cracks.edge
            fine, far = cells >= RESOLVED, cells < LOST and not fracture.unresolved
            yield Row(
                f"fracture {pair}: process zone {mode}", cells, "facets",
                f"{zone:.4g} m, E G / strength^2" if fine else
                f"below {RESOLVED:g}: strength and path depend on the mesh; refine it, or a larger "
                + f"G_{mode}c" + ("; or say that you know: fracture.unresolved = true" if far else ""),
                "ok" if fine else "error" if far else "warning",
            )  # fmt: skip
    yield from _loading(model, of_pairs)
    if isinstance(fracture, OnStrength):
        fastest = max(material.wave_speeds(model.case.plane).c_p for material in model.materials)
        way = fracture.check_every * dt * fastest / cracks.edge
        yield Row(
            "fracture: way of a wave between two looks at the strength", way, "facets",
            "" if way <= LATE else f"more than {LATE:g}: facets are inserted late; reduce fracture.check_every",
            "ok" if way <= LATE else "warning",
        )  # fmt: skip
        return
    for name, material, stiff in zip(model.bodies.names, model.materials, cracks.cell_materials, strict=True):
        stiffer = _young(stiff) / _young(material) - 1
        yield Row(
            f"fracture {name}: stiffness of cells", _young(stiff), "Pa",
            f"{stiffer:+.1%}, which the springs take off again" if stiffer else
            f"not compensated: the body is softer by about {_softer(model, cracks, material):.1%}",
            "ok" if stiffer else "warning",
        )  # fmt: skip


def _loading(model: Model, laws: Mapping[str, CrackLaws]) -> Iterator[Row]:
    """How often waves pass a body before what moves has loaded it to f_t: f_t / (rho c_p v) of the softer of a pair."""
    flying = [float(np.linalg.norm(velocity)) for velocity in model.case.initial_velocity.values()]
    speed = max(model.case.impact_speed, *flying, 0.0)
    impedance = {
        name: material.density * material.wave_speeds(model.case.plane).c_p
        for name, material in zip(model.bodies.names, model.materials, strict=True)
    }
    waves = [
        each.cohesion.f_t / (speed * min(impedance[name] for name in pair.split("-")))
        for pair, each in laws.items() if speed and each.cohesion is not None
    ]  # fmt: skip
    if waves:
        yield Row(
            "fracture: passages of waves until f_t", min(waves), "", f"at {speed:.4g} m/s: "
            + ("the first wave alone reaches it" if min(waves) < 1 else "loading is slow where these are many"),
        )  # fmt: skip


def _young(material: Material) -> float:
    assert isinstance(material, IsotropicElastic)  # cracks have no others
    return material.young_modulus


def _softer(model: Model, cracks: CrackStep, material: Material) -> float:
    """Part of the plane modulus E' that springs cost, 1 - 1 / (1 + S E' / 2 k)."""
    assert isinstance(material, IsotropicElastic)
    lame, shear = material.lame(model.case.plane)
    modulus = 4 * shear * (lame + shear) / (lame + 2 * shear)
    stiffness = cracks.fracture.stiffness(material, model.case.plane, cracks.edge)
    return 1 - 1 / (1 + cracks.length_per_area * modulus / (2 * stiffness))


def _doubtful(doubt: Doubt) -> Row:
    return Row(doubt.quantity, doubt.value, doubt.unit, doubt.note, "ok" if doubt.likely_meant else "warning")


def generalized_rayleigh_speed(model: Model) -> float | None:
    """Speed of the interface wave of the first and last body without friction [m/s], None where there is none."""
    materials = [model.materials[0], model.materials[-1]]
    speeds = [material.wave_speeds(model.case.plane) for material in materials]
    moduli = [material.density * s.c_s**2 for material, s in zip(materials, speeds, strict=True)]
    return fracture.generalized_rayleigh_speed(speeds, moduli)


def _remembers(model: Model) -> bool:
    """Whether every fault has a memory of the normal stress."""
    return all("Pa" in fault.friction.all_state_fields().values() for fault in model.faults)


def _pairing(model: Model) -> Iterator[Row]:
    first, second = model.materials[0], model.materials[-1]
    if first == second:
        yield Row("generalized Rayleigh speed", first.wave_speeds(model.case.plane).c_R, "m/s", "identical bodies: c_R")
        return
    speed = generalized_rayleigh_speed(model)
    if speed is None:
        yield Row("generalized Rayleigh speed", "none", "", "Coulomb friction is well-posed for small coefficients")
    else:
        yield Row(
            "generalized Rayleigh speed", speed, "m/s",
            "exists: Coulomb friction is ill-posed at any coefficient; use normal-stress memory (prakash_clifton)",
            "ok" if _remembers(model) else "warning",
        )  # fmt: skip


def _load_rows(case: Case) -> Iterator[Row]:
    """Samples in time that boundaries follow: how many, and what of them the run sees."""
    given = [("boundaries", case.boundaries, case.duration)]
    if case.stages:
        given = [
            ("boundaries", case.boundaries, stage.duration) if stage.boundaries is None else
            (f"stages.{number}.boundaries", stage.boundaries, stage.duration)
            for number, stage in enumerate(case.stages)
        ]  # fmt: skip
    for key, boundaries, end in given:
        for number, boundary in enumerate(boundaries):
            if boundary.samples is not None:
                yield _samples_row(f"{key}.{number}: samples", boundary, boundary.samples, end)


def _samples_row(quantity: str, boundary: Boundary, samples: Samples, end: float) -> Row:
    first, last = samples.times[0], samples.times[-1]
    low, high = samples.until(end)
    unit = "" if samples.unit == "1" else f" {samples.unit}"
    where = f"{boundary.kind()}, {boundary.edge}" if isinstance(boundary, EdgeBoundary) else boundary.kind()
    if samples.file:
        where += f", {samples.file}"
    note = f"{where}: {first:.4g} to {last:.4g} s; the run sees {low:.4g} to {high:.4g}{unit} in {end:.4g} s"
    if last > LONG_AFTER * end:
        note += f"; they end {last / end:.3g} times later than the run: are the times in SI units? A header such as " \
                "'time (us)' says so"
    elif first >= end:
        note += "; the run ends before the first: a longer duration, or earlier times"
    elif last < end * (1 - 1e-9) and not samples.held:
        note += "; they end before the run, and not at rest: more samples, or a shorter duration"
    else:
        return Row(quantity, len(samples.times), "", note)
    return Row(quantity, len(samples.times), "", note, "warning")


def _fault_rows(model: Model, fault: Fault) -> Iterator[Row]:
    """Strength, S ratio, process zone and critical lengths of one fault, at the nucleation and at its weakest place."""
    face, label = fault.interface, f"faults.{fault.name}"
    spacing = float(np.max(np.diff(np.sort(face.position)), initial=0))
    yield Row(f"{label}: points", face.total, "", f"largest spacing {spacing:.4g} m")
    yield from _position_rows(model, fault)
    rest = _at_rest(fault)
    if any(material.lame(model.case.plane) is None for material in model.materials):
        yield Row(
            f"{label}: lengths and limits", "estimates", "",
            "formulas for isotropic bodies, with the wave speeds along x", "warning",
        )  # fmt: skip
    if rest.slips.any() and not isinstance(fault.friction.lengths(fault.normal_stress_0, 1.0), RateDependence):
        ratio = float(np.max(rest.shear[rest.slips] / np.maximum(rest.strength[rest.slips], 1e-300)))
        where = "everywhere" if rest.slips.all() else f"at {np.count_nonzero(rest.slips)} points"
        yield Row(f"{label}: shear / strength", ratio, "", f"it slips from the first step {where}", "warning")
    rate = max(_expected_slip_rate(model, fault), model.case.impact_speed) or 1.0
    lengths = fault.friction.lengths(fault.normal_stress_0, rate)
    start, weakest = _judged_points(model, fault, rest, lengths)
    found = {row.quantity: row for row in _rows_at(model, fault, rest, lengths, rate, start, spacing)}
    yield from found.values()
    if weakest == start:
        return
    for row in _rows_at(model, fault, rest, lengths, rate, weakest, spacing):
        same = found.get(row.quantity)
        if same is None or row.value != same.value:
            yield replace(row, quantity=row.quantity.replace(label, f"{label}, weakest place", 1))


@dataclass(frozen=True)
class _AtRest:
    """Shear stress and strength of the points of a fault before the first step [Pa], and which of them slip at once."""

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
    model: Model, fault: Fault, rest: _AtRest, lengths: Breakdown | RateDependence | None
) -> tuple[int, int]:
    """Numbers of the points at which a fault is judged, among those that do not slip at once, if there are any.

    The first is the nearest to the nucleation; without one it is the weakest, too. The weakest has the largest shear
    over strength, where strength depends on the slip rate the largest (b - a) sigma; of several the nearest to the
    nucleation or to the middle.
    """
    face = fault.interface
    begins = _nucleation_position(model, fault, rest)
    middle = 0.5 * (face.line.first + face.line.last) if begins is None else begins
    distance = np.abs(face.position - middle)
    allowed = ~rest.slips if not rest.slips.all() else np.ones(len(distance), dtype=bool)
    if isinstance(lengths, RateDependence):
        scores = [np.broadcast_to(lengths.weakening, distance.shape)]
    else:
        scores = [rest.shear / np.maximum(rest.strength, 1e-300), -rest.strength]
    best = allowed
    for score in scores:
        most = np.max(np.nan_to_num(score[best], nan=-np.inf))
        close = score >= most - 1e-9 * abs(most)
        best = best & (close if np.any(best & close) else True)  # numbers that overflow tell no point from another
    weakest = int(np.argmin(np.where(best, distance, np.inf)))
    start = weakest if begins is None else int(np.argmin(np.where(allowed, distance, np.inf)))
    return start, weakest


def _nucleation_position(model: Model, fault: Fault, rest: _AtRest) -> float | None:
    """Position where a rupture is started [m]: the center of a nucleation, its largest load, or what slips at once."""
    position = fault.interface.position
    for nucleation in model.placed[fault.name].nucleation:
        center = getattr(nucleation, "center", None)
        if isinstance(center, float):
            return center
        added = np.abs(nucleation.shear_traction(position, model.case.duration))
        if added.any():
            return float(position[added >= added.max() * (1 - 1e-9)].mean())
    return float(position[rest.slips].mean()) if rest.slips.any() and not rest.slips.all() else None


def _rows_at(
    model: Model, fault: Fault, rest: _AtRest, lengths: Breakdown | RateDependence | None, rate: float, point: int,
    spacing: float,
) -> Iterator[Row]:  # fmt: skip
    """Strength, S ratio, process zone and critical lengths at one point of a fault."""
    face, label = fault.interface, f"faults.{fault.name}"
    sigma, tau, peak = (float(values[point]) for values in (fault.normal_stress_0, rest.shear, rest.strength))
    where = f"at {'x' if face.line.measure == 'x' else 'position'} = {face.position[point]:.4g} m"
    yield Row(f"{label}: initial stress", sigma, "Pa", f"shear {tau:.6g} Pa, {where}")
    slowest = min(model.materials, key=lambda m: m.wave_speeds(model.case.plane).c_s)
    speeds = slowest.wave_speeds(model.case.plane)
    modulus = slowest.density * speeds.c_s**2
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
    yield from _breakdown_rows(label, _at(lengths, point), tau, note, modulus, spacing, fault, model, where)


def _bond_rows(
    label: str, fault: Fault, point: int, sigma: float, modulus: float, spacing: float
) -> Iterator[Row]:  # fmt: skip
    """Where an interface is held together: tension it carries, and the zones in which it breaks at rest.

    9 pi / 16 G* G / strength^2, that of linear softening (Source: Palmer and Rice 1973).
    """
    law = fault.cohesion
    assert law is not None
    energies = {"I": (law.f_t, law.G_Ic), "II": (law.c, law.G_IIc)}
    for mode, given in energies.items():
        strength, energy = (float(np.broadcast_to(value, fault.normal_stress_0.shape)[point]) for value in given)
        if strength == 0:
            yield Row(f"{label}: bond, mode {mode}", "none", "", "nothing is held there")
            continue
        zone = 9 * np.pi / 16 * modulus * energy / strength**2
        yield Row(f"{label}: bond, process zone {mode}", zone, "m", "at rest; it shrinks as cracks get faster")
        yield _points_row(f"{label}: points in it", zone, spacing, 5)
    tension = float(np.broadcast_to(law.f_t, fault.normal_stress_0.shape)[point])
    if -sigma > tension > 0:
        yield Row(f"{label}: tension / strength", -sigma / tension, "", "it breaks in the first step", "warning")


def _chain(law: FrictionLaw) -> list[FrictionLaw]:
    """A law and those it holds, from the outermost in."""
    chain = [law]
    while hasattr(chain[-1], "law"):
        chain.append(chain[-1].law)
    return chain


def _without_effect(model: Model, fault: Fault) -> Iterator[Row]:
    """Nucleations that change nothing, such as a patch off the interface, and profiles that vary nowhere on it."""
    given: FaultCase = model.placed[fault.name]
    position, label = fault.interface.position, f"faults.{fault.name}"
    along = f"positions {position.min():.6g} to {position.max():.6g} m"
    law = given.friction.at(position)
    for number, nucleation in enumerate(given.nucleation):
        held, law = law, nucleation.weaken(law, position)
        if not _acts(nucleation, held, law, fault, model.case.duration):
            yield Row(
                f"{label}.nucleation.{number}", "no effect", "", f"{nucleation.kind()} with {_shown(nucleation)}: it "
                f"changes nothing within {model.case.duration:.6g} s at {along}; move it onto the interface", "error",
            )  # fmt: skip
    for key, profile in _profiles(given, label):
        values = profile(position)
        if np.ptp(values) == 0:
            yield Row(key, values[0], "", f"at all {along}: {_shown(profile)} varies nowhere there", "warning")


def _acts(nucleation: Nucleation, held: FrictionLaw, weakened: FrictionLaw, fault: Fault, duration: float) -> bool:
    """Whether a nucleation loads a point, or weakens the law of one that does not slip, within the duration."""
    position = fault.interface.position
    normal = np.where(fault.normal_stress_0 > 0, fault.normal_stress_0, 1.0)
    shear = np.linalg.norm(fault.shear_traction_0, axis=1)

    def strengths(law: FrictionLaw, time: float) -> np.ndarray:
        state = law.advance(law.initial_state(normal, shear, 0 * normal), 0 * normal, normal, time)
        # Laws with a direct effect carry nothing at rest.
        return np.array([law.strength(rate + 0 * normal, normal, state) for rate in (0.0, 1e-9, 1.0)])

    times = np.linspace(0, duration, 21)
    if any(np.any(nucleation.shear_traction(position, time)) for time in times):
        return True
    return weakened is not held and any(np.any(strengths(held, t) != strengths(weakened, t)) for t in times)


def _profiles(part: Part, key: str) -> Iterator[tuple[str, Any]]:
    """Every profile of a part and the parts it holds in tables, with its key; not those of nucleations."""
    for name, value in part:
        if callable(value):
            if not isinstance(value, Constant):
                yield f"{key}.{name}", value
        elif isinstance(value, Part):
            yield from _profiles(value, f"{key}.{name}")


def _shown(part: Part) -> str:
    """The numbers of a part as they are given."""
    given = [(name, value) for name, value in part if name in part.model_fields_set]
    numbers = [f"{name} = {value:.6g}" for name, value in given if isinstance(value, float | int)]
    return ", ".join(numbers + [f"{name} = {{ {_shown(value)} }}" for name, value in given if isinstance(value, Part)])


def _shortest_time(model: Model, fault: Fault, dt: float) -> Iterator[Row]:
    """The shortest time in which the law changes, against the time step.

    That is a length of the law over the expected slip rate, or the time in which a state relaxes by itself.
    """
    rate = max(_expected_slip_rate(model, fault), model.case.impact_speed)
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


def _expected_slip_rate(model: Model, fault: Fault) -> float:
    """Stress drop over impedance [m/s], largest of all points.

    It is the slip rate behind a front that radiates S waves into both bodies,
    V = (tau_0 - tau_r) (1 / (rho c_s)+ + 1 / (rho c_s)-), with the residual strength after 1 km of slip at 1 m/s.
    """
    face = fault.interface
    impedance = np.array([m.density * m.wave_speeds(model.case.plane).c_s for m in model.materials])
    mobility = 1 / impedance[model.layout.body[face.plus]]
    if face.other_side == "meshed":
        mobility = mobility + 1 / impedance[model.layout.body[face.minus]]
    elif face.other_side != "rigid":
        mobility = 2 * mobility
    normal, law, fast = fault.normal_stress_0, fault.friction, np.ones(len(face.plus))
    state = {name: value for name, value in fault.initial_state().items() if name in law.all_state_fields()}
    residual = law.strength(fast, normal, law.advance(state, fast, normal, 1e3))
    loaded = [np.linalg.norm(fault.driving_shear(time), axis=1) for time in (0.0, model.case.duration)]
    return float(np.max((np.maximum(*loaded) - residual) * mobility))


def _relaxation_times(fault: Fault, dt: float) -> dict[str, float]:
    """Time [s] in which each state of the law forgets a disturbance at rest; those that do not are left out."""
    law, normal, rest = fault.friction, fault.normal_stress_0, np.zeros(len(fault.normal_stress_0))
    state = {name: value for name, value in fault.initial_state().items() if name in law.all_state_fields()}
    later, found = law.advance(state, rest, normal, dt), {}
    for name, value in state.items():
        step = 1e-6 * np.maximum(np.abs(value), 1e-3)
        left = np.min((law.advance({**state, name: value + step}, rest, normal, dt)[name] - later[name]) / step)
        if left < 1 - 1e-4:
            found[name] = float(-dt / np.log(max(left, 1e-12)))
    return found


def _position_rows(model: Model, fault: Fault) -> Iterator[Row]:
    """What positions are, and every patch and barrier of the case in positions and coordinates."""
    face, label = fault.interface, f"faults.{fault.name}"
    yield Row(f"{label}: position", _range(face.line.first, face.line.last), "m", face.line.meaning)
    for patch in patches(model.placed[fault.name], label):
        note = "a strip across the interface"
        if face.points.shape[1] == 2:
            note = " to ".join(_coordinates(face, end) for end in patch.ends)
        yield Row(f"{label}: {patch.key.removeprefix(f'{label}.')}, {patch.kind}", _range(*patch.ends), "m", note)


def _sliding_rows(
    model: Model, name: str, face: SlidingInterface, stages_end: Sequence[tuple[float, Loads]]
) -> Iterator[Row]:
    """What the surfaces of an interface that slides are like, how far they reach, and how far edges drive them."""
    label = f"faults.{name}"
    sides = face.geometry.plus, face.geometry.minus
    ratio = sides[0].spacing / sides[1].spacing
    coarse = "; the finer side had better carry the points: swap plus and minus" if ratio > COARSER else ""
    if ratio < 1 / FAR_COARSER:
        coarse = f"; the facing side is {1 / ratio:.2g} times coarser: contacts shorter than its elements are not " \
                 "resolved, refine it"
    spacings = f"{sides[0].spacing:.4g} and {sides[1].spacing:.4g} m{coarse}"
    yield Row(f"{label}: spacing of nodes, plus / minus", ratio, "", spacings, "warning" if coarse else "ok")
    chord = sides[0].points[-1] - sides[0].points[0]
    along = chord / np.linalg.norm(chord)
    across = np.array([-along[1], along[0]])
    steps = np.concatenate([np.diff(side.points, axis=0) for side in sides])
    slope = float(np.max(np.abs(steps @ across) / np.maximum(steps @ along, 1e-300)))
    steep = "; strains and rotations must stay small: contact of steep flanks is less exact" if slope > STEEP else ""
    yield Row(f"{label}: largest slope", slope, "", f"of both surfaces{steep}", "warning" if steep else "ok")
    ends = sides[0].points[0] - sides[1].points[0], sides[1].points[-1] - sides[0].points[-1]
    margins = [0.0 if abs(end @ along) < 1e-9 * face.line.length else float(end @ along) for end in ends]
    driven = sum(_driven_slip(model, face, along, time, loads) for time, loads in stages_end)
    leaves = abs(driven) > max(0.0, margins[driven > 0])
    away = f", but edges drive it by {driven:.4g} m: make the body that it slides on longer" if leaves else ""
    yield Row(
        f"{label}: slip until an end leaves", max(0.0, min(margins)), "m",
        f"to -t {margins[0]:.4g}, to +t {margins[1]:.4g} m; what reaches over the end carries nothing{away}",
        "warning" if leaves else "ok",
    )  # fmt: skip
    ways = model.case.stepper.ways
    if "implicit" in ways:
        note = "one that slides farther is repeated in two"
        yield Row(f"{label}: largest slip of an implicit step", face.step_limit, "m", note)
    if "explicit" in ways and model.case.impact_speed > 0:
        yield Row(
            f"{label}: updates of what points face", model.case.impact_speed * model.case.duration / face.limit, "",
            f"one in {face.limit:.3g} m of slip, at {model.case.impact_speed:.4g} m/s from the beginning to the end",
        )  # fmt: skip


def _spring_rows(model: Model, fault: Fault, stable: float) -> Iterator[Row]:
    """Whether springs of an interface that slides are so stiff that bodies chatter on them."""
    ways, damping = model.case.stepper.ways, [stage.damping for stage in model.case.stages] + [model.case.damping]
    if "explicit" not in ways or not any(fault.contact.stiffness()):
        return
    others = [other for other in springs_of(model) if other.text != f"the contact stiffness of faults.{fault.name}"]
    without = stable_time_step(model, others)
    damped = any(each is not None and each.kelvin_voigt is not None for each in damping)
    chatters = without > STIFF * stable and not damped
    note = (
        "bodies that meet chatter on springs as stiff as these, which gain energy or lose it where they close or open "
        "within a step (impact in energy.csv): add damping.kelvin_voigt, reduce stepper.safety or the stiffness, or "
        "use contact.kind = 'forward_lagrange'"
    )
    yield Row(
        f"faults.{fault.name}: stable step without springs / with them", without / stable, "", note * chatters,
        "warning" if chatters else "ok",
    )  # fmt: skip


def _driven_slip(model: Model, face: SlidingInterface, along: np.ndarray, time: float, loads: Loads) -> float:
    """By how much driven edges move the plus side along the interface, and the minus side back, until a time [m]."""
    slip = 0.0
    for side, sign in ((face.geometry.plus, 1.0), (face.geometry.minus, -1.0)):
        if not len(side.nodes):  # a rigid base
            continue
        body = model.layout.body[side.nodes[0]]
        ways = np.zeros(2)
        for motion in loads.motions:
            way = np.broadcast_to(motion.displacement(time), motion.dofs.shape)
            for axis in (0, 1):
                there = (model.layout.body[motion.dofs // 2] == body) & (motion.dofs % 2 == axis)
                mean = float(way[there].mean()) if there.any() else 0.0
                ways[axis] = mean if abs(mean) > abs(ways[axis]) else ways[axis]
        slip += sign * float(ways @ along)
    return slip


def _rough_rows(label: str, found: Roughness | None) -> Iterator[Row]:
    """What theory says of the contact of rough surfaces, and whether nodes resolve that."""
    if found is None:
        return
    if found.shortest is not None:
        note = f"shortest wavelength {found.shortest:.4g} m"
        yield _nodes_row(f"{label}: nodes along the shortest wave", found.shortest / max(found.spacing), note)
    yield Row(f"{label}: E*", found.modulus, "Pa", "of the two bodies in contact")
    yield Row(f"{label}: root mean square slope", found.slope, "", "of the distance of the surfaces")
    if found.wave is not None:
        yield from _wave_rows(label, found, *found.wave)
    if found.pressure is None or found.pressure <= 0:
        why = "the motion of edges presses" if found.pressure is None else "nothing presses"
        yield Row(f"{label}: contact fraction", "not known", "", why)
    elif found.wave is None:
        touch = rough_contact.rough(found.pressure, found.modulus, found.slope)
        yield Row(f"{label}: contact fraction", touch.fraction, "", f"under {found.pressure:.4g} Pa (Persson 2001)")
        yield Row(f"{label}: mean pressure of contacts", touch.pressure, "Pa")


def _wave_rows(label: str, found: Roughness, amplitude: float, wavelength: float) -> Iterator[Row]:
    full = rough_contact.full_contact_pressure(found.modulus, amplitude, wavelength)
    note = f"full contact; the distance of the surfaces has an amplitude of {amplitude:.4g} m over {wavelength:.4g} m"
    yield Row(f"{label}: p*", full, "Pa", note)
    if found.pressure is None or found.pressure <= 0:
        return
    touch = rough_contact.waves(found.pressure, full)
    yield Row(f"{label}: contact fraction", touch.fraction, "", f"under {found.pressure:.4g} Pa (Westergaard 1939)")
    yield Row(f"{label}: peak pressure", touch.pressure, "Pa")
    width = touch.fraction * wavelength
    yield _nodes_row(f"{label}: nodes across one contact", width / found.spacing[0], f"width {width:.4g} m")


def _nodes_row(quantity: str, nodes: float, note: str) -> Row:
    if nodes > FEWEST_NODES - 0.01:
        return Row(quantity, nodes, "", note)
    return Row(quantity, nodes, "", f"{note}; too few, {FEWEST_NODES} or more resolve it", "warning")


def _range(*ends: float) -> str:
    return " to ".join(f"{end:.6g}" for end in ends)


def _coordinates(face: Interface, position: float) -> str:
    """Of a position on a 2D interface."""
    slack = 1e-9 * face.line.length
    if not face.line.first - slack <= position <= face.line.last + slack:
        return "beyond the end"
    return "(" + ", ".join(f"{np.interp(position, face.position, x):.6g}" for x in face.points.T) + ")"


AnyLengths = TypeVar("AnyLengths", Breakdown, RateDependence)


def _at(lengths: AnyLengths, point: int) -> AnyLengths:
    """The same at one point; what is not given by point is one number."""
    numbers = {field.name: np.asarray(getattr(lengths, field.name)) for field in fields(lengths)}
    return replace(lengths, **{name: float(value[point] if value.ndim else value) for name, value in numbers.items()})


def _breakdown_rows(
    label: str, law: Breakdown, tau: float, note: str, modulus: float, spacing: float, fault: Fault, model: Model,
    where: str,
) -> Iterator[Row]:
    """S, critical lengths and process zone, for laws that lose strength with slip."""
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
                limit, source = fracture.supershear_limit(*model.wave_speeds()), "Burridge 1973; Andrews 1985"
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
    yield _points_row(f"{label}: points in it", zone, spacing, 5)
    yield from (_doubtful(doubt) for doubt in slow_records(model, label, zone))
    stiffness = fault.contact.stiffness()[1]
    if stiffness and not note and law.drop > stiffness * law.slip:
        yield Row(
            f"{label}: softening / stiffness", law.drop / law.slip / stiffness, "", "above 1: strength falls faster "
            "with slip than the springs of the contact unload, so that slip jumps within a step; take a stiffer "
            "contact, split_node, or a longer slip weakening", "warning",
        )  # fmt: skip
    if "explicit" in model.case.stepper.ways and not any(fault.contact.stiffness()) and model.viscosity is None:
        yield Row(
            f"{label}: damping", "none", "", "split nodes make grid noise behind a sharp front; "
            "damping.kelvin_voigt = { fraction = 0.2 } takes most of it away (Day et al. 2005)", "warning",
        )  # fmt: skip


def _rate_rows(
    label: str, law: RateDependence, sigma: float, modulus: float, spacing: float, where: str
) -> Iterator[Row]:
    """Critical stiffness and lengths, for laws that change with the rate of slip."""
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


def _cost(model: Model, motion: Motion, steps: int | None, started: float, built: float) -> Iterator[Row]:
    """Memory, files and time of the whole command, from a rehearsal."""
    found, there = rehearse(model, motion, steps, started, built), available()
    if there is None or found.memory < there:
        yield Row("memory", found.memory / 1e6, "MB", "of one rank; more ranks share the mesh")
    else:
        note = f"{there / 1e6:.0f} MB are free here: take a larger mesh.element_size, or another machine"
        yield Row("memory", found.memory / 1e6, "MB", note, "error")
    if steps is None:
        yield Row("time of a step", found.step, "s", "processor time on one rank; how many there are is not known")
        return
    free = shutil.disk_usage(".").free
    smaller = ", before compression" * bool(model.case.output.bulk_compression)
    note = f"on disk, without checkpoints{smaller}; {free / 1e9:.3g} GB are free here"
    yield Row("files", found.disk / 1e6, "MB", note, "ok" if found.disk < free else "warning")
    parts = f"{steps} steps of {found.step:.3g} s, records and pictures; processor time on one rank"
    parts += "; stop_when may end it before" * (model.case.stop_when is not None)
    yield Row("expected run time", found.time, "s", parts)


def _instrument_rows(model: Model, dt: float) -> Iterator[Row]:
    """Up to which frequency each instrument sees, and what limits it."""
    speed = float(model.wave_speeds().c_s)
    for number, (instrument, channels) in enumerate(measured(model, dt)):
        often = 0.5 / instrument.interval
        highest = min(often, instrument.bandwidth or often)
        verdict: Literal["ok", "warning"] = "ok"
        notes = [f"{len(channels)} numbers every {instrument.interval:.3g} s, half of whose rate is {often:.3g} Hz"]
        if instrument.bandwidth is not None and instrument.bandwidth > often:
            notes.append(f"the bandwidth of {instrument.bandwidth:.3g} Hz passes more: reduce the interval")
            verdict = "warning"
        sizes = [Inside(model, point, body, f"instruments.{number}").element_size for point, body in instrument.points]
        if sizes:
            spacing = max(sizes) / model.case.order
            carried = speed / (NODES_PER_WAVELENGTH * spacing)
            notes.append(f"the mesh carries S waves to {carried:.3g} Hz, {NODES_PER_WAVELENGTH} nodes per wavelength")
            if 0 < instrument.extent < spacing:
                notes.append(f"shorter than the {spacing:.3g} m between nodes: as good as a point")
        yield Row(f"instruments.{instrument.name}: sees", highest, "Hz", "; ".join(notes), verdict)
