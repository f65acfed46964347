"""Points of a line or a surface whose slip is unknown, and the direction along which slip and tractions are compared.

Slip rates, slip and shear tractions are rows of columns: those of all points along the first tangent, then, of a
surface, along the second one. Curves, bands and the friction law are those of the part in the direction of the initial
shear stress, which of a line is its tangent.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ruptfx.input.schema import CaseError
from ruptfx.interfaces.faults.fault import Fault
from ruptfx.many_runs.adjoint.unknowns import whole
from ruptfx.readings.misfits import Reconstruction as Settings

if TYPE_CHECKING:
    from ruptfx.run.model import Model

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
OF_SURFACES, OF_LINES = ("dip_length", "points", "map_times"), ("positions",)
"""Keys of `[reconstruction]`."""


@dataclass(frozen=True)
class Geometry:
    """Points in their order; the same on all ranks.

    Attributes
    ----------
    points : ndarray, shape (n, dim)
        Coordinates [m].
    position : ndarray, shape (n,)
        Along a line, or along the strike of a surface [m].
    dip : ndarray, shape (n,), or None
        Distance down the dip of a surface [m].
    area : ndarray, shape (n,)
        Tributary lengths [m], areas of a surface [m2].
    direction : ndarray, shape (n, tangents)
        Unit vectors: of the initial shear stress, of a line 1.
    """

    points: Floats
    position: Floats
    dip: Floats | None
    area: Floats
    direction: Floats

    @classmethod
    def of_fault(cls, model: Model, fault: Fault) -> Geometry:
        """Return the points of an interface; collective."""
        face = fault.interface

        def gathered(table: Floats) -> Floats:
            return np.stack([whole(model, face, column) for column in table.T], axis=1)

        position, tangents = whole(model, face, face.position), fault.tangents
        return cls(
            gathered(face.points), position, None if face.across is None else whole(model, face, face.across),
            whole(model, face, face.area),
            np.ones((len(position), 1)) if tangents == 1 else gathered(fault.shear_direction),
        )  # fmt: skip

    @property
    def tangents(self) -> int:
        """1 of a line, 2 of a surface."""
        return int(self.direction.shape[1])

    @property
    def locations(self) -> Floats:
        """Positions as profiles read them [m], shape (n,), of a surface (n, 2)."""
        return self.position if self.dip is None else np.stack([self.position, self.dip], axis=1)

    def distance(self, point: int, other: int) -> float:
        """Return the distance of two points along the interface [m]."""
        return float(np.linalg.norm(self.locations[point] - self.locations[other]))

    def apart(self, count: int) -> float:
        """Return the distance of so many points that are spread evenly [m]."""
        extents = np.ptp(self.locations.reshape(len(self.position), -1), axis=0)
        return float((np.prod(extents) / count) ** (1 / len(extents)))

    def columns(self, points: Integers | slice = slice(None)) -> Integers:
        """Return the columns of some points."""
        numbers = np.arange(self.direction.size).reshape(self.tangents, -1)
        return np.asarray(numbers[:, points].ravel())

    def split(self, values: Floats) -> Floats:
        """Return columns by tangent, shape (tangents, ..., n)."""
        return np.moveaxis(values.reshape(*values.shape[:-1], self.tangents, -1), -2, 0)

    def along(self, values: Floats, points: Integers | slice = slice(None)) -> Floats:
        """Return the part of columns of some points in their direction, shape (..., points)."""
        if self.tangents == 1:
            return values
        parts = values.reshape(*values.shape[:-1], self.tangents, -1)
        return np.asarray(np.einsum("...ci,ic->...i", parts, self.direction[points]))

    def without_reverse(self, values: Floats, towards: float) -> Floats:
        """Return columns without their part against the direction times a sign."""
        part = self.along(values)
        change = towards * np.maximum(towards * part, 0.0) - part
        return values + (change[..., None, :] * self.direction.T).reshape(values.shape)

    def chosen(self, settings: Settings) -> Integers | None:
        """Return the points next to those of the case, None without any.

        Raises
        ------
        CaseError
            Keys of a surface for a line, and of a line for a surface.
        """
        surface = self.dip is not None
        for name in OF_LINES if surface else OF_SURFACES:
            if getattr(settings, name) is not None:
                kind, other = ("a surface", "points = [[x, y, z]]") if surface else ("a line", "positions, or nothing")
                raise CaseError(f"reconstruction.{name}: the interface is {kind}; remove the key, or give {other}")
        if settings.positions is not None:
            return np.unique([int(np.argmin(np.abs(self.position - each))) for each in settings.positions])
        if settings.points is None:
            return None
        for number, each in enumerate(settings.points):
            if len(each) != self.points.shape[1]:
                raise CaseError(f"reconstruction.points.{number} = {each}: give x, y and z of a point of the surface")
        return np.unique([int(np.argmin(np.linalg.norm(self.points - each, axis=1))) for each in settings.points])
