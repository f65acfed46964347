# %% [markdown]
# # A front as a crack: prediction and run
#
# A rupture runs along an interface that carries 1 MPa more than its residual strength, for 30 mm, and then 0.2 MPa
# less. Fracture mechanics says how fast it is at every length and where it stops, from the stress drop
# tau(x) - mu_d sigma(x) and the fracture energy alone. Twice: a crack with one tip, for which the equation of motion is
# exact, and one with two tips that run apart, where it holds until waves from the other tip arrive.
#
# Run this file with `python demos/stress_barrier.py`; the picture is `runs/stress_barrier/figures/front.png`.

# %%
from ruptfx import simulate
from ruptfx.app.bench.stress_barrier import Front, medium, one_tip, predicted, two_tips
from ruptfx.app.script import begin, save
from ruptfx.results.figure_style import letter, new_figure, style

begin("runs/stress_barrier_one_tip", "runs/stress_barrier")

# %% [markdown]
# The cases are those of `ruptfx bench stress_barrier`: `demos/stress_barrier.toml`, and its right half, mirrored.
#
# The speed of the front is the slope of straight lines through the onset of slip within 2 mm.

# %%
found = {}
for shape, case, folder in (
    ("one tip", one_tip(), "runs/stress_barrier_one_tip"),
    ("bilateral", two_tips(), "runs/stress_barrier"),
):
    with simulate(case, out=folder, overwrite=True) as record:
        data, theory = record.interface, predicted(case, shape)
        front = Front.of(case, data.position.values, data.rupture_time.values)
        figures = record.path / "figures"
    found[shape] = theory, front
    print(f"{shape}: stops at {1e3 * front.stopped:.1f} mm, predicted: {1e3 * theory.arrest:.1f} mm")
caught_up = front.caught_up(case)
print(f"waves of the other tip catch up with it at {1e3 * caught_up:.0f} mm")

# %% [markdown]
# Both, each with its prediction.

# %%
c_R = medium(case).c_R
with style():
    figure, (axes,) = new_figure(1, 2, 3.2)
    for ax, (shape, (theory, front)) in zip(axes, found.items(), strict=True):
        ax.axvspan(30, 80, color="0.92", lw=0)
        ax.text(78, 0.96, "barrier", ha="right", va="top", color="0.4")
        ax.plot(1e3 * theory.length, theory.speed / c_R, "k--", label="equation of motion")
        ax.plot(1e3 * front.place, front.speed / c_R, "o", ms=3, color="C0", label="run")
        ax.axvline(1e3 * front.stopped, color="C0", lw=0.8, ls=":", label="where it stops")
        ax.set(xlim=(0, 80), ylim=(0, 1), title={"one tip": "One tip", "bilateral": "Two tips"}[shape])
    axes[1].axvline(1e3 * caught_up, color="#d9480f", lw=0.8, ls="-.", label="waves of the other tip arrive")
    axes[0].set(xlabel="Length of the rupture (mm)", ylabel="Front speed / $c_R$")
    axes[1].set(xlabel="Half-length of the rupture (mm)")
    handles, labels = axes[1].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4)
    letter(axes)
    save(figure, figures / "front.png")
