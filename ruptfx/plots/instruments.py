"""Figure of the signals of the instruments."""

from __future__ import annotations

import re
from textwrap import fill

import numpy as np
from matplotlib.figure import Figure

from ruptfx.analysis.measured import channel_label
from ruptfx.figure_style import known_unit, letter, new_figure, remark, scale, styled
from ruptfx.plots._panels import without
from ruptfx.record import Files

MOST = 12  # largest number of panels of a figure
LEGEND = 0.18  # height of a legend line over that of a panel
SHORT = 9  # letters of a label of which three fit side by side
LABEL = 20  # letters per line of an axis label
LINES = ("-", "--", ":")
_COMPONENT = re.compile(r"_([xyz]{1,2}|\d)$")


def suits(record: Files) -> bool:
    """Return whether the run has instruments with data, other than grids."""
    return bool(_signals(record)) and (record.path / "instruments.h5").is_file()


def _signals(record: Files) -> list[str]:
    """Return the names of the instruments that measure at one place."""
    return [str(table["name"]) for table in record.case.get("instruments", []) if table["kind"] != "receiver_grid"]


@styled
def instruments(record: Files) -> Figure:
    """Draw samples against time: a panel per instrument and unit.

    If there are more panels than fit a page, a remark states how many are missing.
    """
    panels, measured = [], {name: record.instruments[name] for name in _signals(record)}
    for name, data in measured.items():
        units = {str(key): str(data[key].attrs.get("units", "1")) for key in data if key != "time"}
        for unit in dict.fromkeys(units.values()):
            panels.append((name, unit, [key for key, its in units.items() if its == unit]))
    if not any(data.sizes["time"] for data in measured.values()):
        return without("no sample was saved")
    shown = panels[:MOST]
    columns = min(len(shown), 2)
    rows = -(-len(shown) // columns)
    figure, axes = new_figure(rows, columns, 0.5 + 1.55 * rows, sharex=True)
    latest = max(float(data["time"].values[-1]) for data in measured.values() if data.sizes["time"])
    t_size, t_unit = scale(latest, "s")
    for ax, (name, unit, channels) in zip(axes.ravel(), shown, strict=False):
        data = measured[name]
        values = np.array([data[channel].values for channel in channels])
        size, printed = (0.01, "%") if unit == "1" else scale(values, unit) if known_unit(unit) else (1.0, unit)
        kinds = list(dict.fromkeys(_COMPONENT.sub("", channel) for channel in channels))
        for channel, line in zip(channels, values, strict=True):
            # An extension along x equals the strain xx: line styles keep both visible.
            style = LINES[kinds.index(_COMPONENT.sub("", channel)) % len(LINES)]
            named = _COMPONENT.search(channel)
            alone = named and len(kinds) == 1 and len(channels) > 2
            label = named[1] if named and alone else channel_label(channel, data[channel].attrs)
            ax.plot(data["time"].values / t_size, line / size, style, label=label)
        ax.set_ylabel(f"{fill(_common(channels), LABEL)}\n({printed})")
        ax.set_title(name, loc="right")
        if len(channels) > 1:
            longest = max(len(str(line.get_label())) for line in ax.lines)
            columns_of_legend = min(len(channels), 3 if longest <= SHORT else 2)
            low, high = ax.get_ylim()  # room above the data, for a legend that hides none of it
            ax.set_ylim(low, high + LEGEND * -(-len(channels) // columns_of_legend) * (high - low))
            ax.legend(loc="upper left", ncols=columns_of_legend, columnspacing=1.0, handlelength=1.6)
    for ax in axes.ravel()[: len(shown)][-columns:]:
        ax.set_xlabel(f"Time ({t_unit})")
        ax.tick_params(labelbottom=True)
    for ax in axes.ravel()[len(shown) :]:
        ax.set_visible(False)
    left = len(panels) - len(shown)
    remark(figure, f"{left} more panels do not fit here; all numbers are in instruments.h5." if left else "")
    letter(axes.ravel()[: len(shown)])
    return figure


def _common(channels: list[str]) -> str:
    """Return the label of channels without their components."""
    words = list(dict.fromkeys(_COMPONENT.sub("", channel).replace("_", " ") for channel in channels))
    return " and ".join([", ".join(words[:-1])] * (len(words) > 1) + words[-1:]).capitalize()
