"""A box with a rectangular fault, vertical or dipping, that reaches its surface or is buried."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field, model_validator

from ruptfx.bodies.meshes import MeshSource
from ruptfx.bodies.meshes._bricks import Bricks, rise
from ruptfx.bodies.meshes._lattice import even, graded
from ruptfx.bodies.meshes.rough_plates import in_plan
from ruptfx.input.profiles import evaluate
from ruptfx.input.quantities import at_least, at_most
from ruptfx.input.schema import CaseError, Unit
from ruptfx.input.units import Coordinate, Length, VaryingHeight

FLATTEST = 0.3  # height over the distance of the far edges: elements shrink to about half in between
STEEPEST = 1.0  # slope of the topography, 45 degrees
SHORTEST = 0.5  # elements of the surface beside a dipping fault, over their length without topography


class BoxWithFault(MeshSource):
    """Hexahedra around a rectangular fault: x along strike, z up, the surface at z = 0.

    The fault is in the plane y = 0, or dips towards +y: body `plus` is then its hanging wall, `minus` its foot wall.
    Beyond the rim of the fault the bodies are welded. Positions on the interface `main` are x and the distance down
    dip from its upper edge; slip is that of `plus` relative to `minus`. The edges are `plus.left`, `.right` (ends of
    x), `.bottom`, `.top` (the surface of the Earth), `.far` (away from the fault), and those of `minus`.

    With `half` the body `minus` is the mirror image of `plus` and is not meshed. Then the plane of the fault beyond its
    rim is an edge, `plus.plane`, which continuous bodies need at rest along x and z: two boundaries of kind `driven`
    with the velocity zero.
    """

    example: ClassVar[str] = (
        '{ kind = "box_with_fault", fault_length = 9e-3, fault_width = 4e-3, element_size = 1e-3, beyond = 2e-3, '
        "distance = 3e-3, growth = 1.1 }"
    )

    fault_length: Length
    """Along strike; a whole number of elements, else they are a little smaller than `element_size`."""
    fault_width: Length
    """Down dip."""
    element_size: Length
    """On the fault and next to it; the spacing of nodes is this over the order."""
    beyond: Length
    """Distance of the ends of the box from the fault, along x and below."""
    distance: Length
    """Distance of the far edges from the fault, along y."""
    fault_left: Coordinate | None = None
    """x of the first end of the fault; minus half its length without it."""
    fault_top: Annotated[float, Field(ge=0), Unit("m")] = 0.0
    """Depth of the upper edge; 0: it reaches the surface."""
    dip: Annotated[float, Field(ge=30, le=90)] = 90.0
    """Angle between the fault and the horizontal in degrees."""
    height: VaryingHeight = 0.0
    """Distance of a rough fault from its plane along y, a profile over x and the distance down dip in that plane, such
    as `self_affine_surface`; not with `half`. The whole box follows, less and less towards its sides. Positions are
    those in the plane."""
    topography: VaryingHeight = 0.0
    """Height of the surface, a profile over x and y, such as `surface_table` with the file of a height map. Rows of
    elements, and the fault with them, follow it less and less down to the plane bottom; the fault stays in its plane.
    Slopes are at most 45 degrees, and on a dipping fault half as steep as the fault. Not with `half` or `height`."""
    growth: Annotated[float, Field(ge=1, le=1.2), Unit("1")] = 1.15
    """Ratio of the sizes of neighbouring elements outside of the fine box around the fault."""
    fine: Annotated[float, Field(ge=0), Unit("m")] = 0.0
    """Distance from the fault over which elements keep their size."""
    half: bool = False
    """Only the half `plus` of a vertical fault: the motion of the other half is its opposite along x and z and the
    same along y, and the normal stress stays."""

    @model_validator(mode="after")
    def _two_elements(self) -> BoxWithFault:
        for name in ("fault_length", "fault_width"):
            value = getattr(self, name)
            if value < 1.5 * self.element_size:
                raise ValueError(
                    f"{name} = {value:g} m: a fault has at least two elements along each direction; make element_size "
                    f"at most {at_most(value / 2)} m"
                )
        return self

    @model_validator(mode="after")
    def _vertical_half(self) -> BoxWithFault:
        if self.half and self.dip != 90:
            raise ValueError(
                f"half = true: the sides of a fault that dips at {self.dip:g} degrees are no mirror images; leave out "
                "half, or make dip 90"
            )
        if self.half and _varies(self.height):
            raise ValueError("half = true: the sides of a rough fault are no mirror images; leave out half, or height")
        return self

    @model_validator(mode="after")
    def _topography_alone(self) -> BoxWithFault:
        if _varies(self.topography):
            for key, is_used in (("half = true", self.half), ("height", _varies(self.height))):
                if is_used:
                    raise ValueError(f"{key}: is not possible with topography; leave out one of them")
        return self

    def lattice(self) -> Bricks:
        angle = np.deg2rad(self.dip)
        sine = 1.0 if self.dip == 90 else float(np.sin(angle))
        left = -0.5 * self.fault_length if self.fault_left is None else self.fault_left
        fault = left + even(self.fault_length, self.element_size)
        outside = graded(self.beyond, self.element_size, self.growth, self.fine)
        x = np.concatenate([left - outside[:0:-1], fault, fault[-1] + outside[1:]])
        # From the surface downwards.
        size, top = sine * self.element_size, self.fault_top
        above = even(top, size) if top else np.zeros(1)
        depth = top + even(sine * self.fault_width, size)
        below = graded(self.beyond, size, self.growth, self.fine)
        z = -np.concatenate([above[:-1], depth, depth[-1] + below[1:]])[::-1]
        side = graded(self.distance, self.element_size, self.growth, self.fine)
        last = len(z) - len(above)
        bricks = Bricks(
            x=x, y=side if self.half else np.concatenate([-side[:0:-1], side]), z=z + 0.0,
            plane=0 if self.half else len(side) - 1,
            along=(len(outside) - 1, len(outside) + len(fault) - 2), down=(last - len(depth) + 1, last),
            slope=0.0 if self.dip == 90 else float(1 / np.tan(angle)), half=self.half,
            height=self.height if _varies(self.height) else None,
            topography=in_plan(self.topography, 2) if _varies(self.topography) else None,
        )  # fmt: skip
        if bricks.height is not None:
            self._not_folded(bricks)
        if bricks.topography is not None:
            self._not_steep(bricks)
        return bricks

    def _not_folded(self, bricks: Bricks) -> None:
        """Refuse heights at which elements between the fault and the far edges become too flat.

        Raises
        ------
        CaseError
        """
        x, z = (each.ravel() for each in np.meshgrid(bricks.x, bricks.z))
        sine = 1 / np.hypot(1.0, bricks.slope)
        top = bricks.z[bricks.down[1]]
        inside = (np.clip(x, *bricks.x[list(bricks.along)]), np.clip(top - z, 0, top - bricks.z[bricks.down[0]]) / sine)
        try:
            largest = float(np.abs(evaluate(self.height, np.stack(inside, axis=1))).max())
        except CaseError as error:
            raise CaseError(f"mesh.height: {error}") from None
        if largest > FLATTEST * self.distance:
            raise CaseError(
                f"mesh.height: up to {largest:.5g} m, more than {FLATTEST:g} of distance = {self.distance:g} m, over "
                f"which the box follows the fault; make distance at least {at_least(largest / FLATTEST)}, or the fault "
                "smoother"
            )

    def _not_steep(self, bricks: Bricks) -> None:
        """Refuse topography that is too high for the depth of the box, too steep, or not defined everywhere.

        Raises
        ------
        CaseError
        """
        i, j = np.indices((len(bricks.x), len(bricks.y)))
        try:
            height = rise(bricks, i.ravel(), j.ravel()).reshape(i.shape)
        except CaseError as error:
            raise CaseError(f"mesh.topography: {error}") from None
        depth, largest = float(-bricks.z[0]), float(np.abs(height).max())
        if largest > FLATTEST * depth:
            raise CaseError(
                f"mesh.topography: up to {largest:.5g} m from z = 0, more than {FLATTEST:g} of the depth of the box, "
                f"{depth:.5g} m, over which elements follow it; subtract its mean, or make beyond at least "
                f"{at_least(self.beyond + largest / FLATTEST - depth)}"
            )
        y = bricks.y[None] - bricks.slope * height
        limits = (STEEPEST, min(STEEPEST, SHORTEST / bricks.slope if bricks.slope else STEEPEST))
        for axis, limit in enumerate(limits):
            across = np.diff(bricks.x)[:, None] if axis == 0 else np.maximum(np.diff(y, axis=1), 1e-300)
            slope = np.abs(np.diff(height, axis=axis)) / across
            if slope.max() > limit:
                at = np.unravel_index(int(np.argmax(slope)), slope.shape)
                raise CaseError(
                    f"mesh.topography: rises by {slope.max():.4g} m per m along {'xy'[axis]} at "
                    f"x = {bricks.x[at[0]]:.6g}, y = {y[at]:.6g} m, more than {limit:.4g}"
                    + f", with which elements beside a fault that dips at {self.dip:g} degrees" * (limit < STEEPEST)
                    + (" keep half of their length" if limit < STEEPEST else "")
                    + "; smooth it, or make element_size larger"
                )


def _varies(height: object) -> bool:
    return not (isinstance(height, float) and height == 0)
