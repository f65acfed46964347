# %% [markdown]
# # A rupture that jumps from contact to contact
#
# Two rough bodies of different materials touch at crests, 0.6 mm apart. When one contact loses its friction, waves run
# through both bodies and make the edges of the next contacts slip, to both sides alike and as fast as the P wave of the
# stiff body; the middle of a contact is skipped, or slips with slower waves. On a smooth interface the fronts to the
# two sides differ. After Di Bartolomeo et al., ESDA2010-25247, Fig. 6a and 7.
#
# Run this file with `python demos/rough_rupture.py`; the picture is `runs/rough_rupture/figures/arrivals.png`. With
# `python demos/rough_rupture.py small` the waves are an eighth as long, as in Fig. 6b, on elements of a tenth, and
# there are four times as many: left and right then differ, as on a smooth interface. That takes five minutes.

# %%
from pathlib import Path

import numpy as np

from ruptfx import RuptfxError, simulate
from ruptfx.app.script import begin, read_words, save, save_numbers
from ruptfx.case import parse_case, read_toml
from ruptfx.results.analysis.asperities import asperities
from ruptfx.results.figure_style import new_figure, style

table, name = read_toml(Path(__file__).with_name("rough_rupture.toml")), "rough_rupture"
words = read_words()[:1]
if words not in ([], ["small"]):
    raise RuptfxError(f"{words[0]}: no such waves; the argument is small, or there is none")
if words:
    name = "rough_rupture_small"
    profile = {"kind": "sinusoid", "wavelength": 75e-6}
    plate = {"left": -1.5e-3, "length": 3e-3, "height": 0.75e-3, "element_size": 5e-6}
    for body, side in (("upper", 1), ("lower", -1)):
        table["mesh"][body] |= plate | {"profile": profile | {"mean": side * 1.25e-6, "amplitude": -side * 1.25e-6}}
    # Half as large bodies need half the time to come to rest.
    table["duration"] *= 0.5
    for stage in table["stages"]:
        stage["duration"] *= 0.5
        stage["damping"] = {key: 2 * value if key == "mass" else value for key, value in stage["damping"].items()}
        for boundary in stage["boundaries"]:
            if "ramp" in boundary:
                boundary["ramp"] *= 0.5
    table["faults"]["main"]["nucleation"][0] |= {"half_width": 6.25e-6, "time": 9e-6}
    table["output"] |= {"interface_interval": 0.04e-6, "bulk_interval": 0.25e-6, "bulk_fields": ["velocity"],
                        "rupture_after": 9e-6}  # fmt: skip
begin(f"runs/{name}", words=words)
case = parse_case(table)
record = simulate(case, out=f"runs/{name}", overwrite=True)

# %% [markdown]
# First slip of every point after the nucleation, and the contacts: neighbouring points that are closed then.

# %%
data, patch = record.interface.load(), case.faults["main"].nucleation[0]
position, after = data.position.values, data.rupture_time.values - patch.time
closed = data.normal_stress.sel(time=patch.time, method="nearest").values > 0
contacts = asperities(position, closed, after)
numbers = {}
width = max(contact.width for contact in contacts if abs(contact.center) < patch.half_width)
for contact in contacts:
    edge = np.abs(position[contact.points]) - min(patch.half_width, 0.5 * width)  # from the edge of what has failed
    if np.all(edge > 0) and np.isfinite(contact.arrival):
        speed = (edge / after[contact.points])[np.isfinite(after[contact.points])]
        place = f"contact at {1e3 * contact.center:.2f} mm"
        print(
            f"{place}: first slip after {1e6 * contact.arrival:.3f} us at {100 * contact.slipped:.0f} % of its points"
        )
        numbers |= {f"{place}: fastest front": (speed.max(), "m/s"), f"{place}: slowest front": (speed.min(), "m/s")}
save_numbers(record.path / "figures", numbers)

# %%
with style():
    figure, axes = new_figure(1, 1, 3.2)
    ax, end, last = axes[0, 0], position.max(), 1e6 * (case.duration - patch.time)
    for body, material in case.materials.items():
        speeds = material.wave_speeds(case.plane)
        for symbol, speed, dash in (("c_p", speeds.c_p, "--"), ("c_s", speeds.c_s, ":")):
            reach = np.linspace(patch.half_width, end, 2)
            for side in (-1, 1):
                ax.plot(side * 1e3 * reach, 1e6 * (reach - patch.half_width) / speed, dash, lw=0.8,
                        color="#1769aa" if body == "upper" else "#c1440e",
                        label=f"${symbol}$ of the {body} body" if side > 0 else None)  # fmt: skip
    ax.plot(1e3 * position[closed], 1e6 * after[closed], "ko", ms=2, label="first slip of contacts")
    ax.set(xlabel="x (mm)", ylabel="Time after the nucleation (µs)", xlim=(-1e3 * end, 1e3 * end), ylim=(0, last))
    ax.legend(loc="lower center", ncols=3, bbox_to_anchor=(0.5, 1.0), frameon=False)
save(figure, record.path / "figures" / "arrivals.png")
