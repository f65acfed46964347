# %% [markdown]
# # Where granite breaks, how, and between which minerals
#
# Pictures of the runs that a study over the pressure on the sides has kept, after figures 5-3, 5-8 and 5-10 to 5-12 of
# Zhao (2013): events before the first peak of the stress with the five largest, directions of the facets that failed,
# the minerals on their sides; and directions and modes at 10 MPa long after the peak, where pieces must meet.
#
#     ruptfx study demos/granite_confinement.toml --out studies/granite
#     python demos/granite_figures.py
#
# The last command runs one case of its own, tens of minutes long, and leaves the pictures in `studies/granite/figures`.

# %%
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ruptfx import Record, RuptfxError, read_case, simulate
from ruptfx.app.script import begin, save
from ruptfx.many_runs.study import read_csv
from ruptfx.results.analysis.compression import MODES, emission_of, loading
from ruptfx.results.analysis.emission import rose
from ruptfx.results.figure_style import letter, styled
from ruptfx.results.plots.cracks import COLOURS

HERE, STUDY = Path(__file__).parent, Path("studies/granite")
OUT = STUDY / "figures"
PAIRS = [f"{a}-{b}" for a, b in ("bb", "bf", "bq", "ff", "fq", "qq")]  # in the order of the alphabet
MINERALS = {"b": "biotite", "f": "feldspar", "q": "quartz"}
WINDOWS = (0.0, 0.5845e-3, 1.5e-3, 2.5e-3)  # displacement of both platens [m]
SPEED = 0.25  # m/s, of both platens
begin(OUT)


# %% [markdown]
# The runs of the first draw of the minerals, by pressure.

# %%
if not (STUDY / "table.csv").is_file():
    study = HERE / "granite_confinement.toml"
    raise RuptfxError(f"{STUDY}/table.csv: missing; first run: ruptfx study {study} --out {STUDY}")
rows = [row for row in read_csv(STUDY / "table.csv") if row["draw"] == 1]
records = {row["pressure"]: Record(STUDY / "points" / row["point"] / "run") for row in rows}
found = {pressure: emission_of(record) for pressure, record in sorted(records.items())}


