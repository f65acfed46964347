# %% [markdown]
# # Descent from the best sets of a search, with exact gradients
#
# `ruptfx study demos/four_modes_two.toml` searches one set of interface constants that gives four sliding modes. From
# its best sets that differ, this script goes on with the exact gradient of smooth degrees of the modes
# (`kind = "mode_degree"`) by the twelve constants of the friction law; stiffness of the contact, ramp and height of the
# hit edge stay those of the set. Each set is run under all four loadings.
#
# Run this file with `python demos/four_modes_descent.py scores.csv 60`, where `scores.csv` is the result of the search
# and 60 the most minutes. Loadings after them restrict it: `... scores.csv 60 IV`. It writes `descent.csv`, with every
# step, and `best.toml`, a study of the sets before and after on any mesh.

# %%
import csv
import os
import time
from pathlib import Path

import numpy as np
import tomli_w
from scipy.optimize import nnls

from ruptfx import RuptfxError
from ruptfx.app.script import begin, read_number, read_words
from ruptfx.case import Case
from ruptfx.many_runs.adjoint.gradients import Objective
from ruptfx.many_runs.study import read_study
from ruptfx.platform import fem
from ruptfx.readings.misfits import Unknown

HERE = Path(__file__).parent
SETS, APART = 5, 0.1
NEAR, RADIUS = 5, 0.02  # gradients near by, and their distance in parts of the ranges
LEAST = 10.0  # nodes in a zone; with 5 zones at III become narrower than in the start
LENGTHS = (0.08, 0.04, 0.02, 0.01, 0.005, 0.0025)  # of steps that are tried
MODES = {"I": "crack", "II": "pulse", "III": "train", "IV": "pulses_into_crack"}
words = read_words()
SCORES = Path(words[0] if words else "scores.csv")
if not SCORES.is_file():
    raise RuptfxError(f"{SCORES}: is no file; the first argument is the file with the scores of the search")
MINUTES = read_number(words[1], "most minutes", "min") if len(words) > 1 else 60.0
WANTED = words[2:] or list(MODES)
if unknown := set(WANTED) - set(MODES):
    raise RuptfxError(f"{', '.join(sorted(unknown))}: no such loading; there are {', '.join(MODES)}")
OUT = Path("studies/four_modes_descent" + "".join(f"_{each}" for each in words[2:]))
begin(OUT, words=words)
study = read_study(HERE / "four_modes_two.toml")
base = study.base()
axes = [axis for axis in study.sampled if ".friction." in axis.keys[0]]
with SCORES.open(encoding="utf-8") as file:
    rows = list(csv.DictReader(file))
if missing := {"score", *(axis.column for axis in study.sampled)} - set(rows[0] if rows else ()):
    raise RuptfxError(f"{SCORES}: has no column {', '.join(sorted(missing))}; give scores of the study four_modes_two")

# %% [markdown]
# The best sets that differ by at least a tenth of the ranges (root mean square).


# %%
def part(axis, row):
    return axis.part(float(row[axis.column]))


starts = []
for row in sorted(rows, key=lambda row: -float(row["score"])):
    if all(np.sqrt(np.mean([(part(a, row) - part(a, o)) ** 2 for a in study.sampled])) > APART for o in starts):
        starts.append(row)
    if len(starts) == SETS:
        break

# %% [markdown]
# The objective of a loading: one minus the degree of its mode, the mean over both thresholds of the analysis, times
# the width of zones over ten nodes. Its derivative by a part of the range of an axis follows by the chain rule.


# %%
def term(mode, velocity, level):
    # A crack at IV has no derivative towards pulses with a steep step.
    steepness = 1.0 if mode == "pulses_into_crack" else 4.0
    return {
        "kind": "mode_degree", "mode": mode, "threshold": level * velocity, "loaded_end": 0.0, "far_end": 140e-3,
        "spacing": 1e-3, "interval": 1e-6, "least_points": LEAST, "steepness": steepness,
        "weight": 0.5,
    }  # fmt: skip


