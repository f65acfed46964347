"""Contact methods, one per file: the trial traction of an interface that stays closed and sticks.

A contact method is pointwise NumPy, traced like a friction law (`ruptfx.platform.codegen.tracing`); the shared
projection then brings the trial back to tractions that the friction law admits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar, Literal

from ruptfx.input.fields import Array as Array
from ruptfx.input.schema import Alternative, alternative

Way = Literal["explicit", "implicit"]


@dataclass(frozen=True)
class Point:
    """Quantities that a contact method may use at an interface point; shear ones have one entry per tangent.

    Attributes
    ----------
    normal_stress_0, shear_traction_0 :
        Initial stresses [Pa], in equilibrium with the state of zero displacement; compression positive.
    opening_jump, slip_jump :
        Displacement jump [m] in the local frame, at the time of the traction.
    opening_velocity, slip_velocity :
        Velocity jump [m/s] half a step later under the initial stress of the interface only.
    slip :
        Inelastic slip at the previous traction [m].
    since, dt :
        Time since the previous traction, and until the next displacement [s].
    normal_impedance, shear_impedance :
        Traction per velocity jump over the coming step [Pa s/m], 1 / (dt w (1/m+ + 1/m-)).
    normal_multiplier, shear_multiplier :
        Normal stress and shear traction [Pa] of the last outer iteration (implicit steps only).
    body_stiffness :
        Stiffness of the bodies at the point with all other points fixed [Pa/m], with inertia (implicit steps only).

    In implicit steps the jumps belong to the end of the step; velocities and impedances are not known (nan).
    """

    normal_stress_0: Array
    shear_traction_0: Sequence[Array]
    opening_jump: Array
    slip_jump: Sequence[Array]
    opening_velocity: Array
    slip_velocity: Sequence[Array]
    slip: Sequence[Array]
    since: Array
    dt: Array
    normal_impedance: Array
    shear_impedance: Sequence[Array]
    normal_multiplier: Array = 0.0
    shear_multiplier: Sequence[Array] = field(default_factory=list)
    body_stiffness: Array = 0.0


@dataclass(frozen=True)
class Trial:
    """Trial traction and the compliances by which it is relieved.

    Attributes
    ----------
    normal_stress : trial normal stress [Pa], negative where the interface would be pulled.
    shear_traction : trial shear traction [Pa], one entry per tangent.
    normal_compliance : opening per normal stress beyond the admissible one [m/Pa].
    impedance : Z, shear traction relieved per slip rate [Pa s/m], one entry per tangent.
    """

    normal_stress: Array
    shear_traction: Sequence[Array]
    normal_compliance: Array
    impedance: Sequence[Array]


class ContactMethod(Alternative):
    """The contract of a contact method.

    Implicit steps differentiate the trial: opening changes the normal stress by -1 / `normal_compliance`, slip the
    shear traction by `impedance` / since, equally for all tangents, and nothing else may depend on the displacement.
    """

    offers_with: ClassVar[dict[str, str]] = {
        "sweeps_to": "sweeps", "multiplier_tolerance": "multipliers", "in_steps": "methods for other steps",
        "stiffness": "stiffness",
    }  # fmt: skip
    explicit: ClassVar[bool] = True
    """Whether explicit steps can use the trial."""
    traction_ends_slip: ClassVar[bool] = False
    """Whether an explicit step solves for the slip rate of the step which ends with the traction, rather than that
    of the one which begins with it."""
    implicit: ClassVar[bool] = False
    """Whether implicit steps can use the trial."""

    def sweeps_to(self) -> tuple[float, int] | None:
        """Return the tolerance and the largest number of sweeps of explicit steps with coupled points.

        The tolerance is a change of the tractions over the largest one. None where a method cannot
        be used there, or, as compliant contact, needs no sweeps. The trial normal stress of a method with sweeps
        changes by minus `normal_impedance` times the opening velocity: open points that cannot close are skipped.
        """
        return None

    def multiplier_tolerance(self) -> float | None:
        """Return the change of the tractions over the largest one at which outer iterations of implicit steps end.

        None where the trial does not depend on multipliers.
        """
        return None

    def in_steps(self, way: Way, coupled: bool) -> ContactMethod | None:
        """Return the method that enforces the same contact in steps of one kind, None where there is none.

        Parameters
        ----------
        way : str
        coupled : bool
            Whether neighbouring points depend on each other, because the surfaces slide on meshes that do not match, or
            because facets tie the corners of the cells beside the interface.
        """
        return self if getattr(self, way) else None

    def trial(self, point: Point) -> Trial:
        """Return the traction of an interface that stays closed and sticks."""
        raise NotImplementedError

    def dissipated(self, traction_old: Array, traction: Array, rate_old: Array, rate: Array) -> Array:
        """Return the frictional power [W/m2] of one shear component over the step that `traction_ends_slip` names.

        Parameters
        ----------
        traction_old, traction : at the previous and at this update [Pa].
        rate_old, rate : mean slip rates of the step before, and of this one [m/s].
        """
        raise NotImplementedError

    def lost_in_impact(self, normal_stress: Array, rate_old: Array, rate: Array) -> Array:
        """Return the power [W/m2] lost when a gap closes, over the step that ends with this update.

        Parameters
        ----------
        normal_stress : [Pa]
        rate_old, rate : opening rate before and after [m/s].
        """
        return 0.0 * normal_stress

    def stored(self, normal_stress: Array, shear_traction: list[Array], opening: Array, slip: list[Array]) -> Array:
        """Return the elastic energy of the interface [J/m2].

        Parameters
        ----------
        normal_stress, shear_traction :
            Tractions [Pa], at the time of the last update.
        opening, slip :
            Elastic jumps added since then [m]: kinetic and strain energy belong to the middle of the following step.
        """
        return 0.0 * normal_stress

    def stiffness(self) -> tuple[float, float]:
        """Return the normal and the shear stiffness [Pa/m] for the stable time step; zero for rigid methods."""
        return 0.0, 0.0


if TYPE_CHECKING:
    AnyContact = ContactMethod
else:
    AnyContact = alternative("ruptfx.laws.contact")