def segments(x, y, inclination, length):
    """Facets as lines [mm], shape (n, 2, 2)."""
    middle, angle = 1e3 * np.column_stack([x, y]), np.radians(inclination)
    half = 500 * length[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    return np.stack([middle - half, middle + half], axis=1)


# %% [markdown]
# Events before the first peak, circles as large as their magnitude, in the colour of their mode; a star is the largest,
# black circles are the four next.


# %%
@styled
def maps():
    figure = Figure(figsize=(10.0, 3.7), layout="constrained")
    axes = figure.subplots(1, len(found), sharex=True, sharey=True)
    for ax, (pressure, each) in zip(axes, found.items(), strict=True):
        here, M = each.seismic, each.seismic.magnitude
        lines = segments(each.events.x, each.events.y, each.inclination, each.length)[each.before]
        ax.add_collection(LineCollection(list(lines), colors="#b0b0b0", linewidths=0.5))
        for mode in MODES:
            of = each.mode[each.counted] == mode
            ax.scatter(1e3 * here.x[of], 1e3 * here.y[of], 1 + 6 * np.clip(M[of] + 9, 0, None) ** 1.5,
                       facecolors="none", edgecolors=COLOURS[mode], linewidths=0.5, label=mode)  # fmt: skip
        largest = np.argsort(M)[::-1][:5]
        x, y = 1e3 * here.x[largest], 1e3 * here.y[largest]
        ax.plot(x[1:], y[1:], "o", ms=7, mfc="none", mec="k", mew=0.9)
        ax.plot(x[0], y[0], "*", ms=10, color="k")
        ax.set(aspect="equal", xlim=(-28, 28), ylim=(-55, 55), title=f"{pressure:g} MPa, {len(here)}", xlabel="x (mm)")
        print(f"{pressure:g} MPa, largest events: " + "; ".join(
            f"M {M[i]:.2f} at {1e3 * here.x[i]:.1f}, {1e3 * here.y[i]:.1f} mm" for i in largest))  # fmt: skip
    axes[0].set_ylabel("y (mm)")
    axes[0].legend(fontsize=6, loc="lower left")
    return figure


save(maps(), OUT / "granite_maps.png")


# %% [markdown]
# Directions of the facets that failed before the first peak: length in sectors of 10 degrees, over that of all facets
# in the sector, as a mesh has not the same length of facets in all directions.


# %%
def petals(ax, inclination, length, record):
    """A rose of failed facets over all facets; the other half is its mirror image."""
    data = record.cracks
    along = np.diff(data["points"].values[data["lines"].values], axis=1)[:, 0]
    everywhere = rose(np.degrees(np.arctan2(along[:, 1], along[:, 0])), data["length"].values)[1]
    limits, failed = rose(inclination, length)
    for turn in (0.0, 180.0):
        ax.bar(np.radians(limits[:-1] + turn), 100 * failed / everywhere, np.radians(np.diff(limits)), align="edge",
               color=COLOURS["shear"], edgecolor="white", linewidth=0.4)  # fmt: skip
    ax.yaxis.set_major_locator(MaxNLocator(3))
    ax.set_rlabel_position(0)
    ax.tick_params(labelsize=5)


@styled
def roses():
    figure = Figure(figsize=(10.0, 2.4), layout="constrained")
    axes = figure.subplots(1, len(found), subplot_kw={"projection": "polar"})
    for ax, (pressure, each) in zip(axes, found.items(), strict=True):
        petals(ax, each.inclination[each.before], each.length[each.before], records[pressure])
        ax.set_title(f"{pressure:g} MPa")
    figure.supxlabel("Failed facets by direction, % of the length of all facets of that direction", fontsize=7)
    return figure


save(roses(), OUT / "granite_roses.png")


# %% [markdown]
# Minerals on both sides of what failed before the first peak, as a part of all facets between these minerals; black
# lines: facets that failed at all pressures.


# %%
def pairs_of(record):
    """Minerals on the sides of all facets, as in the events."""
    data = record.cracks
    names = np.array(data.attrs["bodies"])
    return np.array(["-".join(sorted(pair)) for pair in names[data["bodies"].values]])


@styled
def boundaries():
    figure = Figure(figsize=(7.2, 2.8), layout="constrained")
    ax = figure.subplots()
    names = ["-".join(MINERALS[letter] for letter in pair.split("-")) for pair in PAIRS]
    of_all = pairs_of(records[0.0])
    count = np.array([np.sum(of_all == name) for name in names])
    places = [
        {(round(x, 9), round(y, 9)): pair for x, y, pair in zip(
            each.events.x[each.before], each.events.y[each.before],
            records[pressure].events["pair"].values[each.before], strict=True)}
        for pressure, each in found.items()
    ]  # fmt: skip
    common = set.intersection(*(set(each) for each in places))
    always = np.array([sum(places[0][place] == name for place in common) for name in names])
    for number, (pressure, each) in enumerate(zip(found, places, strict=True)):
        failed = np.array([sum(pair == name for pair in each.values()) for name in names])
        ax.bar(np.arange(6) + 0.13 * (number - 2.5), 100 * failed / count, 0.12, label=f"{pressure:g} MPa",
               color=str(0.8 - 0.13 * number))  # fmt: skip
        print(
            f"{pressure:g} MPa, % of facets that failed: "
            + ", ".join(
                f"{name} {part:.2g} ({n})" for name, part, n in zip(names, 100 * failed / count, failed, strict=True)
            )
        )
    ax.hlines(100 * always / count, np.arange(6) - 0.4, np.arange(6) + 0.4, color=COLOURS["tensile"], lw=1.2)
    ax.set_xticks(range(6), [f"{name}\n({n} facets)" for name, n in zip(names, count, strict=True)], fontsize=6)
    ax.set(ylabel="Failed before the first peak (%)")
    ax.legend(fontsize=6, ncols=6, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    print(f"{len(common)} facets failed at all pressures: {dict(zip(names, always.tolist(), strict=True))}")
    return figure


save(boundaries(), OUT / "granite_boundaries.png")


# %% [markdown]
# Far beyond the peak at 10 MPa, on cells of 3 mm: pieces turn and meet others, so that rotations are large and contact
# is that of the potential. Bodies are damped by a force per mass.

# %%
path = OUT / "runs" / "windows"
far = {
    "mesh.element_size": 3e-3, "duration": WINDOWS[-1] / SPEED, "large_rotations": "true",
    "collisions": '{ kind = "potential" }', "damping": "{ mass = 1e5 }", "boundaries.2.traction": [10e6, 0.0],
    "boundaries.3.traction": [-10e6, 0.0], "output.figures": "false", "output.bulk_interval": 1e-3,
    "output.interface_interval": 10e-6,
}  # fmt: skip
if (path / "summary.json").exists():
    late = Record(path)
else:
    case = read_case(HERE / "granite.toml", [f"{key}={value}" for key, value in far.items()])
    late = simulate(case, path, overwrite=True)


@styled
def windows(record):
    each, curve = emission_of(record), loading(record)
    displaced = SPEED * record.events["time_of_failure"].values
    radiates = (each.events.energy > 0) & (each.events.magnitude >= -10)
    figure = Figure(figsize=(9.0, 2.9), layout="constrained")
    left = figure.add_subplot(1, 4, 1)
    left.plot(1e3 * SPEED * curve.time, curve.stress / 1e6, color="#1a1a1a", lw=0.8)
    left.set(xlabel="Displacement of both platens (mm)", ylabel="Stress (MPa)")
    for number, (start, end) in enumerate(pairwise(WINDOWS)):
        here = radiates & (displaced >= start) & (displaced < end)
        shares = [float(np.mean(each.mode[here] == mode)) if here.any() else np.nan for mode in MODES]
        ax = figure.add_subplot(1, 4, 2 + number, projection="polar")
        petals(ax, each.inclination[here], each.length[here], record)
        ax.set_title(f"{1e3 * start:g} to {1e3 * end:g} mm, {here.sum()}\n" + " / ".join(f"{s:.1%}" for s in shares),
                     fontsize=7)  # fmt: skip
        left.axvline(1e3 * start, color="#b0b0b0", lw=0.6)
        print(
            f"{1e3 * start:g} to {1e3 * end:g} mm: {here.sum()} events, "
            + ", ".join(f"{mode} {share:.1%}" for mode, share in zip(MODES, shares, strict=True))
        )
    letter(figure.axes)
    return figure


save(windows(late), OUT / "granite_windows.png")
