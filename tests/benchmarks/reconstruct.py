"""Slip rate and traction of an interface from 16 strain gauges: part of the truth in bands of 68 %, and a rupture.

Two plates of 32 mm by 8 mm with grids of 1 mm in a row 1 mm above the interface and in one below it, data every 0.3 us
with noise of 2 % of their largest value. The data come from a mesh with half the spacing and another time step than
that of the reconstruction. In 40 experiments the slip rate is a random field with the lengths of the prior: bands of
the exact posterior contain 68 % of the truth in the mean over points, times and experiments if mesh, impulse responses
and posterior are right; with `--fine` also where each experiment has the prior that its data make likeliest. Tractions
of runs with the mean slip rate are compared where the deviation of runs with samples is below 5 % of their largest
change. A spontaneous rupture with linear slip weakening is no such field: lengths that maximise the likelihood give the
part of it in bands and its final slip, over 40 realisations of the noise. With `--fine` also those of a rupture of a
surface in 3D, from gauges on free faces (`_surface_rupture.py`), where the aims are missed.
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from benchmarks._surface_rupture import CHOSEN, LAYOUTS, SIDES, TOP, SurfaceRupture
from benchmarks._twins import Bodies
from ruptfx import Table, simulate
from ruptfx.app.bench import Check, Outcome
from ruptfx.case import Case
from ruptfx.many_runs.reconstruction.posterior import Posterior, Prior, likeliest
from ruptfx.readings.misfits.traces import Traces

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ruptfx.platform.fem import MPI

Floats = NDArray[np.float64]
SEEDS, RUNS, SAMPLES, CLOSE = 40, 4, 32, 0.05
NOISE, INTERVAL, BEGIN, END = 0.02, 3e-7, 3e-7, 15e-6
SPACING = 1.6e-3
FIELDS = ((5e-3, 1.5e-6), (3e-3, 1e-6), (8e-3, 3e-6))
"""Lengths [m] and times [s] of the random slip rates, whose standard deviation is 1 m/s."""
FREE: dict[str, float | None] = {"amplitude": None, "length": None, "time": None}
"""Numbers of a prior that maximise the likelihood of the data."""
PLACES = np.linspace(3e-3, 29e-3, 8)


def specimen(element_size: float) -> Case:
    """Return the plates with gauges and data of zero."""
    gauges = [
        {"kind": "strain_gauge", "name": f"g{row}{number}", "interval": INTERVAL, "point": [float(x), y],
         "length": 1e-3, "angles": ["45 deg"], "bandwidth": 2e6}
        for row, y in enumerate((1e-3, -1e-3)) for number, x in enumerate(PLACES)
    ]  # fmt: skip
    times = np.arange(1, round(END / INTERVAL)) * INTERVAL
    terms: list[Table] = [
        {"kind": "traces", "instrument": each["name"], "times": times.tolist(), "sigma": 1.0,
         "data": {"extension_1": [0.0] * len(times)}, "units": {"extension_1": "1"}} for each in gauges
    ]  # fmt: skip
    return Case.model_validate({
        "plane": "stress", "order": 4, "duration": END,
        "mesh": {"kind": "two_plates", "length": 32e-3, "height": 8e-3, "element_size": element_size},
        "materials": {"default": {"kind": "isotropic_elastic", "young_modulus": 5.3e9, "poisson_ratio": 0.35,
                                  "density": 1246.0}},
        "faults": {"main": {
            "contact": {"kind": "split_node"},
            "friction": {"kind": "linear_slip_weakening", "mu_s": 0.6, "mu_d": 0.3, "D_c": 5e-6},
            "initial_stress": {"normal": 6e6, "shear": 2.7e6},
            "nucleation": {"kind": "forced_rupture", "center": 8e-3, "radius": 10e-3, "speed": 900.0, "mu_d": 0.3,
                           "t_w": 1.5e-6}}},
        "boundaries": [{"kind": "absorbing", "edge": f"{body}.{side}"} for body in ("upper", "lower")
                       for side in ("left", "right")],
        "instruments": gauges, "objective": terms,
        "output": {"interface_interval": INTERVAL, "figures": False},
    })  # fmt: skip


def prior_of(scales: dict[str, float], bodies: Bodies) -> Prior:
    """Return the prior of an amplitude, a length and a time at the points of a mesh."""
    return Prior.of_lengths(scales["amplitude"], scales["length"], scales["time"], bodies.position, bodies.times)


def part_within(truth: Floats, mean: Floats, deviation: Floats) -> float:
    """Return the part of the truth that is not more than a standard deviation from the mean."""
    return float(np.mean(np.abs(truth - mean) < deviation))


class RandomFields:
    """Random slip rates with lengths [m] and [s], and their data without noise.

    Attributes
    ----------
    on_fine, on_coarse : Prior
        Modes of the slip rates at the points of both meshes.
    coefficients : ndarray, shape (SEEDS, modes)
    data : ndarray, shape (SEEDS, data)
        With noise.
    sigma : float
    """

    def __init__(self, fine: Bodies, coarse: Bodies, length: float, time_: float) -> None:
        union = np.unique(np.round(np.concatenate([fine.position, coarse.position]), 9))
        whole = Prior.of_lengths(1.0, length, time_, union, fine.times)
        self.on_fine, self.on_coarse = (
            Prior(whole.space[np.searchsorted(union, np.round(each.position, 9))], whole.time)
            for each in (fine, coarse)
        )
        random = np.random.default_rng(0)
        self.coefficients = random.normal(size=(SEEDS, whole.size))
        clean = self.coefficients @ fine.rows.design(self.on_fine).T
        self.sigma = NOISE * float(np.abs(clean).max())
        self.data = clean + self.sigma * random.normal(size=clean.shape)


def likely_lengths(made: RandomFields, coarse: Bodies) -> tuple[float, float, float]:
    """Return the part of slip rates in bands of 68 % whose prior is the likeliest one of each experiment.

    The second number is the part where the data remove more than half of the prior variance; the third is the mean
    likeliest length [m].
    """
    parts, known_parts, lengths = [], [], []
    for coefficients, values in zip(made.coefficients, made.data, strict=True):
        rows = replace(coarse.rows, values=values, sigma=np.full(len(values), made.sigma))
        scales = likeliest(FREE, rows, coarse.position, coarse.times)
        prior = prior_of(scales, coarse)
        posterior = Posterior(prior, rows)
        fields = made.on_coarse.fields(coefficients), prior.fields(posterior.mean), posterior.deviation()
        known = 1 - np.mean(fields[2] ** 2, axis=0) / np.mean(prior.deviation() ** 2, axis=0) > 0.5
        parts.append(part_within(*fields))
        known_parts.append(part_within(*(each[:, known] for each in fields)))
        lengths.append(scales["length"])
    return float(np.mean(parts)), float(np.mean(known_parts)), float(np.mean(lengths))


def random_fields(
    made: RandomFields, fine: Bodies, coarse: Bodies, lengths: tuple[float, float], runs: int
) -> tuple[float, float]:
    """Return the part of slip rates in bands of 68 %, and the error of tractions of some where bands are narrow."""
    on_fine, sigma = made.on_fine, made.sigma
    rows = replace(coarse.rows, sigma=np.full(len(made.data[0]), sigma))
    prior = Prior.of_lengths(1.0, *lengths, coarse.position, coarse.times)
    posterior = Posterior(prior, rows)
    deviation = posterior.deviation()
    parts, tractions, band = [], [], None
    for number, (each, values) in enumerate(zip(made.coefficients, made.data, strict=True)):
        solution = posterior.solution(values)
        parts.append(part_within(made.on_coarse.fields(each), prior.fields(solution), deviation))
        if number < runs:
            if band is None:  # it does not depend on the data
                shapes = prior.fields(posterior.samples(SAMPLES, 1)) - prior.fields(posterior.mean)
                band = np.sqrt(
                    np.mean([(coarse.traction(s) - coarse.still.shear_traction) ** 2 for s in shapes], axis=0)
                )
            truth = fine.traction(on_fine.fields(each))
            order = np.argsort(fine.position)
            at = np.array([np.interp(coarse.position, fine.position[order], row[order]) for row in truth])
            error, largest = (
                at - coarse.traction(prior.fields(solution)),
                np.abs(at - coarse.still.shear_traction).max(),
            )
            tractions.append(np.sqrt(np.mean((error / largest)[band < CLOSE * largest] ** 2)))
    return float(np.mean(parts)), float(np.mean(tractions)) if tractions else np.nan


def rupture(fine: Bodies, coarse: Bodies) -> dict[str, Floats | float]:
    """Return slip rates of a spontaneous rupture, their reconstruction, and the part that is in bands of 68 %."""
    with tempfile.TemporaryDirectory() as folder:
        record = simulate(fine.case, out=folder + "/run", progress=False)
        data, order = record.interface, np.argsort(record.interface["position"].values)
        along = data["position"].values[order]
        fields = {}
        for name in ("slip_rate", "slip"):
            in_time = [np.interp(coarse.times, data["time"].values, row) for row in data[name].values[:, order].T]
            fields[name] = np.array([np.interp(coarse.position, along, row) for row in np.array(in_time).T])
        readings = np.concatenate([
            np.interp(np.array(term.times), record.instruments[term.instrument]["time"].values,
                      record.instruments[term.instrument]["extension_1"].values)
            for term in fine.case.objective if isinstance(term, Traces)
        ])  # fmt: skip
    clean = readings - np.concatenate([sample.values for sample in coarse.still.samples])
    sigma, random = NOISE * float(np.abs(clean).max()), np.random.default_rng(5)
    rows = replace(coarse.rows, values=clean + sigma * random.normal(size=len(clean)), sigma=np.full(len(clean), sigma))
    scales = likeliest(FREE, rows, coarse.position, coarse.times)
    prior = prior_of(scales, coarse)
    posterior = Posterior(prior, rows)
    deviation = posterior.deviation()
    known = 1 - np.mean(deviation**2, axis=0) / np.mean(prior.deviation() ** 2, axis=0) > 0.5
    parts = []
    for _ in range(SEEDS):
        mean = prior.fields(posterior.solution(clean + sigma * random.normal(size=len(clean))))
        parts.append(part_within(fields["slip_rate"][:, known], mean[:, known], deviation[:, known]))
    mean = prior.fields(posterior.mean)
    summed = coarse.twin.knots.interval * (np.tril(np.ones((len(mean),) * 2)) - 0.5 * np.eye(len(mean)))
    slip = (summed @ mean)[-1]
    return {
        "truth": fields["slip_rate"], "mean": mean, "deviation": deviation, "part": float(np.mean(parts)),
        "slip": float(np.sqrt(np.mean((slip - fields["slip"][-1])[known] ** 2)) / fields["slip"][-1].max()),
    }  # fmt: skip


def surface_rupture(comm: MPI.Comm) -> list[Check]:
    """Return the numbers of a rupture of a surface from gauges on free faces."""
    made, checks = SurfaceRupture(comm), []
    sets = f"{LAYOUTS} sets of {CHOSEN} of {len(TOP + SIDES)} rosettes"
    for scales, about in ((made.of_page, "lengths of the sensors"), (made.likely(), "likeliest lengths")):
        everywhere, only_top = made.coverage(scales), made.coverage(scales, only_top=True)
        error, _, part = made.traction(scales)
        checks += [
            Check(f"rupture of a surface, {about}: slip rates within 68 % bands where it is known, {sets}", 68.0,
                  100 * everywhere.part, 4.0, "%", "normal distribution"),
            Check(f"the same from the {len(TOP)} rosettes of the top face", 68.0, 100 * only_top.part, 4.0, "%",
                  "normal distribution"),
            Check("the same, tractions of all rosettes", 68.0, 100 * part, 4.0, "%", "normal distribution"),
            *(Check(f"rupture of a surface, {about}: {what}, RMS error over the largest", 0.0, value, 0.05, "1",
                    "run that made the data")
              for what, value in (("slip rates", everywhere.error), ("final slip", everywhere.slip),
                                  ("change of tractions", error))),
        ]  # fmt: skip
    return checks


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    begun = time.process_time()
    data, twin = (Bodies(specimen(part * SPACING / (2 if fine else 1)), comm, INTERVAL, BEGIN) for part in (0.5, 1.0))
    set_up = time.process_time() - begun
    checks = []
    for number, (length, time_) in enumerate(FIELDS):
        made = RandomFields(data, twin, length, time_)
        slip, traction = random_fields(made, data, twin, (length, time_), RUNS if number == 0 else 0)
        about = f"{1e3 * length:g} mm, {1e6 * time_:g} us"
        checks.append(Check(f"slip rates within 68 % bands, {about}, {SEEDS} experiments", 68.0, 100 * slip, 4.0, "%",
                            "normal distribution"))  # fmt: skip
        if fine and number == 0:
            likely, _, _ = likely_lengths(made, twin)
            checks.append(Check(f"the same, {about}, with the likeliest prior of each experiment", 68.0, 100 * likely,
                                4.0, "%", "normal distribution"))  # fmt: skip
        if np.isfinite(traction):
            checks.append(Check(f"tractions with deviations below {100 * CLOSE:g} %, {about}, RMS error over the "
                                "largest change", 0.0, traction, CLOSE, "1", "runs that made the data"))  # fmt: skip
    ruptured = rupture(data, twin)
    checks += [
        Check(f"slip rates of a rupture within 68 % bands where it is known, {SEEDS} realisations of the noise", 68.0,
              100 * float(ruptured["part"]), 4.0, "%", "normal distribution"),
        Check("final slip of a rupture where it is known, RMS error over the largest", 0.0, float(ruptured["slip"]),
              0.05, "1", "run that made the data"),
        Check("CPU time of both set-ups with 16 responses each", 60.0, set_up, 0.0, "s", "", "at most", timing=True),
    ]  # fmt: skip
    if fine:
        checks += surface_rupture(comm)
    return Outcome(checks, lambda: _draw(ruptured, twin))


def _draw(made: dict[str, Floats | float], twin: Bodies) -> Figure:
    from ruptfx.results.figure_style import RATE_MAP, edges, new_figure, remark

    figure, (panels,) = new_figure(1, 3, 3.2, 8, sharey=True)
    order = np.argsort(twin.position)
    grid = edges(1e3 * twin.position[order]), edges(1e6 * twin.times)
    largest = float(np.max(made["truth"]))
    for ax, name in zip(panels, ("truth", "mean", "deviation"), strict=True):
        mesh = ax.pcolormesh(
            *grid, np.asarray(made[name])[:, order], cmap=RATE_MAP, vmin=0, vmax=largest, rasterized=True
        )
        ax.set(xlabel="Position (mm)", title=name)
    figure.colorbar(mesh, ax=panels, label="Slip rate (m/s)", pad=0.02)
    panels[0].set_ylabel("Time (µs)")
    part = 100 * float(made["part"])
    remark(figure, f"Spontaneous rupture: {part:.0f} % of the true slip rates are in the band of 68 %, where "
                   f"it is known, over {SEEDS} realisations of the noise.")  # fmt: skip
    return figure
