"""Time steppers, one per file; the file name is the `kind` in a case.

A stepper never writes files and does not know how long the run is; `ruptfx.simulation` asks it for one step after
another.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Protocol, Self

from ruptfx.contact import Way
from ruptfx.schema import Alternative, alternative

if TYPE_CHECKING:
    from ruptfx.model import Model
    from ruptfx.state import State


class Motion(Protocol):
    """A stepper bound to a model: what it owes to the time loop, to records, checkpoints and other steppers."""

    dt: float
    """Size of the steps [s]; of the first where they vary."""

    collective: bool
    """Whether every step exchanges messages with all ranks anyway. Then an error is raised by all of them, with the
    state as it was, and signals are looked for in each step. Else a rank may fail alone: it goes on with the clock and
    with its messages, until all ranks meet."""

    def step(self, state: State) -> None:
        """Advance the state in place by one step.

        Afterwards

        * `time` and `step` have gone on, and `numbers["lag"]` says how far the faults are behind `time`, if they are;
        * the arrays of nodes and faults are still the same objects, which others hold;
        * `force` is zero: steps gather internal forces in it;
        * driven edges are where they have to be at `time`, and move as they have to at the time of the velocity;
        * `energy` has grown by what friction and damping took and boundaries gave, of what this rank owns;
        * what the next step needs beyond that is in `fields` and `numbers`, such as its size (``dt``): checkpoints keep
          them, and the stepper, bound anew to the same model, goes on from there as if nothing had been.

        Raises
        ------
        RuptfxError
            On all ranks if `collective`, else maybe on one.
        """

    def energies(self, state: State) -> dict[str, float]:
        """Energy budget over all ranks [J], all of `fields.ENERGIES`; collective.

        At the time of the velocity, where the scheme balances it.
        """


class StagedMotion(Motion, Protocol):
    """A motion that takes turns with others, which have other loads and damping.

    Its steps end at `Loads.end` where they may be of any length, else with the first one behind it.
    """

    def leave(self, state: State) -> None:
        """Leave a state with which another motion can go on; collective."""

    def enter(self, state: State) -> None:
        """Go on from what another motion has left; collective."""


class Stepper(Alternative):
    """The contract of a time stepper."""

    ways: ClassVar[tuple[Way, ...]] = ("explicit",)
    """How it asks interfaces for their traction: from what is known at the time (explicit), or with the displacement it
    is solved with (implicit). The contact method must be able to do all of them."""
    second_order: ClassVar[bool] = True
    """Whether its error falls with the square of the step, with all options as they are; False where they decide."""
    conserving: ClassVar[dict[str, object] | None] = None
    """Fields with which the energy budget closes to round-off; None if it does not."""
    closure: ClassVar[float] = 1e-9
    """Bound of what its energy budget leaves open, relative to the largest work of the boundaries, with all options as
    they are and steps that resolve the loading."""
    why_open: ClassVar[str] = ""
    """Reason for a bound that is larger than rounding and the tolerances of solvers."""
    keeps_ties: ClassVar[bool] = False
    """Whether nodes that are tied to each other move alike in it."""
    inertia: ClassVar[bool] = True
    """Whether it solves the equation of motion, or only equilibrium: then nothing with `waves` has an effect."""
    adaptive: ClassVar[bool] = False
    """Whether its steps vary."""
    staged: ClassVar[bool] = False
    """Whether loading may come in stages: it is bound anew for each of them, to a `StagedMotion`."""
    sliding: ClassVar[bool] = True
    """Whether interfaces may slide."""
    fracture: ClassVar[bool] = False
    """Whether bodies may break."""
    large_rotations: ClassVar[bool] = False
    """Whether bodies may turn by any angle."""
    attachments: ClassVar[bool] = False
    """Whether its steps ask mechanisms for their forces, so that masses and springs may be attached to the bodies."""
    multipliers: ClassVar[bool] = True
    """Whether the contact method may depend on multipliers, which outer iterations find."""
    elastic_contact_only: ClassVar[bool] = False
    """Whether the contact method must have a stiffness."""

    def fixed(self, model: Model) -> Self:
        """Itself with the step that it takes for a model, in place of one that it would choose for another."""
        return self

    def bind(self, model: Model) -> Motion:
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
    AnyStepper = alternative("ruptfx.steppers")
