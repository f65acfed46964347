"""Parameter studies: one case, axes along which it varies, all points run once, one table and one map.

A study file names a case, axes and what to keep::

    case = "impact.toml"

    [[axes]]
    key = "faults.main.initial_stress.normal"
    name = "Sigma_0"
    range = [0.9e6, 40e6]
    points = 10
    spacing = "log"

    [[axes]]
    key = "boundaries.0.velocity"
    values = [1.0, 2.0, 5.0, 10.0]

``ruptfx study FILE --out map`` runs it on all cores and leaves `table.csv`, `table.nc`, `mode_map.png`,
`mode_map.pdf` and `mode_map.html`; with one axis and named `quantities` also `curves.png` and
`curves.pdf`. A further axis over a seed repeats that with other draws: curves are then medians (`medians.csv`).
A study may be interrupted at any time: the same command continues it and runs only the missing points.

On a cluster: start dask there, point at its scheduler, and keep the study on a file system that all nodes see.
With SLURM::

    #!/bin/bash
    #SBATCH --nodes=4 --ntasks-per-node=1 --cpus-per-task=32
    dask scheduler --scheduler-file scheduler.json &
    # Each thread of a worker starts one run under `mpiexec -n ranks`: threads x ranks = cores of the node.
    srun dask worker --scheduler-file scheduler.json --nworkers 1 --nthreads 32 --no-nanny &
    sleep 10
    address=$(python -c "import json; print(json.load(open('scheduler.json'))['address'])")
    ruptfx study mode_map.toml --out /shared/map --scheduler $address

With SSH ``dask ssh host1 host2 --nworkers 1 --nthreads 8`` starts both; on Kubernetes dask-kubernetes gives the
address.
"""

from ruptfx.many_runs.study.definition import Axis, Point, Study, read_study
from ruptfx.many_runs.study.execute import Outcome, run_study
from ruptfx.many_runs.study.table import read_csv

__all__ = ["Axis", "Outcome", "Point", "Study", "read_csv", "read_study", "run_study"]
