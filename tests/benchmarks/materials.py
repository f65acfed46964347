"""Materials with memory: points against closed forms, Q of plane waves, energy budget, elastic limit, cost.

Plane S and P waves travel through a column: the ratio of their spectra at two depths gives Q, compared with that of
the case, and the phase velocity, compared with that of the complex modulus (Emmerich and Korn 1987). Cyclic shear
beyond yield is compared with the solution of its differential equation by SciPy.
"""

from __future__ import annotations

import time
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ruptfx import Table
from ruptfx.app.bench import Check
from ruptfx.bodies.initial_stress.depth import Depth
from ruptfx.bodies.meshes import MeshSource, RawMesh
from ruptfx.bodies.space.numbering import in_sweep_order
from ruptfx.case import Case, read_toml
from ruptfx.laws.materials.continuum_damage import ContinuumDamage
from ruptfx.laws.materials.drucker_prager import DruckerPrager
from ruptfx.laws.materials.maxwell import Maxwell
from ruptfx.laws.materials.prony import Prony
from ruptfx.laws.materials.standard_linear_solids import StandardLinearSolids
from ruptfx.laws.materials.traced import traced
from ruptfx.laws.materials.von_mises import VonMises
from ruptfx.platform import fem, parallel
from ruptfx.run.model import Model
from ruptfx.run.recording.bulk_fields import BulkFields

if TYPE_CHECKING:
    from ruptfx.bodies.state import State
    from ruptfx.platform.fem import MPI
    from ruptfx.stepping.steppers import Motion

ROCK: Table = {"young_modulus": 5.3e9, "poisson_ratio": 0.35, "density": 1246.0}
SOLID: Table = {
    **ROCK, "Q_p": 30.0, "Q_s": 20.0, "lowest_frequency": 3e4, "frequency_ratio": 10.0, "mechanisms": 3
}  # fmt: skip
YIELDING: Table = {
    **ROCK, "cohesion": 1e6, "friction_angle": 0.5, "relaxation_time": 1e-7,
    "initial_stress": [-6e6, -6e6, -6e6, 0.0, 0.0, 0.0],
}  # fmt: skip
FIBRES: Table = {
    "density": 1478.0, "E_1": 80e9, "E_2": 8.9e9, "nu_12": 0.25, "nu_23": 0.43, "G_12": 3.6e9,
}  # fmt: skip
DURATION = 120e-6  # s, of plane waves
LEAST, END = 5e-5, 3.7  # least plastic strain of a yielded zone; s, when the front of the crack has run for 10 km
SCIPY = "scipy"
CREEP = "closed form of springs and dashpots"


class Block(MeshSource):
    """A rectangle of square elements without interface."""

    columns: int
    rows: int
    size: float

    def build(self) -> RawMesh:
        """Return the elements row by row."""
        x, y = np.meshgrid(np.arange(self.columns + 1), np.arange(self.rows + 1))
        points = self.size * np.stack([x.ravel(), y.ravel()], axis=1)
        number = np.arange(len(points)).reshape(self.rows + 1, self.columns + 1)
        cells = np.stack([number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]], axis=-1).reshape(-1, 4)
        sides = {"bottom": number[0], "top": number[-1], "left": number[:, 0], "right": number[:, -1]}
        return RawMesh(
            "quadrilateral", points, cells, bodies=["rock"], cell_body=np.zeros(len(cells), int),
            edges={f"rock.{name}": np.stack([row[:-1], row[1:]], axis=1) for name, row in sides.items()}, interfaces={},
        )  # fmt: skip


def run(fine: bool, comm: MPI.Comm) -> list[Check]:
    waves = [*_waves(fine, comm), *_layers(comm), *_directions(comm), *_trapped(comm), *_at_rest(comm)]
    points = [*_relaxation(), *_flow(), *_hardening(), *_damage()]
    return [*points, *waves, *_blocks(comm), *_off_fault(comm), *_cost(fine)]


def _points(material: Any, shear: np.ndarray, dt: float) -> np.ndarray:
    """Return the shear stress of one point along a path of shear strain [Pa]."""
    law = traced(material, "strain")
    state = {name: np.full(1, value) for name, value in law.state.items()}
    found = []
    for strain in shear:
        parts = {"xx": np.zeros(1), "yy": np.zeros(1), "xy": np.full(1, strain)}
        stress, state = law.evaluate(parts, state, dt)
        found.append(float(stress["xy"][0]))
    return np.array(found)


