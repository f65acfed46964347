"""Contact of solids with rough surfaces: a ball, crossed waves, a ball that is dragged, and one that begins to slide.

An elastic block of 5 GPa is pressed on rigid surfaces and damped to rest. On a paraboloid of 10 mm radius without
friction, contact radius and largest pressure follow from the force (Hertz): a^3 = 3 F R / (4 E*) and
p_0 = 3 F / (2 pi a^2). They are those of the parabola that fits the squares of the pressure inside of 0.85 a. On the
waves h cos(2 pi x / l) cos(2 pi y / l), pressed until contact is complete, the pressure is its mean plus waves of the
amplitude sqrt(2) pi E* h / l (Johnson, Greenwood, Higginson 1985). Dragged with friction, the force on the base is
that of friction along the direction of motion. A ball on a plate of the same material, pushed by less than friction
takes, sticks within c = a (1 - Q / (mu P))^(1/3) (Mindlin 1949); friction is of rate and state, mu its mean where it
slips. Both radii are those of the areas.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from benchmarks._cases import case_of, table_of
from ruptfx import Table
from ruptfx.app.bench import Check, Outcome
from ruptfx.bodies.state import State
from ruptfx.case import Case
from ruptfx.platform import fem, parallel
from ruptfx.run import stages
from ruptfx.run.model import Model

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]

BODY = table_of("contact_3d")
BLOCK = BODY["materials"]["default"]
MODULUS = BLOCK["young_modulus"] / (1 - BLOCK["poisson_ratio"] ** 2)
RADIUS = BODY["mesh"]["base"]["profile"]["value"]["radius"]
PRESSED = BODY["boundaries"][0]
INSIDE = 0.85  # part of the contact radius inside of which the pressure is fitted
HEIGHT, WAVELENGTH, EXCESS = 2e-6, 1e-3, 1.4  # of the waves [m]; mean pressure over that of full contact
FRICTION, SPEED, DRAG = 0.3, 10.0, 6e-6  # of the dragged ball: coefficient, m/s, s
CREEP = 0.01  # m/s; slower points stick


def at_end(case: Case, comm: fem.MPI.Comm) -> tuple[Model, State]:
    model = Model(case, comm)
    motion, state = stages.bind(model), model.initial_state()
    while state.time < case.duration * (1 - 1e-9):
        motion.step(state)
    return model, state


def pressed(case: Case, comm: fem.MPI.Comm) -> tuple[Floats, Floats, Floats, Floats]:
    """Return x, y and pressure of all points of this rank at the end, their areas, and forces on the base [N].

    The forces are the sum of the normal ones, and the components of the sum of the tangential ones.
    """
    model, state = at_end(case, comm)
    face, fault = model.faults[0].interface, state.faults["main"]
    area = face.owned * face.weight
    shear = np.column_stack([fault[f"shear_traction_{k}"] for k in (1, 2)])
    tangential = np.einsum("i,ik,ikc->c", area, shear, face.frame[:, 1:])
    force = parallel.total(comm, [area @ fault["normal_stress"], *tangential])
    return face.points[:, :2], fault["normal_stress"], area, np.asarray(force)


def hertz(size: float, comm: fem.MPI.Comm) -> tuple[list[Check], tuple[Floats, Floats, float, float]]:
    """Return the checks of the ball with elements of a size [m], and distance and pressure of points, a and p_0."""
    places, pressure, area, force = pressed(case_of("contact_3d", {"mesh.element_size": size}), comm)
    total = float(force[0])
    radius = (3 * total * RADIUS / (4 * MODULUS)) ** (1 / 3)
    largest = 3 * total / (2 * np.pi * radius**2)
    squared = np.sum(places**2, axis=1)
    inside = (squared < (INSIDE * radius) ** 2) & (area > 0)
    columns = np.column_stack([np.ones(inside.sum()), squared[inside] / radius**2])
    sums = parallel.total(comm, [*(columns.T @ columns).ravel(), *(columns.T @ pressure[inside] ** 2)])
    level, slope = np.linalg.solve(np.reshape(sums[:4], (2, 2)), sums[4:])
    name = f"ball, elements of {1e3 * size:g} mm"
    checks = [
        Check(f"{name}: contact radius", radius, radius * np.sqrt(-level / slope), 0.02, "m", "Hertz", relative=True),
        Check(f"{name}: largest pressure", largest, np.sqrt(level), 0.02, "Pa", "Hertz", relative=True),
    ]
    return checks, (np.sqrt(squared), pressure, radius, largest)


def waves(elements: int, comm: fem.MPI.Comm) -> list[Check]:
    """Return the checks of crossed waves in full contact, with as many elements in a wavelength."""
    wave: Table = {"kind": "sinusoid", "amplitude": HEIGHT, "wavelength": WAVELENGTH}
    across = {"kind": "along_dip", "profile": {"kind": "sinusoid", "amplitude": 1.0, "wavelength": WAVELENGTH}}
    full = np.sqrt(2) * np.pi * MODULUS * HEIGHT / WAVELENGTH
    edges = [("left", "x"), ("right", "x"), ("front", "y"), ("back", "y")]
    square = {"length": WAVELENGTH, "width": WAVELENGTH}
    case = case_of("contact_3d", {
        "mesh": {
            "kind": "block_on_rigid", **square, "height": 1.5 * WAVELENGTH, "element_size": WAVELENGTH / elements,
            "growth": 1.2, "base": {**square, "profile": {"kind": "product", "value": wave, "factor": across}},
        },
        "duration": 24e-6,
        "boundaries": [
            *({"kind": "driven", "edge": f"upper.{side}", "component": axis, "velocity": 0.0} for side, axis in edges),
            {"kind": "traction", "edge": "upper.top", "traction": [0.0, 0.0, -EXCESS * full], "ramp": 6e-6},
        ],
    })  # fmt: skip
    places, pressure, area, _ = pressed(case, comm)
    shape = np.prod(np.cos(2 * np.pi * places / WAVELENGTH), axis=1)
    total, load, mixed, size = parallel.total(
        comm, [area.sum(), area @ pressure, area @ (pressure * shape), area @ shape**2]
    )
    return [
        Check("waves: mean pressure", EXCESS * full, load / total, 0.005, "Pa", "load", relative=True),
        Check("waves: amplitude of the pressure in full contact", full, mixed / size, 0.02, "Pa",
              "Johnson, Greenwood, Higginson (1985)", relative=True),
    ]  # fmt: skip


def dragged(degrees: float, comm: fem.MPI.Comm) -> list[Check]:
    """Return the checks of the ball that is dragged in a direction."""
    angle = np.deg2rad(degrees)
    begin = BODY["duration"]
    moves = [
        {"kind": "moved", "edge": "upper.top", "component": axis, "quantity": "displacement",
         "times": [begin, begin + DRAG], "values": [0.0, SPEED * DRAG * share]}
        for axis, share in (("x", np.cos(angle)), ("y", np.sin(angle)))
    ]  # fmt: skip
    case = case_of("contact_3d", {
        "faults.main.friction": {"kind": "coulomb", "mu_d": FRICTION}, "duration": begin + DRAG,
        "boundaries": [PRESSED, *moves], "mesh.element_size": 0.15e-3,
    })  # fmt: skip
    _, _, _, force = pressed(case, comm)
    shear = float(np.hypot(force[1], force[2]))
    turned = (np.rad2deg(np.arctan2(force[2], force[1]) - angle) + 180) % 360 - 180
    name = f"dragged at {degrees:g} degrees"
    return [
        Check(f"{name}: shear over normal force", FRICTION, shear / force[0], 0.005, "1", "friction",
              relative=True),
        Check(f"{name}: direction of the force on the base", 0.0, float(turned), 0.5, "degree", "friction"),
    ]  # fmt: skip


def begins(comm: fem.MPI.Comm) -> Check:
    """Return the check of the part of the contact radius that sticks while a ball begins to slide."""
    plate = {"length": 4e-3, "width": 4e-3, "left": -2e-3, "front": -2e-3, "height": 2e-3, "element_size": 0.1e-3,
             "fine": 1e-3, "growth": 1.8}  # fmt: skip
    wide = {"length": 4.4e-3, "width": 4.4e-3, "left": -2.2e-3, "front": -2.2e-3}
    ball = {"kind": "parabola", "radius": 15e-3, "center": {"x": 0.0, "y": 0.0}}
    edges = [{"kind": "driven", "edge": edge, "component": axis, "velocity": 0.0}
             for edge, axis in [("upper.top", "y"), *(("lower.bottom", each) for each in "xyz")]]  # fmt: skip
    moves = [
        {"kind": "moved", "edge": "upper.top", "component": axis, "quantity": "displacement",
         "times": [0.0, start, 45e-6], "values": values}
        for axis, start, values in (("z", 8e-6, [0.0, -14e-6, -14e-6]), ("x", 20e-6, [0.0, 0.0, 6.25e-6]))
    ]  # fmt: skip
    case = case_of("contact_3d", {
        "mesh": {"kind": "rough_plates", "curve_order": 2, "upper": {**plate, "profile": ball},
                 "lower": {**plate, **wide}},
        "duration": 40e-6, "boundaries": [*edges, *moves], "damping.mass": 5e5,
        "faults.main.friction": {"kind": "rate_and_state_ageing", "a": 0.008, "b": 0.006, "D_c": 1e-7, "f_0": 0.3,
                                 "V_0": 0.1, "V_initial": 1e-6},
    })  # fmt: skip
    model, state = at_end(case, comm)
    face, fault = model.faults[0].interface, state.faults["main"]
    shear, rate = (np.stack([fault[f"{name}_{k}"] for k in (1, 2)], axis=1) for name in ("shear_traction", "slip_rate"))
    pressure, area = fault["normal_stress"], face.owned * face.weight
    closed, slips = pressure > 0, (pressure > 0) & (np.linalg.norm(rate, axis=1) > CREEP)
    friction = np.linalg.norm(shear, axis=1)
    touching, sticking, load, rubbing, carried, *push = parallel.total(comm, [
        area @ closed, area @ (closed & ~slips), area @ pressure, area @ (friction * slips), area @ (pressure * slips),
        *np.einsum("i,ik,ikc->c", area, shear, face.frame[:, 1:]),
    ])  # fmt: skip
    theory = (1 - np.linalg.norm(push) / (rubbing / carried * load)) ** (1 / 3)
    return Check("begins to slide: radius that sticks over that of contact", float(theory),
                 float(np.sqrt(sticking / touching)), 0.03, "1", "Mindlin (1949)", relative=True)  # fmt: skip


def run(fine: bool, comm: fem.MPI.Comm) -> Outcome:
    sizes = (0.15e-3, 0.1e-3, 0.07e-3) if fine else (0.1e-3,)
    results = [hertz(size, comm) for size in sizes]
    checks = [check for each, _ in results for check in each] + waves(16 if fine else 8, comm)
    for degrees in (0, 30, 45, 90, 135, 180, 225, 300) if fine else (30,):
        checks += dragged(degrees, comm)
    if fine:
        checks.append(begins(comm))
    return Outcome(checks, lambda: _draw(*results[-1][1]))


def _draw(distance: Floats, pressure: Floats, radius: float, largest: float) -> Figure:
    from ruptfx.results.figure_style import new_figure

    figure, ((axes,),) = new_figure(1, 1, 3, 5)
    ratio = np.linspace(0, 1, 200)
    axes.plot(ratio, np.sqrt(1 - ratio**2), color="#1a1a1a", lw=1, label="Hertz")
    near = distance < 1.5 * radius
    axes.plot(distance[near] / radius, pressure[near] / largest, ".", ms=3, color="#2a6099", label="points")
    axes.set(xlabel="Distance from the axis over the contact radius", ylabel="Pressure over that of Hertz at the axis")
    axes.legend(frameon=False)
    return figure
