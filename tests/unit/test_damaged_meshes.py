"""Mesh files that are cut short or changed: one message with the name of the file, or a mesh."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from helpers.small_cases import merged, plates
from typer.testing import CliRunner

pytest.importorskip("dolfinx")
pytest.importorskip("meshio")

import meshio

from ruptfx import RuptfxError
from ruptfx.app.cli import app
from ruptfx.bodies.meshes.gmsh_file import GmshFile

SIDES = {"main": {"plus": "upper", "minus": "lower"}}


def write(path: Path, binary: bool = False) -> None:
    """Two rows of four squares, the upper and the lower body, named as Gmsh does."""
    x, y = np.meshgrid(np.linspace(0.0, 12e-3, 5), np.linspace(-4e-3, 4e-3, 3))
    corners = np.array([[row * 5 + k, row * 5 + k + 1, row * 5 + k + 6, row * 5 + k + 5] for row in (0, 1)
                        for k in range(4)])  # fmt: skip
    fault = np.array([[5 + k, 6 + k] for k in range(4)])
    bodies, line = np.repeat([1, 2], 4), np.full(4, 3)
    mesh = meshio.Mesh(
        np.column_stack([x.ravel(), y.ravel(), np.zeros(15)]), [("quad", corners), ("line", fault)],
        cell_data={"gmsh:physical": [bodies, line], "gmsh:geometrical": [bodies, line]},
        field_data={"lower": np.array([1, 2]), "upper": np.array([2, 2]), "main": np.array([3, 1])},
    )  # fmt: skip
    meshio.write(path, mesh, file_format="gmsh22", binary=binary)


@pytest.mark.parametrize("binary", [False, True])
def test_a_damaged_file_is_named(binary: bool, tmp_path: Path) -> None:
    """Cut at 40 places, and 60 times with three bytes changed."""
    write(tmp_path / "whole.msh", binary)
    whole, chance, path = (tmp_path / "whole.msh").read_bytes(), random.Random(0), tmp_path / "damaged.msh"
    GmshFile.model_validate({"file": str(tmp_path / "whole.msh"), "interfaces": SIDES}).build()
    tried = [whole[: len(whole) * cut // 40] for cut in range(40)]
    for _ in range(60):
        changed = bytearray(whole)
        for _ in range(3):
            changed[chance.randrange(len(whole))] = chance.randrange(256)
        tried.append(bytes(changed))
    refused = 0
    for content in tried:
        path.write_bytes(content)
        try:
            GmshFile.model_validate({"file": str(path), "interfaces": SIDES}).build()
        except RuptfxError as error:
            refused += 1
            assert str(error).startswith(f"{path}: "), error
            assert "\n" not in str(error), error
    assert refused > 50


@pytest.mark.fem
@pytest.mark.parametrize("command", ["mesh", "check", "run"])
def test_commands_name_it(command: str, tmp_path: Path) -> None:
    write(tmp_path / "whole.msh")
    text = (tmp_path / "whole.msh").read_text()
    (tmp_path / "cut.msh").write_text(text[: text.index("$EndNodes") - 40])  # in the middle of the points
    table = merged(plates(), {"mesh": {"kind": "gmsh_file", "file": "cut.msh", "interfaces": SIDES}})
    (tmp_path / "case.toml").write_text(tomli_w.dumps(table))
    done = CliRunner(env={"COLUMNS": "500"}).invoke(app, [
        command, str(tmp_path / "case.toml"), *(["--out", str(tmp_path / "out")] if command != "check" else []),
    ])  # fmt: skip
    assert done.exit_code == 1 and (done.exception is None or isinstance(done.exception, SystemExit))
    assert f"{tmp_path / 'cut.msh'}: " in done.output and "write it again" in done.output
    assert all(line.strip() for line in done.output.splitlines())  # meshio prints an empty one
