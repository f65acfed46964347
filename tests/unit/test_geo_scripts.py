"""What a .geo file does beyond describing a geometry is refused before Gmsh sees it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from helpers.messages import facts

from ruptfx import RuptfxError
from ruptfx.bodies.meshes import _geo, _mesh_file
from ruptfx.bodies.meshes.gmsh_file import GmshFile

DATA = Path(__file__).parents[1] / "data"
PLATES = (DATA / "two_bodies.geo").read_text()
SIDES = {"main": {"plus": "upper", "minus": "lower"}}


def build(path: Path, **options: bool) -> None:
    GmshFile.model_validate({"file": str(path), "interfaces": SIDES, **options}).build()


# What Gmsh does while it opens the script: commands, files, or an end of the process.
REFUSED = {
    'SystemCall "touch {hit}";': "'SystemCall' may run commands",
    'System "touch {hit}";': "'System'",
    'NonBlockingSystemCall "touch {hit}";': "'NonBlockingSystemCall'",
    'x = "a\\"; SystemCall "touch {hit}"; // "': "'SystemCall'",  # no escapes in strings
    'x = "a\n"; SystemCall "touch {hit}";': "2: 'SystemCall'",
    '// goes on \\\nSystemCall "touch {hit}";': "2: 'SystemCall'",
    '/* a /* b */ SystemCall "touch {hit}"; /* */': "'SystemCall'",
    '// \0 SystemCall "touch {hit}";': "zero byte",
    'Printf("x") > "{hit}";': "'Printf' writes a file",
    'Printf("%g", (1 > 0)) >> "{hit}";': "'Printf' writes a file",
    'CreateDir "{hit}";': "'CreateDir'",
    'Save "{hit}.msh";': "'Save'",
    'Print "{hit}.msh";': "'Print'",
    'OnelabRun("x", "touch {hit}");': "'OnelabRun'",
    'General.LogFileName = "{hit}";': "'LogFileName'",
    'Field[1] = ExternalProcess; Field[1].CommandLine = "touch {hit}"; Background Field = 1;': "'ExternalProcess'",
    "Exit;": "'Exit'",
    "\ufeffExit;": "'Exit'",
    "x = 'a \"b'; y = 1;": "quotation marks of both kinds",
}  # fmt: skip


@pytest.mark.parametrize("line", REFUSED)
def test_commands_are_refused_and_did_not_run(line: str, tmp_path: Path) -> None:
    pytest.importorskip("meshio")
    path = tmp_path / "plates.geo"
    path.write_text(line.replace("{hit}", str(tmp_path / "hit")) + "\n" + PLATES)
    with pytest.raises(RuptfxError, match=facts(rf"plates.geo, line .*{REFUSED[line]}.*add trust = true to \[mesh\]")):
        build(path)
    assert [item.name for item in tmp_path.iterdir()] == ["plates.geo"]


def test_a_trusted_file_runs_what_it_says(tmp_path: Path) -> None:
    pytest.importorskip("gmsh")
    pytest.importorskip("dolfinx")
    path = tmp_path / "plates.geo"
    path.write_text(f'SystemCall "touch {tmp_path}/hit";\n{PLATES}')
    build(path, trust=True)
    assert (tmp_path / "hit").exists()


def test_words_in_comments_and_strings_are_no_commands(tmp_path: Path) -> None:
    pytest.importorskip("gmsh")
    pytest.importorskip("dolfinx")
    path = tmp_path / "plates.geo"
    path.write_text(f'/* Save "x" */ // Print\nMesh.SaveAll = 0; x = "SystemCall /* "; Printf("1 > 0");\n{PLATES}')
    build(path)


READ = {
    'Include "../other.geo";': r"reads .*other.geo, which is not in",
    'Merge "/etc/hostname";': r"'Merge' reads /etc/hostname, which is not in",
    'Include StrCat("a", ".geo");': r"'Include' is not followed by the name of a file",
    'Merge "run.py";': r"run.py, which is neither a script nor a geometry",
    'Include "inside.geo";': r"inside.geo, line 2: 'SystemCall'",
    'Merge "inside.msh"; Include "inside.msh";': r"inside.msh, line 1: 'Exit'",
    'Include "link.geo";': r"reads .*outside.geo, which is not in",
    "": r"plates.geo.opt, line 1: 'SystemCall'",
    'Merge "beside.msh";': r"beside.msh.opt, line 1: 'SystemCall'",
}  # fmt: skip


@pytest.mark.parametrize("line", READ)
def test_files_that_are_read_are_looked_at(line: str, tmp_path: Path) -> None:
    folder = tmp_path / "case"
    folder.mkdir()
    (tmp_path / "outside.geo").write_text("")
    (folder / "link.geo").symlink_to(tmp_path / "outside.geo")
    (folder / "inside.geo").write_text('Include "plates.geo";\nSystemCall "ls";')
    (folder / "inside.msh").write_text("Exit;")
    (folder / "plates.geo").write_text(line)
    (folder / "beside.msh").write_text("")
    (folder / "beside.msh.opt").write_text('SystemCall "ls";')
    if not line:
        (folder / "plates.geo.opt").write_text('SystemCall "ls";')
    with pytest.raises(RuptfxError, match=READ[line]):
        _geo.check(folder / "plates.geo")


def test_a_script_in_two_files(tmp_path: Path) -> None:
    pytest.importorskip("gmsh")
    pytest.importorskip("dolfinx")
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "plates.geo").write_text(PLATES)
    path = tmp_path / "whole.geo"
    path.write_text('Include "parts/plates.geo";\n')
    build(path)


# -- what Gmsh does of its own accord ----------------------------------------------------------------------------------


def test_options_of_a_script_write_no_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With this algorithm and that much to say Gmsh writes quadqs_statistics.json and sizes where it works."""
    pytest.importorskip("gmsh")
    pytest.importorskip("dolfinx")
    for folder in ("here", "there"):
        (tmp_path / folder).mkdir()
    monkeypatch.chdir(tmp_path / "here")
    path = tmp_path / "there" / "plates.geo"
    path.write_text(f"{PLATES}\nGeneral.Verbosity = 100;\nMesh.Algorithm = 11;\n")
    build(path)
    assert [item.name for item in tmp_path.rglob("*") if item.is_file()] == ["plates.geo"]


