"""Fields of an interface and energies of a run: names, units and meaning, declared once.

The initial state, the steps, the interface file, checkpoints, reserved names of friction laws and figures read these
lists. A field derived from others is a `Monitor`: one entry with its formula, which acts on arrays and is traced
into the C code of explicit steps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, Protocol

import numpy as np


class Comparable(Protocol):
    """Comparisons of values at points, and logic of their results."""

    def __invert__(self) -> PointValues: ...
    def __and__(self, other: Any, /) -> PointValues: ...
    def __rand__(self, other: Any, /) -> PointValues: ...
    def __or__(self, other: Any, /) -> PointValues: ...
    def __ror__(self, other: Any, /) -> PointValues: ...
    def __lt__(self, other: Any, /) -> PointValues: ...
    def __le__(self, other: Any, /) -> PointValues: ...
    def __gt__(self, other: Any, /) -> PointValues: ...
    def __ge__(self, other: Any, /) -> PointValues: ...


class PointValues(Comparable, Protocol):
    """Values at all points of an interface: a NumPy array, or an expression while a formula is traced.

    It has what both have: arithmetic, comparisons, logic, and NumPy's pointwise functions. Lengths, indices, attributes
    and conversions to numbers are missing because a formula is traced before there are points.
    """

    def __array__(self) -> np.ndarray: ...
    def __array_ufunc__(self, ufunc: Any, method: Any, /, *inputs: Any, **options: Any) -> Any: ...
    def __neg__(self) -> PointValues: ...
    def __add__(self, other: Any, /) -> PointValues: ...
    def __radd__(self, other: Any, /) -> PointValues: ...
    def __sub__(self, other: Any, /) -> PointValues: ...
    def __rsub__(self, other: Any, /) -> PointValues: ...
    def __mul__(self, other: Any, /) -> PointValues: ...
    def __rmul__(self, other: Any, /) -> PointValues: ...
    def __truediv__(self, other: Any, /) -> PointValues: ...
    def __rtruediv__(self, other: Any, /) -> PointValues: ...
    def __pow__(self, other: Any, /) -> PointValues: ...
    def __rpow__(self, other: Any, /) -> PointValues: ...


Array = PointValues | float
"""Values at all points of an interface, a number for all of them, or a traced expression."""


@dataclass(frozen=True)
class Field:
    """A field of an interface.

    Attributes
    ----------
    name, unit, long_name : str
    tangential : bool
        One array per tangent: `slip` in 2D, `slip_1` and `slip_2` in 3D.
    recorded : bool
        True if it is in the interface file; checkpoints contain all fields.
    meanings : tuple of str
        Meanings of the values 0, 1, 2 ... of a state.
    """

    name: str
    unit: str
    long_name: str
    tangential: bool = False
    recorded: bool = True
    meanings: tuple[str, ...] = ()

    def names(self, tangents: int) -> list[str]:
        """Return the names of its arrays."""
        return component_names(self.name, tangents) if self.tangential else [self.name]


@dataclass(frozen=True)
class Moment:
    """Input of a monitor at every point: NumPy arrays, or traced expressions.

    Attributes
    ----------
    time, since : [s]
        Time of the traction, and time since the previous one.
    speed, speed_then : [m/s]
        Slip rate now and at the previous traction.
    normal_stress, normal_stress_then : [Pa]
        Normal stress now and at the previous traction.
    closed : bool
        True if the two sides touch or are cohesive.
    has_strength : [1]
        1 where opening is a rupture, 0 where the interface has no strength before the first step.
    power, duration : [W/m2], [s]
        Power of friction and its duration: their product is the energy dissipated since the last update.
    threshold : [m/s]
        `output.rupture_threshold`; infinite before `output.rupture_after`.
    held : bool
        True where slip is prescribed, whatever the normal stress is.
    """

    time: Array
    since: Array
    speed: Array
    speed_then: Array
    normal_stress: Array
    normal_stress_then: Array
    closed: Array
    has_strength: Array
    power: Array
    duration: Array
    threshold: Array
    held: Any = False


@dataclass(frozen=True)
class Monitor(Field):
    """A field derived from others in every step; the file has its last value at every point.

    Attributes
    ----------
    start : float
    update : callable
        New value from the old one and a `Moment`, in NumPy operations without branches on values.
    """

    start: float = 0.0
    update: Callable[[Array, Moment], Array] = lambda old, _: old


@dataclass(frozen=True)
class PointField:
    """A field that a mechanism has at the nodes on which it acts.

    Attributes
    ----------
    name, unit, long_name : str
    vector : bool
        One number per component of the displacement: `velocity_x`, `velocity_y`.
    start : float
        Value at the beginning of a run.
    recorded, checkpointed : bool
        Whether `attachments.h5` has it, and checkpoints; what is in none follows from the others.
    """

    name: str
    unit: str
    long_name: str
    vector: bool = False
    start: float = 0.0
    recorded: bool = True
    checkpointed: bool = True

    def names(self, components: int) -> list[str]:
        """Return the names of its numbers at a node."""
        axes = "z" if components == 1 else "xyz"[:components]
        return [f"{self.name}_{axis}" for axis in axes] if self.vector else [self.name]


@dataclass(frozen=True)
class Energy:
    """A column of the energy table [J, per metre of thickness in 2D].

    Attributes
    ----------
    name, meaning : str
    role : {"stored", "dissipated"}
        Stored energy may come back, dissipated energy does not.
    """

    name: str
    meaning: str
    role: Literal["stored", "dissipated"]


_NEVER = 1e300  # m/s


def _peak(old: Array, at: Moment) -> Array:
    # An opening compliant interface releases its traction within one step, which is no sliding.
    return np.maximum(old, np.where((at.normal_stress > 0) | at.held, at.speed, 0.0))


def _work(old: Array, at: Moment) -> Array:
    return old + at.power * at.duration


def _first_rupture(old: Array, at: Moment) -> Array:
    """Return the rupture time: sliding of closed points, or opening of points that were closed.

    Where the interface has no strength from the start, as at the surface of the Earth, waves far below the threshold
    open it: only sliding counts there.
    """
    beyond, rise = at.speed - at.threshold, at.speed - at.speed_then
    part = np.where(at.speed_then < at.threshold, beyond / np.where(rise > 0, rise, 1.0), 0.0)
    slipped = np.where(beyond > 0, at.time - at.since * part, np.nan)
    opens = (at.normal_stress_then != 0) & (at.has_strength > 0) & (at.threshold < _NEVER)
    opened = np.where(opens, at.time, np.nan)
    return np.where(old != old, np.where(at.closed, slipped, opened), old)


FIELDS = (
    Field("normal_stress", "Pa", "normal stress, positive in compression"),
    Field("opening", "m", "opening"),
    Field("slip", "m", "slip", tangential=True),
    Field("slip_rate", "m/s", "slip rate", tangential=True),
    Field("mean_slip_rate", "m/s", "mean slip rate of a step, which updates slip", True, recorded=False),
    Field("shear_traction", "Pa", "shear traction", tangential=True),
)
INTERFACE_FIELDS = {field.name: field for field in (
    Field("pore_pressure", "Pa", "pore pressure"),
    Field("pore_pressure_rate", "Pa/s", "rate of the pore pressure over a step"),
    Field("temperature", "K", "temperature"),
    Field("temperature_rate", "K/s", "rate of the temperature over a step"),
    Field("frictional_heat", "J/m2", "heat of friction per area since the start"),
)}  # fmt: skip
"""Fields of an interface beside contact, friction and cohesion, which friction laws have among their states."""
DERIVED = (Field("displacement_jump", "m", "tangential displacement jump", tangential=True),)
"""Fields of the file that are not in the state."""
OF_SLIDING = (
    Field("contact", "1", "state of contact", meanings=("open", "sticking", "sliding", "uncovered")),
    Field("paired_position", "m", "initial position along the opposite surface of the point paired with this one"),
    *(Field(f"deformed_{axis}", "m", f"{axis} of the point, displaced") for axis in "xyz"),
    *(Field(f"paired_{axis}", "m", f"{axis} of the paired point of the opposite surface, displaced") for axis in "xyz"),
)
"""Fields of the file in finite sliding, z in solids; NaN at unpaired points."""
MONITORS = (
    Monitor("peak_slip_rate", "m/s", "largest slip rate of all steps while closed", update=_peak),
    Monitor(
        "rupture_time", "s",
        "first time the slip rate passed rupture_threshold while closed, linear between steps, or a contact opened",
        start=np.nan, update=_first_rupture,
    ),
    Monitor("friction_work", "J/m2", "work of friction per area in all steps", update=_work),
)  # fmt: skip

ADDED_SHEAR = Field(
    "added_shear",
    "Pa",
    "shear traction that nucleations have added since the start, at the last record",
    tangential=True,
)
"""Only of interfaces with such a nucleation, one number for every point."""

PLACE = {
    "position": ("m", "position along the interface"), "dip": ("m", "distance down dip, from the upper edge"),
    "area": ("m2", "area of the surface that the point stands for"),
    **{name: ("Pa", f"shear modulus {text}, harmonic mean of both sides") for name, text in {
        "shear_modulus": "in the direction of slip", "shear_modulus_11": "of slip along the first tangent",
        "shear_modulus_22": "of slip along the second tangent", "shear_modulus_12": "that couples both tangents",
    }.items()},
    "c_p": ("m/s", "longitudinal wave speed along the interface, of the side with the slower shear waves"),
    "c_s": ("m/s", "shear wave speed along the interface, of the side where it is slower"),
    "c_R": ("m/s", "Rayleigh wave speed along the interface, of the side with the slower shear waves"),
    "c_s_dip": ("m/s", "shear wave speed along the second tangent, of the side where it is slower"),
    "fastest_wave": ("m/s", "largest wave speed of both sides"),
}  # fmt: skip
"""Units and meanings of what does not change at the points, besides x, y and z."""
ENERGIES = {
    "kinetic": "kinetic energy", "strain": "strain energy",
    "interface_elastic": "elastic energy of compliant interfaces",
    "frictional_dissipation": "frictional dissipation", "fracture": "fracture energy dissipated by cracks",
    "damping": "energy dissipated by damping",
    "impact_loss": "energy lost in plastic impacts, and by freezing the mortar pairing between updates",
    "collisions": "elastic energy of contact between non-neighbouring cells, [collisions]",
    "collision_loss": "error of finite steps in that contact, and energy of facet springs that it replaces",
    "pairing_update_loss": "energy removed from contact springs by updates of the mortar pairing",
    "rotation_error": "error of finite steps in rotating bodies: work of their forces minus change of their energies",
    "boundary_work": "work of boundaries, initial stress and nucleation, and initial kinetic energy",
}  # fmt: skip
"""Columns of the energy table [J, per metre of thickness in 2D]; the last is the sum of the others."""
KEPT = ("collisions", "rotation_error")
"""Of `ACCUMULATED`: what mechanisms keep from step to step and is no column by itself."""
ACCUMULATED = (
    "frictional_dissipation", "fracture", "damping", "impact_loss", "collisions", "collision_loss",
    "pairing_update_loss", "rotation_error", "boundary_work",
)  # fmt: skip
"""Energies accumulated or stored by steps."""
PRESCRIBED = "prescribed_slip"
"""Column of the energy table of cases with prescribed slip."""
OF_BODIES = "force_of_bodies"
"""Nodal field of explicit steps with large rotations: force of cells, facets and supports [N]."""
OF_COLLISIONS, OF_VISCOSITY = "force_of_collisions", "force_of_viscosity"
"""Nodal fields of explicit steps with large rotations: forces with an energy balance of their own [N]."""
TAKEN_IN_SLIDING = ("frictional_dissipation", "impact_loss", "pairing_update_loss")
"""Those that are also recorded for each interface with finite sliding."""


STRESSES = {
    1: {"xz": (0, 0), "yz": (1, 0)},
    2: {"xx": (0, 0), "yy": (1, 1), "xy": (0, 1)},
    3: {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xy": (0, 1), "yz": (1, 2), "xz": (0, 2)},
}
"""Stresses and strains in files, by number of displacement components; in antiplane axis and component."""


def extensive_unit(unit: str, plane: str) -> str:
    """Return the unit of a sum over the bodies in J or N: per metre of thickness in a plane, but around an axis."""
    return unit if plane in ("solid", "axisymmetric") else f"{unit}/m"


def stress_entries(plane: str, components: int) -> dict[str, tuple[int, int]]:
    """Return the stresses and strains in files, by name; in axisymmetric bodies zz (hoop) is last."""
    return STRESSES[components] | ({"zz": (2, 2)} if plane == "axisymmetric" else {})


def component_names(name: str, tangents: int) -> list[str]:
    """Return `slip` in 2D; `slip_1`, `slip_2` in 3D."""
    return [name] if tangents == 1 else [f"{name}_{k + 1}" for k in range(tangents)]


def fields_of_sliding(dim: int) -> tuple[Field, ...]:
    """Return `OF_SLIDING` in a plane or in space."""
    return tuple(field for field in OF_SLIDING if dim == 3 or not field.name.endswith("_z"))


def reserved_names() -> frozenset[str]:
    """Return every name used by an interface and its file, for any number of tangents."""
    fields = (*FIELDS, *DERIVED, *OF_SLIDING, *MONITORS, ADDED_SHEAR)
    return frozenset(name for field in fields for tangents in (1, 2) for name in field.names(tangents)) | set(PLACE)
