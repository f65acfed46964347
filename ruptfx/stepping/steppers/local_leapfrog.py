"""Leapfrog with local time steps: small elements act in substeps, the others once per step."""

from __future__ import annotations

import copy
from typing import TYPE_CHECKING, Annotated, ClassVar

import numpy as np
from pydantic import Field, field_validator

from ruptfx.bodies.operators import FusedOperator
from ruptfx.bodies.spectrum import stable_time_step
from ruptfx.input.quantities import at_most
from ruptfx.input.schema import CaseError
from ruptfx.input.units import Duration, Fraction
from ruptfx.interfaces.mechanisms import mechanisms_of
from ruptfx.platform import parallel
from ruptfx.stepping.steppers import Stepper, _clusters
from ruptfx.stepping.steppers.leapfrog import LeapfrogMotion, what_limits

if TYPE_CHECKING:
    from ruptfx.bodies.state import State
    from ruptfx.interfaces.mechanisms.stepped_nodes import Kick
    from ruptfx.interfaces.mechanisms.system import System
    from ruptfx.stepping.steppers import Motion


class LocalLeapfrog(Stepper):
    """Leapfrog whose small elements act in every substep of length d, and all others once per step of p d.

    The stiffness is the sum K = K_f + K_c of two clusters of elements. In substep m, from u(m) at time m d,

        M (v(m+1/2) - v(m-1/2)) = d (-K_f u(m) + F(m)),    in the middle one of p substeps also - p d K_c u(m),
        u(m+1) = u(m) + d v(m+1/2),

    with the tractions of interfaces, loads, dashpots and prescribed motion in F(m). These are changes of velocities
    and of displacements in turn, each of them symplectic, in an order that is symmetric in time: second order,
    explicit, without drift of the energy (Source: Tuckerman et al. 1992, impulses of multiple time steps; Lew et al.
    2003, impulses of elements). p is odd, so that at the end of a step all velocities are of the same time, d / 2
    before it: records are like those of leapfrog with steps d. With p = 1 it is the leapfrog.

    Impulses at intervals of p d excite vibrations with periods of 2 p d / k, which only small elements have: their
    amplitude decays in larger elements, whose highest frequency is lower. Therefore two layers of larger elements
    around the small ones act in every substep, too. With no layer, bars of two element sizes are unstable from 0.7 of
    the stable step of the larger elements on; with one layer, energy grows by up to 1e-5 per step; with two it is
    constant to rounding, for p from 3 to 9.

    The elements at interfaces and one layer beyond them act in every substep; dashpots and loads do at all their nodes.
    """

    offers = (Stepper.offers | {"ties", "attachments", "precision"}) - {"sliding"}
    conserving: ClassVar[dict[str, object] | None] = {"substeps": 1}
    closure: ClassVar[float] = 1e-3
    why_open: ClassVar[str] = (
        "the work of impulses of larger elements agrees with the change of their strain energy to second order only, "
        "as nodes of both clusters move in substeps in between"
    )

    safety: Fraction = 0.9
    """Substep over the stable step of all elements, and largest step over that of the elements that are not small."""
    substeps: Annotated[int, Field(ge=1, le=_clusters.MOST_SUBSTEPS)] | None = None
    """Substeps of the small elements in a step, an odd number; default: as the sizes of elements make best."""
    time_step: Duration | None = None
    """Length of a step in place of the chosen one; refused if it is not stable."""

    @field_validator("substeps")
    @classmethod
    def _odd(cls, value: int | None) -> int | None:
        if value is not None and value % 2 == 0:
            raise ValueError(
                f"substeps = {value}: must be odd, so that all velocities are of one time; use {value + 1}"
            )
        return value

    def bind(self, model: System) -> Motion:
        clusters, step = self._chosen(model)
        explicit = model.in_steps("explicit")
        if clusters.substeps == 1:
            return LeapfrogMotion(explicit, step)
        if obstacle := _obstacle(explicit):
            raise CaseError(obstacle)
        return LocalMotion(explicit, step, clusters)

    def _chosen(self, model: System) -> tuple[_clusters.Clusters, float]:
        """Return the clusters and the length of a substep [s]; collective."""
        mechanisms, stable = mechanisms_of(model), stable_time_step(model)
        if self.time_step is None:
            step = parallel.three_digits(self.safety * stable)
            clusters = _clusters.stable(model, mechanisms, self.substeps, step / self.safety)
            self._require(clusters, step)
            return clusters, step
        unsafe = self.time_step / (self.substeps or 1)
        clusters = _clusters.stable(model, mechanisms, self.substeps, unsafe)
        self._require(clusters, unsafe)
        if unsafe > stable:
            raise CaseError(
                f"stepper.time_step = {self.time_step:.4g} s: unstable in {clusters.substeps} substeps, the limit is "
                f"{at_most(clusters.substeps * stable)} s, {what_limits(model, stable)}; reduce it, or leave it out"
            )
        return clusters, unsafe

    def _require(self, clusters: _clusters.Clusters, step: float) -> None:
        if self.substeps is not None and clusters.substeps != self.substeps:
            raise CaseError(
                f"stepper.substeps = {self.substeps}: no elements are large enough for steps of "
                f"{self.substeps * step:.4g} s; reduce it, or leave it out"
            )


