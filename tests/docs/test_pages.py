"""The site: every code block of README and docs/ runs, every link inside leads somewhere."""

import re
from pathlib import Path

import pytest
from helpers.page_blocks import ROOT, blocks, matches, run_page

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
NAMES = [str(page.relative_to(ROOT)) for page in PAGES]
pytestmark = pytest.mark.docs


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_blocks_run(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    run_page(page, tmp_path)


def test_pages_do_not_stand_in_each_others_way() -> None:
    """Whoever follows them one after another in one directory meets no run or file of an earlier one there."""
    made: dict[str, Path] = {}
    for page in PAGES:
        for name in makes(page):
            assert made.setdefault(name, page) == page, f"{page} makes {name}, as {made[name]} does"


def test_every_demo_stands_in_the_gallery() -> None:
    """A script and the case of its name share a line; what only serves other demos and tests needs none."""
    told = (ROOT / "docs" / "gallery" / "demos.md").read_text()
    demos = {path.stem for path in (ROOT / "demos").iterdir() if path.suffix in (".toml", ".py")}
    assert {demo for demo in demos if f"`{demo}." not in told} <= {"lecture_cases"}


def makes(page: Path) -> set[str]:
    """Runs, studies and cases that its blocks begin; what is overwritten on purpose does not count."""
    found = set()
    for block in filter(lambda block: block.wanted and not block.caption, blocks(page)):
        found |= set(re.findall(r"""simulate\([^\n]*out="([^"]+)"(?!, overwrite=True)""", block.text))
        for line in block.text.replace("\\\n", " ").splitlines():
            command = re.match(r"(?:\$ )?ruptfx (run|study|new) (\S+)(?!.*\|\| true)", line)
            if command:
                given = re.search(r"--out (\S+)", line)
                folder = {"run": "runs/", "study": "studies/", "new": ""}[command[1]]
                found.add(given[1] if given else folder + Path(command[2]).stem)
    return found


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_links_lead_somewhere(page: Path) -> None:
    """Relative links; those in the site are checked by Sphinx, too, but not those out of docs/."""
    for target in re.findall(r"\]\(([^)#\s]+)[^)]*\)|<img src=\"([^\"]+)\"", page.read_text()):
        link = target[0] or target[1]
        if not re.match(r"[a-z]+:", link):
            assert (page.parent / link).exists() or (page.parent / f"{link}.md").exists(), f"{page}: {link}"


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_no_text_is_a_comment(page: Path) -> None:
    """MyST drops a line that begins with a percent sign, such as one that was wrapped within "60 %"."""
    text = re.sub(r"^ *(```+).*?^ *\1$", "", page.read_text(), flags=re.MULTILINE | re.DOTALL)
    assert re.findall(r"^\s*%.*", text, re.MULTILINE) == []


def test_blocks_are_read_as_said(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(
        "```sh\ntrue\n```\n\n<!-- not run: it would never end -->\n```sh\nsleep inf\n```\n\n"
        ":::{note}\n```{code-block} toml\n:caption: a.toml\nx = 1\n```\n:::\n"
    )
    found = [(block.line, block.language, block.caption, block.text, block.wanted) for block in blocks(page)]
    assert found == [
        (1, "sh", "", "true\n", True), (6, "sh", "", "sleep inf\n", False), (11, "toml", "a.toml", "x = 1\n", True)
    ]  # fmt: skip


def test_a_block_that_fails_is_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for number, text in enumerate(("```sh\nfalse\n```\n", "```python\n1 / 0\n```\n", "```console\n$ echo a\nb\n```\n")):
        page = tmp_path / f"page{number}.md"
        page.write_text(text)
        (tmp_path / str(number)).mkdir()
        with pytest.raises((AssertionError, ZeroDivisionError)):
            run_page(page, tmp_path / str(number))


def test_console_blocks_are_commands_and_what_they_print(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("```console\n$ echo a; \\\n  echo b\na\nb\n$ echo c\n```\n")
    (tmp_path / "right").mkdir()
    run_page(page, tmp_path / "right")
    page.write_text("```console\n$ echo a\nb\n```\n")
    (tmp_path / "wrong").mkdir()
    with pytest.raises(AssertionError, match="shows otherwise"):
        run_page(page, tmp_path / "wrong")


def test_shown_output_is_compared_line_by_line() -> None:
    assert matches("speed ... m/s\n...\nend\n", "begin\nspeed 1.25   m/s\nmore\nend\n")
    assert not matches("end\nspeed ...\n", "speed 1\nend\n")  # the other order
    assert matches("zone ... m\n", "│ zone │ 8.1 │ m │\n")
    assert not matches("[x]\n", "x\n")  # brackets are characters


def test_output_of_python_blocks_is_compared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name, shown in (("right", "speed 1.5 ..."), ("wrong", "speed 2 ...")):
        page = tmp_path / f"{name}.md"
        page.write_text(
            f"```python\nprint('speed 1.5 m/s')\n```\n\n<!-- output of the block above -->\n```text\n{shown}\n```\n"
        )
        (tmp_path / name).mkdir()
    run_page(tmp_path / "right.md", tmp_path / "right")
    with pytest.raises(AssertionError, match="shows otherwise"):
        run_page(tmp_path / "wrong.md", tmp_path / "wrong")
