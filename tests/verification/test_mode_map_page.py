"""The map's page in a real browser: it works from the disk without a network, and does what it says it does."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.browser import Tab, browser, visit
from helpers.labels import label_faults
from helpers.messages import says
from PIL import Image

from ruptfx.many_runs.study import mode_map, read_study
from ruptfx.many_runs.study.table import rows, write_csv
from ruptfx.platform.run_files import write_json

IMPACT = Path(__file__).parents[2] / "demos" / "impact.toml"
READY = "document.querySelectorAll('.point').length > 0"

STUDY = f"""
title = "Modes <of> two plates & more"
case = "{IMPACT}"
[[axes]]
key = "faults.main.initial_stress.normal"
name = "Sigma_0"
label = "Compression"
unit = "Pa"
spacing = "log"
values = [1e6, 4e6, 16e6]
[[axes]]
key = "boundaries.0.velocity"
name = "V_imp"
label = "Impact speed"
unit = "m/s"
values = [2.0, 4.0, 6.0, 8.0]
[[axes]]
name = "set"
key = ["faults.main.friction.law.mu_d"]
labels = ["A", "B"]
values = [[0.1], [0.2]]
[[marks]]
label = "I"
point = [4e6, 4.0]
"""


# Names that are markup, paths, formulas or places of the page's own template.
TITLE = """<!-- <script>window.hit = 1</script> /*DATA*/null /*TITLE*/ & $\\x$ [bold]-x[/] ../ünïcode "quoted" 'too'"""
NAMES = {
    "Modes <of> two plates & more": TITLE, "Impact speed": "<img src=x onerror='window.hit = 1'>",
    "A": "</script><b>A", "I": "$\\frac$<i>",
}  # fmt: skip
HOSTILE = STUDY
for plain, name in NAMES.items():
    HOSTILE = HOSTILE.replace(f'"{plain}"', json.dumps(name))


@pytest.fixture(scope="module")
def page(tmp_path_factory) -> Path:
    return made(tmp_path_factory.mktemp("map"), STUDY)


def made(out: Path, text: str) -> Path:
    """A study directory by construction: 24 points, one failed; pictures of a single colour."""
    (out / "study.toml").write_text(text)
    study = read_study(out / "study.toml")
    known = []
    for number, point in enumerate(study.points()):
        sigma, speed = point.values["Sigma_0"], point.values["V_imp"]
        values = {
            "mode": "pulse" if sigma * speed > 20e6 else "crack", "mode_at_half_threshold": "crack",
            "tip_speed_over_c_l": 0.9, "peak_slip_rate": speed, "max_slip": speed * 1e-6, "overflow": float("inf"),
            "kinetic_share": 0.5, "strain_share": 0.25, "frictional_dissipation_share": 0.25,
        }  # fmt: skip
        result = {"status": "done", "values": values}
        if number == 0:
            result = {"status": "failed", "error": "the run crashed </script>"}
        known.append((point, result))
        directory = out / "points" / point.hash
        directory.mkdir(parents=True)
        for name in ("space_time", "wavefield"):
            Image.new("RGB", (40, 20), "red").save(directory / f"{name}.webp")
        (directory / "case.toml").write_text("[output]\nfigures = false\n")
    write_csv(out / "table.csv", rows(study, known, {}))
    write_json(out / "study.json", {"study": study.model_dump(mode="json", exclude_none=True)})
    paths = mode_map.save(out)
    assert [path.name for path in paths] == ["mode_map.png", "mode_map.pdf", "mode_map.html"]
    return out / "mode_map.html"


def test_the_page_is_one_file_without_links(page):
    text = page.read_text()
    assert not re.findall(r"""(?:src|href)\s*=\s*["'](?!data:)""", text)
    assert not [url for url in re.findall(r"https?://[^\"' ]+", text) if "www.w3.org/2000/svg" not in url]
    assert says("<title>Modes &lt;of&gt; two plates &amp; more</title>", text)


def test_what_is_not_resolved_has_a_colour_of_its_own_and_no_speed(page):
    shown = mode_map.read_map(page.parent)
    lost = {"mode": "not resolved", "mode_at_half_threshold": "not resolved", "tip_speed_over_c_l": None}
    marked = replace(shown, rows=[row | (lost if row["V_imp"] == 8.0 else {}) for row in shown.rows])
    colours = [colour for colour, _ in marked.look().values()]
    assert set(marked.look()) == {"crack", "pulse", "not resolved", "failed"} and len(set(colours)) == 4
    assert marked.look()["not resolved"] == mode_map.MODES["not resolved"]
    assert f'"not resolved":"{mode_map.MODES["not resolved"][0]}"' in mode_map.page(marked)
    figure = mode_map.draw(marked)
    assert "not resolved" in [text.get_text() for text in figure.legends[0].get_texts()]
    speeds = next(ax for ax in figure.axes if ax.collections and ax.get_title() == "A" and ax.get_facecolor()[0] < 1)
    # Of the three compressions those at 8 m/s, and the failed point, have no speed.
    assert np.ma.count(np.ma.masked_invalid(speeds.collections[0].get_array())) == 3 * 4 - 3 - 1


