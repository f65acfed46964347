"""Equations of motion of a slider on one spring, for one or many sliders at once.

    M dv/dt = K (x_drive - x) - F,    F = strength(V, W, theta),    dtheta/dt as the law says,
    V = d/dt (x - lambda F / W)    where the interface is elastic with stiffness W / lambda

(Baumberger, Berthoud, Caroli 2001, eqs. 6-9). Without mass the force is F = K e / (1 + K lambda / W), e being the
travel of the drive ahead of the irreversible slip. The variables are e and ln theta, with mass also F / (a W), or,
where the interface is elastic, the velocity and the stretch of the interface. A law gives V from F, so that no equation
has to be solved inside a step. The velocity itself would not do for a block that sticks: friction of either sign
belongs to velocities that differ by less than any tolerance.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.integrate import LSODA, OdeSolver, Radau, solve_ivp
from scipy.optimize import brentq
from scipy.sparse import identity, kron

from ruptfx import RuptfxError
from ruptfx.laws.friction.rate_and_state_base import RateAndState

RUNAWAY = 1.0  # m/s; a quasi-static slider as fast as this would be held back by its inertia
SHORT = 1e-11  # of the time since the start of a solver; its shortest step is ten spacings, 2e-15
MOST_RENEWALS = 200  # of a solver between two samples; the end of a slip takes a few
STALLED = 20_000  # steps of a solver between two samples; a slip takes a few thousand
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

    def need_mass(self) -> None:
        """Refuse a slider without mass, which has no stick-slip.

        Raises
        ------
        RuptfxError
        """
        if self.mass == 0:
            raise RuptfxError("mass = 0: beyond K_c a quasi-static slider runs away; give mass (normal_force / 9.81)")

    def with_stiffness(self, stiffness: object) -> Slider:
        return replace(self, stiffness=stiffness)

    @property
    def size(self) -> int:
        """Number of variables: e, ln theta; with mass also F / (a W), or v and stretch of an elastic interface."""
        return 2 + (self.mass > 0) + (self.mass > 0 and self.interface_length > 0)

    def scales(self, speed: object) -> np.ndarray:
        """Natural sizes of the variables, shape (size,) or (size, sliders)."""
        length, one = float(self.law.D_c), np.ones_like(np.asarray(speed, float))
        rows = [length * one, one, *([one] if self.size == 3 else [speed * one, length * one])]
        return np.array(rows[: self.size])

    def steady(self, speed: Any) -> np.ndarray:
        """Variables in steady sliding at a speed [m/s], shape (size,) or (size, sliders)."""
        force = self.law.steady_strength(speed, self.normal_force)
        stretch = self.interface_length * force / self.normal_force
        age = np.log(self.law.steady_age(np.asarray(speed, float)))
        # Without mass e counts from the irreversible slip, with mass from the position of the slider.
        if self.size == 2:
            return np.array(np.broadcast_arrays(force / self.stiffness + stretch, age))
        of_mass = [force / (self.law.a * self.normal_force)] if self.size == 3 else [speed, stretch]
        return np.array(np.broadcast_arrays(force / self.stiffness, age, *of_mass))

    def force(self, y: np.ndarray, normal_force: Any) -> Any:
        """Friction force [N]."""
        if self.size == 2:
            return self.stiffness * y[0] / (1 + self.stiffness * self.interface_length / normal_force)
        if self.size == 3:
            return self.law.a * normal_force * y[2]
        return normal_force / self.interface_length * y[3]

    def slip_rate(self, y: np.ndarray, normal_force: Any) -> Any:
        """Irreversible sliding rate V [m/s]."""
        return self.law.slip_rate(self.force(y, normal_force), normal_force, {"theta": np.exp(y[1])})

    def rates(self, y: np.ndarray, drive: object, normal_force: object) -> np.ndarray:
        """Time derivatives, shape of `y`, at a speed of the drive [m/s] and a normal force [N]."""
        theta, speed = np.exp(y[1]), self.slip_rate(y, normal_force)
        ageing = self.law.age_rate(theta, speed) / theta
        if self.size == 2:
            return np.array((drive - speed, ageing))
        acceleration = (self.stiffness * y[0] - self.force(y, normal_force)) / self.mass
        if self.size == 3:  # V = 2 V_0 sinh(F / (a W)) exp(-psi / a), differentiated
            exponent = self.law.psi({"theta": theta}) / self.law.a
            slope = self.law.V_0 * (np.exp(y[2] - exponent) + np.exp(-y[2] - exponent))
            forcing = acceleration + speed * self.law.contact_slope(theta) / self.law.a * ageing
            return np.array((drive - speed, ageing, forcing / slope))
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


def integrate(  # noqa: PLR0913
    slider: Slider,
    start: np.ndarray,
    times: np.ndarray,
    drive: Signal,
    normal_force: Signal | None = None,
    rtol: float = 1e-8,
    longest_step: float = np.inf,
    stop_at: float | None = None,
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
    stop_at : float, optional
        Slip rate [m/s] at which the motion ends; times after it are left out.

    Raises
    ------
    RuptfxError
        The motion cannot be followed, mostly a quasi-static slider that runs away.
    """
    load: Signal = slider.normal_force if normal_force is None else normal_force
    speed = drive if callable(drive) else (lambda time: drive)
    weight = load if callable(load) else (lambda time: load)
    scale = slider.scales(max(abs(float(np.asarray(speed(times[0])))), float(slider.law.V_0) * 1e-3))
    if times[-1] == times[0]:
        raise RuptfxError(f"the slider's motion stops at t = {times[0]:.6g} s: slow the drive down")
    y = np.empty((slider.size, len(times)))
    y[:, 0], done = start, 1
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what goes wrong is seen, and raised, in the steps
        rates = _ScaledRates(slider, scale, speed, weight)
        for begin, solver in _steps(rates, start / scale, times, longest_step, rtol):
            now = begin + solver.t
            rate = abs(float(slider.slip_rate(solver.y * scale, weight(now))))
            if stop_at is not None and rate >= stop_at:
                break
            if slider.mass == 0 and rate > RUNAWAY:
                raise RuptfxError(
                    f"the slider runs away: {RUNAWAY:g} m/s at t = {now:.6g} s without inertia to hold it back; give "
                    "it a mass, or a spring stiffer than K_c"
                )
            reached = len(times) if solver.status == "finished" else int(np.searchsorted(times, now, side="right"))
            if reached > done:
                y[:, done:reached] = solver.dense_output()(times[done:reached] - begin) * scale[:, None]
                done = reached
    times, y = times[:done], y[:, :done]
    weights = np.array([weight(t) for t in times])
    return Trajectory(times, y, slider.force(y, weights) / slider.normal_force, slider.slip_rate(y, weights))


