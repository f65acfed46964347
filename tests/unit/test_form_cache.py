"""The cache of compiled forms after a process was killed while it compiled one."""

from __future__ import annotations

import os
from pathlib import Path

from ruptfx.fem import remove_abandoned


def test_only_abandoned_sources_are_removed(tmp_path: Path) -> None:
    for name in ("whole.c", "whole.c.cached", "killed.c", "compiling.c", "killed.o"):
        (tmp_path / name).touch()
    for name in ("whole.c", "killed.c"):
        os.utime(tmp_path / name, (1.0, 1.0))
    remove_abandoned(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["compiling.c", "killed.o", "whole.c", "whole.c.cached"]
    remove_abandoned(tmp_path / "missing")
