"""Cameras that film a run, one kind per file; the file name is the `kind` of an entry of ``[[cameras]]``.

A camera takes no part in a run: `ruptfx film` makes its frames from the snapshots of a run, whose case names it.
`ruptfx check` compares its frame rate with the interval of the snapshots.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

from pydantic import TypeAdapter, ValidationError

from ruptfx import RuptfxError
from ruptfx.input.quantities import at_most
from ruptfx.input.schema import Alternative, CaseError, Name, alternative, nearest
from ruptfx.input.units import Duration, Frequency, Length
from ruptfx.laws.materials import Plane

if TYPE_CHECKING:
    import xarray

    from ruptfx.results.record import Record


class Camera(Alternative):
    """Contract of a camera."""

    example: ClassVar[str] = ""
    """Entry of a case of two plates in plane stress, each 12 mm long and 4 mm high."""

    name: Name
    """Name of its film, in the folder `films` of a run."""
    frame_rate: Frequency
    """Frames per second."""
    exposure: Duration
    """Duration of the exposure, with which a frame begins."""
    pixel: Length
    """Size of a pixel on the bodies."""

    def check(self, key: str, plane: Plane) -> None:
        """Refuse values that do not fit each other or a plane.

        Raises
        ------
        ValueError
            Names the key, the value and the remedy.
        """
        if self.exposure * self.frame_rate > 1:
            raise ValueError(
                f"{key}.exposure = {self.exposure:g} s: longer than the {at_most(1 / self.frame_rate)} s from frame "
                "to frame; make it shorter"
            )

    def film(self, record: Record) -> xarray.DataArray:
        """Return frames from 0 (black) to 1 (white) against `time`, `y` and `x`; NaN outside of the bodies.

        Raises
        ------
        RuptfxError
            A run without the snapshots that it needs.
        """
        raise NotImplementedError


if TYPE_CHECKING:
    AnyCamera = Camera
else:
    AnyCamera = alternative("ruptfx.results.cameras")


def camera_of(record: Record, name: str | None) -> Camera:
    """Return a camera of the case of a run; without a name, its only one.

    Raises
    ------
    RuptfxError
        There is no such camera, or there are several.
    """
    tables = {str(table.get("name")): table for table in record.case.get("cameras", [])}
    if not tables:
        raise RuptfxError(
            f"{record.path}: its case has no [[cameras]]; name one as a table, such as --camera "
            '\'{ kind = "speckles", name = "film", frame_rate = 2e5, exposure = 5e-7, pixel = 5e-4 }\''
        )
    if name is None and len(tables) > 1:
        raise RuptfxError(f"{record.path}: it has several cameras; give --camera {' or '.join(tables)}")
    chosen = next(iter(tables)) if name is None else name
    if chosen not in tables:
        raise RuptfxError(f"--camera {chosen}: {nearest(chosen, list(tables))}")
    return camera_from(tables[chosen])


def camera_from(table: dict[str, Any]) -> Camera:
    """Return the camera of a table.

    Raises
    ------
    RuptfxError
        It is not valid.
    """
    try:
        camera: Camera = TypeAdapter(AnyCamera).validate_python(table)
    except ValidationError as error:
        raise CaseError.from_validation(error, "camera") from None
    return camera