def possible(model: System, stable: float) -> _clusters.Clusters:
    """Return the clusters that a model would have; one substep where it cannot have more. Collective.

    Parameters
    ----------
    stable : float
        Stable step of all elements [s].
    """
    explicit = model.in_steps("explicit")
    wanted = 1 if _obstacle(explicit) else None
    return _clusters.stable(explicit, mechanisms_of(explicit), wanted, stable)


def _obstacle(model: System) -> str:
    """Return what does not act in substeps and the remedy, as a text; empty if everything does."""
    if model.case.damping.mass:
        return (
            f"damping.mass = {model.case.damping.mass:g}: damps all nodes in equal steps only; remove it, or use "
            "stepper.kind = 'leapfrog'"
        )
    return next(filter(None, (each.obstacle_to_substeps() for each in mechanisms_of(model))), "")


class LocalMotion(LeapfrogMotion):
    """Local time steps bound to a model.

    Attributes
    ----------
    dt : float
        Length of a step [s], of `clusters.substeps` substeps.
    clusters : Clusters

    Parameters
    ----------
    step : float
        Length of a substep [s].
    """

    def __init__(self, model: System, step: float, clusters: _clusters.Clusters) -> None:
        self.clusters, self._bodies = clusters, model
        self._middle = clusters.substeps // 2
        of_fine = _clusters.nodes_of(model, clusters.fine)
        of_coarse = _clusters.nodes_of(model, ~clusters.fine)
        view = copy.copy(model)
        view.operator = _clusters.part_of(model, clusters.fine)
        super().__init__(view, step, of_fine & of_coarse)
        self.dt = clusters.substeps * step
        self._larger = _clusters.part_of(model, ~clusters.fine)
        # The kernel moves its nodes up to the middle substep, kicks for the whole step, and drifts until its end.
        self._drift = (self._middle + 1) * step
        self._push = (self.dt / self._drift / model.mass.reshape(model.nodes, -1)[:, 0]).astype(model.real, copy=False)
        if isinstance(self._larger, FusedOperator):
            of_coarse[self.nodes.dofs // model.components] = False
            self._larger.prepare_step(~of_coarse, moves=True)
        self._substep = 0

    def step(self, state: State) -> None:
        """Advance by one step of all elements; `state.time` becomes the time of the new displacement."""
        watched, state.wants_energies = state.wants_energies, False
        try:
            for number in range(self.clusters.substeps):
                self._substep = number
                self._kick_and_drift(state)
        finally:
            state.step += 1
            state.wants_energies = watched
        self._raise_kept()

    def _advance(self, state: State, kick: Kick) -> None:
        if self._substep == self._middle:
            self._kick_larger(state)
        super()._advance(state, kick)

    def _kick_larger(self, state: State) -> None:
        """Let the larger elements act for the whole step: on their own nodes, and as forces on stepped ones."""
        if isinstance(self._larger, FusedOperator):
            how = state.displacement, state.velocity, state.force, self._push, self._drift
            self._larger.step(*how, move=self._middle * self._kick_dt)
        else:
            self._larger.add_internal_force(state.displacement, state.force)
        state.force[self.nodes.index] *= self.clusters.substeps

    def energies(self, state: State) -> dict[str, float]:
        """Return the energies at the time of the velocity [J]; collective.

        The strain energy of the larger elements is u(a)' K_c u(b) / 2 with the displacements at the begin and the end
        of the interval in which their velocity is constant, as that of the others is with those of a substep.
        """
        kinetic, strain = self._bodies.bulk_energies(state)
        if state.lag:
            force = np.zeros_like(state.velocity)
            self._larger.add_internal_force(state.velocity.astype(float, copy=False), force)
            strain += (self.clusters.substeps**2 - 1) * self._kick_dt**2 / 8 * float(force @ state.velocity)
        return self._bodies.energies(state, (kinetic, strain))
