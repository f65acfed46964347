"""Fronts and precursors of a block on a rigid base, started by slow loading alone.

The demos `sheared_block` and `pushed_block`. Static friction is 0.6, 0.5 or 0.55 at random, velocity weakening has a
length. Published of PMMA blocks, in words: fronts run the faster the larger the shear over normal stress they run into;
slow, sub-Rayleigh and supershear ones; first slip where that ratio peaks (Ben-David, Cohen and Fineberg 2010); a block
pushed at its edge has precursors, whose length grows with the force (Rubinstein et al. 2011).

The chain is `spring_block` with the stiffness of the block: E H / L of the slider, 3 G / H of the base (a bar whose
shear stress falls to zero over its height). Its contacts lose all of their force when they break and those of the block
less than half, and the bar has no height, over which the stress decays along it, too: forces are only expected within
a half.
"""

from __future__ import annotations

from functools import cache
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import spearmanr

from ruptfx.app.bench import Check
from ruptfx.case import Case, parse_case, read_case, read_toml
from ruptfx.lumped.spring_block import SpringBlock
from ruptfx.platform import fem
from ruptfx.results.analysis.slip_events import SlipEvent, slip_events, speed_against_ratio
from ruptfx.results.record import Record
from ruptfx.run.model import Model
from ruptfx.run.simulation import simulate

if TYPE_CHECKING:
    import xarray

SPEED, EDGE = "Ben-David et al. (2010)", "Rubinstein et al. (2011)"
SUPERSHEAR, SPRINGS = "Andrews (1976)", "chain of the same stiffness"
E, NU, RHO, LENGTH, HEIGHT = 2.6e9, 0.37, 1200.0, 0.2, 0.05  # of the block: Pa, 1, kg/m3, m, m
PRESSURE, STATIC, CELLS = 5e6, 0.545, 40  # Pa; mean coefficient, its relative deviation is SCATTER; cells of 5 mm
SCATTER = 0.076
FALLS, RISES = [7e6, 3e6], [3e6, 7e6]  # Pa, normal stress at the two ends
# m, under 4 MPa, twice those between two equal bodies, G* = E / 2 in plane stress: half-length at which slip runs
# away, 0.579 (2 G*) (2 L) / drop, and process zone at rest, (9 pi / 32) (2 G*) (2 L) / drop. Fronts accelerate over the
# former to both sides of where they begin; the latter is what a front has to see of the stress.
SPREAD, WINDOW = 12e-3, 18e-3
ORIGIN = 20e-3  # four cells of random strength; three draws gave 13 mm at most on elements of 10 mm, 18 mm on 5 mm
WHOLE = 0.95  # of the block
THRESHOLD = (STATIC + 1.77 * 0.3) / 2.77  # of tau / sigma, S = 1.77: no supershear fronts below it


@cache
def loaded(name: str, *changes: str) -> tuple[xarray.Dataset, list[SlipEvent]]:
    """Return the interface record of a demo with changes, and its events; the same on every rank."""
    case = read_case(str(files("ruptfx").joinpath(f"demos/{name}.toml")), [*changes, "output.figures=false"])
    assert isinstance(case, Case)
    comm = fem.MPI.COMM_WORLD
    with TemporaryDirectory() as folder:
        out = Path(comm.bcast(folder, root=0)) / "run"
        simulate(case, out, progress=False)
        with Record(out) as record:
            data = record.interface.load()
        comm.Barrier()
    return data, slip_events(data, case.output.rupture_threshold)


def linear(normal: list[float]) -> str:
    """Return the override of a normal stress that varies linearly along the block."""
    return f'faults.main.initial_stress.normal={{ kind = "table", positions = [0.0, {LENGTH}], values = {normal} }}'


def chain(seed: int = 1) -> SpringBlock:
    """Return the spring-block chain of the block, one metre deep, a block and a contact per cell."""
    return SpringBlock(
        blocks=CELLS, contacts=1, mass=RHO * LENGTH * HEIGHT, stiffness=E * HEIGHT / LENGTH,
        interface_ratio=3 * LENGTH**2 / (2 * (1 + NU) * HEIGHT**2 * CELLS), strength=STATIC * PRESSURE * LENGTH,
        scatter=SCATTER, delay=1e-3, damping=np.sqrt(E / (2 * (1 + NU) * RHO)) / HEIGHT,
        drive_stiffness=10 * E * HEIGHT / LENGTH, drive_speed=4e-4, large_events=1, duration=3.0, seed=seed,
    )  # fmt: skip


