# %% [markdown]
# # Plates have a thickness: plane stress, plane strain, and three dimensions
#
# The shear impact of `demos/impact.toml` in plane stress, in plane strain, and on plates of 9.5 mm thickness in three
# dimensions (`demos/impact_3d.toml`). Plane stress is the limit of waves that are long compared with the thickness; the
# tip of a rupture makes waves of all lengths.
#
# Run with `python demos/impact_3d.py`: two minutes of one core. Another element size is the argument, in m or with its
# unit: with "2 mm", a quarter of a minute, speeds change by 1 m/s and peak slip rates by 0.002 m/s.

# %%
from pathlib import Path

import numpy as np

from ruptfx import simulate
from ruptfx.app.script import begin, read_number, read_words, save
from ruptfx.case import parse_case, read_toml
from ruptfx.results.figure_style import letter, new_figure, remark, styled

GAUGES = (20e-3, 60e-3)  # m, from the driven edge
out = Path("runs/impact_3d")
words = read_words()[:1]
begin(out, words=words)
solid = read_toml(Path(__file__).with_name("impact_3d.toml"))
for word in words:
    size = read_number(word, "element size", "m")
    solid["mesh"]["section"]["element_size"] = size
    solid["mesh"]["layers"] = max(1, round(solid["mesh"]["thickness"] / size))
solid["output"]["figures"] = False


def section(plane):
    """The case in two dimensions: the section of the mesh, without the faces of the plates."""
    driven = [each for each in solid["boundaries"] if not each["edge"].endswith(".back")]
    return {**solid, "plane": plane, "mesh": solid["mesh"]["section"], "boundaries": driven}


cases = {"stress": section("stress"), "strain": section("strain"), "solid": solid}
runs = {name: simulate(parse_case(table), out / name, overwrite=True) for name, table in cases.items()}

# %% [markdown]
# The surface as arrays over position and z, and both lines of it that experiments see: the middle and the face.

# %%
data = runs["solid"].interface
x, z = (np.unique(np.round(data[name].values, 9)) for name in ("x", "z"))
order = np.lexsort((data["z"].values, data["x"].values))


def on_surface(name):
    """A field of the surface, shape (..., x, z)."""
    values = data[name].values[..., order]
    return values.reshape(*values.shape[:-1], len(x), len(z))


time, rate, arrival = data["time"].values, on_surface("slip_rate_1"), on_surface("rupture_time")
share = np.gradient(z) / np.gradient(z).sum()  # of the thickness, at every point across it
lines = {
    "plane stress": ("C0", "-", runs["stress"].interface),
    "plane strain": ("C1", "-", runs["strain"].interface),
}
for _, _, flat in lines.values():
    np.testing.assert_allclose(flat["position"].values, x, atol=1e-9)
found = {
    name: (colour, style, flat["time"].values, flat["slip_rate"].values, flat["rupture_time"].values)
    for name, (colour, style, flat) in lines.items()
}
found |= {
    "plate, middle": ("black", "-", time, rate[:, :, 0], arrival[:, 0]),
    "plate, face": ("black", ":", time, rate[:, :, -1], arrival[:, -1]),
}

# %% [markdown]
# Speed of the tip between 40 and 80 mm, and what the planes get wrong at the gauges.

# %%
inside = (x > 40e-3) & (x < 80e-3)
for name, (_, _, _, values, first) in found.items():
    speed = 1 / np.polyfit(x[inside], first[inside], 1)[0]
    peaks = ", ".join(f"{values[:, np.argmin(abs(x - at))].max():.3f} m/s at {1e3 * at:.0f} mm" for at in GAUGES)
    print(f"{name}: tip {speed:.0f} m/s, peak slip rate {peaks}")
for at in GAUGES:
    column = np.argmin(abs(x - at))
    mean = rate[:, column] @ share
    for name in ("plane stress", "plane strain"):
        _, _, when, values, _ = found[name]
        error = np.interp(time, when, values[:, column]) - mean
        print(f"{1e3 * at:.0f} mm, {name}: RMS difference from the mean over the thickness "
              f"{100 * np.sqrt(np.mean(error**2)) / mean.max():.1f} % of its peak")  # fmt: skip

# %%


@styled
def picture():
    """Delay of the tip, slip rates at the gauges, slip rate on the surface, and slip across the thickness."""
    figure, axes = new_figure(2, 2, 5.2)
    c_l = runs["stress"].interface.attrs["c_p"]
    (front, map_of), (near, far) = axes
    for name, (colour, style, when, values, first) in found.items():
        front.plot(x * 1e3, (first - x / c_l) * 1e6, color=colour, ls=style, label=name)
        for ax, at in zip((near, far), GAUGES, strict=True):
            ax.plot(when * 1e6, values[:, np.argmin(abs(x - at))], color=colour, ls=style)
    front.set(xlim=(0, 90), ylim=(-2.2, 4.5), xlabel="Position (mm)", ylabel="Tip behind a plate wave (µs)")
    front.legend(loc="lower left")
    row = int(np.argmin(abs(time - 30e-6)))
    difference = rate[row] - (rate[row] @ share)[:, None]
    whole = np.concatenate([-z[:0:-1], z])  # both halves of the plate
    shown = map_of.pcolormesh(
        x * 1e3, whole * 1e3, np.hstack([difference[:, :0:-1], difference]).T, cmap="RdBu_r", vmin=-0.05, vmax=0.05,
        shading="gouraud", rasterized=True,
    )  # fmt: skip
    map_of.set(xlim=(0, 65), xlabel="Position (mm)", ylabel="z (mm)", title=f"At {1e6 * time[row]:.0f} µs")
    figure.colorbar(shown, ax=map_of, extend="both", label="Slip rate minus its mean over z (m/s)")
    for ax, at in zip((near, far), GAUGES, strict=True):
        ax.set(xlabel="Time (µs)", ylabel="Slip rate (m/s)", title=f"at {1e3 * at:.0f} mm", ylim=(0, None))
    letter(axes.ravel())
    remark(figure, "Tip: first slip faster than 1 mm/s. The plate is 9.5 mm thick; its middle is z = 0.")
    return figure


save(picture(), out / "impact_3d.png")
