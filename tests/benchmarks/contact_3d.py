"""Contact of solids with rough surfaces: a ball, crossed waves, a ball that is dragged, and one that begins to slide.

An elastic block of 5 GPa is pressed on rigid surfaces and damped to rest. On a paraboloid of 10 mm radius without
friction, contact radius and largest pressure follow from the force (Hertz): a^3 = 3 F R / (4 E*) and
p_0 = 3 F / (2 pi a^2). They are those of the parabola that fits the squares of the pressure inside of 0.85 a. On the
waves h cos(2 pi x / l) cos(2 pi y / l), pressed until contact is complete, the pressure is its mean plus waves of the
amplitude sqrt(2) pi E* h / l (Johnson, Greenwood, Higginson 1985). Dragged with friction, the force on the base is
that of friction along the direction of motion. A ball on a plate of the same material, pushed by less than friction
takes, sticks within c = a (1 - Q / (mu P))^(1/3) (Mindlin 1949); friction is of rate and state, mu its mean where it
slips. Both radii are those of the areas.

Friction between a rigid ball and a compressible block changes the pressure while the ball is pressed, because points
cannot move outwards as they would: pressed with friction 0.3 in quasi-static steps, the fitted radius is 6 % smaller
and the pressure 8 % higher than without. Once all points slip along the motion, both are those of Hertz again. The
centre of pressure is then ahead of the axis by 8 % of the contact radius; the slope of the ball there reduces the force
along the motion, 0.2966 times that along z where friction is 0.3. The bound is the slope of the ball over the slip
between updates of the pairing. Most of the 8 % is no contact mechanics: mass damping and inertia shear and tilt the
block. On elements of 0.2 mm the centre is ahead by 8.4, 5.8, 4.9 and 4.4 % at 10, 5, 2.5 and 1.25 m/s; a half-space has
4.8 %. Elements of 0.13 mm and updates four times as often change it by 0.2 % of the contact radius at most.

A block that spins on the ball has the moment 3 pi mu P a / 16 (Lubkin 1951). The compliance of a ball that sticks is
(2 - nu) / (2 (1 - nu)) times as large along the surface as across it (Mindlin 1949). Crests of the waves that touch are
balls of radius l^2 / (4 pi^2 h). On a self-affine surface of the slope h' the contact fraction is 1.6 times the mean
pressure over E* h' (Persson 2001) to 2.3 times (Hyun et al. 2004), at 1 to 10 % of contact.
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
from ruptfx.interfaces.sliding.interface import SlidingInterface
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
SPIN, SPINS = 5e4, 1e-6  # of the block on the ball [1/s], and its duration [s]
SIDE, RIM = 1e-3, (np.pi - 1 + np.log(2)) / 24  # of the rough block [m]; area of points of a rim that is not in contact
SHORTEST = 0.125e-3  # wave of the rough base [m]
ROUGH = {"kind": "self_affine_surface", "rms": 1e-6, "hurst": 0.8, "length": SIDE, "longest": 0.5e-3,
         "shortest": SHORTEST, "seed": 3}  # fmt: skip
APPROACH, RESOLVED = 0.275, 64  # speed [m/s]; elements along a side from which single contacts have several points
NUDGE = 0.2e-6  # of a ball that sticks [m]
WAVES: Table = {
    "kind": "product", "value": {"kind": "sinusoid", "amplitude": HEIGHT, "wavelength": WAVELENGTH},
    "factor": {"kind": "along_dip", "profile": {"kind": "sinusoid", "amplitude": 1.0, "wavelength": WAVELENGTH}},
}  # fmt: skip
COARSE = 0.15e-3  # elements below a ball that moves [m]
TOUCHING = 0.07  # contact radius on a crest of the waves over their wavelength
CREEP = 0.01  # m/s; slower points stick


def at_end(case: Case, comm: fem.MPI.Comm) -> tuple[Model, State]:
    model = Model(case, comm)
    motion, state = stages.bind(model), model.initial_state()
    while state.time < case.duration * (1 - 1e-9):
        motion.step(state)
    return model, state


def pressed(case: Case, comm: fem.MPI.Comm, moved: bool = False) -> tuple[Floats, Floats, Floats, Floats]:
    """Return x, y and pressure of all points of this rank at the end, their areas, and forces on the base [N].

    Positions are undeformed ones, or those of points that have moved.

    These are the sum of the normal ones, x and y of the sum of the tangential ones, and x, y and z of all.
    """
    model, state = at_end(case, comm)
    face, fault = _face(model), state.faults["main"]
    area = face.owned * face.weight
    shear = np.column_stack([fault[f"shear_traction_{k}"] for k in (1, 2)])
    tangential = np.einsum("i,ik,ikc->c", area, shear, face.frame[:, 1:])
    force = [*parallel.total(comm, [area @ fault["normal_stress"], *tangential[:2]]), *_force(model, state, comm)]
    places = face.places(state.displacement)[1] if moved else face.points
    return places[:, :2], fault["normal_stress"], area, np.asarray(force)


def fitted(
    name: str, places: Floats, pressure: Floats, area: Floats, load: float, radius_of: float, comm: fem.MPI.Comm
) -> tuple[list[Check], tuple[Floats, Floats, float, float]]:
    """Return the checks of a contact around the axis, and distance and pressure of points, a and p_0.

    `load` is the force of the contact [N], `radius_of` the radius of the ball [m].
    """
    radius = (3 * load * radius_of / (4 * MODULUS)) ** (1 / 3)
    largest = 3 * load / (2 * np.pi * radius**2)
    squared = np.sum(places**2, axis=1)
    inside = (squared < (INSIDE * radius) ** 2) & (area > 0)
    columns = np.column_stack([np.ones(inside.sum()), squared[inside] / radius**2])
    sums = parallel.total(comm, [*(columns.T @ columns).ravel(), *(columns.T @ pressure[inside] ** 2)])
    level, slope = np.linalg.solve(np.reshape(sums[:4], (2, 2)), sums[4:])
    checks = [
        Check(f"{name}: contact radius", radius, radius * np.sqrt(-level / slope), 0.02, "m", "Hertz", relative=True),
        Check(f"{name}: largest pressure", largest, np.sqrt(level), 0.02, "Pa", "Hertz", relative=True),
    ]
    return checks, (np.sqrt(squared), pressure, radius, largest)


def hertz(size: float, comm: fem.MPI.Comm) -> tuple[list[Check], tuple[Floats, Floats, float, float]]:
    """Return the checks of the ball with elements of a size [m], and distance and pressure of points, a and p_0."""
    places, pressure, area, force = pressed(case_of("contact_3d", {"mesh.element_size": size}), comm)
    return fitted(f"ball, elements of {1e3 * size:g} mm", places, pressure, area, float(force[0]), RADIUS, comm)


def waves(elements: int, comm: fem.MPI.Comm) -> list[Check]:
    """Return the checks of crossed waves in full contact, with as many elements in a wavelength."""
    full = np.sqrt(2) * np.pi * MODULUS * HEIGHT / WAVELENGTH
    case = _square(WAVELENGTH, WAVELENGTH / elements, WAVES, {
        "duration": 24e-6,
        "boundaries": [
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


def light(elements: int, comm: fem.MPI.Comm) -> list[Check]:
    """Return the checks of crossed waves of which the crests touch, a quarter of a wavelength between symmetries."""
    half = 0.5 * WAVELENGTH
    crest = WAVELENGTH**2 / (4 * np.pi**2 * HEIGHT)  # radius of curvature [m]
    load = 4 * MODULUS * (TOUCHING * WAVELENGTH) ** 3 / (3 * crest)
    case = _square(half, half / elements, WAVES, {
        "duration": 24e-6,
        "boundaries": [{"kind": "traction", "edge": "upper.top", "ramp": 6e-6,
                        "traction": [0.0, 0.0, -2 * load / WAVELENGTH**2]}],
    })  # fmt: skip
    places, pressure, area, _ = pressed(case, comm)
    area = area * (np.sum(places**2, axis=1) < (0.5 * half) ** 2)
    return fitted("waves, crests", places, pressure, area, 4 * parallel.total(comm, [float(area @ pressure)])[0],
                  crest, comm)[0]  # fmt: skip


def _square(side: float, size: float, profile: Table, changes: Table) -> Case:
    """Return the case of a square block between walls of symmetry on a base."""
    edges = [("left", "x"), ("right", "x"), ("front", "y"), ("back", "y")]
    square = {"length": side, "width": side}
    walls = [{"kind": "driven", "edge": f"upper.{edge}", "component": axis, "velocity": 0.0} for edge, axis in edges]
    return case_of("contact_3d", {
        "mesh": {"kind": "block_on_rigid", **square, "height": 1.5 * side, "element_size": size, "growth": 1.2,
                 "base": {**square, "profile": profile}},
        **changes, "boundaries": walls + changes["boundaries"],
    })  # fmt: skip


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
        "boundaries": [PRESSED, *moves], "mesh.element_size": COARSE,
    })  # fmt: skip
    places, pressure, area, force = pressed(case, comm, moved=True)
    shear = float(np.hypot(force[1], force[2]))
    turned = (np.rad2deg(np.arctan2(force[2], force[1]) - angle) + 180) % 360 - 180
    way = np.array([np.cos(angle), np.sin(angle)])
    centre = parallel.total(comm, [float((area * pressure) @ places @ way)])[0] / force[0]
    sliding = case.faults["main"].sliding
    assert sliding is not None
    lag = sliding.update_slip * COARSE / case.order / RADIUS
    whole = float(force[3:5] @ way / -force[5])
    name = f"dragged at {degrees:g} degrees"
    checks, _ = fitted(name, places, pressure, area, float(force[0]), RADIUS, comm)
    return [
        *checks,
        Check(f"{name}: shear over normal force", FRICTION, shear / force[0], 0.005, "1", "friction",
              relative=True),
        Check(f"{name}: direction of the force on the base", 0.0, float(turned), 0.5, "degree", "friction"),
        Check(f"{name}: force along the motion over that along z",
              float(np.tan(np.arctan(FRICTION) - centre / RADIUS)), whole, lag, "1", "slope at the centre"),
    ]  # fmt: skip


def twisted(comm: fem.MPI.Comm) -> Check:
    """Return the check of the moment of a pressed ball on which the block spins, full slip."""
    case = case_of("contact_3d", {
        "faults.main.friction": {"kind": "coulomb", "mu_d": FRICTION}, "mesh.element_size": COARSE,
        "boundaries": [PRESSED], "damping": {"kelvin_voigt": {"fraction": 0.1}},
        "duration": BODY["duration"] + SPINS,
        "stages": [{"duration": BODY["duration"], "damping": BODY["damping"]}, {"duration": SPINS}],
    })  # fmt: skip
    model = Model(case, comm)
    motion, state = stages.bind(model), model.initial_state()
    turning, moments = False, []
    while state.time < case.duration * (1 - 1e-9):
        if state.time >= BODY["duration"] and not turning:
            turning = True
            state.velocity.reshape(-1, 3)[:, :2] += (
                SPIN * model.coordinates[:, :2] @ np.array([[0.0, 1.0], [-1.0, 0.0]])
            )
        motion.step(state)
        if state.time > case.duration - 0.5 * SPINS:
            moments.append(_moment(model, state, comm))
    moment, load = np.mean(moments, axis=0)
    radius = (3 * load * RADIUS / (4 * MODULUS)) ** (1 / 3)
    theory = 3 * np.pi / 16 * FRICTION * load * radius
    return Check(
        "torsion: moment of full slip", theory, float(abs(moment)), 0.02, "N m", "Lubkin (1951)", relative=True
    )


def rough(elements: int, comm: fem.MPI.Comm) -> Floats:
    """Return contact fraction with and without correction, and mean pressure over E* and the slope, of every step.

    A block is pressed on a rough base.
    """
    case = _square(SIDE, SIDE / elements, ROUGH, {
        "order": 1, "duration": 8e-6, "mesh.height": SIDE, "mesh.growth": 1.5,
        "boundaries": [{"kind": "driven", "edge": "upper.top", "component": "z", "velocity": -APPROACH}],
    })  # fmt: skip
    model = Model(case, comm)
    motion, state, face = stages.bind(model), model.initial_state(), _face(model)
    area, rows, base, square = face.owned * face.weight, [], face.geometry.minus, 0.0
    if base.facets:  # a rank knows all points or none
        normal = base.directions(base.points)
        square = float(np.average(np.sum(normal[..., :2] ** 2, axis=2) / normal[..., 2] ** 2, weights=base.shares))
    slope = np.sqrt(parallel.largest(comm, square))
    while state.time < case.duration * (1 - 1e-9):
        motion.step(state)
        pressure = state.faults["main"]["normal_stress"]
        grid = np.zeros((elements + 1, elements + 1), dtype=bool)
        grid[tuple(np.rint(face.points[:, :2] * elements / SIDE).astype(int).T)] = pressure > 0
        # Points of the rim of a contact stand for less than their area (Yastrebov, Anciaux, Molinari 2017).
        changes = sum(int(np.sum(np.diff(grid.astype(int), axis=axis) != 0)) for axis in (0, 1))
        rim = parallel.largest(comm, changes) / elements**2
        total = parallel.total(comm, [area @ (pressure > 0), area @ pressure])
        rows.append([total[0] / SIDE**2 - RIM * rim, total[0] / SIDE**2, total[1] / SIDE**2 / (MODULUS * slope)])
    return np.array(rows).T


def roughness(sizes: tuple[int, ...], comm: fem.MPI.Comm) -> tuple[list[Check], Floats]:
    """Return the checks of the contact area of a self-affine surface at 1 to 10 % of contact, and rows of a figure.

    Of every mesh these are the elements in the shortest wave, and the area over the load with and without correction.
    """
    checks, rows = [], []
    for elements in sizes:
        fraction, closed, load = rough(elements, comm)
        few = (fraction > 0.01) & (fraction < 0.1)
        factor, closed_factor = (float(area[few] @ load[few] / (load[few] @ load[few])) for area in (fraction, closed))
        rows.append([elements * SHORTEST / SIDE, factor, closed_factor])
        name = f"self-affine surface, {elements} elements"
        checks.append(Check(f"{name}: area over load", 1.95, factor, 0.35, "1", "Persson (2001), Hyun et al. (2004)"))
    exponent = float(np.polyfit(np.log(load[few]), np.log(fraction[few]), 1)[0])
    if elements >= RESOLVED:
        checks.append(Check(f"{name}: exponent of the area over the load", 1.0, exponent, 0.1, "1", "Persson (2001)"))
    return checks, np.array(rows)


def compliance(comm: fem.MPI.Comm) -> Check:
    """Return the check of the compliance along the surface over the normal one, of a ball that sticks.

    That of the block, which is not infinite, cancels in the difference of two depths.
    """
    poisson, hold = 0.45, 20e-6
    pairs = []
    for depth in (8e-6, 16e-6):
        times = [0.0, 6e-6, hold, hold + 2e-6, 2 * hold, 2 * hold + 2e-6]
        moves = {"x": [0.0, 0.0, 0.0, NUDGE, NUDGE, NUDGE], "y": [0.0] * 6,
                 "z": [0.0, -depth, -depth, -depth, -depth, -depth - NUDGE]}  # fmt: skip
        case = case_of("contact_3d", {
            "mesh.element_size": COARSE, "duration": 3 * hold, "materials.default.poisson_ratio": poisson,
            "materials.default.young_modulus": MODULUS * (1 - poisson**2),
            "faults.main.friction": {"kind": "coulomb", "mu_d": 100.0},
            "boundaries": [{"kind": "moved", "edge": "upper.top", "component": axis, "quantity": "displacement",
                            "times": times, "values": values} for axis, values in moves.items()],
        })  # fmt: skip
        model = Model(case, comm)
        motion, state = stages.bind(model), model.initial_state()
        forces = []
        for until in (hold, 2 * hold, 3 * hold):
            while state.time < until * (1 - 1e-9):
                motion.step(state)
            forces.append(_force(model, state, comm))
        pairs.append([NUDGE / abs(forces[1][0] - forces[0][0]), NUDGE / abs(forces[2][2] - forces[1][2])])
    along, normal = np.subtract(pairs[0], pairs[1])
    theory = (2 - poisson) / (2 * (1 - poisson))
    return Check("sticking ball: tangential over normal compliance", theory, float(along / normal), 0.03, "1",
                 "Mindlin (1949)", relative=True)  # fmt: skip


def _force(model: Model, state: State, comm: fem.MPI.Comm) -> Floats:
    """Return the components of the force on the base [N]."""
    face, fault = model.faults[0].interface, state.faults["main"]
    local = np.stack([-fault["normal_stress"], *(fault[f"shear_traction_{k}"] for k in (1, 2))], axis=1)
    return parallel.total(comm, np.einsum("i,ik,ikc->c", face.owned * face.weight, local, face.frame).tolist())


def ironed(comm: fem.MPI.Comm) -> list[Check]:
    """Return the checks of forces while a ball is dragged along a diagonal over two elements of the block."""
    size, angle = COARSE, np.deg2rad(30.0)
    begin, settled = BODY["duration"], 0.15e-3
    ramp, way = 4e-6, 2 * size
    duration = 0.5 * ramp + (settled + way) / SPEED
    drives = [
        {"kind": "driven", "edge": "upper.top", "component": axis, "velocity": v, "ramp": ramp}
        for axis, v in zip("xyz", (SPEED * np.cos(angle), SPEED * np.sin(angle), 0.0), strict=True)
    ]
    case = case_of("contact_3d", {
        "faults.main.friction": {"kind": "coulomb", "mu_d": FRICTION}, "mesh.element_size": size,
        "duration": begin + duration,
        "stages": [{"duration": begin, "boundaries": BODY["boundaries"]}, {"duration": duration, "boundaries": drives}],
    })  # fmt: skip
    model = Model(case, comm)
    motion, state = stages.bind(model), model.initial_state()
    rows = []
    while state.time < case.duration * (1 - 1e-9):
        motion.step(state)
        slid = SPEED * (state.time - begin - 0.5 * ramp) - settled
        if slid >= 0:
            rows.append([slid / way, *_force(model, state, comm)])
    along, *force = np.array(rows).T
    checks = []
    for name, values in (("shear", np.hypot(force[0], force[1])), ("normal", -force[2])):
        noise = np.ptp(values - np.polyval(np.polyfit(along, values, 2), along)) / values.mean()
        checks.append(Check(f"ironing: {name} force, peak to peak over the mean", 0.0, float(noise), 0.03, "1", "aim"))
    return checks


def _face(model: Model) -> SlidingInterface:
    face = model.faults[0].interface
    assert isinstance(face, SlidingInterface)
    return face


def _moment(model: Model, state: State, comm: fem.MPI.Comm) -> Floats:
    """Return the moment of friction about the axis [N m], and the normal force [N]."""
    face, fault = _face(model), state.faults["main"]
    area, (_, now, _) = face.owned * face.weight, face.places(state.displacement)
    shear = np.stack([fault[f"shear_traction_{k}"] for k in (1, 2)], axis=1)
    along = np.einsum("i,ik,ikc->ic", area, shear, face.frame[:, 1:])
    return parallel.total(comm, [float(np.cross(now, along)[:, 2].sum()), float(area @ fault["normal_stress"])])


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
    few, areas = roughness((16, 32, 64) if fine else (32,), comm)
    checks += [twisted(comm), *ironed(comm), *few]
    for degrees in (0, 30, 45, 90, 135, 180, 225, 300) if fine else (30,):
        checks += dragged(degrees, comm)
    if fine:
        checks += [*light(24, comm), compliance(comm), begins(comm)]
    return Outcome(checks, lambda: _draw(*results[-1][1], areas))


def _draw(distance: Floats, pressure: Floats, radius: float, largest: float, areas: Floats) -> Figure:
    from ruptfx.results.figure_style import new_figure

    figure, ((axes, trend),) = new_figure(1, 2, 3.2, 7.2)
    ratio = np.linspace(0, 1, 200)
    axes.plot(ratio, np.sqrt(1 - ratio**2), color="#1a1a1a", lw=1, label="Hertz")
    near = distance < 1.5 * radius
    axes.plot(distance[near] / radius, pressure[near] / largest, ".", ms=3, color="#2a6099", label="points")
    axes.set(xlabel="Distance from the axis over the contact radius", ylabel="Pressure over Hertz at the axis")
    axes.legend(frameon=False)
    across, factor, closed_factor = areas.T
    trend.axhspan(1.6, 2.3, color="#e5e5e5", label="theories")
    trend.plot(across, closed_factor, "s--", ms=4, color="#9a9a9a", label="points in contact")
    trend.plot(across, factor, "o-", ms=4, color="#2a6099", label="without half the rim")
    trend.set(xlabel="Elements in the shortest wave", ylabel="Contact area A E* h' / F", xticks=across)
    trend.set_ylim(bottom=0)
    trend.legend(frameon=False)
    return figure
