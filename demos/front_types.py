# %% [markdown]
# # Fast and slow fronts: the local stress decides
#
# In a long block the speed of a front depends on the ratio of shear to normal stress where it passes (Ben-David, Cohen,
# Fineberg 2010). Here a block of 200 mm on a rigid base is loaded to several ratios, with a normal stress that is even
# or falls or rises along the block; static friction is 0.5, 0.55 or 0.6 at random, in cells of 5 mm. The trailing end
# lets go, and the front is timed as it runs along. Constants are ours; friction weakens with slip.
#
# Run with `python demos/front_types.py`: a minute.

# %%
from pathlib import Path

import numpy as np

from ruptfx import read_case, simulate
from ruptfx.app.script import begin, save
from ruptfx.results.analysis.front import local_speed
from ruptfx.results.figure_style import GUIDE, letter, new_figure, remark, styled

CASE = Path(__file__).with_name("front_types.toml")
EVEN = (1.6e6, 1.65e6, 1.7e6, 1.75e6, 1.8e6, 1.9e6, 2.0e6, 2.15e6)  # shear stress under 5 MPa [Pa]
UNEVEN = {"falls": (1.8e6, [5.6e6, 4.4e6]), "rises": (1.8e6, [4.4e6, 5.6e6])}
BEGIN, END, WIDTH = 40e-3, 180e-3, 30e-3  # m: where the front is timed, and over which length
out = Path("runs/front_types")
begin(out)


def timed(name, shear, normal, size=2e-3):
    """Position [m], shear over normal stress and speed [m/s] of the front, where it passes."""
    case = read_case(CASE, overrides=["output.figures=false", "output.bulk_interval=300e-6"])
    table = {"kind": "table", "positions": [0.0, 0.2], "values": normal}
    for key, value in {"initial_stress.normal": table, "initial_stress.shear": shear}.items():
        case = case.changed(f"faults.main.{key}", value)
    record = simulate(case.changed("mesh.element_size", size), out / name, overwrite=True)
    data = record.interface
    x, arrival = data.position.values, data.rupture_time.values
    speed = local_speed(x, arrival, WIDTH)
    here = (x > BEGIN) & (x < END) & np.isfinite(speed)
    return x[here], shear / np.interp(x[here], [0.0, 0.2], normal), speed[here], record


# %%
even = {shear: timed(f"even_{shear / 1e6:g}", shear, [5e6, 5e6]) for shear in EVEN}
uneven = {name: timed(name, *load) for name, load in UNEVEN.items()}
for shear, (x, _, speed, record) in even.items():
    c_R = record.interface.attrs["c_R"]
    reach = 1e3 * x.max() if len(x) else 0.0
    middle = np.median(speed) / c_R if len(x) else np.nan
    print(f"tau / sigma = {shear / 5e6:.2f}: median speed {middle:.2f} c_R, timed up to {reach:.0f} mm")
for name, (x, _, speed, _) in uneven.items():
    print(f"normal stress {name}: timed up to {1e3 * x.max():.0f} mm, {speed.min():.0f} to {speed.max():.0f} m/s")
fine = timed("fine", 1.8e6, [5e6, 5e6], 1e-3)[2]
print(f"0.36 on half the elements: median {np.median(fine):.0f}, before {np.median(even[1.8e6][2]):.0f} m/s")

# %%


@styled
def picture():
    """Speed of the front against position, and against the ratio of the stresses where it passes."""
    figure, (axes,) = new_figure(1, 2, 3.0)
    attrs = even[EVEN[0]][3].interface.attrs
    for number, (shear, (x, ratio, speed, _)) in enumerate(even.items()):
        shade = str(0.75 - 0.75 * number / (len(EVEN) - 1))
        axes[0].plot(x * 1e3, speed, color=shade, lw=0.8, label=f"{shear / 5e6:.2f}")
        axes[1].plot(ratio, speed, ".", color=shade, ms=2)
    for (name, (x, ratio, speed, _)), colour in zip(uneven.items(), ("#b5382a", "#2a6099"), strict=True):
        axes[0].plot(x * 1e3, speed, color=colour, lw=0.8)
        axes[1].plot(ratio, speed, ".", color=colour, ms=2, label=f"normal stress {name} along the block")
    for name, label, side in (("c_R", "$c_R$", "top"), ("c_s", "$c_s$", "bottom"), ("c_p", "$c_l$", "center")):
        for ax in axes:
            ax.axhline(attrs[name], color=GUIDE, ls="--", lw=0.7)
        axes[1].annotate(label, (1.01, attrs[name]), xycoords=("axes fraction", "data"), color=GUIDE, va=side)
    axes[0].set(xlabel="Position (mm)", ylabel="Speed of the front (m/s)", ylim=(0, 2000))
    axes[1].set(xlabel="Shear over normal stress where it passes", ylim=(0, 2000))
    axes[0].legend(title="ratio, even load", ncols=2)
    axes[1].legend(loc="upper left", borderaxespad=0.3)
    letter(axes)
    remark(figure, f"Speeds over {WIDTH * 1e3:.0f} mm. Static friction 0.5, 0.55 or 0.6 at random in cells of 5 mm.")
    return figure


save(picture(), out / "front_types.png")
