"""Friction laws as a step sees them, and the step of contact points in arrays.

`TracedLaw` is the strength of a law at the time of the traction. `project` brings trial tractions to admissible ones
with the formulas of `point_step.py`; time steps do the same in C (`points.c`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from ruptfx import RuptfxError, Table
from ruptfx.input.schema import Part
from ruptfx.interfaces.faults import point_step
from ruptfx.laws.friction import FrictionLaw
from ruptfx.platform.codegen.tracing import Expression, constant, derivative, record, symbol, to_numpy

OVERFLOW = 1e50  # Pa
FOR_EVER = 1e9  # steps, after which the state is that of steady sliding

PartOfCase = TypeVar("PartOfCase", bound=Part)


@dataclass(frozen=True)
class CohesiveStrength:
    """Cohesive strength of the points in a step.

    Attributes
    ----------
    tension, shear : ndarray, shape (n,)
        Largest tension, and shear strength beyond friction [Pa].
    opening : ndarray, shape (n,)
        Largest so far [m].
    compliance : ndarray, shape (n,)
        Opening per trial tension beyond the carried one [m/Pa].
    """

    tension: np.ndarray
    shear: np.ndarray
    opening: np.ndarray
    compliance: np.ndarray

    @property
    def intact(self) -> np.ndarray:
        """Mask of the points that have cohesive strength, shape (n,)."""
        return (self.tension > 0) | (self.shear > 0)

    def normal_stress(self, trial: np.ndarray) -> np.ndarray:
        """Return the admissible normal stress for a trial one, compression positive [Pa]."""
        with np.errstate(all="ignore"):
            return np.asarray(point_step.normal_stress(trial, self.tension, self.opening / self.compliance))


def parameters_as_symbols(part: PartOfCase, prefix: str) -> tuple[Table, PartOfCase]:
    """Replace every number of a part by a symbol; return the numbers and the part.

    Parts that differ in numbers share their code.

    Returns
    -------
    values : dict of str to float or ndarray
        Numbers by the name of the symbol.
    part : Part
        Part of the same type, with symbols for fields.
    """
    values: Table = {}
    changes: Table = {}
    for name in type(part).model_fields:
        value = getattr(part, name)
        if isinstance(value, Part):
            inner, changes[name] = parameters_as_symbols(value, f"{prefix}{name}_")
            values |= inner
        elif isinstance(value, float | int | np.ndarray) and not isinstance(value, bool):
            values[f"{prefix}{name}"] = value
            changes[name] = symbol(f"{prefix}{name}")
        elif isinstance(value, dict):  # numbers by name, as the initial fields of `InFields`
            values |= {f"{prefix}{name}_{key}": number for key, number in value.items()}
            changes[name] = {key: symbol(f"{prefix}{name}_{key}") for key in value}
    return values, part.substituted(changes)


class TracedLaw:
    """A recorded law: its strength at the time of the traction, the exact derivatives and the state there.

    Parameters
    ----------
    law : FrictionLaw
    at_end : bool
        True if the unknown V is the mean slip rate of the step that ends at the time of the traction (compliant
        contact, implicit steps), False if it is that of the step at whose beginning the traction acts (split nodes).
    bonded : bool
        Whether `bond` acts besides friction.

    Notes
    -----
    Split nodes: velocities belong to the middle of steps, so the slip rate at the traction is (V_before + V) / 2, with
    which leapfrog balances energy. At the end of a step it is V + e (V - V_before), e = dt / (dt + dt_before): BDF2 for
    the slip, second order and free of oscillations. Where sliding stops within a step it is not less than V / 2; where
    it begins, or more than doubles, not more than V + e V_before, lest it overshoot.

    What the law adds up, like slip or time, goes from one traction to the next with the mean slip rate between them:
    exact. All other state goes there with the same mean slip rate, hence with the slip that there was, half of the way
    with the normal stress of the traction before and half with the new one. The slip rates at the two tractions are no
    substitute for the mean: where a front arrives they grow several times in a step, and their mean is far above it.
    In steps much longer than its memory the state must be what the slip rate at the traction makes of it. So the
    second half goes with V_mean + f^4 (V_now - V_mean), f being the part that the state forgets in a step of steady
    sliding: the fourth power leaves the error of short steps what it is. This is of second order, and exact at
    constant rates. `advance` being exact, a step never has to be divided, whatever the slip rate.
    """

    def __init__(self, law: FrictionLaw, at_end: bool = False, bonded: bool = False) -> None:
        self.law, self.at_end = law, at_end
        self.state_names = list(law.all_state_fields())
        self.parameters, traced = parameters_as_symbols(law, "p_")
        rate, before = symbol("slip_rate"), symbol("rate_before")  # type: Any, Any
        stress, dt = symbol("normal_stress"), symbol("since")
        if at_end:
            ahead = symbol("extrapolation") * np.minimum(rate - before, before)
            middle, now = rate, np.maximum(rate + ahead, 0.5 * rate)
        else:
            middle, now = symbol("speed_before"), 0.5 * (before + rate)
        advance, strength_of = self._recorded(traced)
        stress_before, speed_before = symbol("normal_stress_before"), symbol("speed_before")
        old = {name: symbol(f"s_{name}") for name in self.state_names}
        known = {name: symbol(f"h_{name}") for name in self.state_names}
        first = known if at_end else old  # at the end of a step the mean slip rate is the unknown
        by_means = advance(first, middle, 0.5 * (stress_before + stress), dt)
        sums = {name for name in first if derivative(by_means[name], first[name]) is constant(1)}
        begun = advance(first, middle, stress_before, 0.5 * dt)
        half_way = {name: (by_means if name in sums else begun)[name] for name in first}
        self.start = {f"h_{name}": value for name, value in (old if at_end else half_way).items()}
        half_way = half_way if at_end else known
        steady = advance(old, speed_before, stress_before, FOR_EVER * dt)
        steady |= {name: old[name] for name in sums}
        later = advance(steady, speed_before, stress_before, dt)
        new = dict(half_way)
        for name in (name for name in old if name not in sums):
            forgotten: Any = np.minimum(np.maximum(1 - derivative(later[name], steady[name]), 0.0), 1.0)
            self.start[f"f_{name}"] = np.square(np.square(forgotten))
            rate_after = middle + symbol(f"f_{name}") * (now - middle)
            new[name] = advance(half_way, rate_after, stress, 0.5 * dt)[name]
        strength: Any = strength_of(now, stress, new) + symbol("radiation") * now
        if bonded:
            strength = strength + symbol("bond")
        self.outputs = {
            "strength": strength,
            "slope": derivative(strength, rate),
            "rate_now": now,
            "rate_slope": derivative(now, rate),
            **{f"n_{name}": new[name] for name in self.state_names},
        }
        self.slopes = {
            "slope": self.outputs["slope"], "stress_slope": derivative(strength, stress),
            "before_slope": derivative(strength, before),
        }  # fmt: skip

    def _recorded(self, law: FrictionLaw) -> tuple[Callable[..., Table], Callable[..., Expression]]:
        """Return `advance` and `strength`, whose errors give the line."""

        def as_state(value: Any) -> dict[str, Expression]:
            if not isinstance(value, Mapping) or set(value) != set(self.state_names):
                shown = f"state {', '.join(value) or 'nothing'}" if isinstance(value, Mapping) else repr(value)
                raise RuptfxError(f"returns {shown}; state_fields declares {', '.join(self.state_names) or 'nothing'}")
            return {name: _traced(value[name]) for name in self.state_names}

        def advance(state: Table, *rest: Any) -> Table:
            return record(law.advance, _Given(state), *rest, as_=as_state)

        def strength(slip_rate: Any, normal_stress: Any, state: Table) -> Expression:
            return record(law.strength, slip_rate, normal_stress, _Given(state), as_=_traced)

        return advance, strength

    def carried(self, extrapolation: float) -> float:
        """Return k: weight of V_before over that of V in the slip rate at the traction."""
        return -extrapolation / (1 + extrapolation) if self.at_end else 1.0

    @cached_property
    def _functions(self) -> tuple[Any, Any]:
        """Functions from the previous state to the known part of the step, and from there to the outputs."""
        items = [*GIVEN, *self.parameters]
        return (
            to_numpy(self.start, [*items, *(f"s_{name}" for name in self.state_names)]),
            to_numpy({**self.outputs, **self.slopes}, [*items, *self.start]),
        )

    def __call__(  # noqa: PLR0913
        self, slip_rate: np.ndarray, normal_stress: np.ndarray, state: Mapping[str, np.ndarray], dt: float,
        *, before: np.ndarray | float = 0.0, speed_before: np.ndarray | float = 0.0,
        extrapolation: float = 0.0, radiation: np.ndarray | float = 0.0,
        bond: np.ndarray | float = 0.0,
    ) -> Evaluated:  # fmt: skip
        """Evaluate at all points.

        Parameters
        ----------
        slip_rate, normal_stress : ndarray, shape (n,)
            V [m/s] and the normal stress at the traction [Pa].
        state : dict of ndarray, shape (n,)
            State at the previous traction; default of its `normal_stress` is the current one.
        dt : float
            Time since then [s].
        before, speed_before : ndarray, shape (n,)
            Mean slip rate of the previous step [m/s]: along V, and its magnitude.
        extrapolation : float
            e above; default is the strength at V itself.
        radiation : ndarray, shape (n,)
            Traction per slip rate [Pa s/m] in addition to the strength.
        bond : ndarray, shape (n,)
            Strength in addition to friction [Pa].
        """

        stress_before = state.get("normal_stress", normal_stress)
        items = (slip_rate, before, speed_before, normal_stress, stress_before, dt, extrapolation, radiation, bond,
                 *self.parameters.values())  # fmt: skip
        begin, finish = self._functions
        with np.errstate(all="ignore"):
            result = finish(*items, *begin(*items, *(state[name] for name in self.state_names)))
        shape = np.shape(slip_rate)
        named = {k: np.broadcast_to(v, shape) for k, v in zip({**self.outputs, **self.slopes}, result, strict=True)}
        new = {name: named.pop(f"n_{name}") for name in self.state_names}
        return Evaluated(**named, state=new)


class StrengthAtState:
    """Strength of a law at a known state, with its exact derivative.

    Parameters
    ----------
    law : FrictionLaw
    """

    def __init__(self, law: FrictionLaw) -> None:
        names = list(law.all_state_fields())
        values, traced = parameters_as_symbols(law, "p_")
        rate, state = symbol("slip_rate"), {name: symbol(f"s_{name}") for name in names}
        strength: Expression = record(traced.strength, rate, symbol("normal_stress"), state, as_=_traced)
        inputs = ["slip_rate", "normal_stress", *values, *(f"s_{name}" for name in names)]
        self._names, self._values = names, list(values.values())
        self._function = to_numpy({"strength": strength, "slope": derivative(strength, rate)}, inputs)

    def __call__(
        self, slip_rate: np.ndarray, normal_stress: np.ndarray, state: Mapping[str, np.ndarray],
        rows: slice | np.ndarray = slice(None),
    ) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
        """Return the strength [Pa] and its derivative with respect to the slip rate [Pa s/m], shapes (n,).

        Rates and stresses are those of the points `rows`, states those of all points.
        """
        values = (value[rows] if np.ndim(value) else value for value in self._values)
        strength, slope = self._function(
            slip_rate, normal_stress, *values, *(state[name][rows] for name in self._names)
        )
        return np.broadcast_to(strength, np.shape(slip_rate)), np.broadcast_to(slope, np.shape(slip_rate))


# Arguments of a traced law besides state and parameters, by name.
GIVEN = (
    "slip_rate", "rate_before", "speed_before", "normal_stress", "normal_stress_before", "since",
    "extrapolation", "radiation", "bond",
)  # fmt: skip


def _traced(value: Any) -> Expression:
    return value if isinstance(value, Expression) else constant(value)


class _Given(Table):
    """State passed to a law; read-only, because changes would affect the previous step."""

    def _refuse(self, *args: Any, **options: Any) -> Any:
        raise RuptfxError("the state that is given must not change: return a new one, {**state, 'name': value}")

    __setitem__ = __delitem__ = __ior__ = update = pop = setdefault = clear = popitem = _refuse


@dataclass(frozen=True)
class Evaluated:
    """Values and derivatives of a law in a step.

    Attributes
    ----------
    strength : ndarray, shape (n,) [Pa]
    slope, stress_slope, before_slope : ndarray, shape (n,)
        Derivatives of the strength with respect to V, the normal stress and V_before.
    rate_now, rate_slope : ndarray, shape (n,)
        Slip rate at the time of the traction [m/s], and its derivative with respect to V.
    state : dict of ndarray, shape (n,)
        At the time of the traction.
    """

    strength: np.ndarray
    slope: np.ndarray
    rate_now: np.ndarray
    rate_slope: np.ndarray
    stress_slope: np.ndarray
    before_slope: np.ndarray
    state: dict[str, np.ndarray]


@dataclass
class Projected:
    """Admissible tractions of the friction law.

    Attributes
    ----------
    normal_stress : ndarray, shape (n,) [Pa]
    shear_traction : ndarray, shape (n, tangents) [Pa]
    mean_slip_rate : ndarray, shape (n, tangents)
        V, of the step [m/s].
    slip_rate : ndarray, shape (n, tangents)
        At the time of the traction [m/s].
    state : dict of ndarray, shape (n,)
        At the time of the traction.
    """

    normal_stress: np.ndarray
    shear_traction: np.ndarray
    mean_slip_rate: np.ndarray
    slip_rate: np.ndarray
    state: dict[str, np.ndarray]


class ProjectionError(RuptfxError):
    """Error of a missing admissible traction: names the law, the point, the time, V, sigma and the state."""


def least_strength(law: TracedLaw, state: Mapping[str, np.ndarray], point: int, values: Mapping[str, float]) -> float:
    """Return the smallest strength at a failed point, at rest and at the slip rate of zero traction [Pa]."""
    pressed = np.full(len(next(iter(state.values()))), max(values["trial_normal_stress"], 0.0))
    free = values["trial_shear_traction"] / max(values["Z"], 1e-300)
    of_law = {name: state[name] for name in law.state_names}
    return min(float(law(np.full_like(pressed, rate), pressed, of_law, 0.0).strength[point]) for rate in (0.0, free))


def explain(
    law: FrictionLaw, point: int, where: str, values: dict[str, float], strength: float = 0.0
) -> ProjectionError:
    """Return the error of a failed interface point; `strength` is the smallest one found there [Pa]."""
    listed = ", ".join(f"{name} = {value:.6g}" for name, value in values.items())
    size = abs(values["trial_shear_traction"]) + abs(values["trial_normal_stress"])
    if not size < OVERFLOW:
        reason = "the trial traction is not a number or overflows (the motion of the bodies does: reduce the time step)"
    elif strength < 0:
        remedy = "correct its parameters or, in a plug-in, its strength (ruptfx check-law tries a law)"
        reason = f"its strength is negative ({strength:.6g} Pa); {remedy}"
    else:
        reason = "no slip rate balances the trial traction (is the step well-posed, Z + dstrength/dV > 0?)"
    return ProjectionError(f"{law.kind()}: {reason}; interface point {point} {where}: {listed}")


def project(  # noqa: PLR0913
    law: TracedLaw,
    state: Mapping[str, np.ndarray],
    trial_normal: np.ndarray,
    trial_shear: np.ndarray,
    impedance: np.ndarray,
    dt: float,
    before: np.ndarray | None = None,
    extrapolation: float = 0.0,
    radiation: np.ndarray | float = 0.0,
    guess: np.ndarray | None = None,
    where: str = "",
    cohesive: CohesiveStrength | None = None,
) -> Projected:
    """Project trial tractions onto those that the law admits.

    Parameters
    ----------
    law : TracedLaw
    state : dict of ndarray, shape (n,)
        State of the law, and normal stress for laws with memory of it, at the previous traction.
    trial_normal, trial_shear : ndarray, shapes (n,) and (n, tangents)
        Trial tractions [Pa]; compression positive.
    impedance : ndarray, shape (n,) or (n, tangents)
        Z [Pa s/m], not negative; zero for a step of zero length, without slip.
    dt : float
        Time since the previous traction [s].
    before : ndarray, shape (n, tangents), optional
        Mean slip rate of the previous step [m/s].
    extrapolation, radiation
        As for `TracedLaw`.
    guess : ndarray, shape (n,), optional
        Initial guess of |V| [m/s].
    where : str
        Text added to the message of an error, for example the time.
    cohesive : CohesiveStrength, optional
        Tensile and shear strength in addition to friction.

    Raises
    ------
    ProjectionError
        If a trial is not finite, or a law has no root.
    """
    sigma = np.maximum(trial_normal, 0.0) if cohesive is None else cohesive.normal_stress(trial_normal)
    together = sigma > 0 if cohesive is None else (sigma > 0) | cohesive.intact
    pressure = sigma if cohesive is None else np.maximum(sigma, 0.0)
    shape = trial_shear.shape
    z = list(np.broadcast_to(impedance if np.ndim(impedance) == 2 else np.asarray(impedance)[..., None], shape).T)
    shear, rates_before = list(trial_shear.T), list(np.zeros(shape).T if before is None else before.T)
    with np.errstate(all="ignore"):
        trial = point_step.shifted_trial(shear, z, rates_before, law.carried(extrapolation))
        known: Table = {
            "before": trial.rate_before, "speed_before": point_step.length(rates_before),
            "extrapolation": extrapolation, "radiation": radiation, "bond": 0.0 if cohesive is None else cohesive.shear,
        }  # fmt: skip

        def resistance(rate: np.ndarray) -> Resistance:
            at = law(rate, pressure, state, dt, **known)
            return at.strength, at.slope, at.rate_now / at.rate_slope

        root = solved(trial, trial_normal, sigma, together, resistance, guess)
    bad = np.flatnonzero(~np.isfinite(root.rate))
    if len(bad):
        i = int(bad[0])
        largest = max(each[i] for each in z)
        values = {"trial_shear_traction": trial.size[i], "trial_normal_stress": trial_normal[i], "Z": largest}
        listed = values | {name: state[name][i] for name in law.state_names}
        raise explain(law.law, i, where, listed, least_strength(law, {"": trial.size, **state}, i, values))
    at_root = law(root.rate, pressure, state, dt, **known)
    result = point_step.sliding(
        trial, shear, rates_before, root.rate, at_root.rate_now, root.direction,
        is_open=~together, is_stuck=(root.rate == 0) & together, at_end=law.at_end,
    )  # fmt: skip
    return Projected(
        normal_stress=sigma,
        shear_traction=np.stack(result.shear_traction, axis=1),
        mean_slip_rate=np.stack(result.mean_slip_rate, axis=1),
        slip_rate=np.stack(result.slip_rate, axis=1),
        state={name: np.array(value) for name, value in at_root.state.items()},
    )


Resistance = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Strength [Pa], its derivative with respect to V [Pa s/m], and the spread of `point_step.next_iterate` [m/s]."""


def solved(
    trial: point_step.ShiftedTrial, trial_normal: np.ndarray, normal_stress: np.ndarray, is_closed: np.ndarray,
    resistance: Callable[[np.ndarray], Resistance], guess: np.ndarray | None = None,
) -> point_step.Iterate:  # fmt: skip
    """Return the last iterate of the slip rate V of all points, not a number without a root.

    Parameters as for `point_step.first_iterate`; the resistance is a function of V.
    """
    with np.errstate(all="ignore"):  # formulas have a value where their result is not used
        at_rest = resistance(np.zeros_like(trial.size))[0]
        iterate = point_step.first_iterate(
            trial, trial_normal, normal_stress, at_rest, 0.0 if guess is None else guess, is_closed
        )
        for iteration in range(point_step.MAX_ITERATIONS):
            if not np.any(iterate.goes_on):
                break
            bisects = iteration % point_step.BISECT_EVERY == point_step.BISECT_EVERY - 1
            iterate = point_step.next_iterate(iterate, trial, normal_stress, *resistance(iterate.rate), bisects)
    return replace(iterate, rate=np.where(iterate.goes_on, np.nan, iterate.rate))
