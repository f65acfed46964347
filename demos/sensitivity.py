# %% [markdown]
# # Which part of an interface decides whether a rupture goes supershear
#
# A rupture starts at x = 5 km and runs with nearly the Rayleigh speed, until a daughter crack begins to slip ahead of
# it and goes on faster than shear waves. One backward sweep through the run gives the derivative of the arrival at
# 40 km by the initial shear stress at every point of the interface: it is largest where the daughter crack begins.
#
# Run this file with `python demos/sensitivity.py`; the picture is `gradients/sensitivity/sensitivity.png`.

# %%
from pathlib import Path

import numpy as np

from ruptfx import gradient, read_case, simulate
from ruptfx.app.script import begin, save
from ruptfx.results.figure_style import new_figure, style

OUT = Path("gradients/sensitivity")
begin("runs/sensitivity")
case = read_case(Path(__file__).with_name("sensitivity.toml"))
found = gradient(case)
record = simulate(case, out="runs/sensitivity", overwrite=True)

# %% [markdown]
# Derivatives are by the values at the points. Over the length that a point stands for they are densities, whose
# integral times a change of the stress is the change of the arrival, to first order.

# %%
shear = found["faults.main.initial_stress.shear"]
position, weight = found.position_main.values, found.weight_main.values
density = shear.values / weight
peak = position[np.argmax(np.abs(density))]
print(f"arrival {float(found.objective):.4f} s, {1e6 * shear.attrs['uniform_change']:.3f} s per MPa everywhere")
print(f"most sensitive at x = {1e-3 * peak:.1f} km: {1e9 * density[np.argmax(np.abs(density))]:.3f} s per MPa and km")

# %% [markdown]
# The same small change of stress there and elsewhere: what the gradient says, and two more runs.

# %%
SIZE, HALF = 1e4, 1e3  # Pa, m
centers = (peak, 0.5 * (5e3 + peak))
for center in centers:
    near = np.abs(position - center) <= HALF
    changed = case.changed("faults.main.initial_stress.shear", {
        "kind": "boxcar", "inside": 71e6 + SIZE, "outside": 71e6, "center": float(center), "half_width": HALF,
    })  # fmt: skip
    after = gradient(changed, progress=False)
    computed = float(after.objective - found.objective)
    print(
        f"{1e-6 * SIZE:g} MPa within 1 km of {1e-3 * center:.1f} km: arrival {1e3 * computed:.3f} ms by a run, "
        f"{1e3 * SIZE * shear.values[near].sum():.3f} ms by the gradient"
    )

# %%
with style():
    figure, axes = new_figure(2, 1, 4.4, sharex=True)
    first, second = axes[:, 0]
    data = record.interface.load()
    where, when = data.position.values, data.rupture_time.values
    speeds = next(iter(case.materials.values())).wave_speeds(case.plane)
    first.plot(1e-3 * where, when, "k-", lw=1.2, label="first slip")
    reach = np.array([8e3, 50e3])
    for symbol, speed, dash in (("c_p", speeds.c_p, "--"), ("c_s", speeds.c_s, ":")):
        first.plot(1e-3 * reach, 1.5 + (reach - 8e3) / speed, dash, lw=0.8, color="#1769aa", label=f"${symbol}$")
    first.axvline(1e-3 * peak, color="#c8501e", lw=0.8)
    first.set(ylabel="Time (s)", ylim=(0, None))
    first.legend(frameon=False, loc="upper left")
    second.axhline(0.0, color="0.7", lw=0.6)
    second.plot(1e-3 * position, 1e9 * density, color="#1769aa", lw=1.2)
    second.axvline(1e-3 * peak, color="#c8501e", lw=0.8)
    second.set(xlabel="x (km)", ylabel="Arrival at 40 km by shear stress\n(s per MPa and km)", xlim=(0, 50))
OUT.mkdir(parents=True, exist_ok=True)
save(figure, OUT / "sensitivity.png")