def first_slip(data: xarray.Dataset, beyond: float = 0.0) -> tuple[float, float]:
    """Return the position of first slip and that of the previous peak of tau / sigma [m]; x >= `beyond` only."""
    away = data.position.values >= beyond
    slid = (data.slip.values > 1e-9) & away
    record = int(np.argmax(slid.any(axis=1)))
    shear, normal = (data[name].values[record - 1] for name in ("shear_traction", "normal_stress"))
    x = data.position.values
    ratio = np.divide(shear, normal, out=np.full(len(x), -np.inf), where=away & (normal > 0))
    return float(x[np.argmax(np.where(slid[record], data.slip.values[record], 0.0))]), float(x[np.argmax(ratio)])


def speeds(runs: list[tuple[xarray.Dataset, list[SlipEvent]]]) -> tuple[np.ndarray, np.ndarray]:
    """Return shear over normal stress and front speed [m/s] in all windows of all events."""
    found = [
        np.array(speed_against_ratio(each, data.position.values, WINDOW, 2 * SPREAD))
        for data, events in runs for each in events
    ]  # fmt: skip
    ratio, speed = np.hstack(found)
    return ratio, speed


def record_lengths(events: list[SlipEvent]) -> tuple[np.ndarray, np.ndarray]:
    """Return force [N/m] and reach [m] of precursors that run farther than all before them."""
    force, reach = (np.array([getattr(each, name) for each in events]) for name in ("force", "reach"))
    longest = farther(reach)
    return force[longest], reach[longest]


def before_whole(events: list[SlipEvent]) -> list[SlipEvent]:
    """Return the precursors of the first slip of the whole block."""
    whole = [each.start for each in events if each.reach > WHOLE * LENGTH]
    return [each for each in events if each.start < min(whole, default=np.inf)]


def quarter_force(events: list[SlipEvent]) -> float:
    """Return the force at which precursors reach a quarter of the block [N/m]."""
    forces, lengths = record_lengths(before_whole(events))
    return float(np.interp(0.25 * LENGTH, lengths, forces))


def farther(reach: np.ndarray) -> np.ndarray:
    """Return which precursors run farther than all before them, as booleans."""
    return reach > np.append(0, np.maximum.accumulate(reach)[:-1])


def first_break(model: SpringBlock) -> float:
    """Return the force at the first contact failure of the chain, without scatter [N per metre of depth]."""
    springs, contacts = (model.blocks - 1) * model.stiffness, model.interface_ratio * model.stiffness
    stretch = model.strength / model.blocks / contacts
    return (springs * (1 - model.decay) + contacts) * stretch


