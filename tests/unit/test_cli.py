"""The command line: what is refused before and during a run, and what check, plot and describe print."""

from __future__ import annotations

import inspect
import json
import os
import re
import shlex
import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
import tomli_w
import typer
from helpers.messages import says
from helpers.small_cases import impact, merged, plates, slip_weakening
from helpers.units import check_units
from typer.testing import CliRunner, Result

from ruptfx import __version__
from ruptfx.app.cli import app
from ruptfx.app.commands.check import engineering, readable
from ruptfx.app.commands.check import merged as merged_rows
from ruptfx.app.reference.describe import TOPICS, about, entries, entries_of, keys_of
from ruptfx.case import Case, FaultCase
from ruptfx.input.schema import kinds, package_of
from ruptfx.interfaces.mechanisms.checks.table import Row
from ruptfx.laws.friction.coulomb import Coulomb
from ruptfx.platform import launch
from ruptfx.results import summary_fields

ROOT = Path(__file__).parents[2]
GROUP: Any = typer.main.get_command(app)


def ruptfx(*arguments: str | Path) -> Result:
    return CliRunner(env={"COLUMNS": "200"}).invoke(app, [str(argument) for argument in arguments])


def said(result: Result) -> str:
    """Everything printed, without the line breaks of a narrow terminal."""
    return " ".join(result.output.split())


def write(folder: Path, changes: dict[str, Any] | None = None, table: dict[str, Any] | None = None) -> Path:
    path = folder / "case.toml"
    path.write_text(tomli_w.dumps(merged(table or plates({"duration": 1e-6}), changes or {})))
    return path


@pytest.fixture
def needs_fem() -> None:
    pytest.importorskip("dolfinx")


def test_demos_come_along(tmp_path: Path) -> None:
    """Byte for byte, and never over what is there."""
    out = tmp_path / "cases"
    assert ruptfx("demos", out).exit_code == 0
    given = sorted((Path(__file__).parents[2] / "demos").glob("*.toml"))
    assert len(given) > 5
    assert {path.name: path.read_bytes() for path in out.glob("*.toml")} == {p.name: p.read_bytes() for p in given}
    again = ruptfx("demos", out)
    assert again.exit_code == 1 and "exists already; give another directory" in said(again)


def test_demos_with_a_schema(tmp_path: Path) -> None:
    """The first line is Taplo's directive, with a path relative to the case; the rest is that of the demo."""
    assert ruptfx("demos", tmp_path / "cases", "--schema").exit_code == 0
    for path in (tmp_path / "cases").glob("*.toml"):
        first, rest = path.read_text().split("\n", 1)
        assert first == "#:schema ./ruptfx.input.schema.json" and rest == (ROOT / "demos" / path.name).read_text()
    assert "friction" in json.loads((tmp_path / "cases" / "ruptfx.input.schema.json").read_text())["$defs"]


@pytest.mark.parametrize(("asked", "same"), [(["help"], ["--help"]), (["help", "run"], ["run", "--help"])])
def test_help_is_a_command_as_well(asked: list[str], same: list[str]) -> None:
    assert ruptfx(*asked).exit_code == 0 and ruptfx(*asked).output == ruptfx(*same).output
    wrong = ruptfx("help", "runn")
    assert wrong.exit_code == 2 and "did you mean 'run'?" in said(wrong).lower()


# -- refused before anything is computed ---------------------------------------------------------------------------


@pytest.mark.parametrize("command", ["run", "check"])
@pytest.mark.parametrize(
    "changes, message",
    [
        ({"duratoin": 1.0}, "unknown key 'duratoin', did you mean 'duration'?"),
        ({"duration": "60e-6"}, "duration = '60e-6': input should be a valid number"),
        ({"materials.default.young_modulus": -5.3e9}, "materials.default.young_modulus = -5300000000.0: input should"),
    ],
)
def test_bad_cases(command: str, changes: dict[str, Any], message: str, tmp_path: Path) -> None:
    result = ruptfx(command, write(tmp_path, changes))
    assert result.exit_code == 1
    assert "case error: " in said(result) and says(message, said(result)) and "Traceback" not in said(result)


