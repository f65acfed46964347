"""Rough against homogeneous friction of a block that is pressed and sheared: delay of the first slip.

The demo `chamfered_block`, pressed evenly and unevenly, with static friction of 0.5, 0.55 or 0.6 drawn every 5 mm, and
with the mean of it, 0.545, everywhere. Published in words: the delay of the first slip by rough friction follows the
coefficient, by a rank correlation above 0.5 when the block is pressed evenly, and does not when it is pressed unevenly
(Zhao, FEM/DEM frictional sliding, thesis, University of Toronto, 2013). Ten draws, and the median of them, under
`--fine`; else three of the even load on elements twice as large, which are asked for the sign only. Mesh and loads are
ours. Where and how much both blocks are pressed is in the case of the demo.
"""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray
from scipy.stats import spearmanr

from ruptfx.app.bench import Check
from ruptfx.case import Case, read_case
from ruptfx.input.profiles import evaluate
from ruptfx.platform import fem
from ruptfx.results.record import Record
from ruptfx.run.simulation import simulate

SOURCE, MEAN = "Zhao (2013), thesis", 0.545
HELD = 1.2e-3  # s: duration of pressing and hold; shearing follows
EVEN = ["stages.0.boundaries.0.profile=1.0"]
ABOUT_ZERO = 0.2  # a rank correlation that explains 4 % of the order


def first_slip(friction: str, load: list[str], size: float, comm: fem.MPI.Comm) -> NDArray[np.float64]:
    """Return static friction and time of first slip after the hold [s] of every point; shape (2, points), all ranks."""
    changes = [
        f"faults.main.friction.mu_s={friction}", f"output.rupture_after={HELD}", f"mesh.element_size={size}",
        f"mesh.chamfer={size / 2}", "output.figures=false",
    ]  # fmt: skip
    case = read_case(str(files("ruptfx").joinpath("demos/chamfered_block.toml")), [*changes, *load])
    assert isinstance(case, Case)
    with TemporaryDirectory() as folder:
        out = Path(comm.bcast(folder, root=0)) / "run"
        simulate(case, out, comm, progress=False)
        with Record(out) as record:
            data = record.interface.load()
        comm.Barrier()
    law = case.faults["main"].friction
    return np.array([evaluate(law.mu_s, data.position.values), data.rupture_time.values])  # type: ignore[attr-defined]


def correlations(draws: int, load: list[str], size: float, comm: fem.MPI.Comm) -> list[float]:
    """Return the rank correlation of delay and static friction over all points, for every draw."""
    _, even = first_slip(str(MEAN), load, size, comm)
    drawn = "values=[0.6,0.5,0.55],weights=[30,40,30],cell=5e-3,seed="
    found = []
    for seed in range(1, draws + 1):
        static, rough = first_slip(f'{{kind="random_classes",{drawn}{seed}}}', load, size, comm)
        slid = np.isfinite(rough) & np.isfinite(even)
        found.append(float(spearmanr((rough - even)[slid], static[slid]).statistic))
    return found


def run(fine: bool, comm: fem.MPI.Comm) -> list[Check]:
    """Run the benchmark; every rank returns the same checks."""
    even = correlations(10 if fine else 3, EVEN, 4e-3 if fine else 8e-3, comm)
    name = "delay by rough friction against mu_s, rank correlation, pressed"
    checks = [Check(f"{name} evenly: least of {len(even)} draws", 0.0, min(even), 0.0, "1", SOURCE, "at least")]
    if not fine:
        return checks
    uneven = correlations(10, [], 4e-3, comm)
    return [
        *checks,
        Check(f"{name} evenly: median", 0.5, float(np.median(even)), 0.0, "1", SOURCE, "at least"),
        Check(f"{name} unevenly: median", 0.0, float(np.median(uneven)), ABOUT_ZERO, "1", SOURCE),
        Check(f"{name} unevenly: median over evenly", 1.0, float(np.median(uneven) / np.median(even)), 0.0, "1", SOURCE,
              "at most"),
    ]  # fmt: skip
