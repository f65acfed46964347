from __future__ import annotations

from ruptfx.progress import Progress


def test_last_step_beyond_the_end_is_the_whole(capsys):
    with Progress(1.0, show=True) as progress:
        progress.update(0.55, 11, 0.1)
        progress.update(1.1, 22, 0.1)  # few long steps: the last passes the end by up to one of them
    percent = [line.split("%")[0].strip() for line in capsys.readouterr().err.splitlines()]
    assert percent == ["50", "100"]
