"""Figure of the signals of the instruments."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from textwrap import fill

import numpy as np

from ruptfx import RuptfxError
from ruptfx.input.schema import nearest
from ruptfx.results.analysis.measured import channel_label
from ruptfx.results.plots._sheet import Sheet, figure
from ruptfx.results.record import Data, Files

MOST = 12  # largest number of panels of a figure
LEGEND = 0.18  # height of a legend line over that of a panel
SHORT = 9  # letters of a label of which three fit side by side
SMALLEST = 0.1  # of the largest range of the panels of a quantity: smaller ones have an axis of their own
MARGIN = 0.05  # of the range of an axis, on both sides
LABEL = 20  # letters per line of an axis label
LINES = ("-", "--", ":")
_COMPONENT = re.compile(r"_([xyz]{1,2}|\d)$")


def suits(record: Files) -> bool:
    """Return whether the run has instruments with data, other than grids."""
    return bool(_signals(record)) and (record.path / "instruments.h5").is_file()


def _signals(record: Files) -> list[str]:
    """Return the names of the instruments that measure at one place."""
    return [str(table["name"]) for table in record.case.get("instruments", []) if table["kind"] != "receiver_grid"]


@figure
def instruments(sheet: Sheet, record: Files, *, field: str | Sequence[str] | None = None) -> None:
    """Draw samples against time: a panel per instrument and unit, without channels that are zero throughout.

    Panels of one quantity have one unit, and one scale but for those that fill less than a tenth of it.

    If there are more panels than fit a page, a remark states how many are missing.

    Parameters
    ----------
    field
        Instruments, or their channels: "G1", "G1.velocity_x". Default: all.
    """
    data = {name: record.instruments[name] for name in _signals(record)}
    panels = _panels(data, field)
    if not any(each.sizes["time"] for each in data.values()):
        sheet.empty("no sample was saved")
        return
    shown = panels[:MOST]
    columns = min(len(shown), 2)
    rows = -(-len(shown) // columns)
    sheet.one_of(f"choose one with field = '{panels[0][0]}.{panels[0][2][0]}'")
    axes = sheet.panels(rows, columns, 0.5 + 1.55 * rows, sharex=True)
    latest = max(float(each["time"].values[-1]) for each in data.values() if each.sizes["time"])
    t_size, t_unit = sheet.scale("time", latest, "s")
    zero = []
    drawn_of = {number: _drawn(data[name], channels) for number, (name, _, channels) in enumerate(shown)}
    quantities = [(_kinds(drawn_of[number])[0], unit) for number, (_, unit, _) in enumerate(shown)]
    for number, (ax, (name, unit, channels)) in enumerate(zip(axes.ravel(), shown, strict=False)):
        drawn = drawn_of[number]
        zero += [f"{name}.{channel}" for channel in channels if channel not in drawn]
        kinds = _kinds(drawn)
        alike = [i for i, quantity in enumerate(quantities) if quantity == quantities[number]]
        every = np.concatenate([np.ravel(data[shown[i][0]][channel].values) for i in alike for channel in drawn_of[i]])
        size, printed = sheet.scale(kinds[0], every, unit)
        if unit == "1" and not sheet.asks(kinds[0]):
            size, printed = 1e-6, "µε"
        for index, channel in enumerate(drawn):
            # An extension along x equals the strain xx: line styles keep both visible, and components in print.
            style = LINES[(kinds.index(_COMPONENT.sub("", channel)) if len(kinds) > 1 else index) % len(LINES)]
            named = _COMPONENT.search(channel)
            alone = named and len(kinds) == 1 and len(drawn) > 2
            label = named[1] if named and alone else channel_label(channel, data[name][channel].attrs)
            ax.plot(data[name]["time"].values / t_size, data[name][channel].values / size, style, label=label)
        limits = _limits([np.array([data[shown[i][0]][key].values for key in drawn_of[i]]) for i in alike])
        if (together := limits.get(alike.index(number))) is not None:
            ax.set_ylim(*(end / size for end in together))
        ax.set_ylabel(f"{fill(_common(drawn), LABEL)}\n({printed})")
        ax.set_title(name, loc="right")
        if len(drawn) > 1:
            longest = max(len(str(line.get_label())) for line in ax.lines)
            columns_of_legend = min(len(drawn), 3 if longest <= SHORT else 2)
            low, high = ax.get_ylim()  # room above the data, for a legend that hides none of it
            ax.set_ylim(low, high + LEGEND * -(-len(drawn) // columns_of_legend) * (high - low))
            ax.legend(loc="upper left", ncols=columns_of_legend, columnspacing=1.0, handlelength=1.6)
    for ax in axes.ravel()[: len(shown)][-columns:]:
        ax.set_xlabel(f"Time ({t_unit})")
        ax.tick_params(labelbottom=True)
    for ax in axes.ravel()[len(shown) :]:
        ax.set_visible(False)
    omitted = len(panels) - len(shown)
    sheet.letter(axes.ravel()[: len(shown)])
    sheet.remark(
        f"{omitted} more panels do not fit here; all numbers are in instruments.h5." if omitted else "",
        f"Zero throughout, and not drawn: {', '.join(zero)}." if zero else "",
    )


def _panels(data: Mapping[str, Data], field: str | Sequence[str] | None) -> list[tuple[str, str, list[str]]]:
    """Return instrument, unit and channels of every panel.

    Raises
    ------
    RuptfxError
        There is no such instrument or channel.
    """
    channels = {name: [str(key) for key in each if key != "time"] for name, each in data.items()}
    known = [*channels, *(f"{name}.{key}" for name, keys in channels.items() for key in keys)]
    wanted = list(channels) if field is None else [field] if isinstance(field, str) else list(field)
    chosen: dict[str, list[str]] = {}
    for each in wanted:
        if each not in known:
            raise RuptfxError(f"plots.instruments: field = '{each}': {nearest(each, known)}")
        name = each if each in channels else next(one for one in channels if each.startswith(f"{one}."))
        keys = channels[name] if each in channels else [each.removeprefix(f"{name}.")]
        chosen[name] = [*chosen.get(name, []), *keys]
    panels = []
    for name, keys in chosen.items():
        units = {key: str(data[name][key].attrs.get("units", "1")) for key in keys}
        for unit in dict.fromkeys(units.values()):
            panels.append((name, unit, [key for key in dict.fromkeys(keys) if units[key] == unit]))
    return panels


def _drawn(data: Data, channels: list[str]) -> list[str]:
    """Return the channels that are not zero throughout, at least one."""
    return [channel for channel in channels if np.any(data[channel].values)] or channels[:1]


def _kinds(channels: list[str]) -> list[str]:
    """Return the names of channels without their components, each once."""
    return list(dict.fromkeys(_COMPONENT.sub("", channel) for channel in channels))


def _limits(panels: Sequence[np.ndarray]) -> dict[int, tuple[float, float]]:
    """Return the common limits of the axes of panels by their numbers, without those whose range is small."""
    spans = [float(np.ptp(values)) if values.size else 0.0 for values in panels]
    large = [number for number, span in enumerate(spans) if span > SMALLEST * max(spans)]
    if len(large) < 2:
        return {}
    low, high = (float(end([end(panels[number]) for number in large])) for end in (np.min, np.max))
    return dict.fromkeys(large, (low - MARGIN * (high - low), high + MARGIN * (high - low)))


def _common(channels: list[str]) -> str:
    """Return the label of channels without their components."""
    words = list(dict.fromkeys(_COMPONENT.sub("", channel).replace("_", " ") for channel in channels))
    return " and ".join([", ".join(words[:-1])] * (len(words) > 1) + words[-1:]).capitalize()
