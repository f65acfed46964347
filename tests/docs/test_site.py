"""The built site in a real browser, from the disk and without a network: every page, every link and picture, search."""

from __future__ import annotations

import fcntl
import html
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from helpers.browser import Tab, browser, visit
from helpers.page_blocks import ROOT

from ruptfx.results.plots import FIGURES

pytest.importorskip("sphinx")
pytestmark = pytest.mark.docs

INSIDE = """[...document.querySelectorAll('a[href]')].map(a => a.href)
    .filter(h => h.startsWith('SITE/') && /\\.html(#|$)/.test(h))"""
WRONG = """[...document.images].filter(i => i.loading !== 'lazy' && i.complete && !i.naturalWidth).map(i => i.src)"""


@pytest.fixture(scope="session")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built once; where several processes run the tests, the others wait for the first one."""
    folder = tmp_path_factory.getbasetemp()
    folder = folder.parent if "PYTEST_XDIST_WORKER" in os.environ else folder
    out, built = folder / "site", folder / "site_is_built"
    with (folder / "site.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not built.exists():
            build = [sys.executable, "-m", "sphinx", "-q", "-b", "html", str(ROOT / "docs"), str(out)]
            subprocess.run(build, check=True, timeout=600, env=os.environ | {"PYTHONPATH": str(ROOT)})
            built.touch()
    return out


@browser
def test_every_page_opens_and_every_link_leads_to_its_place(site: Path, tmp_path: Path) -> None:
    """From the first page along all links; a link to a section leads to an element of that name."""
    links = INSIDE.replace("SITE", site.as_uri())

    async def act(tab: Tab) -> None:
        todo, places, names = [f"{site.as_uri()}/index.html"], {}, {}
        while todo:
            address = todo.pop()
            await tab.open(address)
            assert await tab.value("document.querySelectorAll('h1').length") == 1, address
            assert await tab.value(WRONG) == [], address
            names[address] = set(await tab.value("[...document.querySelectorAll('[id]')].map(n => n.id)"))
            for link in await tab.value(links):
                page, _, place = link.partition("#")
                places.setdefault((page, place), address)
                if page not in names and page not in todo:
                    todo.append(page)
        missing = [(link, where) for link, where in places.items() if link[1] and link[1] not in names[link[0]]]
        assert not missing
        pages = {path.relative_to(ROOT / "docs").with_suffix(".html") for path in (ROOT / "docs").rglob("*.md")}
        seen = {Path(address.removeprefix(f"{site.as_uri()}/")) for address in names}
        assert pages <= seen  # nothing is left that no link leads to

    visit(site / "index.html", tmp_path / "profile", act)


def test_every_figure_is_in_the_python_reference(site: Path) -> None:
    page = (site / "reference" / "python.html").read_text(encoding="utf-8")
    assert [name for name in FIGURES if f'id="ruptfx.results.plots.{name}"' not in page] == []


def test_formulas_are_set_and_no_latex_is_left(site: Path) -> None:
    """Formulas are MathML; outside of code no page shows what LaTeX begins with."""
    code = re.compile(r"<(pre|code|script|annotation)\b.*?</\1>", re.DOTALL)
    latex = re.compile(r"\$\$|\\(?:int|frac|sigma|Gamma|mathrm|dot|le|ge)\b")
    pages = {path.name: code.sub("", path.read_text(encoding="utf-8")) for path in site.rglob("*.html")}
    left = {name: found for name, text in pages.items() if (found := latex.findall(text))}
    assert left == {}
    set_ = {path.stem: path.read_text().count("<math") for path in (site / "explanation").glob("*.html")}
    assert set_["weak_form"] > 10 and set_["cracks"] > 5 and set_["sliding"] > 2 and set_["notation"] > 20


def test_the_font_of_the_site_has_every_character_of_its_formulas(site: Path) -> None:
    """Single letters are set in italics; the table MATH has the places of subscripts and roots."""
    from fontTools.ttLib import TTFont

    css = (site / "_static" / "site.css").read_text(encoding="utf-8")
    (name,) = re.findall(r'@font-face \{ font-family: "ruptfx Math"; src: url\("([^"]+)"\)', css)
    assert re.search(r'math \{ font-family: [^}]*"ruptfx Math"', css)
    with TTFont(site / "_static" / name) as font:
        assert "MATH" in font
        known = set(font.getBestCmap())
    formulas = [html.unescape(text) for path in site.rglob("*.html")
                for text in re.findall(r"<math.*?</math>", path.read_text(encoding="utf-8"), re.DOTALL)]  # fmt: skip
    letters = set("".join(re.sub(r"<[^>]*>", "", text) for text in formulas))
    single = {letter for text in formulas for letter in re.findall(r"<mi>(.)</mi>", text)}
    italic = {0x1D434 + ord(each) - ord("A") if each.isupper() else 0x1D44E + ord(each) - ord("a")
              for each in single if each.isascii() and each not in "h"}  # fmt: skip
    assert len(formulas) > 100 and len(italic) > 20
    assert {each for each in letters if ord(each) not in known and not each.isspace()} == set()
    assert italic <= known


@browser
def test_the_bar_is_one_line_and_nothing_is_cut(site: Path, tmp_path: Path) -> None:
    """At 1280 px the navigation bar is as high as one line; at 400 px no page is wider than the screen."""

    async def act(tab: Tab) -> None:
        for width, pages in ((1280, ("index", "reference/case")), (400, ("index", "explanation/weak_form"))):
            await tab.call(
                "Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=False
            )
            for page in pages:
                await tab.open(f"{site.as_uri()}/{page}.html")
                height = await tab.value("document.querySelector('.bd-header').offsetHeight")
                assert 40 < height < 90, (width, page)
                assert await tab.value("document.documentElement.scrollWidth") <= width, (width, page)

    visit(site / "index.html", tmp_path / "profile", act)


@browser
def test_no_printed_output_is_cut(site: Path, tmp_path: Path) -> None:
    """At 1280 px every page shows what commands print as a whole; files of users, which have a caption, may scroll."""
    cut = """[...document.querySelectorAll('div.highlight-console pre, div.highlight-text pre')]
        .filter(n => !n.closest('.literal-block-wrapper') && n.scrollWidth > n.clientWidth + 1)
        .map(n => n.textContent.split('\\n').sort((a, b) => b.length - a.length)[0])"""
    shown = re.compile(r"highlight-(console|text)")
    pages = [path for path in sorted(site.rglob("*.html")) if shown.search(path.read_text(encoding="utf-8"))]
    assert len(pages) > 10

    async def act(tab: Tab) -> None:
        await tab.call("Emulation.setDeviceMetricsOverride", width=1280, height=900, deviceScaleFactor=1, mobile=False)
        for page in pages:
            await tab.open(page.as_uri())
            assert await tab.value(cut) == [], page.name

    visit(site / "index.html", tmp_path / "profile", act)


@browser
@pytest.mark.parametrize("width, part", [(400, 0.9), (500, 0.9), (800, 0.5), (1280, 0.2)])
def test_tables_of_sources_are_as_wide_as_the_page(width: int, part: float, site: Path, tmp_path: Path) -> None:
    """No cell is beyond the article; pictures take at least this part of its width, on a phone nearly all of it."""
    article = "n.closest('.pst-scrollable-table-container').getBoundingClientRect()"
    beyond = f"""[...document.querySelectorAll('table.sources td, table.sources td *')]
        .filter(n => n.getBoundingClientRect().right > {article}.right + 1).map(n => n.textContent.slice(0, 60))"""
    narrow = f"""[...document.querySelectorAll('table.sources img')]
        .filter(n => n.getBoundingClientRect().width < {part} * {article}.width).length"""

    async def act(tab: Tab) -> None:
        await tab.call("Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=False)
        await tab.open(f"{site.as_uri()}/gallery/sources.html")
        assert await tab.value("document.querySelectorAll('table.sources tr').length") > 50
        assert await tab.value(beyond) == []
        assert await tab.value(narrow) == 0

    visit(site / "index.html", tmp_path / "profile", act)


@browser
def test_names_of_a_page_and_times_of_demos_are_not_cut(site: Path, tmp_path: Path) -> None:
    beyond = """[...document.querySelectorAll('SELECTOR')].filter(n => {
        const range = document.createRange();
        range.selectNodeContents(n);
        return range.getBoundingClientRect().right > n.closest('WITHIN').getBoundingClientRect().right + 1;
    }).map(n => n.textContent)"""

    async def act(tab: Tab) -> None:
        for width, page, selector, within in (
            (1280, "reference/friction", ".page-toc a", ".bd-sidebar-secondary"),
            (400, "gallery/demos", ".demos td", "article"),
        ):
            await tab.call(
                "Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=False
            )
            await tab.open(f"{site.as_uri()}/{page}.html")
            assert await tab.value(f"document.querySelectorAll('{selector}').length") > 20
            assert await tab.value(beyond.replace("SELECTOR", selector).replace("WITHIN", within)) == [], page

    visit(site / "index.html", tmp_path / "profile", act)


@browser
def test_clicks_and_search(site: Path, tmp_path: Path) -> None:
    async def act(tab: Tab) -> None:
        # A card of the first page, then a page of its sidebar.
        await tab.value("[...document.querySelectorAll('.sd-card a')].find(a => a.href.includes('howto')).click()")
        await tab.until("location.href.includes('howto/index.html') && document.readyState === 'complete'")
        sidebar = ".bd-sidebar-primary a[href='damping.html']"
        await tab.until(f'document.querySelector("{sidebar}") !== null')
        await tab.click(sidebar)
        await tab.until("location.href.endsWith('howto/damping.html') && document.readyState === 'complete'")
        assert "Damp the noise" in await tab.value("document.querySelector('h1').textContent")
        # What a reader types into the search field.
        results = "[...document.querySelectorAll('#search-results li a')]"
        # Sphinx appends the results one by one.
        await tab.open(
            f"{site.as_uri()}/search.html?q=bulk_precision",
            f"{results}.some(a => a.href.includes('paraview.html'))",
        )
        await tab.value(f"{results}[0].click()")
        await tab.until("!location.href.includes('search.html') && document.readyState === 'complete'")
        assert "bulk_precision" in await tab.value("document.body.textContent")

    visit(site / "index.html", tmp_path / "profile", act)
