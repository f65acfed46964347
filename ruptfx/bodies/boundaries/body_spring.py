"""Springs between bodies and a rigid ground at all points of the bodies."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np
from pydantic import Field, model_validator

from ruptfx.bodies.boundaries import Action, Boundary, Support
from ruptfx.input.schema import CaseError, Unit, nearest
from ruptfx.input.units import Length
from ruptfx.laws.materials import Material, Plane
from ruptfx.platform import fem

if TYPE_CHECKING:
    from ruptfx.bodies.boundaries.loading import Loads

BodyStiffness = Annotated[float, Field(gt=0), Unit("N/m4")]
WITH_WIDTH: tuple[Plane, ...] = ("strain", "antiplane")


class BodySpring(Boundary):
    """Force per volume against the displacement from the initial state: -k u.

    With `width` W, it is the 2.5-dimensional model of a long fault that slips over the width W out of the plane only:
    k = G (pi / W)^2 in antiplane and G (pi (1 - nu) / W)^2 in plane strain, with the shear modulus G and Poisson's
    ratio nu of each body. With `stiffness`, k is given: plates glued to a rigid ground by a soft layer, for example.
    Its energy counts as strain energy, and the stable time step takes its stiffness into account.
    """

    example: ClassVar[str] = '{ kind = "body_spring", stiffness = 4e15 }'
    source: ClassVar[str] = "Weng and Ampuero (2019)"

    width: Length | None = None
    """Width W of the fault out of the plane."""
    stiffness: BodyStiffness | None = None
    """Force per volume and displacement, given instead of the width."""
    body: str | None = None
    """Body that the springs act on; default: all bodies."""

    @model_validator(mode="after")
    def _one_of_both(self) -> BodySpring:
        if (self.width is None) == (self.stiffness is None):
            raise ValueError("width, stiffness: give one of them")
        return self

    def check(self, key: str, plane: Plane, components: str) -> None:
        if self.width is not None and plane not in WITH_WIDTH:
            raise ValueError(f"{key}.width: is for plane = 'strain' and 'antiplane', not '{plane}'; use stiffness")

    def act(self, loads: Loads, key: str) -> Action:
        model = loads.model
        names = model.bodies.names
        if self.body is not None and self.body not in names:
            raise CaseError(f"{key}.body = '{self.body}': no such body, {nearest(self.body, names)}")
        test = model.around(model.sum_of(fem.ufl.TestFunction(model.space)))
        dx = model.measure()
        # The quadrature of the mass keeps the stiffness diagonal.
        stiffness = fem.assemble_summed(model.space, sum(
            self._of(material, f"{key}.width", model.plane) * test * dx(number)
            for number, (name, material) in enumerate(zip(names, model.materials_in_forms(), strict=True))
            if self.body in (None, name)
        ))  # fmt: skip
        of_nodes = stiffness.reshape(-1, model.components)
        nodes = np.flatnonzero(of_nodes.any(axis=1))
        return Action(support=Support(nodes, of_nodes[nodes][:, :, None] * np.eye(model.components)))

    def _of(self, material: Material, key: str, plane: Plane) -> Any:
        """Return the stiffness per volume in a body [N/m4], a function where its moduli vary."""
        if self.width is None:
            assert self.stiffness is not None
            return self.stiffness
        constants = material.lame("strain")
        if constants is None:
            raise CaseError(f"{key}: is for isotropic bodies, not for '{material.kind()}'; use stiffness")
        first, shear = constants
        ratio = 0.5 * first / (first + shear)
        return shear * (np.pi * (1.0 if plane == "antiplane" else 1 - ratio) / self.width) ** 2
