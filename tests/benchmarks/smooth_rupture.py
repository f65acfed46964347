"""A rupture on a smooth interface of two materials, on the mesh of a paper: waves, fronts to both sides, two patches.

Di Bartolomeo et al. (ESDA2010-25247, section 3.1, Fig. 2, 4 and 5): plain Coulomb friction, mu = 1, nodes 12.5 um
apart, friction lost at once on a patch of 0.125 mm, and of 0.5 mm. They do not print the load. Here the bodies begin
under uniform stress, the only number that matters is the ratio of shear to normal stress, and that is chosen once, so
that the front in the slip direction of the stiff body ends where theirs does, 1.3 mm from the centre; all other numbers
follow.

Coulomb friction between these bodies is ill-posed: with nodes 25 um apart the pulse the other way shrinks instead of
growing, so that only that front is looked at on both meshes. `bimaterial` has the same with a memory, on which the mesh
has no influence.

"Left" and "right" are those of the paper: to the right slips the soft body, here to negative x.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from benchmarks import bimaterial as smooth
from ruptfx.app.bench import Check, Outcome
from ruptfx.app.bench._rupture import Rupture, rupture

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ruptfx.platform.fem import MPI

RATIO = 0.93  # of shear to normal stress; between 0.90 and 0.96, ends of the left front from 0.8 to 2.7 mm
SPACINGS = (25e-6, 12.5e-6)  # m
PATCH, LARGE_PATCH = 0.125e-3, 0.5e-3  # m, whole
LEFT, RIGHT = 1, -1
FAST = 0.05  # m/s, above the slip rates of the waves behind the fronts
WAVES = (0.4e-6, 1.2e-6)  # s, times at which P waves are located
EVERY = 0.2e-6  # s, between the slips of the figure
SOURCE = "Di Bartolomeo et al. (2010)"

Floats = NDArray[np.float64]


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    del fine, comm
    usual = [_run(spacing, PATCH, 4.5e-6) for spacing in SPACINGS]
    finest, large = usual[-1], _run(SPACINGS[-1], LARGE_PATCH, 3e-6)
    strength = smooth.FRICTION * smooth.SIGMA
    inside = np.abs(finest.position) < 0.499 * PATCH
    held = float(np.abs(finest.fields["shear_traction"][inside]).max()) / strength
    checks = [Check("shear on the patch over the strength", 0.0, held, 1e-12, "1", "friction is gone")]
    fields = [_run(SPACINGS[-1], PATCH, time) for time in WAVES]
    for name, material in zip(finest.model.bodies.names, finest.model.materials, strict=True):
        (r_1, t_1), (r_2, t_2) = (_p_front(field, name) for field in fields)
        c_p = material.wave_speeds("strain").c_p
        speed = (r_2 - r_1) / (t_2 - t_1)
        checks.append(Check(f"front of the P wave, {name} body", c_p, speed, 0.01, "m/s", "c_p", relative=True))
    for result, spacing in zip(usual, SPACINGS, strict=True):
        mesh = f"nodes {1e6 * spacing:g} um apart"
        checks += [
            Check(f"left front ends, {mesh}", 1.3e-3, _end(result, LEFT), 0.3e-3, "m", f"{SOURCE}; chosen"),
            Check(f"left front, {mesh}", 1700.0, _front(result, LEFT, 0.3e-3, 1e-3), 0.06, "m/s", SOURCE,
                  relative=True),
            Check(f"left: slip at 1 mm over that at 0.5 mm, {mesh}", 1.0, _slip(result, LEFT * 1e-3)
                  / _slip(result, LEFT * 0.5e-3), 0.0, "1", "decays", "at most"),
        ]  # fmt: skip
    there = finest.at(RIGHT * 2e-3)
    healed = float(np.abs(finest.slip_rate[-1, there]) / np.abs(finest.slip_rate[:, there]).max())
    checks += [
        Check("right: speed of the peak", 1000.0, _peak(finest, RIGHT, 1e-3, 4e-3), 50.0, "m/s", f"{SOURCE}: 980"),
        Check("right: slip rate behind the pulse over its peak", 0.0, healed, 0.01, "1", "self-healing"),
        Check("right: slip at 4 mm over that at 1 mm", 1.0, _slip(finest, RIGHT * 4e-3) / _slip(finest, RIGHT * 1e-3),
              0.0, "1", "grows", "at least"),
        Check("patch of 0.5 mm: left front", 1765.0, _front(large, LEFT, 1e-3, 4e-3), 65.0, "m/s",
              f"{SOURCE}: tends to c_p of the soft body"),
        Check("patch of 0.5 mm: left front is at", 4e-3, _end(large, LEFT), 0.0, "m", "sustained", "at least"),
        Check("patch of 0.5 mm: right front", finest.model.materials[0].wave_speeds("strain").c_s,
              _front(large, RIGHT, 0.3e-3, 1e-3), 0.0, "m/s", "supershear", "at least"),
        *(result.budget() for result in (*usual, large)),
    ]  # fmt: skip
    return Outcome(checks, lambda: _draw(finest, large))


def _run(spacing: float, patch: float, duration: float) -> Rupture:
    """Run from uniform stress; waves from the edges do not reach the evaluated part."""
    table = smooth.case(spacing, smooth.COULOMB, duration)
    table["mesh"] |= {"length": 12e-3, "left": -6e-3, "height": 3e-3}
    fault = table["faults"]["main"]
    fault["initial_stress"]["shear"] = RATIO * smooth.FRICTION * smooth.SIGMA
    fault["nucleation"]["half_width"] = 0.5 * patch
    return rupture(table, stride=2)


def _p_front(result: Rupture, body: str) -> tuple[float, float]:
    """Return the distance that half of the P-wave amplitude has reached [m], and the time [s].

    From 45 to 75 degrees from the interface, the mean over narrow angles: on the interface there is none, and up to 37
    degrees in the soft body the head wave of the stiff one is ahead.
    """
    model, state = result.model, result.state
    number, x = model.bodies.names.index(body), np.abs(model.coordinates[:, :2])
    distance, angle = np.hypot(*x.T), np.degrees(np.arctan2(x[:, 1], x[:, 0]))
    speed, time = np.linalg.norm(state.velocity.reshape(-1, 2), axis=1), state.time - 0.5 * state.lag
    ahead = distance > 1.2 * model.materials[number].wave_speeds("strain").c_s * time  # of the S wave
    reached = []
    for first in np.arange(45.0, 75.0, 3.0):
        there = ahead & (model.layout.body == number) & (angle >= first) & (angle < first + 3)
        reached.append(distance[there & (speed > 0.5 * speed[there].max())].max())
    return float(np.mean(reached)), time


def _reach(result: Rupture, side: int) -> tuple[Floats, Floats]:
    """Return distances from the centre to one side [m], increasing, and arrival times of slip [s]."""
    distance = side * result.position
    order = np.argsort(distance)[np.sort(distance) > 0]
    return distance[order], result.rupture_time(FAST)[order]


def _end(result: Rupture, side: int) -> float:
    """Return the position at which a front ends [m]."""
    distance, arrival = _reach(result, side)
    return float(distance[np.isfinite(arrival)].max())


def _front(result: Rupture, side: int, near: float, far: float) -> float:
    """Return the speed of the first slip between two distances [m/s]."""
    distance, arrival = _reach(result, side)
    part = (distance > near) & (distance < far) & np.isfinite(arrival)
    return float(np.polyfit(arrival[part], distance[part], 1)[0])


def _peak(result: Rupture, side: int, near: float, far: float) -> float:
    """Return the speed of the largest slip rate between two distances [m/s]."""
    distance = side * result.position
    part = (distance > near) & (distance < far)
    when = result.time[np.abs(result.slip_rate).argmax(axis=0)]
    return float(np.polyfit(when[part], distance[part], 1)[0])


def _slip(result: Rupture, position: float) -> float:
    """Return the slip at the end [m]."""
    return float(np.abs(np.interp(position, result.position, result.fields["slip"])))


def _draw(usual: Rupture, large: Rupture) -> Figure:
    from ruptfx.results.figure_style import new_figure

    figure, axes = new_figure(2, 2, 5.2, sharex=True)
    for column, (result, patch) in enumerate(((usual, PATCH), (large, LARGE_PATCH))):
        x, above, below = -1e3 * result.position, axes[0, column], axes[1, column]
        above.plot(x, 1e6 * result.rupture_time(FAST), "k.", ms=1)
        above.set(title=f"patch of {1e3 * patch:g} mm", ylabel="Rupture time (µs)")
        rows = np.searchsorted(result.time, np.arange(EVERY, result.time[-1], EVERY))
        slips = np.cumsum(np.abs(result.slip_rate), axis=0) * (result.time[2] - result.time[1])
        below.plot(x, 1e6 * slips[rows].T, "k", lw=0.5)
        below.set(xlabel="x as in the paper (mm)", ylabel="Slip every 0.2 µs (µm)", xlim=(-5, 5))
    return figure
