"""Trial traction -> admissible traction and slip rate: one scalar solve, shared by every law and contact method.

    normal:  sigma = max(trial_n, 0); the rest opens the gap
    shear:   find V >= 0 with |trial_s| - Z V = strength(V, sigma, state seen), the state advanced with V and sigma;
             the traction is parallel to trial_s

Advancing the state inside the solve makes stiff laws stable at the bulk time step; `TracedLaw` says which state is
seen. The root is bracketed by V = 0 and V = |trial_s| / Z and found by Newton steps in V or log V, whichever fits,
with bisection as the way out. The same algorithm exists twice, for arrays here and in `fault.c` for the explicit hot
path; both evaluate the traced law (`TracedLaw`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ruptfx import RuptfxError
from ruptfx.friction import FrictionLaw
from ruptfx.schema import Part
from ruptfx.tracing import Expression, constant, depends, derivative, symbol, to_c, to_numpy

TOLERANCE = 1e-13  # of the trial traction
MAX_ITERATIONS = 100
BISECT_EVERY = 8


def parameters_as_symbols(part: Part, prefix: str) -> tuple[dict[str, Any], Any]:
    """A part with every number replaced by a symbol, and the numbers: parts that differ in numbers share their code.

    Returns
    -------
    values : dict of str to float or ndarray
        By the name of the symbol.
    part : Part
        Of the same type, with symbols for fields.
    """
    values: dict[str, Any] = {}
    changes: dict[str, Any] = {}
    for name in type(part).model_fields:
        value = getattr(part, name)
        if isinstance(value, Part):
            inner, changes[name] = parameters_as_symbols(value, f"{prefix}{name}_")
            values |= inner
        elif isinstance(value, float | int | np.ndarray) and not isinstance(value, bool):
            values[f"{prefix}{name}"] = value
            changes[name] = symbol(f"{prefix}{name}")
    return values, part.substituted(changes)


class TracedLaw:
    """A law recorded once: its strength in a step, the exact derivatives and the new state.

    Parameters
    ----------
    law : FrictionLaw
        With profiles already evaluated at the points (`law.at(position)`).
    at_end : bool
        Whether the traction belongs to the end of the slip that the step adds, or to its beginning.
    explicit : bool
        Whether time has gone on to that of the traction before the step.

    Notes
    -----
    At the end of the slip the strength sees the `new` state: backward Euler. At its beginning it sees `old` +
    (1 - dnew/dold) (`new` - `old`). Slip has dnew/dold = 1 and enters with its value at the time of the traction:
    weakening one step early would make rupture fronts too fast, by an amount of first order in the step. A variable
    that relaxes has dnew/dold = exp(-x) for a step of x relaxation times: short steps, x << 1, see `old` but for terms
    of second order; long ones see `new`, where each step ends at its own steady state and nothing can overshoot.
    `advance` being exact, a step never has to be divided, whatever the slip rate; slip rates keep their sign within a
    step, and the normal stress enters with its mean. The slip rate itself is that of the middle of the step: where the
    strength depends on it, steps are of first order. Clocks, which nothing but time drives, tell the time of
    the traction before explicit steps.
    """

    def __init__(self, law: FrictionLaw, at_end: bool = False, explicit: bool = True) -> None:
        self.law = law
        self.state_names = list(law.all_state_fields())
        self.parameters, traced = parameters_as_symbols(law, "p_")
        self.slip_rate, self.normal_stress, self.dt = map(symbol, ("slip_rate", "normal_stress", "dt"))
        old = {name: symbol(f"s_{name}") for name in self.state_names}
        stress, before = self.normal_stress, symbol("normal_stress_before")
        if explicit:  # the mean while it slips: between the last two or, at the beginning, half a step beyond
            stress = 0.5 * (before + stress) if at_end else np.maximum(1.5 * stress - 0.5 * before, 0.0)
        new = traced.advance(old, self.slip_rate, stress, self.dt)
        seen = dict(new)
        for name, value in old.items():
            if explicit and not depends(new[name], (self.slip_rate, self.normal_stress)):
                seen[name] = value
            elif not at_end:
                relaxed = np.minimum(np.maximum(1 - derivative(new[name], value), 0.0), 1.0)
                seen[name] = value + (new[name] - value) * relaxed
        strength = traced.strength(self.slip_rate, self.normal_stress, seen)
        if not isinstance(strength, Expression):
            strength = constant(strength)
        self.outputs = {
            "strength": strength,
            "slope": derivative(strength, self.slip_rate),
            **{f"n_{name}": new[name] for name in self.state_names},
        }
        self._stress_slope = derivative(strength, self.normal_stress)

    @property
    def inputs(self) -> list[str]:
        given = "slip_rate", "normal_stress", "normal_stress_before", "dt"
        return [*given, *(f"s_{name}" for name in self.state_names), *self.parameters]

    @cached_property
    def _function(self) -> Any:
        return to_numpy({**self.outputs, "stress_slope": self._stress_slope}, self.inputs)

    def code(self) -> str:
        """C statements assigning strength, slope and the new states."""
        return to_c(self.outputs)

    def __call__(
        self,
        slip_rate: np.ndarray,
        normal_stress: np.ndarray,
        state: dict[str, np.ndarray],
        dt: float,
        points: Any = slice(None),
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, dict[str, np.ndarray]]:
        """Strength [Pa] in a step, its derivatives with respect to slip rate [Pa s/m] and normal stress, and the new
        state. `state` may hold the `normal_stress` before the step; without it, it is the same. `points` selects from
        parameters and state when only some points are evaluated."""

        def pick(value: Any) -> Any:
            return value[points] if isinstance(value, np.ndarray) else value

        values = [pick(value) for value in (*(state[name] for name in self.state_names), *self.parameters.values())]
        before = pick(state["normal_stress"]) if "normal_stress" in state else normal_stress
        with np.errstate(all="ignore"):
            strength, slope, *new, stress_slope = self._function(slip_rate, normal_stress, before, dt, *values)
        shape = np.shape(slip_rate)
        states = {name: np.broadcast_to(v, shape) for name, v in zip(self.state_names, new, strict=True)}
        strength, slope, stress_slope = (np.broadcast_to(v, shape) for v in (strength, slope, stress_slope))
        return strength, slope, stress_slope, states


@dataclass
class Projected:
    """What the friction law admits.

    Attributes
    ----------
    normal_stress : ndarray, shape (n,) [Pa]
    shear_traction : ndarray, shape (n, tangents) [Pa]
    slip_rate : ndarray, shape (n, tangents) [m/s]
    state : dict of ndarray, shape (n,)
    tangent : Tangent or None
        Where it was asked for.
    """

    normal_stress: np.ndarray
    shear_traction: np.ndarray
    slip_rate: np.ndarray
    state: dict[str, np.ndarray]
    tangent: Tangent | None = None


@dataclass
class Tangent:
    """Exact derivatives of what is admitted with respect to the trial, the state advanced inside the solve included.

    Attributes
    ----------
    stress : ndarray, shape (n,)
        d normal_stress / d trial_normal: 1 where closed, 0 where open.
    rate_by_shear : ndarray, shape (n, tangents, tangents)
        d slip_rate / d trial_shear [m/s/Pa]; the shear traction changes by 1 - Z times this.
    rate_by_normal : ndarray, shape (n, tangents)
        d slip_rate / d trial_normal [m/s/Pa]: more pressure, more strength, less slip.
    """

    stress: np.ndarray
    rate_by_shear: np.ndarray
    rate_by_normal: np.ndarray


class ProjectionError(RuptfxError):
    """No admissible traction: names the law, the point, the time, V, sigma and the state."""


def explain(law: FrictionLaw, point: int, where: str, values: dict[str, float]) -> ProjectionError:
    """The error for one failing interface point."""
    listed = ", ".join(f"{name} = {value:.6g}" for name, value in values.items())
    if not np.isfinite(values["trial_shear_traction"] + values["trial_normal_stress"]):
        reason = "the trial traction is not a number (the bodies' motion is: reduce the time step)"
    else:
        reason = "no slip rate balances the trial traction (is the step well-posed, Z + dstrength/dV > 0?)"
    return ProjectionError(f"{law.kind()}: {reason}; interface point {point} {where}: {listed}")


def project(
    law: TracedLaw,
    state: dict[str, np.ndarray],
    trial_normal: np.ndarray,
    trial_shear: np.ndarray,
    impedance: np.ndarray,
    dt: float,
    guess: np.ndarray | None = None,
    where: str = "",
    tangent: bool = False,
) -> Projected:
    """Bring trial tractions back to what the law admits.

    Parameters
    ----------
    law : TracedLaw
    state : dict of ndarray, shape (n,)
        State of the law, and normal stress where it matters that it changes, at the beginning of the step.
    trial_normal, trial_shear : ndarray, shapes (n,) and (n, tangents)
        Trial tractions [Pa]; compression positive.
    impedance : ndarray, shape (n,)
        Z > 0 [Pa s/m].
    dt : float
        Time step [s].
    guess : ndarray, shape (n,), optional
        Slip rates to begin with [m/s].
    where : str
        Added to the message of an error, e.g. the time.
    tangent : bool
        Differentiate, too.

    Raises
    ------
    ProjectionError
        A trial that is not finite, or a law without a root.
    """
    sigma = np.maximum(trial_normal, 0.0)
    trial = np.sqrt(np.sum(trial_shear**2, axis=1))
    impedance = np.broadcast_to(impedance, sigma.shape)
    rate = _solve(law, state, sigma, trial, impedance, dt, guess)
    bad = ~np.isfinite(rate)
    if np.any(bad):
        i = int(np.flatnonzero(bad)[0])
        values = {"trial_shear_traction": trial[i], "trial_normal_stress": trial_normal[i], "Z": impedance[i]}
        raise explain(law.law, i, where, values | {name: state[name][i] for name in law.state_names})
    _, slope, stress_slope, new = law(rate, sigma, state, dt)
    with np.errstate(invalid="ignore", divide="ignore"):
        direction = np.where(trial[:, None] > 0, trial_shear / trial[:, None], 0.0)
    return Projected(
        normal_stress=sigma,
        shear_traction=trial_shear - (impedance * rate)[:, None] * direction,
        slip_rate=rate[:, None] * direction,
        state={name: np.array(value) for name, value in new.items()},
        tangent=_tangent(sigma, trial, rate, direction, impedance, slope, stress_slope) if tangent else None,
    )


def _tangent(
    sigma: np.ndarray, trial: np.ndarray, rate: np.ndarray, direction: np.ndarray, impedance: np.ndarray,
    slope: np.ndarray, stress_slope: np.ndarray,
) -> Tangent:  # fmt: skip
    """Derivative of |trial| - Z V = strength(V, sigma), and of the direction, which turns with the trial."""
    closed, sliding = sigma > 0, rate > 0
    with np.errstate(invalid="ignore", divide="ignore"):
        # (Z + dstrength/dV) dV = d|trial| - dstrength/dsigma dsigma; an open interface has no strength
        by_size = np.where(sliding, 1 / (impedance + np.where(closed, slope, 0.0)), 0.0)
        by_normal = np.where(sliding & closed, -by_size * stress_slope, 0.0)
        turning = np.where(sliding, rate / trial, 0.0)
    along = direction[:, :, None] * direction[:, None, :]
    across = np.eye(direction.shape[1]) - along
    return Tangent(
        stress=closed.astype(float),
        rate_by_shear=by_size[:, None, None] * along + turning[:, None, None] * across,
        rate_by_normal=by_normal[:, None] * direction,
    )


def _solve(
    law: TracedLaw,
    state: dict[str, np.ndarray],
    sigma: np.ndarray,
    trial: np.ndarray,
    impedance: np.ndarray,
    dt: float,
    guess: np.ndarray | None,
) -> np.ndarray:
    """Slip rate of every point, shape (n,); not a number where there is none."""
    at_rest, *_ = law(np.zeros_like(trial), sigma, state, dt)
    rate = np.where(np.isfinite(trial) & np.isfinite(at_rest), 0.0, np.nan)
    closed, open_ = sigma > 0, sigma <= 0  # neither, where sigma is not a number
    rate[open_] = (trial / impedance)[open_]  # an open interface carries no shear
    todo = np.flatnonzero(closed & (trial > at_rest))
    low, high = np.zeros(len(todo)), trial[todo] / impedance[todo]
    v = (trial[todo] - at_rest[todo]) / impedance[todo]
    if guess is not None:
        v = np.where((guess[todo] > 0) & (guess[todo] < high), guess[todo], v)
    for iteration in range(MAX_ITERATIONS):
        if len(todo) == 0:
            return rate
        z, t = impedance[todo], trial[todo]
        strength, slope, *_ = law(v, sigma[todo], state, dt, todo)
        residual, slope = t - z * v - strength, z + slope
        low, high = np.where(residual > 0, v, low), np.where(residual > 0, high, v)
        done = (np.abs(residual) <= TOLERANCE * t) | (high - low <= 1e-15 * high)
        rate[todo[done]] = v[done]
        go = ~done & np.isfinite(residual)
        rate[todo[~done & ~go]] = np.nan
        todo, low, high, v = todo[go], low[go], high[go], v[go]
        v = _next(v, low, high, residual[go], slope[go], z[go], iteration % BISECT_EVERY == BISECT_EVERY - 1)
    rate[todo] = np.nan
    return rate


def _next(
    v: np.ndarray, low: np.ndarray, high: np.ndarray, residual: np.ndarray, slope: np.ndarray, z: np.ndarray,
    bisect: bool,
) -> np.ndarray:  # fmt: skip
    """Newton in V where the impedance rules, in log V where the law does; bisection (in log V when the bracket spans
    decades) where that leaves the bracket, and now and then: the two sorts of steps may lead to each other for ever."""
    with np.errstate(all="ignore"):
        linear = v + residual / slope
        logarithmic = v * np.exp(residual / (slope * v))
    step = np.where(slope > 2 * z, logarithmic, linear)
    middle = np.where(low > 1e-3 * high, 0.5 * (low + high), np.sqrt(np.maximum(low, 1e-12 * high) * high))
    return np.where((step > low) & (step < high) & (not bisect), step, middle)
