"""Directives of the reference: what `ruptfx describe` knows, as pages.

- ``{ruptfx-entries} TOPIC``: every kind or table of a topic of `ruptfx describe`.
- ``{ruptfx-commands}``: every command with its arguments and options.
- ``{ruptfx-fields}``: the fields of interface.h5.
- ``{ruptfx-support} TOPIC``: which features work with which steppers, contact methods, planes or materials.
- ``{ruptfx-bench} FOLDER``: tables of saved results of `ruptfx bench`.
- ``{ruptfx-speed} FILE TABLE``: one of the tables of `ruptfx bench speed`: steps, phases, aims or checks.
- ``{ruptfx-time}`DEMO` ``, in a line: the time of a demo that `ruptfx bench demo_times` found.
"""

from __future__ import annotations

import ast
import inspect
import json
import math
from pathlib import Path
from typing import Any

import typer
from docutils import nodes
from docutils.parsers.rst import Directive
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxRole

from ruptfx import bench, describe, support_table
from ruptfx.bench import _speed_tables, demo_times
from ruptfx.cli import app
from ruptfx.fields import DERIVED, FIELDS, MONITORS, OF_SLIDING


def paragraph(text: str) -> nodes.paragraph:
    """Text in which `names` stand out."""
    block = nodes.paragraph()
    for number, part in enumerate(text.split("`")):
        block += nodes.literal(part, part) if number % 2 else nodes.Text(part)
    return block


Row = tuple[str, ...]


def table(header: Row, rows: list[Row], widths: tuple[int, ...], literal: int = 1) -> nodes.table:
    """Return a table with code in the first columns."""
    group = nodes.tgroup(cols=len(header))
    group += [nodes.colspec(colwidth=width) for width in widths]

    def row(cells: tuple[str, ...], code: int) -> nodes.row:
        line = nodes.row()
        for place, cell in enumerate(cells):
            entry = nodes.entry()
            if cell and place < code:
                block = nodes.paragraph()
                block += nodes.literal(cell, cell)
                entry += block
            else:
                entry += paragraph(cell)
            line += entry
        return line

    head, body = nodes.thead(), nodes.tbody()
    head += row(header, 0)
    body += [row(cells, literal) for cells in rows]
    group += [head, body]
    whole = nodes.table(classes=["colwidths-given"])
    whole += group
    return whole


def section(title: str, identifier: str) -> nodes.section:
    """Return a section with a title and an identifier for links."""
    block = nodes.section(ids=[nodes.make_id(identifier)], names=[nodes.fully_normalize_name(title)])
    block += nodes.title(title, title)
    return block


def entry_section(topic: str, entry: describe.Entry) -> nodes.section:
    """One kind or table."""
    block = section(entry.name, f"{topic}-{entry.name}")
    block += paragraph(entry.summary)
    block += [paragraph(" ".join(part.split())) for part in entry.details.split("\n\n") if part.strip()]
    for label, text in entry.labels.items():
        line = paragraph("")
        line += nodes.strong(label, label.capitalize())
        line += nodes.Text(": ")
        line += nodes.literal(text, text) if label in ("formula", "example", "state") else nodes.Text(text)
        block += line
    if entry.keys:
        rows = [(key.name, key.unit, key.bounds, key.default, key.description) for key in entry.keys]
        if topic == "summary":
            block += table(("field", "unit", "what it is"), [(r[0], r[1], r[4]) for r in rows], (30, 10, 60))
        else:
            block += table(("key", "unit", "bounds", "default", "what it is"), rows, (16, 8, 14, 14, 48))
    return block


