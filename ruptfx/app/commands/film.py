"""`ruptfx film`."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ruptfx import RuptfxError
from ruptfx.app.commands._shared import Overwrite, begin, first_given, reported, runs, screen, writing

if TYPE_CHECKING:
    import xarray

    from ruptfx.results.cameras import Camera

HEADING = "Post-process"


def cameras(context: typer.Context, incomplete: str) -> list[str]:
    """Return the names of the cameras of the run that begin with the typed text, for completion."""
    from ruptfx.results.record import Record

    items: list[str] = []
    with suppress(RuptfxError), Record(Path(first_given(context, "run") or "")) as record:
        items += [str(table.get("name")) for table in record.case.get("cameras", [])]
    return [name for name in items if name.startswith(incomplete)]


def film(
    run: Annotated[Path, typer.Argument(help="Run directory.", autocompletion=runs, show_default=False)],
    camera: Annotated[
        str | None,
        typer.Option(
            help="Name of a camera of the case, or a camera as a TOML table in braces; default: its only one.",
            autocompletion=cameras,
        ),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder of the film; default RUN/films/NAME.")] = None,
    rate: Annotated[float, typer.Option(min=0.1, max=100.0, help="Frames per second of film.gif.")] = 5.0,
    overwrite: Overwrite = False,
) -> None:
    """Make the film of a camera from the snapshots of a run: pictures, film.gif, and film.nc for xarray.

    Example: ruptfx film runs/impact --camera fringes
    """
    begin(f"reading {run}")
    with reported():
        from ruptfx.platform.progress import working
        from ruptfx.results.cameras import camera_from, camera_of
        from ruptfx.results.record import Record

        with Record(run) as record:
            chosen = camera_from(_table(camera)) if camera and "{" in camera else camera_of(record, camera)
            folder = out or run / "films" / chosen.name
            with writing(folder, overwrite=overwrite) as files:
                files.claim("frame_0000.png", "film.nc", "film.gif")
                files.remove("frame_[0-9][0-9][0-9][0-9].png")  # of an earlier film with more frames
                with working("making the film"):
                    frames = chosen.film(record)
                    _write(frames, chosen, files.place, rate)
        screen.print(f"{folder}: {frames.sizes['time']} frames, film.gif and film.nc", soft_wrap=True)


def _table(text: str) -> dict[str, object]:
    """Return a table written in braces.

    Raises
    ------
    RuptfxError
        It is no TOML.
    """
    from ruptfx.input.schema import CaseError, load_toml

    try:
        camera = load_toml(f"camera = {text}")["camera"]
    except CaseError as error:
        raise RuptfxError(f"--camera {text}: {error}") from None
    if not isinstance(camera, dict):
        raise RuptfxError(f"--camera {text}: is no table; write one in braces, or the name of a camera")
    return {"name": "camera", **camera}


def _write(frames: xarray.DataArray, camera: Camera, folder: Path, rate: float) -> None:
    """Write a picture of every frame, upper row first, and both files of all frames; points of no body are black."""
    import numpy as np
    from PIL import Image

    from ruptfx.results.hdf5 import write_netcdf

    frames.attrs["camera"] = camera.model_dump_json()
    write_netcdf(frames.to_dataset(), folder / "film.nc")
    pictures = [
        Image.fromarray(np.round(255 * np.nan_to_num(frame)).clip(0, 255).astype(np.uint8)[::-1])
        for frame in frames.values
    ]
    for number, picture in enumerate(pictures):
        picture.save(folder / f"frame_{number:04d}.png")
    first, *others = pictures
    first.save(folder / "film.gif", save_all=True, append_images=others, duration=1000 / rate, loop=0)
