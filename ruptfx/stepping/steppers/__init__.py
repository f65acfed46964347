"""Time steppers, one per file; the file name is the `kind` in a case.

A stepper never writes files and does not know the duration of the run; `ruptfx.run.simulation` requests one step after
another.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self, cast

from ruptfx.input.former_names import warn_of_former
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

    former_attributes: ClassVar[dict[str, str]] = {"ways": "time_schemes"}
    former_flags: ClassVar[dict[str, str]] = {
        "keeps_ties": "ties", "supports_ties": "ties", "staged": "stages", "elastic_contact_only": "rigid contact",
        **{name: name for name in ("inertia", "sliding", "cohesion", "gap", "fracture", "large_rotations",
                                   "attachments", "adjoint", "newmark", "memory", "multipliers")},
    }  # fmt: skip
    """Flags of the last version, which plug-ins may still set, and the capability of each in `offers`."""

    offers: ClassVar[frozenset[str]] = frozenset(
        {"inertia", "sliding", "cohesion", "gap", "newmark", "multipliers", "rigid contact"}
    )
    """What cases may have, as `ruptfx.case.support` compares it with their parts; a class adds and removes:

    * ``inertia``: it solves the equation of motion; with equilibrium only, parts that act on waves have no effect;
    * ``sliding``, ``cohesion``, ``gap``: interfaces that slide, have cohesion, or are open at the start;
    * ``ties``: tied nodes have the same motion;
    * ``stages``: it is bound again for each stage of loading, to a `StagedMotion`;
    * ``fracture``, ``large_rotations``, ``memory``: bodies that break, turn by any angle, or have memory;
    * ``attachments``: its steps ask mechanisms for their forces; ``newmark``: implicit steps with inertia follow
      Newmark's rules, with which attachments advance their masses;
    * ``adjoint``: its steps have an adjoint, so that an objective may be differentiated;
    * ``multipliers``: contact may use multipliers of outer iterations; ``rigid contact``: it needs no stiffness.
    """
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
    adaptive: ClassVar[bool] = False
    """Whether its steps vary."""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        for flag, capability in cls.former_flags.items():
            if isinstance(vars(cls).get(flag), bool):
                offered = vars(cls)[flag] != (flag == "elastic_contact_only")
                now = f"Stepper.offers {'|' if offered else '-'} {{'{capability}'}}"
                warn_of_former(f"of {cls.__name__} the flag", flag, now)
                cls.offers = cls.offers | {capability} if offered else cls.offers - {capability}

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


# Classes that still set them have no fields of these names, which pydantic would ask for their types.
Stepper.__class_vars__.update({*Stepper.former_flags, *Stepper.former_attributes})

if TYPE_CHECKING:
    AnyStepper = Stepper
else:
    AnyStepper = alternative("ruptfx.stepping.steppers")
