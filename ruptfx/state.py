"""Everything that changes during a run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ruptfx.fields import ACCUMULATED

FaultState = dict[str, np.ndarray]


@dataclass
class State:
    """Everything that changes during a run.

    Attributes
    ----------
    time, step : float, int
        Time [s] of the displacement and number of steps done.
    displacement, velocity, force : ndarray, shape (nodes * components,)
        Velocity is half of `lag` behind the displacement; `force` is internal force under way.
    faults : dict of str to dict of ndarray
        Fields of every fault by name, `lag` behind the displacement.
    cracks : dict of ndarray
        Fields of the facets that may break, at the same time as those of the faults; empty where none may.
    energy : dict of str to float
        Energies accumulated on this rank [J]: frictional_dissipation, fracture, damping, impact, facing,
        boundary_work; of faults that slide also what each took, ``"main.impact"``.
    fields : dict of str to ndarray, shape (nodes * components,)
        Nodal fields that a stepper carries from step to step, such as an acceleration; made at its first step.
    numbers : dict of str to float
        Numbers it carries, the same on all ranks: the size of the next step (``dt``) where steps vary, its mode ...
    points : dict of str to dict of ndarray, shape (n,)
        Fields of points that it carries, by fault.
    pairs : dict of ndarray, shape (n,)
        What friction holds between cells that collide; empty where none may.
    watched : bool
        Whether energies will be asked for after the next step, which may then sum them on its way.
    unseen : bool
        Whether nobody looks at displacement and velocity after a step before `catch_up`, so that they may wait.
    behind : callable, state -> None, optional
        Brings them up to date where they wait.
    """

    displacement: np.ndarray
    velocity: np.ndarray
    force: np.ndarray
    faults: dict[str, FaultState]
    time: float = 0.0
    step: int = 0
    energy: dict[str, float] = field(
        default_factory=lambda: dict.fromkeys(ACCUMULATED, 0.0)
    )
    fields: dict[str, np.ndarray] = field(default_factory=dict)
    numbers: dict[str, float] = field(default_factory=dict)
    watched: bool = False
    cracks: FaultState = field(default_factory=dict)
    points: dict[str, FaultState] = field(default_factory=dict)
    pairs: FaultState = field(default_factory=dict)
    unseen: bool = False
    behind: Callable[[State], None] | None = field(default=None, repr=False)

    def take(self, fault: str, name: str, energy: float) -> None:
        """Add an energy that a fault took, points of this rank [J]."""
        for each in (name, f"{fault}.{name}"):
            if each in self.energy:
                self.energy[each] += energy

    def catch_up(self) -> None:
        """Bring displacement and velocity to `time` where the steps left that for later; collective."""
        behind, self.behind = self.behind, None
        if behind is not None:
            behind(self)

    @property
    def lag(self) -> float:
        """Time by which tractions and all other fields of the faults are behind the displacement [s].

        A step in explicit runs, else zero.
        """
        return self.numbers.get("lag", 0.0)

    @property
    def fault_time(self) -> float:
        """Time of the fields of the faults [s]; every step asks for it, so without the displacement then."""
        return self.time - self.lag

    def at_faults(self) -> tuple[float, np.ndarray]:
        """Time of the fields of the faults [s], and the displacement then."""
        return self.fault_time, self.displacement - self.lag * self.velocity if self.lag else self.displacement

    def at_velocity(self) -> tuple[float, np.ndarray]:
        """Time of the velocity [s], where explicit steps balance energy, and the displacement then."""
        half = 0.5 * self.lag
        return self.time - half, self.displacement - half * self.velocity if half else self.displacement
