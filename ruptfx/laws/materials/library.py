"""Elastic constants of common materials, which a case names: ``materials.upper = "pmma"``.

Sources; those of PMMA, polycarbonate, steel and granite were not at hand: these values are as commonly quoted from them

- homalite: constants of the shear-impact study of Coker, Lykotrafitis, Needleman and Rosakis (2005), J. Mech. Phys.
  Solids 53, 884-922, for dynamic loading; under slow loading the modulus is about 3.9 GPa. The fringe constant is a
  commonly quoted, typical value in green light.
- pmma: wave speeds and density of the blocks of Svetlizky and Fineberg (2014), Nature 509, 205-208, for dynamic
  loading; under slow loading the modulus is about half.
- polycarbonate: modulus, Poisson's ratio and fringe constant of Dally and Riley (1991), Experimental Stress Analysis,
  3rd ed., table of photoelastic materials, for slow loading; the density is a typical value.
- aluminium: alloy 6061-T6, typical values of the Aluminum Association; Poisson's ratio is that of similar alloys.
- steel: wave speeds of mild steel from the CRC Handbook of Chemistry and Physics, "Speed of sound in various media";
  the density is a typical value.
- granite: typical; the middle of the ranges of Bourbié, Coussy and Zinszner (1987), Acoustics of Porous Media (c_p 4500
  to 6000 m/s, c_s 2500 to 3300 m/s, density 2500 to 2700 kg/m3). Granites differ: measure yours.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from pydantic_core import PydanticCustomError

from ruptfx import Table
from ruptfx.input.schema import kinds, nearest


class Known(NamedTuple):
    """Constants of a material as keys of `isotropic_elastic`, which of them are typical values, and their source."""

    constants: dict[str, float]
    typical: tuple[str, ...]
    source: str


LIBRARY = {
    "homalite": Known(
        {"density": 1246.0, "young_modulus": 5.3e9, "poisson_ratio": 0.35, "fringe_constant": 22.6e3},
        ("fringe_constant",), "Homalite-100, dynamic; Coker et al. (2005)",
    ),
    "pmma": Known(
        {"density": 1170.0, "c_p": 2700.0, "c_s": 1345.0}, (), "PMMA, dynamic; Svetlizky and Fineberg (2014)"
    ),
    "polycarbonate": Known(
        {"density": 1200.0, "young_modulus": 2.48e9, "poisson_ratio": 0.38, "fringe_constant": 7.0e3},
        ("density",), "polycarbonate, slow loading; Dally and Riley (1991)",
    ),
    "aluminium": Known(
        {"density": 2700.0, "young_modulus": 68.9e9, "poisson_ratio": 0.33},
        ("density", "young_modulus", "poisson_ratio"), "aluminium 6061-T6; Aluminum Association",
    ),
    "steel": Known(
        {"density": 7850.0, "c_p": 5960.0, "c_s": 3235.0}, ("density",), "mild steel; CRC Handbook",
    ),
    "granite": Known(
        {"density": 2600.0, "c_p": 5250.0, "c_s": 2900.0}, ("density", "c_p", "c_s"),
        "granite, middle of the ranges of Bourbié et al. (1987)",
    ),
}  # fmt: skip
"""By name."""


def constants_of(value: object) -> object:
    """Replace the name of a material, alone or as key `name` of a table, by its constants; other keys replace them.

    Raises
    ------
    PydanticCustomError
        Neither a material of the library nor a kind.
    """
    name = value.get("name") if isinstance(value, Mapping) else value
    if not isinstance(name, str):
        return value
    own: Table = {key: each for key, each in value.items() if key != "name"} if isinstance(value, Mapping) else {}
    if name not in LIBRARY:
        if not own and name in kinds("ruptfx.laws.materials"):
            return value
        hint = nearest(name, [*LIBRARY])
        raise PydanticCustomError(
            "unknown_kind", "no material is called '{name}', {hint}; or give a table with a kind",
            {"name": name, "hint": hint},
        )  # fmt: skip
    return {"kind": "isotropic_elastic", **LIBRARY[name].constants, **own}


def in_words(name: str) -> str:
    """Return the constants of a material with units and source, in one line."""
    known = LIBRARY[name]
    units = {
        "density": ("rho", 1, "kg/m3"), "young_modulus": ("E", 1e9, "GPa"), "poisson_ratio": ("nu", 1, ""),
        "c_p": ("c_p", 1, "m/s"), "c_s": ("c_s", 1, "m/s"), "fringe_constant": ("f_sigma", 1e3, "kN/m"),
    }  # fmt: skip
    parts = []
    for key, value in known.constants.items():
        symbol, size, unit = units[key]
        parts.append(f"{symbol} {value / size:g} {unit}".rstrip() + " (typical)" * (key in known.typical))
    return f"{', '.join(parts)}; {known.source}"
