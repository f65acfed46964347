"""Implicit steps condensed to the interfaces: bodies are linear, so that Newton's iteration is done there only.

At a displacement u with the jump g and the residual R, the correction d that balances all forces solves

    A d = -R - J' W q,    q(e) = t(g + e) - t(g) - k e,    e = J d

with A = K + c_M M + c_C C + J' W k J for closed, stuck interfaces, whose factors are stored (`compliance`), and
tractions t. Hence e + S W q(e) = -J A^-1 R, a system for the jumps e only, solved with the exact tangents of t; then
d takes one back substitution. Where R is at the interfaces only, as in quasi-static steps with steady loading,
J A^-1 R is S times it; if waves have a limited reach in a step, it takes one of a strip along the interfaces; else
one of all. As bodies are linear, u + d is the equilibrium up to rounding;
the residual of the full system decides, and is reduced once more if needed. Multipliers are iterated at the
interfaces, too.

Newton's linear systems (1 + S D) de = b, D = dq/de, are factorised if small; larger ones are solved by
GMRES, preconditioned by their diagonal or, if that is too slow, by the factors of a previous iteration.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import numpy as np
from scipy.linalg import lu_factor, lu_solve

from ruptfx.bodies.operators.assembled import is_linear
from ruptfx.input.schema import CaseError
from ruptfx.interfaces.faults.projection import ProjectionError
from ruptfx.interfaces.mechanisms import responding
from ruptfx.interfaces.sliding.interface import SlidingInterface
from ruptfx.platform import parallel
from ruptfx.stepping.implicit.compliance import Compliance, Influence, Jumps, norm
from ruptfx.stepping.implicit.solvers import MAX_NEWTON, TOLERANCE, is_factorised
from ruptfx.stepping.implicit.step import MAX_OUTER, Step
from ruptfx.stepping.implicit.surfaces import PairedCompliance, Surfaces, SurfaceStiffness, count_components
from ruptfx.stepping.implicit.tangent import Tangent

if TYPE_CHECKING:
    from ruptfx.interfaces.mechanisms.system import System

Stored = TypeVar("Stored")

MAX_UNKNOWNS = 4000  # largest number of jump components, or of surface nodes with finite sliding: matrices are dense
MAX_STORED = 4  # number of stored factorisations
MAX_CORRECTIONS = 4
MAX_HALVINGS = 12
FAST = 0.1  # ratio of successive residuals for which iterations continue below the tolerance
STALLING, MAX_STALLED = 0.9, 2  # ratio of successive residuals that counts as stalling, and its largest repetition
SMALL = 200  # number of unknowns up to which a factorisation takes almost no time
MAX_KRYLOV = 30  # GMRES iterations beyond which a factorisation is cheaper
ROUNDING = 8 * np.finfo(float).eps
INEXACT = 1e-3  # relative residual of linear systems: Newton's iteration hardly slows down


def fits(model: System) -> bool:
    """Return whether the steps of a model can be condensed; collective.

    Bodies must be linear and, without finite sliding, factorised by default, with few interface unknowns, and without
    mechanisms that act on them besides boundaries and faults.
    """
    if count_jumps(model) > MAX_UNKNOWNS or not is_condensable(model):
        return False
    return is_factorised(model) or any(fault.slides for fault in model.faults)


def is_condensable(model: System) -> bool:
    """Return whether a matrix of the interfaces gives their tractions, however large it is; collective."""
    if responding(model.mechanisms):
        return False
    return count_jumps(model) > 0 and is_linear(model.bulk)


def count_jumps(model: System) -> int:
    """Return the number of jump components of all interfaces."""
    return sum(fault.interface.total * fault.interface.frame.shape[1] for fault in model.faults)


def require_fit(model: System) -> None:
    """Refuse finite sliding where steps cannot be condensed; collective.

    Raises
    ------
    CaseError
    """
    name = next((fault.name for fault in model.faults if fault.slides), None)
    if name is None:
        return
    unknowns = count_components(model)
    label, instead = f"faults.{name}.sliding", "or use the stepper 'leapfrog'"
    if not is_linear(model.bulk):
        kinds = ", ".join(sorted({f"'{material.kind()}'" for material in model.materials}))
        raise CaseError(
            f"{label}: implicit steps need materials whose stiffness is constant, and one of {kinds} has another; use "
            f"'isotropic_elastic' or 'orthotropic_elastic', {instead}"
        )
    if unknowns > MAX_UNKNOWNS:
        raise CaseError(
            f"{label}: the surfaces have {unknowns} degrees of freedom, implicit steps take {MAX_UNKNOWNS} (their "
            f"stiffness is a dense matrix); use larger elements along the interface, {instead}"
        )


@dataclass
class Tractions:
    """Tractions t of all interface points, shape (points, local) [Pa], and dt/de, shape (points, local, local)."""

    value: np.ndarray
    tangent: np.ndarray


@dataclass(frozen=True)
class Start:
    """Start of Newton's iteration, e = 0: the jumps of known bodies, or those that interfaces are expected to have.

    Attributes
    ----------
    influence : Influence
        Jumps under unit tractions.
    jumps : ndarray, shape (points, local)
        Jumps for e = 0 [m], at which the step has been evaluated.
    driven : ndarray, shape (points, local)
        -J A^-1 R [m].
    enough : float
        Tolerated residual of the full system [N]; a hundredth of it is the tolerance here.
    """

    influence: Influence
    jumps: np.ndarray
    driven: np.ndarray
    enough: float


@dataclass
class Guess:
    """Jumps e [m], shape (points, local), with dt/de there, q [Pa] and the residual of e + S W q(e) [m]."""

    e: np.ndarray
    tangent: np.ndarray
    q: np.ndarray
    residual: np.ndarray


class Condensed:
    """Solver of the steps of one model on its interfaces.

    Attributes
    ----------
    model : System
    jumps : Jumps
    history : list of float
        Norm of the residual at every evaluation of the last solve [N]: of the full system, and of the interface
        system.
    iterations, outer : int
        Newton iterations and multiplier iterations of the last solve.
    reason : str
        Reason why it ended.
    """

    def __init__(self, model: System, tangent: Tangent) -> None:
        self.model, self._tangent, self.comm = model, tangent, model.comm
        self.jumps = Jumps(model)
        self._surfaces = Surfaces(model, self.jumps) if any(fault.slides for fault in model.faults) else None
        self._kept: OrderedDict[tuple[float, ...], Any] = OrderedDict()
        self._paired: tuple[tuple[object, ...], PairedCompliance] | None = None
        self.history: list[float] = []
        self.iterations = self.outer = 0
        self.reason = ""

    def solve(self, step: Step, u: np.ndarray) -> bool:
        """Solve `step` from `u` and evaluate it there; return whether it has an equilibrium; collective."""
        return self.iterate(step, KnownBodies(self, u))

    def iterate(self, step: Step, bodies: Bodies) -> bool:
        """Balance the interfaces of a step until its bodies need no correction; return whether they are; collective."""
        self.clear_history()
        while (start := bodies.start(step)) is not None:
            multipliers, root = step.multipliers, self.balance(step, start)
            if root is None and self._surfaces is not None:
                step.multipliers, self.outer = multipliers, 1
                self.tractions(step, start.jumps)
                root = self.balance(step, start, together=True)
            if root is None:
                return False
            bodies.correct(step, start, root)
        return bodies.converged

    def clear_history(self) -> None:
        """Reset the counters."""
        self.history, self.iterations, self.outer, self.reason = [], 0, 1, ""

    def influence(self, step: Step) -> Influence:
        """Return the jumps under unit tractions, for the length of the step and the present pairing; collective."""
        if self._surfaces is None:
            return self.compliance(step)
        surfaces = self._surfaces
        of_bodies = self._of_length(
            step.key[:2], lambda: SurfaceStiffness(self.model, surfaces, self._tangent, step.key[:2])
        )
        faces = [fault.interface for fault in self.model.faults]
        key = (step.key, *(face.geometry.revision for face in faces if isinstance(face, SlidingInterface)))
        if self._paired is None or self._paired[0] != key:
            self._paired = None  # frees memory for the next one
            self._paired = key, PairedCompliance(of_bodies, self.jumps, step.stuck())
        return self._paired[1]

    def compliance(self, step: Step) -> Compliance:
        """Return the compliance for the length of the step, for interfaces without finite sliding; collective."""
        return self._of_length(
            step.key, lambda: Compliance(self.model, self.jumps, self._tangent, step.key[:2], step.stuck())
        )

    def _of_length(self, key: tuple[float, ...], make: Callable[[], Stored]) -> Stored:
        """Return a stored object for the length of steps, or create it; the last few are stored; collective."""
        length = self._kept.pop(key, None)
        if length is None:
            while len(self._kept) >= MAX_STORED:
                self._kept.popitem(last=False)[1].destroy()
            length = make()
        self._kept[key] = length
        return length

    def balance(self, step: Step, start: Start, together: bool = False) -> Guess | None:
        """Return the jumps e that balance forces, None if none are found; collective.

        The step must have been evaluated at the jumps at the start; afterwards it has been at those of the end.

        Parameters
        ----------
        together : bool
            Begin with all points closed, so that a body which only contact supports is held; the iteration then opens
            points instead of searching for the first one that touches.
        """
        newton = _Newton(self, step, start)
        guess = newton.first(together)
        while guess is not None and self.outer <= MAX_OUTER:
            guess = newton.solve(guess)
            if guess is None or step.multipliers_converged():
                return guess
            step.update_multipliers()
            self.outer += 1
            guess = newton.at(guess.e)
        failed = "a law failed" if guess is None else f"tractions still change after {MAX_OUTER} updates"
        self.reason = f"DIVERGED: {failed}"
        return None

    def residual_bound(self, influence: Influence, guess: Guess) -> float:
        """Return an upper bound of the unbalanced forces for a residual of the jumps [N]; collective.

        No interface is stiffer than a stuck one.
        """
        pulls = influence.weight[:, None] * blockwise_product(influence.stuck, guess.residual)
        return parallel.agreed(self.model.comm, float(np.linalg.norm(pulls)))

    def tractions(self, step: Step, jump: np.ndarray) -> Tractions | None:
        """Return the tractions at jumps of all points, None where a law fails; collective."""
        error = None
        try:
            step.respond({fault.name: self.jumps.pick(jump, fault.name) for fault in self.model.faults})
        except ProjectionError as caught:
            error = caught
        if parallel.anywhere(self.model.comm, error is not None):
            return None
        return self.gather(step)

    def gather(self, step: Step) -> Tractions:
        """Return the tractions of the last responses; collective."""
        value, tangent = (
            self.jumps.gather({name: getattr(response, part) for name, response in step.responses.items()})
            for part in ("traction", "tangent")
        )
        return Tractions(value, tangent)


class Bodies(Protocol):
    """The bodies in a step: from where the iteration for the jumps starts, and what its root is for them.

    Attributes
    ----------
    converged : bool
    """

    converged: bool

    def start(self, step: Step) -> Start | None:
        """Return the start of an iteration, at which the step has been evaluated; None to end; collective."""

    def correct(self, step: Step, start: Start, root: Guess) -> None:
        """Use the root, at which the interfaces of the step have been evaluated; collective."""


class KnownBodies:
    """Bodies with a displacement, which roots correct until the residual of the full system is small.

    Parameters
    ----------
    solver : Condensed
    u : ndarray, shape (nodes * components,)
        Displacement from which the iteration starts [m].
    """

    def __init__(self, solver: Condensed, u: np.ndarray) -> None:
        self._solver, self._u, self.converged = solver, u.copy(), False
        self._before, self._corrections = np.inf, 0

    def start(self, step: Step) -> Start | None:
        solver = self._solver
        if self._corrections == MAX_CORRECTIONS:
            solver.reason = "DIVERGED: the residual falls too slowly"
            return None
        self._corrections += 1
        step.evaluate(self._u)
        size, enough = norm(solver.model, step.residual), step.enough(TOLERANCE)
        solver.history.append(size)
        self.converged = size <= enough
        if self.converged:
            solver.reason = "CONVERGED"
            return None
        if not size < 0.5 * self._before:
            solver.reason = f"DIVERGED: {'the residual falls no more' if np.isfinite(size) else 'a law failed'}"
            return None
        self._before = size
        influence = solver.influence(step)
        driven, self._substitute = influence.begin(-step.residual, 0.1 * enough)
        return Start(influence, solver.jumps.of(self._u), driven, enough)

    def correct(self, step: Step, start: Start, root: Guess) -> None:
        self._u += self._substitute(root.q)


class _Newton:
    """Newton's iteration for the jumps of a step; it ends with the same multipliers with which it begins."""

    def __init__(self, solver: Condensed, step: Step, start: Start) -> None:
        self._solver, self._step, self._start = solver, step, start
        self._begin, self._changes = solver.gather(step), _Changes(start.influence)
        self._agreed = partial(parallel.agreed, solver.comm)

    def first(self, together: bool) -> Guess | None:
        """Return the guess at the start, or that of closed points (`Condensed.balance`)."""
        step, start, solver = self._step, self._start, self._solver
        if not together:
            return self._residual(np.zeros_like(start.driven), self._begin)
        opening = solver.jumps.gather({name: response.state["opening"] for name, response in step.responses.items()})
        pulled = np.zeros_like(start.driven)
        pulled[:, 0] = start.influence.stuck[:, 0, 0] * opening
        return self.at(self._agreed(start.driven - start.influence.jumps_under(pulled)))

    def at(self, e: np.ndarray) -> Guess | None:
        """Return the residual at some jumps, None where a law fails; collective."""
        tractions = self._solver.tractions(self._step, self._start.jumps + e)
        return None if tractions is None else self._residual(e, tractions)

    def _residual(self, e: np.ndarray, tractions: Tractions) -> Guess:
        start = self._start
        q = traction_change(tractions.value, self._begin.value, blockwise_product(start.influence.stuck, e))
        return Guess(e, tractions.tangent, q, e - start.driven + start.influence.jumps_under(q))

    def solve(self, guess: Guess) -> Guess | None:
        """Return the root for the present multipliers, None with `Condensed.reason` if there is none; collective."""
        solver, start, stalled, before = self._solver, self._start, 0, np.inf
        for _ in range(MAX_NEWTON):
            forces = solver.residual_bound(start.influence, guess)
            size = self._agreed(float(np.linalg.norm(guess.residual)))
            solver.history.append(forces)
            # Or the jumps are exact up to rounding.
            small = size <= 1e-15 * (np.linalg.norm(guess.e) + np.linalg.norm(start.jumps))
            # Below the tolerance, Newton's iteration converges fast or has reached rounding.
            ends = forces <= start.enough and size > FAST * before
            if self._agreed(bool(forces <= 0.01 * start.enough or small or ends)):
                return guess
            change = self._agreed(self._changes.solve(guess.tangent - start.influence.stuck, guess.residual))
            solver.iterations += 1
            following, stalls = self._search(guess, change, size)
            before, stalled = size, stalled + 1 if stalls else 0
            if following is None and forces <= start.enough:
                return guess
            if following is None or stalled == MAX_STALLED:
                solver.reason = f"DIVERGED: no step at the interfaces reduces {forces:.3g} N"
                return None
            guess = following
        solver.reason = f"DIVERGED: {MAX_NEWTON} iterations at the interfaces"
        return None

    def _search(self, guess: Guess, change: np.ndarray, size: float) -> tuple[Guess | None, bool]:
        """Return the guess after a change that is halved until the residual falls, and whether it hardly falls."""
        longest = length = min(1.0, self._start.influence.farthest / max(float(np.abs(change).max()), 1e-300))
        ahead = np.inf
        for _ in range(MAX_HALVINGS):
            following = self.at(guess.e + length * change)
            ahead = self._agreed(np.inf if following is None else float(np.linalg.norm(following.residual)))
            if ahead <= (1 - 1e-4 * length) * size:
                return following, length < longest and ahead > STALLING * size
            length *= 0.5
        return None, ahead > STALLING * size


