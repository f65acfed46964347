# %% [markdown]
# # A block that is pressed and pushed, as image correlation would see it
#
# Shear strain E_xy under a normal load, then what a push adds to E_xx without sliding: true, and as pictures of a
# speckled block with noise would show it. The mean error is some 0.005 %; most of the difference is noise.
#
# Then three specimens of the same size: one block without an interface, two with a rough one, two with a smooth one, at
# 30 % of each load and at all of it.
#
# Run this file with `python demos/pressed_block.py`, also under `mpirun -n 2`.
# Pictures are `strains.png` and `specimens.png` in `runs/pressed_block/figures`.

# %%
from pathlib import Path

import numpy as np

from ruptfx import simulate
from ruptfx.app.script import begin, save, save_numbers
from ruptfx.case import parse_case, read_toml
from ruptfx.results.analysis.image_correlation import errors, experiment
from ruptfx.results.figure_style import letter, new_figure, style

CASE = Path(__file__).with_name("pressed_block.toml")
begin("runs/pressed_block", "runs/pressed_block_single", "runs/pressed_block_rough")
record = simulate(parse_case(read_toml(CASE)), out="runs/pressed_block", overwrite=True)
slipped = float(np.abs(record.interface.slip).max())
base = record.instruments["base"]
print(f"largest slip {slipped:.3g} m; the base carries {float(base.force_y[-1]) / 1e3:.4g} kN/m")

# %% [markdown]
# The platen presses with 20 MPa on 60 mm: 1200 kN/m. Speckles are 4 pixels of 0.25 mm, grey levels have a noise of one
# in 255, subsets and windows for strains 21 pixels, or 5 mm.

# %%
FRAMES = {"first": 0.3, "last": 1.0}  # of each load, which grows for a second


def frames(record, load):
    """Strains by image correlation under the normal load, or what the push adds to them, in both frames."""
    times = record.bulk.time.values
    start = 1.0 if load == "push" else 0.0
    rows = {frame: int(np.argmin(np.abs(times - start - part))) for frame, part in FRAMES.items()}
    since = int(np.argmin(np.abs(times - start))) if load == "push" else None
    return {
        frame: experiment(record, row, pixel=0.25e-3, subset=21, noise=1.0, since=since) for frame, row in rows.items()
    }


smooth = {load: frames(record, load) for load in ("press", "push")}
pressed, pushed = smooth["press"]["last"], smooth["push"]["last"]
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
save(figure, record.path / "figures" / "strains.png")

# %% [markdown]
# The single block has an interface that neither opens nor slips: friction is unlimited, and a stress that bends nothing
# closes it. The rough one touches at its highest crests (0.05 mm RMS, waves of 6 to 25 mm), so that the bodies carry
# the load in columns.


# %%
def specimen(name, fault, **changes):
    """Frames of another specimen."""
    table = read_toml(CASE)
    table["faults"]["main"] |= fault
    del table["instruments"]
    record = simulate(parse_case(table | changes), out=f"runs/pressed_block_{name}", overwrite=True)
    return {load: frames(record, load) for load in ("press", "push")}


body = {"length": 100e-3, "height": 50e-3, "element_size": 2.5e-3, "growth": 1.2}
heights = {"kind": "self_affine", "rms": 50e-6, "hurst": 0.8, "length": 0.1, "longest": 25e-3, "shortest": 6e-3,
           "seed": 3}  # fmt: skip
rough = {"kind": "rough_plates", "upper": body | {"profile": heights}, "lower": body}
specimens = {
    "single": specimen("single", {"initial_stress": {"normal": 200e6}, "contact": {"kind": "split_node"},
                                  "friction": {"kind": "coulomb", "mu_d": 1e3}}),
    "rough": specimen("rough", {"sliding": {}, "initial_stress": {"normal": 0.0},
                                "contact": {"kind": "augmented_lagrangian"}}, mesh=rough, order=2),
    "smooth": smooth,
}  # fmt: skip
LOADS = (("press", "xy"), ("push", "xx"))
scales = {load: 100 * float(np.nanquantile(np.abs(smooth[load]["last"][f"measured_{component}"]), 0.98))
          for load, component in LOADS}  # fmt: skip
numbers = {}
for name, loads in specimens.items():
    for load, component in LOADS:
        near = {frame: data[f"true_{component}"].where(data.distance < 10e-3) for frame, data in loads[load].items()}
        strain = {frame: 100 * float(np.sqrt((values**2).mean())) for frame, values in near.items()}
        numbers |= {f"{name}, {load}, {frame} frame: E_{component}": (value, "%") for frame, value in strain.items()}
save_numbers("runs/pressed_block", numbers)
with style():
    figure, axes = new_figure(3, 4, 5.4, 7.2, sharex=True, sharey=True)
    for row, (name, loads) in zip(axes, specimens.items(), strict=True):
        columns = ((load, component, frame) for load, component in LOADS for frame in FRAMES)
        for ax, (load, component, frame) in zip(row, columns, strict=True):
            data, largest = loads[load][frame], scales[load]
            picture = ax.pcolormesh(
                1e3 * data.x, 1e3 * data.y, 100 * data[f"measured_{component}"], cmap="RdBu_r", vmin=-largest,
                vmax=largest, rasterized=True,
            )  # fmt: skip
            ax.set_aspect("equal")
            if name == "single":
                ax.set_title(f"{'normal load' if load == 'press' else 'push'}, {frame} frame", fontsize=7)
            if frame == "last":
                figure.colorbar(picture, ax=ax, label=f"$E_{{{component}}}$ (%)", extend="both", shrink=0.8)
        row[0].set_ylabel(f"{name}\ny (mm)")
    for ax in axes[-1]:
        ax.set(xlabel="x (mm)", xticks=[0, 50, 100])
save(figure, record.path / "figures" / "specimens.png")
