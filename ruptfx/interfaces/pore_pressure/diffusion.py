"""Pore pressure that diffuses along the interface, with wells."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import numpy as np
from pydantic import ValidationInfo, model_validator

from ruptfx.bodies.boundaries.histories import History, course
from ruptfx.input.number_files import two_columns
from ruptfx.input.profiles.places import Center, distance
from ruptfx.input.schema import CaseError, Part, Unit
from ruptfx.input.units import (
    Compressibility,
    Fraction,
    Length,
    Strength,
    VaryingCoefficient,
    VaryingPermeability,
    VaryingPressure,
    Viscosity,
)
from ruptfx.interfaces.faults.fields import Contribution, Heating
from ruptfx.interfaces.field_table import MOTION
from ruptfx.interfaces.pore_pressure import PorePressure
from ruptfx.interfaces.pore_pressure._along import Along, AlongStep, on_all_ranks
from ruptfx.interfaces.pore_pressure._state import require_state
from ruptfx.platform import parallel

if TYPE_CHECKING:
    from ruptfx.interfaces.faults.interface import Interface
    from ruptfx.interfaces.mechanisms.system import System

STRAINS = ("slid", "pressed", "rate")
"""Memory of a permeability that changes: path of slip [m], change of the effective stress [Pa], rate of ln k [1/s]."""
FARTHEST = 1.0
"""Largest extrapolation of ln k in a step."""
RIM = 1e-6
"""Distance from the rim over the length of the interface below which a point is on it."""


class Well(Part):
    """A well that injects or withdraws fluid, or has a known pressure."""

    center: Center
    """Place of the well on the interface; on a surface a point, or one number for a line of wells across it."""
    rate: Annotated[float, Unit("m3/s")] | None = None
    """Volume of fluid that enters the interface per time, in 2D per metre of thickness of the bodies [m2/s]; negative
    where it leaves."""
    pressure: Annotated[float, Unit("Pa")] | None = None
    """Change of the pressure at the nearest point since the start, instead of a rate."""
    file: str | None = None
    """CSV file with time and rate instead of rate and history, linear in between; its header may give the units, as in
    `time (d), rate (L/min)`. The resolved case contains the numbers."""
    half_width: Length | None = None
    """Standard deviation of a Gaussian distribution of the rate; without it, at the nearest point."""
    history: History | None = None
    """Factor in time; without it rate or pressure are constant from the start."""

    @model_validator(mode="before")
    @classmethod
    def _from_file(cls, values: object, info: ValidationInfo) -> object:
        """Replace the file of a pumping record by a rate of 1 m3/s and its history."""
        if not isinstance(values, Mapping) or not isinstance(values.get("file"), str):
            return values
        for other in ("rate", "pressure", "history"):
            if values.get(other) is not None:
                raise ValueError(f"{other}: the file has the rate over time; remove {other}")
        times, rates = two_columns(Path((info.context or {}).get("directory") or ".", values["file"]), "time",
                                   ("s", "m3/s"), "rate")  # fmt: skip
        history = {"kind": "sampled", "times": times, "values": rates}
        return {**values, "file": None, "rate": 1.0, "history": history}

    @model_validator(mode="after")
    def _one_quantity(self) -> Well:
        if (self.rate is None) == (self.pressure is None):
            raise ValueError("rate, pressure: give one of them")
        if self.pressure is not None and self.half_width is not None:
            raise ValueError(
                f"half_width = {self.half_width:g}: a known pressure is that of one point; remove half_width, or give "
                "rate instead of pressure"
            )
        return self


class Diffusion(PorePressure):
    """Diffusion of the pore pressure along the interface, a permeable layer between tight bodies.

    beta phi dp/dt = div (k / eta grad p) + Q / b + epsilon d(ln theta)/dt, with the rate Q of wells per area and the
    state theta of the friction law. The field is the change of the pressure since the start plus `initial`. With the
    path s of slip and the effective normal stress s_e, which changes by D s_e since the start,
    k = [k_0 + (k_1 - k_0) (1 - exp(-s / L))] exp(-D s_e / s_k).
    """

    needs = frozenset({MOTION})
    source = "Rice (1992); Segall and Rice (1995); Zhu, Allison, Dunham and Yang (2020); SEAS benchmark BP6"
    example: ClassVar[str] = (
        '{ kind = "diffusion", permeability = 1e-13, viscosity = 1e-3, compressibility = 1e-8, porosity = 0.1, '
        "thickness = 1.0, wells = [{ center = 0.0, rate = 1.25e-6 }] }"
    )

    permeability: VaryingPermeability
    """k_0 of the layer at the start."""
    viscosity: Viscosity
    """eta of the fluid."""
    compressibility: Compressibility
    """beta of fluid and pores."""
    porosity: Fraction
    """phi of the layer."""
    thickness: Length
    """b of the permeable layer."""
    wells: list[Well] = []
    """Wells, an entry each."""
    initial: VaryingPressure = 0.0
    """Pressure at the start."""
    slid_permeability: VaryingPermeability | None = None
    """k_1: permeability after much slip."""
    slip_length: Length | None = None
    """L: slip in which the difference to it falls by a factor of e."""
    stress_scale: Strength | None = None
    """s_k: the permeability falls by a factor of e where the effective normal stress grows by it."""
    dilatancy: VaryingCoefficient = 0.0
    """epsilon: pores open by epsilon when theta falls by a factor of e, where slip accelerates."""
    rim: Literal["no_flux", "fixed"] = "no_flux"
    """Rim of the interface: `no_flux`, or `fixed` for the initial pressure."""

    @property
    def follows_motion(self) -> bool:
        opens = callable(self.dilatancy) or np.any(self.dilatancy)
        return bool(opens or self.slip_length is not None or self.stress_scale is not None)

    @model_validator(mode="after")
    def _both_of_slip(self) -> Diffusion:
        if (self.slid_permeability is None) != (self.slip_length is None):
            one, other = ("slid_permeability", "slip_length")[:: 1 if self.slip_length is None else -1]
            raise ValueError(
                f"{one}: the permeability follows slip from permeability to slid_permeability within slip_length; give "
                f"{other}, too, or remove {one}"
            )
        return self

    def bind(self, model: System, face: Interface, key: str) -> PressureAlong:
        if np.any(self.dilatancy):
            require_state(model, key)
        for number, well in enumerate(self.wells):
            _check_place(model, face, well, f"{key}.wells.{number}.center")
        return PressureAlong(self, model, face, key.split(".")[1])


def _check_place(model: System, face: Interface, well: Well, key: str) -> None:
    """Refuse a well that is not on the interface; collective.

    Raises
    ------
    CaseError
    """
    place = np.ravel(np.asarray(well.center, dtype=float))
    ranges = [(face.line.first, face.line.last)]
    if face.across is not None:
        deepest = parallel.largest(model.comm, float(face.across.max(initial=0.0)))
        ranges.append((0.0, deepest))
    for value, (first, last) in zip(place, ranges, strict=False):  # one number is a position along strike
        if not first <= value <= last:
            raise CaseError(
                f"{key} = {value:.6g} m: the well is off the interface, whose points are from {first:.6g} to "
                f"{last:.6g} m; move it onto the interface"
            )


class PressureAlong(Contribution):
    """The pressure of all points of an interface, on every rank.

    Attributes
    ----------
    along : Along
    injected : float
        Volume that wells of known rate have injected since this object was made, over the thickness of the layer [m2],
        in 2D per metre of thickness of the bodies [m].
    """

    adds = ("pore_pressure",)
    flows = True

    def __init__(self, table: Diffusion, model: System, face: Interface, name: str) -> None:
        self._face, self._table, self._comm = face, table, model.comm
        area, places = (on_all_ranks(model.comm, face, each) for each in (face.area, face.locations))
        self._fixed = np.zeros(face.total, dtype=bool)
        if table.rim == "fixed":
            for axis in places.reshape(face.total, -1).T:
                near = RIM * np.ptp(axis)
                self._fixed |= (axis <= axis.min() + near) | (axis >= axis.max() - near)
        strike = model.case.mesh.along_strike
        # No fluid beyond the ends of a fault that repeats along strike.
        porous = area if strike is None else area * (np.abs(places[:, 0]) <= strike.half_length)
        self._rates: list[tuple[Well, np.ndarray]] = []
        self._pressures: list[tuple[Well, np.ndarray]] = []
        for well in table.wells:
            away = distance(places, well.center)
            # All points of a line across a surface are the nearest ones of a center that is one number.
            nearest = away <= away.min() + RIM * np.ptp(places, axis=0).max()
            if well.pressure is not None:
                self._fixed |= nearest
                self._pressures.append((well, nearest.astype(float)))
            else:
                width = well.half_width
                share = porous * (nearest if width is None else np.exp(-0.5 * (away / width) ** 2))
                self._rates.append((well, share / share.sum()))
        self._dilatancy, self.is_aged = np.broadcast_to(table.dilatancy, len(face.plus)), bool(np.any(table.dilatancy))
        self._free = ~self._fixed[face.number]
        storage = table.compressibility * table.porosity
        self._per_age = self._dilatancy / storage  # Pa
        self.along = Along(model, face, name, storage, area, self._fixed)
        self.is_strained = table.slip_length is not None or table.stress_scale is not None
        permeability = np.broadcast_to(table.permeability, len(face.plus))
        self._mobility = on_all_ranks(model.comm, face, permeability / table.viscosity)
        self._growth = 0.0 if table.slid_permeability is None else table.slid_permeability / permeability - 1
        self.along.set_mobility(self._mobility)
        self._step: AlongStep | None = None
        self.injected = 0.0

    def _known(self, time: float) -> np.ndarray:
        """Return the change of the pressure at points of known pressure [Pa], zero elsewhere."""
        known = (share * (well.pressure or 0.0) * course(time, 0.0, well.history) for well, share in self._pressures)
        return sum(known, np.zeros(self._face.total))

    def _source(self, time: float) -> np.ndarray:
        """Return the volume that enters per time at each point, over the thickness of the layer."""
        rates = (share * (well.rate or 0.0) * course(time, 0.0, well.history) for well, share in self._rates)
        return sum(rates, np.zeros(self._face.total)) / self._table.thickness

    def memory(self) -> dict[str, np.ndarray]:
        change = self._known(0.0)[self._face.number][:, None]
        more = [*(["ageing"] if self.is_aged else []), *(STRAINS if self.is_strained else [])]
        return {"change": change, **{name: np.zeros_like(change) for name in more}}

    def permeability(self, slid: np.ndarray, pressed: np.ndarray) -> np.ndarray:
        """Return ln(k / k_0) after a path of slip [m] and a change of the effective stress [Pa], shape (n,)."""
        table, log = self._table, np.zeros(len(slid))
        if table.slip_length is not None:
            log += np.log1p(-self._growth * np.expm1(-slid / table.slip_length))
        if table.stress_scale is not None:
            log -= pressed / table.stress_scale
        return log

    def _ahead(self, memory: Mapping[str, np.ndarray], dt: float) -> np.ndarray:
        """Return the change of ln k from the begin of a step to its middle, extrapolated, shape (n, 1)."""
        return np.clip(0.5 * dt * memory["rate"], -FARTHEST, FARTHEST)

    def plan(self, memory: Mapping[str, np.ndarray], time: float, dt: float) -> None:
        self._step = None
        if dt > 0:
            face, values, steady = self._face, memory["change"], 0.0
            if self.is_aged:
                # The rate of the step before diffuses; what differs from it is added without diffusion (`_differs`).
                opened = self._dilatancy * face.area * memory["ageing"][:, 0]
                begin, steady = on_all_ranks(self._comm, face, np.column_stack([values, opened])).T
            else:
                begin = on_all_ranks(self._comm, face, values[:, 0])
            if self.is_strained:
                ahead = self.permeability(*(memory[name][:, 0] for name in STRAINS[:2])) + self._ahead(memory, dt)[:, 0]
                self.along.set_mobility(self._mobility * np.exp(on_all_ranks(self._comm, face, ahead)))
                self._doubt = np.abs(self._ahead(memory, dt)[:, 0])
            known = (self._known(time + dt) - self._known(time)) / dt
            self._step = self.along.step(begin, time, dt, self._source, known, steady)

    def values(self, memory: Mapping[str, np.ndarray], time: float, heating: Heating) -> dict[str, np.ndarray]:
        change = memory["change"][:, 0]
        if heating.elapsed > 0 and self._step is not None:
            change = self._step.at(heating.elapsed / self._step.length)[self._face.number] + self._differs(heating)
        return {"pore_pressure": self._initial + change}

    def _differs(self, heating: Heating) -> np.ndarray | float:
        """Return the pressure by the change of the state beyond that at the rate of the step before [Pa]."""
        if not self.is_aged:
            return 0.0
        return np.asarray(self._free * self._per_age * (heating.aged - heating.ageing * heating.elapsed))

    @property
    def _initial(self) -> np.ndarray:
        return np.broadcast_to(self._table.initial, len(self._face.plus))

    def advance(self, memory: Mapping[str, np.ndarray], time: float, heating: Heating) -> None:
        assert self._step is not None
        memory["change"][:, 0] = self._step.end[self._face.number] + self._differs(heating)
        if self.is_aged:
            memory["ageing"][:, 0] = heating.aged / heating.elapsed
        if self.is_strained:
            slid, pressed = (memory[name][:, 0] for name in STRAINS[:2])
            before = self.permeability(slid, pressed)
            slid += heating.slid
            pressed += heating.pressed
            memory["rate"][:, 0] = (self.permeability(slid, pressed) - before) / heating.elapsed
        self.injected += self._step.injected

    def uncertainty(self, heating: Heating) -> np.ndarray | float:
        return self.planned_error(heating) + np.abs(self._differs(heating))

    def planned_error(self, heating: Heating) -> np.ndarray | float:
        if self._step is None:
            return 0.0
        error = np.abs(self._step.error)[self._face.number]
        if self.is_strained:  # of the permeability at the begin
            error = error + np.abs(self._step.end - self._step.begin)[self._face.number] * self._doubt
        return np.asarray(error)
