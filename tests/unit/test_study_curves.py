"""Curves of a study over one axis."""

from __future__ import annotations

import json
from itertools import product
from pathlib import Path
from typing import Any

import pytest
from helpers.messages import facts
from matplotlib.container import ErrorbarContainer

from ruptfx import RuptfxError
from ruptfx.many_runs.study import curves
from ruptfx.many_runs.study.definition import Study
from ruptfx.many_runs.study.execute import draw
from ruptfx.many_runs.study.mode_map import read_map
from ruptfx.many_runs.study.table import read_csv, write_csv

AXIS: dict[str, Any] = {"key": "boundaries.0.velocity", "name": "speed", "label": "Speed", "unit": "m/s"}


def study(path: Path, axes: list[dict[str, Any]], **columns: list[Any]) -> Path:
    """A finished study with these columns."""
    path.mkdir()
    (path / "case.toml").write_text("duration = 1.0\n")
    given = {"case": str(path / "case.toml"), "axes": axes, "quantities": list(columns)}
    named = Study.model_validate(given, context={"directory": path}).model_dump(mode="json")
    (path / "study.json").write_text(json.dumps({"study": named}))
    columns_of = [axis["name"] for axis in axes]
    values = [dict(zip(columns_of, each, strict=True)) for each in product(*(axis["values"] for axis in axes))]
    rows = [{**row, "origin": "sample", "status": "done", **dict(zip(columns, each, strict=True)), "point": str(i)}
            for i, (row, each) in enumerate(zip(values, zip(*columns.values(), strict=True), strict=True))]  # fmt: skip
    write_csv(path / "table.csv", rows)
    return path


def test_a_panel_for_every_quantity_and_one_for_all_shares(tmp_path: Path) -> None:
    path = study(
        tmp_path / "study", [AXIS | {"values": [4.0, 1.0]}], largest_stress=[2e6, 1e6], b_value=[1.5, None],
        b_value_error=[0.25, None], tensile_share=[0.25, 0.75], shear_share=[0.75, 0.25], nothing=[None, None],
    )  # fmt: skip
    shown = read_map(path)
    assert curves.suits(shown)
    figure = curves.draw(shown)
    panels = [ax for ax in figure.axes if ax.axison]
    assert [ax.get_ylabel() for ax in panels] == ["Largest stress (MPa)", "b value", "Part of events"]
    assert panels[0].get_xlabel() == "" or "Speed" in panels[0].get_xlabel()
    (stress,) = [bar for bar in panels[0].containers if isinstance(bar, ErrorbarContainer)]
    assert stress[0].get_xdata().tolist() == [1.0, 4.0] and stress[0].get_ydata().tolist() == [1.0, 2.0]
    (b,) = [bar for bar in panels[1].containers if isinstance(bar, ErrorbarContainer)]
    (segments,) = b[2]
    heights = [ends[1, 1] - ends[0, 1] for ends in segments.get_segments() if len(ends)]
    assert max(heights) == pytest.approx(0.5)
    assert {text.get_text() for text in panels[2].get_legend().get_texts()} == {"tensile", "shear"}
    assert {path.name for path in curves.save(shown)} == {"curves.png", "curves.pdf"}


def test_errors_are_in_the_unit_of_their_quantity(tmp_path: Path) -> None:
    """Of 2 and 1 MPa: 0.1 MPa on both sides of the first, nothing at the second."""
    stresses: dict[str, Any] = {"largest_stress": [2e6, 1e6], "largest_stress_error": [1e5, None]}
    path = study(tmp_path / "study", [AXIS | {"values": [1.0, 4.0]}], **stresses)
    (panel,) = [ax for ax in curves.draw(read_map(path)).axes if ax.axison]
    assert panel.get_ylabel() == "Largest stress (MPa)"
    (stress,) = [bar for bar in panel.containers if isinstance(bar, ErrorbarContainer)]
    assert stress[0].get_ydata().tolist() == [2.0, 1.0]
    (segments,) = stress[2]
    assert [ends[:, 1].tolist() for ends in segments.get_segments()] == [[1.9, 2.1], [1.0, 1.0]]


