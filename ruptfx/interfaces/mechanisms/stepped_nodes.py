"""The nodes that an explicit stepper advances itself, because a mechanism acts on them or ranks share them.

All other nodes are advanced inside the sweep of the bulk kernel (`FusedOperator`).
"""

from __future__ import annotations

import ctypes
from importlib.resources import files
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ruptfx.interfaces.faults.points import Clock
from ruptfx.interfaces.mechanisms import Floats
from ruptfx.platform.codegen import native
from ruptfx.platform.codegen.native import address

if TYPE_CHECKING:
    from ruptfx.bodies.operators import Damped
    from ruptfx.bodies.state import State
    from ruptfx.interfaces.mechanisms.system import System

Integers = NDArray[np.int64]


def masses_and_dashpots(model: System) -> tuple[Floats, Floats]:
    """Return mass [kg] and damping force per velocity [N s/m] of every degree of freedom, sums for tied ones."""
    mass, dashpot = model.mass.copy(), model.case.damping.mass * model.mass
    dashpot += model.loads.dashpot
    for values in (mass, dashpot):
        model.layout.sum_tied(values)
    return mass, dashpot


class Kick:
    """The change of velocities by forces in step 0, in step 1, or in any later step (number 2).

    Attributes
    ----------
    number : int
    clock : Clock
    keep, push : ndarray, shape (stepped degrees of freedom,)
        v = keep v_before + push force.
    plain_keep, plain_push, plain_loss, plain_mass : float, ndarray of shape (nodes,), float, float
        For the nodes that the kernel advances, whose only damping is that of the mass: factor of the old velocity; push
        over the time step; loss per sum of squares that the kernel returns; and the mass times `plain_push`.
    """

    def __init__(self, model: System, dofs: Integers, dt: float, number: int, mass: Floats, dashpot: Floats) -> None:
        self.number, self.clock = number, Clock.of_step(dt, number)
        length, rate = self.clock.kick, model.case.damping.mass
        self.keep, self.push = np.empty(len(dofs)), np.empty(len(dofs))
        self.renew(slice(None), mass[dofs], dashpot[dofs], model.loads.prescribed[dofs])
        lost = 0.5 * length * rate
        self.plain_keep, self.plain_loss = (1 - lost) / (1 + lost), 2 * lost / (1 + lost) * length / dt
        nodal = np.ascontiguousarray(1 / mass.reshape(-1, model.components)[:, 0])
        self.plain_mass = length / dt / (1 + lost)
        self.plain_push = (self.plain_mass * nodal).astype(model.real, copy=False)

    def renew(self, places: Integers | slice, mass: Floats, dashpot: Floats, prescribed: NDArray[np.bool_]) -> None:
        """Set `keep` and `push` at some of the stepped degrees of freedom."""
        decay = 0.5 * self.clock.kick * dashpot
        effective = 1 / (mass + decay)
        self.keep[places] = np.where(prescribed, 0.0, (mass - decay) * effective)
        self.push[places] = np.where(prescribed, 0.0, self.clock.kick * effective)


