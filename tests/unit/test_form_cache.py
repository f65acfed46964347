"""The cache of compiled forms after a process was killed while it compiled one."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest

import ruptfx
from ruptfx import RuptfxError
from ruptfx.platform import fem
from ruptfx.platform.fem import remove_abandoned

PACKAGE = Path(ruptfx.__file__).parent


def test_only_abandoned_sources_are_removed(tmp_path: Path) -> None:
    for name in ("whole.c", "whole.c.cached", "killed.c", "compiling.c", "killed.o"):
        (tmp_path / name).touch()
    for name in ("whole.c", "killed.c"):
        os.utime(tmp_path / name, (1.0, 1.0))
    remove_abandoned(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["compiling.c", "killed.o", "whole.c", "whole.c.cached"]
    remove_abandoned(tmp_path / "missing")


def test_every_form_is_compiled_by_one_function() -> None:
    """Else DOLFINx keeps it in its own folder, which nobody clears and which processors share."""
    modules = [path for path in PACKAGE.rglob("*.py") if path != PACKAGE / "platform" / "fem.py"]
    assert len(modules) > 100
    assert not [path for path in modules if re.search(r"dolfinx\.fem\.(form|Expression)\(", path.read_text())]


def test_a_form_that_nobody_finishes_names_the_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("dolfinx")
    mesh = fem.dolfinx.mesh.create_unit_square(fem.MPI.COMM_SELF, 1, 1)
    one = fem.dolfinx.fem.Constant(mesh, 1.0) * fem.ufl.dx(domain=mesh)
    monkeypatch.setattr(fem, "JIT_OPTIONS", fem.JIT_OPTIONS | {"cache_dir": str(tmp_path / "forms"), "timeout": 1})
    assert fem.dolfinx.fem.assemble_scalar(fem.form(one)) == pytest.approx(1.0)
    (mark,) = (tmp_path / "forms").glob("*.cached")
    mark.unlink()  # as if the process that compiles it had been killed
    with pytest.raises(RuptfxError, match="forms") as refused:
        fem.form(one)
    assert str(tmp_path / "forms") in str(refused.value)
