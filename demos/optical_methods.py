# # The shear impact through a polariscope, and the light of its contacts
#
# The first 20 us of `impact.toml` on a coarser mesh, as a camera with pixels of 0.4 mm sees it: isochromatics with
# their orders, what a long exposure leaves of them, isoclinics, and the real contact area along the interface.
#
# Run this file with `python demos/optical_methods.py`; the picture is `runs/optical_methods/figures/optics.png`.

# %%
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from ruptfx import read_case, simulate
from ruptfx.analysis.contact_light import contact_light
from ruptfx.analysis.photoelasticity import principal_difference
from ruptfx.analysis.polariscope import Camera
from ruptfx.analysis.raster import Raster

changes = ["duration=20e-6", "mesh.element_size=2e-3", "output.bulk_interval=0.25e-6", "output.figures=false"]
record = simulate(read_case(Path(__file__).with_name("impact.toml"), changes), out="runs/optical_methods")

# %% [markdown]
# Frames every 5 us; the one at 15 us is shown. The polariser of the plane polariscope stands at 20 degrees.

# %%
cameras = {
    "Isochromatics, 0.1 µs": Camera(2e5, 0.1e-6, 0.4e-3),
    "The same, exposed for 4 µs": Camera(2e5, 4e-6, 0.4e-3),
    "Isoclinics at 20 degrees": Camera(2e5, 0.1e-6, 0.4e-3, "plane", polariser=np.radians(20)),
}
figure = Figure(figsize=(7.2, 6.2), layout="constrained")
axes = figure.subplots(2, 2)
for ax, (name, camera) in zip(axes.ravel(), cameras.items(), strict=False):
    frame = camera.film(record).isel(time=3)
    ax.pcolormesh(1e3 * frame.x, 1e3 * frame.y, frame, cmap="gray", vmin=0, vmax=1, rasterized=True)
    ax.set(title=name, xlabel="x (mm)", ylabel="y (mm)", xlim=(0, 60))
    ax.axhline(0, color="#d9480f", lw=0.5)
    ax.set_aspect("equal")

# %% [markdown]
# Lines of equal fringe order on the first picture: 9.5 mm of Homalite, 22.6 kN/m.

# %%
bulk, case = record.bulk.sel(time=float(frame.time), method="nearest"), record.case
raster = Raster(bulk.points.values, bulk.cells.values, pixels=400)
per_fringe = case["materials"]["default"]["fringe_constant"] / case["output"]["plate_thickness"]
order = principal_difference(*(raster(part) for part in bulk.stress.values.T)) / per_fringe
left, right, bottom, top = raster.extent
places = [1e3 * np.linspace(*ends, n) for ends, n in (((left, right), order.shape[1]), ((bottom, top), order.shape[0]))]
lines = axes[0, 0].contour(*places, order, np.arange(0.5, np.nanmax(order), 0.5), colors="#1769aa", linewidths=0.6)
axes[0, 0].clabel(lines, fmt="%g", fontsize=6)

# %% [markdown]
# Contacts of hardness 0.6 GPa whose area grows by 5 % of itself with every factor e of their age, from 1 us on. The
# pressure that the wave brings brightens them more than slip, which renews them, takes.

# %%
area = contact_light(record, hardness=0.6e9, growth=0.05, cutoff=1e-6)
shown = axes[1, 1].pcolormesh(1e3 * area.position, 1e6 * area.time, 100 * area, cmap="inferno", rasterized=True)
axes[1, 1].set(title="Contact light", xlabel="x (mm)", ylabel="Time (µs)", xlim=(0, 60))
figure.colorbar(shown, ax=axes[1, 1], label="Real contact area (% of the nominal one)")
Path("runs/optical_methods/figures").mkdir(exist_ok=True)
figure.savefig("runs/optical_methods/figures/optics.png", dpi=200)
print(f"contact area from {100 * float(area.min()):.3g} to {100 * float(area.max()):.3g} %")
