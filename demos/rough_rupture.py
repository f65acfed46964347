# %% [markdown]
# # A rupture that jumps from contact to contact
#
# Two rough bodies of different materials touch at crests, 0.6 mm apart. When one contact loses its friction, waves run
# through both bodies and make the edges of the next contacts slip, to both sides alike and as fast as the P wave of the
# stiff body; the middle of a contact is skipped, or slips with slower waves. On a smooth interface the fronts to the
# two sides differ. After Di Bartolomeo et al., ESDA2010-25247, Fig. 6a and 7.
#
# Run this file with `python demos/rough_rupture.py`; the picture is `runs/rough_rupture/figures/arrivals.png`.

# %%
from pathlib import Path

import numpy as np

from ruptfx import read_case, simulate
from ruptfx.analysis.asperities import asperities, first_slip
from ruptfx.figure_style import new_figure

FAST = 0.3  # m/s, above what the slow loading leaves
case = read_case(Path(__file__).with_name("rough_rupture.toml"))
record = simulate(case, out="runs/rough_rupture")

# %% [markdown]
# First slip of every point after the nucleation, and the contacts: neighbouring points that are closed then.

# %%
data, patch = record.interface.load(), case.faults["main"].nucleation[0]
time, position = data.time.values, data.position.values
closed = data.normal_stress.sel(time=patch.time, method="nearest").values > 0
after = first_slip(time, data.slip_rate.values, patch.time, FAST) - patch.time
contacts = asperities(position, closed, after)
for contact in contacts:
    edge = np.abs(position[contact.points]) - patch.half_width  # from the edge of the patch
    if contact.center and np.all(edge > 0) and np.isfinite(contact.arrival):
        speed = (edge / after[contact.points])[np.isfinite(after[contact.points])]
        print(
            f"{1e3 * contact.center:6.2f} mm: first slip after {1e6 * contact.arrival:.2f} us, "
            f"{100 * contact.slipped:3.0f} % of its points slip, {speed.max():.0f} to {speed.min():.0f} m/s"
        )

# %%
figure, axes = new_figure(1, 1, 3.2)
ax = axes[0, 0]
for name, material in case.materials.items():
    speeds = material.wave_speeds(case.plane)
    for symbol, speed, style in (("c_p", speeds.c_p, "--"), ("c_s", speeds.c_s, ":")):
        reach = np.linspace(patch.half_width, 3e-3, 2)
        for side in (-1, 1):
            ax.plot(side * 1e3 * reach, 1e6 * (reach - patch.half_width) / speed, style, lw=0.8,
                    color="#1769aa" if name == "upper" else "#c1440e",
                    label=f"${symbol}$ of the {name} body" if side > 0 else None)  # fmt: skip
ax.plot(1e3 * position[~closed], 1e6 * after[~closed], ".", ms=1, color="0.75", label="motion where it is open")
ax.plot(1e3 * position[closed], 1e6 * after[closed], "ko", ms=3, label="first slip of contacts")
ax.set(xlabel="x (mm)", ylabel="Time after the nucleation (µs)", xlim=(-3, 3), ylim=(0, 2))
ax.legend(loc="lower center", ncols=3, bbox_to_anchor=(0.5, 1.0), frameon=False)
figure.savefig(record.path / "figures" / "arrivals.png", dpi=150)
