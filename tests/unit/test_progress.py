from __future__ import annotations

from ruptfx.platform.progress import Progress


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
