"""Fields of an interface: pore pressure and temperature, which friction laws read.

A field is the sum of contributions (`Contribution`), one for each entry of ``[faults.NAME.pore_pressure]`` and
``[faults.NAME.temperature]``. A step has two parts. `FaultFields.plan` comes first: it extrapolates the heat of
friction and sets the rates of the fields, which the law adds up over the step (`ruptfx.laws.friction.in_fields`).
`FaultFields.complete` comes last: it computes the memory of the contributions with the heat of the step. Explicit steps
call both through a mechanism, implicit steps through `FaultResponse`. Runge-Kutta steps evaluate the fields at any time
in between with `FaultFields.values`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np

from ruptfx import RuptfxError
from ruptfx.bodies.state import FaultState
from ruptfx.input.schema import CaseError
from ruptfx.laws.friction import FrictionLaw
from ruptfx.laws.friction.in_fields import InFields, rate_of

if TYPE_CHECKING:
    from ruptfx.bodies.state import State
    from ruptfx.interfaces.faults.interface import Interface


class WithFields(Protocol):
    """The fields of a fault use these parts of it."""

    @property
    def name(self) -> str: ...
    @property
    def interface(self) -> Interface: ...
    @property
    def fields(self) -> FaultFields: ...
    def components(self, state: Mapping[str, np.ndarray], name: str) -> np.ndarray: ...


TOLERANCE = 1e-3
"""Tolerated difference between the planned pressure of a step and that of its heat, over the normal stress."""


LARGEST = 0.1
"""Largest estimated error of the pressure in a step of fixed length, over the normal stress."""


@dataclass(frozen=True)
class Heating:
    """Heat of friction per area, and change of the state, from the begin of a step to a time in it.

    Attributes
    ----------
    power : ndarray, shape (n,)
        Power of friction at the begin [W/m2].
    heat : ndarray, shape (n,)
        [J/m2].
    elapsed : float
        Time since the begin [s].
    aged : ndarray, shape (n,)
        Change of ln theta since the begin, of the state theta of the friction law.
    ageing : ndarray, shape (n,)
        Rate of ln theta in the step before [1/s].
    slid : ndarray, shape (n,)
        Length of the path of slip since the begin [m].
    pressed : ndarray, shape (n,)
        Change of the effective normal stress since the begin [Pa].
    """

    power: np.ndarray
    heat: np.ndarray
    elapsed: float
    aged: np.ndarray | float = 0.0
    ageing: np.ndarray | float = 0.0
    slid: np.ndarray | float = 0.0
    pressed: np.ndarray | float = 0.0

    @property
    def growth(self) -> np.ndarray:
        """Change of the power until then [W/m2], if it is linear in time."""
        return 2 * (self.heat / self.elapsed - self.power) if self.elapsed > 0 else np.zeros_like(self.heat)


class Contribution:
    """Contract of what adds to the fields of an interface; memories are arrays of shape (n, columns)."""

    adds: tuple[str, ...] = ()
    """Fields to which it adds."""
    is_heated: bool = False
    """Whether it depends on the heat of friction."""
    is_aged: bool = False
    """Whether it depends on the state theta of the friction law."""
    is_strained: bool = False
    """Whether it depends on slip or on the normal stress."""
    flows: bool = False
    """Whether fluid flows along the interface."""

    @property
    def follows_motion(self) -> bool:
        """True if it depends on the motion of the interface, so that gradients of a run would have a part by it."""
        return self.is_heated or self.is_aged or self.is_strained

    parameters: Mapping[str, np.ndarray] = {}
    """Parameters by which a run is differentiated, by the key of the table, shapes (n,)."""

    def slopes(self, time: float) -> dict[str, np.ndarray]:
        """Return the derivatives of its field by its parameters at a time [s], shapes (n,)."""
        return {}

    def with_changes(self, changes: Mapping[str, np.ndarray]) -> Contribution:
        """Return the contribution with changes added to its parameters, shapes (n,)."""
        return self

    def memory(self) -> dict[str, np.ndarray]:
        """Return its memory at the start of a run by name, shape (n,) or (n, values) each, in units of its own."""
        return {}

    def plan(self, memory: Mapping[str, np.ndarray], time: float, dt: float) -> None:
        """Prepare the values of a step that begins at a time [s]; collective."""

    def values(self, memory: Mapping[str, np.ndarray], time: float, heating: Heating) -> dict[str, np.ndarray]:
        """Return its parts of the fields within a step that begins at a time [s], shapes (n,)."""
        raise NotImplementedError

    def advance(self, memory: Mapping[str, np.ndarray], time: float, heating: Heating) -> None:
        """Set the memory to that at the end of a step that begins at a time [s]."""

    def uncertainty(self, heating: Heating) -> np.ndarray | float:
        """Return the estimated error of its pressure in a step [Pa], shape (n,)."""
        return 0.0

    def planned_error(self, heating: Heating) -> np.ndarray | float:
        """Return the part of the error for which a step of fixed length may be too long [Pa], shape (n,)."""
        return 0.0


@dataclass
class FaultFields:
    """The fields of one interface, none by default.

    Attributes
    ----------
    contributions : sequence of Contribution
    points : int
        Number of points of this rank.
    """

    contributions: Sequence[Contribution] = field(default_factory=list)
    points: int = 0

    def __bool__(self) -> bool:
        return bool(self.contributions)

    @property
    def is_heated(self) -> bool:
        """True if the heat of friction changes a field."""
        return any(each.is_heated for each in self.contributions)

    @property
    def is_aged(self) -> bool:
        """True if the state of the friction law changes a field."""
        return any(each.is_aged for each in self.contributions)

    @property
    def parameters(self) -> dict[str, np.ndarray]:
        """The parameters of all contributions, by number and key: `fluid_0_pressure`."""
        items = enumerate(self.contributions)
        return {f"fluid_{n}_{name}": values for n, each in items for name, values in each.parameters.items()}

    def slopes(self, time: float) -> dict[str, np.ndarray]:
        """Return the derivatives of the pore pressure by all parameters at a time [s], shapes (n,)."""
        items = enumerate(self.contributions)
        return {f"fluid_{n}_{name}": slope for n, each in items for name, slope in each.slopes(time).items()}

    def with_changes(self, changes: Mapping[str, np.ndarray]) -> FaultFields:
        """Return the fields with changes added to parameters, by the names of `parameters`."""
        made = []
        for n, each in enumerate(self.contributions):
            own = {name: changes[key] for name in each.parameters if (key := f"fluid_{n}_{name}") in changes}
            made.append(each.with_changes(own) if own else each)
        return replace(self, contributions=made)

    def memory(self, power: np.ndarray) -> FaultState:
        """Return the memory of all contributions at the start, from the power of friction [W/m2], shape (n,).

        Arrays have the shape (n, columns).
        """
        own = {"power": power, "power_before": power, "step": np.zeros(self.points)}
        own |= {"ageing": np.zeros(self.points)} if self.is_aged else {}
        memory = {name: values[:, None].copy() for name, values in own.items()}
        for number, each in enumerate(self.contributions):
            memory |= {f"{number}.{name}": values for name, values in each.memory().items()}
        return memory

    def initial(self) -> dict[str, np.ndarray]:
        """Return the fields at the start of a run, shape (n,)."""
        none = np.zeros(self.points)
        return self.values(self.memory(none), 0.0, Heating(none, none, 0.0))

    def surrounding(self, law: FrictionLaw) -> FrictionLaw:
        """Return the law that reads the fields; its own initial values of them are replaced."""
        if not self:
            return law
        initial = self.initial()
        return InFields.model_construct(law=_started(law, initial), initial=initial, is_heated=self.is_heated)

    def require_closed(self, normal_stress: np.ndarray, position: np.ndarray) -> None:
        """Refuse an initial pressure that would open the interface.

        Raises
        ------
        CaseError
        """
        pressure = self.initial().get("pore_pressure", np.zeros(self.points))
        wrong = np.flatnonzero((pressure >= normal_stress) & (pressure > 0))
        if len(wrong):
            point = int(wrong[0])
            raise CaseError(
                f"pore_pressure: {pressure[point]:.6g} Pa at the start is not below the normal stress of "
                f"{normal_stress[point]:.6g} Pa at position {position[point]:.6g} m ({len(wrong)} such points), and "
                "would open the interface; reduce the pressure, or raise initial_stress.normal"
            )

    def values(self, memory: FaultState, time: float, heating: Heating) -> dict[str, np.ndarray]:
        """Return the fields within a step that begins at a time [s], shape (n,)."""
        fields: dict[str, np.ndarray] = {}
        for each, own in self._with_memory(memory):
            for name, values in each.values(own, time, heating).items():
                fields[name] = fields.get(name, 0.0) + values
        return fields

    def _with_memory(self, memory: FaultState) -> Iterator[tuple[Contribution, FaultState]]:
        """Yield the contributions with their parts of the memory."""
        for number, each in enumerate(self.contributions):
            begin = f"{number}."
            yield each, {key.removeprefix(begin): values for key, values in memory.items() if key.startswith(begin)}

    def prepare(self, memory: FaultState, time: float, dt: float) -> None:
        """Prepare the values of a step that begins at a time [s]; collective."""
        for each, own in self._with_memory(memory):
            each.plan(own, time, dt)

    def plan(self, fault: WithFields, state: State, dt: float) -> None:
        """Set the rates of the fields over a step of the length `dt` [s] with an extrapolated heat; collective."""
        if not self:
            return
        memory, fields, time = state.fluids[fault.name], state.faults[fault.name], state.fault_time
        self.prepare(memory, time, dt)
        values = self.values(memory, time, _extrapolated(memory, dt))
        for name, end in values.items():
            fields[rate_of(name)][:] = (end - fields[name]) / dt if dt > 0 else 0.0

    def heating(
        self, fault: WithFields, memory: FaultState, old: FaultState, new: FaultState, dt: float,
        radiation: np.ndarray | float = 0.0,
    ) -> tuple[Heating, np.ndarray]:  # fmt: skip
        """Return the heat of friction in a step, and the power at its end [W/m2], shape (n,).

        The heat is that of the mean friction of both tractions on the slip between them, or what the step has added to
        `frictional_heat` itself.

        Parameters
        ----------
        radiation : ndarray, shape (n,)
            Impedance of radiation damping [Pa s/m], whose part of the traction is no friction.
        """
        (before, _), (after, power) = (_friction(fault, fields, radiation) for fields in (old, new))
        slid = fault.components(new, "slip") - fault.components(old, "slip")
        heat = 0.5 * np.sum((before + after) * slid, axis=1)
        added = new["frictional_heat"] - old["frictional_heat"] if self.is_heated else np.zeros(self.points)
        heat, power_before = np.where(added != 0, added, heat), memory["power"][:, 0].copy()
        pressed = _effective(new) - _effective(old)
        slip = np.linalg.norm(slid, axis=1)
        return Heating(power_before, heat, dt, *self.ageing(memory, old, new), slip, pressed), power

    def ageing(
        self, memory: FaultState, old: Mapping[str, np.ndarray], new: Mapping[str, np.ndarray]
    ) -> tuple[np.ndarray | float, np.ndarray | float]:
        """Return the change of ln theta between two states, and its rate in the step before [1/s], shapes (n,)."""
        return (np.log(new["theta"] / old["theta"]), memory["ageing"][:, 0].copy()) if self.is_aged else (0.0, 0.0)

    def complete(
        self, fault: WithFields, state: State, old: FaultState, new: FaultState, dt: float,
        ends_at: float, radiation: np.ndarray | float = 0.0,
    ) -> Heating | None:  # fmt: skip
        """Set the memory to that at the end of a step between the tractions `old` and `new`, which ends at a time [s].

        Returns
        -------
        Heating or None
            Of the step; None without fields.

        Raises
        ------
        RuptfxError
            On this rank, if the pressure exceeds the normal stress.
        """
        if not self:
            return None
        memory = state.fluids[fault.name]
        heating, power = self.heating(fault, memory, old, new, dt, radiation)
        if dt > 0:
            time = ends_at - dt
            for each, own in self._with_memory(memory):
                each.advance(own, time, heating)
            if self.is_aged:
                memory["ageing"][:, 0] = heating.aged / dt
            memory["power_before"][:, 0], memory["step"][:, 0] = memory["power"][:, 0], dt
            if self.is_heated:
                new["frictional_heat"][:] = old["frictional_heat"] + heating.heat
        memory["power"][:, 0] = power
        _require_pressed(fault, new, ends_at)
        return heating

    def require_short(self, fault: WithFields, state: State, heating: Heating | None) -> None:
        """Refuse a step of a fixed length that is too long for the pressure.

        Raises
        ------
        RuptfxError
            On this rank.
        """
        fields, time = state.faults[fault.name], state.time
        if heating is None or heating.elapsed == 0 or "pore_pressure" not in fields:
            return
        normal = fields["normal_stress"]
        parts = (np.asarray(each.planned_error(heating)) for each in self.contributions)
        error, most = sum(parts, np.zeros(self.points)), LARGEST * np.maximum(normal, 1.0)
        wrong = np.flatnonzero((error > most) & (normal > 0))
        if len(wrong):
            point = int(wrong[np.argmax(error[wrong] / most[wrong])])
            where = ", ".join(f"{x:.6g}" for x in fault.interface.points[point])
            shorter = heating.elapsed * min(0.5, float(most[point] / error[point]))
            raise RuptfxError(
                f"faults.{fault.name}.pore_pressure: a step of {heating.elapsed:.4g} s has an error of "
                f"{error[point]:.4g} Pa at ({where}) m, time {time:.6g} s; at most {LARGEST:g} of the normal stress, "
                f"{most[point]:.4g} Pa, is computed: use stepper.time_step = {shorter:.3g}, or a smaller rate of "
                "wells"
            )

    def error(
        self, fault: WithFields, state: State, new: FaultState, dt: float, radiation: np.ndarray | float = 0.0
    ) -> float:
        """Return the error of the planned pressure of a step over its tolerance, largest of this rank."""
        if "pore_pressure" not in new:
            return 0.0
        memory, old = state.fluids[fault.name], state.faults[fault.name]
        heating, _ = self.heating(fault, memory, old, new, dt, radiation)
        wrong = self.values(memory, state.fault_time, heating)["pore_pressure"] - new["pore_pressure"]
        wrong = np.maximum(np.abs(wrong), self.uncertainty(memory, heating))
        return float((wrong / (TOLERANCE * np.maximum(np.abs(new["normal_stress"]), 1.0))).max(initial=0.0))

    def uncertainty(self, memory: FaultState, heating: Heating) -> np.ndarray:
        """Return the estimated error of the pressure within a step [Pa], shape (n,)."""
        parts = [np.asarray(each.uncertainty(heating)) for each in self.contributions]
        return sum(parts, np.zeros(self.points))


def _extrapolated(memory: FaultState, dt: float) -> Heating:
    power, before, step = (memory[name][:, 0] for name in ("power", "power_before", "step"))
    grown = 0.5 * dt * (power - before) / np.where(step > 0, step, 1.0)
    ageing = memory["ageing"][:, 0] if "ageing" in memory else 0.0
    return Heating(power, np.maximum(power + grown, 0.0) * dt, dt, ageing * dt, ageing)


def _require_pressed(fault: WithFields, fields: FaultState, time: float) -> None:
    pressure, normal = fields.get("pore_pressure"), fields["normal_stress"]
    if pressure is not None and len(wrong := np.flatnonzero((pressure > normal) & (normal > 0))):
        point = int(wrong[0])
        where = ", ".join(f"{x:.6g}" for x in fault.interface.points[point])
        raise RuptfxError(
            f"faults.{fault.name}.pore_pressure: {pressure[point]:.6g} Pa exceeds the normal stress of "
            f"{normal[point]:.6g} Pa at ({where}) m, time {time:.6g} s: fluid would open the "
            "interface, which is not computed; reduce the pressure or the injection, or raise the normal stress"
        )


def _started(law: FrictionLaw, initial: Mapping[str, np.ndarray]) -> FrictionLaw:
    """Return a law and the laws inside it, with the initial fields for parameters such as `temperature_initial`."""
    named = {f"{name}_initial": values for name, values in initial.items()}
    changes: dict[str, object] = {name: values for name, values in named.items() if name in type(law).model_fields}
    inner = getattr(law, "law", None)
    if inner is not None:
        changes["law"] = _started(inner, initial)
    return law.substituted(changes)


def _effective(fields: FaultState) -> np.ndarray:
    """Return the effective normal stress of closed points, zero of open ones [Pa], shape (n,)."""
    return np.asarray(np.maximum(fields["normal_stress"] - fields.get("pore_pressure", 0.0), 0.0))


def _friction(fault: WithFields, fields: FaultState, radiation: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
    """Return the traction of friction [Pa], shape (n, tangents), and its power [W/m2], shape (n,)."""
    rate = fault.components(fields, "slip_rate")
    traction = fault.components(fields, "shear_traction") - np.reshape(radiation, (-1, 1)) * rate
    return traction, np.maximum(np.sum(traction * rate, axis=1), 0.0)


def power_of(fault: WithFields, fields: FaultState) -> np.ndarray:
    """Return the power of friction [W/m2], shape (n,)."""
    return _friction(fault, fields, 0.0)[1]


def plan_fields(faults: Iterable[WithFields], state: State, dt: float) -> None:
    """Set the rates of the fields of all interfaces over a step of the length `dt` [s]; collective."""
    for fault in faults:
        fault.fields.plan(fault, state, dt)
