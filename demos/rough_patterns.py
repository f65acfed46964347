# %% [markdown]
# # Ruptures over four patterns of roughness
#
# Two bodies of different materials are pressed and sheared; then a part of the interface loses its friction. Between
# smooth bodies the fronts to the two sides differ; waves of the surfaces can decouple the bodies, so that both sides
# look alike. Patterns: smooth, waves in phase (the surfaces fit into each other), waves in opposition, one wavy
# surface. Wavelength, amplitude and length of the nucleation vary. Di Bartolomeo et al. (ESDA2010-25247) varied them,
# show two runs, and leave a detailed study to further work. Their Table 1 prints wave speeds that belong to a Poisson
# ratio of 0.31, not to the printed 0.25: both run.
#
# Measure: slip of closed points after the nucleation, to the right less that to the left, over their sum; zero where
# both sides are alike.
#
# "Just less than the shear that slips", as the paper has it, depends on the pattern. Where surfaces touch everywhere it
# is the shear stress with which the steepest flank carries 0.93 of its strength; contacts of crests are loaded
# unevenly, and 0.8 of the normal stress is near enough. Loading excites the instability of unlike bodies with Coulomb
# friction where they touch everywhere; viscosity beside the interface takes it while they are loaded. So the four
# patterns are not loaded alike, and part of their difference may be that: in a first version, all loaded to 0.8 without
# viscosity, smooth surfaces slid at 50 m/s before the nucleation and had an asymmetry below 0.02, those in phase up
# to 0.99.
#
# Run with `python demos/rough_patterns.py`: 30 runs, some minutes; runs that exist are not run again. The map is
# `runs/rough_patterns/asymmetry.png`.

# %%
from itertools import product
from pathlib import Path

import numpy as np

from ruptfx import Record, simulate
from ruptfx.app.script import begin, save, save_numbers
from ruptfx.case import parse_case, read_toml
from ruptfx.results.figure_style import letter, new_figure, remark, styled

PATTERNS = {"smooth": (0, 0), "in phase": (1, 1), "opposed": (-1, 1), "one side": (-1, 0)}  # signs of the waves
WAVES, STEEP, PATCHES = (0.6e-3, 0.3e-3), (1 / 120, 1 / 60), (40e-6, 120e-6)  # m; amplitude over wavelength; m
OUT = Path("runs/rough_patterns")
begin(OUT)


def profile(sign, wave, amplitude, upper, fits):
    """Profile of a surface that touches y = 0 with its crests; in phase the surfaces coincide."""
    if sign == 0:
        return 0.0
    mean = 0.0 if fits else (amplitude if upper else -amplitude)
    return {"kind": "sinusoid", "mean": mean, "amplitude": sign * amplitude, "wavelength": wave}


def run(pattern, wave=0.6e-3, steep=1 / 60, patch=120e-6, nu=0.25):
    """The interface of a run, from its record if there is one, and its case."""
    table = read_toml(Path(__file__).with_name("rough_rupture.toml"))
    signs = PATTERNS[pattern]
    for body, sign in zip(("upper", "lower"), signs, strict=True):
        table["mesh"][body] |= {
            "element_size": 75e-6, "profile": profile(sign, wave, steep * wave, body == "upper", signs == (1, 1)),
        }  # fmt: skip
        table["materials"][body]["poisson_ratio"] = nu
    if signs in ((0, 0), (1, 1)):  # they touch everywhere
        slope = 2 * np.pi * steep if signs[0] else 0.0
        shear = float(10e6 * np.tan(np.arctan(0.93) - slope))
        tractions = [each for stage in table["stages"] for each in stage["boundaries"] if "traction" in each]
        for each in tractions:
            each["traction"] = [value * shear / 8e6 if abs(value) == 8e6 else value for value in each["traction"]]
        for stage in table["stages"][:2]:
            stage["damping"]["kelvin_voigt"] = {"fraction": 0.3}
    table["faults"]["main"]["nucleation"][0]["half_width"] = 0.5 * patch
    table["output"] |= {
        "figures": False, "interface_interval": 0.05e-6, "bulk_interval": 20e-6, "bulk_fields": ["velocity"],
    }  # fmt: skip
    case = parse_case(table)
    path = OUT / f"{pattern}_{1e6 * wave:.0f}_{1 / steep:.0f}_{1e6 * patch:.0f}_{nu}".replace(" ", "_")
    record = Record(path) if (path / "summary.json").exists() else simulate(case, path, overwrite=True)
    return record.interface.load(), case


