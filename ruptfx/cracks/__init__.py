"""How bodies break, one way per file; the file name is the `kind` of the table ``[fracture]``.

Every inner facet of a mesh of triangles is a potential crack, an interface of two points. The bodies live in a broken
Lagrange space of order 1 on the ordinary connected mesh, and the weak form has one more term,

    integral over all inner facets of T([u]) . [v],

with the quadrature at the ends of the facets. Until a facet has failed it carries what its cohesive law and its
friction law admit, afterwards friction alone.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Annotated, ClassVar

from pydantic import Field

from ruptfx.cohesion import AnyCohesion
from ruptfx.friction import AnyFriction
from ruptfx.materials import IN_PLANE, Material, Plane
from ruptfx.schema import Alternative, CaseError, Name, Part, alternative, nearest
from ruptfx.units import Length

Pair = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*-[A-Za-z][A-Za-z0-9_]*$")]


class CrackLaws(Part):
    """What the facets between two bodies carry, or those inside of a body."""

    cohesion: AnyCohesion | None = None
    """Until they have failed; without it, they are in contact from the start."""
    friction: AnyFriction
    """While they are closed, in parallel to the cohesion: c left(D) + friction. A law without rates."""


class Fracture(Alternative):
    """The contract of a way to break."""

    rigid: ClassVar[bool] = False
    """Whether cells are tied to each other until a facet breaks; else springs are between them from the start."""

    planes: ClassVar[tuple[Plane, ...]] = IN_PLANE
    """Where bodies break."""
    isotropic: ClassVar[bool] = True
    """Whether only bodies of isotropic materials break."""

    default: CrackLaws
    """Of all facets that `pairs` does not mention."""
    pairs: dict[Pair, CrackLaws] = {}
    """By the bodies on both sides, ``"biotite-feldspar"`` in the order of the alphabet; inside of one,
    ``"quartz-quartz"``."""
    joints: dict[Name, CrackLaws] = {}
    """By the names of joints of the mesh: lines that were there before, weaker than the bodies."""
    thickness: Length = 1.0
    """Of the bodies, for the energies of events."""
    unresolved: bool = False
    """Run although process zones are much smaller than cells: strength then depends on the mesh."""

    def laws_by_pair(self, bodies: Sequence[str]) -> dict[tuple[str, str], CrackLaws]:
        """Laws of any two bodies of a mesh, by their names in the order of the alphabet.

        Raises
        ------
        CaseError
            A pair that is none.
        """
        names = sorted(bodies)
        pairs = {f"{a}-{b}": (a, b) for i, a in enumerate(names) for b in names[i:]}
        turned = {f"{b}-{a}": pair for pair, (a, b) in pairs.items()}
        for given in self.pairs:
            if given not in pairs:
                hint = f"write it in the order of the alphabet, '{turned[given]}'" if given in turned else (
                    f"no such pair of bodies, {nearest(given, list(pairs))}")  # fmt: skip
                raise CaseError(f"fracture.pairs.{given}: {hint}")
        return {pair: self.pairs.get(name, self.default) for name, pair in pairs.items()}

    def laws_of_joints(self, joints: Iterable[str]) -> dict[str, CrackLaws]:
        """Laws of the joints of a mesh that have laws of their own.

        Raises
        ------
        CaseError
            A joint that the mesh does not have.
        """
        known = list(joints)
        for given in self.joints:
            if given not in known:
                raise CaseError(f"fracture.joints.{given}: the mesh has no such joint, {nearest(given, known)}")
        return dict(self.joints)

    def all_laws(self) -> Iterator[tuple[str, CrackLaws]]:
        """With their keys in a case."""
        yield "fracture.default", self.default
        yield from ((f"fracture.pairs.{name}", laws) for name, laws in self.pairs.items())
        yield from ((f"fracture.joints.{name}", laws) for name, laws in self.joints.items())

    def stiffness(self, material: Material, plane: Plane, edge: float) -> float:
        """What a body brings to the springs of its facets [Pa/m]; those of two bodies have the mean compliance.

        Parameters
        ----------
        edge : float
            Mean length of facets [m].
        """
        raise NotImplementedError

    def of_cells(self, material: Material, plane: Plane, compliance: float) -> Material:
        """The material of cells whose facets add a compliance of their own to the body [1/Pa].

        Raises
        ------
        CaseError
            There is none.
        """
        raise NotImplementedError


if TYPE_CHECKING:
    AnyFracture = Fracture
else:
    AnyFracture = alternative("ruptfx.cracks")
