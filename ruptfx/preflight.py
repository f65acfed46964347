"""What a careful user computes by hand before the first time step: `ruptfx check`."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ruptfx import fem
from ruptfx.analysis import fracture
from ruptfx.case import Case
from ruptfx.fault import Fault
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
    steps = None if case.stepper.adaptive else int(np.ceil(case.duration / motion.dt))
    if steps is None:
        yield Row("first time step", motion.dt, "s", f"steps vary over {case.duration:.6g} s")
    else:
        yield Row("time step", motion.dt, "s", f"{steps} steps for {case.duration:.6g} s")
    for fault in model.faults:
        yield from _fault_rows(model, fault)
    yield from _cost(model, motion, steps)


def generalized_rayleigh_speed(model: Model) -> float | None:
    """Speed of the interface wave of the first and last body without friction [m/s], None where there is none."""
    materials = [model.materials[0], model.materials[-1]]
    speeds = [material.wave_speeds(model.case.plane) for material in materials]
    moduli = [material.density * s.c_s**2 for material, s in zip(materials, speeds, strict=True)]
    return fracture.generalized_rayleigh_speed(speeds, moduli)


def _remembers(model: Model) -> bool:
    """Whether every fault has a memory of the normal stress."""
    return all("Pa" in fault.friction.all_state_fields().values() for fault in model.faults)


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
            "exists: Coulomb friction is ill-posed at any coefficient; use normal-stress memory (prakash_clifton)",
            "ok" if _remembers(model) else "warning",
        )  # fmt: skip


def _fault_rows(model: Model, fault: Fault) -> Iterator[Row]:
    """Strength, S ratio, process zone and nucleation length of one fault, at its middle point or, where that slips at
    once, at the nearest point that does not."""
    face, label = fault.interface, f"faults.{fault.name}"
    if len(face.plus) == 0:
        return
    spacing = float(np.max(np.diff(np.sort(face.position)), initial=0))
    yield Row(f"{label}: points", face.total, "", f"largest spacing {spacing:.4g} m")
    shear = np.linalg.norm(fault.shear_traction_0, axis=1)
    state = {name: value for name, value in fault.initial_state().items() if name in fault.friction.all_state_fields()}
    zero = np.zeros(len(face.plus))
    strength = TracedLaw(fault.friction)(zero, fault.normal_stress_0, state, 0.0)[0]
    slips = shear > strength * (1 + 1e-12)
    distance = np.abs(face.position - 0.5 * face.position.max())
    middle = int(np.argmin(np.where(slips & ~slips.all(), np.inf, distance)))
    sigma, tau, peak = (float(values[middle]) for values in (fault.normal_stress_0, shear, strength))
    yield Row(f"{label}: initial stress", sigma, "Pa", f"shear {tau:.6g} Pa, at position {face.position[middle]:.4g} m")
    slowest = min(model.materials, key=lambda m: m.wave_speeds(model.case.plane).c_s)
    speeds = slowest.wave_speeds(model.case.plane)
    modulus = slowest.density * speeds.c_s**2
    if model.case.plane != "antiplane":
        modulus = fracture.effective_modulus(modulus, speeds.c_p, speeds.c_s)
    # Inside whatever wrapper the law has.
    law = fault.friction
    while hasattr(law, "law"):
        law = law.law
    numbers = {
        name: float(np.broadcast_to(value, face.position.shape)[middle])
        for name, value in law
        if isinstance(value, float | int | np.ndarray)
    }
    if {"a", "b", "D_c"} <= numbers.keys():
        yield from _rate_and_state_rows(label, numbers, sigma, modulus, spacing)
        return
    yield Row(f"{label}: strength at rest", peak, "Pa")
    if slips.any():
        ratio = float(np.max(shear[slips] / np.maximum(strength[slips], 1e-300)))
        where = "everywhere" if slips.all() else f"at {np.count_nonzero(slips)} points"
        yield Row(f"{label}: shear / strength", ratio, "", f"it slips from the first step {where}", "warning")
    if {"mu_d", "D_c"} <= numbers.keys():
        exponential = law.kind() == "exponential_slip_weakening"
        yield from _slip_weakening_rows(label, numbers, exponential, (peak, tau, sigma), modulus, spacing, model)


def _slip_weakening_rows(
    label: str, law: dict[str, float], exponential: bool, stress: tuple[float, float, float], modulus: float,
    spacing: float, model: Model,
) -> Iterator[Row]:  # fmt: skip
    """S, critical lengths and process zone, for laws with a residual strength and a weakening slip."""
    peak, tau, sigma = stress
    residual = law["mu_d"] * sigma
    strength_drop = peak - residual
    if strength_drop <= 0:
        yield Row(f"{label}: strength drop", strength_drop, "Pa", "does not weaken")
        return
    # An exponential law has the fracture energy of a linear one with twice its D_c.
    slip = law["D_c"] * (2 if exponential else 1)
    energy = 0.5 * strength_drop * slip
    yield Row(f"{label}: fracture energy", energy, "J/m2")
    if tau > residual:
        ratio = (peak - tau) / (tau - residual)
        plane = model.case.plane
        verdict = "antiplane: never supershear"
        if plane != "antiplane":
            verdict = "may go supershear" if ratio < 1.77 else "stays sub-Rayleigh"
            verdict += " (limit 1.77, Burridge 1973; Andrews 1976)"
        yield Row(f"{label}: S", ratio, "", verdict)
        critical = fracture.critical_half_length(energy, 2 * modulus, tau - residual)
        yield Row(f"{label}: critical half-length", critical, "m", "Griffith, under the stress drop (Andrews 1976)")
        # Instability of linear slip weakening: half-length 0.579 G* D_c / (tau_p - tau_r), whatever the load.
        nucleation = 0.579 * modulus * slip / strength_drop
        yield Row(f"{label}: nucleation half-length", nucleation, "m", "under slow loading (Uenishi and Rice 2003)")
    zone = fracture.static_process_zone(modulus, slip, strength_drop)
    yield Row(f"{label}: static process zone", zone, "m", "shrinks as 1/A_II with rupture speed")
    points = zone / max(spacing, 1e-300)
    yield Row(
        f"{label}: points in it", points, "", "" if points >= 5 else "too few: 5 or more resolve a front",
        "ok" if points >= 5 else "warning",
    )  # fmt: skip


def _rate_and_state_rows(
    label: str, law: dict[str, float], sigma: float, modulus: float, spacing: float
) -> Iterator[Row]:
    """Critical stiffness and lengths of rate and state friction."""
    a, b, slip = law["a"], law["b"], law["D_c"]
    yield Row(f"{label}: b - a", b - a, "", "velocity weakening" if b > a else "velocity strengthening: stable")
    length = modulus * slip / (b * sigma)
    yield Row(f"{label}: L_b", length, "m", "G* D_c / (b sigma), the process zone (Dieterich 1992)")
    points = length / max(spacing, 1e-300)
    yield Row(
        f"{label}: points in L_b", points, "", "" if points >= 3 else "too few: 3 or more resolve a front",
        "ok" if points >= 3 else "warning",
    )  # fmt: skip
    if b > a:
        yield Row(f"{label}: k_c", (b - a) * sigma / slip, "Pa/m", "critical stiffness (Ruina 1983)")
        yield Row(f"{label}: h*", np.pi * modulus * slip / ((b - a) * sigma), "m", "pi G* D_c / ((b - a) sigma), "
                  "wavelength that slides unstably (Rice and Ruina 1983)")  # fmt: skip
        half = b / (np.pi * (b - a) ** 2) * modulus * slip / sigma
        yield Row(f"{label}: nucleation half-length", half, "m", "ageing law, a/b > 0.5 (Rubin and Ampuero 2005)")


def _cost(model: Model, motion: object, steps: int | None) -> Iterator[Row]:
    """Memory and run time, from a few real steps."""
    state = model.initial_state()
    motion.step(state)  # type: ignore[attr-defined]
    begin = time.perf_counter()
    for _ in range(5):
        motion.step(state)  # type: ignore[attr-defined]
    each = (time.perf_counter() - begin) / 5
    vectors = 8 * 8 * model.nodes * model.components
    yield Row("memory of the vectors", vectors / 1e6, "MB", "per rank, without the mesh")
    where = f"on {model.comm.size} rank(s), without output"
    if steps is None:
        yield Row("time of a step", each, "s", where)
    else:
        yield Row("expected run time", each * steps, "s", f"{each:.3g} s per step {where}")