def slipped(speed: float, size: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the slipped part of the block against the motion of its top [m], with velocity weakening alone.

    alpha_s = 0.1 s/m, which is V_w = 10 m/s, contact without springs, explicit steps; the first 2.3 MPa are given.
    """
    table = read_toml(Path(str(files("ruptfx").joinpath("demos/sheared_block.toml"))))
    del table["stop_when"]
    ramp, motion = 0.2e-3, 26e-6
    fault = table["faults"]["main"]
    fault["contact"] = {"kind": "split_node"}
    fault["initial_stress"] = {"normal": PRESSURE, "shear": 2.3e6}
    fault["friction"] = {"kind": "velocity_weakening", "mu_s": fault["friction"]["mu_s"], "mu_d": 0.3, "V_w": 10.0}
    table |= {"duration": motion / speed + 0.5 * ramp, "stepper": {"kind": "leapfrog"}}
    table["mesh"]["element_size"] = size
    table["boundaries"][1] |= {"velocity": speed, "ramp": ramp}
    table["damping"] = {"kelvin_voigt": {"fraction": 0.1}}
    case = parse_case(table)
    assert isinstance(case, Case)
    model = Model(case, fem.MPI.COMM_SELF)
    motion_of, state, part, moved = case.stepper.bind(model), model.initial_state(), [], []
    while state.time < case.duration:
        motion_of.step(state)
        if state.time > ramp:
            part.append(float(np.mean(state.faults["main"]["slip"] > 1e-8)))
            moved.append(speed * (state.time - 0.5 * ramp))
    return np.array(moved), np.array(part)


def run(fine: bool, comm: fem.MPI.Comm) -> list[Check]:
    """Run the benchmark; every rank returns the same checks."""
    del comm
    size = 5e-3 if fine else 10e-3
    runs = {
        name: [loaded("sheared_block", f"mesh.element_size={size}", f"faults.main.friction.mu_s.seed={seed}", *load)
               for seed in (1, 2, 3)]
        for name, load in (("even", ()), ("falls", (linear(FALLS),)), ("rises", (linear(RISES),)))
    }  # fmt: skip
    pushed = pushed_at(size, () if fine else ("duration=6.5",))
    every = [*runs["even"], *runs["falls"], *runs["rises"], pushed]
    checks = [*start_checks(runs), *speed_checks(every, fine), *edge_checks(pushed[1], fine), spread_check(size)]
    if fine:
        one, other = (quarter_force(loaded_at[1]) for loaded_at in (pushed, pushed_at(2 * size, ("duration=6.5",))))
        name = "pushed: a quarter of the length, force over that with elements twice as large"
        checks.append(Check(name, 1, one / other, 0.1, "1", "two meshes"))
    return checks


def pushed_at(size: float, changes: tuple[str, ...]) -> tuple[xarray.Dataset, list[SlipEvent]]:
    """Return record and events of `pushed_block` with elements of a size [m]."""
    return loaded("pushed_block", f"mesh.element_size={size}", "output.interface_steps=10", *changes)


def start_checks(runs: dict[str, list[tuple[xarray.Dataset, list[SlipEvent]]]]) -> list[Check]:
    """Return the checks of where slip begins."""
    corner = max(first_slip(data)[0] for data, _ in runs["even"])
    away = [abs(events[0].origin - first_slip(data, 0.1 * LENGTH)[1]) for data, events in runs["falls"]]
    peak = min(first_slip(data, 0.1 * LENGTH)[1] for data, _ in runs["falls"])
    return [
        Check("even normal stress: first slip from the trailing corner", 0.0, corner, 0.0, "m", SPEED),
        Check("it falls: peak of tau / sigma beyond the corner", 0.5 * LENGTH, peak, 0.0, "m", SPEED, "at least"),
        Check("it falls: the front starts from that peak", ORIGIN, max(away), 0.0, "m", SPEED, "at most"),
    ]


def speed_checks(runs: list[tuple[xarray.Dataset, list[SlipEvent]]], fine: bool) -> list[Check]:
    """Return the checks of front speed against tau / sigma."""
    ratio, speed = speeds(runs)
    attrs, order = runs[0][0].attrs, spearmanr(ratio, speed)
    fast, slow = speed > attrs["c_s"], speed < 0.5 * attrs["c_R"]
    above, below = (float(np.mean(fast[part])) for part in (ratio > THRESHOLD, ratio <= THRESHOLD))
    fewest = min(int(kind.sum()) for kind in (slow, ~slow & ~fast, fast))
    # Coarse runs have fewer windows, one or none of them slow.
    kinds = [Check("slow, sub-Rayleigh, supershear: windows of the rarest", 1, fewest, 0, "1", SPEED, "at least")]
    chance = 1e-3 if fine else 1e-2
    return [
        *kinds[: int(fine)],
        Check("speed and tau / sigma: rank correlation", 0, float(order.statistic), 0, "1", SPEED, "at least"),
        Check("speed and tau / sigma: chance of such an order", chance, float(order.pvalue), 0, "1", SPEED, "at most"),
        Check("supershear part where S > 1.77 over where S < 1.77", 1, below / above, 0, "1", SUPERSHEAR, "at most"),
    ]


def edge_checks(events: list[SlipEvent], fine: bool) -> list[Check]:
    """Return the checks of the precursors of `pushed_block`."""
    model = chain()
    data = model.run()
    through = np.flatnonzero(data.event_large.values.astype(bool))
    before = slice(0, int(through[0]) if len(through) else None)
    reach, force = (data[f"event_{name}"].values[before] for name in ("reach", "force"))
    longest = farther(reach)
    quarter_of_chain = float(np.interp(0.25 * model.blocks, reach[longest], force[longest]))
    precursors, whole = before_whole(events), [each for each in events if each.reach > WHOLE * LENGTH]
    order = spearmanr([each.force for each in precursors], [each.reach for each in precursors])
    begin, forces = max(each.begin for each in precursors), record_lengths(precursors)[0]
    first, over = forces[0] / first_break(model), quarter_force(events) / quarter_of_chain
    checks = [
        Check("pushed: precursors begin at the trailing edge", SPREAD, begin, 0, "m", EDGE, "at most"),
        Check("pushed: rank correlation of length and force", 0.5, float(order.statistic), 0, "1", EDGE, "at least"),
        Check("pushed: first precursor over the chain's first break, force", 1, first, 0.5, "1", SPRINGS),
        Check("pushed: a quarter of the length, force over the chain's", 1, over, 0.5, "1", SPRINGS),
    ]
    if fine:
        part = forces[0] / whole[0].force
        name = "pushed: first precursor over sliding of all, force"
        checks.append(Check(name, 0.5, part, 0, "1", EDGE, "at most"))
    return checks


def spread_check(size: float) -> Check:
    """Return the check that the slipped part follows the load, at two speeds."""
    one, two = (slipped(speed, size) for speed in (20e-3, 40e-3))
    motion = np.linspace(5e-6, 25e-6, 41)
    differs = float(np.abs(np.interp(motion, *one) - np.interp(motion, *two)).max())
    return Check("alpha_s = 0.1 s/m: slipped part at twice the speed", 0.0, differs, 0.1, "1", "follows the load")
