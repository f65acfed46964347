"""Times that the gallery tells: of whole processes with all they start, rounded to what a machine repeats."""

from __future__ import annotations

from pathlib import Path

import pytest
from messages import facts

from ruptfx import RuptfxError

pytest.importorskip("dolfinx")

from ruptfx.bench import demo_times
from ruptfx.bench.demo_times import processor_time, rounded

BUSY = "import time\nwhile time.process_time() < {seconds}: pass\n"


def test_processes_that_a_script_starts_are_counted(tmp_path: Path) -> None:
    (tmp_path / "part.py").write_text(BUSY.format(seconds=0.6))
    starts = f"import subprocess, sys\nsubprocess.run([sys.executable, {str(tmp_path / 'part.py')!r}])\n"
    (tmp_path / "whole.py").write_text(BUSY.format(seconds=0.3) + starts)
    seconds, wall = processor_time(tmp_path / "whole.py")
    assert 0.9 <= seconds < 1.5 and wall >= 0.9


def test_a_script_that_fails_says_why(tmp_path: Path) -> None:
    (tmp_path / "broken.py").write_text("raise SystemExit('no such mesh')")
    with pytest.raises(RuptfxError, match=facts(r"demo_times, broken\.py: no such mesh")):
        processor_time(tmp_path / "broken.py")


@pytest.mark.parametrize(
    "seconds, told",
    [(0.4, "1 s"), (1.6, "2 s"), (9.4, "9 s"), (12.6, "15 s"), (57.0, "55 s"), (100, "1.5 min"), (290, "5 min")],
)
def test_told(seconds: float, told: str) -> None:
    assert rounded(seconds) == told


def test_what_is_timed() -> None:
    """Single runs and scripts; studies and searches are not, and cases that other programs only read are."""
    names = {path.name for path in demo_times.DEMOS.iterdir() if path.suffix in (".toml", ".py")}
    fine, coarse = (
        {name for name in names if demo_times.wanted(demo_times.DEMOS / name, which)} for which in (True, False)
    )
    assert {"impact.toml", "granite.toml", "spring_block.toml", "shear_impact.py"} <= fine
    assert not fine & {"mode_map.toml", "lecture_cases.py", "granite_confinement.toml"}
    assert coarse < fine and "spring_block.toml" in coarse and "granite.toml" not in coarse
