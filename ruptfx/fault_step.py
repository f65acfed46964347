"""The explicit step of a fault.

A step knows the displacement at the time t of the traction and the velocity half a step before. It finds the traction
at t, and with it the velocity half a step later; `FaultState` is then that of time t, all of it.

`FaultStep` is C: `fault_step.c`, and in front of it, as macros, where arrays are and the traced formulas of contact
method, law and monitors. The tests have the same step written with arrays (`tests/reference_step.py`).
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from dataclasses import fields
from importlib.resources import files
from itertools import accumulate

import numpy as np

from ruptfx import native
from ruptfx.contact import Array, ContactMethod, Point, Trial
from ruptfx.fault import Fault
from ruptfx.fields import FIELDS, MONITORS, Moment, component_names
from ruptfx.interface import Interface
from ruptfx.points import Clock
from ruptfx.projection import BISECT_EVERY, MAX_ITERATIONS, TOLERANCE, TracedLaw, parameters_as_symbols
from ruptfx.state import FaultState
from ruptfx.tracing import Expression, constant, record, symbol, to_c

LANES = 8  # points that the C code does at a time
_FAILURE = ("trial_normal_stress", "trial_shear_traction", "Z", "last_slip_rate")


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

    Attributes
    ----------
    work : float
        What the nucleation did in the last step, points of this rank [J].
    """

    def __init__(self, fault: Fault, inverse_mass: np.ndarray, clock: Clock, threshold: float) -> None:
        self.fault, self.clock, self.work = fault, clock, 0.0
        law, face = fault.traced_law(), fault.interface
        parameters, contact = parameters_as_symbols(fault.contact, "c_")
        parameters |= law.parameters
        columns = _columns(fault, inverse_mass, clock)
        n = len(face.weight)
        columns |= {k: np.broadcast_to(v, n) for k, v in parameters.items() if isinstance(v, np.ndarray)}
        numbers = {name: value for name, value in parameters.items() if name not in columns}
        self._inverse_mass = inverse_mass
        self._places = _places({name: int(np.prod(values.shape[1:])) for name, values in columns.items()})
        self._fixed = native.aligned((-(-n // LANES), self._places["COUNT"], LANES))
        for name, values in columns.items():
            self._put(name, values)
        self._numbers = np.array([*numbers.values(), 0.0])
        self._nodes = [
            np.ascontiguousarray(_filled(side * face.frame.shape[2]), np.int64) for side in (face.plus, face.minus)
        ]
        macros = _sizes(fault) | _names(fault, law, self._places, numbers) | _formulas(fault, law, contact)
        source = files("ruptfx").joinpath("fault_step.c").read_text()
        self._library = native.load("fault_step", source, macros)
        carried = law.carried(clock.extrapolation)
        self._times = np.array([clock.dt, clock.kick, clock.since, clock.extrapolation, carried, threshold, 0.0])
        self._result = np.zeros(2 + len(_FAILURE))
        self._fields = [name for field in (*FIELDS, *MONITORS) for name in field.names(face.tangents)]
        self._fields += law.state_names
        self._bound: tuple[object, ...] = ()
        self._was_open = True

    def _put(self, name: str, values: np.ndarray) -> None:
        """Values of one column or several, shape (n,) or (n, k)."""
        columns = _filled(values if values.ndim == 2 else values[:, None])
        place, many = self._places[name], columns.shape[1]
        self._fixed[:, place : place + many] = columns.reshape(-1, LANES, many).transpose(0, 2, 1)

    def refresh(self) -> None:
        """Take over weights and inverse masses that have changed in place."""
        for name, values in _columns(self.fault, self._inverse_mass, self.clock).items():
            self._put(name, values)

    def start_from(self, normal_stress: np.ndarray, shear_traction: np.ndarray) -> None:
        """Stresses that the velocities contain, in place of the initial ones; shapes (n,) and (n, tangents) [Pa]."""
        self._put("normal_stress_0", normal_stress)
        self._put("shear_traction_0", shear_traction)

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
        return float((face.owned * face.weight) @ power) * self.clock.kick

    def _bind(self, state: FaultState, displacement: np.ndarray, velocity: np.ndarray, force: np.ndarray) -> None:
        """Collect the pointers once; the arrays of a run keep their place."""
        self._table = (ctypes.c_void_p * len(self._fields))(*(state[name].ctypes.data for name in self._fields))
        arrays = (self._times, *self._nodes, displacement, velocity, force, self._fixed, self._numbers)
        self._pointers = [
            ctypes.c_long(len(self.fault.interface.weight)), *(ctypes.c_void_p(array.ctypes.data) for array in arrays),
            ctypes.byref(self._table), ctypes.c_void_p(self._result.ctypes.data),
        ]  # fmt: skip
        self._bound = (state, displacement, velocity, force)

    def __call__(
        self, state: FaultState, displacement: np.ndarray, velocity: np.ndarray, force: np.ndarray, time: float
    ) -> float:
        """Advance `state`, `velocity` and `force` in place; returns the energy dissipated on this rank [J].

        Raises
        ------
        ProjectionError
            A point without an admissible traction; `state` and `velocity` are then of no use.
        """
        given = (state, displacement, velocity, force)
        if not self._bound or any(a is not b for a, b in zip(self._bound, given, strict=True)):
            self._bind(*given)
        fault, since = self.fault, self.clock.since
        if fault.is_loaded:
            first = component_names("mean_slip_rate", fault.tangents)[0]
            load, rate_old = fault.load(time), state[first] * (since > 0)
            self._put("shear_traction_0", fault.shear_traction_0[:, 0] + load)  # the others stay
        self._times[-1] = time
        self._library.update(*self._pointers)
        if self._result[1] >= 0:
            values = dict(zip(_FAILURE, map(float, self._result[2:]), strict=True))
            fault.fail(state, int(self._result[1]), time, values)
        if fault.is_loaded:
            power = fault.contact.dissipated(fault.load(time - since), load, rate_old, state[first])
            work = float((fault.interface.owned * fault.interface.weight) @ power)
            self.work = work * (since if fault.contact.traction_ends_slip else self.clock.kick)
        return float(self._result[0])


# -- memory: blocks of points, in each of them column after column -------------------------------------------------


def _columns(fault: Fault, inverse_mass: np.ndarray, clock: Clock) -> dict[str, np.ndarray]:
    """What does not change at the points but for parameters, shapes (n,) and (n, k)."""
    face = fault.interface
    n, components = len(face.weight), face.frame.shape[2]
    normal_impedance, shear_impedance = impedances(face, inverse_mass, clock.kick)
    mobility = inverse_mass.reshape(-1, components)
    return {
        "weight": face.weight, "owned_area": face.owned * face.weight,
        "frame": face.rows.reshape(n, face.frame.shape[1] * components),
        "gap": np.zeros(n) if fault.gap is None else fault.gap,
        "normal_stress_0": fault.normal_stress_0, "shear_traction_0": fault.shear_traction_0,
        "normal_impedance": normal_impedance, "shear_impedance": shear_impedance,
        "mobility_plus": mobility[face.plus], "mobility_minus": mobility[face.minus],
    }  # fmt: skip


def _filled(values: np.ndarray) -> np.ndarray:
    """Whole blocks: the last point stands in for those that are missing."""
    return np.concatenate([values, np.repeat(values[-1:], -len(values) % LANES, axis=0)])


def _places(widths: Mapping[str, int]) -> dict[str, int]:
    """Where each begins, one after the other, and the end as `COUNT`."""
    return dict(zip([*widths, "COUNT"], accumulate(widths.values(), initial=0), strict=True))


# -- macros: what the C code does not know by itself ---------------------------------------------------------------


def _sizes(fault: Fault) -> dict[str, object]:
    face = fault.interface
    return {
        "LANES": LANES, "COMPONENTS": face.frame.shape[2], "LOCAL": face.frame.shape[1], "TANGENTS": face.tangents,
        "NORMAL": int(face.has_normal), "ONE_SIDED": int(face.one_sided),
        "AT_END": int(fault.contact.traction_ends_slip), "TOLERANCE": TOLERANCE, "MAX_ITERATIONS": MAX_ITERATIONS,
        "BISECT_EVERY": BISECT_EVERY,
    }  # fmt: skip


def _names(fault: Fault, law: TracedLaw, fixed: Mapping[str, int], numbers: Mapping[str, float]) -> dict[str, object]:
    """Where arrays are, and what the symbols of law and contact method stand for."""
    of_state = {field.name: len(field.names(fault.tangents)) for field in (*FIELDS, *MONITORS)}
    of_state |= dict.fromkeys(law.state_names, 1)
    places = {"FIXED": fixed, "STATE": _places(of_state), "BEGUN": _places(dict.fromkeys(law.state_names, 1))}
    found: dict[str, object] = {
        f"{kind}_PLACES": ", ".join(f"{kind}_{name} = {place}" for name, place in of_kind.items())
        for kind, of_kind in places.items()
    }
    found |= {name: f"FIXED({name})" for name in fixed if name.startswith(("c_", "p_"))}
    found |= {name: f"number[{place}]" for place, name in enumerate(numbers)}
    found |= {f"s_{name}": f"OLD({name})" for name in law.state_names}
    return found | {f"h_{name}": f"BEGUN({name})" for name in law.state_names}


def _formulas(fault: Fault, law: TracedLaw, contact: ContactMethod) -> dict[str, object]:
    """The traced formulas as C statements; `contact` holds symbols."""
    tangents, has_normal = range(fault.tangents), fault.interface.has_normal

    def each(place: str) -> list[Expression]:
        return [symbol(place.format(k)) for k in tangents]

    def normal(place: str) -> Expression:
        return symbol(place) if has_normal else constant(0)

    trial: Trial = record(contact.trial, Point(
        normal_stress_0=symbol("FIXED(normal_stress_0)"), shear_traction_0=each("FIXED(shear_traction_0 + {})"),
        opening_jump=normal("points->opening[l]"), slip_jump=each("points->jump[NORMAL + {}][l]"),
        opening_velocity=normal("points->velocity[0][l]"), slip_velocity=each("points->velocity[NORMAL + {}][l]"),
        slip=each("OLD(slip + {})"), since=symbol("since"), dt=symbol("dt"),
        normal_impedance=symbol("FIXED(normal_impedance)"), shear_impedance=each("FIXED(shear_impedance + {})"),
    ))  # fmt: skip
    taken: Array = record(contact.dissipated, *map(symbol, ("traction_old", "traction", "rate_old", "rate")))
    at = Moment(**{field.name: symbol(field.name) for field in fields(Moment)})
    formulas = {
        "TRIAL": {
            "points->trial_normal[l]": trial.normal_stress, "points->compliance[l]": trial.normal_compliance,
            **{f"points->trial_shear[{k}][l]": trial.shear_traction[k] for k in tangents},
            **{f"points->z[{k}][l]": trial.impedance[k] for k in tangents},
        },
        "BEGIN": {f"BEGUN({name})": law.start[f"h_{name}"] for name in law.state_names},
        "STRENGTH": {"strength": law.outputs["strength"]},
        "SOLVED": {name: law.outputs[name] for name in ("strength", "slope", "rate_now", "rate_slope")},
        "ADVANCED": {
            "points->rate_now[l]": law.outputs["rate_now"],
            **{f"NEW({name})": law.outputs[f"n_{name}"] for name in law.state_names},
        },
        "DISSIPATED": {"taken": taken},
        "MONITORS": {f"NEW({m.name})": m.update(symbol(f"OLD({m.name})"), at) for m in MONITORS},
    }  # fmt: skip
    return {name: to_c(outputs, end=" \\\n") for name, outputs in formulas.items()}
