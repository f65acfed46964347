# %% [markdown]
# # A block that slides to rest
#
# A block starts at 0.2 m/s on a rigid base. Newton's law with the law of friction gives its whole course,
# t = int dv / (g mu(v)): with a coefficient of 0.6 it stops earlier than with one that rises from 0.4 to 0.6 as it
# slows down (Zhao 2013, thesis, fig. 3-4 and 3-5).
#
# Run with `python demos/sliding_to_rest.py`: some seconds.

# %%
from pathlib import Path

import numpy as np
from scipy.integrate import cumulative_trapezoid

from ruptfx import read_case, simulate
from ruptfx.app.script import begin, save, save_numbers
from ruptfx.results.figure_style import letter, new_figure, styled

CASE, G = Path(__file__).with_name("sliding_to_rest.toml"), 10.0  # m/s2
LAWS = {"velocity weakening": [], "Coulomb": ['faults.main.friction={kind="coulomb",mu_d=0.6}']}
out = Path("runs/sliding_to_rest")
begin(out)

# %%
results, numbers = {}, {}
for name, changes in LAWS.items():
    case = read_case(CASE, [*changes, "output.figures=false"])
    data = simulate(case, out / name.replace(" ", "_"), overwrite=True).interface.load()
    law, start = case.faults["main"].friction, case.initial_velocity["upper"][0]
    speed = np.linspace(start, 0, 2001)
    mu = law.strength(speed, np.ones_like(speed), {})
    time = -cumulative_trapezoid(1 / (G * mu), speed, initial=0)
    way = -cumulative_trapezoid(speed / (G * mu), speed, initial=0)
    results[name] = data, time, speed, way
    moves = data.slip_rate.mean("position").values > 1e-6
    stop, slip = float(data.time.values[moves][-1]), float(data.slip.mean("position")[-1])
    numbers |= {
        f"{name}: stops after": (stop, "s"), f"{name}: closed form of the time": (float(time[-1]), "s"),
        f"{name}: way": (slip, "m"), f"{name}: closed form of the way": (float(way[-1]), "m"),
    }  # fmt: skip
save_numbers(out, numbers)


# %%
@styled
def picture():
    """Speed and way against time, computed and closed form."""
    figure, (axes,) = new_figure(1, 2, 2.8)
    for number, (name, (data, time, speed, way)) in enumerate(results.items()):
        some = slice(None, None, 12)
        for ax, values, exact in zip(axes, (data.slip_rate, 1e3 * data.slip), (speed, 1e3 * way), strict=True):
            ax.plot(1e3 * time, exact, "--", color=f"C{number}", label=f"{name}, closed form")
            ax.plot(1e3 * data.time[some], values.mean("position")[some], "o", ms=3, color=f"C{number}", label=name)
    axes[0].set(xlabel="Time (ms)", ylabel="Speed (m/s)", ylim=(0, None))
    axes[1].set(xlabel="Time (ms)", ylabel="Way (mm)", ylim=(0, None))
    axes[0].legend(fontsize=6)
    letter(axes)
    return figure


save(picture(), out / "sliding_to_rest.png")
