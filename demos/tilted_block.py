# %% [markdown]
# # Loading geometry: a block under an inclined plate
#
# A soft block is pressed by 10 N under a rigid plate that is inclined by 0 to 1.17 degrees, as in the experiments of
# Yamaguchi, Sawae and Rubinstein (2016), and then sheared. The inclination decides where it touches; force, contact and
# slip follow. Size, rubber and friction are of our own choice: the lecture prints angles and normal force only. With a
# tenth of V_w and V_star the block slid nearly steadily; these values were chosen so that it sticks and slips. Drops
# below a tenth of the normal force do not count.
#
# Run with `python demos/tilted_block.py`: a minute. The picture is `runs/tilted_block/maps.png`.

# %%
from pathlib import Path

import numpy as np

from ruptfx import read_case, simulate
from ruptfx.app.script import begin, save, save_numbers
from ruptfx.results.analysis.force_drops import drops
from ruptfx.results.figure_style import RATE_MAP, letter, new_figure, remark, styled

ANGLES = (0.0, 0.23, 0.94, 1.06, 1.17)  # degrees
F_N, WIDTH = 10.0, 20e-3  # N, and the width of the block [m]
out = Path("runs/tilted_block")
begin(out)
CASE = Path(__file__).with_suffix(".toml")
mesh, rubber = read_case(CASE).mesh, read_case(CASE).materials["default"]

# %% [markdown]
# The depth of the plate follows from columns that do not support each other, u E / h per area: over the whole length,
# or over the part that touches. The force that comes out is printed.


# %%
def profile(angle):
    """Depth of the plate at both ends [m], the trailing end deeper."""
    slope = np.tan(np.deg2rad(angle))
    stiffness = rubber.young_modulus / mesh.height * WIDTH  # N/m2
    whole = F_N / (stiffness * mesh.length) + slope * mesh.length / 2
    deepest = whole if whole > slope * mesh.length else np.sqrt(2 * F_N * slope / stiffness)
    return deepest, deepest - slope * mesh.length


records = {}
for angle in ANGLES:
    ends = [float(depth / 0.1e-3) for depth in profile(angle)]  # the plate moves by 0.1 mm where the profile is 1
    key = "stages.0.boundaries.0.profile"
    changes = [f'{key}={{kind="table", positions=[0.0, {mesh.length}], values={ends}}}', "output.figures=false"]
    records[angle] = simulate(read_case(CASE, changes), out / f"{angle:g}", overwrite=True).interface.load()

# %% [markdown]
# Forces of the interface, drops of the shear force by more than a tenth of the normal one, and the ratio at the first
# drop and at its largest.

# %%
numbers, forces = {}, {}
for angle, data in records.items():
    x, time = data.position.values, data.time.values
    normal, shear = (WIDTH * np.trapezoid(data[name].values, x, axis=1) for name in ("normal_stress", "shear_traction"))
    forces[angle] = shear
    pressed, ratio = time >= 0.2, shear / np.maximum(normal, 1e-9)
    touching = (data.normal_stress.values > 1.0).mean(axis=1)
    events = drops(time[pressed], shear[pressed], 0.1 * F_N)
    name = f"{angle:g} degrees"
    numbers |= {
        f"{name}: normal force": (float(normal[pressed][0]), "N"),
        f"{name}: touching part": (100 * float(touching[pressed][0]), "%"),
        f"{name}: largest shear over normal force": float(ratio[pressed].max()),
        f"{name}: drops": float(len(events)),
        f"{name}: largest drop": (max((event.size for event in events), default=0.0), "N"),
    }
save_numbers(out, numbers)


# %%
@styled
def maps():
    """Shear force, and contact and slip rate in space and time, for each inclination."""
    figure, axes = new_figure(len(records), 2, 7.6, 7.2, sharex=True)
    for (angle, data), (left, right) in zip(records.items(), axes, strict=True):
        x, time = 1e3 * data.position.values, 1e3 * data.time.values
        left.plot(time, forces[angle], color="black", lw=0.8)
        left.set(ylabel=f"{angle:g}°\n$F_S$ (N)", xlim=(200, time[-1]), ylim=(0, None))
        rate = np.where(data.normal_stress.values > 1.0, np.abs(data.slip_rate.values), np.nan)
        shown = right.pcolormesh(time, x, 1e3 * rate.T, cmap=RATE_MAP, vmin=0, vmax=50, rasterized=True)
        right.set(facecolor="0.8", ylabel="x (mm)", ylim=(0, 1e3 * mesh.length))
    for ax in axes[-1]:
        ax.set_xlabel("Time (ms)")
    figure.colorbar(shown, ax=list(axes[:, 1]), label="Slip rate in contact (mm/s)", extend="max", shrink=0.6)
    letter(axes.ravel())
    remark(figure, "Grey: no contact. The plate moves from 200 ms on.")
    return figure


save(maps(), out / "maps.png")
