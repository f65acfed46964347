"""A double cantilever beam is opened slowly: stable growth along a cohesive interface.

Two arms of the height h, bonded ahead of the crack of length a, are moved apart by d at their ends. Beams on the
elastic foundation that the material ahead of the tip is behave as if they were longer by 0.64 h (Kanninen 1973), so
that with the force P per thickness

    G = 12 P^2 (a + 0.64 h)^2 / (E h^3),    d = 8 P (a + 0.64 h)^3 / (E h^3).

While the crack grows G is the fracture energy, and P falls with the root of d whatever the length of the crack:
P^2 d = 8 (G E h^3 / 12)^(3/2) / (E h^3). Plane stress. The ends move slowly; the crack advances node by node, and
vibrations of the arms are averaged over the growth.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from benchmarks._cases import case_of, table_of
from ruptfx.app.bench import Check, Outcome
from ruptfx.run.model import Model
from ruptfx.run.recording.edge_sums import EdgeSums

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ruptfx.platform.fem import MPI

TABLE = table_of("double_cantilever")
YOUNG = TABLE["materials"]["default"]["young_modulus"]
COHESION = TABLE["faults"]["main"]["cohesion"]
ENERGY, CUT = COHESION["G_Ic"], COHESION["f_t"]["half_width"]  # with the strength E G / f_t^2 is 3 mm
HEIGHT = TABLE["mesh"]["height"]  # m, of an arm
FOUNDATION = 0.64 * HEIGHT
SAMPLES = 500
BEGUN, UNTIL = CUT + 4e-3, 50e-3  # m: range of crack lengths that is evaluated
SOURCE = "beam theory, Kanninen (1973)"


def opened(size: float) -> tuple[dict[str, np.ndarray], float]:
    """Return histories of end distance [m], crack length [m], force [N/m], fracture energy [J/m]; and the closure."""
    case = case_of("double_cantilever", {"mesh.element_size": size})
    model = Model(case)
    motion, state = case.stepper.bind(model), model.initial_state()
    sums, position = EdgeSums(model), model.faults[0].interface.position
    steps = int(case.duration / motion.dt)
    rows, lost, work = [], 0.0, 1e-300
    for step in range(1, steps + 1):
        state.wants_energies = step % (steps // SAMPLES) == 0
        motion.step(state)
        if state.wants_energies:
            edges = dict(zip(sums.columns, sums.row(state), strict=True))
            energy = motion.energies(state)
            unaccounted = energy["boundary_work"] - sum(v for name, v in energy.items() if name != "boundary_work")
            lost, work = max(lost, abs(unaccounted)), max(work, abs(energy["boundary_work"]))
            rows.append((
                edges["upper.left.displacement_y"] - edges["lower.left.displacement_y"],
                0.5 * (edges["upper.left.force_y"] - edges["lower.left.force_y"]),
                _tip(position, state.faults["main"]["damage"]), energy["fracture"],
            ))  # fmt: skip
    columns = np.array(rows).T
    return dict(zip(("distance", "force", "length", "fracture"), columns, strict=True)), lost / work


def _tip(position: np.ndarray, damage: np.ndarray) -> float:
    """Return the position at which the damage is one half [m]."""
    inside = np.flatnonzero((position > CUT * (1 + 1e-6)) & (damage < 0.5))
    ahead = int(inside[np.argmin(position[inside])])
    behind = int(np.argmin(np.where(position < position[ahead] * (1 - 1e-9), position[ahead] - position, np.inf)))
    if position[behind] <= CUT * (1 + 1e-6):
        return CUT
    part = (0.5 - damage[ahead]) / (damage[behind] - damage[ahead])
    return float(position[ahead] - part * (position[ahead] - position[behind]))


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    del comm
    found, closure = opened(1.25e-3 if fine else 2.5e-3)
    length, force, distance = found["length"], found["force"], found["distance"]
    grows = (length > BEGUN) & (length < UNTIL)
    released = 12 * force**2 * (length + FOUNDATION) ** 2 / (YOUNG * HEIGHT**3)
    taken = np.polyfit(length[grows], found["fracture"][grows], 1)[0]
    between = np.array([force[grows].mean(), _locus(distance[grows]).mean()])
    checks = [
        Check("energy of breaking per new length of crack", ENERGY, float(taken), 0.02, "J/m2", "G_Ic", relative=True),
        Check("energy release from force and length, mean", ENERGY, float(released[grows].mean()), 0.05, "J/m2",
              SOURCE, relative=True),
        Check("force at the distance of the ends, mean ratio", 1.0, float(between[0] / between[1]), 0.05, "1", SOURCE),
        Check("energy closure", 0.0, closure, 1e-10, "1", "exact"),
    ]  # fmt: skip
    return Outcome(checks, lambda: _draw(found, grows))


def _locus(distance: np.ndarray) -> np.ndarray:
    """Return the force while the crack grows [N/m]."""
    stiff = YOUNG * HEIGHT**3
    return np.sqrt(8 * (ENERGY * stiff / 12) ** 1.5 / (stiff * np.maximum(distance, 1e-12)))


def _draw(found: dict[str, np.ndarray], grows: np.ndarray) -> Figure:
    from ruptfx.results.figure_style import new_figure

    figure, ((left, right),) = new_figure(1, 2, 3.0)
    distance, growing = found["distance"], found["distance"][grows]
    known = _locus(growing)
    left.plot(1e3 * distance, found["force"] / 1e3, lw=0.8, label="computed")
    start = 8 * (CUT + FOUNDATION) ** 3 / (YOUNG * HEIGHT**3)
    bent = distance[distance < growing[0]]
    left.plot(1e3 * bent, bent / start / 1e3, "k:", lw=0.8)
    left.plot(1e3 * growing, known / 1e3, "k:", label="beam theory")
    left.set(xlabel="Distance of the ends (mm)", ylabel="Force (kN/m)")
    left.legend(frameon=False)
    right.plot(1e3 * distance, 1e3 * found["length"], lw=0.8)
    theory = np.sqrt(ENERGY * YOUNG * HEIGHT**3 / 12) / known - FOUNDATION
    right.plot(1e3 * growing, 1e3 * theory, "k:")
    right.set(xlabel="Distance of the ends (mm)", ylabel="Length of the crack (mm)")
    return figure