def test_no_cell_reaches_below_zero(page):
    """Speeds of 2 to 8 m/s in steps of 2: the first cell ends at 1 m/s. Of 1, 10 and 40 at 0 instead of -3.5."""
    np.testing.assert_allclose(mode_map._edges(np.array([2.0, 4.0, 8.0]), False), [1, 3, 6, 10])
    np.testing.assert_allclose(mode_map._edges(np.array([1.0, 10.0, 40.0]), False), [0, 5.5, 25, 55])
    np.testing.assert_allclose(mode_map._edges(np.array([-1.0, 10.0]), False), [-6.5, 4.5, 15.5])
    np.testing.assert_allclose(mode_map._edges(np.array([0.2]), False), [0, 0.7])


def test_axes_without_a_unit_have_that_of_their_key(tmp_path):
    bare = STUDY.replace('unit = "Pa"\n', "").replace('unit = "m/s"\n', "")
    assert bare != STUDY
    (tmp_path / "study.toml").write_text(bare)
    assert [axis.unit for axis in read_study(tmp_path / "study.toml").axes] == ["Pa", "m/s", "1"]


def test_antiplane_maps_compare_with_the_shear_wave(page):
    shown = mode_map.read_map(page.parent)
    labels = [quantity.label for quantity in shown.quantities]
    assert labels[0] == "Tip speed / c_l"
    rows = [row | {"tip_speed_over_c_l": 0.9, "tip_speed_over_c_s": 0.9} for row in shown.rows]
    assert [quantity.label for quantity in replace(shown, rows=rows).quantities] == ["Tip speed / c_s", *labels[1:]]


def test_modes_of_two_studies_side_by_side(page):
    shown = mode_map.read_map(page.parent)
    figure = mode_map.draw_modes([shown, shown])
    assert [ax.get_title() for ax in figure.axes] == ["A", "B", "A", "B"]
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["crack", "pulse", "failed"]
    assert label_faults(figure) == [] == label_faults(mode_map.draw(shown))


@browser
def test_hover_click_and_toggle(page, tmp_path):
    async def act(tab: Tab) -> None:
        assert await tab.value("document.querySelectorAll('#map .point').length") == 12
        assert await tab.value("document.querySelector('h1').textContent") == "Modes <of> two plates & more"
        fills = "[...document.querySelectorAll('#map .point')].map(n => n.getAttribute('fill'))"
        modes = await tab.value(fills)
        assert len(set(modes)) == 3  # crack, pulse, failed

        # Before the first click: the point of the mark, 4 MPa and 4 m/s, with its pictures and how to run it again.
        heading = "document.querySelector('#detail h2').textContent"
        assert "Compression 4 MPa, Impact speed 4 m/s" in await tab.value(heading)
        assert await tab.value("document.querySelectorAll('#detail img').length") == 2
        point = await tab.value("chosen.row.point")
        again = await tab.value("document.querySelector('.again').textContent")
        assert f"ruptfx run points/{point}/case.toml --out runs/{point} --set output.figures=true" in again
        link = await tab.value("document.querySelector('.again a').href")
        assert link == f"{page.parent.as_uri()}/points/{point}/" and (page.parent / "points" / point).is_dir()

        # A pointer over the last point: 16 MPa, 8 m/s.
        last = "#map .point:nth-of-type(12)"
        await tab.mouse("mouseMoved", *await tab.centre(last))
        assert await tab.value("getComputedStyle(document.getElementById('tip')).display") == "block"
        tip = await tab.value("document.getElementById('tip').textContent")
        for text in ("Compression (MPa)16", "Impact speed (m/s)8", "modepulse", "Tip speed / c_l0.9", "slip (µm)8"):
            assert text in tip

        await tab.click(last)
        assert "Compression 16 MPa" in await tab.value("document.querySelector('#detail h2').textContent")
        images = "[...document.querySelectorAll('#detail img')]"
        sizes = f"Promise.all({images}.map(i => i.decode().then(() => i.naturalWidth)))"
        assert await tab.value(sizes) == [40, 40]
        detail = await tab.value("document.getElementById('detail').textContent")
        assert await tab.value("document.querySelectorAll('#map .ring.chosen').length") == 1
        for text in ("peak slip rate8 m/s", "overflowinf", "friction 25.0 %", "kinetic 50.0 %"):
            assert text in detail

        names = await tab.value("[...document.querySelectorAll('#colours button')].map(b => b.textContent)")
        assert names == ["Mode", "Tip speed / c_l", "Peak slip rate", "Largest slip", "Work dissipated by friction"]
        await tab.click("#colours button:nth-child(3)")
        assert await tab.value("document.querySelector('#colours [aria-pressed=true]').textContent") == "Peak slip rate"
        rates = await tab.value(fills)
        assert len(set(rates)) == 5 and rates != modes  # four speeds, and the failed point
        assert "Peak slip rate (m/s):28" in await tab.value("document.getElementById('legend').textContent")
        await tab.click("#colours button:nth-child(1)")
        assert await tab.value(fills) == modes

        await tab.click("#map .point:nth-of-type(1)")
        assert "the run crashed </script>" in await tab.value("document.getElementById('detail').textContent")
        await tab.click("#facets button:nth-child(2)")
        assert len(set(await tab.value(fills))) == 2  # no failure in the other set
        detail = await tab.value("document.getElementById('detail').textContent")
        assert "Compression 1 MPa" in detail and "B · crack" in detail  # the same place in the other set

    visit(page, tmp_path / "profile", act, READY)


