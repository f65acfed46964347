"""Contract of a friction law as checks, for the contract tests and `ruptfx check-law`.

A check takes an example law and a seed. It raises `Broken` with values and position, or returns why it does not apply
to this law, or None.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from typing import Any

import numpy as np
import tomli_w
from numpy.typing import ArrayLike
from pydantic import TypeAdapter

from ruptfx import RuptfxError, Table
from ruptfx.input.schema import unit_of
from ruptfx.interfaces.faults.projection import TracedLaw, project
from ruptfx.laws.friction import COMMON, AnyFriction, FrictionLaw

N = 400
Check = Callable[[FrictionLaw, int], str | None]


class Broken(RuptfxError):  # noqa: N818
    """A law violates its contract; the message gives values and position."""


def require(holds: ArrayLike, what: str, **where: Any) -> None:
    """Raise an error with the values at the first point where the condition is false."""
    holds = np.asarray(holds)
    if not np.all(holds):
        i = int(np.argmin(holds.ravel()))
        values = ((name, np.broadcast_to(value, holds.shape).ravel()[i]) for name, value in where.items())
        shown = ", ".join(f"{name.replace('_', ' ')} = {value:.6g}" for name, value in values)
        raise Broken(f"{what}{f' at {shown}' if shown else ''}")


def close(value: object, expected: object, tolerance: float, what: str, **where: object) -> None:
    """Raise an error where two values differ by more than a tolerance relative to the expected one."""
    value, expected = np.broadcast_arrays(np.asarray(value, float), np.asarray(expected, float))
    near = np.abs(value - expected) <= tolerance * np.abs(expected)
    with np.errstate(divide="ignore", invalid="ignore"):
        apart = np.abs(value - expected) / np.abs(expected)
    require(near | (value == expected), what, found=value, apart=apart, **where)


def histories(law: FrictionLaw, seed: int, steps: int = 6) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Return slip rates, normal stresses and possible states of the law, after a few random steps."""
    random = np.random.default_rng(seed)
    rate = 10 ** random.uniform(-9, 3, N)
    sigma = 10 ** random.uniform(4, 8.5, N)
    state = law.initial_state(sigma, 0.3 * sigma, rate)
    for _ in range(steps):
        v, s = 10 ** random.uniform(-12, 3, N), 10 ** random.uniform(4, 8.5, N)
        state = law.advance(state, v, s, 10 ** random.uniform(-9, -4, N))
    return rate, sigma, {name: np.broadcast_to(value, N).astype(float) for name, value in state.items()}


