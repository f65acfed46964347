"""Methods of fracture, one per file; the file name is the `kind` of the table ``[fracture]``.

Every inner facet of a mesh of triangles is a potential crack, an interface of two points. The bodies live in a broken
Lagrange space of order 1 on the ordinary connected mesh, and the weak form has one more term,

    integral over all inner facets of T([u]) . [v],

with the quadrature at the ends of the facets. A facet carries tractions by its cohesive law and its friction law until
it has failed, afterwards friction only.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, TypeVar

import numpy as np
from pydantic import Field

from ruptfx.input.schema import Alternative, CaseError, Name, Part, alternative, nearest
from ruptfx.input.units import Length
from ruptfx.laws.cohesion import AnyCohesion
from ruptfx.laws.friction import AnyFriction
from ruptfx.laws.materials import IN_PLANE, Material, Plane

Pair = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*-[A-Za-z][A-Za-z0-9_]*$")]


class CrackLaws(Part):
    """Cohesive law and friction law of the facets between two bodies, or inside of a body."""

    cohesion: AnyCohesion | None = None
    """Cohesion of facets until they fail; without it, they are in contact from the start."""
    friction: AnyFriction
    """Friction of closed facets, in parallel to the cohesion: c remaining(D) + friction. The state of a law begins to
    evolve when a facet yields."""


FacetModulus = TypeVar("FacetModulus", float, np.ndarray)
"""Young's modulus of a body [Pa]: one number, or one of every facet."""


class Fracture(Alternative):
    """The contract of a way to break."""

    rigid: ClassVar[bool] = False
    """Whether cells are tied until a facet breaks (extrinsic); otherwise springs connect them from the start."""

    implicit: ClassVar[bool] = False
    """Whether facets act in implicit steps, with those of `Stepper.fracture`."""
    planes: ClassVar[tuple[Plane, ...]] = IN_PLANE
    """Where bodies break."""
    isotropic: ClassVar[bool] = False
    """Whether only bodies of isotropic materials break."""

    default: CrackLaws
    """Laws of all facets that `pairs` does not name."""
    pairs: dict[Pair, CrackLaws] = {}
    """Laws by the bodies on both sides, ``"biotite-feldspar"`` in alphabetical order; inside of one body,
    ``"quartz-quartz"``."""
    joints: dict[Name, CrackLaws] = {}
    """Laws by the names of joints of the mesh: existing lines that are weaker than the bodies."""
    thickness: Length = 1.0
    """Thickness of the bodies, for the energies of events."""
    profiles_along: Literal["x", "y"] = "x"
    """The coordinate of facet ends that profiles of the laws' parameters take as their position."""
    unresolved: bool = False
    """Whether to run with process zones much smaller than cells, where strength depends on the mesh."""

    def laws_by_pair(self, bodies: Sequence[str]) -> dict[tuple[str, str], CrackLaws]:
        """Return the laws of any two bodies of a mesh, by their names in alphabetical order.

        Raises
        ------
        CaseError
            A pair of names that are no two bodies.
        """
        names = sorted(bodies)
        pairs = {f"{a}-{b}": (a, b) for i, a in enumerate(names) for b in names[i:]}
        turned = {f"{b}-{a}": pair for pair, (a, b) in pairs.items()}
        for value in self.pairs:
            if value not in pairs:
                hint = f"write it in the order of the alphabet, '{turned[value]}'" if value in turned else (
                    f"no such pair of bodies, {nearest(value, list(pairs))}")  # fmt: skip
                raise CaseError(f"fracture.pairs.{value}: {hint}")
        return {pair: self.pairs.get(name, self.default) for name, pair in pairs.items()}

    def laws_of_joints(self, joints: Iterable[str]) -> dict[str, CrackLaws]:
        """Return the laws of the joints of a mesh that have separate laws.

        Raises
        ------
        CaseError
            A joint that the mesh does not have.
        """
        known = list(joints)
        for value in self.joints:
            if value not in known:
                raise CaseError(f"fracture.joints.{value}: the mesh has no such joint, {nearest(value, known)}")
        return dict(self.joints)

    def all_laws(self) -> Iterator[tuple[str, CrackLaws]]:
        """Yield all laws with their keys in a case."""
        yield "fracture.default", self.default
        yield from ((f"fracture.pairs.{name}", laws) for name, laws in self.pairs.items())
        yield from ((f"fracture.joints.{name}", laws) for name, laws in self.joints.items())

    def stiffness(self, modulus: FacetModulus, edge: float) -> FacetModulus:
        """Return the contribution of a body to the springs of its facets [Pa/m].

        The springs between two bodies have the mean compliance of both.

        Parameters
        ----------
        modulus : float or ndarray
            Young's modulus of the body along the normals of the facets [Pa].
        edge : float
            Mean length of facets [m].
        """
        raise NotImplementedError

    def spring_of_collisions(self, modulus: FacetModulus, edge: float) -> FacetModulus:
        """Return the stiffness of springs between cells to which that of collision contact refers [Pa/m].

        Parameters
        ----------
        modulus, edge :
            As of `stiffness`.
        """
        return self.stiffness(modulus, edge)

    def of_cells(self, material: Material, plane: Plane, edge: float, length_per_area: float) -> Material:
        """Return the material of cells of a body whose facets add a compliance.

        Parameters
        ----------
        edge, length_per_area : float
            Mean length of facets [m], and length of the bonded ones per area of the bodies [1/m].

        Raises
        ------
        CaseError
            No such material exists.
        """
        raise NotImplementedError


if TYPE_CHECKING:
    AnyFracture = Fracture
else:
    AnyFracture = alternative("ruptfx.interfaces.cracks")

SHARED = ("rigid", "step")
"""Files of this folder that are no kinds."""