class _Changes:
    """Solver of (1 + S D) de = -f for changes of the jumps, with D in blocks.

    A new one is created for every step, so that a step does not depend on previous ones.
    """

    def __init__(self, compliance: Influence) -> None:
        self._compliance = compliance
        self._active = np.zeros((0, 0), dtype=bool)
        self._factors: tuple[np.ndarray, np.ndarray] | None = None

    def solve(self, slope: np.ndarray, f: np.ndarray) -> np.ndarray:
        """Return de, shape (points, local).

        Parameters
        ----------
        slope : ndarray, shape (points, local, local)
            D [Pa/m].
        f : ndarray, shape (points, local)
            [m]
        """
        # y = D de: zero rows of D, as of sticking points, drop out of (1 + D S) y = -D f.
        active = np.any(slope != 0, axis=2)
        if not np.array_equal(active, self._active):
            self._active, self._factors = active, None
        right = -blockwise_product(slope, f)[active]
        if not right.any():
            return -f
        if len(right) > SMALL:
            answered = self._iterate(slope, right)
            if answered is not None:
                return -f - answered
        self._factors = lu_factor(self._matrix(slope), overwrite_a=True, check_finite=False)
        return -f - self._compliance.jumps_under(self._spread(lu_solve(self._factors, right, check_finite=False)))

    def _spread(self, y: np.ndarray) -> np.ndarray:
        """Return tractions of all points, shape (points, local), from the unknown ones."""
        traction = np.zeros(self._active.shape)
        traction[self._active] = y
        return traction

    def _iterate(self, slope: np.ndarray, right: np.ndarray) -> np.ndarray | None:
        """Return S y, shape (points, local), or None after too many iterations.

        GMRES, preconditioned with the diagonal or with earlier factors; S y is the sum of its products with S.
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
            v = y + blockwise_product(slope, answers[k])[self._active]
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
        """Return 1 + D S in the active rows and columns."""
        point, component = np.nonzero(self._active)
        matrix = np.eye(len(point))
        for k, i in np.ndindex(slope.shape[1:]):
            factor, columns = slope[point, component, k], component == i
            if np.any(factor):
                matrix[:, columns] += factor[:, None] * self._compliance.blocks[k, i][np.ix_(point, point[columns])]
        return matrix


def traction_change(traction: np.ndarray, before: np.ndarray, sticking: np.ndarray) -> np.ndarray:
    """Return tractions less those before and those of sticking points; zero up to rounding is exactly zero [Pa].

    Products skip zeros.
    """
    q = traction - before - sticking
    q[np.abs(q) <= ROUNDING * (np.abs(traction) + np.abs(before) + np.abs(sticking))] = 0.0
    return q


def blockwise_product(blocks: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Return the products at every point, of shapes (points, local, local) and (points, local)."""
    return np.asarray(np.einsum("pij,pj->pi", blocks, vectors))
