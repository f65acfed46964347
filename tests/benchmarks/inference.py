"""Intervals of an inference cover the truth as often as they say: 40 data sets with noise of other seeds.

Two problems. Gauges: linear slip weakening in plane stress, three rosettes 3.5 mm from the interface, with the unknowns
mu_s (strength drop), D_c and initial stress. Antiplane: rate and state friction and ten receivers, with the unknowns
D_c and initial stress. Data are those of the truth on the same mesh plus normal noise; there are no priors.

The estimate of a seed is found by the chord method: three steps of Gauss-Newton with the Jacobian of the truth, two of
them with the residuals of a run; the interval is that of Laplace's approximation with this Jacobian. The minimum of the
misfit differs from it to second order, by the change of the Jacobian. Whole inferences by `ruptfx.infer` from another
start, of the first seeds, must agree within half a standard deviation; with --fine they are made for all seeds, and
their own intervals are counted, too. Coverage is that of all numbers and seeds of a problem.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ruptfx import Table
from ruptfx.app.bench import Check, Outcome
from ruptfx.app.bench._rupture import elastic
from ruptfx.case import Case
from ruptfx.many_runs.adjoint.gradients import Objective
from ruptfx.many_runs.inference import posterior
from ruptfx.many_runs.inference.inversion import Inversion, infer

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ruptfx.platform.fem import MPI

SEEDS, WHOLE = 40, 2
NORMAL, MU_D = 6e6, 0.3
MU_S, D_C = "faults.main.friction.mu_s", "faults.main.friction.D_c"
SHEAR = "faults.main.initial_stress.shear"
SOURCE = "68 % of normal deviates"


def gauges() -> Table:
    """Return the problem of the demo infer_gauges with larger elements and a larger D_c."""
    grids = ("extension_1", "extension_2", "extension_3")
    times = np.arange(2e-6, 49e-6, 1e-6).tolist()
    return {
        "plane": "stress", "order": 4, "duration": 50e-6,
        "mesh": {"kind": "half_plate", "length": 60e-3, "height": 12e-3, "element_size": 2e-3},
        "materials": {"default": {"kind": "isotropic_elastic", "young_modulus": 5.65e9, "poisson_ratio": 0.33,
                                  "density": 1170.0}},
        "damping": {"kelvin_voigt": {"fraction": 0.2}},
        "faults": {"main": {
            "contact": {"kind": "split_node"}, "initial_stress": {"normal": NORMAL, "shear": 2.6e6},
            "friction": {"kind": "linear_slip_weakening", "mu_s": 0.6, "mu_d": MU_D, "D_c": 2e-6},
            "nucleation": {"kind": "forced_rupture", "center": 0.0, "radius": 20e-3, "speed": 800.0, "mu_d": MU_D,
                           "t_w": 5e-6},
        }},
        "boundaries": [{"kind": "absorbing", "edge": f"upper.{edge}"} for edge in ("left", "right", "top")],
        "instruments": [
            {"kind": "strain_gauge", "name": f"g{n}", "interval": 5e-7, "point": [x, 3.5e-3], "length": 1e-3,
             "angles": ["45 deg", "90 deg", "135 deg"], "bandwidth": 5e5} for n, x in enumerate((25e-3, 32e-3, 39e-3))
        ],
        "objective": [
            {"kind": "traces", "instrument": f"g{n}", "times": times, "sigma": 5e-6,
             "data": {name: [0.0] * len(times) for name in grids}, "units": dict.fromkeys(grids, "1")} for n in range(3)
        ],
        "unknowns": [
            {"key": MU_S, "shape": "number", "scale": "log", "bounds": [0.4, 1.5]},
            {"key": D_C, "shape": "number", "scale": "log", "bounds": [0.3e-6, 12e-6]},
            {"key": SHEAR, "shape": "number", "bounds": [2.2e6, 3.0e6]},
        ],
        "inference": {"method": "gauss_newton", "iterations": 30},
    }  # fmt: skip


def receivers() -> Table:
    """Return a rupture in antiplane with the ageing law, and ten receivers."""
    times = np.arange(0.1, 1.55, 0.05).tolist()
    return {
        "plane": "antiplane", "order": 4, "duration": 1.6, "positions": "x",
        "mesh": {"kind": "half_plate", "left": -5e3, "length": 10e3, "height": 2e3, "element_size": 500.0},
        "materials": {"default": elastic(6000.0, 3464.0, 2670.0)},
        "damping": {"kelvin_voigt": {"eta": 7e-4}},
        "faults": {"main": {
            "contact": {"kind": "split_node"}, "initial_stress": {"normal": 120e6, "shear": 75e6},
            "friction": {"kind": "rate_and_state_ageing", "a": 0.008, "b": 0.012, "D_c": 0.04, "f_0": 0.6, "V_0": 1e-6,
                         "V_initial": 1e-6},
            "nucleation": {"kind": "smooth_patch", "extra": 25e6, "center": 0.0, "radius": 3e3, "rise": 0.3},
        }},
        "boundaries": [{"kind": "absorbing", "edge": f"upper.{edge}"} for edge in ("left", "right", "top")],
        "instruments": [
            {"kind": "velocimeter", "name": f"r{n}", "interval": 0.02, "point": [-4.5e3 + 1e3 * n, 600.0],
             "direction": [1.0]} for n in range(10)
        ],
        "objective": [
            {"kind": "traces", "instrument": f"r{n}", "times": times, "sigma": 0.05,
             "data": {"velocity": [0.0] * len(times)}, "units": {"velocity": "m/s"}} for n in range(10)
        ],
        "unknowns": [
            {"key": D_C, "shape": "number", "scale": "log", "bounds": [1e-2, 0.2]},
            {"key": SHEAR, "shape": "number", "bounds": [65e6, 85e6]},
        ],
        "inference": {"method": "gauss_newton", "iterations": 30},
    }  # fmt: skip


class Realisations:
    """Estimates of a problem from data with noise of many seeds.

    Parameters
    ----------
    table : dict
        The true case, with data of any values.
    start : dict of str to float
        Values from which whole inferences begin, by key.
    whole : int
        Seeds of which whole inferences are made.
    comm : MPI communicator

    Attributes
    ----------
    estimates : ndarray, shape (SEEDS, n)
        Over the standard deviation of each variable, minus the truth.
    posterior : Posterior
    values : dict of str to ndarray
        Samples of the posterior at the truth by key.
    difference : float
        Largest difference of estimates by whole inferences, over standard deviations.
    width : float
        Largest relative difference of widths of their intervals.
    runs : float
        Mean number of runs of whole inferences.
    covered : list of bool
        Which of their intervals contain the truth.
    """

    def __init__(self, table: Table, start: dict[str, float], whole: int, comm: MPI.Comm) -> None:
        self._table, self._start, self._comm = table, start, comm
        true = Case.model_validate(table)
        made = Objective(true, true.objective, comm, record=False)
        self._clean = [sample.values for _, sample in made.samples]
        case = self._with_data(table, self._clean)
        with tempfile.TemporaryDirectory() as folder:
            inversion = Inversion(case, Path(folder, "out"), comm, False, 1e9)
            n = len(inversion.bounds)
            inversion._run(np.zeros(n), "history")
            jacobian = inversion._jacobian(0)
            self.posterior = posterior.of_jacobian(np.zeros(n), jacobian, np.zeros(n, bool))
            spread = self.posterior.spread
            deviation = np.sqrt(np.sum(spread**2, axis=1))
            noises = [self._noise(seed) for seed in range(SEEDS)]
            found = []
            for noise in noises:
                z = spread @ (spread.T @ (jacobian.T @ noise))
                for _ in range(2):
                    r = inversion._evaluate(z, "none").residuals - noise
                    z = z - spread @ (spread.T @ (jacobian.T @ r))
                found.append(z / deviation)
            self.estimates = np.array(found)
            self.values = {
                each.unknown.key: np.array([
                    each.values(row[number : number + 1])[0] for row in self.posterior.draws(4000, *inversion.bounds.T)
                ]) for number, each in enumerate(inversion.evaluator.variables)
            }  # fmt: skip
            variables = inversion.evaluator.variables
            truth = [each.values(np.zeros(1))[0] for each in variables]
            ends = [each.interval(np.zeros(1), spread[i : i + 1])[:, 0] for i, each in enumerate(variables)]
            log = [each.unknown.scale == "log" for each in variables]
        self.difference, self.width, self.covered, runs = 0.0, 0.0, list[bool](), []
        for seed in range(whole):
            result = self._infer(noises[seed])
            runs.append(len(result.runs))
            for number, each in enumerate(result.unknowns):
                t = np.log if log[number] else np.asarray
                half = 0.5 * float(np.ptp(t(ends[number])))
                away = (float(t(each.best[0])) - float(t(truth[number]))) / half
                own = 0.5 * float(np.ptp(t(each.interval[:, 0])))
                self.difference = max(self.difference, abs(away - float(self.estimates[seed, number])))
                self.width = max(self.width, abs(own / half - 1))
                self.covered.append(bool(each.interval[0, 0] < truth[number] < each.interval[1, 0]))
        self.runs = float(np.mean(runs))

    def _noise(self, seed: int) -> np.ndarray:
        return np.random.default_rng(seed).normal(size=sum(len(each) for each in self._clean))

    @staticmethod
    def _with_data(table: Table, readings: list[np.ndarray]) -> Case:
        found, rest = [], iter(readings)
        for term in table["objective"]:
            found.append({**term, "data": {name: next(rest).tolist() for name in term["data"]}})
        return Case.model_validate({**table, "objective": found})

    def _infer(self, noise: np.ndarray) -> Any:
        sigma = self._table["objective"][0]["sigma"]
        parts = np.split(noise, np.cumsum([len(each) for each in self._clean])[:-1])
        case = self._with_data(self._table, [u + sigma * e for u, e in zip(self._clean, parts, strict=True)])
        for key, value in self._start.items():
            case = case.changed(key, value)
        with tempfile.TemporaryDirectory() as folder:
            path = self._comm.bcast(folder, root=0)
            result = infer(case, Path(path, "out"), self._comm, progress=False)
            self._comm.Barrier()
        return result

    @property
    def coverage(self) -> float:
        """Part of all intervals that contain the truth."""
        return float(np.mean(np.abs(self.estimates) < 1))


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    whole, checks, problems = SEEDS if fine else WHOLE, [], {}
    for name, table, start in (
        ("gauges", gauges(), {MU_S: 0.55, D_C: 2.5e-6, SHEAR: 2.55e6}),
        ("antiplane", receivers(), {D_C: 0.05, SHEAR: 74e6}),
    ):
        made = problems[name] = Realisations(table, start, whole, comm)
        n = made.estimates.shape[1]
        checks += [
            Check(f"{name}: part of {n * SEEDS} intervals with the truth", 0.68, made.coverage, 0.08, "1", SOURCE),
            Check(f"{name}: standard deviation of estimates over that of the posterior", 1.0,
                  float(np.sqrt(np.mean(made.estimates**2))), 0.2, "1", "normal noise"),
            Check(f"{name}: whole inferences against chord steps, {whole} seeds, in standard deviations", 0.0,
                  made.difference, 0.5, "1", "same to first order"),
            Check(f"{name}: widths of their intervals", 0.0, made.width, 0.25, "1", "Jacobian of the truth"),
            Check(f"{name}: runs of a whole inference", 20.0, made.runs, 0.0, "1", "few unknowns", "at most"),
        ]  # fmt: skip
        if fine:
            checks.append(Check(f"{name}: part of {n * SEEDS} intervals of whole inferences with the truth", 0.68,
                                float(np.mean(made.covered)), 0.08, "1", SOURCE))  # fmt: skip
    values = problems["gauges"].values
    energy = 0.5 * (values[MU_S] - MU_D) * NORMAL * values[D_C]
    ratio = float(np.std(values[D_C]) / np.mean(values[D_C]) / (np.std(energy) / np.mean(energy)))
    checks.append(Check("gauges: relative deviation of D_c over that of the fracture energy", 3.0, ratio, 0.0, "1",
                        "a goal: gauges away from the interface feel the fracture energy", "at least"))  # fmt: skip
    return Outcome(checks, lambda: _draw(problems))


def _draw(problems: dict[str, Realisations]) -> Figure:
    from ruptfx.results.figure_style import new_figure

    figure, ((left, right),) = new_figure(1, 2, 3.0)
    for shift, (name, made) in enumerate(problems.items()):
        sizes = np.sort(np.abs(made.estimates).ravel())
        left.step(sizes, (np.arange(len(sizes)) + 1) / len(sizes), label=f"{name}: {100 * made.coverage:.0f} %")
        for number, column in enumerate(made.estimates.T):
            right.plot(np.full(SEEDS, number + 4 * shift), column, ".", ms=3, color=f"C{shift}")
    left.axvline(1.0, color="k", lw=0.7, ls=":")
    left.axhline(0.68, color="k", lw=0.7, ls=":")
    left.set(xlabel="deviation from the truth over that of the posterior", ylabel="part of estimates", xlim=(0, 3))
    left.legend(frameon=False, fontsize="x-small")
    right.axhspan(-1, 1, color="0.9", lw=0)
    right.set_xticks([0, 1, 2, 4, 5], ["mu_s", "D_c", "stress", "D_c", "stress"])
    right.set(ylabel="deviation from the truth")
    return figure
