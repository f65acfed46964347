"""Pull-out of a fibre, axisymmetric and quasi-static, against shear lag.

The fibre of `demos/fibre_pull_out.toml`, but without lateral contraction, so that the pressure on it stays what it was:
all of it then slides at 2 pi R L mu p, exactly but for radiation damping, which is 2e-6 of it. Force against
displacement, while a part of it slides under Coulomb friction, is compared with a bar in a matrix, which leaves out how
the fibre is sheared and the matrix stretched; and whether it slides steadily under the ageing law with the length above
which the bar does not.

The glued fibre of `demos/fibre_debonding.toml`, without lateral contraction, too, is pulled out in explicit steps:
the bond takes its energy times its area, and the figure has the force beside that of a bar whose crack takes it.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from math import pi
from typing import TYPE_CHECKING

import numpy as np

from ruptfx import Table, fem
from ruptfx.analysis.fibre import ShearLag
from ruptfx.bench import Check, Outcome
from ruptfx.case import Case, parse_case
from ruptfx.model import Model

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SPEED = 10e-6  # m/s
SHARES = (0.85, 1.25)  # of the critical length
STRESS, MU, A, B, D_C = 20e6, 0.3, 0.01, 0.03, 2.5e-6
ENERGY = 50.0  # J/m2, of the glue
SOURCE = "shear lag, Cox (1952)"


def bar(length: float) -> ShearLag:
    """The fibre of the demo with another length [m]."""
    return ShearLag(1e-3, 5e-3, length, 70e9, 3.2e9 / 2)


@dataclass(frozen=True)
class Pull:
    """Time [s], displacement [m] and force [N] of the loaded end."""

    time: np.ndarray
    moved: np.ndarray
    force: np.ndarray


def pull(length: float, duration: float, friction: Table, size: float) -> Pull:
    """Pull a fibre out."""
    table = tomllib.loads(files("ruptfx").joinpath("demos/fibre_pull_out.toml").read_text())
    table |= {"duration": duration, "instruments": [], "output": {"figures": False}, "damping": {}}
    table["mesh"] |= {"length": length, "element_size": size}
    for material in table["materials"].values():
        material["poisson_ratio"] = 0.0
    table["faults"]["main"]["friction"] = friction
    table["boundaries"][0]["ramp"] = 0.0
    table["stepper"] = {
        "kind": "quasi_static", "rate_tolerance": 0.1, "radiation_damping": True, "largest_step": duration / 300,
    }  # fmt: skip
    case = parse_case(table)
    assert isinstance(case, Case)
    model = Model(case, fem.MPI.COMM_SELF)
    motion, state = case.stepper.bind(model), model.initial_state()
    face, times, forces = model.faults[0].interface, [0.0], [0.0]
    while state.time < duration * (1 - 1e-9):
        motion.step(state)
        times.append(state.time)
        forces.append(float(abs(face.weight @ state.faults["main"]["shear_traction"].reshape(-1))))
    return Pull(np.array(times), SPEED * np.array(times), np.array(forces))


@cache
def coulomb(size: float) -> tuple[ShearLag, Pull]:
    """A fibre of 30 mm that slides over a longer and longer part of its length."""
    lag = bar(30e-3)
    return lag, pull(lag.length, 10.0, {"kind": "coulomb", "mu_d": MU}, size)


@cache
def ageing(share: float, size: float) -> tuple[ShearLag, Pull]:
    """A fibre of a share of the critical length under the ageing law."""
    critical = bar(1.0).critical_length(STRESS * (B - A) / D_C)
    lag = bar(share * critical)
    law = {"kind": "rate_and_state_ageing", "a": A, "b": B, "D_c": D_C, "f_0": MU, "V_0": SPEED, "theta_initial": 1.0}
    return lag, pull(lag.length, 45.0, law, size)


@dataclass(frozen=True)
class Debonding(Pull):
    """Besides, the energy of the bond and what was taken of it when it was broken [J]."""

    bond: float
    taken: float


@cache
def debonding(size: float) -> tuple[ShearLag, Debonding]:
    """A glued fibre of 30 mm whose bond breaks under friction."""
    table = tomllib.loads(files("ruptfx").joinpath("demos/fibre_debonding.toml").read_text())
    table |= {"instruments": [], "output": {"figures": False}}
    table["mesh"]["element_size"] = size
    for material in table["materials"].values():
        material["poisson_ratio"] = 0.0
    case = parse_case(table)
    assert isinstance(case, Case)
    model = Model(case, fem.MPI.COMM_SELF)
    motion, state = case.stepper.bind(model), model.initial_state()
    face, rows = model.faults[0].interface, []
    speed, ramp = (abs(table["boundaries"][0]["velocity"]), 20e-6)
    while state.time < case.duration * (1 - 1e-9):
        motion.step(state)
        if state.step % 20 == 0:
            found = state.faults["main"]
            force = abs(float(face.weight @ found["shear_traction"].reshape(-1)))
            rows.append((state.time, speed * (state.time - 0.5 * ramp), force))
    energy = table["faults"]["main"]["cohesion"]["G_IIc"]
    bond = float(face.weight @ np.interp(face.position, energy["positions"], energy["values"]))
    time, moved, force = np.array(rows).T
    return bar(table["mesh"]["length"]), Debonding(time, moved, force, bond, model.energies(state)["fracture"])


def swing(pulled: Pull) -> float:
    """Largest over smallest force of the last third, less one."""
    late = pulled.force[pulled.time > pulled.time[-1] * 2 / 3]
    return float(late.max() / late.min() - 1)


def run(fine: bool, comm: fem.MPI.Comm) -> Outcome:
    """The same on every rank."""
    size = 0.5e-3 if fine else 1e-3
    lag, sliding = coulomb(size)
    friction = 2 * pi * lag.radius * MU * STRESS
    moved, force = lag.pulled(MU * STRESS, lag.length * np.array([0.25, 0.5, 0.75]))
    found = np.interp(moved, sliding.moved, sliding.force)
    stable, unstable = (ageing(share, size) for share in SHARES)
    debonded = debonding(size)[1]
    balance = "equilibrium"
    checks = [
        Check("Coulomb: force when all of it slides", friction * lag.length, sliding.force[-1], 1e-5, "N", balance,
              relative=True),
        *(
            Check(f"Coulomb: force when {part} of it slides", expected, got, 0.05, "N", SOURCE, relative=True)
            for part, expected, got in zip(("a quarter", "half", "three quarters"), force, found, strict=True)
        ),
        Check("glued: energy that the bond took", debonded.bond, debonded.taken, 0.01, "J", "G_IIc times its area",
              relative=True),
        Check("ageing law, 0.85 critical length: force in the end", friction * stable[0].length, stable[1].force[-1],
              1e-3, "N", balance, relative=True),
        Check("ageing law, 0.85 critical length: swing of force", 0.01, swing(stable[1]), 0, "1", SOURCE, "at most"),
        Check("ageing law, 1.25 critical length: swing of force", 0.1, swing(unstable[1]), 0, "1", SOURCE, "at least"),
    ]  # fmt: skip
    return Outcome(checks, lambda: figure(size))


def figure(size: float) -> Figure:
    """Force against displacement of the four fibres."""
    from ruptfx.figure_style import STEADY, STICK_SLIP, letter, new_figure, styled

    @styled
    def draw() -> Figure:
        picture, (axes,) = new_figure(1, 3, 2.7)
        lag, sliding = coulomb(size)
        moved, force = lag.pulled(MU * STRESS, np.linspace(0, lag.length, 50))
        axes[0].plot(sliding.moved * 1e6, sliding.force, color=STEADY, label="finite elements")
        axes[0].plot(np.append(0, moved) * 1e6, np.append(0, force), "--", color="0.3", label="shear lag")
        axes[0].legend(title="Coulomb friction")
        lag, debonded = debonding(size)
        moved, force = lag.pulled(MU * STRESS, np.linspace(6e-3, lag.length, 50), ENERGY)
        axes[1].plot(debonded.moved * 1e6, debonded.force, color=STEADY, lw=0.7)
        axes[1].plot(moved * 1e6, force, "--", color="0.3")
        axes[1].set_title("glued")
        for share, colour in zip(SHARES, (STEADY, STICK_SLIP), strict=True):
            lag, pulled = ageing(share, size)
            axes[2].plot(pulled.moved * 1e6, pulled.force, color=colour, label=f"{share:g} critical length")
        axes[2].legend(title="ageing law")
        for ax in axes:
            ax.set(xlabel="Displacement (µm)", ylabel="Force (N)", xlim=(0, None), ylim=(0, None))
        letter(axes)
        return picture

    return draw()
