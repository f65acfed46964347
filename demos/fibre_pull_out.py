# %% [markdown]
# # A fibre that is pulled out: when it sticks and slips
#
# A glass fibre in epoxy, held by residual pressure, bodies of revolution. It is pulled slowly at one end, and friction
# follows the ageing law. The sliding zone grows from the loaded end; once all of the fibre slides, it goes on steadily
# or sticks and slips, and its length decides which. Inertia is replaced by radiation damping here;
# `ruptfx run demos/fibre_pull_out.toml` computes the waves.
#
# Run with `python demos/fibre_pull_out.py`: a minute.

# %%
from pathlib import Path

import numpy as np
from matplotlib.colors import LogNorm

from ruptfx import read_case, simulate
from ruptfx.app.script import begin, save
from ruptfx.results.analysis.fibre import ShearLag
from ruptfx.results.figure_style import RATE_MAP, STEADY, STICK_SLIP, letter, new_figure, styled

CASE = Path(__file__).with_name("fibre_pull_out.toml")
SHORT, LONG = 15e-3, 30e-3  # m
SWEPT = (SHORT, 18e-3, 21e-3, 24e-3, 27e-3, LONG)
out = Path("runs/fibre_pull_out")
begin(out)

# %% [markdown]
# Shear lag, a bar in a matrix that leaves out radial stresses, says above which length steady sliding is unstable.

# %%
case = read_case(CASE)
law, matrix, mesh = case.faults["main"].friction, case.materials["matrix"], case.mesh
pressure = case.faults["main"].initial_stress.normal
bar = ShearLag(mesh.radius, mesh.outer_radius, LONG, case.materials["fibre"].young_modulus, matrix.shear_modulus)
critical = bar.critical_length(pressure * (law.b - law.a) / law.D_c)
print(f"critical length by shear lag: {1e3 * critical:.1f} mm")

# %%
records = {}
for length in SWEPT:
    slow = ["duration=30.0", "output.figures=false", "damping={}", f"mesh.length={length}",
            'stepper={kind="quasi_static",rate_tolerance=0.2,radiation_damping=true}']  # fmt: skip
    records[length] = simulate(read_case(CASE, overrides=slow), out / f"{1e3 * length:.0f} mm", overwrite=True)


def swing(record):
    """Smallest over largest force of the last third."""
    force = -record.instruments["pull"].force_x
    late = force[force.time > 20]
    return float(late.min() / late.max())


for length, record in records.items():
    force = float(-record.instruments["pull"].force_x.min())
    print(f"{1e3 * length:.0f} mm: largest force {force:.0f} N, later between {swing(record):.0%} and all of the peaks")
lowest = float(records[LONG].interface.normal_stress.min())
print(f"lowest pressure on the long fibre, which gets thinner: {lowest / 1e6:.1f} MPa of {pressure / 1e6:.0f} MPa")

# %%


@styled
def picture():
    """Force against displacement, slip rate along the long fibre, and stability against length."""
    figure, (axes,) = new_figure(1, 3, 2.6, gridspec_kw={"width_ratios": (1.2, 1.2, 1)})
    for length, colour in ((SHORT, STEADY), (LONG, STICK_SLIP)):
        pull = records[length].instruments["pull"]
        axes[0].plot(10 * pull.time, -pull.force_x, color=colour, label=f"{1e3 * length:.0f} mm")
    axes[0].set(xlabel="Displacement of the end (µm)", ylabel="Force (N)", xlim=(0, None), ylim=(0, None))
    axes[0].legend(title="Length", loc="lower right")
    rate = abs(records[LONG].interface.slip_rate)
    shown = axes[1].pcolormesh(
        rate.position * 1e3, rate.time, np.maximum(rate, 1e-8), norm=LogNorm(1e-8, 1e-2), cmap=RATE_MAP, rasterized=True
    )
    axes[1].set(xlabel="Position from the loaded end (mm)", ylabel="Time (s)")
    figure.colorbar(shown, ax=axes[1], label="Slip rate (m/s)", extend="both")
    drops = [1 - swing(records[length]) for length in SWEPT]
    axes[2].plot([1e3 * length for length in SWEPT], drops, "o-", color="0.3")
    axes[2].axvline(1e3 * critical, color=STICK_SLIP, ls="--", lw=0.8, label="shear lag")
    axes[2].set(xlabel="Length (mm)", ylabel="Force drop over peak force", ylim=(-0.03, 1.05))
    axes[2].legend()
    letter(axes)
    return figure


save(picture(), out / "fibre_pull_out.png")
