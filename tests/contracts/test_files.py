"""Every key that names a file: a resumed run either does not read the file again, or refuses another content."""

from __future__ import annotations

import json
import re
import shutil
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w
import xarray
from helpers.messages import facts
from helpers.small_cases import plates, strike_slip
from typer.testing import CliRunner

from ruptfx import RuptfxError
from ruptfx.app.cli import app
from ruptfx.case import FOLDERS, parse_case, read_case
from ruptfx.input.schema import Part, RunFile, alternatives, descriptions, has_mark, package_of
from ruptfx.platform import run_files
from ruptfx.platform.files import checksum
from ruptfx.run.recording import checkpoint

GEO = (Path(__file__).parents[1] / "data" / "two_bodies.geo").read_text()
MESH = {"kind": "gmsh_file", "file": "mesh.geo", "interfaces": {"main": {"plus": "upper", "minus": "lower"}}}
GAUGE = {"kind": "fault_receiver", "name": "fault", "interval": 2.3e-7, "position": 5.3e-3}
SLIDER = {
    "kind": "spring_slider", "stiffness": 1e8, "normal_force": 1e4,
    "friction": {"kind": "rate_and_state_ageing", "a": 0.01, "b": 0.015, "D_c": 1e-5, "f_0": 0.6, "V_0": 1e-6},
}  # fmt: skip


def text(name: str, lines: str) -> Callable[[Path], dict[str, Path]]:
    def write(folder: Path) -> dict[str, Path]:
        (folder / name).write_text(lines)
        return {name: folder / name}

    return write


def grid(name: str, **dims: list[float]) -> Callable[[Path], dict[str, Path]]:
    def write(folder: Path) -> dict[str, Path]:
        values = np.full([len(values) for values in dims.values()], 5e9)
        xarray.Dataset({"E": (list(dims), values)}, coords=dims).to_netcdf(folder / name, engine="h5netcdf")
        return {name: folder / name}

    return write


def example(cls: Any) -> Any:
    """The example of an alternative as a table."""
    return tomllib.loads(f"example = {cls.example}")["example"]


def scripts(folder: Path) -> dict[str, Path]:
    """A script that includes another one, and its file of options."""
    (folder / "mesh.geo").write_text('Include "inner.geo";\n')
    (folder / "inner.geo").write_text(GEO)
    (folder / "mesh.geo.opt").write_text("Mesh.Smoothing = 1;\n")
    return {name: folder / name for name in ("mesh.geo", "inner.geo", "mesh.geo.opt")}


Rows = dict[str, tuple[dict[str, Any], Callable[[Path], dict[str, Path]]]]


