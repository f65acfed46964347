"""Onset of sliding of smooth bodies: the sliding test of a paper, on its nodes, and possible missing causes.

Di Bartolomeo et al. (ESDA2010-25247, section 4, Fig. 8 to 12): two bodies of 20 x 5 mm, of 5.3 and 3.392 GPa, bilinear
quadrilaterals, Coulomb friction, mu = 1, mass damping 10 1/s; they are pressed together, then the lower side of the
lower one moves by 93.5 mm/s. Not printed are the normal force, the time step and the parameter of the time integration,
how the upper side is held meanwhile, and the radius of the fine part of the mesh. Here the pressure is 5.3 MPa, with
which the first drop on coarse elements comes when theirs does, and the upper side stays where it is when the bodies
are pressed.

Checked are numbers that the paper prints or that follow from what it says: the first macro-slip at 0.5 ms; others at
about 1.1 and 1.7 ms; a ramp between these with 94 % sticking in its beginning, and more than half sliding in the drop
at its end; T that tends to N; the larger a drop, the longer the next ramp. Times are since the lower body moves.

Without `fine`: elements of 0.2 mm, as far as the first drop. With it: elements of 0.1 mm, those of the paper outside
of a circle in which it has smaller ones; nodes of the paper on the interface, 12.5 um apart within 1.5 mm of the centre
and 0.1 mm outside, for a shorter time (its small elements fill the circle; here columns go all the way up and down, and
rows grow by 1.15 beyond 0.2 mm from the interface); and one change at a time on elements of 0.2 mm, each with a row
that says whether there are macro-slips, and one whether T grows. Viscosity everywhere is what their time integration,
Newmark's with gamma = beta_2 between 1/2 and 1, has: (beta_2 - 1/2) dt over the modulus.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import meshio
import numpy as np
from numpy.typing import NDArray
from scipy.stats import spearmanr

from benchmarks._stuck import added_shear_forces
from ruptfx import Table
from ruptfx.app.bench import Check, Outcome
from ruptfx.case import Case, parse_case
from ruptfx.interfaces.sliding.contact_states import SLIDING
from ruptfx.platform import fem
from ruptfx.results.analysis.force_drops import Drop, averaged, drops
from ruptfx.results.record import Record
from ruptfx.run.simulation import simulate

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LENGTH, HEIGHT = 20e-3, 5e-3  # m
COARSE, FINE, RADIUS = 0.1e-3, 12.5e-6, 1.5e-3  # m; the last is not printed
FINE_ROWS, GROWTH = 0.2e-3, 1.15  # m: how far from the interface rows are as thin as columns
SPEED, DOWN = 93.5e-3, -0.113  # m/s, of the lower side, and of the upper one while it presses: 5.3 MPa, not printed
PRESSED = 0.2e-3  # s, pressing and holding
ONSET, PAPER, CHANGED, WHOLE = 0.7e-3, 0.49e-3, 1.5e-3, 1.9e-3  # s since the lower body moves
WINDOW, DROP = 8e-6, 0.05  # s that forces are averaged over, and what counts as a drop, over the normal force
ABRUPT = 0.25e-3  # s that a macro-slip may take: that of Fig. 11 is in zone V, between 1.65 and 1.9 ms
EARLY, LATE = (0.4e-3, 0.9e-3), (1.0e-3, 1.5e-3)  # s, where means of T/N are compared
RAMP = 10e-6  # s that parts of the length are averaged over
SOURCE = "Di Bartolomeo et al. (2010)"

Floats = NDArray[np.float64]


def run(fine: bool, comm: fem.MPI.Comm) -> Outcome:
    stiffness = _stiffness(comm)
    if not fine:
        return Outcome(_onset("elements of 0.2 mm", slide(case_table(ONSET, 2 * COARSE), comm), stiffness))
    runs = {what: slide(_changed(change), comm) for what, change in CAUSES.items()}
    paper = slide(case_table(PAPER) | {"stepper": {"kind": "leapfrog", "safety": 0.97}}, comm, paper=True)
    whole, usual = slide(case_table(WHOLE), comm), runs[UNCHANGED]
    name = "nodes of the paper"
    checks = [
        *_onset("elements of 0.2 mm", usual, stiffness), *_onset("elements of 0.1 mm", whole, stiffness),
        *_onset(name, paper, stiffness), *_first(name, paper), *_after(name, paper),
        *_first("elements of 0.1 mm", whole),
        *_sequence("elements of 0.1 mm", whole),
        *(check for what, slid in runs.items() for check in _back(what, slid)),
    ]  # fmt: skip
    rows = [paper.row(name), whole.row("elements of 0.1 mm"), *(slid.row(what) for what, slid in runs.items())]
    return Outcome(checks, lambda: _draw(paper, whole, runs), rows)


def _changed(change: Callable[[Table], None]) -> Table:
    """Return a whole run on elements of 0.2 mm with one thing changed."""
    table = case_table(CHANGED, 2 * COARSE)
    change(table)
    return table


def _onset(mesh: str, slid: Slid, stiffness: float) -> list[Check]:
    """Return the checks up to the first macro-slip."""
    return [
        Check(f"{mesh}: slope while all sticks over the stiffness", 1.0, slid.slope() / stiffness, 0.01, "1",
              "equilibrium"),
        Check(f"{mesh}: zones that slide at once before the first drop", 3.0, slid.zones(), 0.0, "1",
              f"{SOURCE}, Fig. 9: several", "at least"),
        Check(f"{mesh}: first drop", 0.5e-3, slid.first, 0.1e-3, "s", f"{SOURCE}; pressure chosen"),
    ]  # fmt: skip


def _first(mesh: str, slid: Slid) -> list[Check]:
    """Return the checks of the first macro-slip."""
    drop = slid.drops[0] if slid.drops else None
    ratio = slid.ratio(slid.first - 0.5 * WINDOW, slid.first + 0.5 * WINDOW)
    during = slid.within(drop.start, drop.end) if drop else slid.time < 0
    return [
        Check(f"{mesh}: T/N at the first drop", 0.725, ratio, 0.175, "1", "T < N in the paper; own band"),
        Check(f"{mesh}: duration of the first drop", ABRUPT, drop.end - drop.start if drop else np.nan, 0.0, "s",
              f"{SOURCE}: abrupt", "at most"),
        Check(f"{mesh}: sliding in the first drop", 0.5, float(slid.sliding[during].max(initial=0.0)), 0.0, "1",
              f"{SOURCE}, Fig. 12", "at least"),
    ]  # fmt: skip


def _after(mesh: str, slid: Slid) -> list[Check]:
    """Return the checks of the contact states at the end of a run that ends after a macro-slip."""
    row = slid.row(mesh)
    return [
        Check(f"{mesh}: sticking after {1e3 * slid.time[-1]:.2f} ms", 0.94, row["sticking_at_end"], 0.04, "1",
              f"{SOURCE}, Fig. 12, begin of a ramp"),
        Check(f"{mesh}: macro-slips until then", 1.0, len(slid.macro_slips), 0.0, "1", SOURCE, "at least"),
    ]  # fmt: skip


def _sequence(mesh: str, slid: Slid) -> list[Check]:
    """Return the checks of ramps and drops until 1.9 ms."""
    later = slid.time > (slid.drops[0].end if slid.drops else np.inf)
    sticks, slides = (averaged(slid.time, part, RAMP)[later] for part in (slid.sticking, slid.sliding))
    return [
        *_back(mesh, slid),
        Check(f"{mesh}: longest ramp after the first drop", 0.55e-3, max((d.ramp for d in slid.macro_slips[1:]),
              default=0.0), 0.0, "s", f"{SOURCE}, Fig. 11: from 1.1 to 1.65 ms", "at least"),
        Check(f"{mesh}: largest part that sticks after the first drop", 0.94, float(sticks.max(initial=0.0)), 0.02, "1",
              f"{SOURCE}, Fig. 12, begin of a ramp"),
        Check(f"{mesh}: largest part that slides after the first drop", 0.5, float(slides.max(initial=0.0)), 0.0, "1",
              f"{SOURCE}, Fig. 12, in a drop", "at least"),
        Check(f"{mesh}: rank correlation of drops and next ramps", 0.0, slid.order(), 0.0, "1",
              f"{SOURCE}: the larger, the longer", "at least"),
    ]  # fmt: skip


def _back(what: str, slid: Slid) -> list[Check]:
    """Return the checks that ramps and drops occur, and that T grows towards N."""
    published = sum(time < slid.time[-1] for time in (0.5e-3, 1.1e-3, 1.7e-3))
    growth = slid.ratio(*LATE) - slid.ratio(*EARLY)
    return [
        Check(
            f"{what}: macro-slips",
            float(published),
            len(slid.macro_slips),
            0.0,
            "1",
            f"{SOURCE}: 0.5, 1.1, 1.7 ms",
            "at least",
        ),
        Check(f"{what}: growth of mean T/N", 0.0, growth, 0.0, "1", f"{SOURCE}, Fig. 10: tends to 1", "at least"),
    ]


def case_table(duration: float, size: float = COARSE) -> Table:
    """Return the case: square elements, Coulomb friction, no viscosity.

    Parameters
    ----------
    duration : float
        Since the lower body moves [s].
    size : float
        Of the elements [m].
    """
    plate = {"length": LENGTH, "left": -0.5 * LENGTH, "height": HEIGHT, "element_size": size}
    still = 0.5 * PRESSED
    return {
        "title": "How smooth bodies begin to slide", "plane": "strain", "order": 1, "duration": PRESSED + duration,
        "mesh": {"kind": "rough_plates", "curve_order": 1, "upper": plate, "lower": dict(plate)},
        "materials": {"upper": _body(5.3e9), "lower": _body(3.392e9)},
        "faults": {"main": {
            "sliding": {}, "initial_stress": {"normal": 0.0}, "contact": {"kind": "forward_lagrange"},
            "friction": {"kind": "coulomb", "mu_d": 1.0},
        }},
        "output": {"figures": False, "interface_interval": 5e-6, "forces_interval": 1e-6},
        "stages": [
            {"duration": still, "damping": {"mass": 1e5}, "boundaries": _edges(0.0, DOWN)},
            {"duration": still, "damping": {"mass": 1e5}, "boundaries": _edges(0.0, 0.0)},
            {"duration": duration, "damping": {"mass": 10.0}, "boundaries": _edges(SPEED, 0.0)},
        ],
    }  # fmt: skip


def _body(young_modulus: float) -> Table:
    return {"kind": "isotropic_elastic", "young_modulus": young_modulus, "poisson_ratio": 0.25, "density": 1246.0}


def _edges(along: float, down: float) -> list[Table]:
    speeds = {"lower.bottom": (along, 0.0), "upper.top": (0.0, down)}
    return [
        {"kind": "driven", "edge": edge, "component": axis, "velocity": speed}
        | ({"ramp": 20e-6} if (edge, axis) == ("upper.top", "y") else {})
        for edge, both in speeds.items() for axis, speed in zip("xy", both, strict=True)
    ]  # fmt: skip


def use_nodes_of_the_paper(table: Table, folder: Path, comm: fem.MPI.Comm) -> None:
    """Write the mesh with the interface nodes of the paper, and use it in a case; collective."""
    path = folder / "paper.msh"
    if comm.rank == 0:
        meshio.write(path, _mesh(), file_format="gmsh22")
    comm.Barrier()
    sides = {"plus": "upper", "minus": "lower", "matching": False}
    table["mesh"] = {"kind": "gmsh_file", "file": str(path), "interfaces": {"main": sides}}


def _mesh() -> meshio.Mesh:
    half = _line(RADIUS, 0.5 * LENGTH)
    x, rows = np.concatenate([-half[:0:-1], half]), _line(FINE_ROWS, HEIGHT)
    points, cells = [], []
    lines: dict[str, list[NDArray[np.int64]]] = {"main": [], "upper.top": [], "lower.bottom": []}
    for shift, (y, surface, edge) in enumerate(((rows, 0, "upper.top"), (-rows[::-1], -1, "lower.bottom"))):
        number = np.arange(len(x) * len(y)).reshape(len(x), len(y)) + shift * len(x) * len(y)
        points.append(np.stack([*np.meshgrid(x, y, [0.0], indexing="ij")], axis=-1).reshape(-1, 3))
        corners = [number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]]
        cells.append(np.stack(corners, axis=-1).reshape(-1, 4))
        for name, row in (("main", surface), (edge, -1 - surface)):
            lines[name].append(np.stack([number[:-1, row], number[1:, row]], axis=1))
    along = {name: np.concatenate(parts) for name, parts in lines.items()}
    groups = [np.repeat([1, 2], [len(part) for part in cells]), np.repeat([1, 2, 3], list(map(len, along.values())))]
    return meshio.Mesh(
        np.concatenate(points), [("quad", np.concatenate(cells)), ("line", np.concatenate(list(along.values())))],
        cell_data={"gmsh:physical": groups, "gmsh:geometrical": groups},
        field_data={"upper": np.array([1, 2]), "lower": np.array([2, 2])}
        | {name: np.array([number, 1]) for number, name in enumerate(along, 1)},
    )  # fmt: skip


def _line(fine: float, end: float) -> Floats:
    """Return coordinates from zero, with fine, growing, and coarse spacings."""
    sizes = [FINE] * round(fine / FINE)
    while (size := sizes[-1] * GROWTH) < COARSE:
        sizes.append(size)
    rest = end - sum(sizes)
    count = int(np.ceil(rest / COARSE))
    return np.concatenate([[0.0], np.cumsum([*sizes, *[rest / count] * count])])


def _viscous(fraction: float, **more: float) -> Callable[[Table], None]:
    def change(table: Table) -> None:
        table["stages"][2]["damping"] = {"mass": 10.0, "kelvin_voigt": {"fraction": fraction, **more}}

    return change


def _fault(**keys: object) -> Callable[[Table], None]:
    return lambda table: table["faults"]["main"].update(keys)


UNCHANGED = "nothing changed"
CAUSES: dict[str, Callable[[Table], None]] = {
    UNCHANGED: lambda table: None,
    "viscosity everywhere, 3 % of a step": _viscous(0.03, thickness=HEIGHT),
    "viscosity everywhere, 10 % of a step": _viscous(0.1, thickness=HEIGHT),
    "viscosity everywhere, 50 % of a step": _viscous(0.5, thickness=HEIGHT),
    "viscosity next to the interface, 10 % of a step": _viscous(0.1),
    "friction falls from 1 to 0.8 over 0.1 m/s": _fault(
        friction={"kind": "velocity_weakening", "mu_s": 1.0, "mu_d": 0.8, "V_w": 0.1}
    ),
    "springs in contact, 2e13 Pa/m": _fault(contact={"kind": "compliant", "C_n": 2e13, "C_s": 2e13}),
}


@dataclass(frozen=True)
class Slid:
    """Result of a run; times count from the start of motion of the lower body.

    Attributes
    ----------
    time, normal, shear, mean : ndarray, shape (times,)
        Forces [N/m]; the last is the averaged shear force.
    sticking, sliding : ndarray, shape (times,)
        Parts of the length.
    states, state_time : ndarray
        Of the points, and when [s].
    drops : list of Drop
        Of the averaged force.
    """

    time: Floats
    normal: Floats
    shear: Floats
    mean: Floats
    sticking: Floats
    sliding: Floats
    states: NDArray[np.int64]
    state_time: Floats
    drops: list[Drop]

    @classmethod
    def read(cls, out: Path) -> Slid:
        """Read a run, also one that was stopped early."""
        with Record(out) as record:
            table, contact = record.forces.load(), record.interface.contact.load()
        time = table.time.values - PRESSED
        moves = time > 0
        normal, shear = (np.abs(table[name].values[moves]) for name in ("normal_force", "shear_force"))
        mean, ratio = averaged(time[moves], shear, WINDOW), DROP * float(np.median(normal))
        sticking, sliding = (table[name].values[moves] for name in ("sticking", "sliding"))
        return cls(
            time[moves], normal, shear, mean, sticking, sliding, contact.values, contact.time.values - PRESSED,
            drops(time[moves], mean, ratio),
        )  # fmt: skip

    @property
    def first(self) -> float:
        """Time at which the first macro-slip begins, abrupt or not [s]."""
        return self.drops[0].start if self.drops else np.nan

    @property
    def macro_slips(self) -> list[Drop]:
        """Abrupt drops."""
        return [drop for drop in self.drops if drop.end - drop.start < ABRUPT]

    def within(self, begin: float, end: float) -> NDArray[np.bool_]:
        """Return which records lie between two times, as booleans."""
        return (self.time > begin) & (self.time < end)

    def ratio(self, begin: float, end: float) -> float:
        """Return the mean of T/N between two times; NaN where the run is shorter."""
        part = self.within(begin, end)
        return float(np.mean(self.shear[part] / self.normal[part])) if end < self.time[-1] + 2e-6 else np.nan

    def slope(self) -> float:
        """Return the slope of shear force over motion of the lower side, after the initial waves [N/m per m]."""
        slides = np.flatnonzero(self.sliding > 0.02)
        part = self.within(20e-6, float(self.time[slides[0] if len(slides) else -1]))
        return float(np.polyfit(self.time[part], self.shear[part], 1)[0]) / SPEED if part.any() else np.nan

    def zones(self) -> int:
        """Return the largest number of zones that slide at once before the first macro-slip."""
        before = (self.state_time > 0) & ~(self.state_time >= self.first)
        slides = np.pad(self.states[before] == SLIDING, ((0, 0), (1, 0)))
        return int(np.max(np.sum(np.diff(slides.astype(int), axis=1) == 1, axis=1), initial=0))

    def order(self) -> float:
        """Return the rank correlation of macro-slips and the ramps after them; NaN with fewer than three pairs."""
        pairs = [(drop.size, after.ramp) for drop, after in zip(self.drops[:-1], self.drops[1:], strict=True)]
        return float(spearmanr(*zip(*pairs, strict=True)).statistic) if len(pairs) > 2 else np.nan

    def row(self, what: str) -> Table:
        """Return the summary of a tried cause; None where the run is too short or has no drop."""
        largest = max(self.drops, key=lambda drop: drop.size, default=Drop(np.nan, np.nan, 0.0, np.nan))
        typical, end = float(np.median(self.normal)), self.time > self.time[-1] - RAMP
        found = {
            "until": float(self.time[-1]), "pressure": typical / LENGTH, "first": self.first,
            "ratio_at_first": self.ratio(self.first - 0.5 * WINDOW, self.first + 0.5 * WINDOW),
            "largest_drop": largest.size / typical, "its_duration": largest.end - largest.start,
            "early_ratio": self.ratio(*EARLY), "late_ratio": self.ratio(*LATE),
            "sticking_at_end": float(self.sticking[end].mean()), "sliding_at_end": float(self.sliding[end].mean()),
        }  # fmt: skip
        counts = {"macro_slips": len(self.macro_slips), "drops": len(self.drops)}
        return {"tried": what, **counts, **{key: value if np.isfinite(value) else None for key, value in found.items()}}


def slide(table: Table, comm: fem.MPI.Comm, paper: bool = False) -> Slid:
    """Run a case; collective."""
    with TemporaryDirectory() as local:
        folder = Path(comm.bcast(local, root=0))
        if paper:
            use_nodes_of_the_paper(table, folder, comm)
        case = parse_case(table)
        assert isinstance(case, Case)
        simulate(case, folder / "run", progress=False)
        slid = Slid.read(folder / "run")
        comm.Barrier()
    return slid


def _stiffness(comm: fem.MPI.Comm) -> float:
    """Return shear force per motion of the lower side, of the same bodies in equilibrium, stuck [N/m per m]."""
    far = 1e-6
    table = case_table(ONSET, 2 * COARSE)
    added, _ = added_shear_forces(table, 0.5 * DOWN * PRESSED, ("lower.bottom", far), (0.25, 0.5), comm)
    return abs(float(added.sum())) / far


def _draw(paper: Slid, whole: Slid, runs: dict[str, Slid]) -> Figure:
    from ruptfx.results.figure_style import new_figure

    figure, axes = new_figure(2, 1, 6, sharex=True)
    above, below = axes[:, 0]
    above.plot(1e3 * whole.time, whole.shear / whole.normal, color="0.7", lw=0.6)
    for slid, name in ((whole, "elements of 0.1 mm"), (paper, "nodes of the paper")):
        above.plot(1e3 * slid.time, slid.mean / slid.normal, lw=0.8, label=name)
    for what in runs:
        below.plot(1e3 * runs[what].time, averaged(runs[what].time, runs[what].shear / runs[what].normal, 5 * WINDOW),
                   lw=0.8, label=what)  # fmt: skip
    for each in (above, below):
        each.set(ylabel="T/N", ylim=(0, 1.1))
        each.legend(frameon=False, loc="center right", bbox_to_anchor=(1, 0.36), fontsize="x-small")
    below.set(xlabel="Time since the lower body moves (ms)")
    return figure
