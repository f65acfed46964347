"""Time steppers, one per file; the file name is the `kind` in a case.

A stepper never writes files and does not know the duration of the run; `ruptfx.run.simulation` requests one step after
another.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Protocol, Self, cast

from ruptfx.input.schema import Alternative, alternative
from ruptfx.laws.contact import Way

if TYPE_CHECKING:
    from ruptfx.bodies.state import State
    from ruptfx.interfaces.mechanisms.system import System


class Motion(Protocol):
    """A stepper bound to a model: its interface to the time loop, to records, checkpoints and other steppers."""

    dt: float
    """Size of the steps [s], or of the first step if they vary."""

    collective: bool
    """Whether every step exchanges messages with all ranks. If so, all ranks raise an error together, with the
    previous state, and check for signals in each step. Otherwise one rank may fail alone: it continues its clock and
    its messages until all ranks synchronise."""

    def step(self, state: State) -> None:
        """Advance the state in place by one step.

        Afterwards

        * `time` and `step` have increased, and `numbers["lag"]` is the delay of the faults against `time`, if any;
        * the arrays of nodes and faults are still the same objects, to which other parts have references;
        * `force` is zero: steps accumulate internal forces in it;
        * driven edges have the prescribed position at `time` and the prescribed speed at the time of the velocity;
        * `energy` contains the losses in friction and damping and the work of boundaries, for the points of this rank;
        * other data of the next step are in `fields` and `numbers`, such as its size (``dt``): checkpoints contain
          them, and a stepper bound again to the same model continues from there without any change.

        Raises
        ------
        RuptfxError
            On all ranks if `collective`, else maybe on one.
        """

    def energies(self, state: State) -> dict[str, float]:
        """Return the energies over all ranks [J], all of `fields.ENERGIES`; collective.

        They belong to the time of the velocity, at which the scheme conserves energy.
        """


class DeferringMotion(Motion, Protocol):
    """A motion that may defer displacement and velocity of the bodies (`State.lazy_bodies`, `State.deferred`)."""

    def advance_bodies(self, state: State) -> None:
        """Compute deferred displacement and velocity at the time of the state; collective."""


def sync_bodies(motion: Motion, state: State) -> None:
    """Compute displacement and velocity at the time of the state if its steps have deferred them; collective."""
    if state.deferred:
        cast("DeferringMotion", motion).advance_bodies(state)


class StagedMotion(Motion, Protocol):
    """A motion that alternates with others, which have other loads and damping.

    Steps of free size end at `Loads.end`; others end with the first step beyond it.
    """

    def leave(self, state: State) -> None:
        """Complete the state so that another motion can continue; collective."""

    def enter(self, state: State) -> None:
        """Continue from a state that another motion has left; collective."""


class Stepper(Alternative):
    """The contract of a time stepper."""

    former_attributes: ClassVar[dict[str, str]] = {"ways": "time_schemes", "keeps_ties": "supports_ties"}

    time_schemes: ClassVar[tuple[Way, ...]] = ("explicit",)
    """How interface tractions are computed: from known quantities (explicit), or together with the displacement
    (implicit). The contact method must support all of them."""
    second_order: ClassVar[bool] = True
    """Whether the error decreases with the square of the step with default options; False if options decide."""
    conserving: ClassVar[dict[str, object] | None] = None
    """Fields with which the energy budget closes to round-off; None if it does not."""
    closure: ClassVar[float] = 1e-9
    """Bound of the error of the energy budget, relative to the largest work of the boundaries, with default options
    and steps that resolve the loading."""
    why_open: ClassVar[str] = ""
    """Reason for a bound that is larger than rounding and the tolerances of solvers."""
    supports_ties: ClassVar[bool] = False
    """Whether it gives tied nodes the same motion."""
    inertia: ClassVar[bool] = True
    """Whether it solves the equation of motion; with equilibrium only, parts with `waves` have no effect."""
    adaptive: ClassVar[bool] = False
    """Whether its steps vary."""
    staged: ClassVar[bool] = False
    """Whether loading may have stages: it is bound again for each of them, to a `StagedMotion`."""
    sliding: ClassVar[bool] = True
    """Whether interfaces may slide (`sliding`)."""
    cohesion: ClassVar[bool] = True
    """Whether interfaces may have cohesion."""
    gap: ClassVar[bool] = True
    """Whether interfaces may be open at the start."""
    fracture: ClassVar[bool] = False
    """Whether bodies may break."""
    large_rotations: ClassVar[bool] = False
    """Whether bodies may turn by any angle."""
    attachments: ClassVar[bool] = False
    """Whether its steps ask mechanisms for their forces, so that masses and springs may be attached to the bodies."""
    adjoint: ClassVar[bool] = False
    """Whether its steps have an adjoint (`ruptfx.many_runs.adjoint`), so that an objective may be differentiated."""
    newmark: ClassVar[bool] = True
    """Whether implicit steps with inertia follow Newmark's rules, with which attachments advance their masses."""
    memory: ClassVar[bool] = False
    """Whether its steps advance materials with memory."""
    multipliers: ClassVar[bool] = True
    """Whether the contact method may use multipliers of outer iterations."""
    elastic_contact_only: ClassVar[bool] = False
    """Whether the contact method must have a stiffness."""

    def fixed(self, model: System) -> Self:
        """Return the stepper with the step that it chooses for a model, for use with another model."""
        return self

    def bind(self, model: System) -> Motion:
        """Choose the step and prepare the arrays.

        Raises
        ------
        CaseError
            A time step the model does not allow.
        """
        raise NotImplementedError


if TYPE_CHECKING:
    AnyStepper = Stepper
else:
    AnyStepper = alternative("ruptfx.stepping.steppers")
