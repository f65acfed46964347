"""Measured signals against a run: units, names of channels, misfit, time shift."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import tomli_w
import xarray
from helpers.labels import label_faults
from helpers.messages import facts
from helpers.small_cases import merged, plates
from matplotlib.image import imread
from typer.testing import CliRunner, Result

from ruptfx import Record, RuptfxError
from ruptfx.app.cli import app
from ruptfx.app.commands._measured import overlay
from ruptfx.input.number_files import named_histories
from ruptfx.results.analysis.measured import TRIED, Pair, channel_label, compare_with_file, misfit

TIME = np.linspace(0, 40e-6, 401)


def ruptfx(*arguments: str | Path) -> Result:
    return CliRunner(env={"COLUMNS": "200"}).invoke(app, [str(argument) for argument in arguments])


def pulse(t: np.ndarray) -> np.ndarray:
    return 3e-4 * np.exp(-(((t - 18e-6) / 4e-6) ** 2))


def recorded() -> Any:
    """A record with a rosette, whose grids at 0 and 45 degrees see a pulse and half of it, and a velocimeter."""

    def channel(values: np.ndarray, angle: float) -> xarray.DataArray:
        name = f"extension at {angle:g} degrees from x"
        return xarray.DataArray(values, dims="time", attrs={"units": "1", "long_name": name})

    rosette = xarray.Dataset(
        {"extension_1": channel(pulse(TIME), 0), "extension_2": channel(pulse(TIME) / 2, 45)}, coords={"time": TIME}
    )
    velocity = xarray.DataArray(1e4 * pulse(TIME), dims="time", attrs={"units": "m/s"})
    slow = xarray.Dataset({"velocity": velocity}, coords={"time": TIME})
    return SimpleNamespace(instruments={"G1": rosette, "V": slow}, path=Path("run"))


def saved(path: Path, header: str, *columns: np.ndarray) -> Path:
    np.savetxt(path, np.transpose(columns), delimiter=",", header=header, comments="", fmt="%.10g")
    return path


def test_misfit_of_a_late_and_large_signal_is_exact() -> None:
    """m(t) = 1.25 c(t - 2.3 us), with other samples: the delay, |1.25 - 1| / 1.25 behind it, and the ratio."""
    t = np.arange(1e-6, 60e-6, 0.37e-6)
    found = misfit(TIME, pulse(TIME), t, 1.25 * pulse(t - 2.3e-6))
    assert found.shift == pytest.approx(2.3e-6, abs=5e-9)
    assert found.shifted == pytest.approx(0.2, abs=1e-3) and found.ratio == pytest.approx(1.25, rel=1e-3)
    t = t[t <= TIME[-1]]
    measured = 1.25 * pulse(t - 2.3e-6)
    expected = np.linalg.norm(measured - pulse(t)) / np.linalg.norm(measured)
    assert found.misfit == pytest.approx(expected, rel=1e-3) and not found.limited


def test_equal_signals_have_no_misfit_and_opposite_ones_no_shift() -> None:
    same, turned = misfit(TIME, pulse(TIME), TIME, pulse(TIME)), misfit(TIME, pulse(TIME), TIME, -pulse(TIME))
    assert same.misfit == 0 and abs(same.shift) < 1e-10 and same.ratio == pytest.approx(1)
    assert turned.misfit == pytest.approx(2) and turned.ratio == pytest.approx(-1) and turned.shift == 0


@pytest.mark.parametrize(("delay", "text"), [(0.0, "0 ns"), (2.3e-6, "2.3 us"), (-2e-9, "-2 ns")])
def test_a_shift_below_the_resolution_of_the_samples_is_zero(delay: float, text: str) -> None:
    """The middle of the shifts tried is 4e-22 s there; samples are 100 ns apart."""
    most = 3.3e-6
    assert 0 < np.linspace(-most, most, 2 * TRIED + 1)[TRIED] < 1e-20
    late = pulse(TIME - delay)
    pair = Pair("x", "m", TIME, late, TIME, pulse(TIME), misfit(TIME, pulse(TIME), TIME, late, most))
    assert pair.shift == text and (pair.result.shift != 0) == bool(delay)


def test_a_constant_signal_is_not_shifted() -> None:
    found = misfit(TIME, np.full(len(TIME), -6e6), TIME, np.full(len(TIME), -6.000001e6))
    assert found.shift == 0 and found.ratio == pytest.approx(1, rel=1e-6) and not found.limited


@pytest.mark.parametrize("delay, reached", [(0.45, True), (0.55, False)])
def test_half_of_the_common_time_is_compared_at_every_shift(delay: float, reached: bool) -> None:
    """A pulse that is later by 45 % of the time is matched, one that is later by 55 % is not."""
    t = np.linspace(0.0, 1.0, 2001)
    computed, measured = (np.exp(-(((t - middle) / 0.05) ** 2)) for middle in (0.3, 0.3 + delay))
    result = misfit(t, computed, t, measured, most_shift=0.7)
    assert (result.shift == pytest.approx(delay, abs=1e-3)) == reached
    assert abs(result.shift) <= 0.5 + 1e-3


def test_a_shift_at_the_end_of_the_searched_range_is_marked() -> None:
    found = misfit(TIME, pulse(TIME), TIME, pulse(TIME - 5e-6), most_shift=1e-6)
    assert found.limited and found.shift == pytest.approx(1e-6, rel=0.01)


def test_signals_without_common_times_are_refused() -> None:
    with pytest.raises(RuptfxError, match=facts(r"\d to \d\S* s .*\d to \d\S* s ")):
        misfit(TIME, pulse(TIME), 1e6 * TIME + 1, pulse(TIME))
    with pytest.raises(RuptfxError, match=r"^force_x:"):
        misfit(TIME, pulse(TIME), TIME, 0 * TIME, what="force_x")


@pytest.mark.parametrize("shift", [0.0, 3.0, -70e-6])
def test_the_time_shift_that_a_refusal_gives_makes_times_common(shift: float) -> None:
    """Of signals on a clock, with a shift of the user or without one, which the message does not add twice."""
    clock = TIME + 1.5
    with pytest.raises(RuptfxError) as caught:
        misfit(TIME, pulse(TIME), clock + shift, pulse(TIME), time_shift=shift)
    found = re.search(r"--time-shift '(\S+) s'", str(caught.value))
    assert found is not None and misfit(TIME, pulse(TIME), clock + float(found[1]), pulse(TIME)).misfit < 1e-6
    with pytest.raises(RuptfxError, match=facts("--time-shift '1 s' they are; leave it out")):
        misfit(TIME, pulse(TIME), TIME + 1.0, pulse(TIME), time_shift=1.0)


@pytest.mark.parametrize("second", [
    "45 deg (um/m)", "extension_2 (um/m)", "G1.extension_2 (um/m)", "45° (um/m)", "45 deg (ue)", "extension_2 (µε)",
    "45 deg [microstrain]", "extension_2 (ustrain)",
])  # fmt: skip
def test_columns_are_found_by_name_or_angle_and_their_units_count(second: str, tmp_path: Path) -> None:
    t = TIME[::3]
    file = saved(tmp_path / "gauge.csv", f"time (us),trigger (V),{second}", 1e6 * t, 0 * t, 1e6 * pulse(t) / 2)
    (pair,) = compare_with_file(recorded(), file, "G1").values()
    assert pair.label == "extension 45°" and pair.result.misfit < 1e-8
    np.testing.assert_allclose(pair.measured_time, t, rtol=1e-9)


def test_units_below_the_names_and_comments(tmp_path: Path) -> None:
    t = TIME[::10]
    file = saved(tmp_path / "v.csv", "# shot 12\nTime,Velocity\nms,mm/s", 1e3 * t, 1e7 * pulse(t))
    times, columns = named_histories(file, {"velocity": (("velocity",), "m/s")})
    np.testing.assert_allclose(times, t, rtol=1e-9)
    np.testing.assert_allclose(columns["velocity"], 1e4 * pulse(t), rtol=1e-9)


def test_two_columns_need_no_name(tmp_path: Path) -> None:
    file = saved(tmp_path / "v.csv", "time (us),CH2 (mm/s)", 1e6 * TIME, 1e7 * pulse(TIME))
    assert compare_with_file(recorded(), file, "V")["velocity"].result.misfit < 1e-8
    gauge = saved(tmp_path / "g.csv", "time (us),CH2", 1e6 * TIME, pulse(TIME))
    assert compare_with_file(recorded(), gauge, "G1", "extension_1")["extension_1"].result.misfit < 1e-8


def test_errors_name_the_remedy(tmp_path: Path) -> None:
    file = saved(tmp_path / "g.csv", "time (us),CH1,CH2", 1e6 * TIME, pulse(TIME), pulse(TIME))
    for instrument, channel, words in (
        (None, None, "choose one with --instrument"), ("X", None, "run has G1, V"), ("G1", "xx", "has extension_1"),
        ("G1", None, "0 deg, 45 deg; rename one in its header, such as 'time .us., 0 deg .1.'"),
    ):  # fmt: skip
        with pytest.raises(RuptfxError, match=facts(words)):
            compare_with_file(recorded(), file, instrument, channel)
    wrong = saved(tmp_path / "w.csv", "time (us),velocity (MPa)", 1e6 * TIME, pulse(TIME))
    with pytest.raises(RuptfxError, match=facts(r"line 1 of .*w.csv, column 2.*of another kind")):
        compare_with_file(recorded(), wrong, "V")


def test_a_gauge_is_named_by_its_angle() -> None:
    assert channel_label("extension_3", {"long_name": "extension at 90 degrees from x"}) == "extension 90°"
    assert channel_label("velocity_x", {"long_name": "velocity"}) == "velocity x"


def test_the_figure_shows_both_signals(tmp_path: Path) -> None:
    file = saved(tmp_path / "g.csv", "time (us),0 deg (um/m),45 deg (um/m)", 1e6 * TIME + 2, 1.1e6 * pulse(TIME),
                 0.5e6 * pulse(TIME))  # fmt: skip
    pairs = list(compare_with_file(recorded(), file, "G1").values())
    figure = overlay(pairs, "g.csv")
    assert label_faults(figure) == []
    for axes, largest, exact in zip(figure.axes, (0.033, 0.015), (0.03, 0.015), strict=True):
        measured, computed, shifted = axes.lines
        assert measured.get_ydata().max() == pytest.approx(largest, rel=1e-3)  # in %
        np.testing.assert_array_equal(shifted.get_ydata(), computed.get_ydata())
        assert computed.get_ydata().max() == pytest.approx(exact, rel=1e-3)
        assert shifted.get_xdata()[0] - computed.get_xdata()[0] == pytest.approx(2.0, abs=0.01)  # us


def test_two_columns_of_one_name_are_refused(tmp_path: Path) -> None:
    file = saved(tmp_path / "v.csv", "time (us),velocity (m/s),trigger,velocity", 1e6 * TIME, TIME, TIME, TIME)
    with pytest.raises(RuptfxError, match=facts("v.csv: columns 2 and 4 are both called velocity")):
        compare_with_file(recorded(), file, "V")


def test_time_stamps_of_a_clock(tmp_path: Path) -> None:
    """The recording began 1234.5 s before the run on its clock: the error says the shift, and with it both agree."""
    file = tmp_path / "v.csv"
    lines = [f"{float(1e4 * pulse(t))!r},{1234.5 + t:.9f}\n" for t in TIME]
    file.write_text("velocity (m/s),time (s)\n" + "".join(lines))
    with pytest.raises(RuptfxError, match=facts("--time-shift '-1234.5 s'")):
        compare_with_file(recorded(), file, "V")
    result = compare_with_file(recorded(), file, "V", time_shift=-1234.5)["velocity"].result
    assert result.misfit < 1e-4 and abs(result.shift) < 1e-9 and result.ratio == pytest.approx(1, abs=1e-4)


def test_further_channels_are_those_that_the_file_names(tmp_path: Path) -> None:
    more = {"h-vel": (2e4 * pulse(TIME), "m/s"), "v-vel": (0 * TIME, "m/s")}
    file = saved(tmp_path / "s.txt", "t h-vel", TIME, 2e4 * pulse(TIME))
    pairs = compare_with_file(recorded(), file, "V", "h-vel", more=lambda name: more if name == "V" else {})
    assert list(pairs) == ["h-vel"] and pairs["h-vel"].result.misfit < 1e-8


@pytest.mark.fem
def test_the_command_reads_a_run(tmp_path: Path) -> None:
    pytest.importorskip("dolfinx")
    gauge = {"kind": "strain_gauge", "name": "G1", "interval": 1e-7, "point": [4e-3, 2e-3], "angles": [0.0, "45 deg"]}
    pushed = {"kind": "driven", "edge": "upper.left", "component": "x", "velocity": 2.0, "ramp": 1e-6}
    keys = {"duration": 5e-6, "instruments": [gauge], "boundaries": [pushed]}
    (tmp_path / "case.toml").write_text(tomli_w.dumps(merged(plates(), keys)))
    assert ruptfx("run", tmp_path / "case.toml", "--out", tmp_path / "run", "--quiet").exit_code == 0
    with Record(tmp_path / "run") as record:
        data = record.instruments["G1"]
        time, grid = data.time.values, data.extension_2.values
    saved(tmp_path / "o.csv", "t (s),45 deg", time - 3, -grid)
    result = ruptfx("compare", tmp_path / "run", tmp_path / "o.csv", "--time-shift", "3 s", "--out", tmp_path / "o.png")
    assert result.exit_code == 0 and "-1" in result.output and "of opposite sign" in result.output, result.output
    saved(tmp_path / "m.csv", "t (us),45 deg (%)", 1e6 * time + 0.25, 50 * grid)
    result = ruptfx("compare", tmp_path / "run", tmp_path / "m.csv", "--out", tmp_path / "both.png")
    assert result.exit_code == 0 and "extension 45°" in result.output and "250 ns" in result.output, result.output
    assert imread(tmp_path / "both.png").std() > 0.02
    refused = ruptfx("compare", tmp_path / "run", tmp_path / "m.csv", "--most-shift", "5 mm")
    assert refused.exit_code == 1 and "--most-shift 5 mm" in refused.output
    # Through a mapping: what is wrong with it is said with its own keys, and the remedy works.
    for key, code in (("strain", 1), ("45 deg", 0)):
        columns = {"time": {"variable": "t", "unit": "s"}, key: {"variable": "45 deg", "unit": "1", "sign": -1}}
        entry = {"kind": "traces", "instrument": "G1", "map": columns}
        (tmp_path / "map.toml").write_text(tomli_w.dumps({"objective": [entry]}))
        mapped = ruptfx("compare", tmp_path / "run", tmp_path / "o.csv", "--map", tmp_path / "map.toml",
                        "--time-shift", "3 s", "--out", tmp_path / f"{code}.png")  # fmt: skip
        assert mapped.exit_code == code, mapped.output
        said = " ".join(mapped.output.split())
        assert ('map."0 deg"' in said and "map.strain" in said) == bool(code), said


@pytest.mark.parametrize("end", [15 * 1e-6, 15 / 1e6, np.nextafter(15e-6, 1)])
def test_a_sample_at_the_end_of_a_run_counts_whatever_its_rounding(end: float) -> None:
    """The last of three samples is half of the computed one: misfit sqrt((1 - 0.5)^2 / (1 + 1 + 0.25))."""
    computed_time = np.linspace(0.0, 15e-6, 151)
    times = np.array([5e-6, 10e-6, end])
    result = misfit(computed_time, np.ones(151), times, np.array([1.0, 1.0, 0.5]))
    assert result.misfit == pytest.approx(1 / 3, rel=1e-12)
