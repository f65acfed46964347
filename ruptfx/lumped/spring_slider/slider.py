"""Equations of motion of a slider on one spring, for one or many sliders at once.

    M dv/dt = K (x_drive - x) - F,    F = strength(V, W, theta),    dtheta/dt as the law says,
    V = d/dt (x - lambda F / W)    where the interface is elastic with stiffness W / lambda

(Baumberger, Berthoud, Caroli 2001, eqs. 6-9). Without mass the force is F = K e / (1 + K lambda / W), e being the
travel of the drive ahead of the irreversible slip. The variables are e and ln theta, with mass also the velocity and
the stretch of the interface; a law gives V from F, so that no equation has to be solved inside a step.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.sparse import identity, kron

from ruptfx import RuptfxError
from ruptfx.laws.friction.rate_and_state_base import RateAndState

RUNAWAY = 1.0  # m/s; a quasi-static slider as fast as this would be held back by its inertia
STUCK = 10_000  # evaluations at one time; SciPy's LSODA in Fortran goes on for ever where rates are infinite
Signal = float | np.ndarray | Callable[[float], Any]


@dataclass(frozen=True)
class Slider:
    """Constants of a slider; stiffness may be an array, for as many sliders.

    Attributes
    ----------
    law : RateAndState
        With uniform parameters; its normal stress is the normal force, its strength the friction force.
    normal_force : float
        W [N].
    stiffness : float or ndarray
        K [N/m].
    mass : float
        M [kg]; 0 is quasi-static.
    interface_length : float
        lambda [m], the interface is a spring of stiffness W / lambda; 0 is rigid.
    """

    law: RateAndState
    normal_force: float
    stiffness: Any
    mass: float = 0.0
    interface_length: float = 0.0

    def with_stiffness(self, stiffness: object) -> Slider:
        return replace(self, stiffness=stiffness)

    @property
    def size(self) -> int:
        """Number of variables: e, ln theta; with mass also v, with mass and interface elasticity also the stretch."""
        return 2 + (self.mass > 0) + (self.mass > 0 and self.interface_length > 0)

    def scales(self, speed: object) -> np.ndarray:
        """Natural sizes of the variables, shape (size,) or (size, sliders)."""
        length, one = float(self.law.D_c), np.ones_like(np.asarray(speed, float))
        rows = [length * one, one, speed * one, length * one]
        return np.array(rows[: self.size])

    def steady(self, speed: Any) -> np.ndarray:
        """Variables in steady sliding at a speed [m/s], shape (size,) or (size, sliders)."""
        force = self.law.steady_strength(speed, self.normal_force)
        stretch = self.interface_length * force / self.normal_force
        age = np.log(self.law.D_c / np.asarray(speed, float))
        # Without mass e counts from the irreversible slip, with mass from the position of the slider.
        if self.size == 2:
            return np.array(np.broadcast_arrays(force / self.stiffness + stretch, age))
        return np.array(np.broadcast_arrays(force / self.stiffness, age, speed, stretch)[: self.size])

    def force(self, y: np.ndarray, normal_force: Any) -> Any:
        """Friction force [N]."""
        if self.size == 2:
            return self.stiffness * y[0] / (1 + self.stiffness * self.interface_length / normal_force)
        if self.size == 3:
            return self.law.strength(y[2], normal_force, {"theta": np.exp(y[1])})
        return normal_force / self.interface_length * y[3]

    def slip_rate(self, y: np.ndarray, normal_force: Any) -> Any:
        """Irreversible sliding rate V [m/s]."""
        if self.size == 3:
            return y[2]
        return self.law.slip_rate(self.force(y, normal_force), normal_force, {"theta": np.exp(y[1])})

    def rates(self, y: np.ndarray, drive: object, normal_force: object) -> np.ndarray:
        """Time derivatives, shape of `y`, at a speed of the drive [m/s] and a normal force [N]."""
        theta, speed = np.exp(y[1]), self.slip_rate(y, normal_force)
        ageing = self.law.age_rate(theta, speed) / theta
        if self.size == 2:
            return np.array((drive - speed, ageing))
        acceleration = (self.stiffness * y[0] - self.force(y, normal_force)) / self.mass
        return np.array((drive - y[2], ageing, acceleration, y[2] - speed)[: self.size])


@dataclass(frozen=True)
class Trajectory:
    """A computed motion: time [s], variables of shape (size, times), friction coefficient F / W_0 and slip rate."""

    time: np.ndarray
    y: np.ndarray
    friction: np.ndarray
    slip_rate: np.ndarray

    @property
    def end(self) -> np.ndarray:
        return self.y[:, -1]


def integrate(
    slider: Slider, start: np.ndarray, times: np.ndarray, drive: Signal, normal_force: Signal | None = None,
    rtol: float = 1e-8, longest_step: float = np.inf,
) -> Trajectory:
    """Return the motion at the given times, by scipy's LSODA or, if that fails, Radau (both stiff, with error control).

    Parameters
    ----------
    slider : Slider
    start : ndarray, shape (size,)
    times : ndarray, shape (n,)
        Increasing [s], the first is that of `start`.
    drive, normal_force : float or callable of time
        Speed of the drive [m/s] and normal force [N].

    Raises
    ------
    RuptfxError
        The motion cannot be followed, mostly a quasi-static slider that runs away.
    """
    load: Signal = slider.normal_force if normal_force is None else normal_force
    speed = drive if callable(drive) else (lambda time: drive)
    weight = load if callable(load) else (lambda time: load)
    scale = slider.scales(max(abs(float(np.asarray(speed(times[0])))), float(slider.law.V_0) * 1e-3))

    same = 4 * np.finfo(float).eps * abs(times[-1])
    there, calls = -np.inf, 0

    def scaled(time: float, z: np.ndarray) -> np.ndarray:
        nonlocal there, calls
        there, calls = (there, calls + 1) if abs(time - there) <= same else (time, 0)
        if calls > STUCK:
            raise RuptfxError(
                f"the slider's motion stops at t = {time:.6g} s: its rates are too large for any step; decrease "
                "stiffness or the drive speeds, or increase friction.D_c"
            )
        return slider.rates(z * scale, speed(time), weight(time)) / scale

    span, first = times[-1] - times[0], times[0]

    def runaway(time: float, z: np.ndarray) -> float:
        return RUNAWAY - abs(float(slider.slip_rate(z * scale, weight(first + time))))

    runaway.terminal = True  # type: ignore[attr-defined]
    for method in ("LSODA", "Radau"):  # where a trial step of the first overflows, the second takes a shorter one
        there, calls = -np.inf, 0
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # what goes wrong is seen, and raised, below
            solution = solve_ivp(
                lambda time, z: scaled(first + time, z), (0.0, span), start / scale, method=method,
                t_eval=np.minimum(times - first, span), rtol=rtol, atol=rtol, max_step=longest_step,
                events=None if slider.mass else runaway,
            )
        if solution.status == 1:
            at = first + float(solution.t_events[0][0])
            raise RuptfxError(
                f"the slider runs away: {RUNAWAY:g} m/s at t = {at:.6g} s without inertia to hold it back; "
                "give it a mass, or a spring stiffer than K_c"
            )
        if solution.success and np.shape(solution.y)[1:] == times.shape and np.isfinite(solution.y).all():
            break
    else:
        reached = first + (solution.t[-1] if len(solution.t) else 0.0)
        remedy = "give the slider a mass or a stiffer spring" if slider.mass == 0 else "change the drive less abruptly"
        raise RuptfxError(f"the slider's motion stops at t = {reached:.6g} s: {solution.message} {remedy}")
    y = solution.y * scale[:, None]
    weights = np.array([weight(t) for t in times])
    return Trajectory(times, y, slider.force(y, weights) / slider.normal_force, slider.slip_rate(y, weights))


def linear_rates(slider: Slider, speed: float) -> np.ndarray:
    """Eigenvalues [1/s] of the motion linearised about steady sliding, by central differences of the rates."""
    y, scale = slider.steady(speed), slider.scales(speed)
    matrix = np.empty((slider.size, slider.size))
    for column in range(slider.size):
        step = np.zeros(slider.size)
        step[column] = 1e-6 * scale[column]
        change = slider.rates(y + step, speed, slider.normal_force) - slider.rates(y - step, speed, slider.normal_force)
        matrix[:, column] = change / (2e-6 * scale)
    return np.linalg.eigvals(matrix)


def critical_stiffness(slider: Slider, speed: float) -> tuple[float, float]:
    """K_c [N/m] below which steady sliding is unstable, and the frequency [rad/s] at onset; 0 and nan if it never is.

    The root of the largest growth rate over stiffness. For the logarithmic laws and a rigid interface it is
    K_c = (W (b - a) / D_c) (1 + M V^2 / (W a D_c)), frequency (V / D_c) sqrt((b - a) / a) (Ruina 1983; Rice and
    Ruina 1983); an elastic interface acts as a spring in series.
    """
    scale = float(slider.normal_force * slider.law.b / slider.law.D_c)

    def growth(log_stiffness: float) -> float:
        return float(linear_rates(slider.with_stiffness(scale * np.exp(log_stiffness)), speed).real.max())

    low, high = np.log(1e-4), np.log(1e2)
    while growth(high) > 0 and high < np.log(1e8):
        high += np.log(10)
    if growth(low) <= 0 or growth(high) >= 0:
        return 0.0, float("nan")
    stiffness = scale * np.exp(brentq(growth, low, high, xtol=1e-12))
    onset = linear_rates(slider.with_stiffness(stiffness), speed)
    return float(stiffness), float(np.abs(onset[np.argmax(onset.real)].imag))


def oscillates(slider: Slider, speeds: np.ndarray, periods: float = 12.0) -> np.ndarray:
    """Return whether small perturbations of steady sliding grow, by integrating all sliders together (BDF, sparse).

    Every slider has its own clock, D_c / V, which slows down where |ln(V / V_drive)| passes 1: an orbit keeps its
    path but a runaway cannot hold up the others.

    Parameters
    ----------
    slider : Slider
        With stiffness of shape (sliders,).
    speeds : ndarray, shape (sliders,)
        Of the drive [m/s].
    periods : float
        Length of the run in periods of the oscillation at onset.
    """
    count, law = len(speeds), slider.law
    scale, start = slider.scales(speeds), slider.steady(speeds)
    clock = law.D_c / speeds
    start[1] += 0.01  # ln theta
    ratio = max(float(law.b / law.a) - 1, 0.05)
    duration = periods * 2 * np.pi / np.sqrt(ratio)

    def scaled(_: float, flat: np.ndarray) -> np.ndarray:
        y = flat.reshape(slider.size, count) * scale
        away = np.log(np.maximum(np.abs(slider.slip_rate(y, slider.normal_force)) / speeds, 1e-30))
        slowing = 1 / (1 + away**16)
        return (slider.rates(y, speeds, slider.normal_force) * clock * slowing / scale).ravel()

    pattern = kron(np.ones((slider.size, slider.size)), identity(count))
    with np.errstate(all="ignore"):
        solution = solve_ivp(
            scaled, (0, duration), (start / scale).ravel(), method="BDF", jac_sparsity=pattern, rtol=1e-5, atol=1e-7,
            t_eval=np.linspace(0, duration, 400),
        )
    if not solution.success:
        raise RuptfxError(
            f"the stability diagram could not be integrated: {solution.message}; narrow its ranges of speeds and "
            "stiffnesses"
        )
    away = np.abs(solution.y.reshape(slider.size, count, -1)[1] - slider.steady(speeds)[1][:, None])
    quarter = away.shape[1] // 4
    grows = away[:, -quarter:].max(axis=1) > away[:, quarter : 2 * quarter].max(axis=1)
    return grows | (away.max(axis=1) > 0.3)  # the second: runaways, which stand still before the end
