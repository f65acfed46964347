"""Stress of an interface and its bodies in the initial state, from which displacements are measured.

It is in equilibrium with the loads that press the bodies together; boundaries act in addition.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field, model_validator

from ruptfx.bodies.initial_stress import tractions as resolved
from ruptfx.input.profiles import evaluate
from ruptfx.input.schema import CaseError, Part, Unit
from ruptfx.input.units import VaryingPressure, VaryingStress

if TYPE_CHECKING:
    from ruptfx.bodies.initial_stress import BodyStress
    from ruptfx.interfaces.faults.interface import Interface
    from ruptfx.laws.friction import FrictionLaw


class InitialStress(Part):
    """Initial stress of an interface: its tractions, or the stress tensor of the bodies.

    A case with the table `[initial_stress]` needs neither: both tractions follow from the stress of the bodies.
    The stress of the bodies does not affect the motion, but snapshots and fringes include it. Tractions do not define
    all of it: without a tensor the assumption is the uniform stress with the mean tractions of the interface with most
    points, without stress along that interface; in 2D a pressure that varies along a flat one is constant across it.
    Give the tensor if the bodies are also loaded sideways.
    """

    normal: VaryingPressure | None = None
    """Normal stress, positive in compression."""
    shear: VaryingStress | None = None
    """Shear traction along the (first) tangent; default is that of a rate-and-state law whose slip rate and
    state are both given, else zero."""
    rake: Annotated[float, Field(ge=-180, le=180)] | None = None
    """Direction of `shear` and of nucleations on a surface in degrees, from the first tangent (strike) to the second
    (down dip); default is 0."""
    tensor: Annotated[list[float], Field(min_length=3, max_length=6), Unit("Pa")] | None = None
    """Uniform stress of the bodies instead, the same for all interfaces that give it, tension positive: xx, yy, xy, in
    3D xx, yy, zz, xy, yz, xz."""

    @model_validator(mode="after")
    def _one_way(self) -> InitialStress:
        if self.normal is not None and self.tensor is not None:
            raise ValueError("give either normal (and shear) or tensor")
        if self.normal is None and self.shear is not None:
            raise ValueError("normal: the normal stress is missing beside shear; give it, too")
        if self.rake is not None and self.shear is None:
            raise ValueError(f"rake = {self.rake:g}: the direction of shear, which is not given; give shear, too")
        if self.tensor is not None and (self.shear is not None or len(self.tensor) not in (3, 6)):
            raise ValueError("tensor needs 3 components (xx, yy, xy), 6 in 3D; remove normal and shear")
        return self

    @property
    def of_bodies(self) -> bool:
        """True if tractions follow from the stress of the bodies, `[initial_stress]`."""
        return self.normal is None and self.tensor is None

    def matrix(self, dim: int) -> np.ndarray | None:
        """Return the tensor as a matrix, shape (dim, dim) [Pa]; None if tractions are given."""
        if self.tensor is None:
            return None
        entries = {2: [(0, 0), (1, 1), (0, 1)], 3: [(0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2)]}[dim]
        stress = np.zeros((dim, dim))
        for (i, j), value in zip(entries, self.tensor, strict=True):
            stress[i, j] = stress[j, i] = value
        return stress

    def tractions(
        self, face: Interface, law: FrictionLaw, bodies: BodyStress | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return normal stress and shear traction at the points of an interface, shapes (n,) and (n, tangents) [Pa].

        Parameters
        ----------
        face : Interface
        law : FrictionLaw
        bodies : BodyStress, optional
            Initial stress of the bodies, for interfaces that give none of their own.

        Raises
        ------
        CaseError
            If shear stress, slip rate and state of a rate-and-state law contradict each other.
        """
        shear = np.zeros((len(face.position), face.tangents))
        if self.of_bodies and bodies is not None:
            return resolved(bodies.effective(face.points), face.frame)
        tensor = self.matrix(face.frame.shape[2])
        if tensor is not None:
            local = np.einsum("ikc,cd,id->ik", face.frame, tensor, face.frame[:, 0])
            return -local[:, 0], local[:, 1:]
        value = self.at(face.locations)
        normal = evaluate(value.normal, face.locations)
        rate = law.given_slip_rate()
        carried = None
        if rate is not None:
            state = law.initial_state(normal, np.zeros_like(normal), np.zeros_like(normal))
            carried = law.strength(rate, normal, state) + np.zeros_like(normal)
        if self.shear is not None:
            shear[:, 0] = evaluate(value.shear, face.locations)
            if carried is not None and np.any(np.abs(np.abs(shear[:, 0]) - carried) > 1e-6 * normal):
                keys = [f"friction.{name}" for name in type(law).model_fields if name.endswith("_initial")]
                others = " and ".join(keys)
                raise CaseError(f"initial_stress.shear: {others} carry another; give two of the three")
        elif carried is not None:
            shear[:, 0] = carried
        return normal, shear[:, :1] * self.direction(face.tangents)

    def directions(self, normal: np.ndarray, shear: np.ndarray) -> np.ndarray:
        """Return unit vectors along which nucleations add shear traction, shape (n, tangents).

        That of the rake, or of the initial shear traction where it follows from a tensor and is not zero; else the
        first tangent.

        Parameters
        ----------
        normal : ndarray, shape (n,)
            Initial normal stress [Pa].
        shear : ndarray, shape (n, tangents)
            Initial shear traction [Pa].
        """
        tangents = shear.shape[1]
        values = np.tile(self.direction(tangents), (len(shear), 1))
        if tangents == 2 and self.normal is None:
            size = np.linalg.norm(shear, axis=1)
            # Rounding against the other traction of the same point: a largest value would be that of a rank.
            sheared = size > 1e-9 * np.abs(normal)
            values[sheared] = shear[sheared] / size[sheared, None]
        return values

    def direction(self, tangents: int) -> tuple[float, ...]:
        """Return the unit vector of `shear` along the tangents; the first tangent without a rake.

        Raises
        ------
        CaseError
            If there is a rake and one tangent only.
        """
        if self.rake is None:
            return (1.0, 0.0)[:tangents]
        if tangents < 2:
            raise CaseError(f"initial_stress.rake = {self.rake:g}: in 2D shear has one direction; leave it out")
        angle = np.deg2rad(self.rake)
        return float(np.cos(angle)), float(np.sin(angle))
