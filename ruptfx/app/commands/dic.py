"""`ruptfx dic`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ruptfx import RuptfxError
from ruptfx.app.commands._shared import Overwrite, reported, screen, writing

if TYPE_CHECKING:
    import numpy as np
    import xarray
    from matplotlib.figure import Figure

HEADING = "Post-process"


def dic(
    before: Annotated[Path, typer.Argument(help="Picture of the speckled surface, undeformed.", show_default=False)],
    after: Annotated[Path, typer.Argument(help="Picture after the deformation, of the same size.", show_default=False)],
    subset: Annotated[int, typer.Option(help="Side of the correlated square in pixels, odd.")] = 21,
    window: Annotated[int | None, typer.Option(help="Side of the strain window in pixels; default: --subset.")] = None,
    pixel: Annotated[
        str | None,
        typer.Option(
            metavar="<length>", help="Size of a pixel, as '20 um', or a number in m; default: lengths in pixels."
        ),
    ] = None,
    least: Annotated[
        float, typer.Option(min=-1.0, max=1.0, help="Correlation below which a subset is lost and left blank.")
    ] = 0.7,
    out: Annotated[Path, typer.Option(help="Name without ending; .png and .nc are written.")] = Path("dic"),
    overwrite: Overwrite = False,
) -> None:
    """Compute displacements and strains from two pictures by digital image correlation; needs the extra dic.

    Example: ruptfx dic before.png after.png --pixel 20e-6 --out strains
    """
    with reported():
        import numpy as np
        import xarray

        from ruptfx.results.analysis.image_correlation import correlation, displacements, spread, strains
        from ruptfx.results.hdf5 import write_netcdf

        name = out.stem if out.suffix in (".png", ".nc") else out.name
        size, unit = (1.0, "pixel") if pixel is None else (_metres(pixel), "m")
        pictures = _grey(before), _grey(after)
        with writing(out.parent, (before, after), overwrite) as files:
            files.claim(f"{name}.nc", f"{name}.png")
        moved = displacements(*pictures, subset)
        quality = correlation(*pictures, *moved, subset)
        lost = ~(quality >= least)
        if lost.all():
            raise RuptfxError(
                f"no subset of {subset} pixels correlates by {least:g} or more with the second picture; use a larger "
                "--subset, a lower --least, or pictures of the same surface"
            )
        # A strain needs all displacements of its window.
        without = lost | spread(lost, window or subset)
        fields = {
            f"displacement_{name}": (np.where(lost, np.nan, size * values), unit)
            for name, values in zip("xy", moved, strict=True)
        }
        fields |= {
            f"strain_{name}": (np.where(without, np.nan, values), "1")
            for name, values in strains(*moved, window or subset).items()
        }
        fields["correlation"] = (quality, "1")
        rows, columns = moved[0].shape
        data = xarray.Dataset(
            {
                name: (("y", "x"), values, {"units": units, "long_name": name.replace("_", " ")})
                for name, (values, units) in fields.items()
            },
            {name: (name, size * np.arange(n), {"units": unit}) for name, n in (("y", rows), ("x", columns))},
            {"subset": subset, "window": window or subset, "least": least, "before": str(before), "after": str(after)},
        )
        with writing(out.parent, (before, after), overwrite) as files:
            write_netcdf(data, files.claim(f"{name}.nc"))
            _draw(data, files.claim(f"{name}.png"))
        half = subset // 2
        inside = lost[half : rows - half, half : columns - half]
        screen.print(f"lost subsets: {100 * inside.mean():.2g} %, of those that the first picture has whole")
        for name in ("strain_xx", "strain_yy", "strain_xy"):
            if np.isnan(data[name]).all():
                screen.print(f"{name}: no window without a lost subset", soft_wrap=True)
                continue
            low, middle, high = np.nanquantile(data[name], [0.01, 0.5, 0.99])
            screen.print(f"{name}: {middle:.3g}, from {low:.3g} to {high:.3g}", soft_wrap=True)
        screen.print(f"{out.parent / name}.png, {out.parent / name}.nc", soft_wrap=True)


def _metres(text: str) -> float:
    """Return the length [m] of a number or of a number with a unit.

    Raises
    ------
    RuptfxError
        Not a length, or not above zero.
    """
    from ruptfx.input.quantities import parse

    try:
        length = float(text)
    except ValueError:
        try:
            length = parse(text, "m")
        except ValueError as error:
            raise RuptfxError(f"--pixel {text!r}: {error}") from None
    if not 0 < length < math.inf:
        raise RuptfxError(f"--pixel {text}: must be finite and above zero; give a length such as '20 um'")
    return length


def _grey(path: Path) -> np.ndarray:
    """Read a picture as grey levels, lowest row first.

    Raises
    ------
    RuptfxError
        No picture.
    """
    import numpy as np
    from PIL import Image

    try:
        with Image.open(path) as picture:
            return np.asarray(picture.convert("F"), dtype=float)[::-1]
    except OSError as error:
        raise RuptfxError(f"{path}: no picture that can be read ({error}); give a PNG or TIFF") from None


def _draw(data: xarray.Dataset, path: Path) -> None:
    import numpy as np

    from ruptfx.results.figure_style import letter, new_figure, remark, scale, styled

    @styled
    def figure() -> Figure:
        names = ("displacement_x", "displacement_y", "strain_xx", "strain_yy", "strain_xy", "correlation")
        unit = data.x.attrs["units"]
        size, axis_unit = scale(float(max(data.x[-1], data.y[-1])), unit) if unit == "m" else (1.0, unit)
        tall = min(2.7 * data.sizes["y"] / data.sizes["x"], 4.0)
        result, axes = new_figure(3, 2, 3 * tall + 1.4, sharex=True, sharey=True)
        for ax, name in zip(axes.ravel(), names, strict=True):
            values, label = data[name].values, name.replace("_", " ").capitalize()
            if name.startswith("strain"):
                part, printed = 0.01, "%"
            elif unit == "m" and name.startswith("displacement"):
                part, printed = scale(values[np.isfinite(values)], unit)
            else:
                part, printed = 1.0, data[name].attrs["units"]
            some = values[np.isfinite(values)] / part
            low, high = np.quantile(some, [0.01, 0.99]) if len(some) else (0.0, 1.0)
            ax.set_facecolor("#dbe4ec")  # of no value
            shown = ax.pcolormesh(
                data.x / size, data.y / size, values / part, vmin=low, vmax=high, cmap="viridis", rasterized=True
            )
            text = label if printed == "1" else f"{label} ({printed})"
            result.colorbar(shown, ax=ax, label=text, extend="both", shrink=0.8, aspect=14)
            ax.set_aspect("equal")
        for ax in axes[-1]:
            ax.set_xlabel(f"x ({axis_unit})")
        for ax in axes[:, 0]:
            ax.set_ylabel(f"y ({axis_unit})")
        letter(axes.ravel())
        remark(result, f"Grey: lost subsets, with a correlation below {data.attrs['least']:g}.")
        return result

    figure().savefig(path, dpi=200)