def test_two_axes_are_a_map(tmp_path: Path) -> None:
    other = {"key": "boundaries.1.velocity", "name": "other", "values": [1.0]}
    path = study(tmp_path / "study", [AXIS | {"values": [1.0]}, other], largest_stress=[1e6])
    assert not curves.suits(read_map(path))


def test_axes_of_names_have_no_map(tmp_path: Path) -> None:
    laws = {"key": "faults.main.friction.kind", "name": "law", "values": ["coulomb", "slip_weakening"]}
    path = study(tmp_path / "study", [laws], largest_stress=[1e6, 2e6])
    with pytest.raises(RuptfxError, match=facts(r"study: .*\(law\).*table\.csv")):
        draw(path)


@pytest.mark.slow
def test_draws_are_points_around_their_median(tmp_path: Path) -> None:
    draws = {"key": "mesh.phases.seed", "name": "draw", "values": [1, 2, 3]}
    path = study(
        tmp_path / "study", [draws, AXIS | {"values": [1.0, 4.0]}], largest_stress=[1e6, 5e6, 4e6, 6e6, 2e6, 9e6],
        b_value=[1.0, None, 3.0, None, None, None], b_value_error=[0.1, None, 0.2, None, None, None],
    )  # fmt: skip
    shown = read_map(path)
    assert curves.suits(shown)
    stress, b = [ax for ax in curves.draw(shown).axes if ax.axison]
    (line,) = [line for line in stress.lines if line.get_label() == "largest stress"]
    assert line.get_xdata().tolist() == [1.0, 4.0] and line.get_ydata().tolist() == [2.0, 6.0]
    (points,) = [bar for bar in stress.containers if isinstance(bar, ErrorbarContainer)]
    assert sorted(points[0].get_ydata().tolist()) == [1.0, 2.0, 4.0, 5.0, 6.0, 9.0]
    (line,) = [line for line in b.lines if line.get_label() == "b value"]
    assert line.get_ydata().tolist() == pytest.approx([2.0, float("nan")], nan_ok=True)
    assert [path.name for path in curves.save(shown)] == ["curves.png", "curves.pdf", "medians.csv"]
    low, high = read_csv(path / "medians.csv")
    assert [low[f"largest_stress{end}"] for end in ("", "_smallest", "_largest")] == [2e6, 1e6, 4e6]
    assert (low["speed"], low["draws"], low["b_value_draws"], low["b_value"]) == (1.0, 3, 2, 2.0)
    assert (high["b_value_draws"], high["b_value"]) == (0, None)
    assert len(draw(path)) == 6, "plot draws the map and the curves"


def test_the_legend_of_shares_hides_no_sample(tmp_path: Path) -> None:
    """As of granite, where curves cross and fill the panel."""
    path = study(
        tmp_path / "study", [AXIS | {"values": [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]}],
        tensile_share=[0.57, 0.37, 0.28, 0.16, 0.12, 0.09], shear_share=[0.17, 0.38, 0.48, 0.58, 0.66, 0.71],
        mixed_share=[0.21, 0.23, 0.26, 0.26, 0.23, 0.2], aseismic_share=[0.0] * 6,
    )  # fmt: skip
    figure = curves.draw(read_map(path))
    figure.savefig(tmp_path / "curves.png")
    (ax,) = [ax for ax in figure.axes if ax.axison]
    samples = [ax.transData.transform(line.get_xydata()) for line in ax.lines if len(line.get_xydata()) == 6]
    assert len(samples) == 4
    assert ax.get_legend().get_window_extent().y0 > max(points[:, 1].max() for points in samples)
    assert ax.get_legend().get_window_extent().y1 < ax.get_window_extent().y1
