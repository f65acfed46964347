"""Pictures of the site against the numbers of the runs that they show."""

from __future__ import annotations

import importlib.util
import json
import re
import sys
from pathlib import Path

import pytest
from PIL import Image

ROOT = Path(__file__).parents[2]
PICTURES = ROOT / "docs" / "pictures"
NUMBERS = json.loads((PICTURES / "numbers.json").read_text(encoding="utf-8"))


def test_the_caption_of_granite_has_the_numbers_of_its_run() -> None:
    """To as many digits as the caption gives."""
    page = (ROOT / "docs" / "gallery" / "granite.md").read_text(encoding="utf-8")
    caption = page.partition("../pictures/granite.png)")[2].partition("\n\n")[2].partition("\n\n")[0].replace("\n", " ")
    run = NUMBERS["granite"]
    for pattern, expected in {
        r"([\d.]+) MPa": f"{1e-6 * run['first_peak_stress']:.1f}",
        r"(\d+) events before": str(run["events_before_peak"]),
        r"([\d.]+) % of them tensile": f"{100 * run['tensile_share']:.0f}",
        r"D = (\d+\.\d+)": f"{run['fractal_dimension']:.2f}",
        r"b = (\d+\.\d+)": f"{run['b_value']:.2f}",
        r"b = [\d.]+ ± (\d+\.\d+)": f"{run['b_value_error']:.2f}",
        r"(\d+) facets failed": str(run["events"]),
    }.items():
        found = re.search(pattern, caption)
        assert found and found[1] == expected, (pattern, expected)


@pytest.mark.parametrize("name", sorted(NUMBERS))
def test_a_picture_has_all_its_colours(name: str) -> None:
    """A palette would have 256 at most; runs behind pictures that are renewed have their numbers saved."""
    path = next(folder / f"{name}.png" for folder in (PICTURES, ROOT / "demos" / "pictures")
                if (folder / f"{name}.png").is_file())  # fmt: skip
    with Image.open(path) as picture:
        assert picture.mode == "RGB" and picture.getcolors(256) is None
    assert path.stat().st_size < 1_000_000


def test_every_picture_is_renewed_by_one_command(monkeypatch: pytest.MonkeyPatch) -> None:
    source = importlib.util.spec_from_file_location("make_pictures", ROOT / "docs" / "make_pictures.py")
    assert source is not None and source.loader is not None
    pytest.importorskip("dolfinx")
    module = importlib.util.module_from_spec(source)
    monkeypatch.setitem(sys.modules, "make_pictures", module)  # dataclasses look their module up
    source.loader.exec_module(module)
    assert {*module.FIGURES, *module.ELSEWHERE} == NUMBERS.keys()
    left = [name for command in module.COMMANDS for name in command.pictures]
    drawn = {*module.DRAWINGS, *module.LUMPED, *NUMBERS, *left, "impact_energy_budget", "impact_space_time"}
    kept = {path.stem for folder in (PICTURES, ROOT / "demos" / "pictures") for path in folder.glob("*.png")}
    assert kept - drawn == {"mode_map_page"}  # a browser's picture of a page
    assert len(left) == len(set(left)) and set(left) <= kept
