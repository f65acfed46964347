# %% [markdown]
# # Where slip begins in a pressed and sheared block
#
# A block of PMMA, 200 x 50 mm, is pressed on a rigid base, held and sheared by its top, with the constants that a
# thesis prints (Zhao 2013, chapter 4): pressed unevenly, slip begins inside of the block; pressed evenly, at its left
# corner.
# Static friction is 0.85 everywhere, or drawn from 0.70 to 1.00 for every element, as a measure of roughness. With one
# omega, V_w then differs between elements.
#
# Speed and tilt of the press are not printed; the even press is chosen so that slip begins after about 1 ms, as there.
# Numbers are checked by `ruptfx bench thesis_block`.
#
# Run with `python demos/thesis_block.py`: a minute.

# %%
from pathlib import Path

import numpy as np
from scipy.stats import spearmanr

from ruptfx import simulate
from ruptfx.app.bench.thesis_block import LATER, LEFT_FRONT, Onset, block, relaxation, rough
from ruptfx.app.script import begin, save
from ruptfx.results.figure_style import GUIDE, letter, new_figure, remark, styled

out = Path("runs/thesis_block")
begin(out)
UNEVEN, EVEN = {"fronts": LEFT_FRONT}, {"times": LATER}
CASES = {
    "uneven": (block(), UNEVEN), "uneven_rough": (block(rough(1)), UNEVEN),
    "even": (block(even=True), EVEN), "even_rough": (block(rough(1), even=True), EVEN),
}  # fmt: skip

# %%
onsets = {}
for name, (case, moments) in CASES.items():
    onsets[name] = Onset.of(case, simulate(case, out / name, overwrite=True), **moments)
    found = onsets[name]
    printed = "+81 mm" if name.startswith("uneven") else "-95 mm after 1 ms"
    print(f"{name}: first slip at {1e3 * found.origin:+.0f} mm after {1e3 * found.begin:.2f} ms of shearing, "
          f"printed {printed}")  # fmt: skip
even, uneven = onsets["even"], onsets["uneven"]
print(f"unevenly pressed, mean sigma_xx between the fronts, left one at -19 mm: {relaxation(uneven):.2f} of that at "
      "the first slip")  # fmt: skip
places, speeds = even.edge_front()
print(f"evenly pressed, front from the left corner: {speeds[0]:.0f} m/s at {1e3 * places[0]:.0f} mm, "
      f"{speeds[-1]:.0f} m/s at {1e3 * places[-1]:.0f} mm, where another one comes")  # fmt: skip
static, delay = onsets["even_rough"].delay(even)
print(f"rank correlation of mu_s and delay: {spearmanr(static, delay).statistic:.2f}")


# %%
def ratio(stress):
    """Apparent friction coefficient; nothing where the base is hardly pressed."""
    pressed = -stress["yy"]
    return np.where(pressed > 0.02 * np.nanmax(pressed), stress["xy"] / np.maximum(pressed, 1.0), np.nan)


@styled
def pressed_unevenly():
    """Stresses along the base and apparent friction at three times, for both frictions."""
    figure, axes = new_figure(4, 3, 6.6, sharex=True, sharey="row")
    for name, style in (("uneven", "-"), ("uneven_rough", "--")):
        found = onsets[name]
        for column, (stress, time) in enumerate(zip(found.stress, found.times, strict=True)):
            lines = (stress["xy"], stress["xx"], stress["yy"])
            for ax, values in zip(axes[:3, column], lines, strict=True):
                ax.plot(1e3 * found.position, 1e-6 * values, style, color="black", lw=0.9)
            label = r"$\mu_s$ = 0.85" if style == "-" else "rough"
            axes[3, column].plot(1e3 * found.position, ratio(stress), style, color="black", lw=0.9, label=label)
            axes[3, column].step(1e3 * found.position, found.static, style, color="#b03a8a", lw=0.6, where="mid")
            place = (found.origin, *LEFT_FRONT)[column]
            if style == "-":
                axes[0, column].set_title(f"{1e3 * time:.1f} ms, front at {1e3 * place:+.0f} mm", fontsize=7)
                for ax in axes[:, column]:
                    ax.axvline(1e3 * place, color=GUIDE, lw=0.7)
    axes[1, 0].axhline(0, color=GUIDE, lw=0.6, ls=":")
    for ax in axes[1, 1:]:
        ax.axhline(0, color=GUIDE, lw=0.6, ls=":")
    names = (r"$\tau$ (MPa)", r"$\sigma_{xx}$ (MPa)", r"$\sigma_{yy}$ (MPa)", r"$\tau/\sigma$")
    for ax, label in zip(axes[:, 0], names, strict=True):
        ax.set_ylabel(label)
    for ax, limits in zip(axes[:, 0], ((-3, 6), (-4, 1), (-12, 0), (-0.4, 1.1)), strict=True):
        ax.set_ylim(*limits)
    for ax in axes[3]:
        ax.set_xlabel("x from the middle (mm)")
    axes[3, 0].legend(fontsize=6, loc="lower center")
    letter(axes.ravel())
    remark(figure, "Full: one static coefficient; dashed: rough. Blue: left front; pink: static coefficient.")
    return figure


@styled
def pressed_evenly():
    """Shear stress in time, first slip, its delay by roughness, and the speed of the front from the corner."""
    figure, ((stress, arrival), (delayed, speed)) = new_figure(2, 2, 4.6)
    for number, (values, time) in enumerate(zip(even.stress[1:], even.times[1:], strict=True)):
        stress.plot(1e3 * even.position, ratio(values), color=f"C{number}", lw=0.9, label=f"{1e3 * time:.1f} ms")
        rough_values = onsets["even_rough"].stress[1 + number]
        stress.plot(1e3 * even.position, ratio(rough_values), "--", color=f"C{number}", lw=0.6)
    stress.set(xlabel="x from the middle (mm)", ylabel=r"$\tau/\sigma$", ylim=(-0.4, 1.1))
    stress.legend(fontsize=6)
    for name, marker, label in (("even", "o", r"$\mu_s$ = 0.85"), ("even_rough", "x", "rough")):
        arrival.plot(1e3 * onsets[name].position, 1e3 * onsets[name].arrival, marker, ms=2.5, label=label)
    arrival.set(xlabel="x from the middle (mm)", ylabel="First slip (ms)")
    arrival.legend(fontsize=6)
    delayed.plot(static, 1e3 * delay, "o", ms=2.5, color="black")
    delayed.axhline(0, color=GUIDE, lw=0.6, ls=":")
    delayed.set(xlabel=r"$\mu_s$", ylabel="Delay by roughness (ms)")
    speed.plot(1e3 * places, speeds, "o-", ms=2.5, lw=0.7, color="black")
    speed.axhline(820, color=GUIDE, ls="--", lw=0.7)
    speed.annotate("$c_R$", (0.02, 800), xycoords=("axes fraction", "data"), color=GUIDE, va="top")
    speed.set(xlabel="x from the middle (mm)", ylabel="Speed of the front (m/s)", ylim=(0, 900))
    letter([stress, arrival, delayed, speed])
    remark(figure, "(a) dashed: rough; (d) front from the left corner until another one comes.")
    return figure


save(pressed_unevenly(), out / "uneven.png")
save(pressed_evenly(), out / "even.png")
