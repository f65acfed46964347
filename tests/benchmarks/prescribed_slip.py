"""Prescribed slip: the field of a small patch in three dimensions, and the surface displacement by slip at depth.

- Slip on a bell of 400 m at the middle of a fault in a full space, an eighth of it, with a rate that is a Gaussian in
  time: displacement at (3, 2, 1) km against the sum of double couples over the patch.
  Source: Aki and Richards (2002), equation 4.29.
- Static slip on a bell on a fault that dips by 60 degrees below the surface of a half-space, with a rake of 30 degrees:
  displacement of the surface against rectangular dislocations. The bell is zero at the rim of the fault, because slip
  that is uniform up to a welded rim ends within half an element there: its potency depends on the mesh.
  Source: Okada (1985).
- Static slip s(z) on a vertical fault in an antiplane half-space: displacement of the surface against that of screw
  dislocations, u(y) = 1 / pi int s(z) y / (y^2 + z^2) dz, in two boxes whose far edges are held.
  Source: Segall (2010), Earthquake and Volcano Deformation.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from benchmarks._okada import surface_displacement
from benchmarks.waves_3d import C_P, C_S, MOMENT, RECEIVER, RHO, Array, corner, fixed, full_space, recorded
from ruptfx.app.bench import Check, Outcome
from ruptfx.app.bench._rupture import elastic
from ruptfx.case import Case
from ruptfx.interfaces.slip_histories.gaussian import Gaussian
from ruptfx.platform import fem
from ruptfx.run.model import Model

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ruptfx.platform.fem import MPI

PATCH, WIDTH, DURATION = 400.0, 0.12, 2.4  # m; s
DEPTH, REACH = 8e3, 2e3  # of the slip in the half-space [m]
DIP, RAKE, TOP, RIM = 60.0, 30.0, 1e3, 7e3  # of the dipping fault: degrees; upper edge, from the bell to its rim [m]
DIPPING = {(40e3, 4e3): 0.04, (40e3, 2e3): 0.02, (80e3, 2e3): 0.01, (80e3, 4e3 / 3): 0.006}
"""Tolerances by distance of the far edges and element size [m]."""
STRIP = 500.0  # side of the rectangular dislocations [m]


def double_couple(size: float, edge: float) -> tuple[Array, Array, Array, float]:
    """Return times [s], displacement and exact displacement at the receiver [m], and energy closure."""
    mu = RHO * C_S["full"] ** 2
    slip = MOMENT / (mu * 2 * np.pi * PATCH**2)
    table = corner(size, edge, edge, "antisymmetric", DURATION, elastic(C_P, C_S["full"], RHO))
    # The corner of the block is the middle of the fault; everywhere else on it slip is held at zero.
    middle = {"x": 0.0, "y": 0.0, "z": 0.0}
    bell = {"kind": "gaussian", "background": 0.0, "amplitude": slip, "width": PATCH, "center": middle}
    table["faults"]["main"] = {
        "contact": {"kind": "split_node"}, "prescribed_slip": [{"kind": "gaussian", "slip": bell, "width": WIDTH}],
    }  # fmt: skip
    table["boundaries"] = [
        *fixed("left", "yz"),
        *fixed("back", "z"),
        *({"kind": "absorbing", "edge": f"upper.{name}"} for name in ("right", "top", "front")),
    ]
    time, displacement, closure = recorded(table, RECEIVER)
    history, tensor = Gaussian(slip=1.0, width=WIDTH), np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, 0]])

    def course(times: Array) -> tuple[Array, Array]:
        return history.grown(times), history.growth(times)

    nodes, weights = np.polynomial.hermite_e.hermegauss(9)
    exact = np.zeros_like(displacement)
    for x, a in zip(PATCH * nodes, weights, strict=True):
        for z, b in zip(PATCH * nodes, weights, strict=True):
            away = np.array(RECEIVER) - (x, 0.0, z)
            exact += a * b / (2 * np.pi) * full_space(tensor, time, receiver=away, course=course)
    return time, displacement, exact, closure


def surface(box: float, size: float) -> tuple[Array, Array, Array]:
    """Return distances from the fault [m], displacement of the surface and its closed form [m]."""
    bell = {"kind": "gaussian", "background": 0.0, "amplitude": 1.0, "width": REACH, "center": DEPTH}
    case = Case.model_validate({
        "plane": "antiplane", "order": 4, "duration": 1.0, "positions": "x",
        "mesh": {
            "kind": "strike_slip_section", "fault_depth": 24e3, "depth": box, "distance": box, "element_size": size,
            "growth": 1.2,
        },
        "materials": {"default": elastic(C_P, C_S["full"], RHO)},
        "faults": {"main": {
            "contact": {"kind": "split_node"},
            "prescribed_slip": [{"kind": "ramp", "slip": bell, "rise_time": 0.5}],
        }},
        "boundaries": [
            {"kind": "driven", "edge": f"upper.{edge}", "component": "z", "velocity": 0.0}
            for edge in ("below", "right", "top")
        ],
        "stepper": {"kind": "quasi_static", "first_step": 1.0, "largest_step": 1.0}, "output": {"figures": False},
    })  # fmt: skip
    model = Model(case, fem.MPI.COMM_SELF)
    motion, state = case.stepper.bind(model), model.initial_state()
    motion.step(state)
    depth, distance = model.coordinates.T[:2]
    chosen = np.flatnonzero((np.abs(depth) < 1.0) & (distance > 1.0) & (distance < 30e3))
    chosen = chosen[np.argsort(distance[chosen])]
    y, z = distance[chosen], np.linspace(0, 24e3, 4801)
    slip = np.exp(-0.5 * ((z - DEPTH) / REACH) ** 2)
    exact = np.trapezoid(slip * y[:, None] / (y[:, None] ** 2 + z**2), z, axis=1) / np.pi
    sign = np.sign(model.faults[0].interface.rows[0, 0, 0])  # of the displacement by slip
    return y, sign * state.displacement[chosen], exact


def dipping(size: float, far: float) -> tuple[Array, Array, Array]:
    """Return positions of surface nodes, their displacement by slip on a dipping fault and that of dislocations [m].

    Parameters
    ----------
    size, far : float
        Elements on the fault, and distance of the far edges, which are held [m].
    """
    angle, rake = np.deg2rad([DIP, RAKE])
    depth = TOP + RIM * np.sin(angle)
    center = {"x": 0.0, "y": float(depth / np.tan(angle)), "z": -float(depth)}
    bell = {"kind": "gaussian", "background": 0.0, "amplitude": 1.0, "width": REACH, "center": center}
    case = Case.model_validate({
        "plane": "solid", "order": 2, "duration": 1.0, "positions": "x",
        "mesh": {
            "kind": "box_with_fault", "fault_length": 2 * RIM, "fault_width": 2 * RIM, "fault_top": TOP, "dip": DIP,
            "element_size": size, "beyond": far, "distance": far, "growth": 1.2,
        },
        "materials": {"default": elastic(C_P, C_S["full"], RHO)},
        "faults": {"main": {
            "contact": {"kind": "compliant", "C_n": 1e13, "C_s": 1e13},
            "prescribed_slip": [{"kind": "ramp", "slip": bell, "rise_time": 0.5, "rake": RAKE}],
        }},
        "boundaries": [
            {"kind": "driven", "edge": f"{body}.{edge}", "component": axis, "velocity": 0.0}
            for body in ("plus", "minus") for edge in ("left", "right", "bottom", "far") for axis in "xyz"
        ],
        "stepper": {"kind": "quasi_static", "first_step": 1.0, "largest_step": 1.0}, "output": {"figures": False},
    })  # fmt: skip
    model = Model(case, fem.MPI.COMM_SELF)
    motion, state = case.stepper.bind(model), model.initial_state()
    motion.step(state)
    near = np.flatnonzero((np.abs(model.coordinates[:, 2]) < 1.0) & (np.abs(model.coordinates[:, :2]).max(1) < 16e3))
    x, y = model.coordinates[near, :2].T

    # Slip is that of the hanging wall: along x, which is right-lateral, and down dip.
    along, down = (each.ravel() for each in np.meshgrid(*[np.arange(-RIM, RIM, STRIP)] * 2))
    slip = np.exp(-0.5 * (np.hypot(along + STRIP / 2, down + STRIP / 2) / REACH) ** 2)
    below = depth + (down + STRIP) * np.sin(angle)
    # The dislocations dip towards -y: both horizontal axes are turned around.
    corners = -(along + STRIP), -below / np.tan(angle), below
    exact = surface_displacement(-x, -y, corners, (STRIP, STRIP), angle,
                                 (-slip * np.cos(rake), -slip * np.sin(rake)), _poisson_ratio())  # fmt: skip
    return model.coordinates[near], state.displacement.reshape(-1, 3)[near], exact * (-1, -1, 1)


def _poisson_ratio() -> float:
    square = (C_P / C_S["full"]) ** 2
    return float((square - 2) / (2 * square - 2))


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    """Check the displacement at the receiver and at the surface."""
    del comm
    time, displacement, exact, closure = double_couple(750.0 if fine else 1000.0, 9e3)
    off = float(np.abs(displacement - exact).max() / np.abs(exact).max())
    checks = [
        Check("patch: largest misfit over peak", 0.0, off, 1e-2, "1", "Aki and Richards (2002)"),
        Check("energy closure", 0.0, closure, 1e-9, "1", "exact"),
    ]
    curves, errors = {}, []
    for box, tolerance in ((200e3, 2e-2), (800e3, 2e-3)):
        curves[box] = surface(box, 1e3 if fine else 2e3)
        _, ours, theirs = curves[box]
        off = float(np.abs(ours - theirs).max() / theirs.max())
        name = f"slip at depth, box of {box / 1e3:g} km: largest misfit over peak"
        checks.append(Check(name, 0.0, off, tolerance, "1", "Segall (2010)"))
        errors.append(off)
    ratio = errors[0] / errors[1]
    name = "misfit over that in a box of four times the size"
    checks.append(Check(name, 16.0, ratio, 1.6, "1", "image of the slip"))
    wrong = {}
    for box, size in ((40e3, 4e3), (40e3, 2e3), *([(80e3, 2e3), (80e3, 4e3 / 3)] if fine else [])):
        ground = dipping(size, box)
        wrong[box, size] = np.abs(ground[1] - ground[2]).max(axis=0) / np.abs(ground[2]).max()
        name = f"dipping fault, elements of {size / 1e3:.3g} km, box of {box / 1e3:g} km: largest misfit over peak"
        checks.append(Check(name, 0.0, float(wrong[box, size].max()), DIPPING[box, size], "1", "Okada (1985)"))
    ratio = float(wrong[40e3, 4e3][2] / wrong[40e3, 2e3][2])
    name = "vertical misfit over that on elements of half the size"
    checks.append(Check(name, 2.0, ratio, 0.0, "1", "mesh convergence", "at least"))
    if fine:
        ratio = float(wrong[40e3, 2e3][0] / wrong[80e3, 2e3][0])
        name = "misfit along strike over that in a box of twice the size"
        checks.append(Check(name, 2.0, ratio, 0.0, "1", "held far edges", "at least"))
    return Outcome(checks, lambda: _draw(time, displacement, exact, curves, ground))


def _draw(
    time: Array, displacement: Array, exact: Array, curves: dict[float, tuple[Array, Array, Array]],
    ground: tuple[Array, Array, Array],
) -> Figure:  # fmt: skip
    from ruptfx.results.figure_style import new_figure

    figure, axes = new_figure(1, 3, 3.2, 11)
    for number, name in enumerate("xyz"):
        axes[0, 0].plot(time, 1e3 * displacement[:, number], label=name)
        axes[0, 0].plot(time, 1e3 * exact[:, number], "k:", lw=1)
    axes[0, 0].set(xlabel="Time (s)", ylabel="Displacement (mm)", title="Patch in a full space")
    for box, (y, ours, theirs) in curves.items():
        axes[0, 1].plot(y / 1e3, ours, label=f"box of {box / 1e3:g} km")
        axes[0, 1].plot(y / 1e3, theirs, "k:", lw=1)
    axes[0, 1].set(xlabel="Distance from the fault (km)", ylabel="Displacement (m)", title="Slip at depth")
    places, ours, theirs = ground
    line = np.flatnonzero(np.abs(places[:, 0]) < 1.0)
    line = line[np.argsort(places[line, 1])]
    for number, name in enumerate("xyz"):
        axes[0, 2].plot(places[line, 1] / 1e3, 1e3 * ours[line, number], ".-", label=name)
        axes[0, 2].plot(places[line, 1] / 1e3, 1e3 * theirs[line, number], "k:", lw=1)
    axes[0, 2].set(xlabel="y (km)", ylabel="Displacement (mm)", title="Slip on a dipping fault")
    for ax in axes[0]:
        ax.legend(frameon=False)
    return figure
