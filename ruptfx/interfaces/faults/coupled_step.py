"""The explicit step of a fault whose points depend on each other, because they share bodies that move as one.

It is one of several sweeps over all points: a Jacobi iteration, the same for any partition. Its trial is the traction
of the last sweep plus the impedance times the velocity jump under it, in place of the initial traction and the jump
without contact (`ruptfx.laws.contact.forward_lagrange`).
"""

from __future__ import annotations

import numpy as np

from ruptfx.bodies.state import FaultState
from ruptfx.interfaces.faults.fault import Fault
from ruptfx.interfaces.faults.fault_step import FaultStep
from ruptfx.interfaces.faults.held_points import beside_diagonal
from ruptfx.interfaces.faults.points import Clock


class CoupledStep(FaultStep):
    """One sweep over the points of a fault; forces change, and velocities do not.

    Parameters
    ----------
    fault, clock, threshold :
        As of `FaultStep`.
    count : int
        Number of local degrees of freedom.

    Attributes
    ----------
    change, scale : float
        Largest change of a traction in the last sweep, and largest traction of this rank [Pa].
    """

    def __init__(self, fault: Fault, count: int, clock: Clock, threshold: float) -> None:
        super().__init__(fault, np.zeros(count), clock, threshold)
        self.change = self.scale = 0.0
        self._begun: FaultState = {}
        # Tractions that a sweep begins with, that the last one has found, and the one before.
        self._last = self._found = self._before = np.zeros(0), np.zeros((0, fault.tangents))

    def put_mobility(self, mobility: np.ndarray) -> None:
        """Set the impedances, 1 / (kick n . mobility n).

        Parameters
        ----------
        mobility : ndarray, shape (nodes, components)
            For both sides of every point the sum of its entries at the two nodes bounds the change of the velocity jump
            per impulse and area, of all points together [m2/kg or m3/kg].
        """
        face = self.fault.interface
        both = mobility[face.plus] + (0 if face.one_sided else mobility[face.minus])
        rows: np.ndarray = sum(face.rows[:, :, c] ** 2 * both[:, c, None] for c in range(both.shape[1]))
        rows = rows + beside_diagonal(np.einsum("ikc,ic,ilc->ikl", face.rows, both, face.rows))
        rows = np.maximum(rows, 1e-8 * rows.max(initial=1e-100))  # as `impedances` where both sides are driven
        z = 1 / (self.clock.kick * rows)
        self._code.put("normal_impedance", z[:, 0])
        self._code.put("shear_impedance", z[:, face.frame.shape[1] - face.tangents :])

    def opening_rate(self, state: FaultState, velocity: np.ndarray, is_first: bool) -> np.ndarray:
        """Return the opening rate of every point [m/s]: sweeps leave some also where all points stay closed."""
        return self.fault.interface.split(self.fault.interface.rate(velocity))[0]

    def tractions(self, state: FaultState) -> tuple[np.ndarray, np.ndarray]:
        """Return normal stress and shear traction of the last update [Pa], shapes (n,) and (n, tangents)."""
        return state["normal_stress"].copy(), self.fault.components(state, "shear_traction")

    def begin(self, state: FaultState, force: np.ndarray, time: float) -> None:
        """Add the forces of the tractions of the previous step beyond the driving stress at `time`."""
        self._begun = {name: state[name].copy() for name in self._code.names}
        self._last = self._found = normal, shear = self.tractions(state)
        fault = self.fault
        change = np.column_stack([fault.normal_stress_0 - normal, shear - fault.driving_shear(time)])
        self._exert(-change, force)

    def sweep(
        self, state: FaultState, displacement: np.ndarray, velocity: np.ndarray, force: np.ndarray, time: float
    ) -> None:
        """Compute the state from that at the beginning of the step; add the change of forces since the last sweep.

        Parameters
        ----------
        velocity : ndarray, shape (nodes * components,)
            Velocity under the tractions of the last sweep [m/s].

        Raises
        ------
        ProjectionError
            If a point has no admissible traction.
        """
        for name, values in self._begun.items():
            state[name][:] = values
        for name, values in zip(("normal_stress_0", "shear_traction_0"), self._last, strict=True):
            self._code.put(name, values)
        if self.fault.cohesion is not None:
            self._held = (np.maximum(-state["normal_stress"], 0.0), state["opening"].copy())
        self._update(state, displacement, velocity, force, time)
        before, self._before = self._last, self._found
        self._last = self._found = self.tractions(state)
        pairs = [(a.ravel(), b.ravel()) for a, b in zip(before, self._last, strict=True)]
        self.change = max(float(np.abs(b - a).max(initial=0.0)) for a, b in pairs)
        self.scale = max(float(np.abs(b).max(initial=0.0)) for _, b in pairs)

    def extrapolate(self, force: np.ndarray, part: float) -> None:
        """Continue the change of the tractions since the sweep before the last by a part of it, and add its forces."""
        more = [part * (now - then) for now, then in zip(self._found, self._before, strict=True)]
        self._last = self._found[0] + more[0], self._found[1] + more[1]
        self._exert(np.column_stack([more[0], -more[1]]), force)

    def _exert(self, traction: np.ndarray, force: np.ndarray) -> None:
        """Add J' W traction, with products and sums whose rounding does not depend on the number of points."""
        face = self.fault.interface
        rows = force.reshape(-1, face.frame.shape[2])
        for c in range(rows.shape[1]):
            added = face.weight * sum(face.rows[:, k, c] * traction[:, k] for k in range(traction.shape[1]))
            np.add.at(rows[:, c], face.plus, added)
            if not face.one_sided:
                np.subtract.at(rows[:, c], face.minus, added)

    def finish(self, state: FaultState, before: np.ndarray, velocity: np.ndarray, time: float) -> float:
        """Return the energy that friction dissipates in the step on this rank [J], and set `work`.

        What the last sweep leaves of the jumps is counted as slip, so that energies are balanced.

        Parameters
        ----------
        before, velocity : ndarray, shape (nodes * components,)
            Velocities before and after the step [m/s].
        """
        fault, face, moves = self.fault, self.fault.interface, self.clock.since > 0
        old, new = (fault.components(fields, "mean_slip_rate") for fields in (self._begun, state))
        load = fault.load(time)
        if fault.is_loaded:
            self._add_work(state, fault.load(time - self.clock.since), load, old * moves)
        missed = face.split(face.rate(velocity))[1] - new + (face.split(face.rate(before))[1] - old) * moves
        power = 0.5 * np.sum((fault.components(state, "shear_traction") - load) * missed, axis=1)
        return float(self._result[0]) + float((face.owned * face.weight) @ power) * self.clock.kick
