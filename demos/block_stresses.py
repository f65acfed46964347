# %% [markdown]
# # Stresses along an interface before anything slides
#
# A block is pressed evenly. Poisson's ratio makes it wider, the base does not follow, and so the interface carries
# shear without any shear force: to the left on one half, to the right on the other. A shear force on the top then
# shifts that profile, and its torque loads the leading edge and unloads the trailing one. After Ben-David, Cohen and
# Fineberg (Science 330, 2010, Fig. 1).
#
# The shear force ends at a quarter of the normal force: with 0.4 of it the steps found no equilibrium.
#
# Run with `python demos/block_stresses.py`: seconds. The picture is `runs/block_stresses/figures/profiles.png`.

# %%
from pathlib import Path

import numpy as np

from ruptfx import read_case, simulate
from ruptfx.app.script import begin, save, save_numbers
from ruptfx.results.figure_style import TIME_MAP, letter, new_figure, styled

out = Path("runs/block_stresses")
begin(out)
case = read_case(Path(__file__).with_suffix(".toml"))
data = simulate(case, out, overwrite=True).interface.load()
x, length, height = data.position.values, case.mesh.length, case.mesh.height

# %% [markdown]
# Forces from the tractions of the interface; the torque of the shear force about the middle of the base must be carried
# by the normal stress.

# %%
rows = [data.sel(time=time, method="nearest") for time in (1.0, 2.0, 3.0, 4.0, 5.0)]
numbers = {}
for row in rows:
    sigma, tau = row.normal_stress.values, row.shear_traction.values
    F_N, F_S = (float(np.trapezoid(stress, x)) for stress in (sigma, tau))
    torque = float(np.trapezoid(sigma * (x - length / 2), x))
    name = f"F_S/F_N {abs(F_S / F_N):.2f}"  # zero may have either sign
    numbers |= {
        f"{name}, {what} at {1e3 * at:.0f} mm over the mean of sigma": float(np.interp(at, x, stress)) * length / F_N
        for what, stress in (("sigma", sigma), ("tau", tau))
        for at in (10e-3, 190e-3)  # stresses of the corners themselves are the mesh's
    }
    if F_S > 0.05 * F_N:
        numbers[f"{name}: torque of sigma over F_S times the height"] = torque / (F_S * height)
    else:
        numbers["pressed only: symmetric part of tau over its largest value"] = float(
            np.abs(tau + np.interp(length - x, x, tau)).max() / np.abs(2 * tau).max()
        )
save_numbers(out, numbers)


# %%
@styled
def profiles():
    """Normal and shear stress along the interface, for growing shear forces."""
    figure, (axes,) = new_figure(1, 2, 3.0)
    for number, row in enumerate(rows):
        colour, dashes = ("0.4", "--") if number == 0 else (TIME_MAP(number / len(rows)), "-")
        ratio = float(np.trapezoid(row.shear_traction, x) / np.trapezoid(row.normal_stress, x))
        axes[0].plot(1e3 * x, row.normal_stress / 1e6, dashes, color=colour, label=f"{abs(ratio):.2f}")
        axes[1].plot(1e3 * x, row.shear_traction / 1e6, dashes, color=colour)
    for ax, label in zip(axes, ("Normal stress (MPa)", "Shear traction (MPa)"), strict=True):
        ax.set(xlabel="x (mm)", ylabel=label)
        inside = (x > 4e-3) & (x < 196e-3)  # the corners carry more than can be shown
        values = [row["normal_stress" if ax is axes[0] else "shear_traction"].values[inside] / 1e6 for row in rows]
        ax.set_ylim(min(map(np.min, values)) - 0.3, max(map(np.max, values)) + 0.3)
    axes[0].legend(title="$F_S / F_N$")
    axes[1].axhline(0, color="0.7", lw=0.6)
    letter(axes)
    return figure


save(profiles(), out / "figures" / "profiles.png")
