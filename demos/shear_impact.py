# %% [markdown]
# # A shear-impact rupture in ten lines
#
# Two Homalite-100 plates are pressed together by Sigma_0. The left edge of the upper plate is driven at V_imp; a
# stress wave runs along the interface faster than its shear waves, and the interface slips behind it.
#
# Run this file with `python demos/shear_impact.py`, or on two ranks with `mpirun -n 2 python demos/shear_impact.py`.

# %%
from pathlib import Path

from ruptfx import read_case, simulate
from ruptfx.app.script import begin
from ruptfx.results import plots

begin("runs/shear_impact")
case = read_case(
    Path(__file__).with_name("impact.toml"),
    overrides=["faults.main.initial_stress.normal=6e6", "boundaries.0.velocity=2.0"],  # Pa, m/s
)
record = simulate(case, out="runs/shear_impact", overwrite=True)

# %% [markdown]
# The run directory `runs/shear_impact` now holds the data and the standard figures. The record opens them as labelled
# arrays with units, on any machine, with or without DOLFINx. Modes and speeds that are the
# mesh's are `not resolved`; the summary says why, and gives no speed.

# %%
summary = record.summary
slip_rate = record.interface.slip_rate
print(record)
print(f"sliding mode: {summary['mode']}")
if summary["tip_speed"] is None:
    print(f"leading tip:  no speed, {summary['not_resolved'] or 'it did not run'}")
else:
    print(f"leading tip:  {summary['tip_speed']:.0f} m/s, {summary['tip_speed_over_c_s']:.2f} c_s")
print(f"peak slip rate at 30 mm: {float(slip_rate.sel(position=30e-3, method='nearest').max()):.2f} m/s")

# %% [markdown]
# The energy budget closes to round-off: the work of the driven edge and of the initial stress is the kinetic, strain
# and interface energy plus frictional dissipation.

# %%
print(f"energy not accounted for: {summary['energy_closure']:.1e} of the work")

# %% [markdown]
# Any of the standard figures can be drawn again, into axes of yours, too, and changed like every Matplotlib figure.
# Under MPI only one rank should draw; `simulate` has already saved the standard set.

# %%
axes = plots.space_time(record)
axes.set_title("Slip rate along the interface")
print(f"pictures: {record.path / 'figures'}")