def test_a_bad_case_starts_no_ranks(tmp_path: Path) -> None:
    result = ruptfx("run", write(tmp_path, {"duration": -1.0}), "--ranks", "2", "--out", tmp_path / "run")
    assert result.exit_code == 1 and says("duration = -1.0: input should be greater than 0", said(result))
    assert not (tmp_path / "run").exists()


def test_missing_and_unreadable_files(tmp_path: Path) -> None:
    assert says("none.toml: cannot be read: No such file or directory", said(ruptfx("check", tmp_path / "none.toml")))
    (tmp_path / "text.toml").write_text("this is not TOML")
    result = ruptfx("run", tmp_path / "text.toml")
    assert result.exit_code == 1 and says("text.toml: not valid TOML", said(result))


def test_bad_set(tmp_path: Path) -> None:
    path = write(tmp_path)
    for item, message in (
        ("duration", "--set duration: write KEY=VALUE"),
        ("durtion=1e-6", "unknown key 'durtion', did you mean 'duration'?"),
        ("duration=soon", "duration = 'soon': input should be a valid number"),
    ):
        result = ruptfx("check", path, "--set", item)
        assert result.exit_code == 1 and says(message, said(result))


def test_what_starts_ranks_needs_dolfinx(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(launch, "find_spec", lambda name: None)
    path, study = write(tmp_path), tmp_path / "study.toml"
    study.write_text('case = "case.toml"\n[[axes]]\nkey = "duration"\nvalues = [1e-6, 2e-6]\n')
    for command in (("run", path, "--ranks", "2"), ("study", study)):
        result = ruptfx(*command, "--out", tmp_path / "out")
        assert result.exit_code == 1 and "-m pip install 'ruptfx[fem]'" in said(result)
        assert "Traceback" not in said(result)
        assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("command", [
    "--version",  # at the end of the program; the others within the text
    *(pytest.param(x, marks=pytest.mark.slow) for x in
      ("describe --schema", "describe friction", "bench table", "bench waves --json")),
])  # fmt: skip
def test_a_reader_that_leaves_ends_a_command_quietly(command: str, needs_fem: None, tmp_path: Path) -> None:
    check = {"quantity": "speed", "expected": 1.0, "found": 1.0, "passed": True}
    (tmp_path / "waves.json").write_text(json.dumps({"fine": False, "checks": [check]}))
    out = ["--out", str(tmp_path), *["--overwrite"] * ("waves" in command)] if "bench" in command else []
    buffered = {key: value for key, value in os.environ.items() if key != "PYTHONUNBUFFERED"}
    with subprocess.Popen(
        [sys.executable, "-m", "ruptfx", *command.split(), *out], env=buffered, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    ) as process:  # fmt: skip
        process.stdout.close()  # before anything is written
        text = " ".join(process.stderr.read().split())
        assert text == (f"waves ... replacing in {tmp_path}: waves.json" if "waves" in command else "")
    assert process.returncode == 1


@pytest.mark.fem
def test_output_directory_that_exists(tmp_path: Path, needs_fem: None) -> None:
    out = tmp_path / "run"
    out.mkdir()
    (out / "precious.txt").write_text("do not touch")
    result = ruptfx("run", write(tmp_path), "--out", out)
    assert result.exit_code == 1 and f"{out}: exists already; choose another directory" in said(result)
    assert [path.name for path in out.iterdir()] == ["precious.txt"]


@pytest.mark.fem
def test_output_directory_that_cannot_be_written(tmp_path: Path, needs_fem: None) -> None:
    # Below a file, where not even an administrator can make a directory.
    (tmp_path / "file").write_text("")
    result = ruptfx("run", write(tmp_path), "--out", tmp_path / "file" / "run")
    assert result.exit_code == 1
    assert says("cannot be written (Not a directory); choose another --out", said(result))
    result = ruptfx("run", write(tmp_path), "--out", tmp_path / "file")
    assert result.exit_code == 1 and "exists already" in said(result)


@pytest.mark.fem
@pytest.mark.parametrize("command", ["run", "check"])
@pytest.mark.parametrize(
    "changes, message",
    [
        ({"stepper": {"kind": "leapfrog", "time_step": 1e-6}}, "stepper.time_step = 1e-06 s: unstable, the limit is"),
        ({"stepper": {"kind": "leapfrog", "time_step": 5e-8}, "faults.main.contact.C_n": 1e15},
         "s, set by the contact stiffness of faults.main ("),
        ({"boundaries": [{"kind": "absorbing", "edge": "uper.left"}]},
         "boundaries.0.edge = 'uper.left': no such edge, did you mean 'upper.left'?"),
        ({"faults": {}}, "faults: the mesh has the interface 'main', which needs [faults.main]"),
    ],
)  # fmt: skip
def test_what_the_mesh_refuses(
    command: str, changes: dict[str, Any], message: str, tmp_path: Path, needs_fem: None
) -> None:
    options = ["--out", tmp_path / "run"] if command == "run" else []
    result = ruptfx(command, write(tmp_path, changes), *options)
    assert result.exit_code == 1 and message in said(result) and "Traceback" not in said(result)


# -- a run ---------------------------------------------------------------------------------------------------------


@pytest.mark.fem
def test_run_leaves_a_complete_directory(tmp_path: Path, needs_fem: None) -> None:
    from ruptfx.results.record import Record

    out = tmp_path / "run"
    result = ruptfx("run", write(tmp_path), "--out", out, "--set", "materials.default.density=1300.0")
    assert result.exit_code == 0, said(result)
    assert f"Run directory: {out}" in said(result) and "wall time" in said(result)
    names = {path.name for path in out.iterdir()}
    assert {"case.toml", "interface.h5", "bulk.h5", "energy.csv", "run.log", "summary.json"} <= names
    with Record(out) as record:
        assert record.complete and record.case["materials"]["default"]["density"] == 1300.0
        assert record.summary["case_hash"] == record.interface.attrs["case_hash"]
        wanted = ("mode tip_speed tip_speed_over_c_s tip_speed_over_c_l peak_slip_rate max_slip energy_closure "
                  "wall_time steps nodes node_updates_per_second ranks versions case_hash")  # fmt: skip
        assert set(wanted.split()) <= set(record.summary) <= set(summary_fields.DESCRIPTIONS)
        # One row of energies per record, from rest to the end.
        assert len(record.energy.time) == record.interface.sizes["time"]
        assert float(record.interface.time[0]) == 0 and float(record.interface.time[-1]) >= 1e-6
        for field in ("slip", "slip_rate", "shear_traction", "normal_stress", "opening"):
            assert record.interface[field].dims == ("time", "position")
    assert check_units(out) > 20


@pytest.mark.fem
def test_a_law_that_turns_not_a_number(tmp_path: Path, needs_fem: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stops at once, names point, time and state; what was written stays readable."""
    import numpy as np

    from ruptfx.interfaces.faults.fault import Fault
    from ruptfx.laws.friction.linear_slip_weakening import LinearSlipWeakening
    from ruptfx.results.record import Record

    monkeypatch.setattr(Fault, "require_strength", lambda self: None)  # it would be refused before the run
    plain = LinearSlipWeakening.strength
    # Beyond a slip of 0.1 um the law is the logarithm of a negative number.
    monkeypatch.setattr(
        LinearSlipWeakening, "strength",
        lambda self, v, sigma, state: plain(self, v, sigma, state) + 1e-9 * np.log(1e-7 - state["cumulative_slip"]),
    )  # fmt: skip
    broken = impact(6e6, 20.0, changes={
        "duration": 20e-6, "output.interface_interval": 1e-6, "mesh.length": 12e-3, "mesh.height": 4e-3,
        "faults.main.friction": {"kind": "linear_slip_weakening", "mu_s": 0.1, "mu_d": 0.05, "D_c": 1e-4},
    })  # fmt: skip
    out = tmp_path / "run"
    result = ruptfx("run", write(tmp_path, table=broken), "--out", out)
    assert result.exit_code == 1
    for part in ("linear_slip_weakening: ", "interface point ", "of fault 'main' at (", "time ", "cumulative_slip = "):
        assert part in said(result)
    with Record(out) as record:
        assert not record.complete and record.interface.sizes["time"] >= 2
        assert np.isfinite(record.interface.slip.values).all() and len(record.energy.time) >= 2
    assert "linear_slip_weakening" in (out / "run.log").read_text()


@pytest.mark.fem
def test_a_motion_that_explodes(tmp_path: Path, needs_fem: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """The check of the time step switched off: the run stops with place and time, not with a file full of NaN."""
    from ruptfx.bodies import spectrum
    from ruptfx.results.record import Record

    real = spectrum.highest_frequency
    monkeypatch.setattr(spectrum, "highest_frequency", lambda *given: 0.5 * real(*given))
    moving = impact(6e6, 2.0, changes={
        "duration": 300e-6, "mesh.length": 12e-3, "mesh.height": 4e-3, "output.interface_interval": 2e-6,
    })  # fmt: skip
    result = ruptfx("run", write(tmp_path, table=moving), "--out", tmp_path / "run")
    assert result.exit_code == 1
    assert "time " in said(result) and says(" at (", said(result)) and "reduce" in said(result)
    with Record(tmp_path / "run") as record:
        assert not record.complete and record.interface.sizes["time"] >= 1


# -- names that are markup or paths --------------------------------------------------------------------------------

NAME = "-m[bold]x :x: 'ü\""


def test_only_one_module_makes_consoles() -> None:
    """They show text as it is; a console of rich's own would read markup in names."""
    package = Path(launch.__file__).parent
    assert [path.name for path in package.rglob("*.py") if "Console(" in path.read_text()] == ["terminal.py"]


@pytest.mark.usefixtures("blank_pictures")
def test_names_are_printed_as_they_are(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path(f"{NAME}.toml").write_text(Path(launch.__file__).parents[1].joinpath("demos/maxwell_slip.toml").read_text())
    assert f" {NAME}.toml: maxwell_slip, " in said(ruptfx("check", "--", f"{NAME}.toml"))
    out = Path(f"[red]{NAME}")
    done = ruptfx("run", "--out", out, "--", f"{NAME}.toml")
    assert done.exit_code == 0 and f"Run directory: {out} " in said(done) and f"Pictures: {out}/figures (" in said(done)
    redrawn = ruptfx("plot", out)
    assert redrawn.exit_code == 0 and redrawn.output.startswith(f"reading {out}")
    assert f"replacing in {out}/figures: " in said(redrawn)
    refused = ruptfx("check", "--set", f"{NAME}=1", "--", f"{NAME}.toml")
    assert refused.exit_code == 1 and NAME in said(refused)


@pytest.mark.fem
def test_a_title_is_printed_as_it_is(tmp_path: Path, needs_fem: None) -> None:
    done = ruptfx("check", write(tmp_path, {"title": NAME}))
    assert any(line.startswith(NAME) for line in done.output.splitlines())


@pytest.mark.fem
def test_ranks_are_given_names_as_they_are(tmp_path: Path, needs_fem: None, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    write(tmp_path).rename("-x.toml")
    asked: list[str] = []
    monkeypatch.setattr(launch, "run_on", lambda ranks, arguments, **variables: asked.extend(arguments) or 0)
    assert ruptfx("run", "--ranks", "2", "--out", "../-x", "--", "-x.toml").exit_code == 0
    assert ruptfx(*asked).exit_code == 0 and (tmp_path / "-x" / "summary.json").exists()


# -- check, plot, describe -----------------------------------------------------------------------------------------


@pytest.mark.fem
def test_check_prints_the_table(tmp_path: Path, needs_fem: None) -> None:
    result = ruptfx("check", write(tmp_path, table=impact(6e6, 2.0)))
    assert result.exit_code == 0, said(result)
    # Plate speeds of Homalite: c_l = sqrt(E / (rho (1 - nu^2))) = 2201.7, c_s = 1255.2, c_R = 1155.9 m/s.
    assert says("upper, lower: c_p", said(result)), "equal bodies once"
    for text in ("2201.", "1255.", "1155.", "stable time step", "time step", "expected run time", "memory", "strength"):
        assert text in said(result)


@pytest.mark.fem
def test_check_shows_its_work_on_a_terminal(tmp_path: Path, needs_fem: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """With a clock; elsewhere each phase is a line on standard error, which is not in the output of the command."""
    path = write(tmp_path)
    done = subprocess.run([sys.executable, "-m", "ruptfx", "check", path], capture_output=True, text=True, timeout=300)
    phases = [f"reading {path}", "building the model, and measuring its steps"]
    assert done.stderr.splitlines() == phases and not any(phase in done.stdout for phase in phases)
    monkeypatch.setenv("RUPTFX_TERMINAL", "1")
    assert "building the model" in (shown := ruptfx("check", path).output) and "0:00:0" in shown


@pytest.mark.fem
def test_check_prints_warnings_as_sentences_below_the_table(tmp_path: Path, needs_fem: None) -> None:
    """Of a material without effect: the row refers to the sentence, which is one line in a pipe."""
    table = impact(6e6, 2.0)
    table["materials"] |= {"upper": "pmma", "lower": "aluminium"}
    below = ruptfx("check", write(tmp_path, table=table)).output.partition("└")[2].splitlines()
    (line,) = [line for line in below if "materials.default" in line]
    assert re.fullmatch(r"warning \d+: materials\.default = isotropic_elastic: without effect.*remove it", line)


def test_rows_of_check() -> None:
    """Rows of bodies that say the same are one, times and stresses have the prefix that suits them."""
    rows = [
        Row("upper: c_p", 2201.0, "m/s"),
        Row("lower: c_p", 2201.0, "m/s"),
        Row("base: c_p", 6000.0, "m/s"),
        Row("time step", 1.86e-7, "s"),
        Row("a: stress", 71981.2, "Pa", "x"),
        Row("b: stress", 71981.2, "Pa", "y"),
    ]
    found = [(row.quantity, *engineering(row)) for row in merged_rows(rows)]
    assert found == [
        ("upper, lower: c_p", "2201", "m/s"), ("base: c_p", "6000", "m/s"), ("time step", "186", "ns"),
        ("a: stress", "71.98", "kPa"), ("b: stress", "71.98", "kPa"),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("value", "unit", "shown"),
    [
        ("0 to 0.14", "m", ("0 to 140", "mm")), ("-15000 to 15000", "m", ("-15 to 15", "km")),
        ("0 to 0", "m", ("0 to 0", "m")), ("0 to 5", "1", ("0 to 5", "1")), ("1e-06 to 2e-05", "s", ("1 to 20", "us")),
    ],
)  # fmt: skip
def test_check_shows_ranges_with_the_prefix_of_their_larger_end(value: str, unit: str, shown: tuple[str, str]) -> None:
    assert engineering(Row("position", value, unit)) == shown


def test_notes_of_check_have_readable_units() -> None:
    """Numbers with a unit alone, and not those of products, of speeds, or of points."""
    note = "9 steps for 6e-05 s, at x = 0.07 m; over 6.085e+04 Pa at 2 m/s, A = 1e-3 m^2, 72 Pa/m, at (0.001, 0.002) m"
    expected = "9 steps for 60 us, at x = 70 mm; over 60.85 kPa at 2 m/s, A = 1e-3 m^2, 72 Pa/m, at (0.001, 0.002) m"
    assert readable(note) == expected


def test_ranges_in_notes_of_check_have_one_unit() -> None:
    note = "at all positions -2723.61 to 2723.61 m: from 0 to 0.5 s, 3 m to 4000 m"
    assert readable(note) == "at all positions -2.724 to 2.724 km: from 0 to 500 ms, 3 m to 4 km"


def test_paragraphs_of_the_help_are_broken_by_the_terminal_alone() -> None:
    shown = CliRunner(env={"COLUMNS": "80"}).invoke(app, ["export", "--help"]).output
    lines = [line.strip() for line in shown.splitlines()]
    start = next(number for number, line in enumerate(lines) if line.startswith("csv: "))
    # Typer before 0.16 leaves no line between paragraphs.
    end = next(start + k for k, line in enumerate(lines[start:]) if not line or line.startswith("Example: "))
    paragraph = lines[start:end]
    # No line is so short that the first word of the next one would have fitted.
    assert all(len(one) + 1 + len(two.split()[0]) > 70 for one, two in pairwise(paragraph)), paragraph


def test_all_contradictions_of_a_case_are_listed_at_once(tmp_path: Path) -> None:
    table = impact(6e6, 2.0)
    table |= {"initial_velocity": {"upper": [1.0]}, "output": {"forces_interval": 1e-6, "interface_interval": 1e-20}}
    lines = ruptfx("check", write(tmp_path, table=table)).output.splitlines()
    for words in ("initial_velocity.upper", "output.forces_interval", "output.interface_interval"):
        assert sum(words in line for line in lines) == 1, words


@pytest.mark.fem
def test_check_looks_beyond_the_overstressed_patch(tmp_path: Path, needs_fem: None) -> None:
    """The middle slips at once under 3.7 MPa; beside it the stress is 2.8 MPa between 3.6 and 1.8 MPa: S = 0.8."""
    text = said(ruptfx("check", write(tmp_path, table=slip_weakening())))
    assert "it slips from the first step at" in text and says("shear 2.8 MPa", text)
    assert any("main: S " in line and "0.8 " in line for line in text.split("│ faults."))


@pytest.mark.fem
@pytest.mark.parametrize("width", [60, 80, 120, None])
def test_rows_of_check_are_readable_at_any_width(width: int | None, tmp_path: Path, needs_fem: None) -> None:
    """No word is cut or broken; in a pipe, without COLUMNS, a row is one line."""
    case = write(tmp_path, table=slip_weakening({"title": "a", "duration": 4e-5}))
    text = CliRunner(env={"COLUMNS": str(width)} if width else {}).invoke(app, ["check", str(case)]).stdout
    assert "…" not in text
    words = text.replace("│", " ").split()
    for word in ("output.interface_interval", "reflects", "processor", "absorbing,"):
        assert word in words, word
    rows = [line for line in text.splitlines() if not line.startswith(("warning", "reading"))]
    if width:
        assert max(map(len, rows)) <= width
    else:
        (row,) = (line for line in rows if "upper.top: echo" in line)
        assert "us" in row and "belong to the experiment" in row


@pytest.mark.fem
def test_check_counts_points_in_the_process_zone(needs_fem: None) -> None:
    from ruptfx.app.checks.preflight import preflight
    from ruptfx.case import parse_case

    rows = {row.quantity: row.value for row in preflight(parse_case(slip_weakening()))}
    # G = 5.3 / 2.7 = 1.963 GPa; plane stress: G* = 1.35 G = 2.65 GPa; D_c = 5 um, drop (0.6 - 0.3) x 6 = 1.8 MPa:
    # 9 pi / 32 x 2.65e9 x 5e-6 / 1.8e6 = 6.504 mm. Widest spacing of order 4: sqrt(3/7) / 2 x 2 mm = 0.6547 mm.
    assert rows["faults.main: static process zone"] == pytest.approx(6.504e-3, rel=1e-3)
    assert rows["faults.main: points in process zone"] == pytest.approx(6.504 / 0.6547, rel=1e-3)


def test_version_and_help() -> None:
    assert ruptfx("--version").output.strip() == __version__
    for command in ("run", "check", "plot", "describe", "demos", "bench", "study"):
        assert command in ruptfx("--help").output
    listed = CliRunner(env={"COLUMNS": "80"}).invoke(app, ["--help"]).output
    assert len(listed.splitlines()) < 60 and "…" not in listed  # two screens


@pytest.mark.parametrize("name", GROUP.commands)
def test_help_of_a_command(name: str) -> None:
    """What it does, an example that it would accept, and a word on every argument and option, which is not cut."""
    command = GROUP.commands[name]
    for width in ("80", "120"):
        assert "…" not in CliRunner(env={"COLUMNS": width}).invoke(app, [name, "--help"]).output
    text, _, example = inspect.cleandoc(command.callback.__doc__ or "").partition("\n\nExample: ")
    assert text.endswith(".")
    program, called, *arguments = shlex.split(example)
    assert (program, called) == ("ruptfx", name)
    command.make_context(name, arguments)  # no such option, or a value that it does not take: an error
    assert all(parameter.help for parameter in command.params if parameter.name != "help")
    shown = said(ruptfx(name, "--help"))
    assert f"Example: ruptfx {name}" in shown
    # What is in brackets would be taken for markup and left out.
    assert [help for parameter in command.params if (help := parameter.help or "") and "[" in help] == []


def test_the_tab_key_offers_names() -> None:
    from ruptfx.app.commands import bench, describe, movie, new
    from ruptfx.app.commands._shared import completed_from

    assert completed_from(describe.topics)("fr") == ["friction"]
    assert "impact" in completed_from(new.cases)("") and "mode_map" not in new.cases()
    assert completed_from(bench.names)("wav") == ["waves", "waves_3d"]
    shown = said(ruptfx("movie", "--help"))
    assert [film for film in completed_from(movie.films)("") if film not in shown] == []


@pytest.mark.parametrize(
    "folder", ["friction", "boundaries", "contact", "materials", "meshes", "steppers", "operators"]
)
def test_describe_lists_the_folder(folder: str) -> None:
    if folder == "operators":
        pytest.importorskip("dolfinx")
    result = ruptfx("describe", folder)
    assert result.exit_code == 0
    assert all(kind in result.output for kind in kinds(package_of(folder)))


def test_describe_shows_units_bounds_and_formulas() -> None:
    text = said(ruptfx("describe", "friction"))
    for part in ("strength = mu_d sigma", "Coulomb (1785)", "theta_p [Pa]", "L_p", "m >", "required"):
        assert part in text
    # What is in brackets is text, not markup.
    assert "[u_s]" in said(ruptfx("describe", "contact"))
    assert "C_n" in said(ruptfx("describe", "contact")) and "Pa/m" in said(ruptfx("describe", "contact"))


@pytest.mark.parametrize("asked, kind, key", [
    ("coulomb", "friction.coulomb", "mu_d"), ("boundaries.driven", "boundaries.driven", "velocity"),
    ("leapfrog", "steppers.leapfrog", "safety"),
])  # fmt: skip
def test_one_kind_is_described(asked: str, kind: str, key: str) -> None:
    (entry,) = entries_of(asked)
    assert entry.name == kind and key in {each.name for each in entry.keys}
    assert kind in ruptfx("describe", asked).output


def test_a_name_that_two_folders_have_is_described_for_both() -> None:
    assert {entry.name for entry in entries_of("linear")} >= {"cohesion.linear"}
    assert ruptfx("describe", "coulom").exit_code == 1 and "'coulomb'" in said(ruptfx("describe", "coulom"))


def test_defaults_are_those_of_toml() -> None:
    keys = {key.name: key.default for topic in TOPICS if topic != "operators" for entry in entries(topic)
            for key in entry.keys}  # fmt: skip
    assert not [name for name, default in keys.items() if any(word in default for word in ("True", "False", "'kind'"))]
    assert keys["large_rotations"] == "false"


def test_flags_are_shown_without_a_type() -> None:
    text = said(ruptfx("run", "--help"))
    assert "--quiet" in text and "<bool>" not in text.lower() and "boolean" not in text.lower()
    whole = said(ruptfx("--help"))
    assert "--version" in whole and "bool" not in whole.lower()


def test_describe_profiles_and_unknown() -> None:
    assert "boxcar" in ruptfx("describe", "profiles").output
    result = ruptfx("describe", "frictoin")
    assert result.exit_code == 1 and says("did you mean 'friction'?", said(result))
    listed = said(ruptfx("describe"))
    for topic in TOPICS:
        assert f"{topic} {about(topic)}" in listed and len(about(topic)) > 10


def test_describe_says_where_to_read_on() -> None:
    keys = {key.name: key.bounds for key in keys_of(FaultCase)}
    assert keys["friction"] == "see friction" and keys["nucleation"] == "see nucleation"
    assert keys["gap"] == "may be a profile" and keys["sliding"] == ""
    assert {key.name: key.bounds for key in keys_of(Case)}["output"] == "see output"
    assert {key.name: key.bounds for key in keys_of(Coulomb)}["mu_d"] == ">= 0, may be a profile"


@pytest.mark.parametrize(
    "topic, parts",
    [
        ("output", ["interface_interval", "s", "> 0", "Time between records of the interface"]),
        ("stop_when", ["sliding_dead_for", "output.rupture_threshold"]),
        ("damping", ["damping.kelvin_voigt", "too much of it delays the front", "fraction", "0.1"]),
        ("study", ["axes", "required", "Latin hypercube", "grid | latin_hypercube"]),
        ("summary", ["tip_speed", "m/s", "Standard error of the fit"]),
        ("boundaries", ["Only the part of the edge between these x moves."]),
        ("histories", ["Ricker wavelet", "frequency", "1/s"]),
    ],
)
def test_describe_tables_of_a_case(topic: str, parts: list[str]) -> None:
    text = said(ruptfx("describe", topic))
    assert [part for part in parts if part not in text] == []


def test_describe_schema_is_json() -> None:
    assert set(json.loads(ruptfx("describe", "--schema").output)["$defs"]) >= {"case", "friction", "lumped", "study"}


def test_plot_of_nothing(tmp_path: Path) -> None:
    result = ruptfx("plot", tmp_path / "nowhere")
    assert result.exit_code == 1 and "no such directory" in said(result)
    result = ruptfx("plot", tmp_path)
    assert result.exit_code == 1 and "case.toml" in said(result)


def test_bench_saves_reports_and_tabulates(needs_fem: None, tmp_path: Path) -> None:
    out = "--out", tmp_path
    done = ruptfx("bench", "table", *out)
    assert done.exit_code == 1 and "no numbers" in said(done)
    printed = ruptfx("bench", "waves", "--json", *out).stdout
    rows = json.loads(printed[printed.index("[") :])  # before click 8.2 the runner mixes in what goes to stderr
    assert all(row["passed"] for row in rows) and (tmp_path / "waves.png").stat().st_size > 1000
    table = ruptfx("bench", "table", *out)
    assert table.exit_code == 0 and table.stdout.count("| pass | `ruptfx bench waves` |") == len(rows)
    # A saved number that does not pass fails the table too.
    saved = json.loads((tmp_path / "waves.json").read_text())
    saved["checks"][0].update(found=None, passed=False)
    (tmp_path / "waves.json").write_text(json.dumps(saved))
    failed = ruptfx("bench", "table", *out)
    assert failed.exit_code == 1 and "nan" in failed.stdout and "**fail**" in failed.stdout
