"""Granite is pressed with and without pressure on its sides: how strength and emission change, as in Zhao (2013).

The demo, on cells of 3 mm at 0 and 10 MPa; fine, on its own cells of 1.6 mm at six pressures. Before anything breaks
the specimen is as stiff as the same mesh without facets, as springs are compensated; there the platens are bonded.
Then, of the bands that were set before the first run: without pressure the stress falls at once behind its peak, at
10 MPa it goes on to a fifth more; with pressure the first peak grows, and tensile events become shear; the fractal
dimension is that of points in a plane; events are the same to the bit on two ranks. Numbers that cells of 3 mm are too
coarse for (there the first peak grows by 12.7 times the pressure) are checked with `--fine` only: most events are
tensile without pressure, and fewer from pressure to pressure; the first peak grows by 5 to 12 times the pressure; b of
clusters is 0.7 to 1.4, with an error of 0.15 at most; the dimension without pressure is no more than 0.1 below the mean
of the others. That one does not come out: it is 1.30 in this draw, and 1.66 with pressure, where the specimen fails all
over before what is its first peak then. One draw of the minerals. What else does not come out is in the documentation
(granite).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np
import tomli_w

from benchmarks._broken import demo
from ruptfx import RuptfxError
from ruptfx.app.bench import Check, Outcome
from ruptfx.case import Case
from ruptfx.interfaces.cracks import CrackLaws
from ruptfx.laws.cohesion.linear import Linear
from ruptfx.laws.friction.coulomb import Coulomb
from ruptfx.platform import launch
from ruptfx.results.analysis.compression import Emission, Loading, emission_of, loading
from ruptfx.results.analysis.emission import BValue, FractalDimension
from ruptfx.results.record import Record
from ruptfx.run.model import Model
from ruptfx.run.recording.edge_sums import EdgeSums
from ruptfx.run.simulation import simulate

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from xarray import Dataset

    from ruptfx.platform.fem import MPI

SIZE = 3e-3  # m
DURATIONS = {0: 0.6e-3, 2: 0.75e-3, 4: 0.9e-3, 6: 1.1e-3, 8: 1.3e-3, 10: 1.5e-3}  # s, by the pressure in MPa
HARDENED = 3.4e-3  # s, nearly twice the strain of the first peak at 10 MPa on cells of 3 mm
LOADED = 80e-6  # s, in which waves pass the specimen four times
FALL, WITHIN = 0.7, 5e-4  # part of the first peak, and strain after it
SOURCE = "trend in Zhao (2013)"


@dataclass(frozen=True)
class Pressed:
    """One run: its loading curve, its emission, its largest unaccounted energy over the largest work, its events."""

    curve: Loading
    emission: Emission
    closure: float
    events: Dataset

    @property
    def peak(self) -> float:
        """First peak of the stress [Pa]."""
        return float(np.nan if self.curve.peak is None else self.curve.stress[self.curve.peak])

    @property
    def hardening(self) -> float:
        """Largest stress over the first peak."""
        return float(self.curve.stress.max()) / self.peak

    @property
    def left(self) -> float:
        """Smallest stress soon after the first peak, over that peak."""
        if self.curve.peak is None:
            return np.nan
        strain = self.curve.strain - self.curve.strain[self.curve.peak]
        return float(self.curve.stress[(strain >= 0) & (strain <= WITHIN)].min()) / self.peak


def under(pressure: int, size: float | None, duration: float | None = None) -> Case:
    """Return the demo under a pressure in MPa."""
    given = [f"boundaries.{i}.traction=[{sign * pressure * 1e6}, 0.0]" for i, sign in ((2, 1), (3, -1))]
    given += [f"duration={duration or DURATIONS[pressure]}", "output.figures=false"]
    return demo("granite", [*given, *([f"mesh.element_size={size}"] if size else [])])


def pressed(pressure: int, size: float | None, duration: float | None = None) -> Pressed:
    """Run the demo under a pressure in MPa."""
    with TemporaryDirectory() as folder:
        simulate(under(pressure, size, duration), Path(folder) / "run", progress=False)
        with Record(Path(folder) / "run") as record:
            curve = loading(record)
            assert curve is not None
            closure = float(np.abs(record.energy.closure).max())
            return Pressed(curve, emission_of(record), closure, record.events)


def unlike(one: Dataset, size: float) -> float:
    """Return how many columns of the events of one rank differ on 2, without pressure; NaN without events."""
    with TemporaryDirectory() as folder:
        path, out = Path(folder, "case.toml"), Path(folder, "run")
        path.write_text(tomli_w.dumps(under(0, size).table()), encoding="utf-8")
        if launch.run_on(2, ["run", str(path), "--out", str(out), "--quiet"]):
            raise RuptfxError("bench compression: granite did not run on 2 ranks")
        with Record(out) as two:
            if not one.sizes["event"]:
                return np.nan
            return float(sum(not values.identical(two.events[name]) for name, values in one.items()))


def stiffness(size: float) -> float:
    """Return the force of bonded facets over that of the same mesh without facets, at the same time."""
    case = demo("granite", [f"mesh.element_size={size}", f"duration={LOADED}"])
    assert case.fracture is not None
    never = CrackLaws(cohesion=Linear(f_t=1e12, c=1e12, G_Ic=1e6, G_IIc=1e6), friction=Coulomb(mu_d=0.5))
    whole = case.fracture.model_copy(update={"default": never, "pairs": {}})
    damped = case.damping.model_copy(update={"kelvin_voigt": None})
    broken, joined = (
        _mean_force(case.model_copy(update={"fracture": each, "damping": damped})) for each in (whole, None)
    )
    return broken / joined


def _mean_force(case: Case) -> float:
    """Return the mean force at both platens over the second half of the time [N/m]."""
    model = Model(case)
    motion, state = case.stepper.bind(model), model.initial_state()
    sums, forces = EdgeSums(model), []
    while state.time < case.duration:
        motion.step(state)
        if state.time > 0.5 * case.duration and state.step % 4 == 0:
            row = dict(zip(sums.columns, sums.row(state), strict=True))
            forces.append(row["steel.bottom.force_y"] - row["steel.top.force_y"])
    return float(np.mean(forces))


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    del comm
    hardened = pressed(10, SIZE, HARDENED)
    free = pressed(0, SIZE)
    found = {p: pressed(p, None) for p in DURATIONS} if fine else {0: free, 10: hardened}
    shares = [each.emission.shares for each in found.values()]
    tensile, shear = (np.array([each[mode] for each in shares]) for mode in ("tensile", "shear"))
    peaks = np.array([each.peak for each in found.values()])
    dimensions = [each.emission.of_events.D for each in found.values()]
    checks = [
        Check("stiffness over that without facets", 1.0, stiffness(SIZE), 0.03, "1", "compensated springs"),
        Check("tensile events at 10 MPa", 0.45, tensile[-1], 0.0, "1", SOURCE, "at most"),
        Check("fall of tensile events from 0 to 10 MPa", 0.25, tensile[0] - tensile[-1], 0.0, "1", SOURCE, "at least"),
        Check("shear events at 10 MPa", 0.35, shear[-1], 0.0, "1", SOURCE, "at least"),
        Check("smallest growth of the first peak from pressure to pressure", 0.0, float(np.diff(peaks).min()), 0.0,
              "Pa", SOURCE, "at least"),
        Check(f"stress left within {WITHIN:.2%} of strain after the peak, no pressure", FALL, found[0].left, 0.0, "1",
              SOURCE, "at most"),
        Check("largest stress over the first peak at 10 MPa, cells of 3 mm", 1.2, hardened.hardening, 0.0, "1", SOURCE,
              "at least"),
        *(Check(f"fractal dimension at {p} MPa", 1.5, D.D if isinstance(D, FractalDimension) else np.nan, 0.4, "1",
                SOURCE) for p, D in zip(found, dimensions, strict=True)),
        Check("energy closure", 0.0, max(each.closure for each in found.values()), 1e-10, "1", "exact"),
        Check("columns of the events that differ on 1 and 2 ranks", 0.0, unlike(free.events, SIZE), 0.0, "1", "exact"),
    ]  # fmt: skip
    return Outcome(checks + (_of_the_thesis(found, tensile, shear, peaks) if fine else []), lambda: _draw(found))


def _of_the_thesis(found: dict[int, Pressed], tensile: np.ndarray, shear: np.ndarray, peaks: np.ndarray) -> list[Check]:
    """Return the checks that need cells finer than 3 mm."""
    to_six = slice(None, list(found).index(6) + 1)
    exponents = [each.emission.of_clusters for each in found.values()]
    growth = (peaks[-1] - peaks[0]) / 10e6
    dimensions = [each.emission.of_events.D for each in found.values()]
    free, *under = (D.D if isinstance(D, FractalDimension) else np.nan for D in dimensions)
    return [
        Check("tensile events without pressure", 0.6, tensile[0], 0.0, "1", SOURCE, "at least"),
        Check("fall of tensile events from 0 to 6 MPa", 0.25, tensile[0] - tensile[to_six][-1], 0.0, "1", SOURCE,
              "at least"),
        Check("largest growth of tensile events from pressure to pressure to 6 MPa", 0.05,
              float(np.diff(tensile[to_six]).max()), 0.0, "1", SOURCE, "at most"),
        Check("largest fall of shear events from pressure to pressure to 6 MPa", 0.05,
              float(-np.diff(shear[to_six]).min()), 0.0, "1", SOURCE, "at most"),
        Check("growth of the first peak over that of the pressure", 8.5, growth, 3.5, "1", SOURCE),
        *(Check(f"b of clusters at {p} MPa", 1.05, b.b if isinstance(b, BValue) else np.nan, 0.35, "1", SOURCE)
          for p, b in zip(found, exponents, strict=True)),
        Check("fractal dimension without pressure beyond the mean of the others", 0.0, free - float(np.mean(under)),
              0.1, "1", SOURCE, "at least"),
        Check("largest error of b of clusters", 0.15,
              float(np.max([b.error if isinstance(b, BValue) else np.nan for b in exponents])), 0.0, "1",
              "scatter of such catalogues", "at most"),
    ]  # fmt: skip


def _draw(found: dict[int, Pressed]) -> Figure:
    from ruptfx.results.figure_style import new_figure

    figure, ((left, right),) = new_figure(1, 2, 3.0)
    for pressure, each in found.items():
        left.plot(100 * each.curve.strain, each.curve.stress / 1e6, lw=0.8, label=f"{pressure} MPa")
    left.set(xlabel="Strain (%)", ylabel="Axial stress (MPa)")
    left.legend(frameon=False, fontsize=7)
    for mode, colour in (("tensile", "C3"), ("shear", "C0"), ("mixed", "C4")):
        shares = [100 * each.emission.shares[mode] for each in found.values()]
        right.plot(list(found), shares, f"{colour}o-", label=mode)
    right.set(xlabel="Pressure on the sides (MPa)", ylabel="Events before the peak (%)", ylim=(0, 100))
    right.legend(frameon=False)
    return figure
