# %% [markdown]
# # Plates hit symmetrically: fringes without sliding
#
# If the edges of both plates are hit alike, the interface is a line of symmetry: it carries no shear, whatever its
# friction, and two plates are one. Coker, Lykotrafitis, Needleman and Rosakis (2005, Fig. 7) compare computed fringes
# at 16 us (10 MPa, 5 m/s) with fringes of plates that are not pressed and are hit at 58 m/s. Both run here.
#
# Run with `python demos/symmetric_impact.py` (or under `mpirun -n 2`): half a minute. The picture is
# `runs/symmetric_impact/fringes.png`.

# %%
from pathlib import Path

import numpy as np

from ruptfx import simulate
from ruptfx.app.script import begin, save, save_numbers
from ruptfx.case import parse_case, read_toml
from ruptfx.results.analysis.photoelasticity import fringe_order, intensity
from ruptfx.results.analysis.raster import Raster
from ruptfx.results.figure_style import letter, new_figure, remark, styled

CASE, out = Path(__file__).with_name("impact.toml"), Path("runs/symmetric_impact")
LOADINGS = {"10 MPa, 5 m/s": (10e6, 5.0), "not pressed, 58 m/s": (0.0, 58.0)}
AT = 16e-6  # s
begin(out)


def run(name, sigma, speed):
    """The record of two plates whose left edges are driven alike."""
    table = read_toml(CASE)
    (upper,) = table["boundaries"]
    table["boundaries"] = [upper | {"edge": f"{body}.left", "velocity": speed} for body in ("upper", "lower")]
    table["faults"]["main"]["initial_stress"]["normal"] = sigma
    table["duration"] = 17e-6
    table["output"] |= {"bulk_interval": 1e-6, "figures": False}
    return simulate(parse_case(table), out / name, overwrite=True)


records = {title: run(name, *LOADINGS[title]) for title, name in zip(LOADINGS, ("pressed", "free"), strict=True)}

# %% [markdown]
# Slip is zero to rounding, and fringes of the lower plate are the mirror image of those of the upper one.


# %%
def fringe_images(record):
    """Fringe order on a regular grid at `AT`, and the extent of the grid [mm]."""
    bulk, case = record.bulk, record.case
    raster = Raster(bulk["points"].values, bulk["cells"].values)
    stress = bulk["fringe"].sel(time=AT, method="nearest").values
    order = fringe_order(stress, case["materials"]["default"]["fringe_constant"], case["output"]["plate_thickness"])
    return raster(order), [1e3 * value for value in raster.extent]


images = {title: fringe_images(record) for title, record in records.items()}
numbers = {}
for title, record in records.items():
    order, _ = images[title]
    numbers[f"{title}: largest slip"] = (float(np.abs(record.interface.slip).max()), "m")
    numbers[f"{title}: largest shear traction"] = (float(np.abs(record.interface.shear_traction).max()), "Pa")
    numbers[f"{title}: largest fringe order"] = float(np.nanmax(order))
    numbers[f"{title}: asymmetry of the fringes"] = float(np.nanmax(np.abs(order - order[::-1])) / np.nanmax(order))
save_numbers(out, numbers)


# %%
@styled
def fringes():
    """Dark-field pictures of both loadings."""
    figure, (axes,) = new_figure(1, 2, 3.4, sharey=True)
    for ax, (title, (order, extent)) in zip(axes, images.items(), strict=True):
        shown = ax.imshow(intensity(order), origin="lower", extent=extent, cmap="gray", vmin=0, vmax=1)
        ax.axhline(0, color="#d9480f", lw=0.6)
        ax.set(title=title, xlabel="x (mm)", xlim=(0, 60), ylim=(-30, 30), aspect="equal")
    axes[0].set_ylabel("y (mm)")
    figure.colorbar(shown, ax=list(axes), label="Dark-field intensity", shrink=0.8)
    letter(axes)
    remark(figure, f"{1e6 * AT:.0f} µs after the impact on both left edges; red: the interface.")
    return figure


save(fringes(), out / "fringes.png")
