"""Initial stress that grows with depth, in equilibrium with the weight of the rock."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field, field_validator, model_validator

from ruptfx.bodies.initial_stress import BodyStress
from ruptfx.input.profiles import evaluate
from ruptfx.input.quantities import at_least
from ruptfx.input.schema import CaseError, Part, Unit
from ruptfx.input.units import Coordinate, Density, VaryingFactor, VaryingRatio


class Layer(Part):
    """Rock of another density below a depth."""

    top: Annotated[float, Field(gt=0), Unit("m")]
    """Depth of its upper side."""
    density: Density
    """Density of the rock."""


class Depth(BodyStress):
    """Lithostatic stress less pore pressure, and horizontal stresses in proportion to it.

    With the depth d the effective vertical stress is P = integral of density g dd - fluid_density g d, a compression.
    The horizontal ones are `along` P and `across` P, and the horizontal shear stress is `shear` P. Up is z in three
    dimensions and y in the plane; `along` is x, `across` the other horizontal direction, y or z. Nothing varies
    horizontally and there is no vertical shear stress, so that it is in equilibrium with any ratios.
    """

    example: ClassVar[str] = (
        '{ kind = "depth", density = 2670.0, fluid_density = 1000.0, gravity = 9.8, along = 0.926793, '
        "across = 1.073206, shear = 0.169029, isotropic = [15e3, 20e3] }"
    )

    density: Density
    """Density of the rock, of its uppermost layer if there are `layers`; that of the materials for equilibrium."""
    layers: list[Layer] = []
    """Layers below, downwards."""
    fluid_density: Annotated[float, Field(ge=0), Unit("kg/m3")] = 0.0
    """Density of the fluid in the pores, whose pressure is hydrostatic; 0: dry rock."""
    gravity: Annotated[float, Field(gt=0), Unit("m/s2")] = 9.81
    """Acceleration of gravity."""
    surface: Coordinate = 0.0
    """Height of the surface, at depth zero."""
    along: VaryingRatio = 1.0
    """Effective horizontal stress along x over the vertical one, a number or a profile of one position, the depth."""
    across: VaryingRatio = 1.0
    """Effective horizontal stress along y, in the plane along z, over the vertical one."""
    shear: VaryingFactor = 0.0
    """Shear stress xy, in the plane xz, over the effective vertical stress P, of either sign."""
    isotropic: Annotated[list[float], Field(min_length=2, max_length=2), Unit("m")] | None = None
    """Depths between which the differences to the isotropic stress P decrease linearly to zero; the same depth twice
    for a sharp end, below which P acts in all directions."""

    @field_validator("layers")
    @classmethod
    def _downwards(cls, layers: list[Layer]) -> list[Layer]:
        if np.any(np.diff([layer.top for layer in layers]) <= 0):
            raise ValueError("layers: their tops must increase")
        return layers

    @model_validator(mode="after")
    def _compressed(self) -> Depth:
        for density in (self.density, *(layer.density for layer in self.layers)):
            if density <= self.fluid_density:
                raise ValueError(
                    f"fluid_density = {self.fluid_density:g} kg/m3: rock of {density:g} kg/m3 would float; give less"
                )
        if self.isotropic is not None and not 0 <= self.isotropic[0] <= self.isotropic[1]:
            raise ValueError(f"isotropic = {self.isotropic}: give two depths, the upper one first")
        return self

    def acceleration(self, dimensions: int) -> np.ndarray:
        return -self.gravity * np.eye(dimensions)[-1]

    def depth(self, points: np.ndarray) -> np.ndarray:
        """Return the depth of points below the surface [m], shape (n,).

        Raises
        ------
        CaseError
            Points above the surface.
        """
        depth = self.surface - points[:, -1]
        highest = float(-depth.min(initial=0.0))
        if highest > 1e-6 * max(float(np.abs(depth).max(initial=0.0)), abs(self.surface)):
            raise CaseError(
                f"initial_stress.surface = {self.surface:g} m: the bodies reach {highest:.6g} m higher, where the rock "
                f"would be under tension; make it {at_least(self.surface + highest)}"
            )
        return np.maximum(depth, 0.0)

    def overburden(self, depth: np.ndarray) -> np.ndarray:
        """Return the total vertical stress at depths, compression positive [Pa], shape (n,)."""
        tops = np.array([0.0, *(layer.top for layer in self.layers)])
        densities = np.array([self.density, *(layer.density for layer in self.layers)])
        at_tops = np.concatenate([[0.0], np.cumsum(np.diff(tops) * densities[:-1])])
        layer = np.searchsorted(tops, depth, side="right") - 1
        return np.asarray(self.gravity * (at_tops[layer] + densities[layer] * (depth - tops[layer])))

    def pore_pressure(self, points: np.ndarray) -> np.ndarray:
        return self.fluid_density * self.gravity * self.depth(points)

    def effective(self, points: np.ndarray) -> np.ndarray:
        depth = self.depth(points)
        vertical = self.overburden(depth) - self.fluid_density * self.gravity * depth
        remaining = np.ones(len(depth))
        if self.isotropic is not None:
            first, last = self.isotropic
            remaining = (
                np.clip((last - depth) / (last - first), 0, 1) if last > first else (depth < first).astype(float)
            )
        along, across = (
            -vertical * (1 + remaining * (evaluate(ratio, depth) - 1)) for ratio in (self.along, self.across)
        )
        shear, zero = vertical * remaining * evaluate(self.shear, depth), np.zeros(len(depth))
        if points.shape[1] == 3:
            return np.stack([along, across, -vertical, shear, zero, zero], axis=1)
        return np.stack([along, -vertical, across, zero, zero, shear], axis=1)
