"""Reference pages: every kind has an example that its class accepts, and no default in words of Python."""

from __future__ import annotations

import ast
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote

import pytest
import toml_examples
from helpers.page_blocks import ROOT, blocks

from ruptfx.app.reference import describe
from ruptfx.input.schema import alternatives, package_of

KINDS = [(topic, name) for topic in (*describe.FOLDERS, "histories") for name in describe.names_of(topic)]


def tables_of(found: object, kind: str) -> Iterator[dict[str, object]]:
    """Yield the tables of a kind at any depth."""
    if isinstance(found, dict):
        if found.get("kind") == kind:
            yield found
        for inner in found.values():
            yield from tables_of(inner, kind)
    if isinstance(found, list):
        for inner in found:
            yield from tables_of(inner, kind)


@pytest.mark.parametrize(("topic", "kind"), KINDS, ids=[".".join(each) for each in KINDS])
def test_a_kind_has_an_example_that_it_accepts(topic: str, kind: str) -> None:
    entry = next(entry for entry in describe.entries(topic) if entry.name == kind)
    text, demo = toml_examples.example(topic, entry)
    assert text and (not demo or (ROOT / "demos" / demo).is_file())
    found = tomllib.loads(text)
    of_files = alternatives(package_of(topic)) if topic in describe.FOLDERS else {}
    if topic == "operators":
        assert found == {"operator": kind}
    elif kind == "a point as center":
        text = text.partition("center = ")[2].splitlines()[0]
        describe.CLASSES[topic][kind].model_validate(tomllib.loads(f"center = {text}")["center"])
    else:
        cls = (of_files | describe.CLASSES.get(topic, {}))[kind]
        table = next(tables_of(found, kind))
        required = {name for name, field in cls.model_fields.items() if field.is_required()} - {"kind"}
        assert required <= table.keys()
        cls.model_validate({key: value for key, value in table.items() if key != "kind" or key in cls.model_fields})


def test_defaults_are_words_of_toml() -> None:
    keys = [key for topic in describe.TOPICS for entry in describe.entries(topic) for key in entry.keys]
    assert len(keys) > 300
    wrong = [key for key in keys if re.search(r"\b(False|True|None|inf|nan)\b|'|<|\w\(", key.default)]
    assert not wrong


def test_values_are_written_as_toml() -> None:
    values = {"a": [1.0, 2e-6, 3], "b": {"c": "6 MPa", "d": True}, "e": -1e5}
    assert tomllib.loads(f"x = {toml_examples.as_toml(values)}")["x"] == values


def imported(page: Path) -> Iterator[str]:
    """Yield the names that Python blocks of a page import from modules of ruptfx."""
    for block in blocks(page):
        if block.language == "python":
            for node in ast.walk(ast.parse(block.text)):
                if isinstance(node, ast.ImportFrom) and str(node.module).startswith("ruptfx"):
                    yield from (name.name for name in node.names)


def test_what_pages_import_is_in_the_python_reference() -> None:
    reference = (ROOT / "docs" / "reference" / "python.md").read_text()
    modules = {"plots", "Array", "LawState"}  # not functions or classes with a docstring
    names = {name for page in (ROOT / "docs").rglob("*.md") for name in imported(page)} - modules
    assert len(names) > 15
    assert {name for name in names if not re.search(rf"\b{name}\b", reference)} == set()


def test_references_are_whole_and_in_order() -> None:
    """Every entry has authors, a year and a journal or a publisher; links are those of their DOIs."""
    text = (ROOT / "docs" / "reference" / "references.md").read_text()
    for part in text.split("\n## ")[1:]:
        entries = [" ".join(entry.split()) for entry in part.split("\n- ")[1:]]
        assert entries and all(re.match(r"[A-Z][\w-]+, [A-Z].* \((19|20)\d\d\)\. ", entry) for entry in entries)
        assert all("*" in entry or "doi:" in entry for entry in entries)
        keys = [(entry.split(",")[0], re.search(r"\((\d{4})\)", entry)[1]) for entry in entries]  # type: ignore[index]
        assert keys == sorted(keys)
    for shown, link in re.findall(r"\[doi:([^\]]+)\]\(https://doi\.org/([^)]+)\)", text):
        assert unquote(link) == shown
