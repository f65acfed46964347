"""Materials of SEM2DPACK: elastic bodies, isotropic or with a vertical axis, and Kelvin-Voigt viscosity."""

from __future__ import annotations

from dataclasses import dataclass

from ruptfx import Table
from ruptfx.convert.sem2dpack.blocks import Block, ConversionError, Input

READS = {"MATERIAL", "MAT_ELASTIC", "MAT_KV"}
REFUSED = {
    "PLAST": "plasticity", "DMG": "continuum damage", "DMG3": "continuum damage", "VISCO": "attenuation",
    "VISLA": "viscoelastic soil", "IWAN": "nonlinear soil", "MASS": "bodies without stiffness",
}  # fmt: skip


@dataclass(frozen=True)
class Medium:
    """Material of a tag of the mesh.

    Attributes
    ----------
    table : dict
        The material of the case.
    viscosity : Block or None
        Block of its Kelvin-Voigt viscosity.
    """

    table: Table
    viscosity: Block | None


def read(given: Input) -> dict[int, Medium]:
    """Return the medium of every tag, and report those without counterpart.

    Raises
    ------
    ConversionError
        There is no material, or a value is missing.
    """
    blocks = given.all("MATERIAL")
    if not blocks:
        raise ConversionError("&MATERIAL: is required")
    media = {}
    for block in blocks:
        kinds, tag = block.words("kind", "ELAST"), int(block.number("tag"))
        for kind in kinds:
            if kind not in ("ELAST", "KV"):
                given.refuse(f"MATERIAL.{kind}", REFUSED.get(kind, "a material without counterpart"))
        if "ELAST" in kinds:
            viscosity = _properties(given, block, "MAT_KV") if "KV" in kinds else None
            media[tag] = Medium(_elastic(given, _properties(given, block, "MAT_ELASTIC")), viscosity)
    return media


def _properties(given: Input, material: Block, name: str) -> Block:
    """Return the first block of a name after a material; materials that follow each other share it."""
    place = next(number for number, block in enumerate(given.blocks) if block is material)
    after = [block for block in given.blocks[place:] if block.name == name]
    found = after or given.all(name)
    if not found:
        raise ConversionError(f"&{name}: is required after &MATERIAL tag = {material.number('tag'):g}")
    return found[0]


def _elastic(given: Input, block: Block) -> Table:
    keys = ("rhoh", "cph", "csh", "c11h", "c13h", "c33h", "c55h", "c66h")
    given.refuse_keys(block, "properties that vary inside of a body; bodies are homogeneous", *keys)
    if any(block.get(key, "") for key in keys):
        return {}
    density = block.number("rho")
    if block.get("c55", 0.0) == 0.0:
        return {"kind": "isotropic_elastic", "density": density, "c_p": block.number("cp"), "c_s": block.number("cs")}
    c11, c13, c33, c55 = (block.number(key, 0.0) for key in ("c11", "c13", "c33", "c55"))
    c66 = block.number("c66", c55)
    if min(c11, c33) <= 0:
        raise ConversionError(f"&{block.name} c11, c33: are required beside c55")
    # In plane strain only c11, c13, c33 and c55 matter: contraction out of the plane may be zero.
    return {
        "kind": "orthotropic_elastic", "density": density, "E_1": c11 - c13**2 / c33, "E_2": c33 - c13**2 / c11,
        "nu_12": c13 / c33, "nu_23": 0.0, "nu_13": 0.0, "G_12": c55, "G_13": c66, "G_23": c55,
    }  # fmt: skip
