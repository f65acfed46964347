"""Pictures of the site against the numbers of the runs that they show."""

from __future__ import annotations

import importlib.util
import json
import re
import sys
from itertools import pairwise
from pathlib import Path
from types import ModuleType

import pytest
from PIL import Image

from ruptfx import read_case
from ruptfx.app.bench import benchmarks
from ruptfx.results import plots

ROOT = Path(__file__).parents[2]
PICTURES = ROOT / "docs" / "pictures"
NUMBERS = json.loads((PICTURES / "numbers.json").read_text(encoding="utf-8"))
OF_SCRIPTS = {name for name in NUMBERS if ".py" in name}  # with arguments


def test_the_caption_of_granite_has_the_numbers_of_its_run() -> None:
    """To as many digits as the caption gives."""
    page = (ROOT / "docs" / "verification" / "granite.md").read_text(encoding="utf-8")
    caption = page.partition("../pictures/granite.png)")[2].partition("\n\n")[2].partition("\n\n")[0].replace("\n", " ")
    run = NUMBERS["granite"]
    for pattern, expected in {
        r"([\d.]+) MPa": f"{1e-6 * run['first_peak_stress']:.1f}",
        r"(\d+) events before": str(run["events_before_peak"]),
        r"([\d.]+) % of them are tensile": f"{100 * run['tensile_share']:.0f}",
        r"D = (\d+\.\d+)": f"{run['fractal_dimension']:.2f}",
        r"b = (\d+\.\d+)": f"{run['b_value']:.2f}",
        r"b = [\d.]+ ± (\d+\.\d+)": f"{run['b_value_error']:.2f}",
        r"(\d+) facets fail": str(run["events"]),
    }.items():
        found = re.search(pattern, caption)
        assert found and found[1] == expected, (pattern, expected)


@pytest.mark.parametrize("name", sorted(NUMBERS.keys() - OF_SCRIPTS))
def test_a_picture_has_all_its_colours(name: str) -> None:
    """A palette would have 256 at most; runs behind pictures that are renewed have their numbers saved."""
    path = next(folder / f"{name}.png" for folder in (PICTURES, ROOT / "demos" / "pictures")
                if (folder / f"{name}.png").is_file())  # fmt: skip
    with Image.open(path) as picture:
        assert picture.mode == "RGB" and picture.getcolors(256) is None
    assert path.stat().st_size < 1_000_000


@pytest.fixture
def make_pictures(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    pytest.importorskip("dolfinx")
    source = importlib.util.spec_from_file_location("make_pictures", ROOT / "docs" / "make_pictures.py")
    assert source is not None and source.loader is not None
    module = importlib.util.module_from_spec(source)
    monkeypatch.setitem(sys.modules, "make_pictures", module)  # dataclasses look their module up
    source.loader.exec_module(module)
    return module


def test_every_picture_is_renewed_by_one_command(make_pictures: ModuleType) -> None:
    drawn = {*make_pictures.FIGURES, *make_pictures.ELSEWHERE}
    assert drawn == NUMBERS.keys() - OF_SCRIPTS
    commands = {each.command for each in make_pictures.COMMANDS}
    assert commands >= OF_SCRIPTS
    left = [(each.folder, name) for each in make_pictures.COMMANDS for name in each.pictures]
    assert len(left) == len(set(left))
    beside = ROOT / "demos" / "pictures"
    here = {*make_pictures.DRAWINGS, *make_pictures.LUMPED, *make_pictures.FIGURES, "impact_energy_budget",
            "impact_space_time"}  # fmt: skip
    drawn = {PICTURES / f"{name}.png" for name in here}
    drawn |= {folder / make_pictures.file_of(name) for folder, name in left}
    drawn |= {folder / f"{name}.png" for name, (_, folder) in make_pictures.ELSEWHERE.items()}
    kept = {path for folder in (PICTURES, beside) for path in folder.glob("*.*") if path.suffix in (".png", ".webp")}
    assert kept - drawn == {beside / "mode_map_page.png"}  # a browser's picture of a page
    assert drawn <= kept


def test_commands_of_pictures_name_what_exists(make_pictures: ModuleType) -> None:
    """Scripts, cases with their overrides, benchmarks and figures; a wrong name would end a run of hours."""
    known = benchmarks()
    for line in (line for each in make_pictures.COMMANDS for line in (*each.before, each.command)):
        first, *words = line.split()
        if first.endswith(".py"):
            assert (ROOT / "demos" / first).is_file(), line
        elif first == "bench":
            assert words[0] in known, line
        elif first == "run":
            changes = [after for word, after in pairwise(words) if word == "--set"]
            read_case(ROOT / words[0], overrides=changes)
        elif first in ("study", "mesh"):
            assert (ROOT / words[0]).is_file(), line
        else:
            assert first in ("compare", "events", "movie"), line
    figures = {*make_pictures.FIGURES.values(), *(figure for figure, _ in make_pictures.ELSEWHERE.values())}
    assert figures <= plots.FIGURES.keys()