def tables() -> Rows:
    """Cases and writers of their files, by class and key."""
    law = "faults.main.friction"
    traces = {"kind": "traces", "instrument": "fault", "file": "t.csv", "sigma": 1e-6}
    field = {"kind": "displacement_field", "file": "u.csv", "time": 1e-6, "sigma": 1e-6}
    moved = {"kind": "moved", "edge": "upper.left", "component": "x", "quantity": "velocity", "file": "v.csv"}
    table = {"kind": "coulomb", "mu_d": {"kind": "table", "file": "p.csv"}}
    surface = {"kind": "coulomb", "mu_d": {"kind": "surface_table", "file": "s.csv"}}
    trace = "time,drive_speed,friction\n" + "".join(f"{i},1e-6,0.6\n" for i in range(20))
    known = "time (us),x (mm),{0}\n" + "".join(f"{t},{x},{{1}}\n" for t in (0, 9) for x in (-1, 20))
    fields: Rows = {f"{name}.Given.file": (plates({f"faults.main.{name}": {"kind": "given", "file": "f.csv"}}),
                                     text("f.csv", known.format(f"{name} ({unit})", value)))
              for name, unit, value in (("pore_pressure", "MPa", 1), ("temperature", "K", 300))}  # fmt: skip
    histories: Rows = {}
    for cls in alternatives("ruptfx.interfaces.slip_histories").values():
        for name, content in cls.files_of_example.items():
            row = plates({"faults.main.prescribed_slip": [example(cls)]}), text(name, content)
            histories[f"slip_histories.{cls.__name__}.file"] = row
    well = example(alternatives("ruptfx.interfaces.pore_pressure")["diffusion"])
    well["wells"] = [{"center": 0.0, "file": "q.csv"}]
    height = "".join(f"{(-1) ** i}e-6\n" for i in range(9))
    modulus = {"kind": "grid", "file": "E.nc", "variable": "E"}
    moves = "x (mm),y (mm),displacement_x (um)\n5,1,0\n"
    return {
        "meshes.GmshFile.file": (plates({"mesh": MESH}), scripts),
        "profiles.Grid.file": (plates({"materials.default.young_modulus": modulus}),
                      grid("E.nc", x=[0.0, 0.012], y=[-0.01, 0.01])),
        "spring_slider.Fit.trace": ({**SLIDER, "experiment": {"kind": "fit", "trace": "f.csv"}}, text("f.csv", trace)),
        "maxwell_slip.Surface.profile": ({"kind": "maxwell_slip", "surfaces": [{"name": "a", "profile": "z.txt"}]},
                            text("z.txt", height)),
        "profiles.Table.file": (plates({law: table}), text("p.csv", "x,mu\n-1,0.5\n1,0.6\n")),
        "profiles.SurfaceTable.file": (plates({law: surface}), text("s.csv", "0,0,1\n1,0,1\n0,1,1\n1,1,1\n")),
        **{f"instruments.{cls}.stations": (strike_slip({"instruments": [
            {"kind": kind, "interval": 1e-6, "name": "sta", "stations": "sta.csv"},
        ]}), text("sta.csv", "name,x (mm),y (mm),z (mm)\nA,1,0,-1\n"))
           for cls, kind in (("Receiver", "receiver"), ("FaultReceiver", "fault_receiver"))},
        "boundaries.Moved.file": (plates({"boundaries": [moved]}), text("v.csv", "time (us),v (m/s)\n0,0\n20,5\n")),
        "misfits.Traces.file": (plates({"instruments": [GAUGE], "objective": [traces]}),
                        text("t.csv", "time (us),slip (um)\n1,0\n2,0\n")),
        "misfits.DisplacementField.file": (plates({"objective": [field]}), text("u.csv", moves)),
        "pore_pressure.Well.file": (plates({"faults.main.pore_pressure": well}),
                                    text("q.csv", "time (d),rate (L/min)\n0,0\n1,2\n")),
        **fields, **histories,
    }  # fmt: skip


TABLES = tables()


def keys_of_files() -> Iterator[str]:
    """Keys of text that are called `file`, have the mark, or whose description begins with a file."""
    for folder in (*FOLDERS, "lumped"):
        alternatives(package_of(folder))
    classes, todo = dict[type[Part], None](), [Part]
    while todo:
        cls = todo.pop()
        todo += cls.__subclasses__()
        classes[cls] = None
    for cls in classes:
        for key, field in cls.model_fields.items():
            if not cls.__module__.startswith("ruptfx.") or "str" not in str(field.annotation) or key == "plugins":
                continue
            said = descriptions(cls).get(key, "").partition(".")[0]
            if key == "file" or has_mark(cls, key, RunFile) or "file" in said:
                *_, folder, file = cls.__module__.split(".")
                if not file.startswith("_"):  # what several kinds share
                    yield f"{folder}.{cls.__name__}.{key}"


def test_every_key_that_names_a_file_has_a_case_here() -> None:
    # `data`, `variable` and `names` tell of the file of another key; files of a study are no keys of a run.
    others = {"misfits.Traces.data", "misfits.Traces.map", "profiles.SurfaceTable.variable", "meshes.GmshFile.names"}
    assert {key for key in keys_of_files() if ".Study." not in key} - others == set(TABLES)


@pytest.mark.parametrize("key", TABLES)
def test_a_file_is_contained_in_the_resolved_case_or_has_a_checksum(key: str, tmp_path: Path) -> None:
    table, write = TABLES[key]
    files = write(tmp_path)
    case, run = parse_case(table, tmp_path), tmp_path / "run"
    run.mkdir()
    case.save(run)
    is_named = str(tmp_path / next(iter(files))) in (run / "case.toml").read_text()
    if is_named:
        assert set(case.sums) == {str(path) for path in files.values()} and run_files.check_inputs(run)
        for path in files.values():
            changes_are_refused(path, run, case.hash, lambda: parse_case(table, tmp_path).hash)
    else:  # its numbers are in the case
        assert not case.sums
        for path in files.values():
            path.unlink()
        assert read_case(run / "case.toml").hash == case.hash and not run_files.check_inputs(run)


