"""What users write in a law: recorded as NumPy means it, or refused with file, line, method and remedy."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.messages import facts

from ruptfx import RuptfxError
from ruptfx.interfaces.faults.projection import TracedLaw
from ruptfx.laws.friction.prakash_clifton import PrakashClifton
from ruptfx.platform.codegen.tracing import record, symbol, to_c, to_numpy

LAW = """
import math

import numpy as np
import scipy.special

from ruptfx.laws.friction import FrictionLaw


def helper(x):
    return math.sqrt(x)


class MyLaw(FrictionLaw):
    state_fields = {"theta": "s"}
    mu: float = 0.6
    nothing: float | None = None

    def strength(self, slip_rate, normal_stress, state):
        V, sigma, theta = slip_rate, normal_stress, state["theta"]
        %s
        return f

    def advance(self, state, slip_rate, normal_stress, dt):
        %s
"""
LINE = LAW[: LAW.index("%s")].count("\n") + 1

WORKS = [
    "f = self.mu * sigma; f += theta; f -= 0.1 * V; f *= 2; f /= 3; f **= 2",
    "f = 0.0; f += sigma",
    "f = np.zeros_like(V); f += self.mu * sigma",
    "f = np.full_like(V, 0.3) * sigma + np.ones_like(V)",
    "f = sigma * np.square(theta) + np.reciprocal(1 + V)",
    "f = sigma * (np.log10(1 + V) + np.log2(1 + theta) + np.log1p(V))",
    "f = sigma * (np.arctan(V) + np.arctan2(V, theta) + np.tan(0.1 * V))",
    "f = sigma * np.clip(self.mu - 0.1 * V, 0.2, 0.6)",
    "f = np.where(~(V > 1), sigma, 0.5 * sigma)",
    "f = np.where((V > 1) & (theta < 2) | (sigma == 0), sigma, 0.0)",
    "f = np.where(np.logical_not(V > 1) ^ (theta > 1), sigma, 0.0)",
    "f = sigma * np.heaviside(V - 1, 0.5)",
    "f = sigma * np.hypot(V, 1e-3) * np.cbrt(theta) * np.exp2(-V)",
    "f = sigma * np.select([V < 0.5, V < 1.5], [0.6, 0.5], default=0.4)",
    "f = abs(-sigma) * max(0.1, self.mu) * math.exp(-self.mu)",
    "f = sigma * pow(1 + V, 0.3) + (1 + V) ** -2",
    "f = sum([sigma, theta, V])",
    "f = sigma * (V > 1)",
    "f = sigma * np.float64(0.5) * np.array(0.5)",
    "f = sigma * np.logaddexp(V, 0) / np.maximum(V, 1e-9)",
    "f = sigma * (V // 0.5 + V % 0.5)",
    "f = sigma * np.where(np.isfinite(1 / V), 0.6, 0.0) * np.sign(V)",
    "f = sigma * np.round(3 * V) + np.floor(theta) + np.abs(-V)",
    "f = np.where(V > 1, np.inf, sigma)",
    "f = sigma\n        for k in range(3): f = f + V**k / math.factorial(k)",
    "f = sigma * np.copy(V) * np.degrees(theta) * np.fmin(V, 1.0)",
    "f = self.mu",
    "f = np.polynomial.polynomial.polyval(0.5, [1.0, 2.0]) * sigma",
]

REFUSED = {
    "f = sigma if V > 1 else 0.0": "must not branch on a value: use numpy.where instead of if",
    "f = max(sigma, 0.0)": "must not branch on a value: use numpy.where",
    "f = sigma * (0 < V < 1)": "a chain a < x < b",
    "f = sigma * (V > 1 and theta > 0)": "must not branch",
    "f = sigma * (not V > 1)": "must not branch",
    "f = V\n        while f > 1: f = f - 1": "must not branch",
    "f = math.exp(-V) * sigma": "a number is needed here, .* use numpy's functions instead of those of math",
    "f = float(V)": "use numpy's functions",
    "f = int(V)": "use numpy's functions",
    "f = round(V, 2)": "use numpy's functions",
    "f = math.floor(V)": "use numpy's functions",
    "f = sigma * f'{V:.3f}'": "a number is needed here",
    "f = list(range(10))[V]": "a number is needed here",
    "f = helper(V)": "a number is needed here",
    "f = V[0]": "cannot pick points: use numpy.where",
    "f = np.zeros_like(V); f[V > 1] = 0.5": "cannot pick points",
    "f = V[V > 1]": "cannot pick points",
    "f = len(V)": "cannot pick points",
    "f = [x for x in V]": "cannot pick points",
    "f = np.array([V, theta]).max()": "no array: leave out numpy.array",
    "f = np.asarray(V) * sigma": "no array: leave out numpy.array",
    "f = V.mean()": "has no 'mean'",
    "f = np.zeros(V.shape)": "has no 'shape'",
    "f = np.mean(V)": r"numpy\.mean cannot be traced",
    "f = np.interp(V, [0, 1], [0.6, 0.5])": r"numpy\.interp cannot be traced",
    "f = np.where(V > 1)": "give both values",
    "f = np.divide(sigma, V, out=np.zeros_like(V), where=V > 0)": r"numpy\.divide with out, where= .* use numpy\.where",
    "f = np.zeros(3); f += V": "write x = x . y instead",
    "f = np.add.reduce(V)": r"numpy\.add\.reduce cannot be traced",
    "f = sigma * scipy.special.erf(V)": "erf cannot be traced; known functions: .*exp",
    "f = (V > 1) + (V > 2)": "numpy.add of conditions",
    "f = sigma * np.array([1.0, 2.0])": r"an array of shape \(2,\) is no number",
    "f = sigma * self.nothing": "None is no number",
    "f = sigma * state['tehta']": "there is no state variable 'tehta'",
    "f = sigma * 1j": "1j is no number",
    "f = sigma * self.mu_d": "has no attribute 'mu_d'",
    "f = sigma * mu": "NameError: name 'mu' is not defined",
    "f = V @ sigma": "matmul cannot be traced",
}


def my_law(folder: Path, body: str, advance: str = "return {'theta': state['theta'] + dt}") -> Any:
    path = folder / "my_law.py"
    path.write_text(LAW % (body, advance))
    spec = importlib.util.spec_from_file_location("my_law", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.MyLaw()


def recorded(law: Any) -> Any:
    return record(law.strength, symbol("V"), symbol("sigma"), {"theta": symbol("theta")})


@pytest.mark.parametrize("body", WORKS)
def test_recorded_as_numpy_means_it(body: str, tmp_path: Path) -> None:
    law = my_law(tmp_path, body)
    V, sigma, theta = np.array([0.3, 1.2, 2.4]), np.array([1.0, 2.0, 0.0]), np.array([0.7, 1.9, 3.0])
    expected = law.strength(V.copy(), sigma.copy(), {"theta": theta.copy()})
    outputs = {"f": 1 * recorded(law) if body != "f = self.mu" else symbol("V") * 0 + recorded(law)}
    found = to_numpy(outputs, ["V", "sigma", "theta"])(V, sigma, theta)[0]
    np.testing.assert_allclose(np.broadcast_to(found, 3), np.broadcast_to(expected, 3), rtol=1e-14)
    assert "f = " in to_c(outputs)


@pytest.mark.parametrize("body", REFUSED)
def test_refused_with_place_and_remedy(body: str, tmp_path: Path) -> None:
    law = my_law(tmp_path, body)
    line = LINE + body.count("\n")
    for tried in (law, PrakashClifton(law=law, L_p=1e-5, D=1.0, theta_p_ratio=0.1)):
        with pytest.raises(RuptfxError, match=REFUSED[body]) as caught:
            if tried is law:
                recorded(law)
            else:  # the held law's line is named, not the wrapper's
                state = {name: symbol(name) for name in tried.all_state_fields()}
                record(tried.strength, symbol("V"), symbol("sigma"), state)
        assert str(caught.value).startswith(f"my_law.py, line {line}, strength: ")
        assert type(caught.value) is RuptfxError


def test_a_method_that_cannot_be_called_is_named(tmp_path: Path) -> None:
    law = my_law(tmp_path, "f = sigma")
    with pytest.raises(
        RuptfxError, match=facts(r"my_law\.py, line \d+, strength: TypeError: .* 2 required positional")
    ):
        record(law.strength, symbol("V"))


ADVANCES = {
    "state['theta'] += dt; return state": r"the state that is given must not change: return a new one",
    "state.update(theta=dt); return state": r"the state that is given must not change",
    "pass": "returns None; state_fields declares theta",
    "return {'theta': None}": "None is no number",
    "return {'tehta': state['theta']}": "returns state tehta; state_fields declares theta",
    "return {**state, 'slip_so_far': dt}": "returns state theta, slip_so_far; state_fields declares theta",
    "return {'theta': state['theta'] if dt > 1 else dt}": "must not branch",
}


@pytest.mark.parametrize("body", ADVANCES)
@pytest.mark.parametrize("at_end", [False, True])
def test_states_that_are_refused(body: str, at_end: bool, tmp_path: Path) -> None:
    law = my_law(tmp_path, "f = sigma", advance=body)
    with pytest.raises(RuptfxError, match=r"^my_law\.py, line \d+, advance: .*" + ADVANCES[body]):
        TracedLaw(law, at_end)


def test_a_strength_that_is_nothing(tmp_path: Path) -> None:
    with pytest.raises(RuptfxError, match=facts(r"^my_law\.py, line \d+, strength: None is no number")):
        TracedLaw(my_law(tmp_path, "f = None"))


def test_new_states_from_the_old_one(tmp_path: Path) -> None:
    for body in ("return {**state, 'theta': state['theta'] + 2 * dt}",
                 "new = state.copy(); new['theta'] = state['theta'] + 2 * dt; return new",
                 "new = dict(state); new['theta'] += 2 * dt; return new"):  # fmt: skip
        law = my_law(tmp_path, "f = theta", advance=body)
        one = np.ones(1)
        assert TracedLaw(law, at_end=True)(one, one, {"theta": one}, 0.25).state["theta"] == 1.5
