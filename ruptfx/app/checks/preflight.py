"""Pre-flight checks of a case: resolution, critical lengths, costs (`ruptfx check`)."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator
from typing import Literal

import numpy as np

from ruptfx.app.checks.data import data_rows
from ruptfx.app.checks.loads import load_rows
from ruptfx.app.checks.stress import stress_rows
from ruptfx.bodies.spectrum import stable_time_step
from ruptfx.case import Case
from ruptfx.input.schema import unit_of
from ruptfx.interfaces.faults.fault import Fault
from ruptfx.interfaces.faults.sides import sides_of
from ruptfx.interfaces.mechanisms.checks.plausibility import doubts, row_of
from ruptfx.interfaces.mechanisms.checks.table import Plan, Row
from ruptfx.laws import fracture
from ruptfx.platform import fem
from ruptfx.platform.memory import available
from ruptfx.run import stages
from ruptfx.run.cost import counts, measured, need_memory, rehearse
from ruptfx.run.model import Model
from ruptfx.stepping.implicit import preconditioners
from ruptfx.stepping.implicit.condensed import count_jumps
from ruptfx.stepping.implicit.iterated import PER_UNKNOWN
from ruptfx.stepping.implicit.loaded_bodies import matrix_bytes
from ruptfx.stepping.implicit.solvers import is_factorised
from ruptfx.stepping.implicit.strike_series import work_of
from ruptfx.stepping.implicit.surfaces import count_components
from ruptfx.stepping.steppers import Motion, leapfrog, local_leapfrog
from ruptfx.stepping.steppers.quasi_dynamic import QuasiDynamic, SeriesMotion
from ruptfx.stepping.stopping import StopRules

NODES_PER_WAVELENGTH = 5
WORTH_A_NOTE = 0.67  # part of the work of equal steps below which local time steps are proposed
ALIKE = 1e-9  # relative difference of moduli and wave speeds of bodies that count as identical


def preflight(case: Case) -> Iterator[Row]:
    """Yield the rows of the table; builds the model on this rank.

    Raises
    ------
    RuptfxError
        For all reasons for which a run would refuse the case.
    """
    started = time.process_time()
    need_memory(case, fem.MPI.COMM_WORLD)
    model = Model(case, fem.MPI.COMM_WORLD)
    yield from _work_rows(model)
    motion = stages.bind(model)
    StopRules(model, model.case.stop_when)
    built = time.process_time()
    if model.section is None:
        yield Row("nodes", model.total_nodes, "", f"{model.components} components, order {case.order}")
    yield from (Row(about, "", "", remark) for about, remark in case.mesh.remarks().items())
    for name, material in zip(model.bodies.names, model.materials, strict=True):
        speeds = material.wave_speeds(case.plane)
        yield from _variation_rows(model, name)
        yield Row(f"{name}: c_p", speeds.c_p, "m/s", "plate speed c_l" if case.plane == "stress" else "")
        note = f"sqrt(2) c_s = {np.sqrt(2) * speeds.c_s:.5g} m/s"
        if not material.isotropic and np.isfinite(free := material.mach_free_speed(case.plane)):
            note = f"no shear Mach front at v_c = {free:.5g} m/s"
        yield Row(f"{name}: c_s", speeds.c_s, "m/s", note)
        yield Row(f"{name}: c_R", speeds.c_R, "m/s")
    own = [name for name in model.bodies.names if name in case.materials]
    if "default" in case.materials and len(own) == len(model.bodies.names):
        note = f"without effect, for every body has its own: {', '.join(own)}; remove it"
        yield Row("materials.default", case.materials["default"].kind(), "", note, "warning")
    if case.plane in ("stress", "strain"):
        yield from (_pairing(model, fault) for fault in model.faults if fault.interface.elastic_sides)
    stable = stable_time_step(model)
    if isinstance(motion, SeriesMotion):
        yield from _along_strike_rows(model, motion)
    else:
        yield Row("stable time step", stable, "s", leapfrog.what_limits(model, stable))
    steps = None if case.stepper.adaptive else int(np.ceil(case.duration / motion.dt))
    if steps is None:
        yield Row("first time step", motion.dt, "s", f"steps vary over {case.duration:.6g} s")
    else:
        yield Row("time step", motion.dt, "s", f"{steps} steps for {case.duration:.6g} s")
    yield from _substep_rows(model, motion, stable)
    yield from load_rows(case)
    yield from stress_rows(model)
    plan = Plan(motion.dt, steps, stable, stages.loads_of(model, motion))
    for each in model.mechanisms:
        yield from each.check(plan)
    if case.instruments:
        yield from _instrument_rows(model, motion.dt)
    yield from _camera_rows(case)
    yield from data_rows(model)
    yield from (row_of(doubt) for doubt in doubts(model))
    yield from _record_rows(case, steps)
    yield from _cost(model, motion, steps, started, built)


def _substep_rows(model: Model, motion: Motion, stable: float) -> Iterator[Row]:
    """Yield what local time steps do, or would do in a case that has the same step for all elements."""
    if isinstance(motion, local_leapfrog.LocalMotion):
        clusters = motion.clusters
        note = f"in a step, of {clusters.share:.2g} of the elements: {clusters.work:.2g} of the work of equal steps"
        yield Row("substeps", clusters.substeps, "", note)
    elif isinstance(motion, leapfrog.LeapfrogMotion):
        clusters = local_leapfrog.possible(model, stable)
        if clusters.work < WORTH_A_NOTE:
            note = (
                f"the smallest elements, this part of all, make the run {1 / clusters.work:.2g} times longer; use "
                "stepper.kind = 'local_leapfrog'"
            )
            yield Row("elements that set the step", clusters.share, "", note)


def _work_rows(model: Model) -> Iterator[Row]:
    """Yield what the matrices of slip and traction will take, and levels of multigrid, before they are computed."""
    if model.section is None:
        yield from _level_rows(model)
        if isinstance(model.case.stepper, QuasiDynamic):
            yield Row("components of jumps", count_jumps(model), "", "each a solution of the bodies", early=True)
            yield Row("memory of their matrices", matrix_bytes(model), "B", "at most, on every rank", early=True)
            yield from _iteration_rows(model, count_jumps(model))
        elif model.case.stepper.time_schemes == ("implicit",) and (components := count_components(model)):
            yield Row("components of the surfaces", components, "", "each a solution of the bodies", early=True)
            yield from _iteration_rows(model, components)
        return
    along = model.section.mesh_table.along_strike
    assert along is not None
    work = work_of(model.section, [fault.name for fault in model.faults], along.points)
    key, components = "mesh.along_strike", 2 * work.points * along.points
    note = f"{work.points} points down dip, {along.points} along strike"
    yield Row(f"{key}: components of slip", components, "", note, early=True)
    yield Row(f"{key}: memory of the matrices", work.bytes, "B", "at most", early=True)
    note = f"{work.wavenumbers} wavenumbers, each a system of {work.unknowns} unknowns"
    yield Row(f"{key}: solutions of a wavenumber", work.columns, "", note, early=True)
    yield Row(f"{key}: time of the matrices", work.seconds, "s", "of one core; none where they are stored", early=True)


def _level_rows(model: Model) -> Iterator[Row]:
    """Yield the memory of the levels of multigrid, on which bodies of implicit steps are solved."""
    if "implicit" not in model.case.stepper.time_schemes:
        return
    kind = preconditioners.choose(model, getattr(model.case.stepper, "petsc_options", {}))
    for level in kind.sizes(model):
        note = f"of all ranks, estimated; {level.unknowns} unknowns"
        yield Row(f"multigrid: memory of order {level.order}", level.bytes, "B", note, early=True)


def _iteration_rows(model: Model, solutions: int) -> Iterator[Row]:
    """Yield the time of solutions of bodies that are too large to be factorised."""
    if not is_factorised(model):
        unknowns = model.total_nodes * model.components
        note = f"by iteration, of all ranks; {unknowns} unknowns are too many for factors"
        yield Row("time of the solutions", solutions * unknowns * PER_UNKNOWN, "s", note, early=True)


def _along_strike_rows(model: Model, motion: SeriesMotion) -> Iterator[Row]:
    """Yield the size of the section and of its matrices, and the distance of the images of the fault."""
    section, series = model.section, motion.series
    assert section is not None and section.mesh_table.along_strike is not None
    key, along = "mesh.along_strike", section.mesh_table.along_strike
    yield Row("nodes of the section", section.nodes, "", f"3 components, order {model.case.order}")
    note = f"{series.stored} of them were stored by earlier runs of these bodies"
    yield Row(f"{key}: wavenumbers", len(series.wavenumbers), "", note)
    opening = "with" if series.has_opening else "without"
    note = f"{series.size} points down dip, {opening} change of the normal stress; every product reads them all"
    yield Row(f"{key}: matrices", series.bytes, "B", note)
    gap, width = along.period - along.length, max(face.line.length for face in section.faces.values())
    if gap < width:
        note = f"less than {width:.4g} m down dip: the images change the stress on each other; increase period"
        yield Row(f"{key}: gap between images", gap, "m", note, "warning")
    else:
        state = f"creeps at {along.creep:.3g} m/s" if along.creep else "is locked"
        yield Row(f"{key}: gap between images", gap, "m", f"{state}; {width:.4g} m is the fault down dip")


def _variation_rows(model: Model, name: str) -> Iterator[Row]:
    """Yield the range of every parameter that varies in a body."""
    number, varying = model.bodies.names.index(name), model.variation
    if varying is None or not varying.varies(number):
        return
    values = varying.parameters(number, np.flatnonzero(model.bodies.cell_body == number))
    for key, each in values.items():
        note = f"it is {each.min():.6g} to {each.max():.6g} in the body; speeds below are those of the slowest S waves"
        unit = unit_of(type(model.given[number]), key.partition(".")[0])
        yield Row(f"{name}: {key} varies", float(each.mean()), unit, note)


def _camera_rows(case: Case) -> Iterator[Row]:
    """Yield the number of frames of each camera, and whether snapshots are as frequent."""
    for camera in case.cameras:
        interval, frames = case.intervals["bulk"], int((case.duration - camera.exposure) * camera.frame_rate) + 1
        note = f"one every {1 / camera.frame_rate:.3g} s, from snapshots every {interval:.3g} s"
        verdict: Literal["ok", "warning"] = "ok"
        if interval > 1.01 / camera.frame_rate:
            note += "; several between two snapshots: reduce output.bulk_interval"
            verdict = "warning"
        yield Row(f"cameras.{camera.name}: frames", max(frames, 0), "", note, verdict)


def _record_rows(case: Case, steps: int | None) -> Iterator[Row]:
    """Yield the numbers of records and snapshots."""
    for what, number in zip(("interface", "bulk"), counts(case, steps), strict=True):
        if what not in case.intervals:
            continue
        interval, key = case.intervals[what], f"output.{what}_interval"
        note = f"every {interval:.6g} s, and at the end" if interval < case.duration else "of the end alone"
        if what == "interface":
            note = note.replace("of the end alone", "of the start and the end alone")
            every = case.output.interface_steps
            note += "" if every is None else f"; also every {every} steps" + ", not counted here" * (steps is None)
        yield Row(f"records: {what}", number, "", f"{note}; {key}")


def _pairing(model: Model, fault: Fault) -> Row:
    """Return the speed of the interface wave of the bodies beside a fault without friction."""
    label, sides = f"faults.{fault.name}: generalized Rayleigh speed", sides_of(model, fault.interface)
    speeds, moduli = np.median(sides.along, axis=1), np.median(sides.moduli[:, :, 0, 0], axis=1)
    if np.allclose(speeds[0], speeds[1], rtol=ALIKE) and np.allclose(moduli[0], moduli[1], rtol=ALIKE):
        return Row(label, float(speeds[0, 2]), "m/s", "identical bodies: c_R")
    speed = fracture.generalized_rayleigh_speed([tuple(each) for each in speeds.tolist()], moduli.tolist())
    if speed is None:
        return Row(label, "none", "", "Coulomb friction is well-posed for small coefficients")
    # A state variable in units of stress is a memory of the normal stress.
    remembers = "Pa" in fault.friction.all_state_fields().values()
    return Row(
        label, speed, "m/s",
        "exists: Coulomb friction is ill-posed at any coefficient; use normal-stress memory (prakash_clifton)",
        "ok" if remembers else "warning",
    )  # fmt: skip


def _cost(model: Model, motion: Motion, steps: int | None, started: float, built: float) -> Iterator[Row]:
    """Yield memory, files and time of the whole command, from a rehearsal."""
    result, there = rehearse(model, motion, steps, started, built), available()
    if there is None or result.memory < there:
        yield Row("memory", result.memory / 1e6, "MB", "of one rank; more ranks share the mesh")
    else:
        note = f"{there / 1e6:.0f} MB are free here: take a larger mesh.element_size, or another machine"
        yield Row("memory", result.memory / 1e6, "MB", note, "error")
    if steps is None:
        yield Row("time of a step", result.step, "s", "processor time on one rank; how many there are is not known")
        return
    free = shutil.disk_usage(".").free
    smaller = ", before compression" * bool(model.case.output.bulk_compression)
    note = f"on disk, without checkpoints{smaller}; {free / 1e9:.3g} GB are free here"
    yield Row("files", result.disk / 1e6, "MB", note, "ok" if result.disk < free else "warning")
    parts = f"{steps} steps of {result.step:.3g} s, records and pictures; processor time on one rank"
    parts += "; stop_when may end it before" * (model.case.stop_when is not None)
    yield Row("expected run time", result.time, "s", parts)


def _instrument_rows(model: Model, dt: float) -> Iterator[Row]:
    """Yield the largest frequency that each instrument resolves, and the reason for the limit.

    What the mesh carries is that of the slowest S waves in the body of the instrument, through which they may come.
    """
    slowest = [material.wave_speeds(model.case.plane).c_s for material in model.materials]
    for number, (instrument, channels) in enumerate(measured(model, dt)):
        often = 0.5 / instrument.interval
        highest = min(often, instrument.bandwidth or often)
        verdict: Literal["ok", "warning"] = "ok"
        numbers = f"{len(channels)} number{'s' * (len(channels) > 1)}"
        notes = [f"{numbers} every {instrument.interval:.3g} s: Nyquist frequency {often:.3g} Hz"]
        if instrument.bandwidth is not None and instrument.bandwidth > often:
            notes.append(f"the bandwidth of {instrument.bandwidth:.3g} Hz passes more: reduce the interval")
            verdict = "warning"
        places = instrument.places(model, f"instruments.{number}")
        if places:
            spacing = max(place.element_size for place in places) / model.case.order
            carried = min(
                model.case.order * slowest[place.body] / (NODES_PER_WAVELENGTH * place.element_size) for place in places
            )
            notes += [place.note for place in places if place.note]
            notes.append(f"the mesh carries S waves to {carried:.3g} Hz, {NODES_PER_WAVELENGTH} nodes per wavelength")
            if 0 < instrument.extent < spacing:
                notes.append(f"shorter than the {spacing:.3g} m between nodes: it measures as at a point")
        yield Row(f"instruments.{instrument.name}: highest frequency", highest, "Hz", "; ".join(notes), verdict)