@pytest.mark.slow
@browser
def test_names_are_shown_as_they_are(tmp_path):
    out = tmp_path / "-m[bold]x <b>"
    out.mkdir()

    async def act(tab: Tab) -> None:
        for place in ("document.title", "document.querySelector('h1').textContent"):
            assert await tab.value(place) == TITLE
        assert await tab.value("document.querySelector('#facets button').textContent") == NAMES["A"]
        marks = "[...document.querySelectorAll('#map text')].map(n => n.textContent)"
        assert NAMES["I"] in await tab.value(marks)
        await tab.click("#map .point:nth-of-type(12)")
        assert NAMES["Impact speed"] in await tab.value("document.querySelector('#detail h2').textContent")
        # Nothing of it became an element or ran.
        assert await tab.value("document.querySelectorAll('b, i:not([style]), img:not([alt])').length") == 0
        assert await tab.value("typeof window.hit") == "undefined"

    visit(made(out, HOSTILE), tmp_path / "profile", act, READY)


def test_names_of_marks_leave_other_cells_to_be_seen(tmp_path):
    """On the map of the lecture, 10 by 9 cells twice: a name covers less than a tenth of any cell."""
    study = read_study(Path(__file__).parents[2] / "demos" / "mode_map.toml")
    values = {"mode": "crack", "peak_slip_rate": 1.0, "max_slip": 1e-6}  # colour bars make the panels narrow
    points = [(point, {"status": "done", "values": values}) for point in study.points()]
    figure = mode_map.draw(mode_map.Map(study, rows(study, points, {}), tmp_path))
    figure.draw_without_rendering()
    for ax in figure.axes[:2]:
        assert sorted(text.get_text() for text in ax.texts) == ["I", "II", "III", "IV"]
        corners = ax.transData.transform(ax.collections[0].get_coordinates().reshape(-1, 2)).reshape(10, 11, 2)
        for text in ax.texts:
            box = (text.get_bbox_patch() or text).get_window_extent()
            low, high = np.maximum(corners[:-1, :-1], box.p0), np.minimum(corners[1:, 1:], box.p1)
            covered = np.maximum(high - low, 0).prod(axis=-1) / (corners[1:, 1:] - corners[:-1, :-1]).prod(axis=-1)
            assert 0 < covered.max() < 0.1


def test_names_of_marks_stay_inside_of_a_map_with_linear_axes(tmp_path):
    """Marks in its first and last column, with names longer than a cell."""
    study = read_study(Path(__file__).parents[2] / "demos" / "inclined_plates_map.toml")
    values = {"mode": "crack", "peak_slip_rate": 1.0, "max_slip": 1e-6}
    points = [(point, {"status": "done", "values": values}) for point in study.points()]
    figure = mode_map.draw(mode_map.Map(study, rows(study, points, {}), tmp_path))
    figure.draw_without_rendering()
    names = [(ax, text) for ax in figure.axes for text in ax.texts if text.get_gid() == "mark"]
    assert {text.get_text() for _, text in names} == {"narrow pulse", "pulse", "crack"}
    for ax, text in names:
        box, panel = text.get_window_extent(), ax.get_window_extent()
        assert panel.x0 <= box.x0 and box.x1 <= panel.x1, text.get_text()
