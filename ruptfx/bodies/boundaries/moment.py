"""Moment tensors at a point of the bodies: point sources of earthquakes, explosions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar

import numpy as np
from pydantic import Field

from ruptfx.bodies.boundaries import Action, Force, check_vector
from ruptfx.bodies.boundaries._at_point import AtPoint
from ruptfx.input.schema import Unit
from ruptfx.laws.materials import Plane

if TYPE_CHECKING:
    from ruptfx.bodies.boundaries.loading import Loads

ENTRIES = {
    "xy": [(0, 0), (1, 1), (0, 1)], "xyz": [(0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2)], "z": [(0, 0), (0, 1)],
}  # fmt: skip


class Moment(AtPoint):
    """Moment tensor at a point, the force -M_ij d delta / dx_j; in 2D on a line, per length of it [N].

    Slip s on a small area A of normal n is the double couple M = mu A (s n + n s).

    The force uses the gradient of the shape functions of the element at the point, which need not be a node; where
    elements meet, the mean of their gradients. The field is not resolved within about one element of the point.
    Source: Aki and Richards (2002), chapter 3.
    """

    example: ClassVar[str] = '{ kind = "moment", point = [5.3e-3, 2.2e-3], moment = [2.0, -1.0, 3.0], ramp = 3e-6 }'
    source: ClassVar[str] = "Aki and Richards (2002), chapter 3"

    moment: Annotated[list[float], Field(min_length=2, max_length=6), Unit("N m")]
    """xx, yy, xy; in 3D xx, yy, zz, xy, yz, xz; in antiplane zx, zy."""

    def check(self, key: str, plane: Plane, components: str) -> None:
        check_vector(f"{key}.point", self.point, "xyz" if plane == "solid" else "xy")
        if len(self.moment) != len(ENTRIES[components]):
            names = ["".join(components[i] + "xyz"[j]) for i, j in ENTRIES[components]]
            raise ValueError(f"{key}.moment: {len(names)} entries are needed ({', '.join(names)})")

    def tensor(self, components: str) -> np.ndarray:
        """Return M_ij, shape (components, dim) [N m]."""
        tensor = np.zeros((len(components), 3 if components == "xyz" else 2))
        for (i, j), value in zip(ENTRIES[components], self.moment, strict=True):
            tensor[i, j] = value
            if components != "z":
                tensor[j, i] = value
        return tensor

    def act(self, loads: Loads, key: str) -> Action:
        place = loads.inside(self.point, self.body, key)
        components = {1: "z", 2: "xy", 3: "xyz"}[loads.model.components]
        return Action(force=Force.of(place.moment(self.tensor(components)), self.factor))
