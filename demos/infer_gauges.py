# %% [markdown]
# # Slip weakening from strain gauges
#
# A rupture passes three strain gauges 3.5 mm from an interface. Their signals have noise of 5 microstrain.
# `ruptfx.infer` recovers the static coefficient of friction, D_c and the initial stress with intervals of 68 %. The
# fracture energy follows from samples of the posterior: it is known better than the two quantities of which it is the
# product.
#
# Run this file with `python demos/infer_gauges.py`. A run that was stopped goes on where it was.

# %%
from pathlib import Path

import numpy as np

from ruptfx import infer, read_case, simulate
from ruptfx.app.script import begin, save
from ruptfx.results.figure_style import new_figure, style

OUT = Path("inferences/infer_gauges")
NOISE, SEED = 5e-6, 1
MU_S, D_C, SHEAR = "faults.main.friction.mu_s", "faults.main.friction.D_c", "faults.main.initial_stress.shear"
TRUTH = {MU_S: 0.7, D_C: 1.5e-6, SHEAR: 2.6e6}
begin("runs/infer_gauges")
known = read_case(Path(__file__).with_name("infer_gauges.toml"))

# %% [markdown]
# ## Data
#
# Each gauge is a rosette of three grids of 1 mm with a bandwidth of 500 kHz, sampled at 1 MHz. The run that makes the
# data has smaller elements than those of the search.

# %%
gauges, grids = (0.03, 0.04, 0.05), ("extension_1", "extension_2", "extension_3")
known = known.changed("instruments", [
    {"kind": "strain_gauge", "name": f"g{number + 1}", "interval": 5e-7, "point": [x, 3.5e-3], "length": 1e-3,
     "angles": ["45 deg", "90 deg", "135 deg"], "bandwidth": 5e5}
    for number, x in enumerate(gauges)
])  # fmt: skip
truth = known.changed("mesh.element_size", 1e-3)
for key, value in TRUTH.items():
    truth = truth.changed(key, value)
record = simulate(truth, out="runs/infer_gauges", overwrite=True)
times, random = np.arange(2e-6, 63e-6, 1e-6), np.random.default_rng(SEED)
traces = [record.instruments[f"g{number + 1}"] for number in range(len(gauges))]
clean = np.array([[np.interp(times, each.time.values, each[name].values) for name in grids] for each in traces])
data = clean + NOISE * random.normal(size=clean.shape)
case = known.changed("objective", [
    {"kind": "traces", "instrument": f"g{number + 1}", "times": times.tolist(), "sigma": NOISE,
     "data": dict(zip(grids, values.tolist(), strict=True)), "units": dict.fromkeys(grids, "1")}
    for number, values in enumerate(data)
])  # fmt: skip

# %% [markdown]
# ## Inference

# %%
found = infer(case, OUT)
normal, mu_d = 6e6, 0.3


def derived(values: dict[str, np.ndarray | float]) -> dict[str, np.ndarray | float]:
    """Strength drop [Pa], D_c [m], fracture energy [J/m2] and stress drop [Pa]."""
    drop = (values[MU_S] - mu_d) * normal
    return {"strength drop": drop, "D_c": values[D_C], "fracture energy": 0.5 * drop * values[D_C],
            "stress drop": values[SHEAR] - mu_d * normal}  # fmt: skip


samples, true = derived(found.samples), derived(TRUTH)
misfits = [2 * found.runs[number].misfit / found.data for number in found.iterates]
of_truth = np.mean(((data - clean) / NOISE) ** 2)
print(f"misfit over that of noise: {misfits[0]:.3g} -> {misfits[-1]:.3f}; the true signals have {of_truth:.3f}")
print(f"{len(found.runs)} runs; {found.reason}")
for each in found.unknowns:
    low, high = each.interval[:, 0]
    print(f"{each.key}: {each.best[0]:.6g} {each.unit}, 68 % from {low:.6g} to {high:.6g}; truth {TRUTH[each.key]:.6g}")
for name, values in samples.items():
    away, known_to = (values.mean() - true[name]) / values.std(), 100 * values.std() / values.mean()
    print(f"{name}: known to {known_to:.2g} %, {away:+.1f} standard deviations from the truth")
correlation = np.corrcoef(samples["strength drop"], samples["D_c"])[0, 1]
print(f"correlation of strength drop and D_c: {correlation:.4f}")

# %%
with style():
    figure, axes = new_figure(1, 3, 3.0, width_ratios=(1.2, 1, 1))
    fit, trade, widths = axes[0]
    for row, each in enumerate(found.fits):
        hidden = "_" * bool(row)
        fit.plot(1e6 * each.times, 1e6 * each.data - 350 * row, ".", color="0.55", ms=1.5, label=f"{hidden}data")
        fit.plot(1e6 * each.times, 1e6 * each.start - 350 * row, color="0.5", lw=0.7, ls=":", label=f"{hidden}start")
        fit.plot(1e6 * each.times, 1e6 * each.best - 350 * row, color="#b5382a", lw=0.9, label=f"{hidden}fit")
    names = [f"{1e3 * x:.0f} mm, {angle}°" for x in gauges for angle in (45, 90, 135)]
    fit.set_yticks(-350 * np.arange(len(names)), names, fontsize=6)
    fit.plot([6, 6], [-250, 250], color="k", lw=2)
    fit.text(7.5, 100, "500 microstrain", fontsize=6)
    fit.set(xlabel="Time (µs)", xlim=(0, 64))
    fit.legend(ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    drops = np.linspace(1.9e6, 3.2e6, 50)
    for part in (0.95, 1.0, 1.05):
        trade.plot(1e-6 * drops, 2e6 * part * true["fracture energy"] / drops, color="#1769aa", lw=0.7,
                   ls="-" if part == 1 else ":", label="_" * (part != 1) + "same fracture energy, ± 5 %")  # fmt: skip
    trade.plot(1e-6 * samples["strength drop"], 1e6 * samples["D_c"], ".", color="#e0a030", ms=1.5, alpha=0.3,
               label="posterior", rasterized=True)  # fmt: skip
    trade.plot(1e-6 * true["strength drop"], 1e6 * true["D_c"], "k+", ms=9, label="truth")
    trade.set(xlabel="Strength drop (MPa)", ylabel="D_c (µm)", xlim=(1.9, 2.8), ylim=(1.2, 2.0))
    trade.legend(loc="upper right", fontsize=6)
    for place, (name, values) in enumerate(samples.items()):
        low, middle, high = np.quantile(values, [0.16, 0.5, 0.84]) / true[name]
        widths.plot([low, high], [place, place], color="#b5382a", lw=2)
        widths.plot(middle, place, "o", color="#b5382a", ms=4)
    widths.axvline(1.0, color="k", lw=0.8, ls="--")
    widths.set_yticks(range(len(samples)), [name.replace(" ", "\n") for name in samples])
    widths.set(xlabel="68 % interval over the truth", ylim=(len(samples) - 0.5, -0.5))
save(figure, OUT / "infer_gauges.png")
