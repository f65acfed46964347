"""Materials of SEM2DPACK: elastic, viscoelastic and plastic bodies, and Kelvin-Voigt viscosity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ruptfx import Table
from ruptfx.app.convert.sem2dpack.blocks import Block, ConversionError, Input
from ruptfx.laws.materials.standard_linear_solids import StandardLinearSolids

READS = {"MATERIAL", "MAT_ELASTIC", "MAT_ELASTICM", "MAT_KV", "MAT_VISCO", "MAT_PLASTIC"}
REFUSED = {
    "DMG": "continuum damage", "DMG3": "continuum damage",
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


def read(value: Input) -> dict[int, Medium]:
    """Return the medium of every tag, and report those without counterpart.

    Raises
    ------
    ConversionError
        There is no material, or a value is missing.
    """
    blocks = value.all("MATERIAL")
    if not blocks:
        raise ConversionError("&MATERIAL: is required and missing; give one for every tag of the mesh")
    media = {}
    for block in blocks:
        kinds, tag = block.words("kind", "ELAST"), int(block.number("tag"))
        for kind in kinds:
            if kind not in (*BODIES, "KV"):
                what = REFUSED.get(kind, "a material without counterpart")
                value.refuse(f"MATERIAL.{kind}", f"{what}; write kind='ELAST' and &MAT_ELASTIC in its place")
        left_out = {kind for kind in kinds if kind == "KV" or f"material.{kind}".lower() in value.without}
        if left_out == set(kinds):
            raise ConversionError(
                f"&MATERIAL tag = {tag}: is required; write kind='ELAST' and &MAT_ELASTIC in place "
                f"of {', '.join(kinds)}"
            )
        for kind in (each for each in kinds if each in BODIES):
            viscosity = _properties(value, block, "MAT_KV") if "KV" in kinds else None
            name, convert = BODIES[kind]
            media[tag] = Medium(convert(value, _properties(value, block, name)), viscosity)
    return media


def _properties(value: Input, material: Block, name: str) -> Block:
    """Return the first block of a name after a material; materials that follow each other share it."""
    place = next(number for number, block in enumerate(value.blocks) if block is material)
    after = [block for block in value.blocks[place:] if block.name == name]
    result = after or value.all(name)
    if not result:
        raise ConversionError(f"&{name}: is required after &MATERIAL tag = {material.number('tag'):g}")
    return result[0]


def _elastic(value: Input, block: Block) -> Table:
    keys = ("rhoh", "cph", "csh", "c11h", "c13h", "c33h", "c55h", "c66h")
    value.refuse_keys(block, "properties that vary inside of a body; bodies are homogeneous", *keys)
    if any(block.get(key, "") for key in keys):
        return {}
    density = block.number("rho")
    if block.get("c55", 0.0) == 0.0:
        return {"kind": "isotropic_elastic", "density": density, "c_p": block.number("cp"), "c_s": block.number("cs")}
    c11, c13, c33, c55 = (block.number(key, 0.0) for key in ("c11", "c13", "c33", "c55"))
    c66 = block.number("c66", c55)
    if min(c11, c33) <= 0:
        raise ConversionError(f"&{block.name} c11 = {c11:g}, c33 = {c33:g}: must be positive beside c55; give both")
    # In plane strain only c11, c13, c33 and c55 matter: contraction out of the plane may be zero.
    return {
        "kind": "orthotropic_elastic", "density": density, "E_1": c11 - c13**2 / c33, "E_2": c33 - c13**2 / c11,
        "nu_12": c13 / c33, "nu_23": 0.0, "nu_13": 0.0, "G_12": c55, "G_13": c66, "G_23": c55,
    }  # fmt: skip


def _strained(value: Input, block: Block) -> Table:
    """Return the elastic material of a version with an initial strain: its forces are those of the later strain."""
    strain = [float(each) for each in block.values.get("e0", [])]
    if any(strain):
        values = ", ".join(f"{each:g}" for each in strain)
        value.note(f"&{block.name} e0 = {values}: initial strain left out; the motion does not depend on it")
    return _elastic(value, block)


def _viscoelastic(value: Input, block: Block) -> Table:
    """Return relaxing moduli; wave speeds of the input are those at the frequency f0, zero without it."""
    lowest, highest, f0 = block.number("fmin"), block.number("fmax"), block.number("f0", 0.0)
    speeds = {"c_p": block.number("cp"), "c_s": block.number("cs")}
    table: Table = {
        "kind": StandardLinearSolids.kind(), "density": block.number("rho"), "Q_p": block.number("qp"),
        "Q_s": block.number("qs"), "lowest_frequency": lowest, "frequency_ratio": highest / max(lowest, 1e-300),
        "mechanisms": int(block.number("nbody")),
    }  # fmt: skip
    law = StandardLinearSolids.model_validate({key: table[key] for key in table if key != "kind"} | speeds)
    first, shear = law.lame("strain")
    of_bulk, of_shear = (np.array(each) for each in law.coefficients)
    of_p = ((first + 2 * shear / 3) * of_bulk + 4 * shear / 3 * of_shear) / (first + 2 * shear)
    for name, fractions in (("c_p", of_p), ("c_s", of_shear)):
        ratio = 2 * np.pi * f0 / np.array(law.rates)
        real, loss = 1 - np.sum(fractions / (1 + ratio**2)), np.sum(fractions * ratio / (1 + ratio**2))
        size = float(np.hypot(real, loss))
        # Phase velocity of a viscoelastic wave (Moczo, Kristek and Halada 2004).
        speeds[name] *= float(np.sqrt((size + real) / (2 * size**2)))
    return {**table, **speeds}


def _plastic(value: Input, block: Block) -> Table:
    """Return Coulomb plasticity; the initial stress follows from the initial strain by elasticity."""
    density, c_p, c_s = (block.number(key) for key in ("rho", "cp", "cs"))
    shear, first = density * c_s**2, density * (c_p**2 - 2 * c_s**2)
    xx, yy, xy = ([float(each) for each in block.values.get("e0", [0.0])] + [0.0] * 3)[:3]
    relaxation = block.number("tv", 0.0)
    if relaxation <= 0:
        raise ConversionError(f"&MAT_PLASTIC Tv = {relaxation:g}: must be positive here; give a time step, for example")
    trace = first * (xx + yy)
    return {
        "kind": "mohr_coulomb", "density": density, "c_p": c_p, "c_s": c_s, "cohesion": block.number("coh"),
        "friction_angle": float(np.deg2rad(block.number("phi"))), "relaxation_time": relaxation,
        "initial_stress": [trace + 2 * shear * xx, trace + 2 * shear * yy, trace, 2 * shear * xy, 0.0, 0.0],
    }  # fmt: skip


BODIES = {
    "ELAST": ("MAT_ELASTIC", _elastic), "ELASM": ("MAT_ELASTICM", _strained), "VISCO": ("MAT_VISCO", _viscoelastic),
    "PLAST": ("MAT_PLASTIC", _plastic),
}  # fmt: skip
"""Kinds of material of a body: the block of their values, and how it becomes a material of the case."""
