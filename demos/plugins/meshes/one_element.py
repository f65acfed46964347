"""A single element."""

from typing import ClassVar

import numpy as np

from ruptfx.plugin import Length, MeshSource, RawMesh


class OneElement(MeshSource):
    """A square on a rigid base."""

    example: ClassVar[str] = '{ kind = "one_element", size = 1e-3 }'
    size: Length
    """Length of a side."""

    def build(self) -> RawMesh:
        bottom = np.array([[0, 1]])
        return RawMesh(
            "quadrilateral", self.size * np.array([[0, 0], [1, 0], [0, 1], [1, 1]]), np.array([[0, 1, 2, 3]]),
            bodies=["upper"], cell_body=np.zeros(1, int), edges={"upper.top": np.array([[2, 3]])},
            interfaces={"main": (bottom, bottom)}, one_sided={"main": "rigid"},
        )  # fmt: skip
