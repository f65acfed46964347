"""Ways of enforcing contact, one per file: the trial traction if the interface stayed closed and stuck.

A contact method is pointwise NumPy, traced like a friction law (`ruptfx.tracing`); the shared projection then brings
its trial back to what the friction law admits.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ruptfx.schema import Alternative, alternative

Array = Any


@dataclass(frozen=True)
class Point:
    """What a contact method may use at an interface point; shear quantities have one entry per tangent.

    Attributes
    ----------
    normal_stress_0, shear_traction_0 :
        Initial stresses [Pa], in equilibrium with the state of zero displacement; compression positive.
    opening_jump, slip_jump :
        Displacement jump [m] in the local frame, at the time of the traction.
    opening_velocity, slip_velocity :
        Velocity jump [m/s] half a step later if the interface carried its initial stress only.
    slip :
        Inelastic slip so far [m].
    dt :
        Time step [s].
    normal_impedance, shear_impedance :
        Traction per velocity jump over the step [Pa s/m], 1 / (dt w (1/m+ + 1/m-)).
    """

    normal_stress_0: Array
    shear_traction_0: list[Array]
    opening_jump: Array
    slip_jump: list[Array]
    opening_velocity: Array
    slip_velocity: list[Array]
    slip: list[Array]
    dt: Array
    normal_impedance: Array
    shear_impedance: Array


@dataclass(frozen=True)
class Trial:
    """Trial traction and how far the interface moves when it is relieved.

    Attributes
    ----------
    normal_stress : trial normal stress [Pa], negative where the interface would be pulled.
    shear_traction : trial shear traction [Pa], one entry per tangent.
    normal_compliance : opening per normal stress that cannot be carried [m/Pa].
    impedance : Z, shear traction relieved per slip rate [Pa s/m].
    """

    normal_stress: Array
    shear_traction: list[Array]
    normal_compliance: Array
    impedance: Array


class ContactMethod(Alternative):
    """The contract of a contact method."""

    def trial(self, point: Point) -> Trial:
        """Traction that would hold if the interface stayed closed and stuck."""
        raise NotImplementedError

    def dissipated(self, traction_old: Array, traction: Array, rate_old: Array, rate: Array) -> Array:
        """Frictional power [W/m2] of one shear component over the step that ends with this update."""
        raise NotImplementedError

    def lost_in_impact(self, normal_stress: Array, rate_old: Array, rate: Array) -> Array:
        """Power [W/m2] lost by a gap that closes, over the step that ends with this update.

        Parameters
        ----------
        normal_stress : [Pa]
        rate_old, rate : opening rate before and after [m/s].
        """
        return 0.0 * normal_stress

    def stored(self, normal_stress: Array, shear_traction: list[Array], opening: Array, slip: list[Array]) -> Array:
        """Elastic energy held in the interface [J/m2].

        Parameters
        ----------
        normal_stress, shear_traction :
            Tractions [Pa], at the time of the last update.
        opening, slip :
            Jumps added since then [m]: kinetic and strain energy belong to the middle of the following step.
        """
        return 0.0 * normal_stress

    def stiffness(self) -> tuple[float, float]:
        """Normal and shear stiffness [Pa/m] that the stable time step must respect; zero for rigid methods."""
        return 0.0, 0.0


if TYPE_CHECKING:
    AnyContact = ContactMethod
else:
    AnyContact = alternative("ruptfx.contact")
