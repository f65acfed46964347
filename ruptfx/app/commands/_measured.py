"""Table and figure of `ruptfx compare RUN FILE`."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from rich.table import Table

from ruptfx import RuptfxError
from ruptfx.app.commands._shared import screen
from ruptfx.input.quantities import with_prefix

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ruptfx.results.analysis.measured import Pair

MOST = 8  # panels of a figure


def show(
    run: Path, file: Path, instrument: str | None, channel: str | None, most: float | None, shift: float, out: Path,
    mapping: Path | None = None,
) -> None:  # fmt: skip
    """Print misfits and time shifts of measured signals, and save a figure with both."""
    if mapping is not None:
        from ruptfx.input.data_files import as_csv, mapping_of
        from ruptfx.results.analysis.measured import UnnamedError

        with TemporaryDirectory() as folder:
            columns = Path(folder) / f"{file.stem}.csv"
            try:
                names = mapping_of(mapping, instrument)
                as_csv(file, names, columns)
                show(run, columns, instrument, channel, most, shift, out)
            except UnnamedError as error:
                wrong = next(name for name in names if name != "time")
                raise RuptfxError(
                    f"{mapping}: map.{wrong}: no key of map is a channel of the instrument: "
                    f'{", ".join(error.channels)}; rename it, as map."{error.channels[0]}" = {{ ... }}'
                ) from None
            except ValueError as error:
                raise RuptfxError(str(error)) from None
        return
    from ruptfx.app.convert.scec_files import channels
    from ruptfx.input.number_files import describe_reading
    from ruptfx.results.analysis.measured import compare_with_file
    from ruptfx.results.record import Files

    with Files(run) as record:
        pairs = compare_with_file(record, file, instrument, channel, most, shift, lambda name: channels(record, name))
    for line in describe_reading(file):
        screen.print(line, soft_wrap=True)
    table = Table("channel", "misfit", "best time shift", "misfit then", "measured/computed", box=None, pad_edge=False)
    for pair in pairs.values():
        result = pair.result
        table.add_row(pair.label, _percent(result.misfit), pair.shift, _percent(result.shifted), f"{result.ratio:.3g}")
    screen.print(table)
    if opposite := [pair.label for pair in pairs.values() if pair.result.ratio < 0]:
        screen.print(
            f"{', '.join(opposite)}: of opposite sign at every time shift tried, and not shifted; the file may define "
            "the sign in another way.", soft_wrap=True,
        )  # fmt: skip
    if any(pair.result.limited for pair in pairs.values()):
        largest = with_prefix(max(2 * abs(pair.result.shift) for pair in pairs.values() if pair.result.limited), "s")
        screen.print(
            f"A shift is the largest one tried: the best may lie beyond; try --most-shift '{largest}'.", soft_wrap=True
        )
    screen.print(
        "misfit: rms(computed - measured) / rms(measured); time shift: delay of the measured signal, at the best "
        "agreement in shape; measured/computed: ratio of amplitudes then", soft_wrap=True,
    )  # fmt: skip
    overlay(list(pairs.values()), file.name).savefig(out, dpi=150)


def _percent(share: float) -> str:
    return f"{100 * share:.3g} %"


def overlay(pairs: list[Pair], measured: str) -> Figure:
    """Draw a panel per channel: measured, computed, and computed after the best time shift."""
    import numpy as np

    from ruptfx.results.figure_style import MUTED, known_unit, letter, new_figure, remark, scale, styled

    @styled
    def draw() -> Figure:
        shown = pairs[:MOST]
        columns = min(len(shown), 2)
        rows = -(-len(shown) // columns)
        figure, axes = new_figure(rows, columns, 0.7 + 1.8 * rows, sharex=True)
        t_size, t_unit = scale(shown[0].computed_time[-1], "s")
        for ax, pair in zip(axes.ravel(), shown, strict=False):
            both = np.concatenate([pair.computed, pair.measured])
            size, unit = (0.01, "%") if pair.unit == "1" else (
                scale(both, pair.unit) if known_unit(pair.unit) else (1.0, pair.unit))  # fmt: skip
            result = pair.result
            label = f"measured: {measured}"
            ax.plot(pair.measured_time / t_size, pair.measured / size, color=MUTED, lw=2.0, label=label)
            ax.plot(pair.computed_time / t_size, pair.computed / size, color="#c1440e", label="computed")
            if result.shift:
                late = (pair.computed_time + result.shift) / t_size
                delayed = "computed, at the best time shift"
                ax.plot(late, pair.computed / size, "--", color="#1a1a1a", lw=0.8, label=delayed)
            first = min(pair.computed_time[0], pair.computed_time[0] + result.shift)
            ax.set_xlim(first / t_size, pair.computed_time[-1] / t_size)
            ax.set_ylabel(f"{pair.label} ({unit})".replace(pair.label[0], pair.label[0].upper(), 1))
            then = f"; {_percent(result.shifted)} at {pair.shift}".replace("us", "µs")
            ax.set_title(f"misfit {_percent(result.misfit)}{then if result.shift else ''}", loc="right")
        for ax in axes.ravel()[: len(shown)][-columns:]:
            ax.set_xlabel(f"Time ({t_unit})")
            ax.tick_params(labelbottom=True)
        for ax in axes.ravel()[len(shown) :]:
            ax.set_visible(False)
        lines = {text: line for ax in axes.ravel() for line, text in zip(*ax.get_legend_handles_labels(), strict=True)}
        figure.legend(list(lines.values()), list(lines), loc="outside upper left", ncols=3)
        omitted = len(pairs) - len(shown)
        remark(figure, f"{omitted} more channels do not fit here; choose one with --channel." if omitted else "")
        letter(axes.ravel()[: len(shown)])
        return figure

    return draw()
