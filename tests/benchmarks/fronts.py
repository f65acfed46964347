"""Fronts as cracks: strain gauges beside ruptures of known fracture energy, local stress drop and J integral.

PMMA in plane strain, linear slip weakening. Toughness grows with the distance from the middle as the energy release of
a bilateral crack does, so that the front runs at a nearly constant speed, one for every loading
(`fracture.half_length_at`); within 30 mm it is forced. Slow fronts get faster on the way, as plates are finite: for the
slowest toughness grows with the power 1.3 of the distance, so that the front stops unless it is loaded, and the far
side of a plate of 60 mm moves on. Nine gauges 2, 3.5 and 5 mm above the interface, 75, 80 and 85 mm from the middle
(79, 80 and 81 mm for the slowest, which changes its speed on the way), see it pass, with noise of 3 % of the largest
strain. The fit knows the elastic constants only. Fracture energy where the front is: (mu_s - mu_d) sigma D_c / 2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ruptfx import Table
from ruptfx.app.bench import Check, Outcome
from ruptfx.bodies.space.inside import Inside
from ruptfx.case import Case
from ruptfx.laws import fracture
from ruptfx.laws.materials.isotropic_elastic import IsotropicElastic
from ruptfx.platform import fem
from ruptfx.results.analysis import energy_release
from ruptfx.results.analysis.front_fit import COMPONENTS, FrontFit, Trace, fit_front
from ruptfx.results.analysis.near_tip import Medium, mode_II, strain_extremes
from ruptfx.run.model import Model

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ruptfx.platform.fem import MPI

Array = np.ndarray

PMMA = IsotropicElastic(young_modulus=5.65e9, poisson_ratio=0.33, density=1180.0)
MEDIUM = Medium.of(PMMA, "strain")
GAMMA, SIGMA, MU_D = 2.5, 5e6, 0.2
PLACE, OFFSET = 80e-3, 2e-3  # m: of the gauges; what D_c is larger by, so that it is not zero in the middle
HEIGHTS = (2e-3, 3.5e-3, 5e-3)  # m: of gauges
NOISE = 0.03
POINTS = 40  # of half the length, and of the height, of the box round PLACE of J integrals


@dataclass(frozen=True)
class Loading:
    """Target speed [c_R], process zone, element size and distance of gauges [m].

    Also: exponent with which toughness grows with distance, stress drop [Pa] if it does not follow from the speed, and
    speed of the far side [m/s].

    And with what power of the distance toughness grows, stress drop [Pa] where the speed does not tell it, and speed of
    the far side [m/s].
    """

    fraction: float
    zone: float = 2e-3
    size: float = 1e-3
    apart: float = 5e-3
    power: float = 1.0
    drop: float | None = None
    pushed: float = 0.0

    @property
    def gauges(self) -> list[tuple[float, float]]:
        """Positions of the gauges [m]."""
        return [(PLACE + x, y) for x in (-self.apart, 0.0, self.apart) for y in HEIGHTS]

    @property
    def box(self) -> float:
        """Half-length, and height, of the box of the J integral [m]."""
        return min(8e-3, 8 * self.zone)

    @property
    def energy(self) -> float:
        """Fracture energy at PLACE [J/m2]."""
        return GAMMA * (1 + OFFSET / PLACE) ** self.power


SLOW = Loading(0.1, 3e-3, 2e-3, apart=1e-3, power=1.3, drop=0.2e6, pushed=3.2e-3)
COARSE = [Loading(0.3), Loading(0.7), Loading(0.9, 0.5e-3, 0.5e-3)]
FINE = [SLOW, *COARSE, Loading(0.95, 0.4e-3, 0.4e-3)]


@dataclass(frozen=True)
class Passage:
    """Result of a run: gauge traces, and the interface at PLACE.

    Attributes
    ----------
    traces : list of Trace
    speed, arrival : float
        Speed [m/s] and arrival [s] of the front at PLACE, from the onset of slip.
    time, traction, slip : ndarray
        Histories at PLACE.
    moment : Moment
        Fields when the front is at PLACE.
    """

    traces: list[Trace]
    speed: float
    arrival: float
    time: Array
    traction: Array
    slip: Array
    moment: energy_release.Moment


def table(load: Loading) -> Table:
    """Return the case of a loading."""
    speed = load.fraction * MEDIUM.c_R
    length = fracture.half_length_at(speed, MEDIUM.c_p, MEDIUM.c_s)
    drop = load.drop or float(np.sqrt(GAMMA * MEDIUM.modulus * length / (np.pi * PLACE)))
    # The zone of a moving front is shorter by A_II; 9 pi / 32 G* D_c / strength, Gamma = strength D_c / 2.
    moving = load.zone * fracture.A_II(speed, MEDIUM.c_p, MEDIUM.c_s)
    strength = float(np.sqrt(9 * np.pi / 32 * MEDIUM.modulus * GAMMA / moving))
    along = np.linspace(0, 0.2, 201)
    D_c = 2 * GAMMA / strength * ((along + OFFSET) / PLACE) ** load.power
    far: list[Table] = [{"kind": "absorbing", "edge": "upper.top"}, {"kind": "absorbing", "edge": "upper.right"}]
    if load.pushed:
        far = [
            {"kind": "driven", "edge": "upper.top", "component": "x", "velocity": load.pushed, "ramp": 100e-6},
            {"kind": "driven", "edge": "upper.right", "component": "y", "velocity": 0.0},
        ]
    length, height = (200e-3, 60e-3) if load.pushed else (115e-3, 110e-3)
    return {
        "plane": "strain", "order": 4, "duration": 1.15 * 92e-3 / speed,
        "mesh": {
            "kind": "half_plate", "length": length, "height": height, "element_size": load.size, "growth": 1.15,
        },
        "materials": {"default": {"kind": "isotropic_elastic", **PMMA.model_dump(exclude_none=True)}},
        "damping": {"kelvin_voigt": {"fraction": 0.1}},
        "faults": {"main": {
            "contact": {"kind": "split_node"}, "initial_stress": {"normal": SIGMA, "shear": MU_D * SIGMA + drop},
            "friction": {
                "kind": "linear_slip_weakening", "mu_s": MU_D + strength / SIGMA, "mu_d": MU_D,
                "D_c": {"kind": "table", "positions": along.tolist(), "values": D_c.tolist()},
            },
            "nucleation": {
                "kind": "forced_rupture", "center": 0.0, "radius": 30e-3, "speed": speed, "mu_d": MU_D,
                "t_w": load.zone / 2 / speed,
            },
        }},
        "boundaries": [{"kind": "driven", "edge": "upper.left", "component": "y", "velocity": 0.0}, *far],
    }  # fmt: skip


def passage(load: Loading) -> Passage:
    """Run a loading and return gauges, front and interface at PLACE."""
    case = Case.model_validate(table(load))
    model = Model(case, fem.MPI.COMM_SELF)
    motion, state = case.stepper.bind(model), model.initial_state()
    gauges = [Inside(model, place, None, "gauges") for place in load.gauges]
    box = _Box(model, load.box)
    fault = model.faults[0]
    position = fault.interface.position
    here = int(np.argmin(np.abs(position - PLACE)))
    drop = float(fault.shear_traction_0[here, 0]) - MU_D * SIGMA
    steps = int(case.duration / motion.dt)
    every = max(1, steps // 1200)
    arrival = np.full(len(position), np.nan)
    times, strains, rows = [], [], []
    for step in range(steps):
        motion.step(state)
        found = state.faults[fault.name]
        rate = np.abs(fault.components(found, "slip_rate")[:, 0])
        arrival = np.where(np.isnan(arrival) & (rate > 1e-3), state.fault_time, arrival)
        if np.isfinite(arrival[here]) and len(box.seen) < 2:
            box.look(state.displacement, state.velocity)
        if step % every == 0:
            times.append(state.time)
            strains.append([gauge.value(state.displacement)[1:] for gauge in gauges])
            traction, slip = (fault.components(found, name)[here, 0] for name in ("shear_traction", "slip"))
            rows.append((state.fault_time, traction, slip))
    when, traction, slip = np.array(rows).T
    traces = _traces(load, np.array(times), np.array(strains))
    moment = box.moment(motion.dt, drop)
    return Passage(traces, _speed(position, arrival), float(arrival[here]), when, traction, slip, moment)


def _traces(load: Loading, time: Array, gradient: Array) -> list[Trace]:
    """Return the gauge traces with noise; gradients have the shape (times, gauges, derivative, component)."""
    noise = NOISE * float(np.abs(gradient[..., 0, 0]).max())
    random = np.random.default_rng(1)
    parts = {
        "xx": gradient[..., 0, 0],
        "yy": gradient[..., 1, 1],
        "xy": 0.5 * (gradient[..., 0, 1] + gradient[..., 1, 0]),
    }
    return [
        Trace(x, y, time, {name: parts[name][:, i] + random.normal(0, noise, len(time)) for name in COMPONENTS})
        for i, (x, y) in enumerate(load.gauges)
    ]


class _Box:
    """Sample points above the interface around PLACE, with their fields in two steps."""

    def __init__(self, model: Model, half: float) -> None:
        size = half / POINTS
        x, y = np.meshgrid(PLACE + size * (np.arange(2 * POINTS) - POINTS + 0.5), size * (np.arange(POINTS) + 0.5))
        self.area = np.full(x.size, size**2)
        self.points = np.column_stack([x.ravel(), y.ravel()])
        self.places = [Inside(model, point, "upper", "box") for point in self.points]
        self.seen: list[tuple[Array, Array]] = []

    def look(self, displacement: Array, velocity: Array) -> None:
        self.seen.append(
            (np.array([place.value(displacement)[1:] for place in self.places]),
             np.array([place.value(velocity) for place in self.places]))
        )  # fmt: skip

    def moment(self, dt: float, drop: float) -> energy_release.Moment:
        """Return the fields of the first step; velocities are half a step before displacements."""
        (gradient, before), (_, after) = self.seen
        gradient = gradient.copy()
        gradient[:, 1, 0] += drop / MEDIUM.shear_modulus
        mean, change = 0.5 * (before + after), (after - before) / dt
        return energy_release.Moment(self.points, self.area, gradient, mean[:, 0], change[:, 0], mean[:, 1])


def _speed(position: Array, arrival: Array) -> float:
    """Return the speed of the front near PLACE [m/s], a line fit to arrivals within 6 mm."""
    near = (np.abs(position - PLACE) < 6e-3) & np.isfinite(arrival)
    return float(1 / np.polyfit(position[near], arrival[near], 1)[0])


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    del comm
    checks, drawn = [], []
    for load in FINE if fine else COARSE:
        seen = passage(load)
        found = fit_front(seen.traces, MEDIUM)
        fall = energy_release.breakdown(seen.time, seen.traction, seen.slip, MU_D * SIGMA)
        label = f"front at {seen.speed / MEDIUM.c_R:.2f} c_R"
        source = "(mu_s - mu_d) sigma D_c / 2"
        flow = energy_release.domain_integral(seen.moment, PLACE, load.box, MEDIUM)
        for what, value in (("gauges", found.fracture_energy), ("local drop", fall.energy), ("J integral", flow)):
            checks.append(Check(f"{label}: Gamma, {what}", load.energy, value, 0.05, "J/m2", source, relative=True))
        away = abs(found.fracture_energy - load.energy) / found.fracture_energy_error
        checks.append(Check(f"{label}: Gamma off, in standard errors", 3.0, away, 0, "1", source, "at most"))
        if not load.pushed:  # that one slows down while gauges see it, from 0.11 to 0.08 c_R: there is no one speed
            checks.append(Check(f"{label}: speed, gauges", seen.speed, found.speed, 0.05, "m/s", "where slip begins",
                                relative=True))  # fmt: skip
        K = fracture.stress_intensity(load.energy, MEDIUM.modulus, fracture.A_II(seen.speed, MEDIUM.c_p, MEDIUM.c_s))
        checks.append(Check(f"{label}: K_II, gauges", K, abs(found.K_II), 0.05, "Pa sqrt(m)", "Gamma, speed",
                            relative=True))  # fmt: skip
        tip = found.tip(np.array([seen.arrival]))[0] - PLACE
        checks.append(Check(f"{label}: tip within the process zone", 0.0, -tip, load.zone, "m", "where slip begins"))
        drawn.append((label, seen, found))
    still = strain_extremes(4e-3, fracture.stress_intensity(2.5, MEDIUM.modulus), 0.0, MEDIUM)
    for name, value in _williams(4e-3).items():
        checks.append(Check(f"strain {name} 4 mm above a front at rest", value, still[name], 1e-4, "1",
                            "Williams (1957)", relative=True))  # fmt: skip
    return Outcome(checks, lambda: _draw(drawn))


def _williams(height: float) -> dict[str, float]:
    """Return the extreme strains of the field at rest [1], from its stresses."""
    angle = np.linspace(1e-3, np.pi - 1e-3, 100001)
    half, other = angle / 2, 3 * angle / 2
    scale = fracture.stress_intensity(2.5, MEDIUM.modulus) * np.sqrt(np.sin(angle) / (2 * np.pi * height))
    xx = -scale * np.sin(half) * (2 + np.cos(half) * np.cos(other))
    yy = scale * np.sin(half) * np.cos(half) * np.cos(other)
    xy = scale * np.cos(half) * (1 - np.sin(half) * np.sin(other))
    nu, shear = PMMA.poisson_ratio, MEDIUM.shear_modulus
    return {
        "xx_min": float(((1 - nu) * xx - nu * yy).min()) / (2 * shear), "xy_max": float(xy.max()) / (2 * shear),
        "yy_max": float(((1 - nu) * yy - nu * xx).max()) / (2 * shear),
    }  # fmt: skip


def _draw(drawn: list[tuple[str, Passage, FrontFit]]) -> Figure:
    from ruptfx.results.figure_style import new_figure

    figure, axes = new_figure(1, len(drawn), 3.4, 3.6 * len(drawn))
    for ax, (label, seen, found) in zip(axes[0], drawn, strict=True):
        trace = seen.traces[4]  # the gauge 3.5 mm above PLACE
        ahead = trace.x - found.tip(trace.time)
        near = np.abs(ahead) < 12e-3
        field = mode_II(ahead, np.full_like(ahead, trace.y), found.speed, MEDIUM, found.K_II, zone=found.process_zone)
        for colour, name in enumerate(COMPONENTS):
            singular = getattr(field, name)
            # The singular field has no uniform stress; subtract the mean difference.
            shift = float(np.mean((trace.strain[name] - singular)[near]))
            ax.plot(1e3 * ahead[near], 1e6 * trace.strain[name][near], f"C{colour}", lw=0.6)
            ax.plot(1e3 * ahead[near], 1e6 * (singular + shift)[near], "k--", lw=0.9)
            ax.plot([], [], f"C{colour}", label=f"$\\varepsilon_{{{name}}}$")
        ax.set(xlabel="gauge ahead of the tip (mm)", title=label)
    axes[0, 0].set_ylabel("strain change ($10^{-6}$)")
    axes[0, 0].legend(frameon=False, title="dashed: near-tip field")
    return figure
