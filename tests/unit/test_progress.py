from __future__ import annotations

import time

from ruptfx.platform.progress import Progress, working


def shown(capsys, *fractions):
    with Progress() as progress:
        for fraction in fractions:
            progress.update(fraction, "text")
    return [line.split("%")[0].strip() for line in capsys.readouterr().err.splitlines()]


def test_a_line_every_tenth(capsys):
    # Few long steps: the last passes the end by up to one of them.
    assert shown(capsys, 0.05, 0.55, 0.58, 1.1) == ["50", "100"]


def test_work_that_is_added(capsys):
    assert shown(capsys, 0.5, 1.0, 0.6, 0.72) == ["50", "100", "70"]


def test_quiet(capsys):
    with Progress(show=False) as progress:
        progress.update(0.5, "text")
    assert capsys.readouterr() == ("", "")


def test_phases_are_named(capsys, monkeypatch):
    with working("building the model"), working("drawing", show=False):
        pass
    assert capsys.readouterr() == ("", "building the model\n")
    monkeypatch.setenv("RUPTFX_TERMINAL", "1")
    with working("building the model"):
        time.sleep(0.2)
    shown = capsys.readouterr().err
    assert "building the model" in shown and "0:00:0" in shown


def test_the_time_left_is_that_of_the_remaining_part(capsys, monkeypatch):
    """A run resumed at 0.5 needs 20 s for a tenth of the whole: 80 s are left at 0.6."""
    now = [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    with Progress() as progress:
        progress.begin(0.5)
        now[0] += 20
        progress.update(0.6, "text")
        now[0] += 80
        progress.update(1.0, "text")
    assert capsys.readouterr().err.splitlines() == [" 60 %  text  left 1:20", "100 %  text"]


def test_a_long_text_of_a_log_stays_on_one_line_with_its_brackets(capsys):
    with Progress() as progress:
        progress.update(0.5, "sets of [friction] over [bold]compression[/] and impact speed: 180 points, 90 done")
    assert capsys.readouterr().err.splitlines() == [
        " 50 %  sets of [friction] over [bold]compression[/] and impact speed: 180 points, 90 done"
    ]


def test_a_slow_run_prints_a_line_every_ten_minutes_with_the_time_of_day(capsys, monkeypatch):
    """Three updates in 5 minutes each, then one after 7: a line after 15 minutes, the first above ten, and at 10 %."""
    now = [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    monkeypatch.setattr(time, "strftime", lambda form: f"  at {now[0]:.0f}")
    with Progress() as progress:
        for seconds, fraction in ((300, 0.01), (600, 0.02), (900, 0.03), (1320, 0.1)):
            now[0] = seconds
            progress.update(fraction, "text")
    lines = capsys.readouterr().err.splitlines()
    assert [(line.split("%")[0].strip(), line.split("at ")[-1]) for line in lines] == [("3", "900"), ("10", "1320")]


def test_a_long_text_of_a_bar_leaves_the_percentage_and_the_time_left(capsys, monkeypatch):
    monkeypatch.setenv("RUPTFX_TERMINAL", "1")
    monkeypatch.setenv("COLUMNS", "80")
    with Progress() as progress:
        progress.update(0.71, "run 23, misfit 0.340245, 0.0851 of noise, variable 2 of 2, sensitivity  step 55 of 125")
        time.sleep(0.2)
    shown = capsys.readouterr().err
    assert "run 23, misfit 0.340245, 0.0851 of noise" in shown and " 71 % left" in shown and "… …" not in shown
