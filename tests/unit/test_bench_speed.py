"""The benchmark of speed: parts that fail, tables, and the clock of whole commands."""

import os
import subprocess
from dataclasses import asdict
from importlib.util import find_spec
from pathlib import Path

import pytest
import tomli_w

from benchmarks import mode_map
from ruptfx import RuptfxError
from ruptfx.app.bench import Check, speed
from ruptfx.app.bench._parts import Parts
from ruptfx.app.bench._speed_tables import (
    CHOICE,
    FIRST,
    RANKS,
    SIZES,
    STEPS,
    aim_rows,
    choice_rows,
    phase_table,
    rank_rows,
    size_rows,
    step_rows,
)
from ruptfx.app.bench._timings import fault_case
from ruptfx.app.bench._whole_runs import _checks, _phases, _run


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
        "ratio_of_single": 1.214,
    }  # fmt: skip
    rows += [step, {"part": "steps", "seconds": 3.0}]
    assert phase_table(rows) == (
        ("phase, seconds (share)", "demo, 1 rank", "demo, 2 ranks"),
        [("steps", "1.50 (25%)", "1.50 (25%)"), ("wall", "7.00", "")],
    )  # fmt: skip
    (cells,) = step_rows(rows)
    assert dict(zip(STEPS, cells, strict=True)) == {
        "element": "2D order 4 affine", "nodes": "0.35 M", "ranks": "1", "M updates /s /core": "204",
        "bytes /node": "66",
        "x ufl_form": "17", "x stock ufl": "23", "x PETSc": "25.0", "of bandwidth": "28%", "interface": "9.4%",
        "x double": "1.21", "speed-up": "",
    }  # fmt: skip


def test_choice_of_a_precision_is_of_saved_results() -> None:
    row = {
        "dim": 3, "order": 4, "geometry": "affine", "asked": 1_000_000, "ranks": 1, "bytes_per_node": 90.9,
        "node_updates_per_second_per_core": 50e6,
    }  # fmt: skip
    measured = {**row, "geometry": "general", "ratio_of_single": 1.6, "single_bytes_per_node": 63.2}
    other = {**row, "ranks": 2}
    checks = [{"quantity": "time in double over single precision, 3D order 4", "found": 1.25}]
    whole = {"checks": [{"quantity": "whole run, nodes 100 m apart, single, 2 ranks", "found": 71.4}]}
    rows = choice_rows({"rows": [other, row, measured, {"part": "steps"}]}, {"checks": checks}, [whole])
    # 1e6 nodes, 1000 steps, 5e7 updates per second: 20 s
    assert [dict(zip(CHOICE, cells, strict=True)) for cells in rows] == [
        {"elements or run": text, "precision": precision, "time (s)": seconds, "bytes per node": held}
        for text, precision, seconds, held in (
            ("3D, order 4, parallel edges", "double", "20.0", "91"),
            ("3D, order 4, parallel edges", "single", "16.0", ""),
            ("3D, order 4, any edges", "double", "20.0", "91"),
            ("3D, order 4, any edges", "single", "12.5", "63"),
            ("TPV5, whole run, nodes 100 m apart, 2 ranks", "single", "71", ""),
        )
    ]  # fmt: skip


def test_tables_of_growth_are_of_the_saved_rows() -> None:
    size = {"nodes": 276_113, "seconds_per_node": 14.94e-9, "peak_per_node": 315.01}
    one = {"nodes": 118_477, "ranks": 1, "messages": 0, "sent": 0, "held": 7_200_000, "elements": 1728, "ghosts": 0}
    two = {**one, "ranks": 2, "messages": 2, "sent": 58_488, "held": 3_700_000, "elements": 864, "ghosts": 1255}
    assert size_rows([size, one, two]) == [("0.28", "14.9", "315")]
    assert rank_rows([size, one, two]) == [
        ("0.12", "1", "1728", "0", "7.2", "1.00", "0", "0.00"),
        ("0.12", "2", "864", "1255", "3.7", "1.03", "2", "0.06"),
    ]
    assert [len(each) for each in (SIZES, RANKS)] == [3, 8]


