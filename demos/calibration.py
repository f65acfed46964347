# %% [markdown]
# # One set of constants for four sliding modes?
#
# A calibration with nothing but studies. Stage 1 samples the constants widely (`calibration.toml`). Stage 2 samples
# narrowly around the best sets of stage 1. Stage 3 runs good sets on the whole plates for the whole time, stage 4 the
# best of these on meshes twice and four times as fine: a mode that changes with the mesh is not a mode. Every stage
# continues where it stopped when started again.
#
# `python demos/calibration.py` runs more than 2000 short runs, in about half an hour on two cores; the result is
# `studies/calibration/report.md`. `python demos/calibration.py two` does the same with a two-variable memory of the
# normal stress.

# %%
import sys
from collections import defaultdict
from pathlib import Path

from ruptfx.study import Axis, read_study, run_study

TARGET = {"I": "crack", "II": "pulse", "III": "train", "IV": "mixed"}
TWO = sys.argv[1:] == ["two"]
BEST = 4
OUT = Path("studies/calibration_two" if TWO else "studies/calibration")
HERE = Path(__file__).parent
study = read_study(HERE / ("calibration_two.toml" if TWO else "calibration.toml"))
constants = [axis.column for axis in study.axes if axis.column != "loading"]


# %% [markdown]
# A set scores one for every loading whose mode is the published one, times the confidence of the classification. A
# neighbouring mode (a train or a mixture where a pulse is wanted, ...) counts 0.3: it shows the way. Where nodes
# chatter, slip rates grow without limit as the mesh gets finer, and the mode means little. So the score falls with
# the largest slip rate beyond what plane waves can give: twice the impact speed, and 2 mu_s Sigma_0 / (rho c_s) from
# the loss of all strength.

# %%
NEAR = {"pulse": ("train", "mixed"), "train": ("pulse", "mixed"), "mixed": ("train", "pulse"), "crack": ("mixed",)}
LOADINGS = next(axis for axis in study.axes if axis.column == "loading")
PLANE = {name: 2 * speed + 2 * 0.6 * sigma / (1246 * 1255)
         for name, (sigma, speed) in zip(LOADINGS.labels, LOADINGS.values, strict=True)}  # fmt: skip


def score(results):
    """Score of one set from its results by loading."""
    total = 0.0
    for loading, wanted in TARGET.items():
        values = results.get(loading, {}).get("values", {})
        mode, confidence = values.get("mode"), values.get("mode_confidence") or 0.0
        trust = confidence * min(1.0, PLANE[loading] / max(values.get("peak_slip_rate") or 0.0, 1e-9))
        total += trust if mode == wanted else 0.3 * trust * (mode in NEAR[wanted])
    return total


def sets_of(outcome):
    """Results by set of constants and loading, best first: list of (score, constants, results)."""
    groups = defaultdict(dict)
    for point, result in outcome.points:
        names = [name for name in point.coordinates if name != "loading"]
        key = tuple((name, point.coordinates[name]) for name in names)
        groups[key][point.coordinates["loading"]] = result
    scored = [(score(results), dict(key), results) for key, results in groups.items()]
    return sorted(scored, key=lambda item: -item[0])


def hits(results, calm=False):
    """Loadings whose mode is the published one; calm: without slip rates beyond ten times those of plane waves."""
    values = {loading: results.get(loading, {}).get("values", {}) for loading in TARGET}
    right = [loading for loading, wanted in TARGET.items() if values[loading].get("mode") == wanted]
    return sum(not calm or values[k].get("peak_slip_rate", 0.0) <= 10 * PLANE[k] for k in right)


def grid(sets, name, **changes):
    """A study of given sets under the four loadings."""
    keys = [axis.keys[0] for axis in study.axes if axis.column != "loading"]
    values = [[constants_[name] for name in constants] for constants_ in sets]
    axis = Axis(key=keys, name="set", values=values, labels=[f"{name}{i + 1}" for i in range(len(sets))])
    return study.model_copy(update={"axes": [axis, LOADINGS], "sampling": "grid", "samples": None, **changes})


# %% [markdown]
# Stage 1, wide, and one set that an earlier search by differential evolution found to give all four modes on coarse
# meshes, with pulses a few elements wide.

# %%
KNOWN = {
    "V_1": 7.4, "mu_d": 0.256, "L_0": 7.18e-6, "theta_0_initial": 2.258e-5, "A_0": 4.83, "V_0": 1.3, "m": 3.35,
    "L_p": 20.7e-6, "theta_p_ratio": 0.0548, "C_n": 306e9, "C_s": 102e9, "ramp": 1.64e-6, "impact_height": 36e-3,
}  # fmt: skip
first = sets_of(run_study(study, OUT / "wide"))
print(f"stage 1: {len(first)} sets, best score {first[0][0]:.2f}", flush=True)
if not TWO:
    known = run_study(grid([KNOWN], "K"), OUT / "known", show=False)
    results = {point.coordinates["loading"]: result for point, result in known.points}
    first.append((score(results), KNOWN, results))
    print(f"the known set: score {first[-1][0]:.2f}, {hits(results)} modes")


