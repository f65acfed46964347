# %% [markdown]
# # Four sliding modes, two sets of constants
#
# A study of shear impact (Coker, Lykotrafitis, Needleman and Rosakis, J. Mech. Phys. Solids 53, 2005; preprint arXiv
# physics/0406119) shows four modes at four loadings (compression, impact speed). Of the preprint only the abstract
# could be read here; it says that modes depend on "the impact velocity, the initial compressive stress and the values
# of interface variables". One set of constants for all four modes may therefore never have been claimed. Here the
# four loadings run with two sets of our own choice, P1 and P2, and a table says which mode comes out.
#
# Loadings and sets are those of `mode_map.toml`. If you have the paper, add its constants there as a further set:
# this script and `ruptfx study mode_map.toml` both run it.
#
# `python demos/lecture_cases.py` (or under `mpirun -n 2`) takes about a minute and leaves one run directory per case
# in `runs/lecture`, the table `runs/lecture/table.md` and one picture of all cases.

# %%
import tomllib
from pathlib import Path

from ruptfx import read_case, simulate
from ruptfx.app.script import begin, save, save_numbers

HERE, OUT = Path(__file__).parent, Path("runs/lecture")
STUDY = tomllib.loads((HERE / "mode_map.toml").read_text())
*LOADS, CONSTANTS = STUDY["axes"]
SETS = dict(zip(CONSTANTS["labels"], CONSTANTS["values"], strict=True))
LOADINGS = {mark["label"]: mark["point"] for mark in STUDY["marks"]}
PUBLISHED = {"I": "crack", "II": "pulse", "III": "train of pulses", "IV": "pulses into a crack"}
begin(OUT)


def overrides(loading, constants):
    """The keys of `impact.toml` that change from case to case."""
    keys = [axis["key"] for axis in LOADS] + CONSTANTS["key"]
    return [f"{key}={value}" for key, value in zip(keys, [*loading, *constants], strict=True)]


# %% [markdown]
# Run them. A finished case is not run again.

# %%
from ruptfx import Record  # noqa: E402

records = {}
for set_name, constants in SETS.items():
    for case_name, loading in LOADINGS.items():
        path = OUT / f"{set_name}_{case_name}"
        title = f'title="Case {case_name}, set {set_name}: {loading[0] / 1e6:g} MPa, {loading[1]:g} m/s"'
        case = read_case(HERE / STUDY["case"], [title, *overrides(loading, constants)])
        done = (path / "summary.json").exists()
        records[set_name, case_name] = Record(path) if done else simulate(case, path, overwrite=True)

# %% [markdown]
# The table: mode of the slip rate at two thresholds, speed of the leading tip, peak slip rate, closure of the energy.

# %%
lines = [
    "| set | case | Sigma_0, V_imp | published | computed | half threshold | tip / c_l | peak slip rate | closure |",
    "|---|---|---|---|---|---|---|---|---|",
]
for (set_name, case_name), record in records.items():
    found, (sigma, speed) = record.summary, LOADINGS[case_name]
    tip = found["tip_speed_over_c_l"]
    lines.append(
        f"| {set_name} | {case_name} | {sigma / 1e6:g} MPa, {speed:g} m/s | {PUBLISHED[case_name]} | {found['mode']} | "
        f"{found['mode_at_half_threshold']} | {'-' if tip is None else f'{tip:.3f}'} | "
        f"{found['peak_slip_rate']:.3g} m/s | {found['energy_closure']:.1e} |"
    )

numbers = {}
for (set_name, case_name), record in records.items():
    tip = record.summary["tip_speed_over_c_l"]
    numbers[f"{set_name}, case {case_name}: mode"] = record.summary["mode"]
    numbers |= {} if tip is None else {f"{set_name}, case {case_name}: tip over c_l": tip}
save_numbers(OUT, numbers)

# %%
from ruptfx.platform import fem  # noqa: E402

if fem.MPI.COMM_WORLD.rank == 0:
    import matplotlib.pyplot as plt
    import numpy as np
    from matplotlib.colors import LogNorm

    from ruptfx.results.figure_style import RATE_MAP

    (OUT / "table.md").write_text("\n".join(lines) + "\n")
    print("\n".join(lines))
    rows, columns = len(SETS), len(LOADINGS)
    figure, axes = plt.subplots(
        rows, columns, figsize=(12, 3 * rows), sharex=True, sharey=True, layout="constrained", squeeze=False
    )
    for axis, ((set_name, case_name), record) in zip(axes.flat, records.items(), strict=True):
        data, (sigma, speed) = record.interface, LOADINGS[case_name]
        picture = axis.pcolormesh(
            data.position * 1e3, data.time * 1e6, np.maximum(abs(data.slip_rate) / speed, 1e-3), rasterized=True,
            norm=LogNorm(0.01, 10), cmap=RATE_MAP, shading="nearest",
        )  # fmt: skip
        axis.set_title(f"{set_name}  {case_name}: {sigma / 1e6:g} MPa, {speed:g} m/s", fontsize=10)
    for axis in axes[-1]:
        axis.set_xlabel("x (mm)")
    for axis in axes[:, 0]:
        axis.set_ylabel("time (µs)")
    figure.colorbar(picture, ax=axes, label="slip rate / impact speed", extend="both")
    save(figure, OUT / "modes.png")
