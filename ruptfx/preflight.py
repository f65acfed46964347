"""What a careful user computes by hand before the first time step: `ruptfx check`."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ruptfx import fem
from ruptfx.case import Case
from ruptfx.fault import Fault
from ruptfx.friction import FrictionLaw
from ruptfx.model import Model
from ruptfx.projection import TracedLaw
from ruptfx.steppers import leapfrog


@dataclass(frozen=True)
class Row:
    """One line of the pre-flight table."""

    quantity: str
    value: float | str
    unit: str = ""
    note: str = ""
    verdict: Literal["ok", "warning", "error"] = "ok"

    @property
    def text(self) -> str:
        return self.value if isinstance(self.value, str) else f"{self.value:.6g}"


def preflight(case: Case) -> Iterator[Row]:
    """Rows of the table; builds the model on this rank.

    Raises
    ------
    RuptfxError
        Whatever a run would refuse.
    """
    model = Model(case, fem.MPI.COMM_WORLD)
    yield Row("nodes", model.total_nodes, "", f"{model.components} components, order {case.order}")
    for name, material in zip(model.bodies.names, model.materials, strict=True):
        speeds = material.wave_speeds(case.plane)
        yield Row(f"{name}: c_p", speeds.c_p, "m/s", "plate speed c_l" if case.plane == "stress" else "")
        yield Row(f"{name}: c_s", speeds.c_s, "m/s", f"sqrt(2) c_s = {np.sqrt(2) * speeds.c_s:.6g}")
        yield Row(f"{name}: c_R", speeds.c_R, "m/s")
    if len(model.materials) > 1 and case.plane in ("stress", "strain"):
        yield from _pairing(model)
    motion = case.stepper.bind(model)
    stable = model.stable_time_step()
    yield Row("stable time step", stable, "s", leapfrog.what_limits(model, stable))
    steps = int(np.ceil(case.duration / motion.dt))
    yield Row("time step", motion.dt, "s", f"{steps} steps for {case.duration:.6g} s")
    for fault in model.faults:
        yield from _fault_rows(model, fault)
    yield from _cost(model, motion, steps)


def generalized_rayleigh_speed(model: Model) -> float | None:
    """Speed of the interface wave of two bodies in frictionless contact [m/s], None where there is none.

    Root of the sum over the bodies of a_p (1 - a_s^2) / (G D) with a_i = sqrt(1 - c^2 / c_i^2) and
    D = 4 a_s a_p - (1 + a_s^2)^2 (Source: Weertman 1963; Achenbach and Epstein 1967).
    """
    from scipy.optimize import brentq

    speeds = [material.wave_speeds(model.case.plane) for material in model.materials]
    moduli = [m.density * s.c_s**2 for m, s in zip(model.materials, speeds, strict=True)]

    def compliance(c: float) -> float:
        total = 0.0
        for s, modulus in zip(speeds, moduli, strict=True):
            a_p, a_s = np.sqrt(1 - (c / s.c_p) ** 2), np.sqrt(1 - (c / s.c_s) ** 2)
            total += a_p * (1 - a_s**2) / (modulus * (4 * a_s * a_p - (1 + a_s**2) ** 2))
        return total

    low, high = min(s.c_R for s in speeds), min(min(s.c_s for s in speeds), max(s.c_R for s in speeds))
    if high <= low * (1 + 1e-12):
        return low if abs(speeds[0].c_R - speeds[1].c_R) < 1e-9 * low else None
    # Below the lower c_R both terms are positive; each passes through infinity at its own c_R.
    grid = np.linspace(low * (1 + 1e-9), high * (1 - 1e-9), 200)
    values = np.array([compliance(c) for c in grid])
    change = np.flatnonzero(values[:-1] * values[1:] < 0)
    return float(brentq(compliance, grid[change[0]], grid[change[0] + 1])) if len(change) else None


def _pairing(model: Model) -> Iterator[Row]:
    first, second = model.materials[0], model.materials[-1]
    if first == second:
        yield Row("generalized Rayleigh speed", first.wave_speeds(model.case.plane).c_R, "m/s", "identical bodies: c_R")
        return
    speed = generalized_rayleigh_speed(model)
    if speed is None:
        yield Row("generalized Rayleigh speed", "none", "", "Coulomb friction is well-posed for small coefficients")
    else:
        yield Row(
            "generalized Rayleigh speed", speed, "m/s",
            "exists: Coulomb friction is ill-posed at any coefficient; use normal-stress memory", "warning",
        )  # fmt: skip


def _fault_rows(model: Model, fault: Fault) -> Iterator[Row]:
    """Strength, S ratio, process zone and nucleation length of one fault, at its middle point."""
    face, label = fault.interface, f"faults.{fault.name}"
    if len(face.plus) == 0:
        return
    yield Row(
        f"{label}: points", face.total, "", f"mean spacing {np.ptp(face.position) / max(face.total - 1, 1):.4g} m"
    )
    middle = int(np.argmin(np.abs(face.position - 0.5 * face.position.max())))
    sigma, tau = float(fault.normal_stress_0[middle]), float(np.linalg.norm(fault.shear_traction_0[middle]))
    law = TracedLaw(fault.friction)
    state = fault.friction.initial_state(
        fault.normal_stress_0, np.abs(fault.shear_traction_0[:, 0]), np.zeros(len(face.plus))
    )
    zero = np.zeros(len(face.plus))
    peak = float(law(zero, fault.normal_stress_0, state, 0.0)[0][middle])
    yield Row(f"{label}: initial stress", sigma, "Pa", f"shear {tau:.6g} Pa, at position {face.position[middle]:.4g} m")
    yield Row(f"{label}: strength at rest", peak, "Pa")
    if tau > peak * (1 + 1e-12):
        yield Row(f"{label}: shear / strength", tau / peak, "", "the interface slips from the first step", "warning")
    yield from _slip_weakening_rows(model, fault.friction, label, peak, tau, sigma, middle, face)


def _slip_weakening_rows(
    model: Model, law: FrictionLaw, label: str, peak: float, tau: float, sigma: float, middle: int, face: object
) -> Iterator[Row]:
    """S, process zone and nucleation length, for laws with a residual strength and a weakening slip."""
    inner = getattr(law, "law", law)
    if not (hasattr(inner, "D_c") and hasattr(inner, "mu_d")):
        return
    at = lambda value: float(np.broadcast_to(value, (middle + 1,))[middle])  # noqa: E731
    residual, slip = at(inner.mu_d) * sigma, at(inner.D_c)
    drop = peak - residual
    material = min(model.materials, key=lambda m: m.wave_speeds(model.case.plane).c_s)
    modulus = material.density * material.wave_speeds(model.case.plane).c_s ** 2
    nu = getattr(material, "poisson_ratio", 0.0)
    effective = (
        modulus
        if model.case.plane == "antiplane"
        else modulus / (1 - nu)
        if model.case.plane == "strain"
        else modulus * (1 + nu)
    )
    if tau > residual:
        ratio = (peak - tau) / (tau - residual)
        limit = 1.77 if model.case.plane != "antiplane" else np.inf
        yield Row(f"{label}: S", ratio, "", "may go supershear" if ratio < limit else "stays sub-Rayleigh (S > 1.77)")
        # Half-length at which a uniformly loaded crack grows: a_c = Gamma E' / (pi dtau^2), E' = 2 G*.
        energy = 0.5 * drop * slip
        yield Row(
            f"{label}: critical half-length", 2 * effective * energy / (np.pi * (tau - residual) ** 2), "m", "Griffith"
        )
    # Static process zone of linear slip weakening: 9 pi / 32 G* D_c / (tau_p - tau_r)  (Palmer and Rice 1973).
    zone = 9 * np.pi / 32 * effective * slip / drop if drop > 0 else np.inf
    spacing = float(np.max(np.diff(np.sort(face.position)), initial=0))  # type: ignore[attr-defined]
    points = zone / spacing
    yield Row(f"{label}: static process zone", zone, "m")
    yield Row(
        f"{label}: points in it", points, "", "" if points >= 5 else "too few: 5 or more resolve a front",
        "ok" if points >= 5 else "warning",
    )  # fmt: skip


def _cost(model: Model, motion: object, steps: int) -> Iterator[Row]:
    """Memory and run time, from a few real steps."""
    state = model.initial_state()
    motion.step(state)  # type: ignore[attr-defined]
    begin = time.perf_counter()
    for _ in range(5):
        motion.step(state)  # type: ignore[attr-defined]
    each = (time.perf_counter() - begin) / 5
    vectors = 8 * 8 * model.nodes * model.components
    yield Row("memory of the vectors", vectors / 1e6, "MB", "per rank, without the mesh")
    yield Row(
        "expected run time", each * steps, "s", f"{each:.3g} s per step on {model.comm.size} rank(s), without output"
    )
