"""Onset of sliding: the force rises while all points stick, slip starts in several places, ramps and drops follow.

The demo `sliding_start`, a rough block that is pressed and sheared over another body with rate and state friction,
and what Di Bartolomeo et al. (ESDA2010-25247, Fig. 8 to 12) say of larger, smooth bodies with Coulomb friction: a first
drop below the strength at rest, at a ratio of the forces between 0.55 and 0.90; more than two zones that slide at once
before it; in a drop most of the interface slides, before and after it most sticks. That larger drops are followed by
longer ramps is not checked: it depends on the time that forces are averaged over.

Without its ends the stack of two blocks rises by k = 1 / (h_1 / G_1 + h_2 / G_2). What is missing are free ends, parts
that are open, and creep, as rate and state friction always slips. The first two are in the stiffness of the same bodies
in equilibrium, pressed alike and stuck; with the shear tau that a small motion of the top adds there, slip in the run
takes from the force, by reciprocity, the part (tau, slip rate) / (tau, speed of the top).
"""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import ruptfx
from benchmarks._stuck import added_shear_forces
from ruptfx.app.bench import Check, Outcome
from ruptfx.bodies.meshes.rough_plates import RoughPlates
from ruptfx.case import Case, read_case, read_toml
from ruptfx.interfaces.sliding.contact_states import SLIDING
from ruptfx.laws.materials.isotropic_elastic import IsotropicElastic
from ruptfx.platform import fem
from ruptfx.results.analysis.force_drops import averaged, drops
from ruptfx.results.record import Record
from ruptfx.run.simulation import simulate

WINDOW, DROP = 0.6e-6, 0.05  # s that forces are averaged over, and what counts as a drop, over the normal force
DEMO = Path(ruptfx.__file__).with_name("demos") / "sliding_start.toml"
MOTION = 1e-7  # m, of the top
SOURCE = "Di Bartolomeo et al. (2010), in words"


def run(fine: bool, comm: fem.MPI.Comm) -> Outcome:
    del fine
    case = read_case(DEMO, ["output.figures=false"])
    assert isinstance(case, Case)
    with TemporaryDirectory() as folder:
        out = Path(comm.bcast(folder, root=0)) / "run"
        simulate(case, out, progress=False)
        with Record(out) as record:
            table, data = record.forces.load(), record.interface.load()
        comm.Barrier()
    time, shear = table.time.values, table.shear_force.values
    sticking, sliding = table.sticking.values, table.sliding.values
    typical = float(np.median(table.normal_force.values))
    mean = averaged(time, shear, WINDOW)
    first, *others = drops(time, mean, DROP * typical)
    starts = np.cumsum([stage.duration for stage in case.stages])[1]
    ramp = (time > starts + 6e-6) & (sliding < 0.02) & (time < first.start)
    assert isinstance(case.mesh, RoughPlates)
    slope = float(np.polyfit(time[ramp], shear[ramp], 1)[0]) / case.impact_speed / case.mesh.upper.length
    before = (data.time.values > starts) & (data.time.values < first.start)
    slides = np.pad(data.contact.values[before] == SLIDING, ((0, 0), (1, 0)))
    zones = int(np.max(np.sum(np.diff(slides.astype(int), axis=1) == 1, axis=1)))
    within, past = ((time > a) & (time < b) for a, b in ((first.start, first.end), (first.end, first.end + 2e-6)))
    peak = int(np.argmin(np.abs(time - first.start)))
    ratio = float(mean[peak] / table.normal_force.values[peak])
    stiffness, shares = _stuck(comm)
    moment = (data.time.values > time[ramp][0]) & (data.time.values < time[ramp][-1])
    creep = np.polyfit(data.time.values[moment], data.slip.values[moment] @ shares, 1)[0] / case.impact_speed
    stack, source = _stack(case), "stack without ends"
    return Outcome([
        Check("slope while all sticks over the stack's", 1.0, slope / stack, 0.1, "1", source),
        Check("stiffness in equilibrium over the stack's", 1.0, stiffness / stack, 0.1, "1", source),
        Check("slope over the former, and creep", 1.0, slope / stiffness + creep, 0.01, "1", "elastic stiffness"),
        Check("first drop: ratio of the forces", 0.725, ratio, 0.175, "1", SOURCE),
        Check("zones that slide at once before it", 3.0, zones, 0.0, "1", SOURCE, "at least"),
        Check("sliding within it", 0.5, float(sliding[within].max()), 0.0, "1", SOURCE, "at least"),
        Check("sticking before it", 0.5, float(sticking[ramp].min()), 0.0, "1", SOURCE, "at least"),
        Check("sticking after it", 0.5, float(sticking[past].max()), 0.0, "1", SOURCE, "at least"),
        Check("drops that follow", 3.0, len(others), 0.0, "1", "ramps and drops follow each other", "at least"),
    ])  # fmt: skip


def _stuck(comm: fem.MPI.Comm) -> tuple[float, np.ndarray]:
    """Load the same bodies in equilibrium, pressed alike, with friction that is never overcome.

    Returns
    -------
    float
        Shear stress per motion of the top [Pa/m].
    ndarray, shape (points,)
        Part of every point in the shear force that the motion adds.
    """
    table = read_toml(DEMO)
    press, *_ = table["stages"]
    *_, down = press["boundaries"]
    way = down["velocity"] * press["duration"]
    added, case = added_shear_forces(table, way, ("upper.top", MOTION), (0.1, 0.25), comm)
    assert isinstance(case.mesh, RoughPlates)
    return float(added.sum()) / MOTION / case.mesh.upper.length, added / added.sum()


def _stack(case: Case) -> float:
    """Return the shear stress per motion of the top, of two wide layers [Pa/m]."""
    assert isinstance(case.mesh, RoughPlates)
    compliance = 0.0
    for name, plate in (("upper", case.mesh.upper), ("lower", case.mesh.lower)):
        material = case.materials[name]
        assert isinstance(material, IsotropicElastic)
        compliance += plate.height / (material.density * material.wave_speeds(case.plane).c_s ** 2)
    return 1 / compliance
