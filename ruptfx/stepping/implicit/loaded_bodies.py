"""Tractions of interfaces from their slip and the loads of linear bodies, by matrices computed once.

With k the stiffness of stuck interfaces in A and g_F = J A^-1 F the jump under the loads, bodies have the jump
g = g_F - S (t - k g) under tractions t; contact of compliance c has g = s + c t with the slip s. Hence
(S (1 - k c) + c) t = g_F - (1 - S k) s.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import lu_factor, lu_solve

from ruptfx.bodies.space.inside import CellBoxes, Inside
from ruptfx.platform import parallel
from ruptfx.platform.memory import refuse_shortage
from ruptfx.stepping.implicit import ConvergenceError
from ruptfx.stepping.implicit.compliance import Compliance, Jumps, norm
from ruptfx.stepping.implicit.condensed import blockwise_product, count_jumps
from ruptfx.stepping.implicit.receivers import Receivers, rows_of
from ruptfx.stepping.implicit.solvers import TOLERANCE

if TYPE_CHECKING:
    from ruptfx.interfaces.faults.fault import Fault
    from ruptfx.interfaces.mechanisms.system import System
    from ruptfx.stepping.implicit.equilibrium import Equilibrium

MATRICES = 6  # dense ones of all jump components, while that from slip to traction is computed
IMMOBILE = 1e-9  # compliance of a point over the largest one, below which its motion is prescribed


def time_of_loads(time: float, duration: float, act: Callable[[float], bool]) -> float:
    """Return the first of a time, its double and so on at which loads act [s]; collective if `act` is.

    It depends on the duration only where no load acts in it: products with the jump at this time must be bitwise the
    same in a run that is made longer.
    """
    while time < duration and not act(time):
        time *= 2
    return time


def matrix_bytes(model: System) -> int:
    """Return the largest memory of the dense matrices of a rank [bytes]."""
    return MATRICES * 8 * count_jumps(model) ** 2


def need_memory(model: System) -> None:
    """Refuse dense matrices that do not fit into the memory, before one is computed; collective.

    Raises
    ------
    RuptfxError
    """
    need, here = matrix_bytes(model), parallel.ranks_here(model.comm)
    refuse_shortage(
        model.comm, "stepper.kind = 'quasi_dynamic'", f"dense matrices of {count_jumps(model)} jump components",
        need * here, "use fewer ranks, twice the mesh.element_size, which takes a quarter in 2D and a sixteenth in 3D, "
        "or mesh.along_strike for a section that repeats along strike",
        f", {need / 1e9:.3g} GB for each of {here} ranks",
    )  # fmt: skip


class LoadedBodies:
    """Linear bodies in equilibrium with their loads and with elastic contact of known slip.

    Parameters
    ----------
    equilibrium : Equilibrium
    shear : slice
        Tangential components of a jump.
    time : float
        First time at which loads are compared with others [s]; see `time_of_loads`.

    Attributes
    ----------
    jumps : Jumps
    prescribed : ndarray of bool, shape (points,)
        True at points whose slip follows the motion of the bodies.
    """

    def __init__(self, equilibrium: Equilibrium, shear: slice, time: float) -> None:
        self._equilibrium, self._model = equilibrium, equilibrium.model
        self.jumps, self._normal = Jumps(self._model), ((0, 0), (shear.start, 0))
        jumps, faults = self.jumps, self._model.faults
        stuck = {
            fault.name: equilibrium.body_stiffness(fault.interface, None)[:, None, None] * np.eye(jumps.local)
            for fault in faults
        }
        bodies = Compliance(self._model, jumps, equilibrium.tangent, (0.0, 0.0), stuck)
        self.solve, self._stuck = bodies.solve, bodies.stuck
        size = jumps.points * jumps.local
        S = bodies.blocks.transpose(2, 0, 3, 1).reshape(size, size)
        k = np.diagonal(bodies.stuck, axis1=1, axis2=2).ravel()
        self._compliance = jumps.gather({fault.name: compliance(fault) for fault in faults})
        c = self._compliance.ravel()
        factors = lu_factor(S * (1 - k * c) + np.diag(c), overwrite_a=True)
        self._by_jump, by_slip = lu_solve(factors, np.eye(size)), lu_solve(factors, np.eye(size) - S * k)
        along = np.arange(size).reshape(jumps.points, jumps.local)[:, shear].ravel()  # slip has no normal component
        self._by_slip = np.ascontiguousarray(by_slip[:, along])
        own = np.diagonal(S).reshape(jumps.points, jumps.local)[:, shear]
        self.prescribed = np.any(own < IMMOBILE * own.max(), axis=1)
        model = self._model
        time = time_of_loads(
            time,
            model.case.duration,
            lambda t: parallel.anywhere(model.comm, any(bool(f.any()) for f in self._loads(t))),
        )
        self._reference = self._loads(time), self._jump_under(self._loads(time), time)

    def held(self, jump: np.ndarray) -> np.ndarray:
        """Return T - T_0 [Pa] without slip from `loaded_jump` [m], both of shape (points, local); it is linear."""
        return np.asarray((self._by_jump @ jump.ravel()).reshape(jump.shape))

    def traction(self, held: np.ndarray, slip: np.ndarray) -> np.ndarray:
        """Return T - T_0 [Pa], shape (points, local).

        Parameters
        ----------
        held : ndarray, shape (points, local)
            That without slip [Pa].
        slip : ndarray, shape (points, tangents)
            [m]
        """
        return np.asarray(held - (self._by_slip @ slip.ravel()).reshape(held.shape))

    def loaded_jump(self, time: float) -> np.ndarray:
        """Return the jump of bodies with stuck faults under the loads of a time, shape (points, local) [m]; collective.

        For proportional loads, such as plates with a constant velocity, it is a multiple of the jump at a reference
        time.
        """
        model, dot, (last, jump) = self._model, self._model.layout.owned_dot, self._reference
        loads = self._loads(time)
        products = [[dot(new, old), dot(old, old)] for new, old in zip(loads, last, strict=True)]
        along, square = max(parallel.total(model.comm, products), key=lambda pair: float(pair[1]))
        part = float(along / square) if square > 0 else 0.0
        same = all(np.allclose(new, part * old, 1e-12, 0.0) for new, old in zip(loads, last, strict=True))
        return self._jump_under(loads, time) if parallel.anywhere(model.comm, not same) else np.asarray(part * jump)

    def _loads(self, time: float) -> tuple[np.ndarray, np.ndarray]:
        """Return nodal forces [N] and the displacement of driven edges [m]."""
        moved = self._model.loads.moved(np.zeros(len(self._model.mass)), 0.0, time)
        return self._equilibrium.forces.load(time), moved

    def _jump_under(self, value: tuple[np.ndarray, np.ndarray], time: float) -> np.ndarray:
        """Return the jump of `loaded_jump` by a solution for the given loads."""
        moved = value[1]
        return self.jumps.of(self._balanced(moved, time, blockwise_product(self._stuck, self.jumps.of(moved))))

    def _balanced(self, u: np.ndarray, time: float, push: np.ndarray) -> np.ndarray:
        """Return the displacement in equilibrium with the loads of a time [m], from one with driven edges in place.

        Parameters
        ----------
        push : ndarray, shape (points, local)
            t - k (g - J u), with the tractions t and the jump g at the end [Pa].
        """
        force = self._equilibrium.forces.load(time) + self._model.internal_force(u)
        return np.asarray(u + self.solve(force - self.jumps.force(push, len(u))))

    def displacement(
        self, moved: np.ndarray, time: float, slip: np.ndarray, traction: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return displacement [m] and internal force [N] from slip and tractions; collective.

        Parameters
        ----------
        moved : ndarray, shape (nodes * components,)
            A displacement with driven edges in place [m].

        Raises
        ------
        ConvergenceError
            On all ranks: bodies out of balance.
        """
        jumps = self.jumps
        jump = np.pad(slip, self._normal) + self._compliance * traction
        u = self._balanced(moved, time, traction - blockwise_product(self._stuck, jump - jumps.of(moved)))
        internal = jumps.force(traction, len(u)) - self._model.internal_force(u)
        self._require_balance(u, internal, time)
        return u, internal

    def receivers(self, points: Sequence[Sequence[float]], key: str) -> Receivers:
        """Return receivers at points of the bodies [m], on one rank.

        Raises
        ------
        CaseError
            A point is outside of the bodies; the message begins with the key.
        """
        model, jumps, internal = self._model, self.jumps, self._model.internal_force
        boxes = CellBoxes.of(model)
        places = [Inside(model, point, None, key, boxes=boxes, first=True) for point in points]
        rows = rows_of(model, places)
        shape = rows.shape[:2]
        answers = np.array([self.solve(row) for row in rows.reshape(shape[0] * shape[1], -1)])
        pulls = np.array([(jumps.weight[:, None] * jumps.of(answer)).ravel() for answer in answers])
        nothing = np.zeros((jumps.points, jumps.local))

        def pulled(traction: np.ndarray, jump: np.ndarray) -> np.ndarray:
            push = traction - blockwise_product(self._stuck, jump)
            return np.asarray(-(pulls @ push.ravel()).reshape(shape))

        def by_loads(time: float) -> np.ndarray:
            load, moved = self._loads(time)
            traction = self.held(self.loaded_jump(time))
            answer = (answers @ (load + internal(moved))).reshape(shape) + rows @ moved
            return np.asarray(answer + pulled(traction, self._compliance * traction - jumps.of(moved)))

        def by_slip(slip: np.ndarray) -> np.ndarray:
            traction = self.traction(nothing, slip)
            return pulled(traction, np.pad(slip, self._normal) + self._compliance * traction)

        return Receivers(by_loads, by_slip, model.case.duration)

    def _require_balance(self, u: np.ndarray, internal: np.ndarray, time: float) -> None:
        """Check that free nodes are in equilibrium after two linear solves; collective."""
        model, load = self._model, self._equilibrium.forces.load(time)
        internal, load = model.layout.reduce_tied(internal), model.layout.reduce_tied(load)
        residual = np.where(model.loads.prescribed, 0.0, internal - load)
        remaining, *sizes = (norm(model, each) for each in (residual, internal, load))
        allowed = max(10 * TOLERANCE * max(sizes), self._equilibrium.rounding(u))
        if not remaining <= allowed:
            raise ConvergenceError(
                f"bodies are out of balance by {remaining:.3g} N of {max(sizes):.3g} N at time {time:.9g} s, "
                f"{allowed:.3g} N is allowed: their stiffness cannot be factorised well; let boundaries hold every "
                "body, or use stepper.kind = 'quasi_static'"
            )


def compliance(fault: Fault) -> np.ndarray:
    """Return the jump per traction of the contact [m/Pa], shape (n, local)."""
    normal, shear = (1 / each for each in fault.contact.stiffness())
    return np.tile([normal] * fault.interface.has_normal + [shear] * fault.tangents, (len(fault.interface.plus), 1))
