# %% [markdown]
# # Four sliding modes, two sets of constants
#
# The published study of shear impact shows four modes at four loadings (compression, impact speed). Its interface
# constants are not public. Here the four loadings run with two sets of constants, P1 and P2, and a table says which
# mode comes out: nothing is tuned per case.
#
# `python demos/lecture_cases.py` (or under `mpirun -n 2`) takes about a minute and leaves one run directory per case in
# `runs/lecture`, the table `runs/lecture/table.md` and one picture of all eight.

# %%
from pathlib import Path

from ruptfx import read_case, simulate
from ruptfx.app.script import begin

LOADINGS = {"I": (6e6, 2.0), "II": (30e6, 2.0), "III": (10e6, 20.0), "IV": (0.9e6, 10.0)}
PUBLISHED = {"I": "crack", "II": "pulse", "III": "train of pulses", "IV": "pulses into a crack"}
SETS = {
    "P1": {"mu_d": 0.4, "V_1": 29.0, "L_0": 10e-6, "theta_0_initial": 10e-6 / 0.05, "L_p": 40e-6},
    "P2": {"mu_d": 0.1, "V_1": 0.5, "L_0": 2e-6, "theta_0_initial": 2e-6 / 0.05, "L_p": 100e-6},
}
OUT = Path("runs/lecture")
begin(OUT)


def overrides(loading, constants):
    """The keys of `impact.toml` that change from case to case."""
    sigma, speed = loading
    law = {key: value for key, value in constants.items() if key != "L_p"}
    return [
        f"faults.main.initial_stress.normal={sigma}",
        f"boundaries.0.velocity={speed}",
        f"faults.main.friction.L_p={constants['L_p']}",
        *(f"faults.main.friction.law.{key}={value}" for key, value in law.items()),
    ]


# %% [markdown]
# Run them. A finished case is not run again.

# %%
from ruptfx import Record  # noqa: E402

records = {}
for set_name, constants in SETS.items():
    for case_name, loading in LOADINGS.items():
        path = OUT / f"{set_name}_{case_name}"
        title = f'title="Case {case_name}, set {set_name}: {loading[0] / 1e6:g} MPa, {loading[1]:g} m/s"'
        case = read_case(Path(__file__).with_name("impact.toml"), [title, *overrides(loading, constants)])
        done = (path / "summary.json").exists()
        records[set_name, case_name] = Record(path) if done else simulate(case, path, overwrite=True)

# %% [markdown]
# The table: mode of the slip rate at two thresholds, speed of the leading tip, peak slip rate, closure of the energy.

# %%
lines = [
    "| set | case | Sigma_0, V_imp | published | found | half threshold | tip / c_l | peak slip rate | closure |",
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

# %%
from ruptfx.platform import fem  # noqa: E402

if fem.MPI.COMM_WORLD.rank == 0:
    import matplotlib.pyplot as plt
    import numpy as np
    from matplotlib.colors import LogNorm

    from ruptfx.results.figure_style import RATE_MAP

    (OUT / "table.md").write_text("\n".join(lines) + "\n")
    print("\n".join(lines))
    figure, axes = plt.subplots(2, 4, figsize=(12, 6), sharex=True, sharey=True, layout="constrained")
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
    figure.savefig(OUT / "modes.png", dpi=150)
    print(f"picture: {OUT / 'modes.png'}")
