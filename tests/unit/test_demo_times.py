"""Times of demos: of whole processes with all they start."""

from __future__ import annotations

from pathlib import Path

import pytest
from helpers.messages import facts

from ruptfx import RuptfxError

pytest.importorskip("dolfinx")

from benchmarks import demo_times
from benchmarks.demo_times import processor_time

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


def test_what_is_timed() -> None:
    """Single runs and scripts; studies and searches are not, and cases that other programs only read are."""
    names = {path.name for path in demo_times.DEMOS.iterdir() if path.suffix in (".toml", ".py")}
    fine, coarse = (
        {name for name in names if demo_times.wanted(demo_times.DEMOS / name, which)} for which in (True, False)
    )
    assert {"impact.toml", "granite.toml", "spring_block.toml", "shear_impact.py"} <= fine
    assert not fine & {"mode_map.toml", "lecture_cases.py", "granite_confinement.toml"}
    assert coarse < fine and "spring_block.toml" in coarse and "granite.toml" not in coarse
