"""Arguments, axes, units and remarks that all figures share.

A figure is a function `draw(sheet, record, *, ...)` with the decorator `figure`. Its public form is
`draw(record, ax=None, *, times=None, ..., units=None)`, which returns the axes.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import wraps
from textwrap import indent
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ruptfx import RuptfxError
from ruptfx.input.quantities import factor
from ruptfx.input.schema import nearest
from ruptfx.results.figure_style import (
    WIDTH,
    Array,
    NotebookFigure,
    blank_figure,
    known_unit,
    letter,
    note,
    remark,
    scale,
)
from ruptfx.results.figure_style import style as house_style

Window = Sequence[float | None]
"""First and last value; None is that of the run."""

_remarks: WeakKeyDictionary[Axes, str] = WeakKeyDictionary()

SHARED = {
    "record": ("Record or Files", "The run."),
    "ax": ("matplotlib.axes.Axes, optional",
           "Axes to draw into, for a figure of one panel. Default: new ones on a new figure."),
    "times": ("(float, float), optional", "First and last time to use [s]; None is that of the run."),
    "at": ("float or sequence of float, optional", "Times of panels or lines [s]; the nearest saved ones are used."),
    "x": ("(float, float), optional", "First and last position to use [m]; None is that of the run."),
    "field": ("str or sequence of str, optional", "What to draw."),
    "units": ("dict of str to str, optional",
              'Units on the axes by quantity, such as ``{"time": "ms", "x": "mm"}``. Default: readable ones.'),
}  # fmt: skip
"""Type and meaning of the arguments that figures share."""


class Panels(np.ndarray):
    """Axes of a figure with several panels, in the order of their letters; a notebook shows the figure."""

    @classmethod
    def of(cls, axes: Array | Iterable[Axes]) -> Panels:
        """Return the array of these axes."""
        if not isinstance(axes, np.ndarray):
            listed = list(axes)
            axes = np.empty(len(listed), dtype=object)
            axes[:] = listed
        return axes.view(cls)

    @property
    def figure(self) -> Figure:
        """The figure of all panels."""
        result: Figure = self.flat[0].figure
        return result

    def _repr_png_(self) -> bytes | None:
        return self.figure._repr_png_() if self.size and isinstance(self.figure, NotebookFigure) else None


class Sheet:
    """Axes of one figure, the units on them, and what its reader must know.

    Parameters
    ----------
    name : str
        Name of the figure.
    ax : Axes, optional
        Axes of the user, instead of a new figure.
    units : dict of str to str, optional
        Units by quantity.
    """

    def __init__(self, name: str, ax: Axes | None = None, units: Mapping[str, str] | None = None) -> None:
        if ax is not None and not isinstance(ax, Axes):
            raise RuptfxError(f"plots.{name}: ax is one matplotlib Axes, not {type(ax).__name__}")
        self.name, self._given, self._units = name, ax, dict(units or {})
        self._known: dict[str, str] = {}
        self._axes: Array | list[Axes] = []
        self._choices = "leave out ax"
        self._texts = ""

    @property
    def is_given(self) -> bool:
        """Return whether the axes are those of the user."""
        return self._given is not None

    @property
    def figure(self) -> Figure:
        """The figure of the axes."""
        result: Figure = np.asarray(self._axes).flat[0].figure
        return result

    def choose(self, field: str | Sequence[str] | None, panels: Sequence[str]) -> list[str]:
        """Return the names of the wanted panels, all of them by default.

        Raises
        ------
        RuptfxError
            There is no such panel.
        """
        wanted = list(panels) if field is None else [field] if isinstance(field, str) else list(field)
        self._choices = f"choose one with field = {', '.join(map(repr, panels))}, or leave out ax"
        for name in wanted:
            if name not in panels:
                raise RuptfxError(f"plots.{self.name}: field = '{name}': {nearest(name, list(panels))}")
        return [name for name in panels if name in wanted]

    def one_of(self, choices: str) -> None:
        """Say how one panel is chosen, for the error message where several are drawn into one."""
        self._choices = f"{choices}, or leave out ax"

    def panels(self, rows: int, columns: int, height: float, width: float = WIDTH, **options: Any) -> Array:
        """Return the axes of the figure, shape (rows, columns): new ones, or that of the user.

        Raises
        ------
        RuptfxError
            Several panels for the axes of the user.
        """
        if self._given is None:
            self._axes = blank_figure(width, height).subplots(rows, columns, squeeze=False, **options)
        else:
            self._refuse_several(rows * columns)
            self._axes = np.array([[self._given]])
        return np.asarray(self._axes)

    def mosaic(self, names: Sequence[str], rows: Any, width: float, height: float, **options: Any) -> dict[str, Axes]:
        """Return the axes of the named panels, arranged in rows; see `Figure.subplot_mosaic`."""
        if self._given is not None:
            self._refuse_several(len(names))
            polar = options.get("per_subplot_kw", {}).get(names[0], {}).get("projection") == "polar"
            if polar != (self._given.name == "polar"):
                needed = 'axes made with subplot_kw={"projection": "polar"}' if polar else "no polar axes"
                raise RuptfxError(f"plots.{self.name}: the panel '{names[0]}' needs {needed}")
            self._axes = [self._given]
            return {names[0]: self._given}
        made: dict[str, Axes] = blank_figure(width, height).subplot_mosaic(rows, **options)
        self._axes = [made[name] for name in names]
        return made

    def _refuse_several(self, count: int) -> None:
        if count > 1:
            raise RuptfxError(f"plots.{self.name}: {count} panels do not fit into one ax; {self._choices}")

    def empty(self, text: str, x: str = "x (m)", y: str = "y (m)") -> None:
        """Draw a small panel with these labels and the reason why it is empty."""
        ax = self.panels(1, 1, 2.0, WIDTH / 2)[0, 0]
        ax.set(xlabel=x, ylabel=y)
        note(ax, text)

    def scale(self, quantity: str, values: Array | float, unit: str) -> tuple[float, str]:
        """Return size and name of the unit of a quantity on the axes: the one that was asked for, or a readable one.

        Raises
        ------
        RuptfxError
            The unit is unknown, or of another kind.
        """
        self._known[quantity] = unit
        wanted = self._units.get(quantity)
        if wanted is None:
            return scale(values, unit) if known_unit(unit) else (1.0, unit)
        try:
            size = float(factor(wanted, unit))
        except ValueError as error:
            raise RuptfxError(f"plots.{self.name}: units of {quantity}: {error}") from None
        return size, re.sub(r"\bu(?=[a-zA-Z])", "µ", wanted)

    def asks(self, quantity: str) -> bool:
        """Return whether the user gave a unit for a quantity."""
        return quantity in self._units

    def letter(self, axes: Array | Iterable[Axes]) -> None:
        """Give panels their letters; these axes are what the figure returns."""
        self._axes = axes if isinstance(axes, np.ndarray) else list(axes)
        if not self.is_given and np.size(np.asarray(self._axes)) > 1:
            letter(np.asarray(self._axes).flat)

    def remark(self, *texts: str) -> None:
        """Write what a reader must know below the figure; in the axes of a user it is kept for `plots.remarks`."""
        self._texts = " ".join(text for text in texts if text)
        if not self.is_given:
            remark(self.figure, *texts)

    def finish(self) -> Axes | Panels:
        """Return the axes: one, or an array of several.

        Raises
        ------
        RuptfxError
            A unit is of a quantity that the figure does not have.
        """
        for quantity in self._units:
            if quantity not in self._known:
                known = ", ".join(f"{name} [{unit}]" for name, unit in self._known.items())
                raise RuptfxError(f"plots.{self.name}: units of '{quantity}': this figure has {known}")
        axes = Panels.of(self._axes)
        for ax in axes.flat:
            _remarks[ax] = self._texts
        return axes.flat[0] if axes.size == 1 else axes


def figure_of(axes: Axes | Panels) -> Figure:
    """Return the figure that axes belong to, also if they are in a part of it."""
    ax = axes if isinstance(axes, Axes) else np.asarray(axes).flat[0]
    figure = ax.get_figure(root=True)
    assert isinstance(figure, Figure)
    return figure


def remarks(axes: Axes | Panels) -> str:
    """Return what a reader of a figure must know, for its caption: what is left white, what is not resolved.

    Parameters
    ----------
    axes : Axes or Panels
        As a figure returned them. Figures that are drawn into axes of yours do not print it below them.
    """
    return _remarks.get(axes if isinstance(axes, Axes) else np.asarray(axes).flat[0], "")


def figure(draw: Callable[..., None]) -> Callable[..., Any]:
    """Make the public form of a figure, which takes `ax`, `times` and `units` and returns axes.

    Parameters
    ----------
    draw : callable
        `draw(sheet, record, *, ...)`; its keywords are arguments of the figure.
    """
    return _public(draw, times=True)


def figure_of_whole_run(draw: Callable[..., None]) -> Callable[..., Any]:
    """Make the public form of a figure that takes no part of a run, such as statistics of all events."""
    return _public(draw, times=False)


def _public(draw: Callable[..., None], times: bool) -> Callable[..., Any]:
    """Return a figure with the shared arguments in its signature and docstring."""
    keyword = inspect.Parameter.KEYWORD_ONLY
    _, record, *own = inspect.signature(draw).parameters.values()
    window = [inspect.Parameter("times", keyword, default=None, annotation="Window | None")] if times else []
    axes = inspect.Parameter("ax", inspect.Parameter.POSITIONAL_OR_KEYWORD, default=None, annotation="Axes | None")
    units = inspect.Parameter("units", keyword, default=None, annotation="Mapping[str, str] | None")
    public = [record, axes, *window, *own, units]
    named = [each.name for each in public[1:]]
    title = draw.__name__

    signature = inspect.Signature(public, return_annotation="Axes | Panels")

    @wraps(draw)
    def drawn(*value: Any, **options: Any) -> Axes | Panels:
        for name in options:
            if name not in ("record", *named):
                raise RuptfxError(f"plots.{title}: it takes {', '.join(named[:-1])} and {named[-1]}, not {name}")
        options = signature.bind(*value, **options).arguments
        record, between, wanted = options.pop("record"), options.pop("times", None), options.pop("units", None)
        with house_style():
            sheet = Sheet(title, options.pop("ax", None), wanted)
            if between is None:
                draw(sheet, record, **options)
            else:
                with record.between(*pair(title, "times", between)) as part:
                    draw(sheet, part, **options)
            return sheet.finish()

    # The site reads defaults from the source, and that of `draw` does not have them all.
    del drawn.__wrapped__
    drawn.__signature__ = signature  # type: ignore[attr-defined]
    drawn.__doc__ = _documented(inspect.getdoc(draw) or "", [each.name for each in public])
    return drawn


def pair(title: str, name: str, window: Window) -> tuple[float | None, float | None]:
    """Return both ends of a window.

    Raises
    ------
    RuptfxError
        It has not two ends, or the first is not the lower one.
    """
    ends = [] if isinstance(window, (int, float, str)) else list(window)
    if len(ends) != 2:
        single = "; single times are given by at" if name == "times" else ""
        raise RuptfxError(f"plots.{title}: {name} has two ends, the first and the last{single}; not {window}")
    low, high = ends
    if low is not None and high is not None and not high > low:
        raise RuptfxError(f"plots.{title}: {name} = ({low:g}, {high:g}): the last must be larger than the first")
    return low, high


def _documented(text: str, names: list[str]) -> str:
    """Return a docstring with the parameters that figures share, in the order of the signature."""
    head, _, own = text.partition("\n\nParameters\n----------\n")
    described = dict(re.findall(r"^(\w+)(?: : .*)?\n((?:    .*\n?)*)", own, re.M))
    types = dict(re.findall(r"^(\w+) : (.*)$", own, re.M))
    rows = []
    for name in names:
        kind, meaning = SHARED.get(name, ("", ""))
        details = described.get(name, "").strip("\n") or (indent(meaning, "    ") if meaning else "")
        rows.append(f"{name} : {types.get(name, kind)}" + (f"\n{details}" if details else ""))
    returned = "Returns\n-------\nAxes or Panels\n    The axes; an array of them where there are several panels."
    return f"{head}\n\nParameters\n----------\n" + "\n".join(rows) + f"\n\n{returned}\n"