def changes_are_refused(path: Path, run: Path, hash_before: str, present_hash: Callable[[], str]) -> None:
    """A byte more, no file at all, and the file as it was."""
    before = path.read_bytes()
    size, sha256 = len(before), checksum(path)
    path.write_bytes(before + b" ")
    words = rf"{path}: changed .*{sha256}, {size} bytes; now {checksum(path)}, {size + 1} bytes.*--out"
    with pytest.raises(RuptfxError, match=facts(words)):
        run_files.check_inputs(run)
    assert present_hash() != hash_before
    path.unlink()
    with pytest.raises(RuptfxError, match=facts(rf"{path}: missing .*{sha256}, {size} bytes")):
        run_files.check_inputs(run)
    path.write_bytes(before)
    assert run_files.check_inputs(run) and present_hash() == hash_before


def begun(folder: Path) -> Path:
    """A run on a mesh of a script that includes another, stopped after its last checkpoint."""
    scripts(folder)
    table = plates({"mesh": MESH, "duration": 1e-6, "output.checkpoint_steps": 2, "order": 1})
    (folder / "case.toml").write_text(tomli_w.dumps(table))
    assert invoked("run", folder / "case.toml", "--out", folder / "run", "--quiet") == (0, "")
    (folder / "run" / "summary.json").unlink()
    return folder / "run"


def invoked(*arguments: str | Path) -> tuple[int, str]:
    result = CliRunner(env={"COLUMNS": "400"}).invoke(app, [str(argument) for argument in arguments])
    return result.exit_code, result.output


def as_of_an_earlier_version(run: Path) -> None:
    """Remove the checksums of files, and give all checkpoints the hash of before."""
    case = read_case(run / "case.toml")
    (run / "inputs.json").unlink()
    for path in checkpoint.all_of(run):
        manifest = checkpoint.read_manifest(path)
        checkpoint.write_manifest(path, {**manifest, "case_hash": case.hash_without_files})
    files = run_files.listed(run) or {}
    run_files.write_json(run / "files.json", {"files": files, "seal": run_files.seal(files)})


@pytest.mark.fem
def test_resume_refuses_another_mesh_wherever_the_run_directory_is(tmp_path: Path) -> None:
    pytest.importorskip("dolfinx")
    run = begun(tmp_path)
    case = read_case(run / "case.toml")
    finer = GEO.replace("h = 2e-3", "h = 1.7e-3")
    moved = tmp_path / "elsewhere" / "moved"
    shutil.copytree(run, moved)
    for place in (run, moved):
        (tmp_path / "inner.geo").write_text(finer)
        for options in ((), ("--duration", "2 us")):
            code, said = invoked("resume", place, "--quiet", *options)
            words = facts(rf"inner\.geo: changed .*{len(GEO)} bytes; now .*{len(finer)} bytes")
            assert code == 1 and re.search(words, said)
        assert invoked("run", tmp_path / "case.toml", "--out", place, "--resume", "--quiet")[0] == 1
        (tmp_path / "inner.geo").write_text(GEO)
    assert invoked("resume", moved, "--quiet")[0] == 0 and (moved / "summary.json").is_file()
    assert json.loads((moved / "summary.json").read_text())["case_hash"] == case.hash


@pytest.mark.fem
def test_a_run_of_an_earlier_version_is_resumed_but_not_with_another_number_of_nodes(tmp_path: Path) -> None:
    pytest.importorskip("dolfinx")
    run = begun(tmp_path)
    as_of_an_earlier_version(run)
    (tmp_path / "inner.geo").write_text(GEO.replace("h = 2e-3", "h = 1.7e-3"))
    code, said = invoked("resume", run)
    assert code == 1 and re.search(facts(r"step_\d+: '\w+' has \d+ nodes and the mesh \d+"), said)
    (tmp_path / "inner.geo").write_text(GEO)
    code, said = invoked("resume", run)
    assert code == 0 and re.search(facts(r"without checksums of .*mesh\.geo"), said)
