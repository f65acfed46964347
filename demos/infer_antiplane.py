# %% [markdown]
# # Initial stress of a fault from 30 receivers
#
# A rupture runs along a fault whose initial shear stress varies. 30 receivers, 600 m from the fault and 1 km apart,
# record velocities with 5 % noise. `ruptfx.infer` recovers the stress at 301 points from these data: it begins with
# uniform stress and makes one run and one backward sweep for each step.
#
# Run this file with `python demos/infer_antiplane.py`. A run that was stopped goes on where it was.

# %%
from pathlib import Path

import numpy as np

from ruptfx import infer, read_case, simulate
from ruptfx.app.script import begin, save
from ruptfx.results.figure_style import new_figure, style

OUT = Path("inferences/infer_antiplane")
NOISE, SEED = 0.05, 1
KEY = "faults.main.initial_stress.shear"
begin("runs/infer_antiplane")
known = read_case(Path(__file__).with_name("infer_antiplane.toml"))

# %% [markdown]
# ## Data
#
# The true stress has two hills and a valley. The run that makes the data has smaller elements than those of the search.

# %%
receivers = np.linspace(-14.5e3, 14.5e3, 30)
known = known.changed("instruments", [
    {"kind": "velocimeter", "name": f"r{number + 1}", "interval": 0.02, "point": [float(x), 600.0], "direction": [1.0]}
    for number, x in enumerate(receivers)
])  # fmt: skip


def true_stress(x: np.ndarray) -> np.ndarray:
    """Initial shear stress that makes the data [Pa]."""
    hills = 4e6 * np.exp(-(((x - 6e3) / 2e3) ** 2)) + 3e6 * np.exp(-(((x + 9e3) / 2e3) ** 2))
    return 75e6 + hills - 3e6 * np.exp(-(((x + 4.5e3) / 1.5e3) ** 2))


x = np.linspace(-15e3, 15e3, 601)
truth = known.changed("mesh.element_size", 300.0).changed(
    KEY, {"kind": "table", "positions": x.tolist(), "values": true_stress(x).tolist()}
)
record = simulate(truth, out="runs/infer_antiplane", overwrite=True)
traces = [record.instruments[f"r{number + 1}"] for number in range(len(receivers))]
random = np.random.default_rng(SEED)
times = np.arange(0.02, 4.99, 0.04)
clean = np.array([np.interp(times, each.time.values, each.velocity.values) for each in traces])
sigma = float(NOISE * np.sqrt(np.mean(clean**2)))  # noise over signal, in the mean square
data = clean + sigma * random.normal(size=clean.shape)
case = known.changed("objective", [
    {"kind": "traces", "instrument": f"r{number + 1}", "times": times.tolist(), "sigma": sigma,
     "data": {"velocity": values.tolist()}, "units": {"velocity": "m/s"}}
    for number, values in enumerate(data)
])  # fmt: skip

# %% [markdown]
# ## Inference

# %%
found = infer(case, OUT)
stress = found.unknowns[0]
order = np.argsort(stress.position)
position, best = stress.position[order], stress.best[order]
true = true_stress(position)

# %% [markdown]
# The data see the stress where the rupture came by early enough for its waves to arrive. The error there is relative to
# the part of the stress that the search did not know: the difference of the truth from its start.

# %%
interface = record.interface.load()
arrival = np.interp(position, interface.position.values, interface.rupture_time.values)
seen = arrival < known.duration - 0.5
error = np.sqrt(np.mean((best - true)[seen] ** 2) / np.mean((stress.start[order] - true)[seen] ** 2))
misfits = [2 * found.runs[number].misfit / found.data for number in found.iterates]
of_truth = np.sum(((data - clean) / sigma) ** 2) / found.data
print(f"misfit over that of noise: {misfits[0]:.3g} -> {misfits[-1]:.3f}; the true signals have {of_truth:.3f}")
print(f"{len(found.runs)} forward runs, {len(found.iterates) - 1} iterations; {found.reason}")
print(f"seen: x = {1e-3 * position[seen].min():.1f} to {1e-3 * position[seen].max():.1f} km; error {100 * error:.1f} %")

# %%
with style():
    figure, axes = new_figure(1, 2, 3.4, width_ratios=(1, 1.25))
    (fit, field), size = axes[0], float(np.abs(clean).max())
    for number, each in enumerate(found.fits):
        at, name = 1e-3 * receivers[number], "_" * bool(number)
        fit.plot(each.times, at + 1.3 * each.data / size, ".", color="0.55", ms=1.2, label=f"{name}data")
        fit.plot(each.times, at + 1.3 * each.best / size, color="#b5382a", lw=0.8, label=f"{name}fit")
    fit.set(xlabel="Time (s)", ylabel="Receiver at x (km), velocity", xlim=(0, 5))
    fit.legend(loc="upper center", ncols=2, bbox_to_anchor=(0.5, 1.1))
    km = 1e-3 * position
    field.axvspan(km[seen].min(), km[seen].max(), color="0.95", lw=0)
    field.fill_between(km, 1e-6 * stress.band[0][order], 1e-6 * stress.band[1][order], color="#e0a030", alpha=0.25,
                       lw=0, label="prior")  # fmt: skip
    field.plot(km, 1e-6 * stress.start[order], color="0.5", ls=":", label="start")
    field.plot(km, 1e-6 * true, "k--", label="truth")
    field.plot(km, 1e-6 * best, color="#b5382a", label="recovered")
    field.set(xlabel="x (km)", ylabel="Initial shear stress (MPa)", xlim=(-15, 15), ylim=(70, 82))
    field.legend(ncols=2, loc="upper center")
    inset = field.inset_axes((0.64, 0.14, 0.32, 0.2))
    inset.plot(misfits, "k.-", ms=2.5, lw=0.7)
    inset.axhline(1.0, color="#1769aa", lw=0.8, ls="--")
    inset.set_xlabel("Iteration", fontsize=6, labelpad=1)
    inset.set_title("Misfit over that of noise", fontsize=6, pad=2)
    inset.tick_params(labelsize=5)
save(figure, OUT / "infer_antiplane.png")