def sides(data, case):
    """Slip of closed points after the nucleation and outside of it [m2], to the left and to the right."""
    nucleation = case.faults["main"].nucleation[0]
    x, half = data.position.values, nucleation.half_width
    before = data.sel(time=nucleation.time, method="nearest")
    slip = np.abs(data.slip.values[-1] - before.slip.values)
    closed = before.normal_stress.values > 0  # others slide past each other without touching
    return [float(np.trapezoid(np.where(side & closed, slip, 0.0), x)) for side in (x < -half, x > half)]


def asymmetry(data, case):
    """Slip to the right less that to the left over their sum."""
    left, right = sides(data, case)
    return (right - left) / (right + left)


# %% [markdown]
# Shorter waves in the same bodies, flatter waves, shorter nucleations; then the other Poisson ratio.

# %%
found = {}
for pattern, wave, steep, patch in product(PATTERNS, WAVES, STEEP, PATCHES):
    if pattern == "smooth":
        wave, steep = WAVES[0], STEEP[1]  # no waves
    found[pattern, wave, steep, patch] = asymmetry(*run(pattern, wave, steep, patch))
other = {pattern: asymmetry(*run(pattern, nu=0.31)) for pattern in PATTERNS}

# %%
numbers = {}
for (pattern, wave, steep, patch), value in found.items():
    waves = "" if pattern == "smooth" else f"waves {1e3 * wave:g} mm, amplitude 1/{1 / steep:.0f}, "
    numbers[f"{pattern}, {waves}patch {1e3 * patch:g} mm"] = value
numbers |= {f"{pattern}, nu 0.31": value for pattern, value in other.items()}
for pattern in PATTERNS:
    values = [abs(value) for key, value in found.items() if key[0] == pattern]
    numbers |= {f"{pattern}: least asymmetry": min(values), f"{pattern}: largest asymmetry": max(values)}
save_numbers(OUT, numbers)


# %%
@styled
def asymmetries():
    """A map for each pattern: asymmetry over wavelength with amplitude, and length of the nucleation."""
    figure, (axes,) = new_figure(1, 4, 2.6, 7.2, sharey=True)
    rows = [(wave, steep) for wave in WAVES for steep in STEEP]
    for ax, pattern in zip(axes, PATTERNS, strict=True):
        smooth = pattern == "smooth"
        values = np.array(
            [[found[pattern, *((WAVES[0], STEEP[1]) if smooth else row), patch] for patch in PATCHES] for row in rows]
        )
        shown = ax.imshow(values, origin="lower", cmap="RdBu_r", vmin=-1, vmax=1, aspect="auto")
        for (row, column), value in np.ndenumerate(values):
            if not smooth or row == 0:
                ax.text(column, 1.5 if smooth else row, f"{value:.2f}", ha="center", va="center", fontsize=7,
                        color="white" if abs(value) > 0.6 else "black")  # fmt: skip
        ax.set(title=pattern, xlabel="Nucleation (mm)", xticks=[0, 1], xticklabels=[f"{1e3 * p:g}" for p in PATCHES])
        ax.set_yticks(range(len(rows)), [f"{1e3 * wave:g} mm, 1/{1 / steep:.0f}" for wave, steep in rows])
        ax.minorticks_off()
    axes[0].set_ylabel("Wavelength, amplitude over it")
    figure.colorbar(shown, ax=list(axes), label="(right - left) / sum of slip")
    letter(axes)
    remark(figure, "At nu = 0.31, waves of 0.6 mm, 1/60 and 0.12 mm: "
           + ", ".join(f"{pattern} {value:.2f}" for pattern, value in other.items()) + ".")  # fmt: skip
    return figure


save(asymmetries(), OUT / "asymmetry.png")
