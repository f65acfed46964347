"""The benchmark of speed: parts that fail, tables, and the clock of whole commands."""

import json
import subprocess
import sys
from importlib.util import find_spec

import pytest

from ruptfx import RuptfxError
from ruptfx.bench import Check
from ruptfx.bench._parts import Parts
from ruptfx.bench._speed_tables import STEPS, phase_table, step_rows


def test_a_part_that_fails_is_a_failed_check_and_loses_nothing() -> None:
    parts = Parts()
    with parts.one("first"):
        parts.checks.append(Check("found", 1.0, 1.0))
    with parts.one("second"):
        raise RuptfxError("no room")
    with parts.one("third"):
        raise subprocess.TimeoutExpired("a command", 5.0)
    with pytest.raises(ZeroDivisionError), parts.one("a bug"):  # is none of its
        raise ZeroDivisionError
    assert [(check.quantity, check.passed) for check in parts.checks] == [
        ("found", True), ("second: was measured", False), ("third: was measured", False),
    ]  # fmt: skip
    assert "no room" in parts.checks[1].source and "5.0 seconds" in parts.checks[2].source
    assert [row["part"] for row in parts.rows] == ["first", "second", "third"]


def test_tables_are_of_the_saved_rows() -> None:
    whole = {"problem": "demo", "phase": "steps", "seconds": 1.5, "share": 0.25}
    rows = [{**whole, "ranks": 1}, {**whole, "ranks": 2}, {**whole, "ranks": 1, "phase": "wall", "seconds": 7.0}]
    step = {
        "dim": 2, "order": 4, "geometry": "affine", "nodes": 349_000, "ranks": 1, "bytes_per_node": 66.4,
        "node_updates_per_second_per_core": 2.04e8, "ratio_to_ufl_form": 17.2, "ratio_to_stock_ufl_form": 23.4,
        "ratio_to_petsc": 24.96, "ratio_to_bandwidth": 0.281, "interface_share": 0.094, "efficiency": None,
    }  # fmt: skip
    rows += [step, {"part": "steps", "seconds": 3.0}]
    assert phase_table(rows) == (
        ("s", "demo, 1 rank", "demo, 2 ranks"), [("steps", "1.50 (25%)", "1.50 (25%)"), ("wall", "7.00", "")],
    )  # fmt: skip
    (cells,) = step_rows(rows)
    assert dict(zip(STEPS, cells, strict=True)) == {
        "element": "2D order 4 affine", "nodes": "0.35 M", "ranks": "1", "M updates/s/core": "204", "bytes/node": "66",
        "x ufl_form": "17", "x stock ufl": "23", "x PETSc": "25.0", "of bandwidth": "28%", "interface": "9.4%",
        "speed-up": "",
    }  # fmt: skip


@pytest.mark.skipif(find_spec("dolfinx") is None, reason="needs DOLFINx")
def test_the_clock_of_a_whole_command_is_in_its_last_line() -> None:
    command = [sys.executable, "-m", "ruptfx.bench._timed_run", "--version"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, check=True)
    seconds = json.loads(done.stdout.splitlines()[-1])
    assert seconds.keys() == {"start", "writing"} and seconds["start"] > 0
    failed = subprocess.run([*command[:-1], "run", "missing.toml"], capture_output=True, text=True, timeout=600)
    assert failed.returncode == 1 and "missing.toml" in failed.stderr