def _steps(
    rates: _ScaledRates, state: np.ndarray, times: np.ndarray, longest_step: float, rtol: float
) -> Iterator[tuple[float, OdeSolver]]:
    """Yield after every step the time from which the solver counts its own [s], and the solver.

    The end of a slip is shorter than the spacing of late times: a solver begins again there, with a time from zero.
    So does one that keeps a step much shorter than its errors need, as LSODA may that starts within a slip.
    """
    begin, methods, renewals, sampled = times[0], [LSODA, Radau], 0, 1
    while True:
        rates.begin_at(begin)
        solver = methods[0](rates, 0.0, state, times[-1] - begin, max_step=longest_step, rtol=rtol, atol=rtol)
        message, passed, stalled = None, 0.0, 0
        while message is None:
            message = solver.step()
            if message is not None or not np.isfinite(solver.y).all():
                message = message or "a rate is not a number."
                break
            passed, state = solver.t, solver.y.copy()
            yield begin, solver
            before, sampled = sampled, int(np.searchsorted(times, begin + passed, side="right"))
            renewals, stalled = (0, 0) if sampled > before else (renewals, stalled + 1)
            if solver.status == "finished" or sampled == len(times):
                return
            if solver.t - solver.t_old < SHORT * solver.t or stalled > STALLED:
                break
        begin, renewals = begin + passed, renewals + 1
        if passed > 0 and renewals < MOST_RENEWALS:
            continue
        if len(methods) == 1:
            quick = "change the drive less abruptly"
            remedy = quick if rates.slider.mass else "give it a mass or a stiffer spring"
            raise RuptfxError(f"the slider's motion stops at t = {begin:.6g} s: {message} {remedy}")
        del methods[0]  # where a trial step of the first overflows, the second takes a shorter one
        renewals = 0


class _ScaledRates:
    """Rates of the scaled variables at a time from `begin` on, which notice that a solver does not get on."""

    def __init__(
        self, slider: Slider, scale: np.ndarray, speed: Callable[[float], Any], weight: Callable[[float], Any]
    ) -> None:
        self.slider, self.scale, self.speed, self.weight = slider, scale, speed, weight
        self.begin_at(0.0)

    def begin_at(self, time: float) -> None:
        """Count the times of a solver from a time on [s]."""
        self.begin, self.last, self.calls = time, -np.inf, 0

    def __call__(self, time: float, z: np.ndarray) -> np.ndarray:
        same = abs(time - self.last) <= 4 * np.finfo(float).eps * abs(time)
        self.last, self.calls = (self.last, self.calls + 1) if same else (time, 0)
        now = self.begin + time
        if self.calls > STUCK:
            raise RuptfxError(
                f"the slider's motion stops at t = {now:.6g} s: its rates are too large for any step; decrease "
                "stiffness or the drive speeds, or increase friction.D_c"
            )
        return self.slider.rates(z * self.scale, self.speed(now), self.weight(now)) / self.scale


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
            scaled,
            (0, duration),
            (start / scale).ravel(),
            method="BDF",
            jac_sparsity=pattern,
            rtol=1e-5,
            atol=1e-7,
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
