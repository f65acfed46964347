"""Bulk materials, one per file: strain energy density in UFL, density and wave speeds."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from ruptfx.schema import Alternative, alternative
from ruptfx.units import Density, FringeConstant

Plane = Literal["stress", "strain", "antiplane", "solid"]
"""What the displacement is: two components in plane stress or strain, the one out of plane, or all three in 3D."""


class WaveSpeeds(NamedTuple):
    """Body and Rayleigh wave speeds [m/s]; `c_p` is the plate speed c_l in plane stress, and in antiplane both equal
    c_s."""

    c_p: float
    c_s: float
    c_R: float


class Material(Alternative):
    """The contract of a material."""

    density: Density
    fringe_constant: FringeConstant | None = None
    """Of the material and the light, f_sigma: stress difference times thickness of one isochromatic fringe. Fringes are
    drawn where it and `output.plate_thickness` are given."""

    def energy_density(self, strain: Any, plane: Plane) -> Any:
        """Strain energy per volume [J/m3] as a UFL expression.

        Parameters
        ----------
        strain : UFL expression
            Symmetric gradient, shape (d, d); in antiplane the gradient of the out-of-plane displacement, shape (2,).
        """
        raise NotImplementedError

    def wave_speeds(self, plane: Plane) -> WaveSpeeds:
        """Speeds of small waves about the initial state [m/s]."""
        raise NotImplementedError


if TYPE_CHECKING:
    AnyMaterial = Material
else:
    AnyMaterial = alternative("ruptfx.materials")
