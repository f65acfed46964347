"""Shared part of the reconstruction benchmark: a rupture of a surface, seen by strain gauges on free faces.

Two bodies meet on a fault of 12 mm by 8 mm that reaches their top face. Eight rosettes are on the top face, 1.5 mm from
the fault, and twelve on the side faces, 3 mm from it. Data come from a spontaneous rupture with linear slip weakening
on a mesh with half the spacing of that of the reconstruction.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from benchmarks._twins import Bodies
from ruptfx import Table, simulate
from ruptfx.case import Case
from ruptfx.many_runs.reconstruction.posterior import Posterior, Prior, likeliest, stretched
from ruptfx.readings.misfits.traces import Traces

if TYPE_CHECKING:
    from ruptfx.many_runs.reconstruction.posterior import Rows
    from ruptfx.platform.fem import MPI

Floats = NDArray[np.float64]
INTERVAL, END, NOISE = 3e-7, 7.2e-6, 0.02
SPACING = 2e-3
LAYOUTS, CHOSEN, SAMPLES = 10, 15, 16
"""Experiments, rosettes of each, and samples of tractions."""
LENGTH, TIME = 3e-3, 1.2e-6
"""Distance of the gauges, and time that the front takes to pass."""
ALONG = (-4.5e-3, -1.5e-3, 1.5e-3, 4.5e-3)
TOP = [(x, side * 1.5e-3, 0.0) for x in ALONG for side in (1, -1)]
SIDES = [(x, side * 3e-3, z) for x in ALONG for side, z in ((1, -1.5e-3), (-1, -4e-3), (1, -6.5e-3))]
DEPTHS = (1e-3, 7e-3)
"""Depth above and below which the fault counts as shallow and deep [m]."""


def specimen(element_size: float) -> Case:
    """Return the bodies with rosettes and data of zero."""
    gauges: list[Table] = [
        {"kind": "strain_gauge", "name": f"{face}{number}", "interval": INTERVAL, "point": list(point), "length": 1e-3,
         "angles": ["45 deg", "135 deg"], "axes": [[1, 0, 0], second], "bandwidth": 2e6}
        for face, second, points in (("top", [0, 1, 0], TOP), ("side", [0, 0, 1], SIDES))
        for number, point in enumerate(points)
    ]  # fmt: skip
    times = np.arange(1, round(END / INTERVAL)) * INTERVAL
    grids = ("extension_1", "extension_2")
    terms: list[Table] = [
        {"kind": "traces", "instrument": each["name"], "times": times.tolist(), "sigma": 1.0,
         "data": {grid: [0.0] * len(times) for grid in grids}, "units": dict.fromkeys(grids, "1")} for each in gauges
    ]  # fmt: skip
    return Case.model_validate({
        "plane": "solid", "order": 4, "duration": END, "positions": "x",
        "mesh": {"kind": "box_with_fault", "fault_length": 12e-3, "fault_width": 8e-3, "element_size": element_size,
                 "beyond": 2e-3, "distance": 3e-3},
        "materials": {"default": {"kind": "isotropic_elastic", "young_modulus": 5.3e9, "poisson_ratio": 0.35,
                                  "density": 1246.0}},
        "faults": {"main": {
            "contact": {"kind": "split_node"},
            "friction": {"kind": "linear_slip_weakening", "mu_s": 0.6, "mu_d": 0.3, "D_c": 1e-6},
            "initial_stress": {"normal": 6e6, "shear": {"kind": "rectangle", "inside": 3.7e6, "outside": 2.8e6,
                                                        "strike": [-3e-3, 3e-3], "dip": [1e-3, 5e-3]}}}},
        "boundaries": [{"kind": "absorbing", "edge": f"{side}.{edge}"} for side in ("plus", "minus")
                       for edge in ("left", "right", "bottom")],
        "instruments": gauges, "objective": terms,
        "output": {"interface_interval": INTERVAL / 3, "figures": False},
    })  # fmt: skip


@dataclass(frozen=True)
class Coverage:
    """Reconstructions of one rupture from several sets of gauges with noise, where their data tell the slip rate.

    Attributes
    ----------
    part : float
        Part of the true slip rates in bands of 68 %.
    known : float
        Part of the surface where the data remove more than half of the prior variance.
    error, band : float
        RMS error and RMS deviation of the slip rate over its peak.
    slip : float
        RMS error of the final slip over its largest value.
    shallow, deep : float
        Part of the prior variance that the data remove near the top and near the bottom.
    """

    part: float
    known: float
    error: float
    band: float
    slip: float
    shallow: float
    deep: float


class SurfaceRupture:
    """A rupture on fine elements, and the bodies of its reconstruction on coarse ones."""

    def __init__(self, comm: MPI.Comm) -> None:
        self._bodies = Bodies(specimen(SPACING), comm, INTERVAL)
        self.twin, self.still, self.rows = self._bodies.twin, self._bodies.still, self._bodies.rows
        self.truth, clean = self._ruptured()
        self._clean = clean - np.concatenate([sample.values for sample in self.still.samples])
        self.sigma = NOISE * float(np.abs(self._clean).max())
        self.peak = float(self.truth["slip_rate"].max())

    def _ruptured(self) -> tuple[dict[str, Floats], Floats]:
        """Return fields of a rupture on fine elements at the points and knots, along strike, and its data."""
        from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator

        with tempfile.TemporaryDirectory() as folder:
            record = simulate(specimen(SPACING / 2), out=folder + "/run", progress=False)
            data, fields = record.interface, {}
            places = np.stack([data["x"].values, data["z"].values], axis=1)
            wanted = self.twin.geometry.points[:, [0, 2]]
            for name in ("slip_rate", "slip", "shear_traction"):
                rows = data[f"{name}_1"].values.T
                at_knots = np.array([np.interp(self.twin.knots.times, data["time"].values, row) for row in rows])
                inside = LinearNDInterpolator(places, at_knots)(wanted)
                outside = NearestNDInterpolator(places, at_knots)(wanted)
                fields[name] = np.where(np.isfinite(inside), inside, outside).T
            readings = [
                np.interp(np.array(term.times), record.instruments[term.instrument]["time"].values,
                          record.instruments[term.instrument][grid].values)
                for term in self._bodies.case.objective if isinstance(term, Traces) for grid in term.data
            ]  # fmt: skip
        return fields, np.concatenate(readings)

    def noisy(self, seed: int, gauges: NDArray[np.int64] | None = None) -> Rows:
        """Return the data of some rosettes, of all without any, with noise."""
        values = self._clean + self.sigma * np.random.default_rng(seed).normal(size=len(self._clean))
        rows = replace(self.rows, values=values, sigma=np.full(len(values), self.sigma))
        return (
            rows if gauges is None else rows.some(np.arange(len(values)).reshape(len(TOP + SIDES), -1)[gauges].ravel())
        )

    @cached_property
    def of_page(self) -> dict[str, float]:
        """Amplitude, length and time as the page on reconstruction says: of a third of the peak, gauges and front."""
        return {"amplitude": self.peak / 3, "length": LENGTH, "time": TIME}

    def likely(self) -> dict[str, float]:
        """Return amplitude, length and time that maximise the likelihood of the data of all rosettes."""
        free: dict[str, float | None] = {"amplitude": None, "length": None, "time": None}
        return likeliest(free, self.noisy(0), self.twin.geometry.locations, self.twin.knots.times)

    def prior(self, scales: dict[str, float]) -> Prior:
        """Return the prior of an amplitude, a length and a time."""
        positions = stretched(self.twin.geometry.locations, scales["length"], None)
        return Prior.of_lengths(scales["amplitude"], scales["length"], scales["time"], positions, self.twin.knots.times)

    def coverage(self, scales: dict[str, float], only_top: bool = False) -> Coverage:
        """Return the means over experiments, with rosettes chosen at random, or those of the top face."""
        prior, geometry, random = self.prior(scales), self.twin.geometry, np.random.default_rng(11)
        along, results = prior.of_columns(geometry.along), []
        before, depth = np.mean(along.deviation() ** 2, axis=0), -geometry.points[:, 2]
        for number in range(LAYOUTS):
            chosen = random.choice(len(TOP + SIDES), CHOSEN, replace=False)
            gauges = np.arange(len(TOP)) if only_top else np.sort(chosen)
            made = Posterior(prior, self.noisy(number, gauges))
            deviation, fields = made.deviation(prior=along), prior.fields(made.mean)
            information = 1 - np.mean(deviation**2, axis=0) / before
            known = information > 0.5
            error = (geometry.along(fields) - self.truth["slip_rate"])[:, known]
            slip = geometry.along(self.twin.slip(fields))[-1] - self.truth["slip"][-1]
            results.append((
                np.mean(np.abs(error) < deviation[:, known]), np.mean(known), np.sqrt(np.mean(error**2)) / self.peak,
                np.sqrt(np.mean(deviation[:, known] ** 2)) / self.peak,
                np.sqrt(np.mean(slip[known] ** 2)) / self.truth["slip"][-1].max(),
                np.mean(information[depth < DEPTHS[0]]), np.mean(information[depth > DEPTHS[1]]),
            ))  # fmt: skip
        return Coverage(*np.mean(results, axis=0).tolist())

    def traction(self, scales: dict[str, float]) -> tuple[float, float, float]:
        """Return error and deviation (RMS) of the shear traction over its largest change, and the part in bands."""
        prior, geometry = self.prior(scales), self.twin.geometry
        made, still = Posterior(prior, self.noisy(0)), geometry.along(self.still.shear_traction)

        def of(slip_rate: Floats) -> Floats:
            return geometry.along(self._bodies.traction(slip_rate))

        error = of(prior.fields(made.mean)) - self.truth["shear_traction"]
        changes = [of(prior.fields(each)) - still for each in made.spread(SAMPLES, 1)]
        band = np.sqrt(np.mean(np.square(changes), axis=0))
        largest = float(np.abs(self.truth["shear_traction"] - still).max())
        rms = [float(np.sqrt(np.mean(each**2))) / largest for each in (error, band)]
        return rms[0], rms[1], float(np.mean(np.abs(error) < band))
