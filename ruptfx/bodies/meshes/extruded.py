"""A two-dimensional mesh, extruded along z."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from ruptfx.bodies.meshes import AnyMesh, MeshSource, RawMesh
from ruptfx.input.schema import CaseError
from ruptfx.input.units import Length


class Extruded(MeshSource):
    """Hexahedra from a section of quadrilaterals, extruded from z = 0 to `thickness`.

    Bodies, edges and interfaces keep their names; the two faces of every body are `.back` (z = 0) and `.front`. Built
    on one rank, then split.
    """

    example: ClassVar[str] = (
        '{ kind = "extruded", thickness = 2e-3, layers = 2, '
        'section = { kind = "two_plates", length = 4e-3, height = 2e-3, element_size = 1e-3 } }'
    )

    section: AnyMesh
    """A mesh of plane quadrilaterals with matching interfaces."""
    thickness: Length
    """Along z."""
    layers: Annotated[int, Field(ge=1)] = 1
    """Number of elements along z."""

    def build(self) -> RawMesh:
        flat = self.section.build()
        if flat.cell != "quadrilateral" or flat.order != 1 or flat.non_matching or len(flat.open_facets) or flat.joints:
            raise CaseError(
                f"mesh.section.kind = '{self.section.kind()}': only straight quadrilaterals with matching interfaces "
                "are extruded; take another kind"
            )
        count, z = len(flat.points), np.linspace(0, self.thickness, self.layers + 1)
        points = np.concatenate([np.column_stack([flat.points, np.full(count, height)]) for height in z])
        cells = np.concatenate([
            np.hstack([flat.cells + layer * count, flat.cells + (layer + 1) * count]) for layer in range(self.layers)
        ])  # fmt: skip

        def raised(lines: np.ndarray) -> np.ndarray:
            """Return the facets above lines, in tensor order."""
            return np.concatenate([
                np.hstack([lines + layer * count, lines + (layer + 1) * count]) for layer in range(self.layers)
            ])  # fmt: skip

        edges = {name: raised(lines) for name, lines in flat.edges.items()}
        for number, body in enumerate(flat.bodies):
            own = flat.cells[flat.cell_body == number]
            edges |= {f"{body}.back": own, f"{body}.front": own + self.layers * count}
        interfaces = {name: (raised(plus), raised(minus)) for name, (plus, minus) in flat.interfaces.items()}
        return RawMesh(
            cell="hexahedron", points=points, cells=cells, bodies=flat.bodies,
            cell_body=np.tile(flat.cell_body, self.layers), edges=edges, interfaces=interfaces,
            one_sided=flat.one_sided,
        )  # fmt: skip
