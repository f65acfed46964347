"""Movies of a run, from its record: a picture of the bodies, and below it the slip rate along the interface.

In three dimensions they show the outer surfaces of the bodies, or the slip rate or the contact on a surface.

Every kind of movie is one file of this folder, found by its name, or a module that a package offers as entry point,
group ``ruptfx.movies``: its function of the same name makes a `Film` of a
`Record`. GIF needs nothing more; MP4 needs the package imageio-ffmpeg or the program ffmpeg.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
from matplotlib.animation import FFMpegWriter
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from ruptfx import RuptfxError
from ruptfx.input.quantities import with_prefix
from ruptfx.input.schema import kinds, module_of, nearest
from ruptfx.results.analysis import slides_far
from ruptfx.results.analysis.raster import Raster
from ruptfx.results.figure_style import STYLE, Array, new_figure, remark, scale
from ruptfx.results.outputs import final, unwritable
from ruptfx.results.plots._record import along, has_slip_rates
from ruptfx.results.record import Record

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Told = Callable[[float, str], None]
FORMATS = ("gif", "mp4")
RESOLUTION = 110  # pixels per inch of a figure 7 inches wide


@dataclass(frozen=True)
class Film:
    """Content of a movie.

    Attributes
    ----------
    times : ndarray, shape (frames,)
        [s].
    image : callable, frame -> ndarray, shape (rows, columns)
        Lowest row first; NaN outside of the bodies.
    extent : (float, float, float, float)
        Left, right, bottom and top of the image, in the units of `x_label` and `y_label`.
    x_label, y_label, label : str
        Labels of the axes and of the colour bar.
    look : dict
        Colour options for `Axes.imshow`.
    draw : callable, Axes -> None
        Draw further static parts of the picture.
    move : callable, (Axes, frame) -> None
        Update further moving parts of the picture.
    aspect : str
        Aspect of the axes; "equal" for a picture of the bodies.
    remark : str
        Remark below the picture.
    below : callable, Axes -> callable, optional
        Draw a panel below the picture, and return the function that updates it to a time [s]. Default: the slip rate
        along a line.
    """

    times: Array
    image: Callable[[int], Array]
    extent: tuple[float, float, float, float]
    x_label: str
    y_label: str
    label: str
    look: dict[str, Any]
    draw: Callable[[Axes], None] = lambda axes: None
    move: Callable[[Axes, int], None] = lambda axes, frame: None
    aspect: str = "equal"
    remark: str = ""
    below: Callable[[Axes], Callable[[float], None]] | None = None


def bodies(record: Record, picture: Callable[[int, Raster], Array], label: str, line: str, **look: Any) -> Film:
    """Return the film of a field of the bodies: `picture` makes the image of a snapshot.

    Raises
    ------
    RuptfxError
        There are no snapshots in two dimensions.
    """
    in_two_dimensions(record)
    several_snapshots(record)
    bulk = record.bulk
    points, times = bulk["points"].values, bulk["time"].values
    if any(map(slides_far, record.interfaces.values())):
        return _that_slide(record, picture, label, line, **look)
    raster = Raster(points, bulk["cells"].values, pixels=900)
    size, unit = scale(np.ptp(points, axis=0), "m")
    look = brightest(lambda row: picture(row, raster), len(times), look)
    left, right, bottom, top = (value / size for value in raster.extent)

    def draw(axes: Axes) -> None:
        for data in record.interfaces.values():
            axes.plot(data["x"].values / size, data["y"].values / size, color=line, lw=0.7)

    return Film(
        times, lambda row: picture(row, raster), (left, right, bottom, top), f"x ({unit})", f"y ({unit})", label, look,
        draw,
    )  # fmt: skip


def several_snapshots(record: Record) -> None:
    """Refuse a run without motion of the bodies.

    Raises
    ------
    RuptfxError
        It has no snapshot, or one.
    """
    count = record.bulk.sizes["time"]
    if count < 2:
        raise RuptfxError(
            f"{record.path}: {count} snapshots; a movie needs several; reduce output.bulk_interval and run again"
        )


def in_two_dimensions(record: Record) -> None:
    """Refuse a run in three dimensions.

    Raises
    ------
    RuptfxError
        Its bodies are solids.
    """
    if record.case.get("plane") == "solid":
        raise RuptfxError(
            f"{record.path}: stresses of solids cannot be drawn as a movie; take --what velocity for their outer "
            "surfaces, --what slip_rate for the interface, --what contact if it slides far, or ruptfx export --format "
            "vtkhdf for ParaView"
        )


def _that_slide(record: Record, picture: Callable[[int, Raster], Array], label: str, line: str, **look: Any) -> Film:
    """Return the film of bodies with finite sliding, at their displaced positions."""
    bulk = record.bulk
    points, cells, times = bulk["points"].values, bulk["cells"].values, bulk["time"].values

    def places(row: int) -> Array:
        moved: Array = points + bulk["displacement"].isel(time=row).values
        return moved

    reach = np.array([(moved.min(axis=0), moved.max(axis=0)) for moved in map(places, range(len(times)))])
    frame = np.stack([reach[:, 0].min(axis=0), reach[:, 1].max(axis=0)])  # belongs to no cell

    def image(row: int) -> Array:
        return picture(row, Raster(np.vstack([places(row), frame]), cells, pixels=900))

    look = brightest(image, len(times), look)
    size, unit = scale(np.ptp(frame, axis=0), "m")
    (left, bottom), (right, top) = frame / size
    faces = list(filter(slides_far, record.interfaces.values()))

    def move(axes: Axes, row: int) -> None:
        for drawn in list(axes.lines):
            drawn.remove()
        for data in faces:
            now = data.sel(time=times[row], method="nearest")
            axes.plot(now["deformed_x"].values / size, now["deformed_y"].values / size, color=line, lw=0.7)

    return Film(times, image, (left, right, bottom, top), f"x ({unit})", f"y ({unit})", label, look, move=move)


def brightest(image: Callable[[int], Array], count: int, look: dict[str, Any]) -> dict[str, Any]:
    """Return colour options with an upper limit: a few bright pixels or facets at a tip must not darken the waves."""
    if "vmax" in look:
        return look
    sample = np.unique(np.linspace(0, count - 1, 12).astype(int))
    brightest = max(float(np.nanquantile(image(int(row)), 0.998)) for row in sample)
    return {**look, "vmax": brightest or 1.0, "extend": "max"}


def assumed(record: Record) -> str:
    """Return a remark if the initial stress of the bodies is an assumption, else an empty text."""
    stress = str(record.bulk.attrs.get("initial_stress", ""))
    return f"Initial stress {stress}." if stress.startswith("assumed") else ""


def film(record: Record, what: str) -> Film:
    """Return the film of a run.

    Raises
    ------
    RuptfxError
        Nothing of that name, or the run has no such data.
    """
    if what not in kinds(__name__):
        raise RuptfxError(f"--what {what}: {nearest(what, kinds(__name__))}")
    shoot: Callable[[Record], Film] = getattr(module_of(__name__, what), what)
    return shoot(record)


def frames(record: Record, what: str, most: int = 200) -> Iterator[tuple[float, Array]]:
    """Yield time [s] and pixels of every frame, shape (rows, columns, 3), both even numbers as video codecs require.

    Parameters
    ----------
    what : str
        The name of a file of this folder.
    most : int
        Largest number of frames, sampled evenly.

    Raises
    ------
    RuptfxError
        Nothing of that name, or the run has no such data.
    """
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(STYLE)
        yield from _drawn(record, film(record, what), most)


def _drawn(record: Record, scene: Film, most: int) -> Iterator[tuple[float, Array]]:
    chosen: Array = np.unique(np.linspace(0, len(scene.times) - 1, most).astype(int))
    look = dict(scene.look)
    extend = look.pop("extend", "neither")
    below = scene.below
    if below is None and has_slip_rates(record):
        below = partial(_profile, record, scene)
    panels = 1 + (below is not None)
    wide, high = scene.extent[1] - scene.extent[0], scene.extent[3] - scene.extent[2]
    tall = float(np.clip(6.1 * abs(high) / wide, 1.2, 5.5)) if scene.aspect == "equal" else 2.6
    figure, axes = new_figure(panels, 1, tall + 1.5 * panels - 0.6, height_ratios=[tall, 1.3][:panels])
    picture = axes[0, 0]
    picture.set_facecolor("#dbe4ec")  # pixels without a value differ from every colour of the map
    shown = picture.imshow(
        scene.image(int(chosen[0])), origin="lower", extent=scene.extent, aspect=scene.aspect,
        interpolation="antialiased", **look,
    )  # fmt: skip
    picture.set(xlabel=scene.x_label, ylabel=scene.y_label)
    scene.draw(picture)
    figure.colorbar(shown, ax=picture, label=scene.label, extend=extend, pad=0.02, aspect=15, shrink=0.9)
    update = None if below is None else below(axes[1, 0])
    remark(figure, scene.remark)
    canvas = FigureCanvasAgg(figure)
    figure.set_dpi(RESOLUTION)
    t_size, t_unit = scale(scene.times, "s")
    stamp = picture.set_title("", loc="right")
    for row in chosen:
        shown.set_data(scene.image(int(row)))
        scene.move(picture, int(row))
        stamp.set_text(f"{scene.times[row] / t_size:6.2f} {t_unit}")
        if update is not None:
            update(float(scene.times[row]))
        canvas.draw()
        figure.set_layout_engine("none")  # axes must not move between frames
        pixels = np.asarray(canvas.buffer_rgba())[..., :3]
        yield float(scene.times[row]), pixels[: len(pixels) // 2 * 2, : pixels.shape[1] // 2 * 2].copy()


def _profile(record: Record, scene: Film, axes: Axes) -> Callable[[float], None]:
    """Draw the slip rate along `record.interface`; return the function that updates it to a time [s]."""
    data = record.interface
    position, time, rate = data["position"].values, data["time"].values, np.abs(data["slip_rate"].values)
    (x_size, x_unit), (size, unit) = scale(np.ptp(position), "m"), scale(rate, "m/s")
    (line,) = axes.plot(position / x_size, 0 * position, color="#c1440e")
    place = along(record, x_size, x_unit)
    # In finite sliding bodies are drawn at displaced positions, but points are labelled by their initial position.
    axes.set(xlabel=f"{place}, before it slid" if slides_far(data) else place, ylabel=f"Slip rate ({unit})")
    axes.set_ylim(0, 1.05 * float(np.nanmax(rate)) / size or 1.0)
    left, right = (position[0] / x_size, position[-1] / x_size)
    if scene.x_label == f"x ({x_unit})" and data.attrs.get("position_measure") == "x" and not slides_far(data):
        left, right = scene.extent[:2]
    axes.set_xlim(left, right)

    def show(now: float) -> None:
        line.set_ydata(rate[int(np.argmin(np.abs(time - now)))] / size)

    return show


def save(
    record: Record,
    what: str,
    path: Path,
    rate: float = 12.0,
    most: int = 200,
    told: Told = lambda part, text: None,
) -> int:
    """Write a movie; the suffix of the file selects the format.

    Parameters
    ----------
    what : str
        The name of a file of this folder.
    path : Path
        Ends with gif or mp4.
    rate : float
        Frames per second.
    most : int
        Largest number of frames.
    told : callable, optional
        Called with the finished fraction and a text.

    Returns
    -------
    int
        Number of frames.

    Raises
    ------
    RuptfxError
        If the format is unknown, there are no data, no program can write MP4, or the disk cannot be written.
    """
    kind = path.suffix.lstrip(".").lower()
    if kind not in FORMATS:
        raise RuptfxError(f"{final(path)}: '.{kind}' is no format of movies; end the name with .gif or .mp4")
    end = float(record.case.get("duration", 1.0))

    def pictures() -> Iterator[Array]:
        for time, pixels in frames(record, what, most):
            told(time / end, f"frame at {with_prefix(float(time), 's')}")
            yield pixels

    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        return (_gif if kind == "gif" else _mp4)(pictures(), path, rate)
    except OSError as error:
        raise unwritable(path, error) or RuptfxError(
            f"{final(path)}: cannot be written ({error}); free space there, or choose another place"
        ) from None


def _gif(pictures: Iterator[Array], path: Path, rate: float) -> int:
    images = [Image.fromarray(pixels).quantize(colors=255, dither=Image.Dither.NONE) for pixels in pictures]
    images[0].save(path, save_all=True, append_images=images[1:], duration=round(1000 / rate), loop=0)
    return len(images)


def _mp4(pictures: Iterator[Array], path: Path, rate: float) -> int:
    """Write MP4 by the program ffmpeg, that of the package imageio-ffmpeg if it is there."""
    program: Any = {}
    with suppress(ImportError):
        import imageio_ffmpeg

        program = {"animation.ffmpeg_path": imageio_ffmpeg.get_ffmpeg_exe()}
    first, count = next(pictures), 1  # it sets the style, before the program
    with matplotlib.rc_context(program):
        if not FFMpegWriter.isAvailable():
            raise RuptfxError(
                f"{final(path)}: MP4 needs the package imageio-ffmpeg (pip install 'ruptfx[movie]') or the program "
                "ffmpeg; or write a .gif, which needs neither"
            )
        figure = Figure(figsize=(first.shape[1] / 100, first.shape[0] / 100), dpi=100)
        FigureCanvasAgg(figure)
        shown = figure.figimage(first)
        writer = FFMpegWriter(fps=rate, extra_args=["-crf", "17"])  # type: ignore[arg-type]
        with writer.saving(figure, str(path), 100):
            writer.grab_frame()
            for pixels in pictures:
                shown.set_data(pixels)
                writer.grab_frame()
                count += 1
    return count
