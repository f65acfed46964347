"""TPV205-2D: in-plane slip-weakening rupture across two patches of different stress.

SCEC/USGS benchmark TPV205 in two dimensions: 15 km to either side of the hypocentre may slip, the shear stress is
62 MPa in a patch to the right and 78 MPa in one to the left. Reference values at the stations: PyLith, 200 m
quadrilaterals, 0.05 s sampling, with the corridor of that sampling (0.1 s) and 10 % in rates and slips. Own
convergence as in Day, Dalguer, Lapusta, Liu (2005): at a node spacing of 100 m against own finer runs.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ruptfx.bench import Check, Outcome
from ruptfx.bench._rupture import Rupture, elastic, rupture

HALF = 40e3  # m, half the length of the model
C_S = 3464.0
STATIONS = np.array([-12, -7.5, -4.5, 4.5, 7.5, 12]) * 1e3
TIMES = np.array([2.85, 1.85, 1.55, 1.55, 2.70, 4.30])
PEAK_RATES = np.array([6.77, 5.26, 4.40, 4.40, 2.30, 4.26])
SLIPS = np.array([4.247, 6.953, 7.299, 6.444, 4.882, 3.611])
SOURCE = "PyLith, 200 m (Aagaard et al. 2013)"
TIME_LIMIT = 15.0  # s, one core


def case(spacing: float, duration: float = 12.0, half: float = HALF, height: float = HALF) -> dict[str, Any]:
    """The problem with nodes that far apart [m], as a half model: equal bodies, antisymmetric motion.

    Order 5, so that at 100 m the edges of all patches are edges of elements; a node there carries the mean stress.
    """

    def patch(left: float, right: float, extra: float) -> list[dict[str, Any]]:
        center, width = half + 0.5 * (left + right), 0.5 * (right - left)
        box = {"kind": "boxcar", "inside": 0.5 * extra, "outside": 0.0, "center": center}
        boxes = ({**box, "half_width": width * (1 + away)} for away in (-1e-6, 1e-6))
        return [{"kind": "overstress", "extra": extra} for extra in boxes]

    return {
        "plane": "strain", "order": 5, "duration": duration,
        "mesh": {
            "kind": "half_plate", "length": 2 * half, "height": height, "left": -half, "element_size": 5 * spacing,
        },
        "materials": {"default": elastic(6000.0, C_S, 2670.0)},
        "damping": {"kelvin_voigt": {"fraction": 0.1}},
        "faults": {"main": {
            "contact": {"kind": "split_node"},
            "friction": {
                "kind": "linear_slip_weakening", "mu_d": 0.525, "D_c": 0.4,
                "mu_s": {"kind": "boxcar", "inside": 0.677, "outside": 1e4, "center": half, "half_width": 15e3},
            },
            "initial_stress": {"normal": 120e6, "shear": 70e6},
            "nucleation": [*patch(-1.5e3, 1.5e3, 11.6e6), *patch(6e3, 9e3, -8e6), *patch(-9e3, -6e3, 8e6)],
        }},
        "boundaries": [{"kind": "absorbing", "edge": f"upper.{side}"} for side in ("left", "right", "top")],
    }  # fmt: skip


def run(fine: bool, comm: Any) -> Outcome:
    """Stations, speed at 100 m and, with `fine`, convergence."""
    main = rupture(case(100.0), comm=comm)
    x = main.position - HALF
    arrival = main.rupture_time(1e-3)
    peak, slip = np.abs(main.slip_rate).max(axis=0), np.abs(main.fields["slip"])
    checks = []
    for station, t, rate, total in zip(STATIONS, TIMES, PEAK_RATES, SLIPS, strict=True):
        at, place = main.at(station + HALF), f"x = {station / 1e3:g} km"
        checks += [
            Check(f"rupture time, {place}", t, arrival[at], 0.1, "s", SOURCE),
            Check(f"peak slip rate, {place}", rate, peak[at], 0.1, "m/s", SOURCE, relative=True),
            Check(f"slip at 12 s, {place}", total, slip[at], 0.1, "m", SOURCE, relative=True),
        ]
    for name, low, high in (("left", -14e3, -9.5e3), ("right", 9.5e3, 14e3)):
        part = (x > low) & (x < high)
        speed = abs(np.polyfit(arrival[part], x[part], 1)[0])
        relation = "at least" if name == "left" else "at most"
        quantity, source = f"mean speed beyond the {name} patch", "supershear on the left only"
        checks.append(Check(quantity, C_S, speed, 0, "m/s", source, relation))  # type: ignore[arg-type]
    checks += [main.budget(), Check("time of the steps", TIME_LIMIT, main.seconds, 0, "s, CPU", "target", "at most")]
    convergence = _convergence(main, fine)
    checks += convergence.pop("checks")
    return Outcome(checks, lambda: _draw(main, arrival, convergence))


def _convergence(main: Rupture, fine: bool) -> dict[str, Any]:
    """Rupture times, peak rates and slips of coarse runs against a fine one, on a shorter problem."""
    half, duration = 18e3, 4.6
    spacings = [100.0, 50.0, 25.0, 12.5] if fine else [100.0, 50.0, 25.0]
    runs = [rupture(case(h, duration, half, 6e3), energies=1) for h in spacings]
    stations = np.arange(-14.5e3, 14.501e3, 0.5e3) + half  # corners of elements in all meshes
    stations = stations[np.abs(stations - half) > 3e3]
    times = [np.interp(stations, r.position, r.rupture_time(1e-3)) for r in runs]
    peaks = [np.interp(stations, r.position, np.abs(r.slip_rate).max(axis=0)) for r in runs]
    slips = [np.interp(stations, r.position, np.abs(r.fields["slip"])) for r in runs]
    reached = np.isfinite(times[-1]) & (times[-1] < 0.9 * duration)

    def rms(values: list[np.ndarray], k: int) -> float:
        return float(np.sqrt(np.nanmean((values[k][reached] / values[-1][reached] - 1) ** 2)))

    errors = np.array([[rms(values, k) for values in (times, peaks, slips)] for k in range(len(runs) - 1)])
    own = f"own {spacings[-1]:g} m"
    at = spacings.index(100.0)
    exponent = np.log(errors[0, 0] / errors[-1, 0]) / np.log(spacings[0] / spacings[-2])
    return {
        "spacings": spacings[:-1], "errors": errors,
        "checks": [
            Check("rupture time, RMS at 100 m", 0.0, errors[at, 0], 5e-3, "1", own),
            Check("peak slip rate, RMS at 100 m", 0.0, errors[at, 1], 6e-2, "1", own),
            Check("slip, RMS at 100 m", 0.0, errors[at, 2], 1e-2, "1", own),
            Check("rupture time, exponent of the error", 2.0, exponent, 0, "1", "Day et al. (2005)", "at least"),
        ],
    }  # fmt: skip


def _draw(main: Rupture, arrival: np.ndarray, convergence: dict[str, Any]) -> Any:
    from matplotlib import pyplot as plt

    figure, (front, rates, errors) = plt.subplots(1, 3, figsize=(11, 3.6), layout="constrained")
    x = (main.position - HALF) / 1e3
    inside = np.abs(x) <= 15
    front.plot(x[inside], arrival[inside])
    front.plot(STATIONS / 1e3, TIMES, "o", mfc="none", label="PyLith 200 m")
    front.set(xlabel="x [km]", ylabel="rupture time [s]")
    front.legend(frameon=False)
    for k, station in enumerate(STATIONS):
        at = main.at(station + HALF)
        rates.plot(main.time, np.abs(main.slip_rate[:, at]) + 8 * k, lw=0.9)
        rates.text(12, 8 * k + 0.5, f"{station / 1e3:g} km", ha="right", fontsize=8)
    rates.set(xlabel="time [s]", ylabel="slip rate [m/s], 8 m/s apart")
    for k, name in enumerate(("rupture time", "peak slip rate", "slip")):
        errors.loglog(convergence["spacings"], convergence["errors"][:, k], "o-", label=name)
    errors.set(xlabel="node spacing [m]", ylabel="RMS error")
    errors.legend(frameon=False)
    return figure
