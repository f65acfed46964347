"""Reflection of plane waves by the edges `sponge` and `absorbing`, from packets at 0, 30 and 60 degrees, nu = 1/4.

A strip is as wide as a wave is long along its upper edge, and periodic along it. A one-way packet of P or S waves, the
exact superposition of waves that have this length along the edge, runs to the edge; what is left in the body when
the reflected packet is where the first one began is its energy, whatever waves it consists of. The square root of the
ratio of both energies is the reflection of amplitudes. The packet at 60 degrees has waves from 58.5 to 61.5 degrees,
and a sponge reflects more at larger angles: 1.05 % instead of the 0.97 % of a plane wave.

- SH waves at dashpots: (1 - cos) / (1 + cos) of the angle. Source: Lysmer and Kuhlemeyer (1969).
- A sponge of two wavelengths: at most 1 % to 60 degrees. A solution of the ordinary differential equations across the
  layer has 0.86, 0.71 and 0.76 % (P), 0.86, 0.97 and 0.97 % (S).
- A sponge of one wavelength: 1.9 % at normal incidence, from the same solution.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ruptfx import Table
from ruptfx.app.bench import Check
from ruptfx.app.bench._rupture import elastic
from ruptfx.case import Case
from ruptfx.laws.materials import Plane
from ruptfx.platform import fem
from ruptfx.run.model import Model

if TYPE_CHECKING:
    from ruptfx.platform.fem import MPI

Array = np.ndarray

C_P, C_S, RHO = np.sqrt(3) * 1000.0, 1000.0, 2000.0
LONG = {0: 3.0, 30: 3.0, 60: 6.0}
"""Standard deviation of the packet along y, in wavelengths along y, by angle."""
AMPLITUDE = 1e-6  # m, of waves 1 m long
STEEP = (1 - 0.5) / (1 + 0.5)
SOURCE = "differential equations of the layer"


def strip(edge: Table, wave: str, angle: int, plane: Plane, elements: int) -> Table:
    """Return the case: waves 1 m long, at an angle [degrees] from the normal of the upper edge."""
    turned = np.deg2rad(angle)
    width = 1 / np.sin(turned) if angle else 1 / elements
    reach = 4 * LONG[angle] / np.cos(turned)  # packet from its middle on
    speed = C_P if wave == "P" else C_S
    stuck = {
        "contact": {"kind": "split_node"}, "friction": {"kind": "coulomb", "mu_d": 1.0},
        "initial_stress": {"normal": 1e6},
    }  # fmt: skip
    sides = [{"kind": "periodic", "first": f"{body}.left", "second": f"{body}.right"} for body in ("upper", "lower")]
    return {
        "plane": plane, "order": 4, "duration": 2 * reach / (speed * np.cos(turned)),
        "mesh": {
            "kind": "two_plates", "length": width, "height": reach + 0.5 * edge.get("width", 0.0),
            "element_size": width / max(1, round(width * elements)),
        },
        "materials": {"default": elastic(C_P, C_S, RHO)}, "faults": {"main": stuck},
        "boundaries": [*sides, {**edge, "edge": "upper.top"}],
    }  # fmt: skip


def packet(model: Model, wave: str, angle: int) -> tuple[Array, Array]:
    """Return displacement [m] and velocity [m/s] of the packet at the nodes."""
    turned = np.deg2rad(angle)
    x, y = model.coordinates[:, 0], model.coordinates[:, 1] - model.coordinates[:, 1].min()
    spread = LONG[angle] / np.cos(turned)
    wavenumbers = 2 * np.pi * np.cos(turned) + np.linspace(-4, 4, 81) / spread
    shares = np.exp(-0.5 * np.linspace(-4, 4, 81) ** 2)
    along = 2 * np.pi * np.sin(turned)
    speed = C_P if wave == "P" else C_S
    moved, rate = np.zeros((2, model.nodes, model.components))
    for across, share in zip(wavenumbers, AMPLITUDE * shares / shares.sum(), strict=True):
        size = np.hypot(along, across)
        motion = np.ones(1)
        if model.components > 1:
            motion = np.array([along, across] if wave == "P" else [across, -along]) / size
        phase = along * x + across * (y - 4 * spread)
        moved[:, : len(motion)] += share * np.cos(phase)[:, None] * motion
        rate[:, : len(motion)] += share * size * speed * np.sin(phase)[:, None] * motion
    return moved, rate


def reflection(edge: Table, wave: str, angle: int, plane: Plane = "strain", elements: int = 3) -> tuple[float, float]:
    """Return the reflected amplitude over that of the packet, and the energy closure."""
    case = Case.model_validate(strip(edge, wave, angle, plane, elements))
    model = Model(case, fem.MPI.COMM_SELF)
    motion, state = case.stepper.bind(model), model.initial_state()
    for field, values in zip((state.displacement, state.velocity), packet(model, wave, angle), strict=True):
        field[:] = values.ravel()
    motion.step(state)
    first = model.energies(state)  # leapfrog conserves energy between steps, from the first one on
    while state.time < case.duration * (1 - 1e-9):
        motion.step(state)
    last = model.energies(state)
    kept, before = (each["kinetic"] + each["strain"] for each in (last, first))
    begun, ended = (sum(each.values()) - 2 * each["boundary_work"] for each in (first, last))
    return float(np.sqrt(kept / before)), abs(ended - begun) / before


def run(fine: bool, comm: MPI.Comm) -> list[Check]:
    """Measure the reflections of both kinds of edges."""
    del comm
    elements = 4 if fine else 3
    found, closure = reflection({"kind": "absorbing"}, "S", 60, "antiplane", elements)
    checks = [
        Check("dashpots, SH at 60 degrees", STEEP, found, 0.02, "1", "Lysmer and Kuhlemeyer (1969)", relative=True),
        Check("energy closure", 0.0, closure, 1e-9, "1", "exact"),
    ]
    for wave in ("P", "S"):
        for angle in (0, 30, 60):
            found, closure = reflection({"kind": "sponge", "width": 2.0}, wave, angle, elements=elements)
            name = f"sponge of two wavelengths, {wave} at {angle} degrees"
            checks.append(Check(name, 0.01, found, 0.0006, "1", "aim; 0.0006 for the packet", "at most"))
            checks.append(Check("energy closure", 0.0, closure, 1e-9, "1", "exact"))
    found, _ = reflection({"kind": "sponge", "width": 1.0}, "P", 0, elements=elements)
    checks.append(Check("sponge of one wavelength, P at 0 degrees", 0.0185, found, 0.1, "1", SOURCE, relative=True))
    return checks
