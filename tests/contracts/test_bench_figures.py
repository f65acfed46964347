"""Figures of all benchmarks, found by their names: no label lies on another or is cut off.

Those that take longer than a second to compute are drawn with `-m slow`, seven of them also of made numbers.
"""

from __future__ import annotations

import ast
from collections.abc import Callable
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest
import xarray
from helpers.labels import label_faults
from matplotlib.figure import Figure

from ruptfx.app.bench import OF_THE_MACHINE, Outcome, benchmarks, module_of

pytest.importorskip("dolfinx")

FILES = benchmarks(Path(__file__).parents[1] / "benchmarks")
QUICK = ("waves", "cohesive_opening", "impact_bar")


def draws(path: Path) -> bool:
    """Whether its outcome has a figure: read, as it takes the run to know."""
    tree = ast.parse(path.read_text())
    made = [node for node in ast.walk(tree) if isinstance(node, ast.Call) and ast.unparse(node.func) == "Outcome"]
    return any(len(call.args) > 1 or any(word.arg == "draw" for word in call.keywords) for call in made)


FINE_ONLY = {"smooth_sliding", "tpv14"}  # draw with --fine, which takes a quarter of an hour, and a minute
NAMES = [name for name, path in FILES.items() if name not in (*OF_THE_MACHINE, *FINE_ONLY) and draws(path)]


@pytest.mark.fem
@pytest.mark.parametrize(
    "name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in NAMES]
)
def test_labels_keep_apart(name: str) -> None:
    from ruptfx.platform import fem

    outcome = module_of(FILES[name]).run(False, fem.MPI.COMM_WORLD)
    assert isinstance(outcome, Outcome) and outcome.draw is not None
    figure = outcome.draw()
    figure.set_dpi(150)
    assert label_faults(figure) == []


# -- figures of those that take minutes: the drawing alone, of numbers like theirs -------------------------------------


def bp1() -> Figure:
    from benchmarks import bp1 as bench
    from benchmarks._cycles import Cycles, Profile

    year = bench.YEAR
    times = [float(time) for time in np.linspace(0, 1100, 300) * year]
    speeds = [10.0 ** (-10 + 10 * np.exp(-(((time / year - 550) / 3) ** 2))) for time in times]
    position = np.linspace(0, 40e3, 81)
    profiles = [Profile(time, time * 1e-9 * (1 - position / 80e3), number % 9 == 0)
                for number, time in enumerate(times)]  # fmt: skip
    made = Cycles(position, times=times, speeds=speeds, profiles=profiles)
    return bench._draw(made, made)


def branching() -> Figure:
    from benchmarks import branching as bench
    from benchmarks._broken import Broken

    ends = 1e-3 * np.array([[[x, 0.0], [x + 5, 0.1 * x]] for x in range(0, 45, 5)])
    return bench._draw({kind: Broken({}, ends, np.zeros(1), {}, 0.0) for kind in ("intrinsic", "extrinsic")})


def fronts() -> Figure:
    from benchmarks import fronts as bench
    from ruptfx.results.analysis.energy_release import Moment
    from ruptfx.results.analysis.front_fit import FrontFit, Trace
    from ruptfx.results.analysis.near_tip import mode_II

    none = Moment(*[np.zeros(0)] * 6)
    drawn, time = [], np.linspace(0, 60e-6, 200)
    for label, speed in (("0.10 c_R", 120.0), ("0.95 c_R", 1150.0)):
        found = FrontFit(1.0, 0.1, 3e4, 1e2, speed, 1.0, 0.05, 30e-6, 1e-7, 1e-3, 0.99, 1e-6, 600)
        ahead = 0.05 - found.tip(time)
        field = mode_II(ahead, np.full_like(ahead, 3.5e-3), speed, bench.MEDIUM, 3e4, zone=1e-3)
        trace = Trace(0.05, 3.5e-3, time, {name: getattr(field, name) for name in bench.COMPONENTS})
        drawn.append((label, bench.Passage([trace] * 5, speed, 30e-6, time, time, time, none), found))
    return bench._draw(drawn)


def lumped() -> Figure:
    from benchmarks import lumped as bench

    alpha, few = np.geomspace(0.1, 10, 20), np.array(list(bench.PILOT))
    eps = np.array(list(bench.MODULATION))
    data = xarray.Dataset(
        {"limit_amplitude": ("alpha_fine", 0.1 / alpha),
         "late_amplitude": (("realisation", "alpha"), np.outer([0.9, 1.1], 0.1 / few))},
        {"alpha_fine": alpha, "alpha": few},
    )  # fmt: skip
    load = xarray.Dataset({"mean_change": ("eps", -0.1 * eps), "law": ("eps", -0.11 * eps)}, {"eps": eps})
    with patch.object(bench, "ensembles", lambda: (data, 1.0)), patch.object(bench, "modulation", lambda: load):
        return bench.figure()


def memory() -> Figure:
    from benchmarks import memory as bench

    return bench._draw(1_002_001, [800.0 / ranks for ranks in bench.RANKS])


def ranks() -> Figure:
    from benchmarks import ranks as bench

    return bench._draw(["tpv101", "tpv103", "tpv205", "bimaterial"], [1e-12, 0.0, 3e-15, 2e-13])


def tpv205() -> Figure:
    from benchmarks import tpv205 as bench
    from ruptfx.app.bench._rupture import Rupture

    position, time = np.linspace(-20e3, 20e3, 401), np.linspace(0, 12, 200)
    arrival = np.abs(position) / 3000
    rate = 5 * np.exp(-np.clip(time[:, None] - arrival, 0, None)) * (time[:, None] > arrival)
    run = Rupture(position, time, rate, 0 * rate, {}, 0.0, 1.0, None, None)
    errors = np.outer([1.0, 0.3], [2e-3, 3e-3, 4e-2, 5e-3])
    return bench._draw(run, arrival, {"spacings": [100.0, 50.0], "errors": errors, "own": "own 25 m"})


@pytest.mark.fem
@pytest.mark.parametrize("draw", [bp1, branching, fronts, lumped, memory, ranks, tpv205])
def test_labels_of_long_benchmarks_keep_apart(draw: Callable[[], Figure]) -> None:
    figure = draw()
    figure.set_dpi(150)
    assert label_faults(figure) == []
    assert all(ax.has_data() for ax in figure.axes)
