# %% [markdown]
# # A front as a crack: prediction and run
#
# A rupture begins in the middle of an interface that carries 1 MPa more than its residual strength within 30 mm, and
# 0.2 MPa less beyond. Fracture mechanics says how fast it is at every length and where it stops, from the stress drop
# tau(x) - mu_d sigma(x) and the fracture energy alone.
#
# Run this file with `python demos/stress_barrier.py`; the picture is `runs/stress_barrier/figures/front.png`.

# %%
from pathlib import Path

import numpy as np

from ruptfx import read_case, simulate
from ruptfx.analysis.front import fit_speed
from ruptfx.analysis.front_motion import front_motion
from ruptfx.analysis.near_tip import Medium
from ruptfx.figure_style import new_figure, style
from ruptfx.profiles import evaluate

case = read_case(Path(__file__).with_name("stress_barrier.toml"))
record = simulate(case, out="runs/stress_barrier")

# %% [markdown]
# The prediction. Gamma is half the strength drop times the slip over which it drops.

# %%
fault = case.faults["main"]
law, stress = fault.friction, fault.initial_stress
medium = Medium.of(case.materials["default"], case.plane)
lengths = np.linspace(fault.nucleation[0].radius, 80e-3, 400)
predicted = front_motion(
    lengths,
    stress_drop=lambda x: evaluate(stress.shear, x) - law.mu_d * stress.normal,
    fracture_energy=lambda x: np.full_like(x, 0.5 * (law.mu_s - law.mu_d) * stress.normal * law.D_c),
    medium=medium,
)

# %% [markdown]
# The run: the speed of the front, by straight lines through what slid within 2 mm.

# %%
data = record.interface
ahead = data.position.values > fault.nucleation[0].radius
position, arrival = data.position.values[ahead], data.rupture_time.values[ahead]
places = np.arange(9e-3, np.nanmax(position[np.isfinite(arrival)]) - 1e-3, 1e-3)
speed = [fit_speed(position, arrival, place - 2e-3, place + 2e-3).value for place in places]
stopped = float(position[np.isfinite(arrival)].max())
print(f"it stops at {1e3 * stopped:.1f} mm after {1e6 * np.nanmax(arrival):.0f} us")
print(f"predicted: at {1e3 * predicted.arrest:.1f} mm")

# %%
with style():
    figure, ((ax,),) = new_figure(1, 1, 3.0)
    ax.plot(1e3 * predicted.length, predicted.speed / medium.c_R, "k--", label="equation of motion")
    ax.plot(1e3 * places, np.array(speed) / medium.c_R, "o", ms=3, label="run")
    ax.axvspan(30, 80, color="0.92", lw=0)
    ax.text(78, 0.95, "barrier", ha="right", va="top", color="0.4")
    ax.axvline(1e3 * stopped, color="C0", lw=0.8, ls=":", label="where it stops")
    ax.set(xlabel="Half-length of the rupture (mm)", ylabel="Front speed / $c_R$", xlim=(0, 80), ylim=(0, 1))
    ax.legend(loc="lower left", bbox_to_anchor=(0.12, 0.02))
    figure.savefig(record.path / "figures" / "front.png", dpi=150)
