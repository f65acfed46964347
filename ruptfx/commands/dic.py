"""`ruptfx dic`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from ruptfx import RuptfxError
from ruptfx.commands._shared import reported, screen

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure


def dic(
    before: Annotated[Path, typer.Argument(help="Picture of the speckled surface, undeformed.", show_default=False)],
    after: Annotated[Path, typer.Argument(help="Picture after the deformation, of the same size.", show_default=False)],
    subset: Annotated[int, typer.Option(help="Side of the correlated square in pixels, odd.")] = 21,
    window: Annotated[int | None, typer.Option(help="Side of the strain window in pixels; default: --subset.")] = None,
    pixel: Annotated[str | None, typer.Option(help="Size of a pixel, in m or as '20 um'; else in pixels.")] = None,
    out: Annotated[Path, typer.Option(help="Name without ending; .png and .nc are written.")] = Path("dic"),
) -> None:
    """Compute displacements and strains from two pictures by digital image correlation; needs the extra dic.

    Example: ruptfx dic before.png after.png --pixel 20e-6 --out strains
    """
    with reported():
        import xarray

        from ruptfx.analysis.image_correlation import displacements, strains

        size, unit = (1.0, "pixel") if pixel is None else (_metres(pixel), "m")
        moved = displacements(_grey(before), _grey(after), subset)
        fields = {f"displacement_{name}": (size * values, unit) for name, values in zip("xy", moved, strict=True)}
        fields |= {f"strain_{name}": (values, "1") for name, values in strains(*moved, window or subset).items()}
        rows, columns = moved[0].shape
        data = xarray.Dataset(
            {
                name: (("y", "x"), values, {"units": units, "long_name": name.replace("_", " ")})
                for name, (values, units) in fields.items()
            },
            {name: (name, size * np.arange(n), {"units": unit}) for name, n in (("y", rows), ("x", columns))},
            {"subset": subset, "window": window or subset, "before": str(before), "after": str(after)},
        )
        try:
            out.parent.mkdir(parents=True, exist_ok=True)
            data.to_netcdf(out.with_suffix(".nc"), engine="h5netcdf")
            _draw(data, out.with_suffix(".png"))
        except OSError as error:
            raise RuptfxError(f"{out}: cannot be written: {error}") from None
        for name in ("strain_xx", "strain_yy", "strain_xy"):
            low, middle, high = np.nanquantile(data[name], [0.01, 0.5, 0.99])
            screen.print(f"{name}: {middle:.3g}, from {low:.3g} to {high:.3g}", soft_wrap=True)
        screen.print(f"{out.with_suffix('.png')}, {out.with_suffix('.nc')}", soft_wrap=True)


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
    from PIL import Image

    try:
        with Image.open(path) as picture:
            return np.asarray(picture.convert("F"), dtype=float)[::-1]
    except OSError as error:
        raise RuptfxError(f"{path}: no picture that can be read: {error}") from None


def _draw(data: xarray.Dataset, path: Path) -> None:
    from ruptfx.figure_style import letter, new_figure, styled

    @styled
    def figure() -> Figure:
        names, unit = ("displacement_x", "displacement_y", "strain_xx", "strain_xy"), data.x.attrs["units"]
        tall = 3.3 * data.sizes["y"] / data.sizes["x"]
        found, axes = new_figure(2, 2, 2 * min(tall, 4.0) + 1.2, sharex=True, sharey=True)
        for ax, name in zip(axes.ravel(), names, strict=True):
            part = 100.0 if name.startswith("strain") else 1.0
            values = part * data[name].values
            low, high = np.nanquantile(values, [0.01, 0.99])
            shown = ax.pcolormesh(data.x, data.y, values, vmin=low, vmax=high, cmap="viridis", rasterized=True)
            printed = "%" if part > 1 else data[name].attrs["units"]
            found.colorbar(shown, ax=ax, label=f"{name.replace('_', ' ').capitalize()} ({printed})", extend="both")
            ax.set_aspect("equal")
        for ax in axes[-1]:
            ax.set_xlabel(f"x ({unit})")
        for ax in axes[:, 0]:
            ax.set_ylabel(f"y ({unit})")
        letter(axes.ravel())
        return found

    figure().savefig(path, dpi=200)
