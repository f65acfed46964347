"""All variables of a run."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ruptfx.input.fields import ACCUMULATED

FaultState = dict[str, np.ndarray]


@dataclass
class State:
    """All variables of a run.

    Attributes
    ----------
    time, step : float, int
        Time [s] of the displacement and number of steps done.
    displacement, velocity, force : ndarray, shape (nodes * components,)
        Velocity is half of `lag` behind the displacement; `force` is the internal force of the current step. Both are
        of the type `System.real`, floats in single precision; displacements are doubles.
    faults : dict of str to dict of ndarray
        Fields of every fault by name, `lag` behind the displacement.
    cracks : dict of ndarray
        Fields of cohesive facets, at the same time as those of the faults; empty without `[fracture]`.
    energy : dict of str to float
        Energies accumulated on this rank [J]: frictional_dissipation, fracture, damping, impact_loss ...; in finite
        sliding also that of each fault, ``"main.impact_loss"``.
    fields : dict of str to ndarray, shape (nodes * components,)
        Nodal fields of a stepper, such as an acceleration; created at its first step.
    numbers : dict of str to float
        Numbers of a stepper, the same on all ranks: the size of the next step (``dt``) if steps vary, its mode ...
    points : dict of str to dict of ndarray, shape (n,)
        Fields of points of a stepper, by fault.
    pairs : dict of ndarray, shape (n,)
        Frictional forces between colliding cells; empty without `[collisions]`.
    attached : dict of str to dict of ndarray
        Fields of attachments at their nodes, by name of the attachment.
    fluids : dict of str to dict of ndarray, shape (n, columns)
        Memory of the fields of interfaces, by fault: heat and pressure beside them, past power.
    memory : dict of ndarray
        State of materials with memory at the points of elements, by name of the body.
    wants_energies : bool
        True if energies are requested after the next step, which may then sum them on its way.
    lazy_bodies : bool
        True if displacement and velocity are not read before `steppers.sync_bodies`, so that steps may defer them.
    deferred : bool
        True if steps have deferred displacement and velocity: they are of an earlier time.
    """

    displacement: np.ndarray
    velocity: np.ndarray
    force: np.ndarray
    faults: dict[str, FaultState]
    time: float = 0.0
    step: int = 0
    energy: dict[str, float] = field(default_factory=lambda: dict.fromkeys(ACCUMULATED, 0.0))
    fields: dict[str, np.ndarray] = field(default_factory=dict)
    numbers: dict[str, float] = field(default_factory=dict)
    wants_energies: bool = False
    cracks: FaultState = field(default_factory=dict)
    points: dict[str, FaultState] = field(default_factory=dict)
    pairs: FaultState = field(default_factory=dict)
    attached: dict[str, FaultState] = field(default_factory=dict)
    fluids: dict[str, FaultState] = field(default_factory=dict)
    memory: FaultState = field(default_factory=dict)
    lazy_bodies: bool = False
    deferred: bool = False

    def add_energy(self, fault: str, name: str, energy: float) -> None:
        """Add an energy dissipated by a fault, points of this rank [J]."""
        for each in (name, f"{fault}.{name}"):
            if each in self.energy:
                self.energy[each] += energy

    @property
    def lag(self) -> float:
        """Time by which tractions and all other fields of the faults are behind the displacement [s].

        A step in explicit runs, else zero.
        """
        return self.numbers.get("lag", 0.0)

    @property
    def fault_time(self) -> float:
        """Time of the fields of the faults [s]; cheaper than `at_faults`."""
        return self.time - self.lag

    def at_faults(self) -> tuple[float, np.ndarray]:
        """Return the time of the fields of the faults [s], and the displacement at it."""
        return self.fault_time, self.displacement - self.lag * self.velocity if self.lag else self.displacement

    def at_velocity(self) -> tuple[float, np.ndarray]:
        """Return the time of the velocity [s], at which explicit steps balance energy, and the displacement at it."""
        half = 0.5 * self.lag
        return self.time - half, self.displacement - half * self.velocity if half else self.displacement