def _relaxation() -> list[Check]:
    """Compare a strain that grows linearly, then rests: exact at every step."""
    given = StandardLinearSolids.model_validate(SOLID)
    dt, ramp, rate = 5e-8, 4e-6, 250.0
    t = dt * np.arange(1, 321)
    stress = _points(given, rate * np.minimum(t, ramp), dt)

    def grown(at: np.ndarray) -> np.ndarray:
        delayed = sum(y * (at + np.expm1(-r * at) / r) for y, r in zip(given.coefficients[1], given.rates, strict=True))
        return np.where(at > 0, 2 * given.shear_modulus * rate * (at - delayed), 0.0)

    exact = grown(t) - grown(np.maximum(t - ramp, 0.0))
    apart = float(np.abs(stress / exact - 1).max())
    checks = [Check("standard_linear_solids: ramp and relaxation of a point", 0.0, apart, 1e-8, source=CREEP)]
    times, parts = np.array([3e-7, 2e-6, 4e-5]), np.array([2e8, 3e8, 1e8])
    prony = Prony.model_validate({**ROCK, "times": times.tolist(), "shear_moduli": parts.tolist()})
    maxwell = Maxwell.model_validate({**ROCK, "relaxation_time": 1e-6})
    ramps = ("prony", prony, times, parts), ("maxwell", maxwell, np.array([1e-6]), np.array([maxwell.shear_modulus]))
    for kind, law, relaxing, moduli in ramps:
        lag = (t[:, None] + relaxing * np.expm1(-t[:, None] / relaxing)) @ moduli
        of_ramp = 2 * rate * (law.shear_modulus * t - lag)
        apart = float(np.abs(_points(law, rate * t, dt) / of_ramp - 1).max())
        checks.append(Check(f"{kind}: ramp of a point", 0.0, apart, 1e-8, source="closed form"))
    return checks


def _hardening() -> list[Check]:
    """Compare shear beyond yield at a constant rate with the closed form of linear hardening and relaxation."""
    T, rate, limit, hardening = 1e-6, 1e3, 2e7, 8e8
    given = VonMises.model_validate({
        **ROCK, "yield_stress": limit, "hardening": 3e8, "kinematic_hardening": 5e8, "relaxation_time": T,
    })  # fmt: skip
    three, t = 3 * given.shear_modulus, 0.7 * T * np.arange(40)
    found = np.sqrt(3) * _points(given, np.sqrt(3) / 2 * (limit / three + rate * t), 0.7 * T)
    over = three * rate * T * -np.expm1(-t / T)
    exact = limit + over + (three * rate * t - over) * hardening / (three + hardening)
    apart = float(np.abs(found / exact - 1).max())
    return [Check("von_mises: ramp with hardening of a point", 0.0, apart, 1e-8, source="closed form")]


def damaged_point(steps: int, cycle: bool) -> float:
    """Return the error of the stress of a point in uniaxial strain over its strength, against an ODE.

    The strain grows linearly from the begin of damage on, or follows a sine that damages in both senses; steps are
    exact for the former.
    """
    from scipy.integrate import solve_ivp

    T, strength, scale, span = 1e-6, 5e7, 4e-2, 8e-6
    given = ContinuumDamage.model_validate({
        **ROCK, "strength": strength, "softening_strain": 1e-2, "relaxation_time": T,
    })  # fmt: skip
    law, (first, shear) = traced(given, "strain"), given.lame("strain")
    young, axial = shear * (3 * first + 2 * shear) / (first + shear), first + 2 * shear
    begun = strength / np.sqrt(young * axial)

    def strain(t: Any) -> Any:
        return scale * np.sin(2 * np.pi * t / span) if cycle else begun + scale * t / span

    def rate(t: float, r: np.ndarray) -> np.ndarray:
        return np.asarray(np.maximum(np.sqrt(young * axial) * np.abs(strain(t)) - r, 0.0) / T)

    t = span * np.arange(steps + 1) / steps
    solved = solve_ivp(rate, (0, span), [strength], "DOP853", t, rtol=1e-12, atol=1e-6, max_step=span / 4000)
    r = solved.y[0]
    exact = strength / r * np.exp((strength - r) / (young * 1e-2)) * axial * strain(t)
    state, found = {name: np.full(1, value) for name, value in law.state.items()}, []
    for number, at in enumerate(t):
        parts = {"xx": np.full(1, strain(at)), "yy": np.zeros(1), "xy": np.zeros(1)}
        stress, state = law.evaluate(parts, state, span / steps * (number > 0))
        found.append(float(stress["xx"][0]))
    return float(np.abs(np.array(found) - exact).max() / strength)


def _damage() -> list[Check]:
    """Compare damage of a point in uniaxial strain with its differential equation."""
    coarse, fine = damaged_point(2000, True), damaged_point(8000, True)
    return [
        Check("continuum_damage: ramp of a point in uniaxial strain", 0.0, damaged_point(40, False), 1e-9, "1", SCIPY),
        Check("continuum_damage: cycle of a point, error ratio of a quarter of the step", 10.0, coarse / fine,
              source=SCIPY, relation="at least"),
        Check("continuum_damage: cycle of a point", 0.0, fine, 1e-5, "1", SCIPY),
    ]  # fmt: skip


