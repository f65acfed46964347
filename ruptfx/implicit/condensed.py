"""Implicit steps of linear bodies: only the interfaces are not, and Newton's iteration is done there alone.

At a displacement u with the jump g and out of balance by R, the correction d that balances all forces solves

    A d = -R - J' W q,    q(e) = t(g + e) - t(g) - k e,    e = J d

with A = K + c_M M + c_C C + J' W k J as if interfaces were closed and stuck, whose factors are kept (`compliance`), and
tractions t. Hence e + S W q(e) = -J A^-1 R, a system for the jumps e alone, solved with the exact tangents of t; then
d takes one back substitution. Where R is at the interfaces only, as in quasi-static steps that go on as before,
J A^-1 R is S times it; where waves get only so far in a step, it takes one of a strip along the interfaces; elsewhere
one of all. Bodies being linear, u + d is the equilibrium but for rounding;
the residual of the whole system decides, and is brought down once more if it must be. Multipliers are iterated at the
interfaces, too.

Newton's linear systems (1 + S D) de = b, D = dq/de, are factorised where they are small; larger ones are solved by
GMRES, preconditioned by their diagonal or, where that is too slow, by the factors of an iteration before.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from scipy.linalg import lu_factor, lu_solve

from ruptfx import parallel
from ruptfx.implicit.compliance import Compliance, Influence, Jumps, norm
from ruptfx.implicit.solvers import MAX_NEWTON, TOLERANCE, is_factorised
from ruptfx.implicit.step import MAX_OUTER, Step
from ruptfx.implicit.surfaces import FacingCompliance, Surfaces, SurfaceStiffness, count_nodes
from ruptfx.implicit.tangent import Tangent
from ruptfx.operators.assembled import is_linear
from ruptfx.projection import ProjectionError
from ruptfx.schema import CaseError
from ruptfx.sliding.interface import SlidingInterface

if TYPE_CHECKING:
    from ruptfx.model import Model

Value = TypeVar("Value")
Kept = TypeVar("Kept")

MOST_UNKNOWNS = 4000  # of all jumps, of all surfaces where some slide: their matrices are dense
KEPT = 4  # factorisations
MAX_CORRECTIONS = 4
MAX_HALVINGS = 12
FAST = 0.1  # part of what is missing that is left after an iteration that is worth while below the tolerance
STALLING, MAX_STALLED = 0.9, 2  # part of what is missing that is left after an iteration, so often in a row
SMALL = 200  # unknowns up to which a factorisation takes next to no time
MAX_KRYLOV = 30  # iterations from which on it takes less than they do
ROUNDING = 8 * np.finfo(float).eps
INEXACT = 1e-3  # of its right-hand side is left of a linear system: Newton's iteration is hardly slower for it


def fits(model: Model) -> bool:
    """Whether the steps of a model can be condensed; collective.

    Its bodies must be linear and factorised anyway, and the interface unknowns few.
    """
    jumps = sum(fault.interface.total * fault.interface.frame.shape[1] for fault in model.faults)
    return 0 < jumps <= MOST_UNKNOWNS and is_factorised(model) and is_linear(model.bulk)


def require_fit(model: Model) -> None:
    """Refuse interfaces that slide where steps cannot be condensed; collective.

    Raises
    ------
    CaseError
    """
    name = next((fault.name for fault in model.faults if fault.slides), None)
    if name is None:
        return
    unknowns = count_nodes(model) * model.components
    label, instead = f"faults.{name}.sliding", "or use the stepper 'leapfrog'"
    if not is_linear(model.bulk):
        kinds = ", ".join(sorted({f"'{material.kind()}'" for material in model.materials}))
        raise CaseError(
            f"{label}: implicit steps need materials whose stiffness is constant, and one of {kinds} has another; use "
            f"'isotropic_elastic' or 'orthotropic_elastic', {instead}"
        )
    if unknowns > MOST_UNKNOWNS:
        raise CaseError(
            f"{label}: the surfaces have {unknowns} degrees of freedom, implicit steps take {MOST_UNKNOWNS} (their "
            f"stiffness is a dense matrix); use larger elements along the interface, {instead}"
        )
    if not is_factorised(model):
        raise CaseError(
            f"{label}: implicit steps factorise the bodies, and {model.total_nodes * model.components} degrees of "
            f"freedom are too many, or there is no MUMPS for {model.comm.size} ranks; use larger elements, {instead}"
        )


@dataclass
class Tractions:
    """At the points of all interfaces: t, shape (points, local) [Pa], and dt/de, shape (points, local, local)."""

    value: np.ndarray
    tangent: np.ndarray


@dataclass
class Guess:
    """Jumps e [m], shape (points, local), with dt/de there, q [Pa] and what is missing to balance [m]."""

    e: np.ndarray
    tangent: np.ndarray
    q: np.ndarray
    missing: np.ndarray


class Condensed:
    """Solves steps of one model on its interfaces.

    Attributes
    ----------
    jumps : Jumps
    history : list of float
        Norm of the residual at every evaluation of the last solve [N]: of the whole system, and of what interfaces
        leave in it.
    iterations, outer : int
        Of the last solve: Newton's, and those of the multipliers.
    reason : str
        Why it ended.
    """

    def __init__(self, model: Model, tangent: Tangent) -> None:
        self._model, self._tangent = model, tangent
        self.jumps = Jumps(model)
        self._surfaces = Surfaces(model, self.jumps) if any(fault.slides for fault in model.faults) else None
        self._kept: OrderedDict[tuple[float, ...], Any] = OrderedDict()
        self._facing: tuple[tuple[object, ...], FacingCompliance] | None = None
        self.history: list[float] = []
        self.iterations = self.outer = 0
        self.reason = ""

    def solve(self, step: Step, u: np.ndarray) -> bool:
        """Leave `step` evaluated at its equilibrium, from `u`; whether there is one; collective."""
        self.forget()
        u, before = u.copy(), np.inf
        for _ in range(MAX_CORRECTIONS):
            step.evaluate(u)
            left = norm(self._model, step.residual)
            self.history.append(left)
            if left <= step.enough(TOLERANCE):
                self.reason = "CONVERGED"
                return True
            if not left < 0.5 * before:
                self.reason = "DIVERGED: the residual falls no more" if np.isfinite(left) else "DIVERGED: a law failed"
                return False
            before = left
            compliance = self.influence(step)
            driven, finish = compliance.begin(-step.residual, 0.1 * step.enough(TOLERANCE))
            start, begun, enough = self.jumps.of(u), step.multipliers, step.enough(TOLERANCE)
            found = self.balance(step, compliance, start, driven, enough)
            if found is None and self._surfaces is not None:
                step.multipliers, self.outer = begun, 1
                self.tractions(step, start)
                found = self.balance(step, compliance, start, driven, enough, together=True)
            if found is None:
                return False
            u += finish(found.q)
        self.reason = "DIVERGED: the residual falls too slowly"
        return False

    def forget(self) -> None:
        """Begin to count anew."""
        self.history, self.iterations, self.outer, self.reason = [], 0, 1, ""

    def influence(self, step: Step) -> Influence:
        """What jumps answer to tractions, by the length of the step and by what points face; collective."""
        if self._surfaces is None:
            return self.compliance(step)
        surfaces = self._surfaces
        of_bodies = self._of_length(
            step.key[:2], lambda: SurfaceStiffness(self._model, surfaces, self._tangent, step.key[:2])
        )
        faces = [fault.interface for fault in self._model.faults]
        key = (step.key, *(face.geometry.revision for face in faces if isinstance(face, SlidingInterface)))
        if self._facing is None or self._facing[0] != key:
            self._facing = None  # room for the next one
            self._facing = key, FacingCompliance(of_bodies, self.jumps, step.stuck())
        return self._facing[1]

    def compliance(self, step: Step) -> Compliance:
        """That of the length of the step, of interfaces that do not slide; collective."""
        return self._of_length(
            step.key, lambda: Compliance(self._model, self.jumps, self._tangent, step.key[:2], step.stuck())
        )

    def _of_length(self, key: tuple[float, ...], make: Callable[[], Kept]) -> Kept:
        """What was made for a length of steps; the last few are kept; collective."""
        found = self._kept.pop(key, None)
        if found is None:
            while len(self._kept) >= KEPT:
                self._kept.popitem(last=False)[1].destroy()
            found = make()
        self._kept[key] = found
        return found

    def balance(
        self, step: Step, compliance: Influence, start: np.ndarray, driven: np.ndarray, enough: float,
        together: bool = False,
    ) -> Guess | None:  # fmt: skip
        """The jumps e that balance; None where there are none; collective.

        The step must have responded to the jumps at the start; after it, it has to those at the end.

        Parameters
        ----------
        start : ndarray, shape (points, local)
            Jumps where e is zero [m].
        driven : ndarray, shape (points, local)
            -J A^-1 R [m].
        enough : float
            Force [N] that may be left in the whole system; a hundredth of it is left here.
        together : bool
            Begin with what open points would do if they pulled as closed ones press: bodies that only contact will
            hold are then in one another, and iteration lets points go instead of looking for the first that touches.
        """
        stuck, begin = compliance.stuck, self.gather(step)
        changes = _Changes(compliance)

        def guess(e: np.ndarray, t: Tractions | None) -> Guess | None:
            if t is None:
                return None
            q = released(t.value, begin.value, times(stuck, e))
            return Guess(e, t.tangent, q, e - driven + compliance.jumps_under(q))

        now = guess(np.zeros_like(driven), begin)
        if together:
            opening = self.jumps.gather({name: response.state["opening"] for name, response in step.responses.items()})
            pulled = np.zeros_like(driven)
            pulled[:, 0] = stuck[:, 0, 0] * opening
            e = self._agreed(driven - compliance.jumps_under(pulled))
            now = guess(e, self.tractions(step, start + e))
        while now is not None and self.outer <= MAX_OUTER:
            stalled, before = 0, np.inf
            for _ in range(MAX_NEWTON):
                forces, size = self.left(compliance, now), self._agreed(float(np.linalg.norm(now.missing)))
                self.history.append(forces)
                # Or the jumps are as good as rounding allows.
                small = size <= 1e-15 * (np.linalg.norm(now.e) + np.linalg.norm(start))
                # Below what may be left, Newton's iteration converges fast or has reached rounding.
                ends = forces <= enough and size > FAST * before
                if self._agreed(bool(forces <= 0.01 * enough or small or ends)):
                    break
                change = self._agreed(changes.solve(now.tangent - stuck, now.missing))
                self.iterations += 1
                longest = length = min(1.0, compliance.farthest / max(float(np.abs(change).max()), 1e-300))
                taken, before = None, size
                for _ in range(MAX_HALVINGS):
                    e = now.e + length * change
                    there = guess(e, self.tractions(step, start + e))
                    ahead = np.inf if there is None else float(np.linalg.norm(there.missing))
                    size = self._agreed(ahead)
                    if size <= (1 - 1e-4 * length) * before:
                        taken = there
                        break
                    length *= 0.5
                stalled = stalled + 1 if length < longest and size > STALLING * before else 0
                if taken is None and forces <= enough:
                    break
                if taken is None or stalled == MAX_STALLED:
                    self.reason = f"DIVERGED: no step at the interfaces reduces {self.history[-1]:.3g} N"
                    return None
                now = taken
            else:
                self.reason = f"DIVERGED: {MAX_NEWTON} iterations at the interfaces"
                return None
            if step.settled():
                return now
            step.update_multipliers()
            self.outer += 1
            now = guess(now.e, self.tractions(step, start + now.e))
        failed = "a law failed" if now is None else f"tractions still change after {MAX_OUTER} updates"
        self.reason = f"DIVERGED: {failed}"
        return None

    def left(self, compliance: Influence, found: Guess) -> float:
        """Upper bound of the forces out of balance [N], were jumps changed by what is missing; collective.

        None is stiffer than a stuck one.
        """
        return self._agreed(float(np.linalg.norm(compliance.weight[:, None] * times(compliance.stuck, found.missing))))

    def _agreed(self, value: Value) -> Value:
        """What the first rank has: all compute the same, but not to the last bit; collective."""
        comm = self._model.comm
        agreed: Value = value if comm.size == 1 else comm.bcast(value, root=0)
        return agreed

    def tractions(self, step: Step, jump: np.ndarray) -> Tractions | None:
        """At jumps of all points; None where a law fails; collective."""
        error = None
        try:
            step.respond({fault.name: self.jumps.pick(jump, fault.name) for fault in self._model.faults})
        except ProjectionError as caught:
            error = caught
        if parallel.anywhere(self._model.comm, error is not None):
            return None
        return self.gather(step)

    def gather(self, step: Step) -> Tractions:
        """Of the last responses; collective."""
        value, tangent = (
            self.jumps.gather({name: getattr(response, part) for name, response in step.responses.items()})
            for part in ("traction", "tangent")
        )
        return Tractions(value, tangent)


class _Changes:
    """Solves (1 + S D) de = -f for changes of the jumps, D in blocks.

    Made anew for every step, so that a step does not depend on those before it.
    """

    def __init__(self, compliance: Influence) -> None:
        self._compliance = compliance
        self._active = np.zeros((0, 0), dtype=bool)
        self._factors: tuple[np.ndarray, np.ndarray] | None = None

    def solve(self, slope: np.ndarray, f: np.ndarray) -> np.ndarray:
        """de, shape (points, local).

        Parameters
        ----------
        slope : ndarray, shape (points, local, local)
            D [Pa/m].
        f : ndarray, shape (points, local)
            [m]
        """
        # y = D de: rows of D that are zero, as where points stick, drop out of (1 + D S) y = -D f.
        active = np.any(slope != 0, axis=2)
        if not np.array_equal(active, self._active):
            self._active, self._factors = active, None
        right = -times(slope, f)[active]
        if not right.any():
            return -f
        if len(right) > SMALL:
            answered = self._iterate(slope, right)
            if answered is not None:
                return -f - answered
        self._factors = lu_factor(self._matrix(slope), overwrite_a=True, check_finite=False)
        return -f - self._compliance.jumps_under(self._spread(lu_solve(self._factors, right, check_finite=False)))

    def _spread(self, y: np.ndarray) -> np.ndarray:
        """Tractions of all points, shape (points, local), from those that are unknown."""
        traction = np.zeros(self._active.shape)
        traction[self._active] = y
        return traction

    def _iterate(self, slope: np.ndarray, right: np.ndarray) -> np.ndarray | None:
        """S y, shape (points, local), or None where it takes too long.

        By GMRES, preconditioned with the diagonal or with earlier factors; S y is the sum of its products with S.
        Source: Saad and Schultz (1986).
        """
        last, compliance = self._factors, self._compliance
        diagonal = 1 + np.einsum("pij,pji->pi", slope, compliance.own)[self._active]
        size = float(np.linalg.norm(right))
        directions, answers = [right / size], []
        hessenberg, target = np.zeros((MAX_KRYLOV + 1, MAX_KRYLOV)), np.zeros(MAX_KRYLOV + 1)
        target[0] = size
        for k in range(MAX_KRYLOV):
            y = directions[k] / diagonal if last is None else lu_solve(last, directions[k], check_finite=False)
            answers.append(compliance.jumps_under(self._spread(y), roughly=True))
            v = y + times(slope, answers[k])[self._active]
            for i, direction in enumerate(directions):
                hessenberg[i, k] = direction @ v
                v -= hessenberg[i, k] * direction
            hessenberg[k + 1, k] = length = float(np.linalg.norm(v))
            part = hessenberg[: k + 2, : k + 1]
            weights = np.linalg.lstsq(part, target[: k + 2], rcond=None)[0]
            if np.linalg.norm(part @ weights - target[: k + 2]) <= INEXACT * size:
                return np.asarray(np.tensordot(weights, answers, 1))
            directions.append(v / length)
        return None

    def _matrix(self, slope: np.ndarray) -> np.ndarray:
        """1 + D S in the active rows and columns."""
        point, component = np.nonzero(self._active)
        whole = np.eye(len(point))
        for k, i in np.ndindex(slope.shape[1:]):
            factor, columns = slope[point, component, k], component == i
            if np.any(factor):
                whole[:, columns] += factor[:, None] * self._compliance.blocks[k, i][np.ix_(point, point[columns])]
        return whole


def released(traction: np.ndarray, before: np.ndarray, held: np.ndarray) -> np.ndarray:
    """Tractions less those before and those that would be held if all stuck; zero where only rounding is left [Pa].

    Zeros cost no product.
    """
    q = traction - before - held
    q[np.abs(q) <= ROUNDING * (np.abs(traction) + np.abs(before) + np.abs(held))] = 0.0
    return q


def times(blocks: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Of every point, shapes (points, local, local) and (points, local)."""
    return np.asarray(np.einsum("pij,pj->pi", blocks, vectors))
