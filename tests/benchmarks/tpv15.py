"""TPV15: spontaneous rupture on a vertical strike-slip fault with a branch of higher stress, in three dimensions.

SCEC/USGS benchmark: the faults of TPV14, left lateral, 70 MPa of shear stress on the fault and 78 MPa on the branch.
The demo `branch_3d` has nodes 375 m apart, where the benchmark asks for 100 m. The rupture takes the whole branch, and
stops on the fault beyond the junction. No published curve was compared, and no finer mesh.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import ruptfx
from benchmarks._surfaces import Surface, budget, ruptures, spacing
from ruptfx.app.bench import Check

if TYPE_CHECKING:
    from ruptfx.platform.fem import MPI

DEMO = Path(ruptfx.__file__).with_name("demos") / "branch_3d.toml"
SLIP = 0.2  # m
DEPTH = 15e3  # m, of both faults
STOPPED = 6e3  # m, x beyond which the fault stays at rest


def run(fine: bool, comm: MPI.Comm) -> list[Check]:
    del fine
    table = tomllib.loads(DEMO.read_text(encoding="utf-8")) | {"output": {"figures": False}}
    main, branch = ruptures(table, comm, SLIP, ["main", "branch"])
    mesh = spacing(1500.0)
    on_it, behind, last = branch.strike > 0, main.strike < 0, main.strike > STOPPED
    return [
        Check(f"branch, share with 0.2 m of slip, {mesh}", 1.0, _share(branch, on_it), 0.02, "1", "takes it"),
        Check(f"fault to the left of the junction, the same, {mesh}", 1.0, _share(main, behind), 0.02, "1", "takes it"),
        Check(f"fault beyond x = {STOPPED / 1e3:g} km, the same, {mesh}", 0.0, _share(main, last), 0.02, "1", "stops"),
        budget(main, mesh),
    ]  # fmt: skip


def _share(surface: Surface, where: np.ndarray) -> float:
    """Return the share of a part of a fault, above its lower rim, that slips by 0.2 m."""
    part = where & (surface.dip < DEPTH - 1.5e3)
    return float(surface.area[part & np.isfinite(surface.fields["slip_time"])].sum() / surface.area[part].sum())
