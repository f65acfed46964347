"""Slip sequences of a block that is pushed at its edge at a height: lengths, places, drops, and the contact profile.

The block of `demos/slip_sequence.toml`: 140 x 75 x 6 mm of PMMA under 3.3 kN, pushed through a spring of 4 MN/m, the
printed stiffness of the machine (Rubinstein et al. 2011, sections 2.2 and 3, fig. 3 to 6, 12). The pusher acts on the
sides of one or two rows of elements, whose middle is the height. Friction, one draw of random strengths, is our choice.
Printed: events begin at the trailing edge, take 1 to 2 % of the force, and have the length l = L F_S / F_N up to 0.4 to
0.5 L at all heights; the profile of the contact area is kept by whole slides.

Studies under `--fine` vary one thing: a spring ten times as stiff, an even strength, elements half as large, and a
coefficient of sliding friction nearer to the static one.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np

from ruptfx.app.bench import Check
from ruptfx.case import Case, read_case
from ruptfx.results.analysis.slip_events import SlipEvent, slip_events, speed_against_ratio
from ruptfx.run.simulation import simulate

if TYPE_CHECKING:
    import xarray

    from ruptfx.platform.fem import MPI

Array = np.ndarray

SOURCE = "Rubinstein et al. (2011)"
WIDTH, MACHINE = 6e-3, 4e6  # m, N/m: width of the block and stiffness of the machine
C_R = 820.5  # m/s, of the block
SPEED, RAMP = 20e-6, 40.0  # m/s, s: of the far end of the machine
SLIDES, WHOLE = 2e-2, 0.97  # m/s; part of the length that a whole slide covers at least
SETTLING = 5e-3  # s after which waves of an event have died
AT_FORCE = 0.75  # of the force of the first whole slide: profiles are compared there
ROWS = {"2.1": (0, 1), "4.9": (0, 2), "7.0": (1, 2), "13.4": (2, 3)}  # height (mm): rows of elements that are pushed


def pushed(rows: tuple[int, int] = (0, 1), machine: float = MACHINE, overrides: tuple[str, ...] = ()) -> Case:
    """Return the case with the pusher on the rows of elements from the first to before the second number."""
    path = Path(str(files("ruptfx").joinpath("demos/slip_sequence.toml")))
    base = read_case(path, overrides)
    assert isinstance(base, Case)
    levels = np.unique(np.round(base.mesh.build().points[:, 1], 9))
    bottom, top = levels[list(rows)]
    spring = machine / WIDTH / (top - bottom)
    case = read_case(path, [
        *overrides, "output.figures=false", f"boundaries.1.normal={spring}",
        f"boundaries.2.traction=[{spring * SPEED * RAMP}, 0.0]", f"boundaries.2.ramp={RAMP}",
        *(f"boundaries.{number}.y_range=[{bottom}, {top}]" for number in (1, 2)),
    ])  # fmt: skip
    assert isinstance(case, Case)
    return case


@dataclass(frozen=True)
class Sequence:
    """Events and contact profiles of a run.

    Attributes
    ----------
    time : ndarray, shape (records,)
        [s]
    position : ndarray, shape (points,)
        From the pushed edge [m].
    area : ndarray, shape (records, points)
        Real contact area over the initial one, that is normal stress over the initial one.
    force : ndarray, shape (records,)
        Shear force of the interface over the normal force F_N.
    load : float
        F_N per depth [N/m].
    events : list of SlipEvent
    """

    time: Array
    position: Array
    area: Array
    force: Array
    load: float
    events: list[SlipEvent]

    @classmethod
    def of(cls, data: xarray.Dataset) -> Sequence:
        """Return the sequence of the record of an interface."""
        x, normal = data.position.values, data.normal_stress.values
        load = float(np.trapezoid(normal[0], x))
        force = np.trapezoid(data.shear_traction.values, x, axis=1) / load
        events = slip_events(data, SLIDES, settling=SETTLING)
        return cls(data.time.values, x, np.maximum(normal, 0.0) / normal[0], force, load, events)

    @property
    def length(self) -> float:
        """Length of the block L [m]."""
        return float(self.position[-1] - self.position[0])

    @property
    def slides(self) -> list[SlipEvent]:
        """Events that cover the whole block."""
        return [event for event in self.events if event.reach - event.begin > WHOLE * self.length]

    @property
    def precursors(self) -> list[SlipEvent]:
        """Events before the first whole slide; all if there is none."""
        first = next(iter(self.slides), None)
        return [event for event in self.events if first is None or event.start < first.start]

    @property
    def growing(self) -> list[SlipEvent]:
        """Precursors that are longer than all before."""
        reach = [event.reach for event in self.precursors]
        return [event for number, event in enumerate(self.precursors) if event.reach > max(reach[:number], default=0.0)]

    @property
    def extension(self) -> float:
        """Mean growth of the longest precursor with every further one, Delta l [m]; NaN for a single one."""
        count = len(self.precursors) - 1
        return (self.growing[-1].reach - self.growing[0].reach) / count if count > 0 else float("nan")

    def front_speeds(self) -> Array:
        """Return the speeds of the fronts of precursors in windows of 12 mm, from 6 mm beyond their origin [m/s]."""
        pairs = [speed_against_ratio(event, self.position, 12e-3, 6e-3) for event in self.precursors]
        return np.asarray(np.concatenate([speed for _, speed in pairs]))

    def at_force(self, share: float = AT_FORCE) -> Array:
        """Return the contact profile when the force first is a share of that of the first whole slide."""
        peak = self.slides[0].force / self.load if self.slides else float(self.force.max())
        return np.asarray(self.area[int(np.argmax(self.force >= share * peak))])

    def around(self, event: SlipEvent) -> tuple[Array, Array]:
        """Return the contact profiles before an event and after it, when its waves have died."""
        before = max(int(np.searchsorted(self.time, event.start)) - 1, 0)
        end = event.start + float(np.nanmax(event.arrival) - np.nanmin(event.arrival)) + 2 * SETTLING
        return self.area[before], self.area[min(int(np.searchsorted(self.time, end)), len(self.time) - 1)]


@dataclass(frozen=True)
class EdgeAsperity:
    """Raised part of a contact profile beside the pushed edge.

    Attributes
    ----------
    extent : float
        D: distance from the edge at which the area falls to the initial one [m]; NaN without a raised part.
    peak : float
        G: largest area within it over the initial one.
    least : float
        Smallest area in the half of the block next to the edge, beyond the peak.
    """

    extent: float
    peak: float
    least: float

    @classmethod
    def of(cls, position: Array, area: Array) -> EdgeAsperity:
        near = position - position[0] <= 0.5 * np.ptp(position)
        x, ratio = position[near] - position[0], area[near]
        top = int(ratio.argmax())
        below = np.flatnonzero(ratio[top:] < 1)
        if ratio[top] <= 1 or not len(below):
            return cls(float("nan"), float(ratio[top]), float(ratio[top:].min()))
        last = top + below[0]
        share = (ratio[last - 1] - 1) / (ratio[last - 1] - ratio[last])
        extent = float(x[last - 1] + share * (x[last] - x[last - 1]))
        return cls(extent, float(ratio[top]), float(ratio[top:].min()))


def sequence(case: Case, comm: MPI.Comm) -> Sequence:
    """Run a case; every rank returns the same."""
    with TemporaryDirectory() as folder:
        out = Path(comm.bcast(folder, root=0)) / "run"
        with simulate(case, out, comm, progress=False) as record:
            result = Sequence.of(record.interface.load())
        comm.Barrier()
    return result


UNTIL_SLIDE = ("stop_when.tip_beyond=0.137",)


def run(fine: bool, comm: MPI.Comm) -> list[Check]:
    """Run the benchmark; every rank returns the same checks."""
    size = () if fine else ("mesh.element_size=10e-3", "mesh.growth=1.0")
    base = sequence(pushed(overrides=size if fine else (*size, *UNTIL_SLIDE)), comm)
    stiff = sequence(pushed((0, 1), 10 * MACHINE, (*size, *UNTIL_SLIDE)), comm)
    origins = [np.median([event.origin for event in each.precursors]) for each in (base, stiff)]
    checks = [
        Check("machine of 4 MN/m: precursors begin at, median", 5e-3, origins[0], 0, "m", SOURCE, "at most"),
        Check(
            "machine ten times as stiff: precursors begin at, median", 10e-3, origins[1], 0, "m", "study", "at least"
        ),
        Check("precursors before the first whole slide", 3, len(base.precursors), 0, "1", SOURCE, "at least"),
    ]
    if not fine:
        return checks
    checks += [_drop("machine of 4 MN/m", base), _drop("machine ten times as stiff", stiff)]
    studies = {
        "even strength": ("faults.main.friction.mu_s=0.4",), "elements of 2.5 mm": ("mesh.element_size=2.5e-3",),
        "mu_d 0.3": ("faults.main.friction.mu_d=0.3",),
        # Half of the drop of friction over half of the length: the same length at which slip runs away.
        "mu_d 0.3 over 2 um": ("faults.main.friction.mu_d=0.3", "faults.main.friction.L=2e-6"),
    }  # fmt: skip
    rows = {"elements of 2.5 mm": (0, 2)}
    for name, changes in studies.items():
        other = sequence(pushed(rows.get(name, (0, 1)), overrides=(*changes, *UNTIL_SLIDE)), comm)
        origin = float(np.median([event.origin for event in other.precursors]))
        checks += [Check(f"{name}: precursors begin at, median", 5e-3, origin, 0, "m", SOURCE, "at most"),
                   _drop(name, other)]  # fmt: skip
    heights = {"2.1": base} | {
        name: sequence(pushed(ROWS[name], overrides=UNTIL_SLIDE), comm) for name in ROWS if name != "2.1"
    }
    speeds = np.concatenate([each.front_speeds() for each in heights.values()]) / C_R
    low, middle, high = np.percentile(speeds, [10, 50, 90])
    checks += [
        Check("all heights: speed of arrested fronts over c_R, median", 0.7, middle, 0.1, "1", SOURCE),
        Check("all heights: speed of arrested fronts over c_R, 10 % are below", 0.6, low, 0.1, "1", SOURCE),
        Check("all heights: speed of arrested fronts over c_R, 10 % are above", 0.8, high, 0.1, "1", SOURCE),
    ]
    return [*checks, *height_checks(heights), *memory_checks(base)]


def _drop(name: str, found: Sequence) -> Check:
    """Return the check of the median force drop of precursors, printed as 1 to 2 %."""
    drop = float(np.median([event.drop / event.force for event in found.precursors]))
    return Check(f"{name}: force drop of a precursor, median", 0.015, drop, 0.005, "1", SOURCE)


def line_of(heights: dict[str, Sequence]) -> tuple[float, float]:
    """Return the slope of l / L = slope F_S / F_N over all heights, and the largest relative distance from it.

    Of precursors that are longer than all before, up to l = 0.5 L, where the source sees the line end.
    """
    pairs = np.array([
        (event.force / each.load, event.reach / each.length)
        for each in heights.values() for event in each.growing if event.reach <= 0.5 * each.length
    ])  # fmt: skip
    slope = float((pairs[:, 0] @ pairs[:, 1]) / (pairs[:, 0] @ pairs[:, 0]))
    return slope, float(np.abs(pairs[:, 1] / (slope * pairs[:, 0]) - 1).max())


def height_checks(heights: dict[str, Sequence]) -> list[Check]:
    """Return the checks of what depends on the height of the push, and of what does not."""
    slope, spread = line_of(heights)
    shapes = {name: EdgeAsperity.of(each.position, each.at_force()) for name, each in heights.items()}
    low, high = heights["2.1"], heights["7.0"]
    higher = 7.04 / 2.13
    shorter = sum(len(each.precursors) - len(each.growing) for each in heights.values())
    return [
        # What slides carries mu_d of its load at least: l / L is at most F_S / (mu_d F_N).
        Check("all heights: slope of l/L over F_S/F_N", 5.0, slope, 0, "1", "mu_d = 0.2", "at most"),
        Check("all heights: largest relative distance from the line, l up to 0.5 L", 0.2, spread, 0, "1", SOURCE,
              "at most"),
        Check("all heights: precursors that are shorter than one before", 0, shorter, 0, "1", SOURCE),
        Check("first length l_0, 7.0 over 2.1 mm", higher, high.precursors[0].reach / low.precursors[0].reach, 0.3, "1",
              SOURCE, relative=True),
        Check("extension Delta l, 7.0 over 2.1 mm", higher, high.extension / low.extension, 0.3, "1", SOURCE,
              relative=True),
        *(Check(f"height {name} mm: extent D of the asperity", 0.5 * heights[name].length, shapes[name].extent, 0, "m",
                SOURCE, "at most") for name in ("2.1", "4.9", "7.0")),
        Check("extent D, 7.0 over 2.1 mm", higher, shapes["7.0"].extent / shapes["2.1"].extent, 0.3, "1", SOURCE,
              relative=True),
        *(Check(f"height {name} mm: peak G of the asperity over the initial area", 1.0, shape.peak, 0, "1", SOURCE,
                "at least") for name, shape in shapes.items()),
        Check("peak G of the asperity, 13.4 over 2.1 mm", 1.0, shapes["13.4"].peak / shapes["2.1"].peak, 0, "1", SOURCE,
              "at most"),
        Check("height 13.4 mm: precursors begin at, median, over the height", 1.0,
              float(np.median([event.origin for event in heights["13.4"].precursors])) / 13.4e-3, 0.5, "1", "study"),
    ]  # fmt: skip


def memory_checks(base: Sequence) -> list[Check]:
    """Return the checks of the contact profile before and after the second and third whole slide."""
    checks = []
    for number, event in list(enumerate(base.slides, 1))[1:3]:
        correlation = float(np.corrcoef(*base.around(event))[0, 1])
        what = f"whole slide {number}: correlation of the contact profile before and after it"
        checks.append(Check(what, 0.95, correlation, 0, "1", SOURCE, "at least"))
    return checks
