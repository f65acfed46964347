"""Rough against homogeneous friction of a block that is pressed and sheared: delay of the first slip.

The demo `chamfered_block`, pressed evenly, with static friction of 0.5, 0.55 or 0.6 drawn every 5 mm, and with the
mean of it, 0.545, everywhere. Published in words, without a number: between the delay of the first slip by rough
friction and the coefficient there is a positive relationship (Zhao, FEM/DEM frictional sliding, thesis, University of
Toronto, 2013). Ten draws under `--fine`; else three on elements twice as large. Mesh and loads are ours. Where and
how much the block is pressed is in the case of the demo.
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


def first_slip(friction: str, size: float, comm: fem.MPI.Comm) -> NDArray[np.float64]:
    """Return static friction and time of first slip after the hold [s] of every point; shape (2, points), all ranks."""
    changes = [
        f"faults.main.friction.mu_s={friction}", f"output.rupture_after={HELD}", f"mesh.element_size={size}",
        f"mesh.chamfer={size / 2}", "output.figures=false",
    ]  # fmt: skip
    case = read_case(str(files("ruptfx").joinpath("demos/chamfered_block.toml")), [*changes, *EVEN])
    assert isinstance(case, Case)
    with TemporaryDirectory() as folder:
        out = Path(comm.bcast(folder, root=0)) / "run"
        simulate(case, out, comm, progress=False)
        with Record(out) as record:
            data = record.interface.load()
        comm.Barrier()
    law = case.faults["main"].friction
    return np.array([evaluate(law.mu_s, data.position.values), data.rupture_time.values])  # type: ignore[union-attr]


def correlations(draws: int, size: float, comm: fem.MPI.Comm) -> list[float]:
    """Return the rank correlation of delay and static friction over all points, for every draw."""
    _, even = first_slip(str(MEAN), size, comm)
    drawn = "values=[0.6,0.5,0.55],weights=[30,40,30],cell=5e-3,seed="
    found = []
    for seed in range(1, draws + 1):
        static, rough = first_slip(f'{{kind="random_classes",{drawn}{seed}}}', size, comm)
        slid = np.isfinite(rough) & np.isfinite(even)
        found.append(float(spearmanr((rough - even)[slid], static[slid]).statistic))
    return found


def run(fine: bool, comm: fem.MPI.Comm) -> list[Check]:
    """Run the benchmark; every rank returns the same checks."""
    even = correlations(10 if fine else 3, 4e-3 if fine else 8e-3, comm)
    name = f"delay by rough friction against mu_s, rank correlation: least of {len(even)} draws"
    return [Check(name, 0.0, min(even), 0.0, "1", SOURCE, "at least")]
