# # The shear impact through a polariscope, and the light of its contacts
#
# The first 20 us of `impact.toml` on a coarser mesh, as a camera with pixels of 0.4 mm sees it: isochromatics with
# their orders in a dark and in a light field, what a long exposure leaves of them, isoclinics, contours of the largest
# shear stress, and the real contact area along the interface.
#
# Run this file with `python demos/optical_methods.py`; the picture is `runs/optical_methods/figures/optics.png`.

# %%
from pathlib import Path

import numpy as np

from ruptfx import read_case, simulate
from ruptfx.app.script import begin, save
from ruptfx.results.analysis.contact_light import contact_light
from ruptfx.results.analysis.polariscope import Camera, fringe_orders, max_shear
from ruptfx.results.figure_style import letter, new_figure, styled

begin("runs/optical_methods")
changes = ["duration=20e-6", "mesh.element_size=2e-3", "output.bulk_interval=0.25e-6", "output.figures=false"]
case = read_case(Path(__file__).with_name("impact.toml"), changes)
record = simulate(case, out="runs/optical_methods", overwrite=True)
PIXEL, SHOWN = 0.4e-3, 15e-6  # m, s

# %% [markdown]
# Frames every 5 us; the one at 15 us is shown. The polariser of the plane polariscope stands at 20 degrees.

# %%
cameras = {
    "dark, 0.1 µs": Camera(2e5, 0.1e-6, PIXEL),
    "light, 0.1 µs": Camera(2e5, 0.1e-6, PIXEL, "light"),
    "dark, 4 µs": Camera(2e5, 4e-6, PIXEL),
    "isoclinics at 20°": Camera(2e5, 0.1e-6, PIXEL, "plane", polariser=np.radians(20)),
}
frames = {name: camera.film(record).sel(time=SHOWN, method="nearest") for name, camera in cameras.items()}

# %% [markdown]
# Lines of equal fringe order on the first pictures (9.5 mm of Homalite, 22.6 kN/m: 2.4 MPa per fringe), and contours of
# the largest shear stress in the plane, half a difference of principal stresses.

# %%
orders = fringe_orders(record, PIXEL).sel(time=SHOWN, method="nearest")
shear = 1e-6 * max_shear(record, PIXEL).sel(time=SHOWN, method="nearest")

# %% [markdown]
# Contacts of hardness 0.6 GPa whose area grows by 5 % of itself with every factor e of their age, from 1 us on. The
# pressure that the wave brings brightens them more than slip, which renews them, takes.

# %%
area = contact_light(record, hardness=0.6e9, growth=0.05, cutoff=1e-6)


def name_levels(ax, lines):
    """Labels on the longest line of every level, away from the edges of the plates and from each other."""
    places = []
    for number, level in enumerate(lines.allsegs):
        line = max(level, key=len, default=np.zeros((0, 2)))
        room = line[(line[:, 0] > 4) & (line[:, 1] > 7) & (line[:, 1] < 32)]
        if len(room):
            places.append(room[np.argmin(abs(room[:, 1] - (12, 27, 19)[number % 3]))])
    ax.clabel(lines, fmt="%g", fontsize=6, manual=places)


@styled
def picture():
    """All of it at the time, and the contact light in space and time."""
    figure, axes = new_figure(2, 3, 5.8)
    for ax, (name, frame) in zip(axes.ravel(), frames.items(), strict=False):
        ax.pcolormesh(1e3 * frame.x, 1e3 * frame.y, frame, cmap="gray", vmin=0, vmax=1, rasterized=True)
        ax.set_title(name, loc="right")
    for ax in axes[0, :2]:
        lines = ax.contour(
            1e3 * orders.x, 1e3 * orders.y, orders, np.arange(0.5, float(orders.max()), 0.5), colors="#1769aa",
            linewidths=0.6,
        )  # fmt: skip
        name_levels(ax, lines)
    *optics, stress, light = axes.ravel()
    levels = np.arange(0.25, 4.0, 0.5)  # not the 3 MPa of the initial stress
    lines = stress.contour(1e3 * shear.x, 1e3 * shear.y, shear, levels, cmap="viridis", linewidths=0.8)
    name_levels(stress, lines)
    stress.set_title("largest shear (MPa)", loc="right")
    for ax in (*optics, stress):
        ax.axhline(0, color="#d9480f", lw=0.5)
        ax.set(xlabel="x (mm)", ylabel="y (mm)", xlim=(0, 60), aspect="equal")
    shown = light.pcolormesh(1e3 * area.position, 1e6 * area.time, 100 * area, cmap="inferno", rasterized=True)
    light.set(xlabel="x (mm)", ylabel="Time (µs)", xlim=(0, 60))
    figure.colorbar(shown, ax=light, label="Real contact area (%)")
    light.set_title("contact light", loc="right")
    letter(axes.ravel())
    return figure


Path("runs/optical_methods/figures").mkdir(exist_ok=True)
save(picture(), "runs/optical_methods/figures/optics.png")
print(f"fringe orders up to {float(orders.max()):.3g}, largest shear stress {float(shear.max()):.3g} MPa")
print(f"contact area from {100 * float(area.min()):.3g} to {100 * float(area.max()):.3g} %")
