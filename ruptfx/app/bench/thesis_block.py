"""Onset of slip of a block with the numbers that a thesis prints: places, stresses, front speeds, effect of roughness.

The block of `demos/thesis_block.toml` (Zhao 2013, thesis, University of Toronto, chapter 4): 200 x 50 mm, elements of
2 mm, mu_s 0.85, mu_d 0.7, omega 0.1 m2/s2; rough interfaces have mu_s of 0.70 to 1.00, in classes of 0.05 with the
shares of a normal distribution (eq. 27). Printed: first slip at 81 mm from the middle when pressed unevenly, and at
-95 mm, after 1 ms of shearing, when pressed evenly. Speed and tilt of the press are not printed; the even press is
chosen so that slip begins after about that 1 ms.

The thesis damps bodies by the viscosity D_c = 2 h sqrt(E rho) = 7065 Pa s. The nearest key is `kelvin_voigt.eta` in all
of the body, D_c / E = 2.72 us: equal in uniaxial stress. Its elastic stress has Poisson's ratio in it, that of the
scheme has not.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.resources import files
from math import erf, sqrt
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import spearmanr

from ruptfx.app.bench import Check
from ruptfx.case import Case, read_case
from ruptfx.input.profiles import evaluate
from ruptfx.results.analysis.along_interface import body_stress
from ruptfx.results.analysis.asperities import first_slip
from ruptfx.run.simulation import simulate

if TYPE_CHECKING:
    from ruptfx.platform.fem import MPI
    from ruptfx.results.record import Record

Array = np.ndarray

SOURCE = "Zhao (2013), thesis"
SHEARED = 2e-3  # s, when shearing begins
CLASSES = [0.70, 0.75, 0.80, 0.85, 0.90, 0.95, 1.00]
P_SPEED = 1584.0  # m/s, printed
UNEVEN, EVEN = 1e-5 * P_SPEED, 1e-6 * P_SPEED  # m/s, of the top
PRESS = 0.87e-3  # m/s, of the even press: first slip after about 1 ms
SLIDES = 1 / 16  # of the speed of the top, above which a point slips
SHORT = ("duration=13e-3", "stages.2.duration=11e-3")  # until the first slip
DAMPED = (*SHORT, 'stages.2.damping={kelvin_voigt={eta=2.717e-6,bodies=["upper"]}}')
STEEPER = (*SHORT, 'stages.0.boundaries.0.profile={kind="table",positions=[-0.1,0.1],values=[1.8,0.2]}')


def shares() -> list[float]:
    """Return the share of every class: the integral of the density of eq. 27 over its 0.05, in percent."""
    bounds = [0.5 * (1 + erf(20 * (middle + side - 0.85) / sqrt(2))) for middle in CLASSES for side in (-0.025, 0.025)]
    return [100 * (after - before) for before, after in zip(bounds[::2], bounds[1::2], strict=True)]


def rough(seed: int, size: float = 2e-3) -> str:
    """Return the change of a case to a drawn roughness, one class for each element."""
    weights = [round(share, 3) for share in shares()]
    profile = f'{{kind="random_classes",values={CLASSES},weights={weights},cell={size},seed={seed}}}'
    return f"faults.main.friction.mu_s={profile}"


def block(*overrides: str, even: bool = False) -> Case:
    """Return the case, with a change to the even press and its slower shear."""
    changes = [
        "duration=3.8e-3", "stages.2.duration=1.8e-3", f"stages.0.boundaries.0.velocity=-{PRESS}",
        "stages.0.boundaries.0.profile=1.0", f"stages.2.boundaries.1.velocity={EVEN}", "output.bulk_interval=0.05e-3",
        "faults.main.initial_stress.normal=1e3",
    ]  # fmt: skip
    path = Path(str(files("ruptfx").joinpath("demos/thesis_block.toml")))
    case = read_case(path, [*(changes if even else []), "output.figures=false", *overrides])
    assert isinstance(case, Case)
    return case


@dataclass(frozen=True)
class Onset:
    """Onset of slip along the base, and the stresses in the block at chosen times.

    Attributes
    ----------
    position : ndarray, shape (points,)
        From the middle [m].
    static : ndarray, shape (points,)
        mu_s.
    arrival : ndarray, shape (points,)
        First slip after the start of shearing [s], NaN where there is none.
    times : list of float
        Of the stresses, after the start of shearing [s].
    stress : list of dict
        ``xx``, ``yy`` and ``xy`` [Pa], tension positive, shape (points,) each.
    """

    position: Array
    static: Array
    arrival: Array
    times: list[float]
    stress: list[dict[str, Array]]

    @classmethod
    def of(cls, case: Case, record: Record, fronts: tuple[float, ...] = (), times: tuple[float, ...] = ()) -> Onset:
        """Return the onset of a run, with the stresses at its first slip, when its left front is at places, and later.

        Parameters
        ----------
        fronts : tuple of float
            Places of the left front [m].
        times : tuple of float
            After the start of shearing [s].
        """
        data = record.interface.load()
        x = data.position.values
        speed = _speed_of_top(case)
        arrival = first_slip(data.time.values, data.slip_rate.values, SHEARED, SLIDES * speed) - SHEARED
        law = case.faults["main"].friction
        static = np.broadcast_to(evaluate(law.mu_s, x), x.shape)  # type: ignore[union-attr]
        moments = [float(np.nanmin(arrival)), *(float(np.interp(place, x, arrival)) for place in fronts), *times]
        pairs = [body_stress(record, SHEARED + moment) for moment in moments if np.isfinite(moment)]
        return cls(x, static, arrival, [at - SHEARED for at, _ in pairs], [stress for _, stress in pairs])

    @property
    def origin(self) -> float:
        """Place of the first slip [m]."""
        return float(self.position[np.nanargmin(self.arrival)])

    @property
    def begin(self) -> float:
        """Time of the first slip after the start of shearing [s]."""
        return float(np.nanmin(self.arrival))

    def edge_front(self, window: float = 6e-3) -> tuple[Array, Array]:
        """Return places [m] and speeds [m/s] of the front from the left corner, until others come first or as soon."""
        first = int(np.nanargmin(self.arrival[: len(self.arrival) // 4]))
        steps = np.diff(self.arrival[first:])
        last = first + (int(np.argmax(~(steps >= 0))) if (~(steps >= 0)).any() else len(steps))
        x, t = self.position[first : last + 1], self.arrival[first : last + 1]
        width = max(2, round(window / np.diff(self.position).mean()))
        places = 0.5 * (x[width:] + x[:-width])
        with np.errstate(divide="ignore"):
            speeds = (x[width:] - x[:-width]) / (t[width:] - t[:-width])
        alone = np.logical_and.accumulate(speeds < P_SPEED)
        return places[alone], speeds[alone]

    def delay(self, even: Onset) -> tuple[Array, Array]:
        """Return mu_s and the delay against a block of one mu_s [s], of the points that slip in both."""
        both = np.isfinite(self.arrival) & np.isfinite(even.arrival)
        return self.static[both], (self.arrival - even.arrival)[both]


def _speed_of_top(case: Case) -> float:
    """Return the speed of shearing [m/s]."""
    return max(boundary.largest_speed for boundary in case.stages[-1].boundaries or [])


LEFT_FRONT = (15e-3, -19e-3)  # m, where the thesis prints the stresses
# Of the mean compression between the fronts, at most: 1 without slip; runs that differ by rounding differ by 0.1.
KEPT = 0.75
LATER = (1.0e-3, 1.2e-3, 1.4e-3)  # s, when it prints those of the even press


def onset(case: Case, comm: MPI.Comm) -> Onset:
    """Run a case; every rank returns the same."""
    even = _speed_of_top(case) == EVEN
    with TemporaryDirectory() as folder:
        out = Path(comm.bcast(folder, root=0)) / "run"
        with simulate(case, out, comm, progress=False) as record:
            result = Onset.of(case, record, () if even else LEFT_FRONT, LATER if even else ())
        comm.Barrier()
    return result


def run(fine: bool, comm: MPI.Comm) -> list[Check]:
    """Run the benchmark; every rank returns the same checks."""
    size = () if fine else ("mesh.element_size=5e-3", "mesh.chamfer=5e-3")
    uneven, even = onset(block(*size), comm), onset(block(*size, even=True), comm)
    middle = np.abs(uneven.position) < 0.08
    checks = [
        Check("evenly pressed: first slip", -95e-3, even.origin, 5e-3, "m", SOURCE),
        Check("evenly pressed: first slip after the start of shearing, by choice of the press", 1e-3, even.begin,
              0.3e-3, "s", SOURCE),
        Check("unevenly pressed: sigma_xx in front of the first slip, largest", 0.0,
              float(np.nanmax(uneven.stress[0]["xx"][middle])), 0, "Pa", SOURCE, "at most"),
    ]  # fmt: skip
    if not fine:
        return checks
    roughs = {seed: onset(block(rough(seed), even=True), comm) for seed in (1, 2, 3)}
    uneven_rough = onset(block(rough(1)), comm)
    places, speeds = even.edge_front()
    others = {"steeper press": STEEPER, "damping of the thesis": DAMPED}
    correlations = [float(spearmanr(*each.delay(even)).statistic) for each in roughs.values()]
    return [
        *checks,
        Check("unevenly pressed: first slip", 81e-3, uneven.origin, 15e-3, "m", SOURCE),
        Check("unevenly pressed: mean sigma_xx between the fronts, left one at -19 mm, over that at the first slip",
              KEPT, relaxation(uneven), 0, "1", SOURCE, "at most"),
        Check("unevenly pressed: change of sigma_yy from the first slip on, over its mean", 0.1,
              _change(uneven, middle), 0, "1", SOURCE, "at most"),
        Check("unevenly pressed: left front from the first slip to -19 mm, mean speed", 100.0,
              (uneven.origin - LEFT_FRONT[1]) / (float(np.interp(LEFT_FRONT[1], uneven.position, uneven.arrival))
                                                 - uneven.begin), 0, "m/s", SOURCE, "at most"),
        Check("unevenly pressed, rough: first slip, time over that of even friction", 1.0,
              uneven_rough.begin / uneven.begin, 0.02, "1", SOURCE),
        Check("unevenly pressed, rough: first slip", uneven.origin, uneven_rough.origin, 5e-3, "m", SOURCE),
        *(Check(f"unevenly pressed, {name}: first slip", 81e-3, onset(block(*changes), comm).origin, 15e-3, "m", SOURCE)
          for name, changes in others.items()),
        Check("evenly pressed: front from the left corner, last over first speed", 2.0, speeds[-1] / speeds[0], 0, "1",
              SOURCE, "at least"),
        Check("evenly pressed: front from the left corner, largest speed over c_R", 0.3, np.max(speeds) / 820.0, 0, "1",
              SOURCE, "at most"),
        Check("evenly pressed: front from the left corner meets another one at", -75e-3, places[-1], 5e-3, "m", SOURCE),
        Check("evenly pressed: delay by roughness against mu_s, rank correlation: least of 3 draws", 0.0,
              min(correlations), 0, "1", SOURCE, "at least"),
    ]  # fmt: skip


def relaxation(onset: Onset) -> float:
    """Return the mean sigma_xx between the fronts, the left one at its last place, over the mean at the first slip.

    A mean, for behind the front points stick and slip in turn, and rounding decides between them: the largest value
    changes its sign with the number of ranks.
    """
    between = (onset.position > LEFT_FRONT[-1]) & (onset.position < onset.origin)
    first, last = (float(np.nanmean(onset.stress[number]["xx"][between])) for number in (0, -1))
    return last / first


def _change(found: Onset, where: Array) -> float:
    """Return the root mean square change of sigma_yy between the first and the last stresses over its mean."""
    first, last = found.stress[0]["yy"][where], found.stress[2]["yy"][where]
    return float(np.sqrt(np.nanmean((last - first) ** 2)) / abs(np.nanmean(first)))
