"""Parameters of materials that vary in the bodies: their values at the points of the elements.

On quadrilaterals and hexahedra the points are the nodes of the element, at which its forces are integrated; on
triangles and tetrahedra, which have one strain, the centre. Points are moved by 1e-9 of their distance to the centre of
the element, so that every element takes the values of its own side of a jump along its sides.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from ruptfx.input.profiles import PointsError
from ruptfx.input.schema import CaseError
from ruptfx.laws.materials import Material, Plane, PointError
from ruptfx.platform import fem, parallel

INWARD = 1e-9


class Variation:
    """Values of the parameters that vary, by body.

    Parameters
    ----------
    space : dolfinx FunctionSpace
        Displacements.
    names : sequence of str
        Of the bodies, for messages.
    cell_body : ndarray of int, shape (local cells,)
        Index of the body of every cell.
    materials : sequence of Material
        In the order of the bodies.

    Attributes
    ----------
    given : list of Material
        With the profiles of the case.
    references : list of Material
        With numbers: those of the point with the slowest S waves, in anisotropic bodies of that with the highest
        density.
    fastest : ndarray, shape (bodies,)
        Largest speed of P waves in every body, in antiplane of S waves [m/s].

    Raises
    ------
    CaseError
        On all ranks: a profile that does not cover its body, values outside of their bounds.
    """

    def __init__(
        self, space: fem.dolfinx.fem.FunctionSpace, names: Sequence[str], cell_body: np.ndarray,
        materials: Sequence[Material], plane: Plane,
    ) -> None:  # fmt: skip
        self._space, self._body, self._plane = space, cell_body, plane
        self.given = list(materials)
        self._row = np.zeros(len(self._body), dtype=np.int64)  # of a cell among those of its body
        self._values: list[dict[str, np.ndarray]] = []
        error: CaseError | None = None
        refused = np.zeros((0, 1 + space.mesh.geometry.dim))  # number of the body, point
        for number, (name, material) in enumerate(zip(names, materials, strict=True)):
            cells = np.flatnonzero(self._body == number)
            self._row[cells] = np.arange(len(cells))
            evaluated: dict[str, np.ndarray] = {}
            if material.varying and error is None:
                try:
                    evaluated = self._evaluated(material, cells)
                except PointsError as caught:
                    error, refused = caught, np.insert(caught.points, 0, number, axis=1)
                except (CaseError, ValueError) as caught:
                    error = CaseError(f"materials.{name}.{caught}")
            self._values.append(evaluated)
        error = self._of_all_ranks(error, refused, names)
        parallel.raise_on_all(space.mesh.comm, error)
        self.references = [self._reference(number) for number in range(len(self.given))]
        speeds = self.evaluate(lambda material, number: self.impedance(
            material, number, True, self.references[number].wave_speeds(plane).c_p * self.references[number].density
        ) / material.density)  # fmt: skip
        self.speed_of_cells = speeds.max(axis=1)
        self.fastest = np.array([
            parallel.largest(space.mesh.comm, float(speeds[cell_body == number].max(initial=0.0)))
            for number in range(len(self.given))
        ])  # fmt: skip

    def _of_all_ranks(self, error: CaseError | None, refused: np.ndarray, names: Sequence[str]) -> CaseError | None:
        """Return the error of this rank, one about points with those of the first body on all ranks; collective."""
        everywhere = parallel.share_rows(self._space.mesh.comm, refused)
        if not len(everywhere) or (error is not None and not isinstance(error, PointsError)):
            return error
        body = int(everywhere[:, 0].min())
        if not isinstance(error, PointsError) or refused[0, 0] != body:
            return None
        points = everywhere[everywhere[:, 0] == body, 1:]
        return CaseError(str(PointsError(f"materials.{names[body]}: {error.reason}", points, error.remedy)))

    @staticmethod
    def needed(materials: Sequence[Material]) -> bool:
        """Return whether a parameter of some material varies."""
        return any(material.varying for material in materials)

    def points(self, cells: np.ndarray) -> np.ndarray:
        """Return the points of cells, shape (cells, points, dimensions) [m]."""
        mesh = self._space.mesh
        x = self._space.tabulate_dof_coordinates()[:, : mesh.geometry.dim][self._space.dofmap.list[cells]]
        centre = x.mean(axis=1, keepdims=True)
        if mesh.basix_cell().name in ("triangle", "tetrahedron"):
            return centre
        return np.asarray(x + INWARD * (centre - x))

    def _evaluated(self, material: Material, cells: np.ndarray) -> dict[str, np.ndarray]:
        points = self.points(cells)
        flat = material.values_at(points.reshape(-1, points.shape[-1]))
        if len(cells):
            try:
                material.with_values(flat).check_values()
            except PointError as error:
                place = ", ".join(f"{x:.6g}" for x in points.reshape(-1, points.shape[-1])[error.index])
                raise CaseError(f"{error}; the worst point is ({place}) m") from None
        return {key: values.reshape(points.shape[:2]) for key, values in flat.items()}

    def _reference(self, number: int) -> Material:
        """Return the material at the point with the slowest S waves; collective."""
        material, values = self.given[number], self._values[number]
        if not material.varying:
            return material
        local = self.local(number)
        lame = local.lame(self._plane)
        order = np.asarray(-local.density if lame is None else lame[1] / local.density)
        order = np.broadcast_to(order, next(iter(values.values())).shape).ravel()
        place = int(np.argmin(order)) if len(order) else None
        point_values = [np.inf] * (1 + len(values)) if place is None else [
            float(order[place]), *(float(each.ravel()[place]) for each in values.values())]  # fmt: skip
        every = parallel.share_rows(self._space.mesh.comm, np.array([point_values]))
        _, *chosen = min(every.tolist())
        return material.with_values(dict(zip(values, chosen, strict=True)))

    def extremes(self, number: int) -> list[Material]:
        """Return the material of a body at the points of this rank where a parameter is smallest or largest."""
        values = {key: each.ravel() for key, each in self._values[number].items()}
        where = {int(find(each)) for each in values.values() if len(each) for find in (np.argmin, np.argmax)}
        return [
            self.given[number].with_values({key: float(each[point]) for key, each in values.items()})
            for point in sorted(where)
        ]

    def varies(self, number: int) -> bool:
        """Return whether a parameter of a body varies."""
        return bool(self.given[number].varying)

    def local(self, number: int, cells: np.ndarray | None = None) -> Material:
        """Return the material of a body with arrays, shape (cells, points), at all or some of its cells."""
        rows = slice(None) if cells is None else self._row[cells]
        return self.given[number].with_values({key: each[rows] for key, each in self._values[number].items()})

    def parameters(self, number: int, cells: np.ndarray) -> dict[str, np.ndarray]:
        """Return the values of the parameters that vary in a body, each of shape (cells, points)."""
        return {key: values[self._row[cells]] for key, values in self._values[number].items()}

    def at_point(self, number: int, point: np.ndarray) -> Material:
        """Return the material of a body with the numbers of one point."""
        values = self.given[number].values_at(np.asarray(point, dtype=float)[None])
        return self.given[number].with_values({key: float(each[0]) for key, each in values.items()})

    def evaluate(self, quantity: Callable[[Material, int], Any]) -> np.ndarray:
        """Return a quantity of the local materials at all points of local cells, shape (cells, points).

        Parameters
        ----------
        quantity : callable
            Of a material with numbers or arrays, and the index of its body.
        """
        points = 1 if self._space.mesh.basix_cell().name in ("triangle", "tetrahedron") else (
            self._space.dofmap.list.shape[1])  # fmt: skip
        values = np.zeros((len(self._body), points))
        for number in range(len(self.given)):
            cells = np.flatnonzero(self._body == number)
            if len(cells):
                values[cells] = quantity(self.local(number, cells), number)
        return values

    def function(self, values: np.ndarray) -> fem.dolfinx.fem.Function:
        """Return the function with given values at the points of cells, shape (cells, points)."""
        function = fem.dolfinx.fem.Function(self._scalars)
        function.x.array[self._scalars.dofmap.list[: len(values)]] = values
        return function

    def in_forms(self, number: int) -> Material:
        """Return the material of a body with functions in place of the parameters that vary."""
        if not self.varies(number):
            return self.given[number]
        cells, functions = np.flatnonzero(self._body == number), {}
        for key, values in self._values[number].items():
            every = np.ones((len(self._body), values.shape[1]))  # cells of other bodies do not use it
            every[cells] = values
            functions[key] = self.function(every)
        return self.given[number].with_values(functions)

    @cached_property
    def _scalars(self) -> fem.dolfinx.fem.FunctionSpace:
        return fem.scalars_of_cells(self._space.mesh, self._space.element.basix_element.degree)

    def impedance(self, material: Material, number: int, along_normal: bool, diagonal: float) -> Any:
        """Return the traction per velocity of plane waves [Pa s/m], with the numbers or arrays of a material.

        Parameters
        ----------
        material : Material
            Of `local`.
        number : int
            Of its body.
        along_normal : bool
            True for motion along the normal, P waves; False for motion across it.
        diagonal : float
            The impedance of the reference, which anisotropic bodies scale by the root of the density.
        """
        if not self.varies(number):
            return diagonal
        lame = material.lame(self._plane)
        if lame is None:
            return diagonal * np.sqrt(material.density / self.references[number].density)
        modulus = lame[0] + 2 * lame[1] if along_normal and self._plane != "antiplane" else lame[1]
        return np.sqrt(material.density * modulus)
