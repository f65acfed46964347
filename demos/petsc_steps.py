# %% [markdown]
# # Time steppers of PETSc beside leapfrog
#
# The shear impact of `impact.toml` on shorter plates and a coarser mesh, with native leapfrog steps, with PETSc's TS,
# explicit (`basicsymplectic`, `rk`) and implicit (`alpha2`), and with `generalized_alpha`. Slip, energy closure, number
# of steps and processor time are printed for each.
#
# Run this file with `python demos/petsc_steps.py`, or on two ranks with `mpirun -n 2 python demos/petsc_steps.py`.
# The picture is `runs/petsc_steps/steppers.png`.

# %%
import time
from pathlib import Path

import numpy as np

from ruptfx import read_case, simulate
from ruptfx.app.script import begin, save, save_numbers
from ruptfx.platform import parallel
from ruptfx.platform.fem import MPI
from ruptfx.results.figure_style import new_figure, style

OUT = Path("runs/petsc_steps")
SMALLER = ["order=2", "duration=16e-6", "mesh.length=32e-3", "mesh.height=12e-3", "output.figures=false"]
STEPPERS = {
    "leapfrog": {"kind": "leapfrog"},
    "basicsymplectic": {"kind": "petsc_ts", "scheme": "basicsymplectic"},
    "rk": {"kind": "petsc_ts", "scheme": "rk"},
    "alpha2": {"kind": "petsc_ts", "scheme": "alpha2", "time_step": 1e-7},
    "generalized_alpha": {"kind": "generalized_alpha", "time_step": 1e-7},
}
begin(*(OUT / name for name in STEPPERS), OUT / "steppers.png")
case = read_case(Path(__file__).with_name("impact.toml"), overrides=SMALLER)

# %% [markdown]
# `petsc_ts` makes one step of PETSc's TS at a time, so that records, energies and interrupts are those of all steppers.
# The processor time is that of all ranks, with the model and files.

# %%
records, numbers = {}, {}
for name, stepper in STEPPERS.items():
    begun = time.process_time()
    record = simulate(case.changed("stepper", stepper), out=OUT / name, overwrite=True, progress=False)
    spent = parallel.total(MPI.COMM_WORLD, time.process_time() - begun)
    records[name], slip = record, record.interface.slip.load()
    other = records["leapfrog"].interface.slip.values[-1]
    numbers |= {
        f"{name}: steps": float(record.summary["steps"]),
        f"{name}: largest slip": (float(np.abs(slip.values[-1]).max()), "m"),
        f"{name}: slip less that of leapfrog, over it":
            float(np.linalg.norm(slip.values[-1] - other) / np.linalg.norm(other)),
        f"{name}: energy closure": float(record.summary["energy_closure"]),
    }  # fmt: skip
    print(f"{name}: {spent:.1f} s of processor time")
save_numbers(OUT, numbers)

# %%
with style():
    figure, axes = new_figure(1, 2, 2.8, 8.0)
    for name, record in records.items():
        data = record.interface
        position, end = 1e3 * data.position, 1e6 * data.slip[-1]
        axes[0, 0].plot(position, end, label=name, ls="-" if name == "leapfrog" else "--")
        less = end - 1e6 * records["leapfrog"].interface.slip[-1]
        axes[0, 1].plot(position, less, ls="--" if name in ("rk", "generalized_alpha") else "-")  # on another line
    axes[0, 0].set(xlabel="Position (mm)", ylabel="Slip at the end (µm)")
    axes[0, 1].set(xlabel="Position (mm)", ylabel="Slip less that of leapfrog (µm)")
    axes[0, 0].legend()
save(figure, OUT / "steppers.png")