def around(centre, axis, size):
    """The axis, narrowed around a value to a part of its range."""
    if axis.range is None:
        return axis
    low, high = axis.range
    value = centre[axis.column]
    if axis.spacing == "log":
        half = (high / low) ** (size / 2)
        limits = [max(low, value / half), min(high, value * half)]
    else:
        half = (high - low) * size / 2
        limits = [max(low, value - half), min(high, value + half)]
    return Axis(**{**axis.model_dump(exclude_none=True), "range": [float(f"{v:.6g}") for v in limits]})


# %% [markdown]
# Stage 2: hypercubes of a third and an eighth of the size around the best so far.

# %%
everything = list(first)
for size, count in ((0.3, 20), (0.12, 20)):
    for number, (_, centre, _) in enumerate(sorted(everything, key=lambda item: -item[0])[:6]):
        changes = {"axes": [around(centre, axis, size) for axis in study.axes], "samples": count, "seed": number + 2}
        outcome = run_study(study.model_copy(update=changes), OUT / f"narrow_{size:g}_{number}", show=False)
        everything += sets_of(outcome)
        print(f"around set {number}, size {size:g}: best score {max(item[0] for item in everything):.2f}", flush=True)
everything.sort(key=lambda item: -item[0])

# %% [markdown]
# Stage 3: short runs do not tell what dies later. Forty good sets that differ, on whole plates and for 60 us.

# %%
WHOLE = {
    **study.set, "duration": 60e-6, "mesh": {"length": 0.14, "height": 38e-3, "element_size": 2e-3},
    "output": {"bulk_interval": 60e-6, "interface_interval": 0.4e-6}, "boundaries.0.y_range": [0.0, 38e-3],
}  # fmt: skip


def differ(one, other):
    """Distance of two sets in parts of the axes."""
    return sum(axis.distance(one[axis.column], other[axis.column]) ** 2 for axis in study.sampled) ** 0.5


chosen = []
for _, values, _ in everything:
    if len(chosen) < 40 and all(differ(values, other) > 0.13 for other in chosen):
        chosen.append(values)
whole = sets_of(run_study(grid(chosen, "W", set=WHOLE), OUT / "whole"))
whole = [(value, chosen[int(known["set"][1:]) - 1], results) for value, known, results in whole]

# %% [markdown]
# Stage 4: the best of these on finer meshes, nodes 0.25 and 0.125 mm apart.

# %%
fine = {}
for size in (1e-3, 0.5e-3):
    mesh = {**WHOLE, "mesh": {**WHOLE["mesh"], "element_size": size}}
    best = grid([values for _, values, _ in whole[:BEST]], "B", set=mesh, keep=["pictures"])
    outcome = run_study(best, OUT / f"mesh_{size * 1e3:g}mm")
    for point, result in outcome.points:
        fine[point.coordinates["set"], point.coordinates["loading"], size] = result.get("values", {})

# %% [markdown]
# The report: how many sets reach how many modes, and the best ones with the evidence.

# %%
runs = sum(len(results) for _, _, results in everything + whole) + len(fine)
reached = []
for calm in (False, True):
    found = [hits(results, calm) for _, _, results in everything]
    reached.append(", ".join(f"{number} modes: {found.count(number)}" for number in range(4, -1, -1)))
lines = [
    f"{runs} runs, {len(everything)} sets. Sets that reach, at nodes 0.5 mm apart, {reached[0]};",
    f"without slip rates beyond ten times those of plane waves, {reached[1]}.",
    "",
    "Modes at node spacings 0.5 / 0.25 / 0.125 mm, and the ratio of the largest slip rates at the two finer ones.",
    "",
    "| set | score | I: crack | II: pulse | III: train | IV: mixed | peak rate ratio I, II, III, IV |",
    "|---|---|---|---|---|---|---|",
]
for i, (value, _, results) in enumerate(whole[:BEST]):
    cells, ratios = [], []
    for loading in TARGET:
        finer = [fine.get((f"B{i + 1}", loading, size), {}) for size in (1e-3, 0.5e-3)]
        values = [results.get(loading, {}).get("values", {}), *finer]
        cells.append(" / ".join(str(v.get("mode", "failed")) for v in values))
        peaks = [v.get("peak_slip_rate") for v in finer]
        ratios.append(f"{peaks[1] / peaks[0]:.2f}" if all(peaks) else "-")
    lines.append(f"| B{i + 1} | {value:.2f} | {' | '.join(cells)} | {', '.join(ratios)} |")
lines += ["", "| set | " + " | ".join(constants) + " |", "|---" * (len(constants) + 1) + "|"]
for i, (_, values, _) in enumerate(whole[:BEST]):
    lines.append(f"| B{i + 1} | " + " | ".join(f"{values[name]:.4g}" for name in constants) + " |")
(OUT / "report.md").write_text("\n".join(lines) + "\n")
print("\n".join(lines))
