# %% [markdown]
# # What a polariscope shows of rough contact
#
# Two plates are pressed on each other with 3 MPa. Where both are smooth the stress is the same everywhere: one shade.
# Where one is rough by 10 um the load goes through few contacts, from which fringes spread; away from the interface, by
# about the distance of the contacts, the stress is even again.
#
# Run this file with `python demos/contact_fringes.py`; the picture is `runs/contact_fringes/figures/pair.png`.

# %%
from pathlib import Path

import numpy as np

from ruptfx import read_case, simulate
from ruptfx.app.script import begin, save
from ruptfx.results.analysis.photoelasticity import fringe_order, intensity
from ruptfx.results.analysis.raster import Raster
from ruptfx.results.figure_style import letter, new_figure, style

begin("runs/contact_fringes_smooth", "runs/contact_fringes")
path = Path(__file__).with_name("contact_fringes.toml")
records = {
    "smooth": simulate(read_case(path, ["mesh.upper.profile=0.0"]), out="runs/contact_fringes_smooth", overwrite=True),
    "rough": simulate(read_case(path), out="runs/contact_fringes", overwrite=True),
}

# %% [markdown]
# Contact fraction at the end, and largest pressure.

# %%
for name, record in records.items():
    last, pressure = record.forces.isel(time=-1), record.interface.normal_stress.isel(time=-1)
    touches = float(last.sticking + last.sliding)
    print(f"{name}: {100 * touches:.0f} % of the length touches, up to {1e-6 * float(pressure.max()):.0f} MPa")

# %% [markdown]
# The dark field: sin^2 of pi times the fringe order h (sigma_1 - sigma_2) / f.

# %%
case = records["rough"].case
thickness, constant = case["output"]["plate_thickness"], case["materials"]["default"]["fringe_constant"]
with style():
    figure, axes = new_figure(1, 2, 3.2, sharey=True)
    for ax, (name, record) in zip(axes[0], records.items(), strict=True):
        bulk = record.bulk
        raster = Raster(bulk["points"].values, bulk["cells"].values)
        order = fringe_order(raster(bulk["fringe"].isel(time=-1).values), constant, thickness)
        extent = [1e3 * value for value in raster.extent]
        image = ax.imshow(intensity(order), origin="lower", extent=extent, cmap="gray", vmin=0, vmax=1)
        ax.set(title=f"{name}: up to {np.nanmax(order):.1f} fringes", xlabel="x (mm)")
    axes[0, 0].set_ylabel("y (mm)")
    label = f"Dark-field intensity, {1e-6 * constant / thickness:.3g} MPa per fringe"
    figure.colorbar(image, ax=list(axes[0]), label=label)
    letter(axes[0])
save(figure, records["rough"].path / "figures" / "pair.png")
