"""A bar that spins about its middle: strains under large rotations, exact in one dimension.

A bar of length L and density rho that turns at omega has the stress rho omega^2 (L^2 / 4 - x^2) / 2 and is longer by
rho omega^2 L^3 / (12 E), and so across; without contraction (nu = 0) that is the whole solution for small strains, here
0.2 %. It begins in that state, turns once, and must stay in it: its angle is omega t, its angular momentum that of the
beginning. Once as one body, once with springs between all cells (`[fracture]`), which must turn with them, and which
begin without jumps, so that this bar vibrates.
"""

from __future__ import annotations

import numpy as np

from benchmarks._cases import case_of, table_of
from ruptfx import Table
from ruptfx.app.bench import Check, Outcome
from ruptfx.case import Case
from ruptfx.platform import fem
from ruptfx.run.model import Model

BAR = table_of("rotating_bar")
LENGTH, HEIGHT = (BAR["mesh"]["shape"][side] for side in ("width", "height"))
YOUNG, DENSITY = (BAR["materials"]["default"][name] for name in ("young_modulus", "density"))
STRAIN = 2e-3  # in the middle
OMEGA = float(np.sqrt(8 * STRAIN * YOUNG / DENSITY)) / LENGTH  # rad/s
TURNS = 1
NEVER = {"kind": "linear", "f_t": 1e12, "c": 1e12, "G_Ic": 1e9, "G_IIc": 1e9}


def bar(size: float, broken: bool) -> Case:
    """Return the case with triangles of a size [m], as one body or with intrinsic facets."""
    changes: Table = {"duration": TURNS * 2 * np.pi / OMEGA, "mesh.element_size": size}
    if broken:
        law = {"cohesion": NEVER, "friction": {"kind": "coulomb", "mu_d": 0.6}}
        changes["fracture"] = {"kind": "intrinsic", "default": law}
    return case_of("rotating_bar", changes)


def spin(case: Case, comm: fem.MPI.Comm) -> dict[str, float]:
    """Return angle over omega t, relative changes of momentum and energy, and mean extension over the exact one."""
    model = Model(case, comm)
    motion, state = case.stepper.bind(model), model.initial_state()
    x, mass = model.coordinates[:, :2], model.mass.reshape(-1, 2)[:, :1]
    strain = DENSITY * OMEGA**2 / (2 * YOUNG)
    stretched = strain * x * (np.array([LENGTH, HEIGHT]) ** 2 / 4 - x**2 / 3)
    state.displacement[:] = stretched.ravel()
    now = x + stretched
    state.velocity[:] = OMEGA * np.stack([-now[:, 1], now[:, 0]], axis=1).ravel()
    owned = slice(0, model.owned_nodes)

    def across(a: np.ndarray, b: np.ndarray) -> float:
        return float(comm.allreduce(np.sum((mass * (a[:, :1] * b[:, 1:] - a[:, 1:] * b[:, :1]))[owned])))

    def along(a: np.ndarray, b: np.ndarray) -> float:
        return float(comm.allreduce(np.sum((mass * a * b)[owned])))

    momentum = across(now, state.velocity.reshape(-1, 2))
    inertia, longer, drift, energy, taken = along(x, x), [], 0.0, [], []
    steps = int(np.ceil(case.duration / motion.dt))
    for step in range(steps):
        before = x + state.displacement.reshape(-1, 2)
        motion.step(state)
        if step % 50 == 0 or step == steps - 1:
            drift = max(drift, abs(across(before, state.velocity.reshape(-1, 2)) / momentum - 1))
            found = model.energies(state)
            taken.append(found.pop("rotation_error"))
            energy.append(sum(found.values()))
            now = x + state.displacement.reshape(-1, 2)
            cos, sin = along(x, now), across(x, now)
            longer.append((np.hypot(cos, sin) - inertia) / along(x, stretched))
    angle = np.arctan2(sin, cos) + 2 * np.pi * round((OMEGA * state.time - np.arctan2(sin, cos)) / (2 * np.pi))
    return {
        "angle": angle / (OMEGA * state.time), "momentum": drift, "energy": float(np.ptp(energy) / energy[0]),
        "closure": float(np.ptp(np.add(energy, taken)) / energy[0]), "extension": float(np.mean(longer)),
    }  # fmt: skip


def run(fine: bool, comm: fem.MPI.Comm) -> Outcome:
    checks = []
    for broken in (False, True):
        found = spin(bar(1e-3 if fine else 1.5e-3, broken), comm)
        name = "springs between cells" if broken else "one body"
        checks += [
            Check(f"{name}: angle after {TURNS} turn", 1.0, found["angle"], 1e-4, "omega t", "rigid rotation"),
            Check(f"{name}: change of angular momentum", 0.0, found["momentum"], 1e-11, "1", "exact"),
            Check(f"{name}: extension", 1.0, found["extension"], 0.01, "1", "rho omega^2 L^3 / (12 E)"),
            Check(f"{name}: change of energy", 0.0, found["energy"], 1e-7, "1", "second order in the step"),
            Check(f"{name}: the same with what finite steps took", 0.0, found["closure"], 1e-10, "1", "exact"),
        ]
    return Outcome(checks)
