"""What an interface carries and what a run accounts for: names, units and meaning, declared once.

The initial state, the steps, the interface file, checkpoints, reserved names of friction laws and figures read these
lists. A field that follows from others is a `Monitor`: one entry with its formula, which acts on arrays and is traced
into the C code of explicit steps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

Array = Any
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
        Whether the interface file has it; checkpoints have all.
    meanings : tuple of str
        Of the values 0, 1, 2 ... where it is a state and no quantity.
    """

    name: str
    unit: str
    long_name: str
    tangential: bool = False
    recorded: bool = True
    meanings: tuple[str, ...] = ()

    def names(self, tangents: int) -> list[str]:
        """Of its arrays."""
        return component_names(self.name, tangents) if self.tangential else [self.name]


@dataclass(frozen=True)
class Moment:
    """What a monitor may use, at every point: NumPy arrays, or traced expressions.

    Attributes
    ----------
    time, since : [s]
        Of the traction, and since the one before.
    speed, speed_then : [m/s]
        Slip rate now and at the traction before.
    normal_stress, normal_stress_then : [Pa]
        Now and at the traction before.
    closed : bool
        Whether the two sides touch, or cohesion holds them.
    power, duration : [W/m2], [s]
        Of friction, and how long: their product is what friction took since the last update.
    threshold : [m/s]
        `output.rupture_threshold`; infinite before `output.rupture_after`.
    """

    time: Array
    since: Array
    speed: Array
    speed_then: Array
    normal_stress: Array
    normal_stress_then: Array
    closed: Array
    power: Array
    duration: Array
    threshold: Array


@dataclass(frozen=True)
class Monitor(Field):
    """A field that follows from the others, step by step; the file has its last value at every point.

    Attributes
    ----------
    start : float
    update : callable
        New value from the old one and a `Moment`, in NumPy operations without branches on values.
    """

    start: float = 0.0
    update: Callable[[Array, Moment], Array] = lambda old, _: old


_NEVER = 1e300  # m/s


def _peak(old: Array, at: Moment) -> Array:
    # Where it opens a compliant interface lets its traction go within one step: not a rate of sliding.
    return np.maximum(old, np.where(at.normal_stress > 0, at.speed, 0.0))


def _work(old: Array, at: Moment) -> Array:
    return old + at.power * at.duration


def _first_rupture(old: Array, at: Moment) -> Array:
    """Sides that have not met move past each other without a rupture; what held is ruptured when it opens."""
    beyond, rise = at.speed - at.threshold, at.speed - at.speed_then
    part = np.where(at.speed_then < at.threshold, beyond / np.where(rise > 0, rise, 1.0), 0.0)
    slipped = np.where(beyond > 0, at.time - at.since * part, np.nan)
    opened = np.where((at.normal_stress_then != 0) & (at.threshold < _NEVER), at.time, np.nan)
    return np.where(old != old, np.where(at.closed, slipped, opened), old)


FIELDS = (
    Field("normal_stress", "Pa", "normal stress, positive in compression"),
    Field("opening", "m", "opening"),
    Field("slip", "m", "slip", tangential=True),
    Field("slip_rate", "m/s", "slip rate", tangential=True),
    Field("mean_slip_rate", "m/s", "mean slip rate of a step, which slip is advanced with", True, recorded=False),
    Field("shear_traction", "Pa", "shear traction", tangential=True),
)
DERIVED = (Field("displacement_jump", "m", "tangential displacement jump", tangential=True),)
"""Not of the state, but of the file."""
OF_SLIDING = (
    Field("contact", "1", "state of contact", meanings=("open", "sticking", "sliding", "uncovered")),
    Field("facing_position", "m", "position on the facing surface, where nothing has moved, of what a point faces"),
    Field("deformed_x", "m", "x of the point, displaced"),
    Field("deformed_y", "m", "y of the point, displaced"),
    Field("facing_x", "m", "x of what the point faces, displaced"),
    Field("facing_y", "m", "y of what the point faces, displaced"),
)
"""Of the file, of interfaces that slide; what is missing where nothing is faced is NaN."""
MONITORS = (
    Monitor("peak_slip_rate", "m/s", "largest slip rate of all steps while closed", update=_peak),
    Monitor(
        "rupture_time", "s",
        "first time the slip rate passed rupture_threshold while closed, linear between steps, or a contact opened",
        start=np.nan, update=_first_rupture,
    ),
    Monitor("friction_work", "J/m2", "work of friction per area in all steps", update=_work),
)  # fmt: skip

ENERGIES = {
    "kinetic": "kinetic energy", "strain": "strain energy", "interface_elastic": "energy held in compliant interfaces",
    "frictional_dissipation": "frictional dissipation", "fracture": "taken by cracks until they have failed",
    "damping": "taken by damping",
    "impact": "taken by plastic impacts, and by the work of the normal stress where what is faced is frozen",
    "collisions": "energy held where pieces meet that were no neighbours, [collisions]",
    "collision_loss": "taken there by the finite step, and when facets are handed over",
    "facing": "taken from springs in contact when what they face is found again",
    "turning": "taken by the finite step where bodies turn: work of their forces beyond their energies",
    "boundary_work": "work of boundaries, initial stress and nucleation, and what bodies that fly begin with",
}  # fmt: skip
"""Columns of the energy table [J, per metre of thickness in 2D]; the last is what the others make up."""
ACCUMULATED = (
    "frictional_dissipation", "fracture", "damping", "impact", "collisions", "collision_loss", "facing", "turning",
    "boundary_work",
)  # fmt: skip
"""Energies that steps add up or keep."""
OF_BODIES = "force_of_bodies"
"""Nodal field that explicit steps carry where rotations are large: of cells, facets and supports [N]."""
TAKEN_IN_SLIDING = ("frictional_dissipation", "impact", "facing")
"""Those of them that are also known of each interface that slides."""


STRESSES = {
    1: {"xz": (0, 0), "yz": (1, 0)},
    2: {"xx": (0, 0), "yy": (1, 1), "xy": (0, 1)},
    3: {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xy": (0, 1), "yz": (1, 2), "xz": (0, 2)},
}
"""Stresses and strains that files have, by the components of the displacement; in antiplane axis and component."""


def stress_entries(plane: str, components: int) -> dict[str, tuple[int, int]]:
    """Stresses and strains that files have, by name; in bodies of revolution zz, which goes round the axis, is last."""
    return STRESSES[components] | ({"zz": (2, 2)} if plane == "axisymmetric" else {})


def component_names(name: str, tangents: int) -> list[str]:
    """`slip` in 2D; `slip_1`, `slip_2` in 3D."""
    return [name] if tangents == 1 else [f"{name}_{k + 1}" for k in range(tangents)]


def reserved_names() -> frozenset[str]:
    """Every name that an interface and its file use, for any number of tangents."""
    fields = (*FIELDS, *DERIVED, *OF_SLIDING, *MONITORS)
    return frozenset(name for field in fields for tangents in (1, 2) for name in field.names(tangents))
