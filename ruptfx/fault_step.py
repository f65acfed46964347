"""The explicit step of a fault.

A step knows the displacement at the time t of the traction and the velocity half a step before. It finds the traction
at t, and with it the velocity half a step later; `FaultState` is then that of time t, all of it.

`FaultStep` is generated C: `fault_step.c` filled with the traced contact method, law and monitors. The tests have the
same step written with arrays (`tests/reference_step.py`).
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from dataclasses import dataclass, fields
from importlib.resources import files
from string import Template
from typing import Any

import numpy as np

from ruptfx import native
from ruptfx.contact import ContactMethod, Point, Trial
from ruptfx.fault import Fault
from ruptfx.fields import MONITORS, Moment, Monitor, component_names
from ruptfx.interface import Interface
from ruptfx.projection import BISECT_EVERY, MAX_ITERATIONS, TOLERANCE, TracedLaw, parameters_as_symbols
from ruptfx.state import FaultState
from ruptfx.tracing import Expression, constant, record, symbol, to_c


def impedances(interface: Interface, inverse_mass: np.ndarray, kick: float) -> tuple[np.ndarray, np.ndarray]:
    """Normal and shear impedance 1 / (kick w (1/m+ + 1/m-)) of every point [Pa s/m], shapes (n,) and (n, tangents).

    Parameters
    ----------
    inverse_mass : ndarray, shape (nodes * components,)
        Inverse lumped mass of every degree of freedom [1/kg]; zero where the motion is prescribed.
    kick : float
        Time the traction acts for [s].
    """
    inverse = inverse_mass.reshape(-1, interface.frame.shape[2])
    both = inverse[interface.plus] + (0 if interface.one_sided else inverse[interface.minus])
    mobility = np.einsum("ikc,ic->ik", interface.rows**2, both)
    # Where both sides are driven nothing yields. An impedance 1e8 times that of others will do: the traction is a small
    # difference of what it multiplies.
    mobility = np.maximum(mobility, 1e-8 * mobility.max(initial=1e-300))
    z = 1 / (kick * interface.weight[:, None] * mobility)
    return z[:, 0], z[:, interface.frame.shape[1] - interface.tangents :]


@dataclass(frozen=True)
class Clock:
    """Times of an explicit step [s].

    Attributes
    ----------
    dt : float
        Between displacements.
    kick : float
        How long the traction acts on the velocity: `dt`, at the start half of it.
    since : float
        Time since the traction before: `dt`, at the start zero.
    extrapolation : float
        Of `TracedLaw`: 1/2, in the step after the start 1.
    """

    dt: float
    kick: float
    since: float
    extrapolation: float

    @classmethod
    def of_step(cls, dt: float, number: int = 2) -> Clock:
        """The step with this number after a start from one time for all: 0, 1, and all others."""
        return cls(dt, 0.5 * dt if number == 0 else dt, 0.0 if number == 0 else dt, 1.0 if number == 1 else 0.5)


class FaultStep:
    """The explicit step as compiled C: `FaultStep(fault, ...)(...)` does what `advance_reference` does.

    Parameters
    ----------
    fault : Fault
    inverse_mass : ndarray, shape (nodes * components,)
        As for `impedances`.
    clock : Clock
    threshold : float
        Slip rate [m/s] whose first passing is the rupture time.
    """

    def __init__(self, fault: Fault, inverse_mass: np.ndarray, clock: Clock, threshold: float) -> None:
        self.fault, self.clock, self.threshold = fault, clock, threshold
        self.law = fault.traced_law()
        face = fault.interface
        normal_impedance, shear_impedance = impedances(face, inverse_mass, clock.kick)
        contact_values, traced_contact = parameters_as_symbols(fault.contact, "c_")
        given = self.law.parameters | contact_values
        shape = face.weight.shape
        self._fixed = {
            "weight": face.weight, "q_normal_stress_0": fault.normal_stress_0, "q_normal_impedance": normal_impedance,
            **{f"q_shear_impedance_{k}": shear_impedance[:, k] for k in range(fault.tangents)},
            **{f"q_shear_traction_0_{k}": fault.shear_traction_0[:, k] for k in range(fault.tangents)},
            **({} if fault.gap is None else {"gap": fault.gap}),
            **{name: value for name, value in given.items() if isinstance(value, np.ndarray)},
        }  # fmt: skip
        self._fixed = {k: np.array(np.broadcast_to(v, shape), float, order="C") for k, v in self._fixed.items()}
        numbers = {name: float(value) for name, value in given.items() if not isinstance(value, np.ndarray)}
        self._state_arrays = list(fault.initial_state())
        source = _source(fault, self.law, traced_contact, list(self._fixed), list(numbers), self._state_arrays)
        self._function = native.load("fault_step", source).update
        self._function.restype = None
        self._numbers = np.array([*numbers.values(), 0.0])
        self._times = [ctypes.c_double(v) for v in (
            clock.dt, clock.kick, clock.since, clock.extrapolation, self.law.carried(clock.extrapolation),
        )]  # fmt: skip
        self._result = np.zeros(6)
        self._owned = face.owned.astype(float)
        self._inverse_mass = inverse_mass
        self._index = [np.ascontiguousarray(side, dtype=np.int64) for side in (face.plus, face.minus)]
        self._frame = np.ascontiguousarray(face.rows)
        self._bound: tuple[Any, ...] = ()
        self.work = 0.0
        self._was_open = True

    def refresh(self) -> None:
        """Take over weights and inverse masses that have changed in place."""
        face = self.fault.interface
        normal, shear = impedances(face, self._inverse_mass, self.clock.kick)
        self._fixed["weight"][:], self._fixed["q_normal_impedance"][:] = face.weight, normal
        for k in range(self.fault.tangents):
            self._fixed[f"q_shear_impedance_{k}"][:] = shear[:, k]

    def start_from(self, normal_stress: np.ndarray, shear_traction: np.ndarray) -> None:
        """Stresses that the velocities contain, in place of the initial ones; shapes (n,) and (n, tangents) [Pa]."""
        self._fixed["q_normal_stress_0"][:] = normal_stress
        for k in range(self.fault.tangents):
            self._fixed[f"q_shear_traction_0_{k}"][:] = shear_traction[:, k]

    def opening_rate(self, state: FaultState, velocity: np.ndarray) -> np.ndarray | None:
        """Opening rate of every point [m/s], or None while all of them stay closed and nothing can collide."""
        is_open = self.fault.interface.has_normal and bool(np.any(state["normal_stress"] <= 0))
        collides, self._was_open = is_open or self._was_open, is_open
        return self.fault.interface.split(self.fault.interface.rate(velocity))[0] if collides else None

    def impact_loss(self, state: FaultState, velocity: np.ndarray, rate_old: np.ndarray | None) -> float:
        """Energy lost in closing gaps over a step, points of this rank [J]."""
        if rate_old is None:
            return 0.0
        face = self.fault.interface
        rate, _ = face.split(face.rate(velocity))
        power = self.fault.contact.lost_in_impact(state["normal_stress"], rate_old, rate)
        return float(self._owned @ (face.weight * power)) * self.clock.kick

    def _bind(self, state: FaultState, displacement: np.ndarray, velocity: np.ndarray, force: np.ndarray) -> None:
        """Collect the pointers once; the arrays of a run keep their place."""
        arrays = [self._fixed[name] if name in self._fixed else state[name] for name in self._arrays]
        self._table = (ctypes.c_void_p * len(arrays))(*(array.ctypes.data for array in arrays))
        pointers = [
            *self._index,
            self._frame,
            self._owned,
            displacement,
            velocity,
            force,
            self._inverse_mass,
        ]
        self._pointers = [ctypes.c_void_p(array.ctypes.data) for array in pointers]
        self._tail = [
            ctypes.byref(self._table),
            *(ctypes.c_void_p(a.ctypes.data) for a in (self._numbers, self._result)),
        ]
        self._bound = (state, displacement, velocity, force)

    @property
    def _arrays(self) -> list[str]:
        return [*self._fixed, *self._state_arrays]

    def __call__(
        self, state: FaultState, displacement: np.ndarray, velocity: np.ndarray, force: np.ndarray, time: float
    ) -> float:
        """Advance `state`, `velocity` and `force` in place; returns the energy dissipated on this rank [J].

        `work` is then the work [J] that the nucleation did on this rank.

        Raises
        ------
        ProjectionError
            A point without an admissible traction; `state` and `velocity` are then of no use.
        """
        given = (state, displacement, velocity, force)
        if not self._bound or any(a is not b for a, b in zip(self._bound, given, strict=True)):
            self._bind(*given)
        n = len(self._owned)
        loaded, since = self.fault.is_loaded, self.clock.since
        if loaded:
            name = component_names("mean_slip_rate", self.fault.tangents)[0]
            load, rate_old = self.fault.load(time), state[name] * (since > 0)
            self._fixed["q_shear_traction_0_0"][:] = self.fault.shear_traction_0[:, 0] + load
        self._function(
            ctypes.c_long(n), *self._times, ctypes.c_double(time), ctypes.c_double(self.threshold),
            *self._pointers, *self._tail,
        )  # fmt: skip
        if self._result[1] >= 0:
            names = ("trial_normal_stress", "trial_shear_traction", "Z", "last_slip_rate")
            values = dict(zip(names, map(float, self._result[2:]), strict=True))
            self.fault.fail(state, int(self._result[1]), time, values)
        if loaded:
            contact = self.fault.contact
            power = contact.dissipated(self.fault.load(time - since), load, rate_old, state[name])
            work = float(self._owned @ (self.fault.interface.weight * power))
            self.work = work * (since if contact.traction_ends_slip else self.clock.kick)
        return float(self._result[0])


def _trace_contact(contact: ContactMethod, tangents: int, has_normal: bool) -> tuple[Trial, Expression]:
    """The trial and the dissipation as expressions."""

    def each(name: str) -> list[Expression]:
        return [symbol(f"q_{name}_{k}") for k in range(tangents)]

    def normal(name: str) -> Expression:
        return symbol(f"q_{name}") if has_normal else constant(0)

    trial = record(contact.trial, Point(
        normal_stress_0=symbol("q_normal_stress_0"), shear_traction_0=each("shear_traction_0"),
        opening_jump=normal("opening_jump"), slip_jump=each("slip_jump"),
        opening_velocity=normal("opening_velocity"), slip_velocity=each("slip_velocity"), slip=each("slip"),
        since=symbol("since"), dt=symbol("dt"), normal_impedance=symbol("q_normal_impedance"),
        shear_impedance=each("shear_impedance"),
    ))  # fmt: skip
    power = record(contact.dissipated, *map(symbol, ("traction_old", "traction", "rate_old", "rate")))
    return trial, power


def _source(
    fault: Fault, law: TracedLaw, contact: ContactMethod, fixed: list[str], numbers: list[str], state: list[str]
) -> str:
    """`fault_step.c` with its blanks filled."""
    tangents, has_normal, at_end = fault.tangents, fault.interface.has_normal, fault.contact.traction_ends_slip
    trial, power = _trace_contact(contact, tangents, has_normal)
    pointers = {
        "rates": "slip_rate", "means": "mean_slip_rate", "tractions": "shear_traction", "slips": "slip",
    }  # fmt: skip
    arrays = {name: component_names(name, tangents) for name in pointers.values()}
    # Symbol of the traced code -> the array it is loaded from.
    loaded = {name: name for name in fixed if name != "weight"}
    loaded |= {f"q_slip_{k}": arrays["slip"][k] for k in range(tangents)}
    loaded |= {"normal_stress_before": "normal_stress"} | {f"s_{name}": name for name in law.state_names}

    def lines(texts: Any) -> str:
        return "\n".join(texts)

    jumps = {f"q_slip_jump_{k}": f"jump_u[{has_normal + k}][l]" for k in range(tangents)}
    jumps |= {f"q_slip_velocity_{k}": f"jump_v[{has_normal + k}][l]" for k in range(tangents)}
    if has_normal:
        gap = "" if fault.gap is None else " + L_gap[l]"
        jumps |= {"q_opening_jump": f"jump_u[0][l]{gap}", "q_opening_velocity": "jump_v[0][l]"}
    bind = [f"const double {name} = L_{name}[l];" for name in loaded]
    begin = to_c({f"H_{name}[l]": law.start[f"h_{name}"] for name in law.state_names})
    half_way = [f"const double h_{name} = H_{name}[l];" for name in law.state_names]
    targets = {
        "trial_n[l]": trial.normal_stress, "compliance[l]": trial.normal_compliance,
        **{f"trial_s[{k}][l]": shear for k, shear in enumerate(trial.shear_traction)},
        **{f"z[{k}][l]": impedance for k, impedance in enumerate(trial.impedance)},
    }  # fmt: skip
    load = [f"double L_{name}[LANES];" for name in loaded]
    load += [f"double *{name}[TANGENTS][LANES];" for name in pointers]
    load += ["double old[TANGENTS][LANES], was[LANES], normal_stress_0[LANES], initial[TANGENTS][LANES];"]
    load += ["for (int l = 0; l < LANES; l++) {"]
    load += [f"    L_{name}[l] = A_{source}[at[l]];" for name, source in loaded.items()]
    load += ["    normal_stress_0[l] = A_q_normal_stress_0[at[l]];", "    double square = 0;"]
    for k in range(tangents):
        load += [f"    {name}[{k}][l] = A_{arrays[field][k]} + at[l];" for name, field in pointers.items()]
        load += [f"    initial[{k}][l] = A_q_shear_traction_0_{k}[at[l]];"]
        load += [f"    old[{k}][l] = *means[{k}][l];"]
        load += [f"    square += *rates[{k}][l] * *rates[{k}][l];"]
    load += ["    was[l] = sqrt(square);", "}"]
    unpack = [f"double *const A_{name} = array[{i}];" for i, name in enumerate([*fixed, *state])]
    unpack += [f"const double {name} = number[{i}];" for i, name in enumerate(numbers)]
    solved = {name: law.outputs[name] for name in ("strength", "slope", "rate_now", "rate_slope")}
    new_state = {f"N_{name}[l]": law.outputs[f"n_{name}"] for name in law.state_names}
    text = files("ruptfx").joinpath("fault_step.c").read_text()
    return Template(text).substitute(
        components=fault.interface.frame.shape[2], local=fault.interface.frame.shape[1], tangents=tangents,
        has_normal=int(has_normal), one_sided=int(fault.interface.one_sided), at_end=int(at_end),
        tolerance=repr(TOLERANCE),
        max_iterations=MAX_ITERATIONS,
        bisect_every=BISECT_EVERY,
        unpack=lines(unpack), load=lines(load), gap="" if fault.gap is None else " + L_gap[l]",
        bind_trial=lines(bind + [f"const double {name} = {value};" for name, value in jumps.items()]),
        trial=to_c(_expressions(targets)), bind_law=lines(bind + half_way), bind_start=lines(bind),
        law_start=begin, declare_start=lines(f"double H_{name}[LANES];" for name in law.state_names),
        law_strength=to_c({"strength": law.outputs["strength"]}), law_solved=to_c(solved),
        declare_new=lines(f"double N_{name}[LANES];" for name in law.state_names),
        law_state=to_c(_expressions({"now[l]": law.outputs["rate_now"], **new_state})),
        dissipated=to_c(_expressions({"power +": power})).replace("power + =", "power +="),
        store_new=lines(f"A_{name}[i] = N_{name}[l];" for name in law.state_names),
        bind_monitors=lines(f"const double old_{monitor.name} = A_{monitor.name}[i];" for monitor in MONITORS),
        monitors=to_c(_expressions({f"A_{monitor.name}[i]": _traced_update(monitor) for monitor in MONITORS})),
    )  # fmt: skip


def _traced_update(monitor: Monitor) -> Any:
    at = Moment(**{field.name: symbol(field.name) for field in fields(Moment)})
    return monitor.update(symbol(f"old_{monitor.name}"), at)


def _expressions(targets: Mapping[str, Any]) -> dict[str, Expression]:
    return {name: v if isinstance(v, Expression) else constant(v) for name, v in targets.items()}