def evaluate(z, fixed, record=True):
    sample = {axis.column: float(fixed[axis.column]) for axis in study.sampled}
    sample |= {axis.column: axis.value(float(p)) for axis, p in zip(axes, z, strict=True)}
    losses, slope = {}, np.zeros(len(z))
    for values in study.crossed(sample):
        table = study.point(values, table=base).case.table()
        name, velocity = study.axis("loading").coordinate(values["loading"]), values["loading"][1]
        if name not in WANTED:
            continue
        terms = [term(MODES[name], velocity, level) for level in (0.02, 0.01)]
        case = Case.model_validate({**table, "objective": terms})
        try:
            made = Objective(case, case.objective, fem.MPI.COMM_SELF, record=record)
        except RuptfxError as error:
            print(f"{name}: {error}; counts as no mode at all")
            losses[name] = 1.0
            continue
        losses[name] = made.value
        if not record:
            continue
        found = made.gradient([Unknown(key=axis.keys[0], shape="number") for axis in axes])
        for number, (axis, derivative) in enumerate(zip(axes, found, strict=True)):
            low, high = axis.range
            ratio = sample[axis.column] * np.log(high / low) if axis.spacing == "log" else high - low
            slope[number] += float(derivative.values.sum()) * ratio
    return float(np.mean(list(losses.values()))), slope / len(losses), losses, sample


# %% [markdown]
# The degrees are rough functions of the constants: a zone that splits one saved time earlier changes them. A gradient
# at one point is then no direction of descent. Gradient sampling (Burke, Lewis and Overton 2005) takes the shortest
# vector in the convex hull of gradients at points near by, and the first of a few lengths along it that improves.


# %%
def shortest(gradients):
    rows = np.vstack([np.array(gradients).T, 1e3 * np.ones(len(gradients))])
    weights, _ = nnls(rows, np.append(np.zeros(len(rows) - 1), 1e3))
    return weights @ np.array(gradients) / weights.sum()


def write(number, kind, value, losses, slope, sample):
    degrees = [f"{1 - each:.4f}" for each in losses.values()]
    log.writerow([number, kind, f"{value:.6f}", *degrees, f"{np.linalg.norm(slope):.4g}",
                  *(f"{each:.8g}" for each in sample.values())])  # fmt: skip
    file.flush()
    print(f"set {number}, {kind}: loss {value:.4f}, degrees {' '.join(degrees)}", flush=True)


def descend(number, row, until):
    random = np.random.default_rng(number)
    z = np.array([part(axis, row) for axis in axes])
    value, slope, losses, best = evaluate(z, row)
    write(number, "start", value, losses, slope, best)
    radius = RADIUS
    while time.monotonic() < until and radius > RADIUS / 10:
        near = [np.clip(z + radius * random.uniform(-1, 1, len(z)), 0, 1) for _ in range(NEAR)]
        direction = shortest([slope, *(evaluate(each, row)[1] for each in near)])
        unit = direction / max(np.linalg.norm(direction), 1e-12)
        for length in LENGTHS:
            trial = np.clip(z - length * unit, 0, 1)
            if evaluate(trial, row, record=False)[0] < value - 1e-5:
                z = trial
                value, slope, losses, best = evaluate(z, row)
                write(number, "step", value, losses, direction, best)
                break
        else:
            radius /= 3
    return best


# %%
began = time.monotonic()
OUT.mkdir(parents=True, exist_ok=True)
kept, labels = [], []
with (OUT / "descent.csv").open("w", newline="", encoding="utf-8") as file:
    log = csv.writer(file)
    log.writerow(["set", "kind", "loss", *(f"degree_{name}" for name in WANTED), "gradient",
                  *(axis.column for axis in study.sampled)])  # fmt: skip
    for number, row in enumerate(starts, 1):
        after = descend(number, row, began + 60 * MINUTES * number / SETS)
        for name, sample in (("before", row), ("after", after)):
            values = [float(sample[axis.column]) for axis in study.sampled for _ in axis.keys]
            if values not in kept:  # no step improved it
                labels.append(f"{number} {name}")
                kept.append(values)

# %% [markdown]
# A study of these sets: `ruptfx study studies/four_modes_descent/best.toml --set order=4 --set mesh.element_size=2e-3`.

# %%
keys = [key for axis in study.sampled for key in axis.keys]
loading = study.axis("loading").model_dump(mode="json", exclude_none=True, exclude_defaults=True)
together = {"name": "set", "key": keys, "labels": labels, "values": kept}
best_study = {
    "title": "Four modes, before and after a descent", "case": os.path.relpath(study.case, OUT), "keep": [],
    "set": study.set, "quantities": study.quantities, "axes": [together, loading],
}  # fmt: skip
(OUT / "best.toml").write_text(tomli_w.dumps(best_study), encoding="utf-8")
print(f"Files: {OUT}/descent.csv, {OUT}/best.toml")