def test_phases_of_a_command_add_up_to_it(tmp_path: Path) -> None:
    """What the log does not say comes from when files were written: nothing is counted twice or left out."""
    (tmp_path / "figures").mkdir()
    log = '2026-01-01 INFO time by phase [s]: {"start": 0.4, "model": 0.5, "steps": 3.0, "writing": 0.25}\n'
    for name, text, when in (("run.log", log, 1005.0), ("summary.json", "", 1005.5), ("figures/a.png", "", 1006.5),
                             ("figures/b.png", "", 1006.0)):  # fmt: skip
        (tmp_path / name).write_text(text)
        os.utime(tmp_path / name, (when, when))
    found = _phases(tmp_path, 1000.0, 1007.0)
    assert found == {
        "start": 1.25, "model": 0.5, "steps": 3.0, "writing": 0.25, "end": 0.5, "figures": 1.0,
        "exit": 0.5, "wall": 7.0,
    }  # fmt: skip
    assert sum(found.values()) == 2 * found["wall"]


@pytest.mark.slow
@pytest.mark.skipif(find_spec("dolfinx") is None, reason="needs DOLFINx")
@pytest.mark.parametrize("ranks", [1, 2])
def test_a_whole_command_by_phase(ranks: int, tmp_path: Path) -> None:
    case = tmp_path / "case.toml"
    case.write_text(tomli_w.dumps(fault_case(1000.0, True) | {"duration": 0.1}))
    found = _run(case, tmp_path, ranks)
    assert set(found) >= {"start", "model", "steps", "energies", "gathering", "writing", "end", "figures", "exit"}
    assert min(found.values()) > 0 and found["start"] < found["wall"]
    with pytest.raises(RuptfxError, match=r"missing\.toml"):
        _run(tmp_path / "missing.toml", tmp_path, ranks)


def test_aims_say_what_was_reached_missed_and_not_measured() -> None:
    def saved(*checks: Check) -> dict[str, object]:
        return {"checks": [{**asdict(check), "passed": check.passed} for check in checks]}

    found = saved(
        Check("fault problem, 100 m: figures", 1.5, 1.23, 0, "s", "aim", "at most"),
        Check("fault problem, 50 m: time loop on 1 rank over 2", 1.75, 1.6, 0, "1", "aim", "at least"),
    )
    rows = {row[0]: row[1:] for row in aim_rows(found, saved())}
    assert rows["fault problem, 100 m: figures"] == ("3 s", "at most 1.5 s", "1.23 s", "reached")
    assert rows["fault problem, 50 m: time loop on 1 rank over 2"] == ("1.36", "at least 1.75", "1.6", "missed")
    assert rows["mode map of 180 runs, 2 cores"] == ("418", "", "not measured", "")


def test_every_aim_is_measured_by_a_benchmark() -> None:
    """Names in the table of aims are those of checks."""
    run = dict.fromkeys(("start", "model", "steps", "energies", "gathering", "writing", "figures", "wall"), 1.0)
    found = {(problem, ranks): [run] for problem in ("impact demo", "fault problem, 100 m", "fault problem, 50 m")
             for ranks in (1, 2)}  # fmt: skip
    row = {
        "dim": 3, "order": 4, "geometry": "affine", "nodes": 1_000_000, "asked": 1_000_000, "ranks": 1,
        "efficiency": None, "node_updates_per_second_per_core": 4e7, "interface_share": 0.1, "bytes_per_node": 91.0,
    }  # fmt: skip
    known = {check.quantity for check in [*_checks(found), *speed._of_steps([row])]}
    assert {quantity for quantity, _ in FIRST} - known == {f"mode map of {mode_map.RUNS} runs, {mode_map.CORES} cores"}
