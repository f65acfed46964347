"""One rank and two ranks: the files of short runs of the rupture problems agree number by number."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import h5py
import numpy as np
import tomli_w

from benchmarks import bimaterial, tpv101, tpv103, tpv205
from ruptfx import RuptfxError
from ruptfx.app.bench import Check, Outcome
from ruptfx.case import parse_case
from ruptfx.platform import launch

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ruptfx.platform.fem import MPI

TOLERANCE = 1e-9  # round-off, after some hundreds of steps


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    del fine, comm
    problems = {
        "TPV205-2D": {**tpv205.case(400.0, 2.0, 20e3, 10e3)}, "TPV101": {**tpv101.case(200.0), "duration": 2.0},
        "TPV103": {**tpv103.case(200.0), "duration": 2.0}, "bimaterial": bimaterial.case(1e-4, bimaterial.MEMORY, 2e-6),
    }  # fmt: skip
    checks = []
    with tempfile.TemporaryDirectory() as folder:
        for name, table in problems.items():
            table["output"] = {"figures": False}
            path = Path(folder, f"{name}.toml")
            path.write_text(tomli_w.dumps(parse_case(table).table()), encoding="utf-8")
            runs = [Path(folder, f"{name}_{ranks}") for ranks in (1, 2)]
            for ranks, out in zip((1, 2), runs, strict=True):
                if launch.run_on(ranks, ["run", str(path), "--out", str(out), "--quiet"]):
                    raise RuptfxError(f"bench ranks: {name} did not run on {ranks} rank(s)")
            quantity = f"{name}: largest relative difference"
            checks.append(Check(quantity, 0.0, difference(*runs), TOLERANCE, "1", "1 rank against 2"))
    return Outcome(checks, lambda: _draw(list(problems), [check.found for check in checks]))


def _draw(names: list[str], differences: list[float]) -> Figure:
    from ruptfx.results.figure_style import new_figure

    figure, ((ax,),) = new_figure(1, 1, 2.4, 4.5)
    ax.barh(names, np.maximum(differences, 1e-17), height=0.5)
    ax.axvline(TOLERANCE, color="k", ls=":", lw=1)
    ax.set(xscale="log", xlim=(1e-17, 10 * TOLERANCE), xlabel="largest difference of 1 and 2 ranks over largest value")
    return figure


def difference(one: Path, other: Path) -> float:
    """Return the largest difference of all fields of the interface, relative to the largest value of each."""
    worst = 0.0
    with h5py.File(one / "interface.h5") as a, h5py.File(other / "interface.h5") as b:
        for name, data in a.items():
            here, there = data[()], b[name][()]
            if here.dtype.kind != "f" or not np.isfinite(here).any():
                continue
            if here.shape != there.shape or np.any(np.isnan(here) != np.isnan(there)):
                return float("inf")
            scale = np.nanmax(np.abs(here))
            worst = max(worst, float(np.nanmax(np.abs(here - there)) / (scale or 1.0)))
    return worst
