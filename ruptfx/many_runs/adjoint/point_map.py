"""Derivatives of the explicit step at the points of an interface, compiled from the traced contact method and law.

A step maps the jumps of the bodies, the fields of the previous traction, initial tractions and parameters of the law to
the change of the tractions and the new fields (`faults/points.c`). The slip rate V is the solution of a scalar equation
G(V, inputs) = 0, so that dV = -(dG/dinputs) dinputs / (dG/dV); V is known here, from the run. Stuck points have V = 0,
open ones the slip rate of zero traction. From one graph come three C functions:

    value   outputs of the inputs, which equal those of the step
    push    changes of the outputs = derivative times changes of the inputs (tangent-linear, forward mode)
    pull    factors of the inputs = transposed derivative times factors of the outputs (adjoint, reverse mode)
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ruptfx.interfaces.faults import point_step
from ruptfx.interfaces.faults.fault import Fault
from ruptfx.interfaces.faults.points import Clock
from ruptfx.interfaces.faults.projection import TracedLaw, parameters_as_symbols
from ruptfx.laws.contact import Point, Trial
from ruptfx.platform.codegen import native
from ruptfx.platform.codegen.native import address
from ruptfx.platform.codegen.tracing import (
    Expression,
    constant,
    derivative,
    directional,
    record,
    substituted,
    symbol,
    to_c,
    transposed,
)

Floats = NDArray[np.float64]
NUMBERS = ("dt", "since", "extrapolation", "carried")
"""Numbers of a step, the same at all points."""


class PointMap:
    """The step at the points of one fault as a function, with its derivatives.

    Parameters
    ----------
    normal_impedance : ndarray, shape (n,)
    shear_impedance : ndarray, shape (n, tangents)
        Impedances [Pa s/m] by number of the step: 0, 1, all others.

    Attributes
    ----------
    inputs, outputs : list of str
        Rows of the arrays of `pull` and `push`. The first `local` outputs are the change of the traction, the
        next ones the fields that steps read again, in the order of `memory`.
    memory : list of str
        Fields of the previous traction among the inputs.
    history : list of str
        Inputs that change from step to step: jumps, rates and `memory`.
    parameters : dict of str to ndarray, shape (n,)
        Initial tractions, parameters of the law, numbers of the contact method, and parameters of the pore pressure.
        The last ones act through the rates of the fields, which are in `memory`, and not within a step.
    """

    def __init__(self, fault: Fault, normal_impedance: Sequence[Floats], shear_impedance: Sequence[Floats]) -> None:
        law, face = fault.traced_law(), fault.interface
        self.fault, self._n = fault, len(face.weight)
        t = range(face.tangents)
        self.local = face.frame.shape[1]
        self.memory = [
            *(f"slip_{k}" for k in t), *(f"mean_slip_rate_{k}" for k in t), "normal_stress",
            *(f"s_{name}" for name in law.state_names),
        ]  # fmt: skip
        self.history = [f"{kind}_{k}" for kind in ("jump", "rate") for k in range(self.local)] + self.memory
        self.parameters = {"normal_stress_0": fault.normal_stress_0}
        self.parameters |= {f"shear_traction_0_{k}": fault.shear_traction_0[:, k] for k in t}
        self.parameters |= {
            name: np.broadcast_to(np.asarray(value, float), self._n) for name, value in law.parameters.items()
        }
        of_contact, contact = parameters_as_symbols(fault.contact, "c_")
        self.parameters |= {
            name: np.broadcast_to(np.asarray(value, float), self._n) for name, value in of_contact.items()
        }
        self.parameters |= fault.fields.parameters
        self.inputs = [*self.history, *self.parameters]
        self._known: dict[str, list[Floats]] = {"gap": [np.zeros(self._n) if fault.gap is None else fault.gap] * 3}
        self._known["normal_impedance"] = list(normal_impedance)
        self._known |= {f"shear_impedance_{k}": [each[:, k] for each in shear_impedance] for k in t}
        self._known = {
            name: [np.ascontiguousarray(each, float) for each in values] for name, values in self._known.items()
        }
        self._found = [*(f"found_{k}" for k in t), "stuck", "opened"]
        step = _Step(fault, law, contact)
        self.outputs = list(step.outputs)
        self._step, self._impedances = step, ["normal_impedance", *(f"shear_impedance_{k}" for k in t)]
        self._library = self._compile(step)

    # -- code ---------------------------------------------------------------------------------------------------

    def _compile(self, step: _Step) -> ctypes.CDLL:
        inputs = [symbol(name) for name in self.inputs]
        outputs = list(step.outputs.values())
        by_v = derivative(step.balance, step.v)
        # Factors of the outputs, and with them that of V, of the equation of V and of the free slip rate.
        factors = [symbol(f"factor_{i}") for i in range(len(outputs))]
        of_v: Any = transposed(_sums(outputs, factors), [step.v])[0]
        seeds = _sums(
            [*outputs, step.balance, step.free],
            [*factors, np.where(step.slides > 0, -of_v / by_v, 0.0), np.where(symbol("opened") > 0, of_v, 0.0)],
        )
        pulled = transposed(seeds, inputs)
        known = [*self.inputs, *self._found, *self._known]
        functions = {
            "value": (outputs, []), "push": self._pushed(step, self.inputs),
            "pull": (pulled, [f"factor_{i}" for i in range(len(outputs))]),
        }  # fmt: skip
        return native.load(
            "point_map", "#include <math.h>\n" + "\n".join(
                _function(name, [*known, *more], substituted(result, {step.v: step.v_found}))
                for name, (result, more) in functions.items()
            )
        )  # fmt: skip

    def _pushed(self, step: _Step, inputs: Sequence[str]) -> tuple[list[Expression], list[str]]:
        """Return the changes of the outputs from those of some inputs, and the names of these changes."""
        names = [f"change_{i}" for i in range(len(inputs))]
        changes = {symbol(each): symbol(name) for each, name in zip(inputs, names, strict=True)}
        by_v = derivative(step.balance, step.v)
        of_balance, of_free = directional([step.balance, step.free], changes, guarded=True)
        of_v: Any = np.where(step.slides > 0, -of_balance / by_v, np.where(symbol("opened") > 0, of_free, 0.0))
        return directional(list(step.outputs.values()), {**changes, step.v: of_v}, guarded=True), names

    @cached_property
    def _library_of_impedances(self) -> ctypes.CDLL:
        """The function `push` with the impedances among the inputs; few need it, and it takes time to compile."""
        pushed, names = self._pushed(self._step, [*self.inputs, *self._impedances])
        result = substituted(pushed, {self._step.v: self._step.v_found})
        code = _function("push", [*self.inputs, *self._found, *self._known, *names], result)
        return native.load("point_map_impedances", "#include <math.h>\n" + code)

    # -- products -------------------------------------------------------------------------------------------------

    def value(self, clock: int, numbers: Clock, history: Floats, parameters: Floats, values: Floats) -> Floats:
        """Return the outputs of a step, shape (outputs, n).

        Parameters
        ----------
        clock : int
            Number of the step: 0, 1, and 2 for all others.
        numbers : Clock
            Its times.
        history, parameters : ndarray, shapes (history, n) and (parameters, n)
        values : ndarray, shape (tangents + 2, n)
            Mean slip rate of the step [m/s], 1 where points are stuck, 1 where they are open.
        """
        return self._call("value", clock, numbers, [history, parameters, values], len(self.outputs))

    def push(
        self, clock: int, numbers: Clock, history: Floats, parameters: Floats, values: Floats, changes: Floats
    ) -> Floats:
        """Return the changes of the outputs from those of the inputs, shape (inputs, n); other arguments as `value`.

        After the inputs there may be changes of the normal impedance and of the shear impedances.
        """
        blocks = [history, parameters, values]
        library = self._library if len(changes) == len(self.inputs) else self._library_of_impedances
        return self._call("push", clock, numbers, blocks, len(self.outputs), changes, library)

    def pull(
        self, clock: int, numbers: Clock, history: Floats, parameters: Floats, values: Floats, factors: Floats
    ) -> Floats:
        """Return the factors of the inputs from those of the outputs, shape (outputs, n); the rest as `value`."""
        return self._call("pull", clock, numbers, [history, parameters, values], len(self.inputs), factors)

    def found(self, history: Floats, after: Floats, clock: Clock) -> Floats:
        """Return slip rate and branch of a step from the histories of this step and the next one."""
        t, first = self.fault.tangents, 2 * self.local
        rate, sigma = after[first + t : first + 2 * t], after[first + 2 * t]
        opened = ~(sigma > 0)
        stuck = ~opened & ((rate == 0).all(axis=0) | (self.fault.contact.traction_ends_slip and clock.since == 0))
        return np.concatenate([rate, stuck[None].astype(float), opened[None].astype(float)])

    def _call(
        self, name: str, clock: int, times: Clock, blocks: list[Floats], count: int, seeds: Floats | None = None,
        library: ctypes.CDLL | None = None,
    ) -> Floats:  # fmt: skip
        out = np.empty((count, self._n))
        numbers = np.array([times.dt, times.since, times.extrapolation, self._carried(times)])
        rows = [np.ascontiguousarray(each) for each in [*blocks, *([] if seeds is None else [seeds])]]
        known = [values[clock] for values in self._known.values()]
        arrays = [_rows(each) for each in rows]
        pointers = np.concatenate([
            *arrays[:3], np.array([each.ctypes.data for each in known], np.uintp), *arrays[3:],
        ])  # fmt: skip
        results = _rows(out)
        getattr(library or self._library, name)(ctypes.c_long(self._n), *map(address, (numbers, pointers, results)))
        return out

    def _carried(self, times: Clock) -> float:
        e = times.extrapolation
        return -e / (1 + e) if self.fault.contact.traction_ends_slip else 1.0


class _Step:
    """The graph of a step with V as a symbol.

    Attributes
    ----------
    outputs : dict of str to Expression
    v, v_found : Expression
        Symbol of V, and its value from the mean slip rate of the step.
    balance : Expression
        G(V, inputs), zero where the point slides.
    free : Expression
        Slip rate of zero traction.
    slides : Expression
        1 where the point is neither stuck nor open.
    """

    def __init__(self, fault: Fault, law: TracedLaw, contact: Any) -> None:
        face, t = fault.interface, range(fault.tangents)
        normal = int(face.has_normal)
        self.v = v = symbol("V")
        since, stuck, opened = symbol("since"), symbol("stuck"), symbol("opened")  # type: Any, Any, Any
        self.slides: Any = np.where(stuck > 0, 0.0, np.where(opened > 0, 0.0, 1.0))
        shear_0: list[Any] = [symbol(f"shear_traction_0_{k}") for k in t]
        before: list[Any] = [symbol(f"mean_slip_rate_{k}") for k in t]
        slip: list[Any] = [symbol(f"slip_{k}") for k in t]
        sigma_0, sigma_before = symbol("normal_stress_0"), symbol("normal_stress")
        apart: Any = symbol("jump_0") + symbol("gap") if normal else constant(0)
        trial: Trial = record(contact.trial, Point(
            normal_stress_0=sigma_0, shear_traction_0=shear_0, opening_jump=apart,
            slip_jump=[symbol(f"jump_{normal + k}") for k in t], slip=slip, since=since, dt=symbol("dt"),
            opening_velocity=symbol("rate_0") if normal else constant(0),
            slip_velocity=[symbol(f"rate_{normal + k}") for k in t], normal_impedance=symbol("normal_impedance"),
            shear_impedance=[symbol(f"shear_impedance_{k}") for k in t],
        ))  # fmt: skip
        shear, z = [_as_expression(each) for each in trial.shear_traction], trial.impedance
        sigma: Any = np.where(opened > 0, 0.0, trial.normal_stress)
        carried = point_step.shifted_trial(shear, z, before, symbol("carried"))
        self.free = carried.free_rate
        entries = {
            symbol("slip_rate"): v, symbol("rate_before"): carried.rate_before,
            symbol("speed_before"): point_step.length(before), symbol("normal_stress"): sigma,
            symbol("normal_stress_before"): sigma_before, symbol("radiation"): constant(0), symbol("bond"): constant(0),
        }  # fmt: skip
        begun = dict(zip(map(symbol, law.start), substituted(law.start.values(), entries), strict=True))
        of_law: dict[str, Any] = dict(
            zip(law.outputs, substituted(law.outputs.values(), {**entries, **begun}), strict=True)
        )
        balance = point_step.balance(carried, v, of_law["strength"], of_law["slope"])
        self.balance = balance.residual
        ends = fault.contact.traction_ends_slip
        direction = [
            np.where(opened > 0, *each) for each in zip(carried.free_direction, balance.direction, strict=True)
        ]
        result = point_step.sliding(
            carried, shear, before, v, of_law["rate_now"], direction,
            is_open=opened > 0, is_stuck=stuck > 0, at_end=ends,
        )  # fmt: skip
        mean, now = result.mean_slip_rate, result.slip_rate
        if ends:  # a step of zero length keeps the rates
            mean, now = (
                [np.where(since > 0, *each) for each in zip(rates, before, strict=True)] for rates in (mean, now)
            )
        slips = point_step.slip_after(slip, mean if ends else before, since)
        opening = point_step.opening_after(
            sigma, trial.normal_stress, trial.normal_compliance, sigma_before, apart, ends
        )
        outputs = {
            **({"change_normal": sigma_0 - sigma} if normal else {}),
            **{f"change_{k}": result.shear_traction[k] - shear_0[k] for k in t},
            **{f"slip_{k}": slips[k] for k in t}, **{f"mean_slip_rate_{k}": mean[k] for k in t},
            "normal_stress": sigma, **{f"s_{name}": of_law[f"n_{name}"] for name in law.state_names},
            **{f"slip_rate_{k}": now[k] for k in t},
            **{f"shear_traction_{k}": result.shear_traction[k] for k in t}, "opening": opening,
        }  # fmt: skip
        self.outputs = {name: _as_expression(value) for name, value in outputs.items()}
        of_run: list[Any] = [symbol(f"found_{k}") for k in t]
        solved: Any = (
            of_run[0] * carried.direction[0]
            if len(t) == 1
            else (
                point_step.length([rate + shift for rate, shift in zip(of_run, carried.shift, strict=True)])
                - carried.shift_along
            )
        )
        self.v_found: Any = np.where(stuck > 0, 0.0, np.where(opened > 0, self.free, solved))


class InitialMap:
    """Fields before the first step as a function of initial tractions and parameters, with its derivatives.

    Parameters
    ----------
    names : list of str
        Parameters of `PointMap`.
    memory : list of str
        Its fields.
    slip_rate : ndarray, shape (n, tangents), or None
        Initial slip rate from the velocities of the bodies [m/s].

    Raises
    ------
    RuptfxError
        If the initial state of the law cannot be traced.
    """

    def __init__(self, fault: Fault, names: list[str], memory: list[str], slip_rate: Floats | None) -> None:
        t, self._n, self._names = range(fault.tangents), len(fault.interface.weight), names
        values = np.zeros((self._n, len(t))) if slip_rate is None else slip_rate
        self._given = np.ascontiguousarray(values.T)
        rate: list[Any] = [symbol(f"given_{k}") for k in t]
        shear_0: list[Any] = [symbol(f"shear_traction_0_{k}") for k in t]
        shear, speed, sigma = point_step.length(shear_0), point_step.length(rate), symbol("normal_stress_0")
        _, law = parameters_as_symbols(fault.friction, "p_")
        state: Mapping[str, Any] = record(law.initial_state, sigma, shear, speed)
        creep: Any = _as_expression(record(law.carried_slip_rate, shear, sigma, state))
        creep = np.minimum(creep, _as_expression(record(law.largest_initial_slip_rate)))
        start = {
            **{f"slip_{k}": constant(0) for k in t},
            **{f"mean_slip_rate_{k}": np.where(speed > 0, rate[k], creep * shear_0[k] / np.maximum(shear, 1e-300))
               for k in t},
            "normal_stress": sigma, **{f"s_{name}": _as_expression(state[name]) for name in law.all_state_fields()},
        }  # fmt: skip
        outputs, inputs = [_as_expression(start[name]) for name in memory], [symbol(name) for name in names]
        factors = [symbol(f"factor_{i}") for i in range(len(outputs))]
        changes = {each: symbol(f"change_{i}") for i, each in enumerate(inputs)}
        known = [*names, *(f"given_{k}" for k in t)]
        self._count = len(outputs)
        self._library = native.load("initial_map", "#include <math.h>\n" + "\n".join([
            _function("value", known, outputs),
            _function("push", [*known, *(f"change_{i}" for i in range(len(inputs)))],
                      directional(outputs, changes, guarded=True)),
            _function("pull", [*known, *(f"factor_{i}" for i in range(len(outputs)))],
                      transposed(_sums(outputs, factors), inputs)),
        ]))  # fmt: skip

    def value(self, parameters: Floats) -> Floats:
        """Return the fields, shape (memory, n)."""
        return self._call("value", self._count, parameters)

    def push(self, parameters: Floats, changes: Floats) -> Floats:
        """Return the changes of the fields from those of the parameters, shapes (memory, n) and (parameters, n)."""
        return self._call("push", self._count, parameters, changes)

    def pull(self, parameters: Floats, factors: Floats) -> Floats:
        """Return the factors of the parameters from those of the fields, shapes (parameters, n) and (memory, n)."""
        return self._call("pull", len(self._names), parameters, factors)

    def _call(self, name: str, count: int, parameters: Floats, seeds: Floats | None = None) -> Floats:
        out, numbers = np.empty((count, self._n)), np.zeros(len(NUMBERS))
        rows = [np.ascontiguousarray(each) for each in (parameters, self._given, seeds) if each is not None]
        pointers, results = np.concatenate([_rows(each) for each in rows]), _rows(out)
        getattr(self._library, name)(ctypes.c_long(self._n), *map(address, (numbers, pointers, results)))
        return out


def _function(name: str, inputs: Sequence[str], outputs: Sequence[Expression]) -> str:
    """Return a C function from rows of arrays to rows of arrays, point by point."""
    numbers = "".join(f"const double {each} = numbers[{i}]; (void){each};\n" for i, each in enumerate(NUMBERS))
    value = "".join(f"const double {each} = in[{i}][l]; (void){each};\n" for i, each in enumerate(inputs))
    body = to_c({f"out[{i}][l]": each for i, each in enumerate(outputs)})
    return (
        f"void {name}(long n, const double *numbers, const double *const *in, double *const *out)\n{{\n{numbers}"
        f"for (long l = 0; l < n; l++) {{\n{value}{body}\n}}\n}}\n"
    )


def _rows(block: Floats) -> NDArray[np.uintp]:
    """Return the addresses of the rows of a contiguous array."""
    return np.asarray(block.ctypes.data + block.strides[0] * np.arange(len(block)), dtype=np.uintp)


def _sums(expressions: Sequence[Expression], factors: Sequence[Any]) -> dict[Expression, Expression]:
    """Return the factor of every expression; equal expressions are one, with the sum of their factors."""
    sums: dict[Expression, Any] = {}
    for expression, factor in zip(expressions, factors, strict=True):
        sums[expression] = sums[expression] + factor if expression in sums else factor
    return sums


def _as_expression(value: Any) -> Expression:
    return value if isinstance(value, Expression) else constant(value)
