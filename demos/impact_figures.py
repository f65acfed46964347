# %% [markdown]
# # What the shear-impact study shows
#
# Four pictures: the modes of all sets of constants side by side; the speed of the leading tip over impact speed and
# compression, from the table of the map; slip and displacement jump along the interface for the four published
# loadings; the fringes of a polariscope 16 us after an impact of 5 m/s at 10 MPa, on an interface that cannot slip and
# on one that does.
#
#     ruptfx study demos/mode_map.toml --out studies/mode_map
#     ruptfx study demos/mode_map_best.toml --out studies/mode_map_best
#     python demos/impact_figures.py
#
# The last command takes a minute and leaves the pictures in `studies/figures`. Runs that exist are not run again.

# %%
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from ruptfx import Record, read_case, simulate
from ruptfx.app.script import begin, save
from ruptfx.many_runs.study import mode_map
from ruptfx.results.analysis.photoelasticity import fringe_order, intensity
from ruptfx.results.analysis.raster import Raster
from ruptfx.results.figure_style import GUIDE, TIME_MAP, letter, styled

HERE, OUT = Path(__file__).parent, Path("studies/figures")
LOADINGS = {"I": (6e6, 2.0), "II": (30e6, 2.0), "III": (10e6, 20.0), "IV": (0.9e6, 10.0)}
begin(OUT)
OUT.mkdir(parents=True, exist_ok=True)


def run(name, sigma, speed, *changes):
    """The record of one loading, run if need be."""
    path = OUT / "runs" / name
    loading = [f"faults.main.initial_stress.normal={sigma}", f"boundaries.0.velocity={speed}", "output.figures=false"]
    case = read_case(HERE / "impact.toml", [*loading, *changes])
    return Record(path) if (path / "summary.json").exists() else simulate(case, path, overwrite=True)


# %% [markdown]
# The modes; and tip speed against impact speed, one line per compression, for the sets of the map. Points without
# sliding, or whose tip has run less than 30 mm, have no speed worth the name.


# %%
@styled
def tip_speeds(table):
    sets = list(dict.fromkeys(row["set"] for row in table))
    figure = Figure(figsize=(3.6 * len(sets), 3.2), layout="constrained")
    axes = figure.subplots(1, len(sets), sharey=True, squeeze=False)[0]
    sigmas = sorted({row["Sigma_0"] for row in table})
    for ax, name in zip(axes, sets, strict=True):
        for k, sigma in enumerate(sigmas):
            line = [r for r in table if r["set"] == name and r["Sigma_0"] == sigma and r["origin"] == "sample"]
            line = [r for r in line if r["tip_speed_over_c_l"] is not None and (r["reach"] or 0) > 30e-3]
            colour = TIME_MAP(k / (len(sigmas) - 1))
            ax.plot([r["V_imp"] for r in line], [r["tip_speed_over_c_l"] for r in line], "o-", ms=3, color=colour,
                    label=f"{sigma / 1e6:g}")  # fmt: skip
        for label, value in (("$\\sqrt{2}\\,c_s$", 0.8063), ("$c_l$", 1.0)):
            ax.axhline(value, color=GUIDE, ls="--", lw=0.8)
            ax.annotate(label, (1, value), (3, 0), xycoords=("axes fraction", "data"), textcoords="offset points",
                        va="center", color=GUIDE, annotation_clip=False)  # fmt: skip
        ax.set(xscale="log", xlabel="Impact speed (m/s)", title=f"set {name}")
        ax.set_xticks([1, 2, 5, 10, 20, 30], ["1", "2", "5", "10", "20", "30"])
        ax.minorticks_off()
    axes[0].set_ylabel("Speed of the leading tip / $c_l$")
    axes[-1].legend(title="Compression (MPa)", loc="upper left", bbox_to_anchor=(1.12, 1))
    letter(axes)
    return figure


