"""Two plates with rough surfaces, one on the other, each with its own elements."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from ruptfx.bodies.meshes import MeshSource, RawMesh
from ruptfx.bodies.meshes._lattice import affordable, row_levels
from ruptfx.bodies.meshes.lobatto import nodes_between
from ruptfx.input.profiles import evaluate
from ruptfx.input.schema import CaseError, Part, Unit
from ruptfx.input.units import Coordinate, Length, VaryingHeight

Floats = NDArray[np.float64]
SAMPLES = 20  # points per element at which the gap between the surfaces is evaluated


class RoughPlate(Part):
    """One of the plates."""

    length: Length
    """Along x."""
    height: Length
    """Height without the roughness."""
    element_size: Length
    """Along the surface, and across it next to the surface; the spacing of nodes is this over the order."""
    growth: Annotated[float, Field(ge=1, le=2), Unit("1")] = 1.0
    """Ratio of the heights of neighbouring elements away from the surface."""
    left: Coordinate = 0.0
    """x of the left end."""
    profile: VaryingHeight = 0.0
    """Height of the surface, upwards, by x; its effect on the mesh decays within the plate."""

    def heights(self, x: Floats, key: str) -> Floats:
        """Return the height of the surface at x [m].

        Raises
        ------
        CaseError
            If the profile is not defined there.
        """
        try:
            return np.asarray(evaluate(self.profile, x), dtype=float)
        except CaseError as error:
            raise CaseError(f"{key}.profile: {error}") from None

    def build(self, order: int, side: int, key: str) -> tuple[Floats, NDArray[np.int64], dict[str, NDArray[np.int64]]]:
        """Return points, cells (vertices first), and the facets of the four sides by vertices.

        Parameters
        ----------
        order : int
            Order of the curved cells.
        side : int
            1 where the plate is above its surface, -1 below.
        key : str
            Key of the plate, for messages.
        """
        columns = affordable(self.length / self.element_size)
        levels = row_levels(self.height, self.element_size, self.growth)
        affordable(columns * (len(levels) - 1))
        x = nodes_between(self.left + np.linspace(0, self.length, columns + 1), order)
        away = nodes_between(levels, order)
        height = self.heights(x, key)
        depth = min(self.height, max(3 * levels[1], 3 * np.abs(height).max()))
        part = np.minimum(away / depth, 1.0)
        fading = 1 - part**3 * (10 - 15 * part + 6 * part**2)
        y = side * away + height[:, None] * fading
        if side < 0:
            y = y[:, ::-1]
        points = np.stack([np.broadcast_to(x[:, None], y.shape), y], axis=-1).reshape(-1, 2)
        number = np.arange(len(points)).reshape(y.shape)
        cells = _cells(number, order)
        corner = number[::order, ::order]
        lines = {"left": corner[0], "right": corner[-1], "bottom": corner[:, 0], "top": corner[:, -1]}
        return points, cells, {name: np.stack([line[:-1], line[1:]], axis=1) for name, line in lines.items()}


class RoughPlates(MeshSource):
    """Two plates of structured, curved quadrilaterals, `upper` above `lower`, whose surfaces are profiles.

    They may differ in length, position, elements and roughness; the interface `main` between them needs the table
    `[faults.main.sliding]`. The upper plate is shifted so that the smallest gap of the surfaces is `closest`. The
    edges are `upper.left`, `upper.right`, `upper.top`, `lower.left`, `lower.right` and `lower.bottom`.
    """

    example: ClassVar[str] = (
        '{ kind = "rough_plates", closest = 1e-4, curve_order = 2, '
        "upper = { length = 4e-3, height = 1e-3, element_size = 1e-3 }, "
        "lower = { length = 4e-3, height = 1e-3, element_size = 0.5e-3, "
        'profile = { kind = "sinusoid", amplitude = 5e-5, wavelength = 2e-3 } } }'
    )

    upper: RoughPlate
    """Upper plate; its lower side has the points of the interface."""
    lower: RoughPlate
    """Lower plate; its upper side is the opposite surface."""
    curve_order: Annotated[int, Field(ge=1, le=8)] = 4
    """Order of the polynomials that follow the profiles; not above the order of the displacement."""
    closest: Annotated[float, Field(ge=0), Unit("m")] = 0.0
    """Smallest gap between the two surfaces."""

    def build(self) -> RawMesh:
        upper, upper_cells, upper_sides = self.upper.build(self.curve_order, 1, "mesh.upper")
        lower, lower_cells, lower_sides = self.lower.build(self.curve_order, -1, "mesh.lower")
        upper[:, 1] += self.closest - self._least_distance()
        shift = len(upper)
        return RawMesh(
            cell="quadrilateral", points=np.concatenate([upper, lower]),
            cells=np.concatenate([upper_cells, lower_cells + shift]), bodies=["upper", "lower"],
            cell_body=np.repeat([0, 1], [len(upper_cells), len(lower_cells)]),
            edges={
                **{f"upper.{side}": upper_sides[side] for side in ("left", "right", "top")},
                **{f"lower.{side}": lower_sides[side] + shift for side in ("left", "right", "bottom")},
            },
            interfaces={"main": (upper_sides["bottom"], lower_sides["top"] + shift)}, non_matching={"main"},
            order=self.curve_order,
        )  # fmt: skip

    def _least_distance(self) -> float:
        """Return the smallest gap of the unshifted profiles, over the overlap of the plates [m]."""
        plates = (self.upper, self.lower)
        first, last = max(p.left for p in plates), min(p.left + p.length for p in plates)
        if first >= last:
            raise CaseError(
                f"mesh.upper.left = {self.upper.left:g}: the plates are beside each other (upper from "
                f"{self.upper.left:g} to {self.upper.left + self.upper.length:g} m, lower from {self.lower.left:g} to "
                f"{self.lower.left + self.lower.length:g} m); put one on the other"
            )
        x = np.linspace(first, last, affordable(SAMPLES * (last - first) / min(p.element_size for p in plates)) + 1)
        return float(np.min(self.upper.heights(x, "mesh.upper") - self.lower.heights(x, "mesh.lower")))


def _cells(number: NDArray[np.int64], order: int) -> NDArray[np.int64]:
    """Return cells by the nodes of a lattice, in the order of DOLFINx: vertices, edges, inside."""
    inner = range(1, order)
    places = [(0, 0), (order, 0), (0, order), (order, order)]
    places += [(i, 0) for i in inner] + [(0, j) for j in inner] + [(order, j) for j in inner]
    places += [(i, order) for i in inner] + [(i, j) for j in inner for i in inner]
    columns, rows = (count // order for count in (number.shape[0] - 1, number.shape[1] - 1))
    return np.stack(
        [number[i : i + columns * order : order, j : j + rows * order : order].ravel() for i, j in places], axis=1
    )
