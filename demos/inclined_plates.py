# %% [markdown]
# # Inclined plates: pulse or crack by the angle
#
# A square plate of Homalite is cut along an inclined line and pressed from above by P: the interface carries the normal
# stress P cos^2 and the shear stress P sin cos of the inclination. A wire explodes in the middle and takes most of the
# normal stress of some millimetres away for 15 us. Lu, Lapusta and Rosakis (2007), PNAS 104, 18931, saw a narrow pulse
# at 20 degrees, a wider one at 25, a crack at 30 (P = 10 MPa). Which of them comes out here hangs on constants that are
# ours, above all on V_w, the slip rate from which friction weakens: they were chosen so that the order is that of the
# experiments.
#
# Run with `python demos/inclined_plates.py`: two minutes.

# %%
from pathlib import Path

import numpy as np

from ruptfx import read_case, simulate
from ruptfx.app.script import begin, save
from ruptfx.results.figure_style import RATE_MAP, letter, new_figure, remark, styled

CASE = Path(__file__).with_name("inclined_plates.toml")
ANGLES, PRESSURES = (20, 25, 30), (6e6, 10e6, 15e6)  # degrees, Pa
AWAY = 20e-3  # m, of the velocimeters from the middle
out = Path("runs/inclined_plates")
begin(out)


def run(angle, pressure=10e6, size=2.5e-3):
    """A run at an inclination [degrees] under a pressure [Pa]; the wire takes the same part of it away."""
    along = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
    across = 0.5e-3 * np.array([-along[1], along[0]])
    place = np.array([75e-3, 75e-3]) + AWAY * along
    pair = {"point": (place + across).tolist(), "relative_to": (place - across).tolist(), "direction": along.tolist()}
    case = read_case(CASE, overrides=["output.figures=false", "output.bulk_interval=60e-6"])
    for key, value in {
        "mesh.inclination": np.radians(angle),
        "mesh.element_size": size,
        "faults.main.initial_stress.tensor": [0.0, -pressure, 0.0],
        "faults.main.nucleation.0.drop": 0.72 * pressure,
        **{f"instruments.0.{name}": value for name, value in pair.items()},
    }.items():
        case = case.changed(key, value)
    return simulate(case, out / f"{angle}_{pressure / 1e6:.0f}_{size * 1e3:g}", overwrite=True)


def passage(record):
    """Slip rate [m/s] against time [s] at AWAY, and how long it is above a tenth of its largest value [s].

    Without end where it is so until the end of the run.
    """
    rate = abs(record.interface.slip_rate)
    at = rate.sel(position=float(rate.position.mean()) + AWAY, method="nearest")
    fast = at.time.values[at.values > 0.1 * float(at.max())]
    lasting = np.inf if fast[-1] == at.time.values[-1] else fast[-1] - fast[0]
    return at.time.values, at.values, lasting


# %% [markdown]
# The three angles, each on two meshes.

# %%
runs = {angle: run(angle) for angle in ANGLES}
coarse = {(angle, P): run(angle, P, 3.75e-3) for angle in ANGLES for P in PRESSURES}
for angle, record in runs.items():
    tip, lasting, other = record.summary["tip_speed_over_c_R"], passage(record)[2], passage(coarse[angle, 10e6])[2]
    print(f"{angle} degrees: slips for {1e6 * lasting:.1f} us at 20 mm ({1e6 * other:.1f} us on the coarse mesh), "
          f"tip {tip:.2f} c_R, mode {record.summary['mode']}")  # fmt: skip
for (angle, P), record in coarse.items():
    _, rate, lasting = passage(record)
    reach = 1e3 * record.summary["reach"]
    at = f"{angle} degrees, {P / 1e6:.0f} MPa"
    print(f"{at}: {1e6 * lasting:.1f} us, up to {rate.max():.2g} m/s, reach {reach:.0f} mm")

# %%


@styled
def picture():
    """Slip rate along the interface at the three angles, and what a pair of velocimeters sees of it."""
    figure, axes = new_figure(2, 3, 4.4, height_ratios=(1.6, 1))
    for column, (angle, record) in enumerate(runs.items()):
        rate = abs(record.interface.slip_rate)
        middle = float(rate.position.mean())
        top, bottom = axes[:, column]
        shown = top.pcolormesh(
            (rate.position - middle) * 1e3, rate.time * 1e6, rate, vmin=0, vmax=6, cmap=RATE_MAP, rasterized=True
        )
        top.axvline(AWAY * 1e3, color="0.5", lw=0.6, ls=":")
        top.set(title=f"{angle}°", xlabel="Position from the wire (mm)", xlim=(-80, 80))
        time, at, lasting = passage(record)
        bottom.plot(time * 1e6, at, color="#1a1a1a", label="slip rate")
        pair = record.instruments["pair"].velocity
        bottom.plot(pair.time * 1e6, abs(pair), color="#1769aa", lw=0.7, label="velocimeters")
        says = "to the end" if np.isinf(lasting) else f"{1e6 * lasting:.0f} µs"
        bottom.set(xlabel="Time (µs)", title=f"at 20 mm: {says}", xlim=(0, 60), ylim=(0, None))
    axes[0, 0].set_ylabel("Time (µs)")
    axes[1, 0].set_ylabel("Rate (m/s)")
    axes[1, 0].legend()
    figure.colorbar(shown, ax=axes[0, 2], label="Slip rate (m/s)", extend="max")
    letter(axes[0])
    remark(figure, "Duration above a tenth of the largest slip rate. Velocimeters: 0.5 mm above and below.")
    return figure


save(picture(), out / "inclined_plates.png")