maps = []
for name in ("mode_map", "mode_map_best"):
    if Path("studies", name, "table.csv").is_file():
        maps.append(mode_map.read_map(Path("studies", name)))
    else:
        print(f"studies/{name}: missing; first run: ruptfx study demos/{name}.toml --out studies/{name}")
if maps:
    save(mode_map.draw_modes(maps), OUT / "modes.png")
    save(tip_speeds(maps[0].rows), OUT / "tip_speed.png")

# %% [markdown]
# Slip (lines) and displacement jump (dashes) every 10 us, set P1. The jump is the slip and the elastic stretch of the
# compliant interface, tau / C_s.


# %%
@styled
def slip_and_jump(records):
    figure = Figure(figsize=(7, 4.6), layout="constrained")
    axes = figure.subplots(2, 2, sharex=True).ravel()
    for ax, (name, record) in zip(axes, records.items(), strict=True):
        data, (sigma, speed) = record.interface, LOADINGS[name]
        for time in np.arange(10, 61, 10) * 1e-6:
            row = data.sel(time=time, method="nearest")
            colour, sign = TIME_MAP(time / 60e-6), np.sign(data.slip[-1].sum()) or 1.0
            ax.plot(data.position * 1e3, sign * row.slip * 1e6, color=colour, label=f"{time * 1e6:.0f} µs")
            ax.plot(data.position * 1e3, sign * row.displacement_jump * 1e6, "--", color=colour, lw=0.7)
        ax.set_title(f"{name}: {sigma / 1e6:g} MPa, {speed:g} m/s")
        ax.set_ylim(bottom=min(0, ax.get_ylim()[0]))
    for ax in axes[2:]:
        ax.set_xlabel("x (mm)")
    for ax in axes[::2]:
        ax.set_ylabel("Slip, jump (µm)")
    axes[1].legend(loc="upper right", title="slip; dashed: jump;\nboth in the direction of slip")
    letter(axes)
    return figure


records = {name: run(f"case_{name}", *loading) for name, loading in LOADINGS.items()}
save(slip_and_jump(records), OUT / "slip_and_jump.png")

# %% [markdown]
# The fringes. The front in the upper plate runs at c_l and is the same in both: it comes from the impact. Where the
# interface slips it carries less shear, so the fringes that cross it bend less and the lower plate is loaded less; a
# faint straight line runs back from the tip into the lower plate: the tip outruns the shear waves.


# %%
@styled
def fringes(pair):
    figure = Figure(figsize=(7, 3.4), layout="constrained")
    axes = figure.subplots(1, 2, sharey=True)
    for ax, (title, record) in zip(axes, pair.items(), strict=True):
        bulk, case = record.bulk, record.case
        constant, thickness = case["materials"]["default"]["fringe_constant"], case["output"]["plate_thickness"]
        raster = Raster(bulk["points"].values, bulk["cells"].values)
        order = fringe_order(bulk["fringe"].sel(time=16e-6, method="nearest").values, constant, thickness)
        extent = [value * 1e3 for value in raster.extent]
        shown = ax.imshow(intensity(raster(order)), origin="lower", extent=extent, cmap="gray", vmin=0, vmax=1)
        ax.axhline(0, color="#d9480f", lw=0.6)
        ax.set(title=title, xlabel="x (mm)", xlim=(0, 60), ylim=(-30, 30))
    axes[0].set_ylabel("y (mm)")
    per_fringe = f"{constant / thickness / 1e6:.3g} MPa per fringe"
    figure.colorbar(shown, ax=axes, label=f"Dark-field intensity; {per_fringe}", shrink=0.8)
    letter(axes)
    return figure


early = ["duration=17e-6", "output.bulk_interval=1e-6"]
stuck = 'faults.main.friction={kind="coulomb", mu_d=1e3}'
pair = {"no sliding": run("stuck", 10e6, 5.0, *early, stuck), "sliding, set P1": run("sliding", 10e6, 5.0, *early)}
save(fringes(pair), OUT / "fringes.png")