def _sliding(law: FrictionLaw, seed: int) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Return slip rates with a significant change within a step, so that differences exceed round-off."""
    random = np.random.default_rng(seed)
    v, sigma = 10 ** random.uniform(-1, 1, N), 10 ** random.uniform(5, 7, N)
    state = law.advance(law.initial_state(sigma, 0.3 * sigma, v), 0.1 * v, 2 * sigma, 1e-5)
    return v, sigma, {name: value + np.zeros(N) for name, value in state.items()}


def missing(cls: type[FrictionLaw]) -> list[str]:
    """Return the names of missing attributes of a class."""
    items = [name for name in ("formula", "source") if not getattr(cls, name)]
    items += ["a docstring"] * (not cls.summary())
    items += [f"the unit of state variable {name}" for name, unit in cls.state_fields.items() if not unit]
    items += [f"a name of its own for state variable {name}" for name in cls.state_fields if name in cls.model_fields]
    lengths = [name for name in cls.model_fields if name.startswith(("D_", "L_", "V_")) and unit_of(cls, name) == "1"]
    return items + [f"the unit of {name}, for example VaryingLength" for name in lengths]


def toml(law: FrictionLaw, seed: int) -> None:
    """Check that a law is unchanged after it is written to a case and read again."""
    written = tomli_w.dumps({"friction": law.model_dump(mode="json", exclude_none=True)})
    again = TypeAdapter(AnyFriction).validate_python(tomllib.loads(written)["friction"])
    require(again == law, "a case with this law reads differently than it was written")


def declared_state(law: FrictionLaw, seed: int) -> None:
    """Check that `initial_state` and `advance` return the declared fields, finite, and change no array."""
    sigma, rate = np.array([1e6, 0.0, 3e6]), np.ones(3)
    names = ", ".join(law.all_state_fields()) or "nothing"
    state = law.initial_state(sigma, 0.4 * sigma, np.zeros(3))
    kept = {name: np.array(value) for name, value in state.items()}
    for method, result in (("initial_state", state), ("advance", law.advance(dict(state), rate, sigma, 1e-6))):
        same = set(result) == set(law.all_state_fields())
        require(same, f"{method} returns {', '.join(result) or 'nothing'}; state_fields declares {names}")
        for name, value in result.items():
            scalar = method == "advance" and np.shape(value) == ()
            require(scalar or np.shape(value) == (3,), f"{method}: {name} has shape {np.shape(value)} for 3 points")
            require(np.isfinite(value), f"{method}: {name} is not finite", normal_stress=sigma)
    for name, value in kept.items():
        require(np.array_equal(state[name], value), f"advance changes the array {name} that it is given (+= ?)")


def common_state(law: FrictionLaw, seed: int) -> str | None:
    """Check that state variables used by several laws have the same meaning in each."""
    sigma, rate = np.array([1e6, 0.0, 3e6]), np.ones(3)
    state = law.initial_state(sigma, 0.4 * sigma, 0 * rate)
    later, other = (law.advance(state, v, s, 0.25) for v, s in ((rate, sigma), (2 * rate, 3 * sigma)))
    for name in sorted(COMMON & state.keys()):
        require(later[name] == other[name], f"{name} depends on slip rate or normal stress")
    if "clock" in state:
        require((state["clock"] == 0) & (later["clock"] == 0.25), "clock is not the time since the start")
    if "coefficient_at_start" in state:
        require(later["coefficient_at_start"] == state["coefficient_at_start"], "coefficient_at_start changes")
    return None if COMMON & state.keys() else "no state that other laws share"


def strength(law: FrictionLaw, seed: int) -> None:
    """Check that strength and state are finite and strength is not negative: anywhere, at rest, open, after a step."""
    rate, sigma, state = histories(law, seed)
    for v in (rate, 0 * rate):
        for s in (sigma, 0 * sigma):
            for dt in (0.0, 1e-12, 1e-7, 1.0, 1e12):
                where = {"slip_rate": v, "normal_stress": s, "dt": dt}
                new = law.advance(state, v, s, dt)
                for name, value in new.items():
                    require(np.isfinite(value + 0 * v), f"{name} is not finite", **where)
                result = law.strength(v, s, new) + 0 * v
                require(np.isfinite(result), "strength is not finite", **where)
                require(result >= 0, "strength is negative", strength=result, **where)


def traced(law: FrictionLaw, seed: int) -> None:
    """Compare the traced formulas with the methods, and their derivatives with finite differences."""
    rate, sigma, state = histories(law, seed)
    dt, where = 1e-7, {"slip_rate": rate, "normal_stress": sigma}
    result = TracedLaw(law, at_end=True)(rate, sigma, state, dt, speed_before=rate)
    after = law.advance(state, rate, sigma, dt)
    close(result.strength, law.strength(rate, sigma, after) + 0 * rate, 1e-12, "traced strength differs", **where)
    for name, value in after.items():
        close(result.state[name], value, 1e-12, f"traced {name} differs", **where)
    # Central differences of step h: error h^2 from the third derivative, 1e-16 / h from rounding; h = 1e-5.
    h, at = 1e-5, state | {"normal_stress": 0.9 * sigma}
    last = rate * np.random.default_rng(seed).uniform(0.3, 1.6, len(rate))  # no kink of the extrapolation within h
    known: Table = {"speed_before": last, "extrapolation": 0.5, "radiation": 1e3}
    for at_end in (True, False):
        of_law = TracedLaw(law, at_end)

        def value(factors: np.ndarray, of_law: TracedLaw = of_law) -> np.ndarray:
            v, s, b = factors
            return of_law(v * rate, s * sigma, at, dt, before=b * last, **known).strength

        moment = of_law(rate, sigma, at, dt, before=last, **known)
        for slope, size, name, step in zip(
            (moment.slope, moment.stress_slope, moment.before_slope), (rate, sigma, last),
            ("slip rate", "normal stress", "slip rate before"), h * np.eye(3), strict=True,
        ):  # fmt: skip
            expected = (value(1 + step) - value(1 - step)) / (2 * h)
            near = np.abs(slope * size - expected) <= 1e-8 * np.abs(moment.strength)
            require(near, f"derivative by {name} differs", found=slope, differences=expected / size, **where)


def state_at_the_traction(law: FrictionLaw, seed: int) -> str | None:
    """Check that a step at constant slip rate and stress is exact.

    In steps much longer than the times of the law, the state follows from the slip rate at the time of the traction,
    independent of the previous rate, if the law has a fading memory.
    """
    if not law.all_state_fields():
        return "no state"
    v, sigma, state = _sliding(law, seed)
    constant: Table = {"before": v, "speed_before": v, "extrapolation": 0.5}
    for at_end in (True, False):
        for dt in (1e-9, 1e-6, 1e-3):
            expected = law.advance(state, v, sigma, dt)
            for name, value in TracedLaw(law, at_end)(v, sigma, state, dt, **constant).state.items():
                close(value, expected[name], 1e-9, f"{name} after a step", dt=dt, slip_rate=v)
    # Clocks and cumulative slip have no fading memory.
    end, other = (law.advance({n: f * x for n, x in state.items()}, v, sigma, 1e3) for f in (1.0, 1.5))
    if all(np.all(np.abs(other[name] - end[name]) < 1e-3 * np.abs(state[name])) for name in end):
        for at_end in (True, False):
            # (V_before + V) / 2 or V + (V - V_before) / 2 with V_before = V / 2
            now = (1.25 if at_end else 0.75) * v
            half: Table = {"before": 0.5 * v, "speed_before": 0.5 * v, "extrapolation": 0.5}
            result = TracedLaw(law, at_end)(v, sigma, state | {"normal_stress": 2 * sigma}, 2e3, **half)
            close(result.rate_now, now, 1e-12, "slip rate at the traction")
            after = law.strength(now, sigma, law.advance(state, now, sigma, 1e3))  # half of the step
            close(result.strength, after, 1e-9, "strength after a long step", slip_rate=now)
    return None


def one_step_is_many(law: FrictionLaw, seed: int) -> str | None:
    """Check that one step equals many at any length, and that the change over a short one is O(dt)."""
    if not law.all_state_fields():
        return "no state"
    v, sigma, state = _sliding(law, seed)
    for dt in 10.0 ** np.arange(-9, 3):
        one, many = law.advance(state, v, sigma, dt), state
        for _ in range(5):
            many = law.advance(many, v, sigma, dt / 5)
        for name in law.all_state_fields():
            close(many[name], one[name], 1e-9, f"advance is not exact: {name} in 5 steps and one", dt=dt, slip_rate=v)
    for name in law.all_state_fields():
        rounding = 1e-11 * np.abs(state[name])
        change = [law.advance(state, v, sigma, dt)[name] - state[name] for dt in (2e-9, 1e-9)]
        near = np.abs(change[0] - 2 * change[1]) <= rounding + 0.01 * np.abs(change[0])
        require(near, f"the change of {name} in a short step is not in proportion to dt", slip_rate=v)
    return None


def steady(law: FrictionLaw, seed: int) -> str | None:
    """Check that long sliding ends at the steady strength."""
    rate, sigma, state = histories(law, seed)
    try:
        expected = law.steady_strength(rate, sigma)
    except NotImplementedError:
        return "no steady_strength"
    for _ in range(3):  # a slip of 1e9 m in each step, against lengths below 1 mm
        state = law.advance(state, rate, sigma, 1e9 / rate)
    close(law.strength(rate, sigma, state), expected + 0 * rate, 1e-6, "strength after long sliding", slip_rate=rate)
    return None


def dissipation(law: FrictionLaw, seed: int) -> None:
    """Check that friction dissipates energy, and that an open interface has no strength."""
    _, sigma, state = histories(law, seed)
    random = np.random.default_rng(seed)
    trial = random.normal(size=(N, 2)) * sigma[:, None]
    sigma = sigma * np.where(random.random(N) < 0.2, -1, 1)
    z, before = 10 ** random.uniform(5, 8, N), random.normal(size=(N, 2))
    size = np.linalg.norm(trial, axis=1)
    for at_end in (True, False):
        done = project(TracedLaw(law, at_end), state, sigma, trial, z, 1e-8, before)
        power = np.sum(done.shear_traction * done.slip_rate, axis=1)
        carried = np.linalg.norm(done.shear_traction, axis=1)
        # Stuck points have slipped until half a step before the traction, possibly in the other direction.
        slides = np.any(done.mean_slip_rate != 0, axis=1)
        require(slides.mean() > 0.1, f"only {slides.mean():.0%} of the points slide under tractions about sigma")
        require(~slides | (power >= -1e-12 * size), "friction gives energy", power=power, normal_stress=sigma)
        require((sigma >= 0) | (carried == 0), "an open interface carries shear", traction=carried)


CHECKS: dict[str, Check] = {
    "case file": toml,
    "declared state": declared_state,
    "shared state": common_state,
    "strength >= 0": strength,
    "traced derivatives": traced,
    "step at constant slip rate": state_at_the_traction,
    "steps of any length": one_step_is_many,
    "steady strength": steady,
    "dissipation": dissipation,
}
