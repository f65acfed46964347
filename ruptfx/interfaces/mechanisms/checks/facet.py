"""Rows of `ruptfx check` on cohesive facets: process zones, loading, stiffness of the cells."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from ruptfx.interfaces.mechanisms.checks.table import Row
from ruptfx.platform import parallel

if TYPE_CHECKING:
    from ruptfx.interfaces.cracks import CrackLaws
    from ruptfx.interfaces.cracks.step import CrackStep
    from ruptfx.interfaces.mechanisms.system import System
    from ruptfx.laws.materials import Material

RESOLVED, LOST = 2.0, 0.2  # facets per process zone of a crack: below these a warning, and an error
LATE = 2.0  # facets that a wave may pass between two checks of the strength


def facet_rows(model: System, cracks: CrackStep) -> Iterator[Row]:
    """Yield the lengths of process zones, E G / strength^2, over that of facets, and how fast loading reaches f_t.

    Source: Hillerborg, Modéer and Petersson (1976).
    """
    fracture = cracks.fracture
    yield Row("fracture: facets", float(parallel.total(model.comm, cracks.owned.sum())), "", "mean length "
              f"{cracks.edge:.4g} m")  # fmt: skip
    young = {name: _young(material) for name, material in zip(model.bodies.names, model.materials, strict=True)}
    moduli = {"-".join(pair): min(young[name] for name in pair) for pair in fracture.laws_by_pair(model.bodies.names)}
    present = {"-".join(sorted(model.bodies.names[body] for body in pair)) for pair in cracks.network.pairs().tolist()}
    of_pairs = {"-".join(pair): laws for pair, laws in fracture.laws_by_pair(model.bodies.names).items()}
    of_pairs = {pair: laws for pair, laws in of_pairs.items() if pair in present}
    for pair, laws in (of_pairs | fracture.laws_of_joints(model.bodies.joints)).items():
        if laws.cohesion is None:
            continue
        law = laws.cohesion.at(cracks.position.ravel())
        modulus = moduli.get(pair, min(young.values()))
        for mode, energy, strength in (("I", law.G_Ic, law.f_t), ("II", law.G_IIc, law.c)):
            zone = float(np.min(modulus * energy / strength**2))
            cells = zone / cracks.edge
            fine, far = cells >= RESOLVED, cells < LOST and not fracture.unresolved
            yield Row(
                f"fracture {pair}: process zone {mode}", cells, "facets",
                f"{zone:.4g} m, E G / strength^2" if fine else
                f"below {RESOLVED:g}: strength and path depend on the mesh; refine it, or a larger "
                + f"G_{mode}c" + ("; or say that you know: fracture.unresolved = true" if far else ""),
                "ok" if fine else "error" if far else "warning",
            )  # fmt: skip
    yield from _loading(model, of_pairs, cracks.position.ravel())


def insertion_rows(model: System, cracks: CrackStep, check_every: int, dt: float) -> Iterator[Row]:
    """Yield the distance of a wave between two checks of the strength."""
    fastest = max(material.wave_speeds(model.case.plane).c_p for material in model.materials)
    way = check_every * dt * fastest / cracks.edge
    yield Row(
        "fracture: distance of a wave between two checks of the strength", way, "facets",
        "" if way <= LATE else f"more than {LATE:g}: facets are inserted late; reduce fracture.check_every",
        "ok" if way <= LATE else "warning",
    )  # fmt: skip


def spring_rows(model: System, cracks: CrackStep) -> Iterator[Row]:
    """Yield the stiffness of the cells, which compensates that of the springs."""
    for name, material, stiff in zip(model.bodies.names, model.materials, cracks.cell_materials, strict=True):
        stiffer = _young(stiff) / _young(material) - 1
        yield Row(
            f"fracture {name}: stiffness of cells", _young(stiff), "Pa",
            f"{stiffer:+.1%}, which compensates the springs" if stiffer else
            f"not compensated: the body is softer by about {_softer(model, cracks, material):.1%}",
            "ok" if stiffer else "warning",
        )  # fmt: skip


def _loading(model: System, laws: Mapping[str, CrackLaws], position: np.ndarray) -> Iterator[Row]:
    """Yield the number of wave passages until the impact speed has loaded a body to f_t, f_t / (rho c_p v)."""
    flying = [float(np.linalg.norm(velocity)) for velocity in model.case.initial_velocity.values()]
    speed = max(model.case.impact_speed, *flying, 0.0)
    impedance = {
        name: material.density * material.wave_speeds(model.case.plane).c_p
        for name, material in zip(model.bodies.names, model.materials, strict=True)
    }
    waves = [
        float(np.min(each.cohesion.at(position).f_t)) / (speed * min(impedance[name] for name in pair.split("-")))
        for pair, each in laws.items() if speed and each.cohesion is not None
    ]  # fmt: skip
    if waves:
        yield Row(
            "fracture: passages of waves until f_t", min(waves), "", f"at {speed:.4g} m/s: "
            + ("the first wave alone reaches it" if min(waves) < 1 else "loading is slow where these are many"),
        )  # fmt: skip


def _young(material: Material) -> float:
    """Return the smaller one of the moduli along the axes of a material, in the plane [Pa]."""
    angle = getattr(material, "angle", 0.0)
    axes = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    return float(material.young_modulus_along(axes).min())


def _softer(model: System, cracks: CrackStep, material: Material) -> float:
    """Return the part of the plane modulus that springs cost, 1 - 1 / (1 + S E / 2 k); anisotropic, of the lower E."""
    lame = material.lame(model.case.plane)
    modulus = _young(material) if lame is None else 4 * lame[1] * (lame[0] + lame[1]) / (lame[0] + 2 * lame[1])
    stiffness = cracks.fracture.stiffness(_young(material), cracks.edge)
    return float(1 - 1 / (1 + cracks.length_per_area * modulus / (2 * stiffness)))
