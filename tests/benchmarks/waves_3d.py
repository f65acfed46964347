"""Waves in three dimensions: explosion and double couple in a full space, a force on a half space, a thin plate.

- Explosion and double couple M_xy in a full space, an eighth of it: on planes of symmetry the motion across is zero, on
  those of antisymmetry the motion along them. Near and far field at (3, 2, 1) km; the moment grows to M_0 within 1 s as
  s - sin(2 pi s) / (2 pi). Source: Aki and Richards (2002), equation 4.29.
- Vertical force with a Ricker wavelet of 1 Hz on a half space, nu = 1/4, a quarter of it: displacement of the surface
  at 2 km. The numbers are a finite integral over the slowness (Pekeris 1955, convolved with the wavelet), which agrees
  with an integral over wavenumber and frequency to 3e-9 m.
- The lowest symmetric Lamb wave of a plate, half of its thickness and of its length: it starts in its mode shape and
  stands. It is slower than the longitudinal wave of plane stress, by the inertia across the plate.
  Source: Rayleigh-Lamb equation.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from ruptfx import Table
from ruptfx.app.bench import Check, Outcome
from ruptfx.app.bench._rupture import elastic
from ruptfx.case import Case
from ruptfx.platform import fem
from ruptfx.run.model import Model

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ruptfx.platform.fem import MPI

Array = np.ndarray
Course = Callable[[Array], tuple[Array, Array]]

C_P, RHO = 6000.0, 2700.0
C_S = {"full": 3464.1, "half": C_P / np.sqrt(3)}
RISE, MOMENT, RECEIVER = 1.0, 1e16, (3e3, 2e3, 1e3)
FORCE, FREQUENCY, DELAY, DISTANCE = 1e15, 1.0, 1.5, 2e3
STUCK = 2e11  # Pa, above the tractions next to the sources, and not so far above that rounding spoils the budget
# Displacement of the surface of the half space [m] by time [s]: into the body, and away from the force.
PEKERIS = np.array([
    (1.0, 0.001100, -0.002528), (1.2, 0.012247, -0.013337), (1.4, 0.026476, 0.083035), (1.6, -0.312365, 0.611132),
    (1.7, -0.781632, 0.727548), (1.8, -1.167028, 0.265326), (1.9, -0.890198, -0.769095), (2.0, 0.313969, -1.669417),
    (2.1, 1.771736, -1.586276), (2.2, 2.299394, -0.502753), (2.3, 1.473207, 0.676832), (2.4, 0.083749, 1.120299),
    (2.6, -0.936337, 0.313988), (2.8, -0.291825, -0.109592), (3.0, -0.028350, -0.058399),
])  # fmt: skip
# The plate: thickness [m], speeds [m/s], density [kg/m3].
THICKNESS, PLATE = 9.5e-3, (2583.0, 1255.0, 1246.0)
LAMB = {20: (2191.28739, 11533.092), 10: (2183.47100, 22983.905), 5: (2148.63289, 45234.377)}
"""Speed [m/s] and frequency [1/s] of the lowest symmetric wave, by its length over the thickness."""


def corner(size: float, edge: float, height: float, symmetry: str, duration: float, material: Table) -> Table:
    """Return a block with a corner at the origin; its side y = 0 is a plane of symmetry or of antisymmetry.

    The interface of the side is so strong that it neither opens nor slides.
    """
    stuck = {
        "contact": {"kind": "split_node"}, "friction": {"kind": "coulomb", "mu_d": 100.0},
        "initial_stress": {"normal": STUCK},
    }  # fmt: skip
    return {
        "plane": "solid", "order": 4, "duration": duration,
        "mesh": {
            "kind": "extruded", "thickness": height, "layers": max(1, round(height / size)),
            "section": {
                "kind": "half_plate", "length": edge, "height": edge, "element_size": size, "symmetry": symmetry,
            },
        },
        "materials": {"default": material}, "faults": {"main": stuck}, "boundaries": [],
    }  # fmt: skip


def fixed(edge: str, components: str) -> list[Table]:
    """Return boundaries that keep components of an edge at rest."""
    return [{"kind": "driven", "edge": f"upper.{edge}", "component": each, "velocity": 0.0} for each in components]


def recorded(table: Table, point: tuple[float, ...], every: int = 1) -> tuple[Array, Array, float]:
    """Run a case; return times [s], displacement at the node next to a point [m], and energy closure."""
    case = Case.model_validate(table)
    model = Model(case, fem.MPI.COMM_SELF)
    motion, state = case.stepper.bind(model), model.initial_state()
    node = int(np.argmin(np.linalg.norm(model.coordinates - np.array(point), axis=1)))
    times, found = [0.0], [np.zeros(3)]
    while state.time < case.duration:
        motion.step(state)
        if state.step % every == 0:
            times.append(state.time)
            found.append(state.displacement.reshape(-1, 3)[node].copy())
    energy = model.energies(state)
    work = energy.pop("boundary_work")
    largest = max(map(abs, (work, *energy.values())))
    return np.array(times), np.array(found), abs(work - sum(energy.values())) / largest


def course(time: Array) -> tuple[Array, Array]:
    """Return the moment over M_0 and its rate [1/s] at times [s]."""
    s = np.clip(time / RISE, 0, 1)
    turn = 2 * np.pi
    growth = s - np.sin(turn * s) / turn
    return growth, (1 - np.cos(turn * s)) / RISE


def full_space(
    tensor: Array, time: Array, c_p: float = C_P, c_s: float = C_S["full"],
    receiver: Array | tuple[float, ...] = RECEIVER, course: Course = course,
) -> Array:  # fmt: skip
    """Return the displacement at a receiver by a moment tensor over M_0 at the origin, shape (times, 3) [m]."""
    x = np.array(receiver)
    r = float(np.linalg.norm(x))
    g = x / r
    nodes, weights = np.polynomial.legendre.leggauss(200)
    delay = r / c_p + 0.5 * (nodes + 1) * (r / c_s - r / c_p)
    near = (course(time[:, None] - delay)[0] * delay) @ weights * 0.5 * (r / c_s - r / c_p)
    (of_p, rate_p), (of_s, rate_s) = course(time - r / c_p), course(time - r / c_s)
    one, ggg = np.eye(3), np.einsum("i,j,k->ijk", g, g, g)
    some = np.einsum("i,jk->ijk", g, one) + np.einsum("j,ik->ijk", g, one) + np.einsum("k,ij->ijk", g, one)
    along = np.einsum("k,ij->ijk", g, one)  # g_q delta_np
    terms = [
        (15 * ggg - 3 * some, near / r**4),
        (6 * ggg - some, of_p / (c_p * r) ** 2),
        (-(6 * ggg - some - along), of_s / (c_s * r) ** 2),
        (ggg, rate_p / (c_p**3 * r)),
        (-(ggg - along), rate_s / (c_s**3 * r)),
    ]
    sums = [np.outer(each, np.einsum("ijk,jk->i", shape, tensor)) for shape, each in terms]
    return MOMENT / (4 * np.pi * RHO) * np.sum(sums, axis=0)


def source(kind: str, size: float, edge: float) -> tuple[Array, Array, Array, float]:
    """Return times [s], displacement and exact displacement at the receiver [m], and energy closure."""
    times = np.linspace(0, RISE, 1001)
    explosion = kind == "explosion"
    table = corner(size, edge, edge, "symmetric" if explosion else "antisymmetric", 2.2, elastic(C_P, C_S["full"], RHO))
    table["boundaries"] = [
        *fixed("left", "x" if explosion else "yz"), *fixed("back", "z"),
        *({"kind": "absorbing", "edge": f"upper.{name}"} for name in ("right", "top", "front")),
        {
            "kind": "moment", "point": [0.0, 0.0, 0.0],
            "moment": [MOMENT / 8 * each for each in ((1, 1, 1, 0, 0, 0) if explosion else (0, 0, 0, 1, 0, 0))],
            "history": {"kind": "sampled", "times": list(times), "values": list(course(times)[0])},
        },
    ]  # fmt: skip
    tensor = np.eye(3) if explosion else np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, 0]])
    time, found, closure = recorded(table, RECEIVER)
    return time, found, full_space(tensor, time), closure


def half_space(size: float, edge: float) -> tuple[Array, Array, float]:
    """Return times [s], displacement of the surface at the receiver (into the body, outwards) [m], energy closure."""
    table = corner(size, edge, edge, "symmetric", 3.0, elastic(C_P, C_S["half"], RHO))
    table["boundaries"] = [
        *fixed("left", "x"), *({"kind": "absorbing", "edge": f"upper.{name}"} for name in ("right", "top", "front")),
        {
            "kind": "point_force", "point": [0.0, 0.0, 0.0], "force": [0.0, 0.0, FORCE / 4],
            "history": {"kind": "ricker", "frequency": FREQUENCY, "delay": DELAY},
        },
    ]  # fmt: skip
    time, found, closure = recorded(table, (DISTANCE, 0.0, 0.0))
    return time, found[:, [2, 0]], closure


def mode_shape(wavelength: float, speed: float) -> Callable[[Array], Array]:
    """Return the symmetric Lamb mode as a function of points in x and y, the middle of the plate at y = 0."""
    c_p, c_s, _ = PLATE
    k = 2 * np.pi / wavelength
    p, q = (np.sqrt(complex((k * speed / c) ** 2 - k**2)) for c in (c_p, c_s))
    h = 0.5 * THICKNESS
    b = 2 * k * p * np.sin(p * h) / ((q**2 - k**2) * np.sin(q * h))  # no shear traction at y = h

    def shape(points: Array) -> Array:
        x, y = points[:, 0], points[:, 1]
        u_x = (-k * np.cos(p * y) + q * b * np.cos(q * y)) * np.sin(k * x)
        u_y = (-p * np.sin(p * y) - k * b * np.sin(q * y)) * np.cos(k * x)
        return np.stack([u_x.real, u_y.real, 0 * x], axis=1) / k

    return shape


def lamb_speed(ratio: int, size: float, periods: int = 4) -> tuple[float, float]:
    """Return the speed of the lowest symmetric wave [m/s] of a length over thickness, and the energy closure."""
    wavelength, (speed, frequency) = ratio * THICKNESS, LAMB[ratio]
    table = corner(size, 0.5 * wavelength, size, "symmetric", periods / frequency, elastic(*PLATE))
    table["mesh"]["section"]["height"] = 0.5 * THICKNESS
    table["faults"]["main"]["initial_stress"]["normal"] = 1e7  # some 10 times the tractions of the wave
    table["boundaries"] = [each for name, c in (("left", "x"), ("right", "x"), ("back", "z"), ("front", "z"))
                           for each in fixed(name, c)]  # fmt: skip
    case = Case.model_validate(table)
    model = Model(case, fem.MPI.COMM_SELF)
    motion, state = case.stepper.bind(model), model.initial_state()
    shape = 1e-6 * mode_shape(wavelength, speed)(model.coordinates).ravel()
    weight = model.mass * shape
    state.displacement[:] = shape
    before = 0.0
    times, amounts = [0.0], [float(weight @ shape)]
    while state.time < case.duration:
        motion.step(state)
        before = before or sum(model.energies(state).values())
        times.append(state.time)
        amounts.append(float(weight @ state.displacement))
    # Zeros of the cosine, linear between two steps.
    sign = np.array(amounts)
    at = np.flatnonzero(sign[:-1] * sign[1:] < 0)
    zeros = np.array(times)[at] + np.diff(times)[at] * sign[at] / (sign[at] - sign[at + 1])
    after = sum(model.energies(state).values())
    return wavelength * 0.5 * (len(zeros) - 1) / (zeros[-1] - zeros[0]), abs(after / before - 1)


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    """Check the displacement at receivers and the speed of the plate."""
    del comm
    checks, drawn = [], {}
    for kind in ("explosion", "double couple"):
        time, found, exact, closure = source(kind, 500.0 if fine else 1000.0, 9e3)
        drawn[kind] = time, found, exact
        off = float(np.abs(found - exact).max() / np.abs(exact).max())
        checks.append(Check(f"{kind}: largest misfit over peak", 0.0, off, 1e-2, "1", "Aki and Richards (2002)"))
        checks.append(Check("energy closure", 0.0, closure, 1e-9, "1", "exact"))
    time, found, closure = half_space(500.0 if fine else 2000 / 3, 10e3)
    at, exact = PEKERIS[:, 0], PEKERIS[:, 1:]
    sampled = np.stack([np.interp(at, time, each) for each in found.T], axis=1)
    drawn["force on a half space"] = at, sampled, exact
    for number, name in enumerate(("into the body", "along the surface")):
        off = float(np.abs(sampled - exact)[:, number].max() / np.abs(exact[:, number]).max())
        name = f"force on a half space, {name}: largest misfit over peak"
        checks.append(Check(name, 0.0, off, 2e-2, "1", "Pekeris (1955)"))
    checks.append(Check("energy closure", 0.0, closure, 1e-9, "1", "exact"))
    for ratio, (exact_speed, _) in LAMB.items():
        speed, closure = lamb_speed(ratio, THICKNESS / (4 if fine else 2))
        name = f"plate, wave of {ratio} thicknesses: speed"
        checks.append(Check(name, exact_speed, speed, 2e-3, "m/s", "Rayleigh-Lamb equation", relative=True))
        checks.append(Check("energy closure", 0.0, closure, 1e-9, "1", "exact"))
    return Outcome(checks, lambda: _draw(drawn))


def _draw(drawn: dict[str, tuple[Array, Array, Array]]) -> Figure:
    from ruptfx.results.figure_style import new_figure

    figure, (axes,) = new_figure(1, 3, 3.2, 11)
    for ax, (name, (time, found, exact)) in zip(axes, drawn.items(), strict=True):
        for number, values in enumerate(found.T):
            label = "xyz"[number] if found.shape[1] == 3 else ("down", "outwards")[number]
            ax.plot(time, values, label=label)
            ax.plot(time, exact[:, number], "k:", lw=1)
        ax.set(xlabel="time (s)", title=name)
        ax.legend(frameon=False, loc="upper left")
    axes[0].set_ylabel("displacement (m)")
    return figure
