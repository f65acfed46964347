"""Initial stress of the bodies as a tensor, one kind per file; the file name is the `kind` of ``[initial_stress]``.

Displacements are measured from the initial state, in which this stress is in equilibrium with the weight of the bodies.
It is the effective stress, total stress plus pore pressure: friction and yield depend on it. The tractions of
interfaces and the initial stress of yielding materials follow from it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ruptfx.input.profiles import Profile
from ruptfx.input.schema import Alternative, alternative
from ruptfx.laws.materials import Plane

COMPONENTS = ("xx", "yy", "zz", "xy", "yz", "xz")
"""Order of the components of a stress."""
PLACES = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))


class BodyStress(Alternative):
    """Contract of an initial stress of the bodies."""

    example: ClassVar[str] = ""
    """Example table, which the contract tests evaluate in three dimensions below z = 0."""

    def effective(self, points: np.ndarray) -> np.ndarray:
        """Return the effective stress at points of the bodies, tension positive [Pa].

        Parameters
        ----------
        points : ndarray, shape (n, dimensions)
            [m].

        Returns
        -------
        ndarray, shape (n, 6)
            Components xx, yy, zz, xy, yz, xz.

        Raises
        ------
        CaseError
            A profile that does not cover the points.
        """
        raise NotImplementedError

    def pore_pressure(self, points: np.ndarray) -> np.ndarray:
        """Return the pore pressure [Pa], shape (n,); zero by default."""
        return np.zeros(len(points))

    def acceleration(self, dimensions: int) -> np.ndarray:
        """Return the acceleration of gravity that it balances [m/s2], shape (dimensions,); zero by default."""
        return np.zeros(dimensions)

    def check(self, plane: Plane) -> None:
        """Refuse what does not fit a plane.

        Raises
        ------
        ValueError
            Names the key, the value and the remedy.
        """

    @property
    def has_six(self) -> bool:
        """True if all six components are known, as yielding materials need them."""
        return True

    @property
    def everywhere(self) -> np.ndarray | None:
        """The stress where it is uniform, shape (6,) [Pa]; None where it varies."""
        return None

    def divergence(self, points: np.ndarray, step: np.ndarray) -> np.ndarray:
        """Return the divergence of the total stress by central differences [N/m3], shape (n, dimensions).

        Parameters
        ----------
        points : ndarray, shape (n, dimensions)
        step : ndarray, shape (n,)
            Distance to both sides [m].
        """
        dim = points.shape[1]
        values = np.zeros((len(points), dim))
        for axis in range(dim):
            sides = [points + sign * step[:, None] * np.eye(dim)[axis] for sign in (1, -1)]
            high, low = (
                matrices(self.effective(each)) - self.pore_pressure(each)[:, None, None] * np.eye(3) for each in sides
            )
            values += ((high - low)[:, axis, :dim]) / (2 * step[:, None])
        return values


class Component(Profile):
    """One component of an initial stress, as a parameter of a material that varies in the bodies."""

    over_body: ClassVar[bool] = True
    stress: AnyBodyStress
    """Initial stress."""
    number: int
    """Index of the component."""

    def __call__(self, position: np.ndarray) -> np.ndarray:
        return self.stress.effective(position)[:, self.number]


def matrices(stress: np.ndarray) -> np.ndarray:
    """Return stresses of shape (n, 6) as matrices, shape (n, 3, 3)."""
    values = np.zeros((len(stress), 3, 3))
    for number, (i, j) in enumerate(PLACES):
        values[:, i, j] = values[:, j, i] = stress[:, number]
    return values


def tractions(stress: np.ndarray, frame: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return normal stress, compression positive, and shear traction of points of an interface [Pa].

    Parameters
    ----------
    stress : ndarray, shape (n, 6)
        Tension positive [Pa].
    frame : ndarray, shape (n, local, components)
        Rows are the normal and the tangents, in the plane or in three dimensions.

    Returns
    -------
    ndarray, ndarray, shapes (n,) and (n, local - 1)
    """
    dim = frame.shape[2]
    local = np.einsum("ikc,icd,id->ik", frame, matrices(stress)[:, :dim, :dim], frame[:, 0])
    return -local[:, 0], local[:, 1:]


if TYPE_CHECKING:
    AnyBodyStress = BodyStress
else:
    AnyBodyStress = alternative("ruptfx.bodies.initial_stress")

Component.model_rebuild()
