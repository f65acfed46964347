# # A block that is pressed and pushed, as image correlation would see it
#
# Shear strain E_xy under a normal load, then what a push adds to E_xx without sliding: true, and as pictures of a
# speckled block with noise would show it. The mean error is some 0.005 %; most of the difference is noise.
#
# Run this file with `python demos/pressed_block.py`; the picture is `runs/pressed_block/figures/strains.png`.

# %%
from pathlib import Path

import numpy as np

from ruptfx import read_case, simulate
from ruptfx.app.script import begin
from ruptfx.results.analysis.image_correlation import errors, experiment
from ruptfx.results.figure_style import letter, new_figure, save, style

begin("runs/pressed_block")
record = simulate(read_case(Path(__file__).with_name("pressed_block.toml")), out="runs/pressed_block", overwrite=True)
slipped = float(np.abs(record.interface.slip).max())
base = record.instruments["base"]
print(f"largest slip {slipped:.3g} m; the base carries {float(base.force_y[-1]) / 1e3:.4g} kN/m")

# %% [markdown]
# The platen presses with 20 MPa on 60 mm: 1200 kN/m. Speckles are 4 pixels of 0.25 mm, grey levels have a noise of one
# in 255, subsets and windows for strains 21 pixels, or 5 mm.

# %%
pressed = experiment(record, 0, pixel=0.25e-3, subset=21, noise=1.0)
pushed = experiment(record, 1, pixel=0.25e-3, subset=21, noise=1.0, since=0)
shown = ((pressed, "xy", "pressed"), (pushed, "xx", "added by the push"))
with style():
    figure, axes = new_figure(2, 2, 6.2, 6.6, sharex=True, sharey=True)
    for row, (data, component, when) in zip(axes, shown, strict=True):
        largest = 100 * float(np.nanquantile(np.abs(data[f"true_{component}"]), 0.99))
        for ax, which in zip(row, ("true", "measured"), strict=True):
            picture = ax.pcolormesh(
                1e3 * data.x, 1e3 * data.y, 100 * data[f"{which}_{component}"], cmap="RdBu_r", vmin=-largest,
                vmax=largest, rasterized=True,
            )  # fmt: skip
            ax.axhline(0, color="black", lw=0.5)
            ax.set_title("true" if which == "true" else "by image correlation")
            ax.set_aspect("equal")
        figure.colorbar(picture, ax=row, label=f"$E_{{{component}}}$, {when} (%)", extend="both")
        bias, noise = errors(data, component, np.array([0.0, 2.5e-3, 5e-3, 10e-3, 40e-3]))
        for low, high, b, n in zip((0, 2.5, 5, 10), (2.5, 5, 10, 40), bias, noise, strict=True):
            place = f"{low:4} to {high:4} mm from the interface"
            print(f"E_{component}, {place}: bias {100 * b:7.4f} %, noise {100 * n:.4f} %")
    for ax in axes[-1]:
        ax.set(xlabel="x (mm)", xticks=[0, 25, 50, 75, 100])
    for ax in axes[:, 0]:
        ax.set_ylabel("y (mm)")
    letter(axes.ravel())
save(figure, record.path / "figures" / "strains.png", "png")