class Entries(Directive):
    """Every kind or table of a topic."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        topic = self.arguments[0]
        found = list(describe.entries(topic))
        broken = [entry.name for entry in found if entry.problem]
        if broken:
            raise self.error(f"these do not load: {', '.join(broken)}")
        return [entry_section(topic, entry) for entry in found]


class Commands(Directive):
    """Every command with its arguments and options."""

    def run(self) -> list[nodes.Node]:
        group = typer.main.get_command(app)
        return [self._command(name, command) for name, command in group.commands.items()]  # type: ignore[attr-defined]

    @staticmethod
    def _command(name: str, command: object) -> nodes.section:
        block = section(f"ruptfx {name}", f"command-{name}")
        text, _, example = inspect.cleandoc(command.callback.__doc__ or "").partition("\n\nExample: ")  # type: ignore[attr-defined]
        block += [paragraph(" ".join(part.split())) for part in text.split("\n\n")]
        block += nodes.literal_block(example, example, language="sh")
        rows = []
        for parameter in command.params:  # type: ignore[attr-defined]
            if parameter.name == "help":
                continue
            argument = parameter.param_type_name == "argument"
            shown = parameter.name.upper().rstrip("_") if argument else ", ".join(parameter.opts)
            default = "" if parameter.default in (None, False, ()) or callable(parameter.default) else parameter.default
            rows.append((shown, "required" if parameter.required else str(default), parameter.help or ""))
        if rows:
            block += table(("argument", "default", "what it is"), rows, (20, 20, 60))
        return block


class Fields(Directive):
    """Table of the interface fields, without the state of the law."""

    def run(self) -> list[nodes.Node]:
        rows = [(item.name, item.unit, item.long_name) for item in (*FIELDS, *DERIVED, *MONITORS) if item.recorded]
        for item in OF_SLIDING:
            meanings = ", ".join(f"{number} {text}" for number, text in enumerate(item.meanings))
            text = f"{item.long_name} ({meanings})" if meanings else item.long_name
            rows.append((item.name, item.unit, f"sliding contact only: {text}"))
        return [table(("field", "unit", "what it is"), rows, (25, 10, 65))]


class Support(Directive):
    """Features against steppers, contact methods, planes or materials, with notes below the table."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        found = next((each for each in support_table.tables() if each.topic == self.arguments[0]), None)
        if found is None:
            raise self.error(f"no table of '{self.arguments[0]}'")
        rows, notes = found.numbered()
        first = 40
        widths = first, *([(100 - first) // len(found.columns)] * len(found.columns))
        listed = nodes.enumerated_list(enumtype="arabic", prefix="(", suffix=")")
        for note in notes:
            item = nodes.list_item()
            item += paragraph(note)
            listed += item
        return [table(("feature", *found.columns), rows, widths, literal=0), *([listed] if notes else [])]


class Bench(Directive):
    """Saved results of `ruptfx bench`, a table for each problem; the argument is their folder."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        folder = Path(self.state.document.settings.env.srcdir, self.arguments[0])
        found = sorted(folder.glob("*.json"))
        if not found:
            raise self.error(f"no saved results in {folder}")
        for path in found:
            self.state.document.settings.env.note_dependency(str(path))
        return [self._problem(path.stem, json.loads(path.read_text())) for path in found]

    @staticmethod
    def _problem(name: str, saved: dict[str, Any]) -> nodes.section:
        block = section(name, f"bench-{name}")
        text = ast.get_docstring(ast.parse((Path(bench.__file__).parent / f"{name}.py").read_text())) or ""
        block += paragraph(" ".join(text.partition("\n\n")[0].split()))
        command = f"ruptfx bench {name}" + " --fine" * saved["fine"]
        block += paragraph(f"`{command}`, {saved['seconds']:.0f} s on the machine of these results")
        block += checks(saved)
        return block


def checks(saved: dict[str, Any]) -> nodes.table:
    """Return the table of saved checks of a benchmark."""
    rows = []
    for row in saved["checks"]:
        values = {key: math.nan if value is None else value for key, value in row.items() if key != "passed"}
        check = bench.Check(**values)
        verdict = "pass" if check.passed else "fails"
        numbers = f"{check.expected:.6g}", f"{check.found:.6g}", check.limit
        rows.append((check.quantity, *numbers, check.unit, check.source, verdict))
    header = ("quantity", "expected", "found", "tolerance", "unit", "source", "")
    return table(header, rows, (30, 11, 11, 10, 7, 25, 6), literal=0)


class Speed(Directive):
    """A table of the saved results of `ruptfx bench speed`: their file, and which table."""

    required_arguments = 2

    def run(self) -> list[nodes.Node]:
        path = Path(self.state.document.settings.env.srcdir, self.arguments[0])
        self.state.document.settings.env.note_dependency(str(path))
        saved = json.loads(path.read_text())
        if self.arguments[1] == "checks":
            return [checks(saved)]
        if self.arguments[1] == "aims":
            others = path.with_name("mode_map.json")
            found = [saved, *([json.loads(others.read_text())] if others.exists() else [])]
            return [table(_speed_tables.AIMS, _speed_tables.aim_rows(*found), (40, 10, 15, 10, 10), literal=0)]
        if self.arguments[1] == "steps":
            header, rows = _speed_tables.STEPS, _speed_tables.step_rows(saved["rows"])
        else:
            header, rows = _speed_tables.phase_table(saved["rows"])
        return [table(header, rows, (24, *(10,) * (len(header) - 1)), literal=0)]


class Time(SphinxRole):
    """Processor time of a demo, from the saved results of `ruptfx bench demo_times`."""

    def run(self) -> tuple[list[nodes.Node], list[nodes.system_message]]:
        path = Path(self.env.srcdir, "verification", "results", "demo_times.json")
        self.env.note_dependency(str(path))
        seconds = {row["demo"]: row["seconds"] for row in json.loads(path.read_text())["rows"]}
        if self.text not in seconds:
            raise ValueError(f"{self.text}: no time of it in {path.name}; has it been run by ruptfx bench demo_times?")
        return [nodes.Text(demo_times.rounded(seconds[self.text]))], []


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directives and the role in Sphinx."""
    for directive in (Entries, Commands, Fields, Support, Bench, Speed):
        app.add_directive(f"ruptfx-{directive.__name__.lower()}", directive)
    app.add_role("ruptfx-time", Time())
    return {"parallel_read_safe": True, "parallel_write_safe": True}
