"""Plane waves that enter through absorbing edges."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from ruptfx.bodies.boundaries import Action, EdgeBoundary, Force, check_vector
from ruptfx.bodies.boundaries.histories import History
from ruptfx.input.schema import CaseError, Unit
from ruptfx.input.units import Velocity
from ruptfx.laws.materials import Material, Plane
from ruptfx.laws.materials.stiffness import christoffel, tangent_stiffness
from ruptfx.platform import parallel

if TYPE_CHECKING:
    from ruptfx.bodies.space.edges import Edge
    from ruptfx.platform.fem import Expr

Vector = Annotated[list[float], Field(min_length=2, max_length=3), Unit("1")]


class IncidentWave(EdgeBoundary):
    """Plane wave from outside the mesh, and dashpots that absorb outgoing waves.

    The traction is that of the wave + impedance times (its velocity - the velocity). The velocity of the wave is
    v = velocity p f(t - (d . x - d . x_0) / c) with the direction d, the motion p and the history f; it reaches the
    bodies at time zero, x_0 being the point of the bodies that it reaches first. Name every edge that the wave passes,
    also those where it leaves: a homogeneous body then acts as a full space at any angle. An edge must be along an
    axis and of one material, as for `absorbing`.
    Source: Lysmer and Kuhlemeyer (1969); Joyner and Chen (1975).
    """

    waves: ClassVar[bool] = True
    example: ClassVar[str] = (
        '{ kind = "incident_wave", edge = "lower.bottom", wave = "P", direction = [0.5, 1.0], velocity = 1.0, '
        'history = { kind = "ricker", frequency = 3e5, delay = 4e-6 } }'
    )
    source: ClassVar[str] = "Lysmer and Kuhlemeyer (1969); Joyner and Chen (1975)"

    wave: Literal["P", "S"]
    """P or SV in the plane (motion 90 degrees to the left of the direction), SH in antiplane; S in 3D needs
    `polarisation`."""
    direction: Vector
    """Direction of propagation, a vector of any length."""
    polarisation: Vector | None = None
    """Direction of particle motion of S waves in 3D, perpendicular to the direction of propagation."""
    velocity: Velocity
    """Particle velocity where the history is 1."""
    history: History
    """Factor of the particle velocity in time."""

    def check(self, key: str, plane: Plane, components: str) -> None:
        check_vector(f"{key}.direction", self.direction, "xyz" if plane == "solid" else "xy")
        if not any(self.direction):
            raise ValueError(f"{key}.direction = {self.direction}: must not be zero")
        if plane == "antiplane" and self.wave != "S":
            raise ValueError(f"{key}.wave = '{self.wave}': plane = 'antiplane' has S waves only; use 'S'")
        if (self.polarisation is not None) != (plane == "solid" and self.wave == "S"):
            raise ValueError(
                f"{key}.polarisation: S waves in plane = 'solid' need it, all others go without; "
                f"{'give' if self.polarisation is None else 'remove'} it"
            )
        if self.polarisation is not None:
            check_vector(f"{key}.polarisation", self.polarisation, components)
            along = np.dot(self.polarisation, self.direction)
            size = np.linalg.norm(self.polarisation) * np.linalg.norm(self.direction)
            if not abs(along) < 1e-6 * size:
                raise ValueError(f"{key}.polarisation = {self.polarisation}: must be across the direction")

    def act_on(self, edge: Edge, key: str) -> Action:
        model, dashpot = edge.model, edge.dashpot()
        material = self._material(edge, key)
        stiffness = tangent_stiffness(material, model.plane)
        d = np.array(self.direction) / np.linalg.norm(self.direction)
        modulus, p = self._motion(stiffness, d)
        speed = np.sqrt(modulus / material.density)
        # Stress of the wave per velocity, by component of the traction and axis of the normal.
        stress = -np.tensordot(stiffness, d, 1)[None] if len(p) == 1 else -np.einsum("ijkl,k,l->ij", stiffness, p, d)
        stress = stress / speed

        def density(tests: list[Expr], n: Expr) -> Expr:
            return sum(float(stress[i, j]) * n[j] * tests[i] for i in range(len(p)) for j in range(len(d)))

        nodal = edge.integral(density) + dashpot * np.tile(p, model.nodes)
        dofs = np.flatnonzero(nodal)
        along = model.coordinates @ d
        first = -parallel.largest(model.comm, -along.min(initial=np.inf))
        delay = (along[dofs // model.components] - first) / speed
        force = Force(dofs, self.velocity * nodal[dofs], lambda time: self.history(time - delay))
        return Action(force=force, dashpot=dashpot)

    def _material(self, edge: Edge, key: str) -> Material:
        """Return the material at the edge, which must be one only; collective."""
        bodies = parallel.share_rows(edge.model.comm, edge.bodies)
        varying = edge.model.variation
        if varying is not None and any(varying.varies(number) for number in np.unique(bodies)):
            raise CaseError(
                f"{key}.edge = '{self.edge}': a plane wave has one material, and parameters of the body at the edge "
                "vary; give numbers, or let the wave enter through a body of its own"
            )
        materials = [edge.model.materials[number] for number in np.unique(bodies)]
        if any(material != materials[0] for material in materials):
            raise CaseError(
                f"{key}.edge = '{self.edge}': a plane wave has one material, and the edge has several; split the edge"
            )
        return materials[0]

    def _motion(self, stiffness: np.ndarray, d: np.ndarray) -> tuple[float, np.ndarray]:
        """Return the modulus [Pa] and the unit motion of the plane wave nearest to the requested polarisation."""
        if stiffness.ndim == 2:
            return float(christoffel(stiffness, d)[0, 0]), np.ones(1)
        wanted = d
        if self.wave == "S":
            wanted = np.array([-d[1], d[0]]) if self.polarisation is None else np.array(self.polarisation)
        moduli, motions = np.linalg.eigh(christoffel(stiffness, d))
        modulus = moduli[np.argmax(np.abs(wanted @ motions))]
        same = motions[:, np.abs(moduli - modulus) < 1e-9 * modulus]  # S waves of isotropic bodies
        p = same @ (wanted @ same)
        return float(modulus), p / np.linalg.norm(p)