def _flow() -> list[Check]:
    """Compare a cycle of shear with SciPy, and long steps with perfect plasticity."""
    from scipy.integrate import solve_ivp

    given = DruckerPrager.model_validate(YIELDING)
    shear, relaxation = given.shear_modulus, given.relaxation_time
    limit = float(1e6 * np.cos(0.5) + 6e6 * np.sin(0.5))
    size, period = 5e-3, 4e-6

    def rate(t: float, stress: np.ndarray) -> np.ndarray:
        beyond = np.sign(stress) * np.maximum(np.abs(stress) - limit, 0.0)
        forced = 2 * shear * size * 2 * np.pi / period * np.cos(2 * np.pi * t / period)
        return np.asarray(forced - beyond / relaxation)

    found = []
    for steps in (10000, 20000):
        t = period * np.arange(1, steps + 1) / steps
        stress = _points(given, size * np.sin(2 * np.pi * t / period), period / steps)
        found.append(stress[steps // 8 - 1 :: steps // 8])
    exact = solve_ivp(
        rate, (0, period), [0.0], "DOP853", period * np.arange(1, 9) / 8, rtol=1e-11, atol=1e-3, max_step=period / 4000
    ).y[0]
    coarse, half = (float(np.abs(each - exact).max() / limit) for each in found)
    plastic = _points(given, 1e-3 * np.arange(1, 20), 1e12 * relaxation)
    speed, after = 5e3, relaxation * np.arange(60)  # from yield on, in steps as long as the relaxation time
    ramp = _points(given, limit / (2 * shear) + speed * after, relaxation)
    lag = 2 * shear * speed * relaxation * -np.expm1(-after / relaxation)
    apart = float(np.abs(ramp / (limit + lag) - 1).max())
    return [
        Check("drucker_prager: ramp beyond yield of a point", 0.0, apart, 1e-8, source="closed form"),
        Check(
            "drucker_prager: cycle of a point, error ratio of half the step",
            3.0,
            coarse / half,
            source=SCIPY,
            relation="at least",
        ),
        Check("drucker_prager: cycle of a point", 0.0, half, 1e-6, "1", SCIPY),
        Check("drucker_prager: long steps stay on the yield surface", 1.0, plastic[-1] / limit, 1e-8),
    ]


def _case(material: Table, kind: str, mesh: MeshSource, boundaries: list[Table], plane: str) -> Case:
    return Case.model_validate({
        "plane": plane, "order": 4, "duration": 1.0, "mesh": mesh, "boundaries": boundaries,
        "materials": {"default": {"kind": kind, **material}}, "output": {"figures": False},
    })  # fmt: skip


def _waves(fine: bool, comm: MPI.Comm) -> list[Check]:
    """Measure plane waves in columns, S in antiplane and P in plane strain, by their spectra at two depths."""
    given, checks = StandardLinearSolids.model_validate(SOLID), []
    size, first, apart = 1e-3 if fine else 2e-3, 8e-3, 40e-3
    for wave, plane in (("S", "antiplane"), ("P", "strain")):
        speed = given.wave_speeds("strain").c_s if wave == "S" else given.wave_speeds("strain").c_p
        length = 0.5 * (speed * DURATION + first + apart) + 10e-3  # nothing comes back from the upper end
        mesh = Block(columns=2, rows=int(np.ceil(length / size)), size=size)
        rollers: list[Table] = [
            {"kind": "driven", "edge": f"rock.{side}", "component": "x", "velocity": 0.0} for side in ("left", "right")
        ]  # fmt: skip
        case = _case(SOLID, "standard_linear_solids", mesh, rollers if wave == "P" else [], plane)
        model = Model(case, comm)
        state, motion = model.initial_state(), case.stepper.bind(model)
        c = model.components
        y = model.coordinates[:, 1]
        # The state at the start: a pulse of velocity at the free lower end, whose spectrum spans the band.
        pulse = np.exp(-((y / (speed * 1.2e-6)) ** 2))
        state.velocity.reshape(-1, c)[:, c - 1] = pulse
        x = model.coordinates[:, 0]
        where = [np.flatnonzero((np.abs(y - depth) < 1e-9) & (np.abs(x) < 1e-9)) for depth in (first, first + apart)]
        series: list[list[float]] = [[], []]
        for _ in range(int(DURATION / motion.dt)):
            motion.step(state)
            for which, nodes in zip(series, where, strict=True):
                here = float(state.velocity.reshape(-1, c)[nodes[0], c - 1]) if len(nodes) else 0.0
                which.append(here)
        frequency = np.array([4e4, 7e4, 1.2e5, 2e5])
        t = motion.dt * (np.arange(len(series[0])) + 0.5)
        spectra = np.exp(-2j * np.pi * frequency[:, None] * t) @ np.array(series).T
        ratio = spectra[:, 1] / spectra[:, 0]
        of_bulk, of_shear = given.relaxed(frequency)
        modulus = of_shear if wave == "S" else of_bulk + 4 / 3 * of_shear
        exact = np.sqrt(modulus / given.density)  # complex speed
        velocity = 1 / (1 / exact).real
        turns = np.round(frequency * apart / velocity + np.angle(ratio) / (2 * np.pi))
        found = frequency * apart / (turns - np.angle(ratio) / (2 * np.pi))
        # exp(i (omega t - k x)): the imaginary part of the slowness is negative where the wave decays.
        slowness = 1 / found + 1j * np.log(np.abs(ratio)) / (2 * np.pi * frequency * apart)
        found_modulus = slowness**-2
        quality = found_modulus.real / found_modulus.imag
        wanted = given.Q_s if wave == "S" else given.Q_p
        for f, q, v, exact_v in zip(frequency, quality, found, velocity, strict=True):
            named = f"{wave} waves at {f / 1e3:g} kHz"
            checks.append(Check(f"Q of {named}", wanted, float(q), 0.05, source="the case", relative=True))
            checks.append(Check(
                f"phase velocity of {named}", float(exact_v), float(v), 2e-3, "m/s", "complex modulus", relative=True
            ))  # fmt: skip
    return checks


def column_of_layers(plane: str, comm: MPI.Comm) -> dict[str, tuple[float, float]]:
    """Return expected and found numbers of a plane wave that crosses the boundary of two layers.

    A pulse of velocity, v = exp(-(y - 10)^2 / 2.25) at y = 10 m, splits into two halves. The upper half meets the
    boundary at 20 m: 2 Z_1 / (Z_1 + Z_2) of it travels on, (Z_1 - Z_2) / (Z_1 + Z_2) of it returns, Z = rho c. Means of
    time and integrals of velocity at 15 m and 30 m give arrivals and amplitudes.
    """
    density, c_p, c_s = (2500.0, 2000.0), (5500.0, 2800.0), (3000.0, 1500.0)

    def layers(values: tuple[float, float]) -> Table:
        profile = {"kind": "layers", "boundaries": [20.0], "values": list(values)}
        return {"kind": "along_axis", "axis": "y", "profile": profile}

    material = {"density": layers(density), "c_p": layers(c_p), "c_s": layers(c_s)}
    boundaries: list[Table] = [{"kind": "absorbing", "edge": f"rock.{edge}"} for edge in ("top", "bottom")]
    boundaries += [] if plane == "antiplane" else [
        {"kind": "driven", "edge": f"rock.{side}", "component": "x", "velocity": 0.0} for side in ("left", "right")
    ]  # fmt: skip
    case = _case(material, "isotropic_elastic", Block(columns=1, rows=40, size=1.0), boundaries, plane)
    model = Model(case, comm)
    state, motion = model.initial_state(), case.stepper.bind(model)
    x, y, c = *model.coordinates.T, model.components
    state.velocity.reshape(-1, c)[:, c - 1] = np.exp(-((y - 10) ** 2) / 2.25)
    owned = np.arange(model.nodes) < model.owned_nodes
    where = [np.flatnonzero(owned & (np.abs(y - at) < 1e-9) & (np.abs(x) < 1e-9)) for at in (15.0, 30.0)]
    first, second = (c_s, c_p)[plane != "antiplane"]
    series = []
    for _ in range(int((10 / first + 10 / second + 6 / first) / motion.dt)):
        motion.step(state)
        series.append([float(state.velocity.reshape(-1, c)[nodes, c - 1].sum()) for nodes in where])
    v = parallel.total(comm, np.array(series))
    t = motion.dt * (np.arange(len(v)) + 0.5)
    returned, beyond = v[:, 0] * (t > 10 / first), v[:, 1]  # between the pulse and its echo
    whole = 0.5 * 1.5 * np.sqrt(np.pi) / first  # integral of half of the pulse over time
    Z = density[0] * first, density[1] * second
    return {
        "arrival beyond the layer boundary": (10 / first + 10 / second, float(t @ beyond / beyond.sum())),
        "arrival of the echo": (15 / first, float(t @ returned / returned.sum())),
        "transmitted velocity": (2 * Z[0] / (Z[0] + Z[1]), float(beyond.sum() * motion.dt / whole)),
        "reflected velocity": ((Z[0] - Z[1]) / (Z[0] + Z[1]), float(returned.sum() * motion.dt / whole)),
    }


def _layers(comm: MPI.Comm) -> list[Check]:
    """Compare waves that cross two layers with closed forms."""
    return [
        Check(f"layers, {wave} waves: {name}", exact, found, 2e-3, source="closed form", relative=True)
        for wave, plane in (("S", "antiplane"), ("P", "strain"))
        for name, (exact, found) in column_of_layers(plane, comm).items()
    ]


def anisotropic_speeds(angle: float, comm: MPI.Comm) -> list[tuple[float, float]]:
    """Return expected and found speeds of the quasi-P and quasi-S wave at an angle to fibres [m/s].

    A column along y with periodic sides and free ends vibrates as p cos(k y) cos(k c t) without tractions at its ends,
    with eigenvalues rho c^2 and eigenvectors p of the Christoffel tensor of the direction (Auld 1973). The column
    starts from rest in that shape, and the projection of the displacement on it changes sign every pi / (k c).
    """
    from ruptfx.laws.materials.stiffness import christoffel, tangent_stiffness

    size, rows = 1e-3, 4
    k = np.pi / (rows * size)
    sides: list[Table] = [{"kind": "periodic", "first": "rock.left", "second": "rock.right"}]
    case = Case.model_validate({
        "plane": "strain", "order": 4, "duration": 1.0, "mesh": Block(columns=1, rows=rows, size=size),
        "materials": {"default": {"kind": "orthotropic_elastic", "angle": angle, **FIBRES}}, "boundaries": sides,
        "stepper": {"kind": "leapfrog", "safety": 0.3}, "output": {"figures": False},
    })  # fmt: skip
    model = Model(case, comm)
    stiffness = tangent_stiffness(case.materials["default"], "strain")
    moduli, motions = np.linalg.eigh(christoffel(stiffness, np.array([0.0, 1.0])))
    found = []
    for modulus, p in zip(moduli, motions.T, strict=True):
        speed = float(np.sqrt(modulus / FIBRES["density"]))
        state, motion = model.initial_state(), case.stepper.bind(model)
        shape = (np.cos(k * model.coordinates[:, 1])[:, None] * p).ravel()
        state.displacement[:] = 1e-6 * shape
        values = [parallel.total(comm, model.layout.owned_dot(shape * model.mass, state.displacement))]
        while np.count_nonzero(np.diff(np.sign(values))) < 3:
            motion.step(state)
            values.append(parallel.total(comm, model.layout.owned_dot(shape * model.mass, state.displacement)))
        v, t = np.array(values), motion.dt * np.arange(len(values))
        before = np.flatnonzero(np.diff(np.sign(v)))
        zeros = t[before] - v[before] * motion.dt / (v[before + 1] - v[before])
        found.append((speed, float(2 * np.pi / (k * (zeros[2] - zeros[0])))))
    return found


def _directions(comm: MPI.Comm) -> list[Check]:
    """Compare wave speeds of a fibre composite in 12 directions with the Christoffel equation."""
    apart: list[list[float]] = [[], []]
    for angle in np.linspace(0, np.pi, 12, endpoint=False):
        for errors, (expected, found) in zip(apart, anisotropic_speeds(float(angle), comm), strict=True):
            errors.append(abs(found / expected - 1))
    return [
        Check(f"orthotropic_elastic: {wave} waves in 12 directions, largest error of the speed", 0.0, max(errors), 1e-3,
              source="Christoffel") for wave, errors in zip(("quasi-S", "quasi-P"), apart, strict=True)
    ]  # fmt: skip


def trapped_period(comm: MPI.Comm) -> tuple[float, float]:
    """Return the expected and found period of waves that are trapped in a zone of slower rock [s].

    The zone of demos/fault_zone.toml: S waves are slower by 30 % within h = 500 m of a fault that slips under constant
    traction. With the wavenumber k the motion cos(k x) cos(q y) in the zone and cos(k x) exp(-p y) beyond it oscillates
    at omega, q^2 = omega^2 / c_1^2 - k^2, p^2 = k^2 - omega^2 / c_2^2, q h tan(q h) = G_2 / G_1 p h (Love 1911). The
    model starts with it, over half of a wavelength of 2.5 km, and the projection of the velocity on it changes sign.
    """
    from scipy.optimize import brentq

    density, slow, fast, h = 2670.0, 2425.0, 3464.0, 500.0
    size, columns, rows = 125.0, 10, 48
    k, ratio = np.pi / (columns * size), (fast / slow) ** 2

    def numbers(omega: float) -> tuple[float, float]:
        return float(np.sqrt((omega / slow) ** 2 - k**2)), float(np.sqrt(k**2 - (omega / fast) ** 2))

    def residual(omega: float) -> float:
        q, p = numbers(omega)
        return q * np.sin(q * h) - ratio * p * np.cos(q * h)

    omega = brentq(residual, slow * k * (1 + 1e-9), min(fast * k, slow * np.hypot(k, 0.5 * np.pi / h)) * (1 - 1e-9))
    q, p = numbers(omega)
    c_s = {"kind": "layers", "boundaries": [h], "values": [slow, fast]}
    material = {"density": density, "c_p": 6000.0, "c_s": {"kind": "along_axis", "axis": "y", "profile": c_s}}
    case = _case(material, "isotropic_elastic", Block(columns=columns, rows=rows, size=size), [], "antiplane")
    model = Model(case, comm)
    state, motion = model.initial_state(), case.stepper.bind(model)
    x, y = model.coordinates.T
    shape = np.cos(k * x) * np.where(y < h, np.cos(q * y), np.cos(q * h) * np.exp(-p * (y - h)))
    state.velocity[:] = shape
    times, found = [0.0], [parallel.total(comm, model.layout.owned_dot(shape * model.mass, state.velocity))]
    while np.count_nonzero(np.diff(np.sign(found))) < 4:
        motion.step(state)
        times.append(motion.dt * (len(times) - 0.5))
        found.append(parallel.total(comm, model.layout.owned_dot(shape * model.mass, state.velocity)))
    v, t = np.array(found), np.array(times)
    before = np.flatnonzero(np.diff(np.sign(v)))
    zeros = t[before] - v[before] * (t[before + 1] - t[before]) / (v[before + 1] - v[before])
    return 2 * np.pi / omega, 2 * float(zeros[3] - zeros[0]) / 3


def _trapped(comm: MPI.Comm) -> list[Check]:
    exact, found = trapped_period(comm)
    named = "fault zone: period of trapped waves of 2.5 km"
    return [Check(named, exact, found, 0.05, "s", "Love (1911)", relative=True)]


def _blocks(comm: MPI.Comm) -> list[Check]:
    """Check the energy budget of a block that is struck, and displacements of one that cannot yield."""
    mesh, checks = Block(columns=12, rows=8, size=1e-3), []
    push: list[Table] = [{"kind": "driven", "edge": "rock.bottom", "component": "y", "velocity": 20.0, "ramp": 1e-6}]
    results = {}
    for name, kind, material in (
        ("elastic", "isotropic_elastic", ROCK), ("standard_linear_solids", "standard_linear_solids", SOLID),
        ("drucker_prager", "drucker_prager", YIELDING),
        ("without yield", "drucker_prager", {**YIELDING, "cohesion": 1e12}),
    ):  # fmt: skip
        case = _case(material, kind, mesh, push, "strain")
        model = Model(case, comm)
        state, motion = model.initial_state(), case.stepper.bind(model)
        for number in range(120):
            state.wants_energies = number == 119
            motion.step(state)
        energy, results[name] = motion.energies(state), state.displacement
        work = energy.pop("boundary_work")
        if kind == name:
            checks.append(Check(f"{name}: unaccounted energy", 0.0, (sum(energy.values()) - work) / work, 1e-10))
            lost = energy["material_dissipation"] / work
            checks.append(Check(f"{name}: dissipated part of the work", 0.01, lost, relation="at least"))
    apart = np.abs(results["without yield"] - results["elastic"]).max() / np.abs(results["elastic"]).max()
    checks.append(Check("drucker_prager without yield: difference to elastic displacements", 0.0, float(apart), 1e-12))
    return checks


def _under_weight(material: Table) -> Case:
    """Return a box with a fault that dips at 60 degrees under weight and tectonic stress, those of TPV12 and TPV13."""
    stress: Table = {
        "kind": "depth", "density": 2700.0, "fluid_density": 1000.0, "gravity": 9.8, "along": 0.6748, "across": 0.3496,
    }  # fmt: skip
    friction: Table = {"kind": "cohesion", "c": 0.2e6, "law": {"kind": "coulomb", "mu_d": 0.7}}
    edges = [f"{body}.{side}" for body in ("plus", "minus") for side in ("left", "right", "bottom")]
    return Case.model_validate({
        "plane": "solid", "order": 2, "duration": 1.0, "initial_stress": stress,
        "mesh": {
            "kind": "box_with_fault", "dip": 60.0, "fault_length": 6e3, "fault_width": 15e3, "element_size": 3e3,
            "beyond": 3e3, "distance": 6e3,
        },
        "materials": {"default": {"c_p": 5716.0, "c_s": 3300.0, "density": 2700.0, **material}},
        "boundaries": [{"kind": "absorbing", "edge": edge} for edge in edges],
        "faults": {"main": {"contact": {"kind": "split_node"}, "friction": friction}}, "output": {"figures": False},
    })  # fmt: skip


def _unbalanced(model: Model) -> float:
    """Return the largest nodal force of initial stress, weight, and tractions of edges and faults, over its parts."""
    stress, ufl, space = model.case.initial_stress, fem.ufl, model.space
    assert isinstance(stress, Depth)
    values = stress.effective(model.coordinates)
    numbers = in_sweep_order(fem.lagrange(model.mesh, model.order, 1))
    parts = []
    for column in values.T:
        part = fem.dolfinx.fem.Function(numbers)
        part.x.array[:] = column
        parts.append(part)
    xx, yy, zz, xy, yz, xz = parts
    tensor = ufl.as_matrix([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    test, dx = ufl.TestFunction(space), ufl.dx(model.mesh)
    inner = fem.assemble_summed(space, ufl.inner(tensor, ufl.grad(test)) * dx)
    weight = ufl.as_vector((stress.density - stress.fluid_density) * stress.acceleration(3))
    outer = fem.assemble_summed(space, ufl.inner(weight, test) * dx)
    normal = ufl.FacetNormal(model.mesh)
    for name in model.bodies.edges:
        edge = ufl.Measure("ds", model.mesh, subdomain_data=model.bodies.facets, subdomain_id=model.bodies.tags[name])
        outer += fem.assemble_summed(space, ufl.inner(tensor * normal, test) * edge)
    fault = model.faults[0]
    traction = np.column_stack([-fault.normal_stress_0, fault.shear_traction_0])
    held = np.zeros(len(inner))
    fault.interface.assemble(traction * fault.interface.owned[:, None], held)
    model.layout.sum_shared(held)
    left = parallel.largest(model.comm, float(np.abs(inner - outer + held).max(initial=0.0)))
    return left / parallel.largest(model.comm, float(np.abs(inner).max(initial=0.0)))


def _at_rest(comm: MPI.Comm) -> list[Check]:
    """Run 1000 steps under weight and tectonic stress, below the strength of fault and rock."""
    yielding = {"cohesion": 5e6, "friction_angle": float(np.arctan(0.85)), "relaxation_time": 0.03}
    checks = []
    for kind, material in (("isotropic_elastic", {}), ("drucker_prager", yielding)):
        case = _under_weight({"kind": kind, **material})
        model = Model(case, comm)
        state, motion = model.initial_state(), case.stepper.bind(model)
        for _ in range(1000):
            motion.step(state)
        fault = model.faults[0]
        now = [state.faults["main"][name] for name in ("normal_stress", "shear_traction_1", "shear_traction_2")]
        then = [fault.normal_stress_0, *fault.shear_traction_0.T]
        changes = [2700 * 5716 * state.velocity, *(a - b for a, b in zip(now, then, strict=True))]
        largest = max(parallel.largest(comm, float(np.abs(each).max(initial=0.0))) for each in changes)
        whole = parallel.largest(comm, float(fault.normal_stress_0.max(initial=0.0)))
        checks.append(Check(f"dipping fault under weight, {kind}: change in 1000 steps", 0.0, largest / whole, 1e-12))
        if kind == "isotropic_elastic":
            left = _unbalanced(model)
            checks.append(Check("dipping fault under weight: unbalanced nodal force over its parts", 0.0, left, 1e-12))
    return checks


def prescribed_crack(material: Table | None = None) -> Case:
    """Return the demo `off_fault_plasticity`, with another material if one is given."""
    table = read_toml(Path(str(files("ruptfx").joinpath("demos/off_fault_plasticity.toml"))))
    if material is not None:
        table["materials"]["default"] = material
    return Case.model_validate(table | {"output": {"figures": False}})


def _width(height: np.ndarray, strain: np.ndarray) -> float:
    """Return the distance from the fault at which the plastic strain of a column of nodes falls below `LEAST` [m]."""
    order = np.argsort(height)
    height, strain = height[order], strain[order]
    last = np.flatnonzero(strain > LEAST)[-1:]
    return float(sum(np.interp(LEAST, strain[at : at + 2][::-1], height[at : at + 2][::-1]) for at in last))


def _off_fault(comm: MPI.Comm) -> list[Check]:
    """Check the demo of a crack in rock that yields: width of the yielded zone, its side, and the largest slip rate.

    The speed is prescribed and the static strength so large that nothing slips ahead of the tip: a lower strength
    limits the stress there before the rock yields. Far from its start such a crack has no length but the distance run,
    so that the width is in proportion to it. Yield on the side of extension: Andrews (2005), JGR 110, B01307.
    """
    rock: Table = {"kind": "isotropic_elastic", "density": 2700.0, "c_p": 5716.0, "c_s": 3300.0}
    places, peaks = np.arange(4e3, 8.1e3, 1e3), {}
    for name, case in (("elastic", prescribed_crack(rock)), ("yielding", prescribed_crack())):
        model = Model(case, comm)
        state, motion = model.initial_state(), case.stepper.bind(model)
        face = model.faults[0].interface
        peak = np.zeros(len(face.points))
        while state.time < END:
            motion.step(state)
            peak = np.maximum(peak, np.abs(state.faults["main"]["slip_rate"]).reshape(len(peak), -1)[:, 0])
        near = [np.abs(face.points[:, 0] - at) < 300 for at in places]
        peaks[name] = np.array([parallel.largest(comm, peak[here].max(initial=0.0)) for here in near])
    bulk = BulkFields(model)
    topology = bulk.topology()
    found = np.column_stack([topology.points, topology.body, bulk.gather(state)["plastic_strain"]])
    x, y, body, strain = parallel.share_rows(comm, found).T
    forward = np.where(body == model.bodies.names.index("lower"), x, -x)  # extension: before the tip in the lower body
    columns = [(np.abs(forward - at) < 1) & (x > 0) for at in places]
    widths = np.array([_width(np.abs(y[here]), strain[here]) for here in columns])
    wrong = np.abs(y[(forward < -2e3) & (strain > LEAST)]).max(initial=0.0)
    slope = np.polyfit(places, widths, 1)
    ratio = (widths / places)[1:]
    grown = {name: float(values[-1] / values[0]) for name, values in peaks.items()}
    named = "crack in yielding rock: "
    return [
        Check(named + "width of the yielded zone, distance from a straight line", 0.0,
              float(np.abs(widths / np.polyval(slope, places) - 1).max()), 0.1),
        Check(named + "width over distance from 5 to 8 km, distance from its mean", 0.0,
              float(np.abs(ratio / ratio.mean() - 1).max()), 0.1),
        Check(named + "width of the yielded zone on the side of compression", 0.0, float(wrong), 1.0, "m"),
        Check(named + "largest slip rate over that of elastic rock", 0.8,
              float(peaks["yielding"][-1] / peaks["elastic"][-1]), relation="at most"),
        Check(named + "growth of the largest slip rate from 4 to 8 km", 1.0, grown["yielding"], 0.1),
        Check("the same crack in elastic rock: growth of the largest slip rate", 1.15, grown["elastic"],
              relation="at least"),
    ]  # fmt: skip


def _cost(fine: bool) -> list[Check]:
    """Measure the speed of steps over that of elastic bodies, order 4 in plane strain."""
    side = 200 if fine else 100
    mesh = Block(columns=side, rows=side, size=1e-3)
    axis: Table = {"kind": "along_axis", "axis": "y"}
    layers = {**axis, "profile": {"kind": "layers", "boundaries": [0.5e-3 * side], "values": [5e9, 6e9]}}
    graded = {**axis, "profile": {"kind": "table", "positions": [0.0, 1e-3 * side], "values": [5e9, 6e9]}}
    motions: dict[str, tuple[Motion, list[float], State]] = {}
    for name, kind, material in (
        ("elastic", "isotropic_elastic", ROCK), ("layers", "isotropic_elastic", {**ROCK, "young_modulus": layers}),
        ("moduli that vary in elements", "isotropic_elastic", {**ROCK, "young_modulus": graded}),
        ("orthotropic_elastic", "orthotropic_elastic", FIBRES), ("drucker_prager", "drucker_prager", YIELDING),
        ("standard_linear_solids", "standard_linear_solids", SOLID),
    ):  # fmt: skip
        case = _case(material, kind, mesh, [], "strain")
        model = Model(case, fem.MPI.COMM_SELF)
        state = model.initial_state()
        state.velocity[:] = np.random.default_rng(0).normal(size=len(state.velocity))
        motions[name] = case.stepper.bind(model), [], state
    for _ in range(30):  # in turns, so that a busy machine slows all of them
        for motion, times, state in motions.values():
            began = time.process_time()
            motion.step(state)
            times.append(time.process_time() - began)
    seconds = {name: float(np.median(times[5:])) for name, (_, times, _) in motions.items()}
    elastic = seconds.pop("elastic")
    aims = {
        "layers": 0.85, "moduli that vary in elements": 0.85, "orthotropic_elastic": 0.75, "drucker_prager": 0.4,
        "standard_linear_solids": 0.25,
    }  # fmt: skip
    return [
        Check(f"{kind}: speed over that of elastic bodies", aims[kind], elastic / each, source="aim",
              relation="at least", timing=True) for kind, each in seconds.items()
    ]  # fmt: skip
