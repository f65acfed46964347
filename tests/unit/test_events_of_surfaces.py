"""`ruptfx events` of a run on a surface: table, file, figure."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("dolfinx")

from helpers.strike_cases import faulted
from typer.testing import CliRunner

from ruptfx.app.cli import app
from ruptfx.run.simulation import simulate

pytestmark = pytest.mark.fem


@pytest.mark.slow
def test_command_writes_table_and_figure(tmp_path: Path) -> None:
    simulate(faulted({"duration": 100.0}), tmp_path / "run", progress=False).close()
    result = CliRunner().invoke(app, ["events", str(tmp_path / "run"), "--csv"])
    assert result.exit_code == 0, result.output
    rows = (tmp_path / "run" / "events.csv").read_text().splitlines()
    assert rows[0].startswith("fault,time (s),duration (s),moment (N m),magnitude") and len(rows) == 1  # it only creeps
    assert (tmp_path / "run" / "figures" / "catalogue.png").stat().st_size > 10_000
    wrong = CliRunner().invoke(app, ["events", str(tmp_path / "run"), "--completeness", "2"])
    assert wrong.exit_code != 0