class SteppedNodes:
    """Arrays and updates of the stepped degrees of freedom; the update is compiled, `stepped_nodes.c`.

    Parameters
    ----------
    nodes : ndarray of bool, shape (nodes,)
    dt : float
        [s]
    rounds_as_kernel, damped :
        As of `Mechanism`.

    Attributes
    ----------
    dofs : ndarray of int, shape (n,)
        Stepped degrees of freedom.
    index : ndarray of int or slice
        The same; a slice where they are all.
    mass, dashpot, driven : ndarray, shape (n,)
        [kg], [N s/m], and 1 where the motion is prescribed.
    owned, once : ndarray, shape (n,)
        1 where this rank counts a degree of freedom in sums: `owned` for quantities of each node (forces), `once`
        for quantities that tied nodes share (mass).
    velocity_before : ndarray, shape (n,)
        Before the last kick [m/s].
    kicks : list of Kick
    only : ndarray of int, optional
        Of the stepped ones those that `kick` and `drift` update now; a mechanism advances the others.
    """

    def __init__(
        self, model: System, nodes: NDArray[np.bool_], dt: float, rounds_as_kernel: bool, damped: Damped | None
    ) -> None:
        self.model, self.dt, self.damped = model, dt, damped
        self.dofs = dofs = np.flatnonzero(np.repeat(nodes, model.components)).astype(np.int64)
        self.index: Integers | slice = slice(None) if nodes.all() else dofs
        mass, dashpot = masses_and_dashpots(model)
        self.mass, self.dashpot, self.driven = mass[dofs], dashpot[dofs], model.loads.prescribed[dofs].astype(float)
        self.owned = (dofs < model.owned_nodes * model.components).astype(float)
        self.once = np.repeat(model.layout.once, model.components)[dofs].astype(float)
        self.velocity_before = np.zeros(len(dofs))
        self.only: Integers | None = None
        self.kicks = [Kick(model, dofs, dt, number, mass, dashpot) for number in range(3)]
        self.kicks[2].plain_push = self.kicks[1].plain_push  # equally long: one vector over all nodes serves both
        self._alike = int(rounds_as_kernel and all(kick.plain_keep == 1 for kick in self.kicks))
        if rounds_as_kernel:
            plain = ~model.loads.acting[dofs]
            for kick in self.kicks:
                kick.keep[plain] = kick.plain_keep
                kick.push[plain] = dt * kick.plain_push[dofs[plain] // model.components]
        self._special, self._work = self._damped_or_driven(), np.zeros(2)
        parts = ("platform/codegen/lanes.c", "interfaces/mechanisms/stepped_nodes.c")
        source = "".join(files("ruptfx").joinpath(part).read_text() for part in parts)
        self._real = model.real
        self._library = native.load("stepped_nodes", source, {"REAL": native.c_type(self._real)})
        self._library.damping_power.restype = ctypes.c_double

    def inverse_mass(self, kick: Kick) -> Floats:
        """Return the velocity per impulse of every degree of freedom in contact [1/kg], shape (nodes * components,).

        The mass includes dashpots; it is zero where the motion is prescribed.
        """
        inverse, dashpot = masses_and_dashpots(self.model)
        dashpot *= 0.5 * kick.clock.kick
        inverse += dashpot
        np.divide(1, inverse, out=inverse)
        inverse[self.model.loads.prescribed] = 0.0
        return inverse

    def among(self, dofs: Integers) -> Integers:
        """Return the indices of some of the stepped degrees of freedom in the arrays of this class."""
        return np.searchsorted(self.dofs, dofs)

    def renew(self, places: Integers, mass: Floats, dashpot: Floats, driven: NDArray[np.bool_]) -> None:
        """Replace mass, dashpots and prescribed motion at some indices of the arrays of this class."""
        self.mass[places], self.dashpot[places], self.driven[places] = mass, dashpot, driven
        if driven.any() or dashpot.any():
            self._special = self._damped_or_driven()
        for kick in self.kicks:
            kick.renew(places, mass, dashpot, driven)

    def kick(self, state: State, kick: Kick) -> None:
        """Let the forces of `state` act on the velocities, and keep the velocities before."""
        self._library.kick(
            *self._which(), ctypes.c_long(self._alike), address(kick.keep), address(kick.push),
            address(state.force, self._real), address(state.velocity, self._real), address(self.velocity_before),
        )  # fmt: skip

    def drift(self, state: State, kick: Kick) -> tuple[float, float]:
        """Move displacements on and clear the forces; return dashpot loss and work of prescribed motion [J]."""
        self._work[:] = 0
        self._library.drift(
            *self._which(), ctypes.c_long(len(self._special)), address(self._special), ctypes.c_double(self.dt),
            ctypes.c_double(kick.clock.kick),
            *map(address, (self.mass, self.dashpot, self.driven, self.once, self.velocity_before)),
            address(state.velocity, self._real), address(state.displacement), address(state.force, self._real),
            address(self._work),
        )  # fmt: skip
        return float(self._work[0]), float(self._work[1])

    def clear(self, dofs: Integers, damping: Floats) -> None:
        """Set damping forces at some degrees of freedom to zero; both arrays of this call are over all nodes."""
        self._library.clear(ctypes.c_long(len(dofs)), address(dofs), address(damping))

    def add_damping(self, dofs: Integers, eta: float, damping: Floats, force: Floats) -> None:
        """Multiply damping forces at some degrees of freedom by eta, and add them to the force."""
        self._library.add_damping(
            ctypes.c_long(len(dofs)), address(dofs), ctypes.c_double(eta), address(damping), address(force, self._real)
        )  # fmt: skip

    def damping_power(
        self, dofs: Integers, damping: Floats, velocity: Floats, before: Floats, among: Integers
    ) -> float:  # fmt: skip
        """Return the power of damping forces at the mean of the velocities before and after the kick [W].

        Parameters
        ----------
        dofs : ndarray of int, shape (n,)
        damping, velocity : ndarray, shape (nodes * components,)
            [N] and [m/s]
        before : ndarray
            Velocity before the kick, such as `velocity_before` [m/s].
        among : ndarray of int, shape (n,)
            Indices of the degrees of freedom in `before`.
        """
        return float(self._library.damping_power(
            ctypes.c_long(len(dofs)), *map(address, (dofs, among, damping, before)), address(velocity, self._real)
        ))  # fmt: skip

    def _which(self) -> tuple[ctypes.c_long, ctypes.c_void_p, ctypes.c_void_p]:
        only = self.only
        count = ctypes.c_long(len(self.dofs if only is None else only))
        return count, address(only), address(None if isinstance(self.index, slice) else self.dofs)

    def _damped_or_driven(self) -> Integers:
        """Return the indices in the arrays of this class at which dashpots or prescribed motion do work."""
        return np.flatnonzero((self.dashpot != 0) | (self.driven != 0)).astype(np.int64)
