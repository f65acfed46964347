"""Lamb's problem: a strip and a line load on a half space; displacement of the surface against Cagniard and de Hoop.

Vertical Ricker load of 10 Hz on a narrow strip of the surface, and the same force at a point, plane strain, c_p 3200,
c_s 1847.5 m/s. An impulse on a line moves the surface at the distance x after the time p x by

    u_z = Im[a / (c_s^2 R)] / (pi mu x) downwards,    u_x = Im[p (g - 2 a b) / R] / (pi mu x)

with a = sqrt(1/c_p^2 - p^2), b = sqrt(1/c_s^2 - p^2), g = 1/c_s^2 - 2 p^2, R = g^2 + 4 p^2 a b just above the real axis
of p. The convolution with the wavelet f is Im of an integral of K(p) f(t - p x) over p; all is analytic above the axis,
so that the path of integration passes over the branch points and the Rayleigh pole.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from benchmarks._cases import table_of
from ruptfx import Table
from ruptfx.app.bench import Check, Outcome
from ruptfx.case import Case
from ruptfx.platform import fem
from ruptfx.run.model import Model

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ruptfx.platform.fem import MPI

STRIP = table_of("lamb")
C_P, C_S, RHO = (STRIP["materials"]["default"][name] for name in ("c_p", "c_s", "density"))
FORCE = STRIP["boundaries"][-1]
FREQUENCY, DELAY = FORCE["history"]["frequency"], FORCE["history"]["delay"]
HALF_WIDTH, LOAD = FORCE["x_range"][1], -FORCE["traction"][1]  # m, Pa
RECEIVERS = (700.0, 1200.0)
DURATION = STRIP["duration"]
SOURCE = "Lamb (1904); de Hoop (1960)"


def case(size: float, kind: str = "strip") -> Table:
    """Return the right half of the problem and of the force: a strip, or a point."""
    table = table_of("lamb")
    table["mesh"]["element_size"] = size
    if kind == "point":
        point = {"kind": "point_force", "point": [0.0, 750.0], "force": [0.0, -LOAD * HALF_WIDTH]}
        table["boundaries"][-1] = point | {"history": FORCE["history"]}
    return table


def exact(x: float, time: np.ndarray, half_width: float = HALF_WIDTH) -> np.ndarray:
    """Return the displacement (right, up) of the surface at x, shape (times, 2) [m]."""
    # As high above the axis as the wavelet, which grows there as exp((pi f x Im p)^2), allows; down to p = 0 at the
    # left, on to where the wavelet has not begun at the right.
    height, end = 1.5 / (np.pi * FREQUENCY * x), (time[-1] + DELAY) / (x - half_width)
    nodes, weights = np.polynomial.legendre.leggauss(2000)
    nodes, weights = 0.5 * (nodes + 1), 0.5 * weights
    p = np.concatenate([1j * height * nodes, 1j * height + end * nodes])
    dp = np.concatenate([1j * height * weights, end * weights])
    a, b, g = np.sqrt(1 / C_P**2 - p**2), np.sqrt(1 / C_S**2 - p**2), 1 / C_S**2 - 2 * p**2
    R = g**2 + 4 * p**2 * a * b
    kernels = np.stack([p * (g - 2 * a * b) / R, -a / (C_S**2 * R)]) * dp
    result = np.zeros((len(time), 2))
    places, shares = np.polynomial.legendre.leggauss(8)  # of the strip
    for place, share in zip(places, shares, strict=True):
        argument = (np.pi * FREQUENCY * (time[:, None] - DELAY - p * (x - half_width * place))) ** 2
        result += 0.5 * share * (((1 - 2 * argument) * np.exp(-argument)) @ kernels.T).imag
    return 2 * HALF_WIDTH * LOAD / (np.pi * RHO * C_S**2) * result


def surface(size: float, kind: str = "strip") -> tuple[np.ndarray, np.ndarray, float]:
    """Return times, displacement at the receivers, shape (times, receivers, 2) [m], and energy closure."""
    problem = Case.model_validate(case(size, kind))
    model = Model(problem, fem.MPI.COMM_SELF)
    motion, state = problem.stepper.bind(model), model.initial_state()
    top = np.flatnonzero(model.coordinates[:, 1] > 750.0 * (1 - 1e-9))
    nodes = [top[np.argmin(np.abs(model.coordinates[top, 0] - x))] for x in RECEIVERS]
    times, found = [0.0], [np.zeros((len(nodes), 2))]
    while state.time < DURATION:
        motion.step(state)
        if state.step % 10 == 0:
            times.append(state.time)
            found.append(state.displacement.reshape(-1, 2)[nodes].copy())
    energy = model.energies(state)
    lost = 2 * energy["boundary_work"] - sum(energy.values())
    return np.array(times), np.array(found), abs(lost / energy["boundary_work"])


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    del comm
    checks, drawn = [], {}
    for kind, half_width in (("strip", HALF_WIDTH), ("point", 0.0)):
        time, found, closure = surface(12.5 if fine else 25.0, kind)
        reference = np.stack([exact(x, time, half_width) for x in RECEIVERS], axis=1)
        drawn[kind] = time, found, reference
        for i, x in enumerate(RECEIVERS):
            for component, name in enumerate(("along the surface", "across it")):
                off = np.abs(found[:, i, component] - reference[:, i, component]).max()
                worst = float(off / np.abs(reference[:, i, component]).max())
                label = f"{kind}, {x:g} m, {name}: largest misfit over peak"
                checks.append(Check(label, 0.0, worst, 5e-3, "1", SOURCE))
        checks.append(Check("energy closure", 0.0, closure, 1e-3, "1", "exact"))
    return Outcome(checks, lambda: _draw(*drawn["point"]))


def _draw(time: np.ndarray, found: np.ndarray, reference: np.ndarray) -> Figure:
    from ruptfx.results.figure_style import new_figure

    figure, (axes,) = new_figure(1, 2, 3.2, 8, sharey=True)
    for ax, component, name in zip(axes, (0, 1), ("along the surface", "upwards"), strict=True):
        for i, x in enumerate(RECEIVERS):
            ax.plot(time, 1e3 * found[:, i, component], label=f"{x:g} m")
            ax.plot(time, 1e3 * reference[:, i, component], "k:", lw=1)
        ax.set(xlabel="time (s)", title=name, xlim=(0.2, DURATION))
    axes[0].set_ylabel("displacement (mm)")
    axes[0].legend(frameon=False)
    return figure
