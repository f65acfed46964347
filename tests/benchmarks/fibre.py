"""Pull-out of a fibre, axisymmetric and quasi-static, against shear lag.

The fibre of `demos/fibre_pull_out.toml`, but without lateral contraction, so that the pressure on it stays what it was:
all of it then slides at 2 pi R L mu p, exactly but for radiation damping, which is 2e-6 of it. Force against
displacement, while a part of it slides under Coulomb friction, is compared with a bar in a matrix, which leaves out how
the fibre is sheared and the matrix stretched, and that next to the loaded end, over a length like R, shear takes
pressure away: all of first order in R over the decay length lambda, which matrices that are 4 and 16 times softer,
where lambda is twice and four times as long, must show; and whether it slides steadily under the ageing law with the
length above which the bar does not.

The glued fibre of `demos/fibre_debonding.toml`, without lateral contraction, too, is pulled out in explicit steps: the
bond dissipates its energy times its area. Without friction, the force while a crack runs along a long fibre is that of
any theory, as it needs only the strain of the free fibre: pi R^2 sqrt(4 E energy / R). Pulled at 0.05 m/s with ageing
law, it debonds, and then slides steadily or sticks and slips, as its length is below or above that of the bar.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from math import pi, sqrt
from typing import TYPE_CHECKING

import numpy as np

from ruptfx import Table
from ruptfx.app.bench import Check, Outcome
from ruptfx.case import Case, parse_case
from ruptfx.platform import fem
from ruptfx.results.analysis.fibre import ShearLag
from ruptfx.run.model import Model

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SPEED = 10e-6  # m/s
SHARES = (0.85, 1.25)  # of the critical length
STRESS, MU, A, B, D_C = 20e6, 0.3, 0.01, 0.03, 2.5e-6
ENERGY = 50.0  # J/m2, of the glue
SLOWLY = 0.05  # m/s, at which glued fibres of LENGTHS under the ageing law are pulled
LENGTHS = (15e-3, 30e-3)  # m; the critical one is 21 mm
SOURCE = "shear lag, Cox (1952)"


def bar(length: float, softer: float = 1.0) -> ShearLag:
    """Return the fibre of the demo with another length [m], in a matrix softer by a factor."""
    return ShearLag(1e-3, 5e-3, length, 70e9, 3.2e9 / 2 / softer)


@dataclass(frozen=True)
class Pull:
    """Time [s], displacement [m] and force [N] of the loaded end."""

    time: np.ndarray
    moved: np.ndarray
    force: np.ndarray


def pull(length: float, duration: float, friction: Table, size: float, softer: float = 1.0, steps: int = 300) -> Pull:
    """Pull a fibre out."""
    table = tomllib.loads(files("ruptfx").joinpath("demos/fibre_pull_out.toml").read_text())
    table |= {"duration": duration, "instruments": [], "output": {"figures": False}, "damping": {}}
    table["mesh"] |= {"length": length, "element_size": size}
    for material in table["materials"].values():
        material["poisson_ratio"] = 0.0
    table["materials"]["matrix"]["young_modulus"] /= softer
    table["faults"]["main"]["friction"] = friction
    table["boundaries"][0]["ramp"] = 0.0
    table["stepper"] = {
        "kind": "quasi_static", "rate_tolerance": 0.1, "radiation_damping": True, "largest_step": duration / steps,
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
    """Pull a fibre of 30 mm whose sliding zone grows under Coulomb friction."""
    lag = bar(30e-3)
    return lag, pull(lag.length, 10.0, {"kind": "coulomb", "mu_d": MU}, size)


@cache
def short_of_bar(softer: float, size: float) -> float:
    """Return the relative deficit of the force against the bar, at a slip zone of one decay length."""
    decay = bar(1.0, softer).decay_length
    lag = bar(round(5 * decay, 3), softer)
    moved, force = lag.pulled(MU * STRESS, np.array([decay]))
    found = pull(lag.length, 1.05 * moved[0] / SPEED, {"kind": "coulomb", "mu_d": MU}, size, softer, 60)
    return float(1 - np.interp(moved[0], found.moved, found.force) / force[0])


@cache
def ageing(share: float, size: float) -> tuple[ShearLag, Pull]:
    """Pull a fibre of a fraction `share` of the critical length under the ageing law."""
    critical = bar(1.0).critical_length(STRESS * (B - A) / D_C)
    lag = bar(share * critical)
    law = {"kind": "rate_and_state_ageing", "a": A, "b": B, "D_c": D_C, "f_0": MU, "V_0": SPEED, "theta_initial": 1.0}
    return lag, pull(lag.length, 45.0, law, size)


@dataclass(frozen=True)
class Debonding(Pull):
    """Pull of a glued fibre.

    Besides: debonded length [m], energy of the whole bond and energy dissipated by debonding [J].
    """

    broken: np.ndarray
    bond: float
    taken: float


def debonding(table: Table, size: float) -> tuple[ShearLag, Debonding]:
    """Pull a glued fibre with friction; `table` holds the differences from the demo."""
    demo = tomllib.loads(files("ruptfx").joinpath("demos/fibre_debonding.toml").read_text())
    demo |= {"instruments": [], "output": {"figures": False}}
    length, fault = table.get("length", demo["mesh"]["length"]), demo["faults"]["main"]
    demo["mesh"] |= {"element_size": size, "length": length}
    for value in fault["cohesion"].values():
        if isinstance(value, dict):
            value["positions"][-1] = length
    fault["friction"] = table.get("friction", fault["friction"])
    pulled = demo["boundaries"][0]
    pulled["velocity"] = -table.get("speed", -pulled["velocity"])
    demo["duration"], demo["damping"] = table.get("duration", demo["duration"]), table.get("damping", demo["damping"])
    for material in demo["materials"].values():
        material["poisson_ratio"] = 0.0
    case = parse_case(demo)
    assert isinstance(case, Case)
    model = Model(case, fem.MPI.COMM_SELF)
    motion, state = case.stepper.bind(model), model.initial_state()
    face, rows = model.faults[0].interface, []
    speed, ramp = (abs(pulled["velocity"]), 20e-6)
    every = max(20, int(case.duration / motion.dt / 3000))
    while state.time < case.duration * (1 - 1e-9):
        motion.step(state)
        if state.step % every == 0:
            found = state.faults["main"]
            force = abs(float(face.weight @ found["shear_traction"].reshape(-1)))
            broken = face.position[found["damage"].reshape(-1) >= 1].max(initial=0.0)
            rows.append((state.time, speed * (state.time - 0.5 * ramp), force, broken))
    energy = fault["cohesion"]["G_IIc"]
    bond = float(face.weight @ np.interp(face.position, energy["positions"], energy["values"]))
    time, moved, force, broken = np.array(rows).T
    return bar(length), Debonding(time, moved, force, broken, bond, model.energies(state)["fracture"])


@cache
def rubbing(size: float) -> tuple[ShearLag, Debonding]:
    """Pull the fibre of the demo, 30 mm under Coulomb friction."""
    return debonding({}, size)


@cache
def smooth(size: float) -> tuple[ShearLag, Debonding]:
    """Pull the same fibre without friction, until it is debonded."""
    return debonding({"friction": {"kind": "coulomb", "mu_d": 0.0}, "duration": 130e-6}, size)


@cache
def weakening(length: float) -> tuple[ShearLag, Debonding]:
    """Pull a glued fibre slowly under the ageing law."""
    law = {
        "kind": "rate_and_state_ageing", "a": A, "b": B, "D_c": D_C, "f_0": MU, "V_0": SLOWLY,
        "theta_initial": D_C / SLOWLY,
    }  # fmt: skip
    table: Table = {"friction": law, "speed": SLOWLY, "duration": 4e-3, "damping": {"mass": 1e4}, "length": length}
    return debonding(table, 1e-3)


def crack_force(lag: ShearLag) -> float:
    """Return the force that drives a crack along a long fibre without friction [N]."""
    return pi * lag.radius**2 * sqrt(4 * lag.young_modulus * ENERGY / lag.radius)


def swing(pulled: Pull) -> float:
    """Return largest over smallest force of the last third, minus one."""
    late = pulled.force[pulled.time > pulled.time[-1] * 2 / 3]
    return float(late.max() / late.min() - 1)


def run(fine: bool, comm: fem.MPI.Comm) -> Outcome:
    """Run the benchmark; every rank returns the same checks."""
    size = 0.5e-3 if fine else 1e-3
    lag, sliding = coulomb(size)
    friction = 2 * pi * lag.radius * MU * STRESS
    moved, force = lag.pulled(MU * STRESS, lag.length * np.array([0.25, 0.5, 0.75]))
    found = np.interp(moved, sliding.moved, sliding.force)
    stable, unstable = (ageing(share, size) for share in SHARES)
    debonded, free = rubbing(size)[1], smooth(size)
    crack = (free[1].broken > 8e-3) & (free[1].broken < 12e-3)
    short, long = (weakening(length)[1] for length in LENGTHS)
    balance = "equilibrium"
    checks = [
        Check("Coulomb: force when all of it slides", friction * lag.length, sliding.force[-1], 1e-5, "N", balance,
              relative=True),
        *(
            Check(f"Coulomb: force when {part} of it slides", expected, got, 0.05, "N", SOURCE, relative=True)
            for part, expected, got in zip(("a quarter", "half", "three quarters"), force, found, strict=True)
        ),
        *(
            Check(f"Coulomb, matrix {softer} times softer: what the bar misses over what it did before",
                  1 / sqrt(softer), short_of_bar(softer, sqrt(softer) * size) / short_of_bar(1, size), 0.05, "1",
                  "R / lambda", relative=True)
            for softer in (4, 16)
        ),
        Check("glued: energy that the bond took", debonded.bond, debonded.taken, 0.01, "J", "G_IIc times its area",
              relative=True),
        Check("glued, no friction: force while 8 to 12 mm are broken", crack_force(free[0]),
              float(free[1].force[crack].mean()), 0.02, "N", "energy balance of a long fibre", relative=True),
        Check("glued, ageing law, 15 mm: swing of force when debonded", 0.1, swing(short), 0, "1", SOURCE, "at most"),
        Check("glued, ageing law, 30 mm: swing of force when debonded", 0.3, swing(long), 0, "1", SOURCE, "at least"),
        Check("ageing law, 0.85 critical length: force in the end", friction * stable[0].length, stable[1].force[-1],
              1e-3, "N", balance, relative=True),
        Check("ageing law, 0.85 critical length: swing of force", 0.01, swing(stable[1]), 0, "1", SOURCE, "at most"),
        Check("ageing law, 1.25 critical length: swing of force", 0.1, swing(unstable[1]), 0, "1", SOURCE, "at least"),
    ]  # fmt: skip
    return Outcome(checks, lambda: figure(size))


def figure(size: float) -> Figure:
    """Draw force against displacement of the four fibres."""
    from ruptfx.results.figure_style import STEADY, STICK_SLIP, letter, new_figure, styled

    @styled
    def draw() -> Figure:
        picture, grid = new_figure(2, 2, 5.0)
        axes = grid.ravel()
        lag, sliding = coulomb(size)
        moved, force = lag.pulled(MU * STRESS, np.linspace(0, lag.length, 50))
        axes[0].plot(sliding.moved * 1e6, sliding.force, color=STEADY, label="finite elements")
        axes[0].plot(np.append(0, moved) * 1e6, np.append(0, force), "--", color="0.3", label="shear lag")
        axes[0].legend(title="Coulomb friction")
        lag, debonded = rubbing(size)
        moved, force = lag.pulled(MU * STRESS, np.linspace(6e-3, lag.length, 50), ENERGY)
        axes[1].plot(debonded.moved * 1e6, debonded.force, color=STEADY, lw=0.7)
        axes[1].plot(moved * 1e6, force, "--", color="0.3")
        axes[1].plot([], [], label="with friction", color=STEADY)
        free = smooth(size)[1]
        axes[1].plot(free.moved * 1e6, free.force, color=STICK_SLIP, lw=0.7, label="without")
        axes[1].axhline(crack_force(lag), color="0.3", ls="--")
        axes[1].legend(title="glued, Coulomb friction", loc="upper left")
        for share, colour in zip(SHARES, (STEADY, STICK_SLIP), strict=True):
            lag, pulled = ageing(share, size)
            axes[2].plot(pulled.moved * 1e6, pulled.force, color=colour, label=f"{share:g} critical length")
        axes[2].legend(title="ageing law")
        for length, colour in zip(LENGTHS, (STEADY, STICK_SLIP), strict=True):
            pulled = weakening(length)[1]
            axes[3].plot(pulled.moved * 1e6, pulled.force, color=colour, lw=0.7, label=f"{1e3 * length:.0f} mm")
        axes[3].legend(title="glued, ageing law")
        for ax in axes:
            ax.set(xlabel="Displacement (µm)", ylabel="Force (N)", xlim=(0, None), ylim=(0, None))
        axes[1].set_ylim(top=1.4 * axes[1].get_ylim()[1])  # room for the legend
        letter(axes)
        return picture

    return draw()