def test_a_script_without_end_is_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("gmsh")
    pytest.importorskip("dolfinx")
    path = tmp_path / "plates.geo"
    path.write_text(f"For i In {{1:1000000000}}\nx = i;\nEndFor\n{PLATES}")
    monkeypatch.setattr(_mesh_file, "SECONDS", 1.0)
    with pytest.raises(RuptfxError, match=facts(r"plates.geo: Gmsh took longer than 1 s; .*\.msh")):
        build(path)


def test_what_gmsh_says_of_a_script(tmp_path: Path) -> None:
    pytest.importorskip("gmsh")
    pytest.importorskip("dolfinx")
    path = tmp_path / "plates.geo"
    path.write_text(PLATES.replace("Plane Surface", "Plain Surface"))
    with pytest.raises(RuptfxError, match=facts(r"plates.geo: Gmsh could not mesh it: (?!Traceback)")):
        build(path)


def test_a_last_line_without_an_end_counts(tmp_path: Path) -> None:
    """It names three edges; the size of the elements is in the file of options, the name of one in another script."""
    pytest.importorskip("gmsh")
    pytest.importorskip("dolfinx")
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "first.geo").write_text('Mesh.Algorithm = 6; top = "upper.top";')
    meshes = []
    for end in ("\n", ""):
        path = tmp_path / f"plates{len(end)}.geo"
        named = PLATES.replace('"upper.top"', "Str(top)").strip()
        path.write_text('Include "parts/first.geo";\n' + named + end)
        path.with_name(path.name + ".opt").write_text("Mesh.Algorithm = 6; Mesh.MeshSizeFactor = 0.5;\n")
        meshes.append(GmshFile.model_validate({"file": str(path), "interfaces": SIDES}).build())
    assert {"lower.bottom", "upper.left", "upper.top"} <= set(meshes[1].edges)
    assert [len(mesh.edges["upper.top"]) for mesh in meshes] == [40, 40]


def test_a_merged_script_without_an_end_is_refused(tmp_path: Path) -> None:
    """Gmsh would skip a part of its last line; with the newline, or by Include, the line counts."""
    pytest.importorskip("gmsh")
    pytest.importorskip("meshio")
    part, path = tmp_path / "part.geo", tmp_path / "plates.geo"
    path.write_text('Merge "part.geo";\n')
    part.write_text(PLATES.strip())
    with pytest.raises(RuptfxError, match=facts(r"part\.geo: .* Merge; .* Include")):
        build(path)
    edges = []
    for read, end in (("Merge", "\n"), ("Include", "")):
        path.write_text(f'{read} "part.geo";\n')
        part.write_text(PLATES.strip() + end)
        edges.append(GmshFile.model_validate({"file": str(path), "interfaces": SIDES}).build().edges.keys())
    assert edges[0] == edges[1] == {"upper.left", "upper.top", "lower.bottom"}


def test_sigterm_ends_gmsh_and_removes_its_folder(tmp_path: Path) -> None:
    """The script counts to 1e9; the folder of its mesh is in that of temporary files."""
    pytest.importorskip("gmsh")
    pytest.importorskip("meshio")
    slow = tmp_path / "slow.geo"
    slow.write_text(PLATES.replace("h = 2e-3;", "h = 2e-3;\nFor k In {1:1000000000}\n  x = k;\nEndFor"))
    code = (
        "import sys; from ruptfx.bodies.meshes.gmsh_file import GmshFile\n"
        f"try: GmshFile(file={str(slow)!r}).build()\n"
        "except Exception as error: sys.exit(type(error).__name__ + ' ' + str(error))"
    )
    folder = tmp_path / "temporary"
    folder.mkdir()
    process = subprocess.Popen(
        [sys.executable, "-c", code], env={**os.environ, "TMPDIR": str(folder)}, stderr=subprocess.PIPE, text=True
    )
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    deadline = time.monotonic() + 60
    while not (gmsh := children.read_text().split()) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert len(gmsh) == 1 and len(list(folder.iterdir())) == 1
    time.sleep(0.5)
    process.send_signal(signal.SIGTERM)
    text = process.communicate(timeout=60)[1]
    assert process.returncode == 1 and text.startswith("RuptfxError") and "SIGTERM" in text and "slow.geo" in text
    assert not list(folder.iterdir())
    assert not Path(f"/proc/{gmsh[0]}").exists()
