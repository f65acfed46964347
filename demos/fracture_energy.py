# %% [markdown]
# # Fracture energy against real contact area
#
# What a front dissipates per area is the work of friction above its final level, (mu_s - mu_d) sigma D_c / 2. With D_c
# of the contacts it grows with the pressure as the real contact area sigma / H does: Gamma is proportional to the area
# (Svetlizky, Bayart and Fineberg 2019). Here strain gauges 2 to 5 mm above the interface see fronts under four
# pressures; Gamma is fitted to their traces, without knowing the law.
#
# The fit needs process zones that are not longer than gauges are high. D_c was first 3 um: then Gamma is 24 % low at
# 2.5 MPa, and it grows with the area to the power 1.18. With the 1.5 um of this file the power is near 1.
#
# Run with `python demos/fracture_energy.py`: a minute. The picture is `runs/fracture_energy/gamma.png`.

# %%
from pathlib import Path

import numpy as np

from ruptfx import Record, simulate
from ruptfx.app.script import begin, save, save_numbers
from ruptfx.case import parse_case
from ruptfx.laws import fracture
from ruptfx.laws.materials.isotropic_elastic import IsotropicElastic
from ruptfx.results.analysis.contact_light import real_contact_area
from ruptfx.results.analysis.front_fit import Trace, fit_front
from ruptfx.results.analysis.near_tip import Medium
from ruptfx.results.figure_style import letter, new_figure, styled

PRESSURES = (2.5e6, 5e6, 7.5e6, 10e6)  # Pa
MU_S, MU_D, D_C, HARDNESS = 0.5, 0.2, 1.5e-6, 400e6  # D_c [m] at the gauges; hardness of PMMA [Pa], in order
PLACE, LENGTH, FRACTION = 60e-3, 85e-3, 0.6  # m; speed of the front that the load is chosen for [c_R]
GAUGES = [(PLACE + dx, y) for dx in (-4e-3, 0.0, 4e-3) for y in (2e-3, 3.5e-3, 5e-3)]
PMMA = {"young_modulus": 5.65e9, "poisson_ratio": 0.33, "density": 1180.0}
medium = Medium.of(IsotropicElastic(**PMMA), "strain")
out = Path("runs/fracture_energy")
begin(out)

# %% [markdown]
# Toughness grows with the distance from the middle as the energy release of a crack with two tips does, so that a front
# keeps its speed; within 25 mm it is forced. The stress drop is what that speed and this toughness need.


# %%
def table(pressure):
    """The case of one pressure."""
    speed = FRACTION * medium.c_R
    gamma = 0.5 * (MU_S - MU_D) * pressure * D_C
    half_length = fracture.half_length_at(speed, medium.c_p, medium.c_s)
    drop = float(np.sqrt(gamma * medium.modulus * half_length / (np.pi * PLACE)))
    along = [0.0, 0.2]
    return {
        "plane": "strain", "order": 4, "duration": 1.25 * PLACE / speed,
        "mesh": {"kind": "half_plate", "length": LENGTH, "height": 60e-3, "element_size": 1.5e-3, "growth": 1.2},
        "materials": {"default": {"kind": "isotropic_elastic", **PMMA}}, "damping": {"kelvin_voigt": {"fraction": 0.1}},
        "faults": {"main": {
            "contact": {"kind": "split_node"},
            "initial_stress": {"normal": pressure, "shear": MU_D * pressure + drop},
            "friction": {"kind": "linear_slip_weakening", "mu_s": MU_S, "mu_d": MU_D, "D_c": {
                "kind": "table", "positions": along, "values": [D_C * (x + 2e-3) / (PLACE + 2e-3) for x in along]}},
            "nucleation": [{"kind": "forced_rupture", "center": 0.0, "radius": 25e-3, "speed": speed, "mu_d": MU_D,
                            "t_w": 1e-3 / speed}],
        }},
        "boundaries": [{"kind": "driven", "edge": "upper.left", "component": "y", "velocity": 0.0},
                       {"kind": "absorbing", "edge": "upper.top"}, {"kind": "absorbing", "edge": "upper.right"}],
        "instruments": [{"kind": "strain_gauge", "name": f"g{number}", "interval": 1e-7, "point": list(point),
                         "length": 0.5e-3, "angles": ["0 deg", "45 deg", "90 deg"]}
                        for number, point in enumerate(GAUGES)],
        "output": {"figures": False, "bulk_interval": 1.0},
    }  # fmt: skip


def traces(record):
    """Changes of strain at the gauges while the front passes."""
    gauges = [record.instruments[f"g{number}"].load() for number in range(len(GAUGES))]
    return [Trace(x, y, gauge.time.values, {part: gauge[f"strain_{part}"].values for part in ("xx", "yy", "xy")})
            for (x, y), gauge in zip(GAUGES, gauges, strict=True)]  # fmt: skip


# %%
areas, fits, numbers = [], [], {}
for pressure in PRESSURES:
    record = simulate(parse_case(table(pressure)), out / f"{pressure / 1e6:g}", overwrite=True)
    fits.append(fit_front(traces(record), medium))
    areas.append(float(real_contact_area(np.array(pressure), HARDNESS)))
    numbers |= {
        f"{pressure / 1e6:g} MPa: Gamma of the gauges": (fits[-1].fracture_energy, "J/m2"),
        f"{pressure / 1e6:g} MPa: Gamma of the law": (0.5 * (MU_S - MU_D) * pressure * D_C, "J/m2"),
        f"{pressure / 1e6:g} MPa: speed over c_R": fits[-1].speed / medium.c_R,
    }
gammas = np.array([fit.fracture_energy for fit in fits])
numbers["exponent of Gamma over the area"] = float(np.polyfit(np.log(areas), np.log(gammas), 1)[0])
save_numbers(out, numbers)


# %%
@styled
def picture():
    """Fitted fracture energy against the real contact area, and traces of one gauge."""
    figure, (axes,) = new_figure(1, 2, 3.0)
    percent = 100 * np.array(areas)
    axes[0].errorbar(percent, gammas, [fit.fracture_energy_error for fit in fits], fmt="o", ms=4, label="gauges")
    axes[0].plot([0, percent[-1]], [0, 0.5 * (MU_S - MU_D) * PRESSURES[-1] * D_C], "k--", lw=0.8, label="law")
    axes[0].set(xlabel="Real contact area (%)", ylabel="Fracture energy (J/m²)", xlim=(0, None), ylim=(0, None))
    axes[0].legend()
    for pressure in PRESSURES:
        with Record(out / f"{pressure / 1e6:g}") as record:
            gauge = record.instruments["g4"].load()
        axes[1].plot(1e6 * gauge.time, 1e6 * gauge.strain_xy, lw=0.8, label=f"{pressure / 1e6:g} MPa")
    axes[1].set(xlabel="Time (µs)", ylabel="Shear strain at 60 mm, 3.5 mm high (µm/m)")
    axes[1].legend()
    letter(axes)
    return figure


save(picture(), out / "gamma.png")
