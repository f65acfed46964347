# %% [markdown]
# # Slip rate, traction and friction from six strain gauges
#
# A rupture with linear slip weakening passes six gauges beside the interface of two plates. Their signals have noise of
# 2 %. `ruptfx.reconstruct` computes what the interface did, without a friction law, and then fits the law to the
# result. Here the interface of the run that made the signals is known, so that the result can be compared with it.
#
# Run this file with `python demos/reconstruct.py`.

# %%
from pathlib import Path

import numpy as np

from ruptfx import read_case, reconstruct, simulate
from ruptfx.app.script import begin, save, save_numbers
from ruptfx.results.figure_style import RATE_MAP, edges, letter, new_figure, style

OUT, SEED, NOISE = Path("reconstructions/reconstruct_demo"), 1, 0.02
LAW = "faults.main.friction."
TRUTH = {f"{LAW}mu_s": 0.6, f"{LAW}mu_d": 0.3, f"{LAW}D_c": 4e-6}
begin("runs/reconstruct", OUT)
case = read_case(Path(__file__).with_name("reconstruct.toml"))

# %% [markdown]
# ## Data
#
# The run that makes the signals has smaller elements than the reconstruction. `demos/reconstruct.csv` has these numbers
# (to rounding).

# %%
truth = case.changed("mesh.element_size", 5e-4).changed("objective", [])
for key, value in TRUTH.items():
    truth = truth.changed(key, value)
record = simulate(truth, out="runs/reconstruct", overwrite=True)
gauges, grids = [each.name for each in case.instruments], {"extension_1": "45 deg", "extension_2": "135 deg"}
times = np.arange(1, 52) * 3e-7
clean = np.array([
    np.interp(times, record.instruments[gauge].time.values, record.instruments[gauge][grid].values)
    for gauge in gauges for grid in grids
]).T  # fmt: skip
sigma, random = NOISE * np.abs(clean - clean[0]).max(), np.random.default_rng(SEED)
signals = clean + sigma * random.normal(size=clean.shape)
OUT.mkdir(parents=True, exist_ok=True)
names = ["time (us)", *(f"{gauge} {angle} (ue)" for gauge in gauges for angle in grids.values())]
np.savetxt(OUT / "reconstruct.csv", np.column_stack([1e6 * times, 1e6 * signals]), fmt="%.5g", delimiter=", ",
           header=", ".join(names), comments="")  # fmt: skip

# %% [markdown]
# ## Reconstruction

# %%
made = reconstruct(case, OUT / "responses")
print(made.summary()["verdict"])
true, order = record.interface, np.argsort(record.interface.position.values)


def at_knots(name: str) -> np.ndarray:
    """Return a field of the run that made the signals at the times and positions of the result."""
    along = true[name].values[:, order]
    in_time = np.array([np.interp(made.times, true.time.values, row) for row in along.T])
    return np.array([np.interp(made.position, true.position.values[order], row) for row in in_time.T])


rate, slip, traction = (at_knots(name) for name in ("slip_rate", "slip", "shear_traction"))
known = made.known > 0.5
within = np.mean(np.abs(made.mean - rate)[:, known] < made.deviation[:, known])
off = np.sqrt(np.mean((made.curves.slip[0, -1] - slip[-1])[known] ** 2)) / slip[-1].max()
numbers = {"slip rates within bands of 68 %": (100 * within, "%"), "noise": (1e6 * sigma, "ue"),
           "error of the final slip over the largest (RMS)": (100 * off, "%")}  # fmt: skip
for key, value in TRUTH.items():
    low, high = made.law.interval(key.removeprefix(LAW))
    name, unit = key.removeprefix(LAW), made.law.units[key.removeprefix(LAW)]
    numbers |= {f"{name} from": (low, unit), f"{name} to": (high, unit), f"{name}, truth": (value, unit)}
save_numbers(OUT, numbers)

# %%
with style():
    figure, axes = new_figure(1, 3, 3.0, 8, width_ratios=(1, 1, 1))
    inside = np.argsort(made.position)
    grid = edges(1e3 * made.position[inside]), edges(1e6 * made.times)
    for ax, values, title in zip(axes[0], (rate, made.mean), ("made the signals", "reconstructed"), strict=False):
        mesh = ax.pcolormesh(*grid, values[:, inside], cmap=RATE_MAP, vmin=0, vmax=rate.max(), rasterized=True)
        ax.plot([1e3 * each.point[0] for each in case.instruments], 6 * [0.5], "^", color="k", ms=4, clip_on=False)
        ax.set(title=title, xlabel="Position (mm)", ylabel="Time (µs)")
        figure.colorbar(mesh, ax=ax, label="Slip rate (m/s)", location="bottom")
    ax, place = axes[0, 2], made.places[len(made.places) // 2]
    moved = 1e6 * made.curves.slip[0, :, place]
    mean, spread = made.curves.friction[0, :, place], made.curves.deviation(made.curves.friction)[:, place]
    ax.errorbar(moved, mean, spread, 1e6 * made.slip_deviation[:, place], color="#b5382a", lw=1.0, elinewidth=0.4,
                label="reconstructed, 68 %")  # fmt: skip
    ax.plot(1e6 * slip[:, place], traction[:, place] / 6e6, "k--", lw=1.0, label="made the signals")
    ax.set(title=f"{1e3 * made.position[place]:.3g} mm", xlabel="Slip (µm)", ylabel="Friction")
    ax.legend(loc="upper right", fontsize=6)
    letter(axes[0])
save(figure, OUT / "reconstruct.png")
