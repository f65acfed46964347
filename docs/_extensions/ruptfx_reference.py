"""Directives of the reference: what `ruptfx describe` knows, as pages.

- ``{ruptfx-entries} TOPIC``: every kind or table of a topic of `ruptfx describe`.
- ``{ruptfx-commands}``: every command with its arguments and options.
- ``{ruptfx-fields}``: the fields of interface.h5.
- ``ruptfx-figures``, in a block of reStructuredText: every function of `ruptfx.results.plots` that draws a figure.
- ``{ruptfx-support} TOPIC``: which features work with which steppers, contact methods, planes or materials.
- ``{ruptfx-bench} FOLDER``: tables of saved results of `ruptfx bench`, after one of a row for each benchmark.
- ``{ruptfx-problems} FILE``: the verification problems of a TOML file, each with picture, source, error and verdict.
- ``{ruptfx-sources} NAME``: what a document prints, and what is computed here.
- ``{ruptfx-speed} FILE TABLE``: one of the tables of `ruptfx bench speed`: choice, rates, steps, phases, aims or
  checks; sizes or ranks of `ruptfx bench scaling`.
- ``{ruptfx-time}`DEMO` ``, in a line: the time of a demo that `ruptfx bench demo_times` found.
"""

from __future__ import annotations

import fnmatch
import inspect
import json
import math
import re
import tomllib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import toml_examples
import typer
from docutils import nodes
from docutils.parsers.rst import Directive
from formulas import latex
from pydantic import BaseModel
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective, SphinxRole

from ruptfx.app import bench
from ruptfx.app.bench import _speed_tables
from ruptfx.app.cli import app
from ruptfx.app.reference import describe, sources, support_table
from ruptfx.app.script import number_text
from ruptfx.input.fields import DERIVED, FIELDS, MONITORS, OF_SLIDING
from ruptfx.input.quantities import with_prefix
from ruptfx.results import plots
from ruptfx.results.summary_fields import UNITS


def paragraph(text: str) -> nodes.paragraph:
    """Text in which `names` stand out."""
    block = nodes.paragraph()
    for number, part in enumerate(text.split("`")):
        block += nodes.literal(part, part) if number % 2 else nodes.Text(part)
    return block


Cell = str | nodes.Element
Cells = tuple[Cell, ...]


def table(
    header: tuple[str, ...],
    rows: list[Cells],
    widths: tuple[int, ...],
    literal: int = 1,
    classes: tuple[str, ...] = (),
) -> nodes.table:
    """Return a table with code in the first columns; cells are text or nodes."""
    group = nodes.tgroup(cols=len(header))
    group += [nodes.colspec(colwidth=width) for width in widths]

    def row(cells: Cells, code: int) -> nodes.row:
        line = nodes.row()
        for place, cell in enumerate(cells):
            entry = nodes.entry()
            if isinstance(cell, nodes.Element):
                entry += cell
            elif cell and place < code:
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
    whole = nodes.table(classes=["colwidths-given", *classes])
    whole += group
    return whole


def section(title: str, identifier: str) -> nodes.section:
    """Return a section with a title and an identifier for links."""
    block = nodes.section(ids=[nodes.make_id(identifier)], names=[nodes.fully_normalize_name(title)])
    block += nodes.title(title, title)
    return block


PAGES = {"faults": "case.html#interfaces", "output": "case.html#output", "stop_when": "case.html#early-end",
         "damping": "case.html#damping"}  # fmt: skip
"""Pages of topics that have none of their own name."""


def bounds(text: str) -> Cell:
    """Return the bounds of a key, with links to the pages of the topics that they name."""
    block = nodes.paragraph()
    for number, part in enumerate(text.split(", ") if text else []):
        block += nodes.Text(", " if number else "")
        topic = "profiles" if part == "may be a profile" else part.removeprefix("see ")
        if part not in ("may be a profile", f"see {topic}"):
            block += nodes.Text(part)
            continue
        shown = part.removeprefix("see ")
        block += nodes.reference(shown, shown, refuri=PAGES.get(topic, f"{topic}.html"), internal=True)
    return block


def entry_section(topic: str, entry: describe.Entry) -> nodes.section:
    """One kind or table."""
    block = section(entry.name, f"{topic}-{entry.name}")
    block += paragraph(entry.summary)
    block += [paragraph(" ".join(part.split())) for part in entry.details.split("\n\n") if part.strip()]
    for label, text in entry.labels.items():
        if label == "example":
            continue
        if label == "formula":
            block += nodes.math_block("", r" \qquad ".join(latex(text)))
            continue
        line = paragraph("")
        line += nodes.strong(label, label.capitalize())
        line += nodes.Text(": ")
        line += nodes.literal(text, text) if label == "state" else nodes.Text(text)
        block += line
    if topic in describe.FOLDERS or topic in describe.CLASSES:
        text, demo = toml_examples.example(topic, entry)
        if text:
            line = paragraph("")
            line += nodes.strong("Example", "Example")
            line += paragraph(f", from `demos/{demo}`:" if demo else ":").children
            block += line
            block += nodes.literal_block(text, text, language="toml")
    if entry.keys:
        rows = [(key.name, key.unit, bounds(key.bounds), key.default, key.description) for key in entry.keys]
        if topic == "summary":
            block += table(("field", "unit", "what it is"), [(r[0], r[1], r[4]) for r in rows], (30, 10, 60))
        else:
            header = ("key", "unit", "bounds", "default", "what it is")
            block += table(header, rows, (16, 8, 14, 14, 48), classes=("keys",))
    return block


class Entries(Directive):
    """Every kind or table of a topic."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        self.state.document.settings.env.note_reread()  # made from the code, whatever files of docs changed
        topic = self.arguments[0]
        found = list(describe.entries(topic))
        broken = [entry.name for entry in found if entry.problem]
        if broken:
            raise self.error(f"these do not load: {', '.join(broken)}")
        return [entry_section(topic, entry) for entry in found]


class Commands(Directive):
    """Every command with its arguments and options."""

    def run(self) -> list[nodes.Node]:
        self.state.document.settings.env.note_reread()  # made from the code, whatever files of docs changed
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
        self.state.document.settings.env.note_reread()  # made from the code, whatever files of docs changed
        rows = [(item.name, item.unit, item.long_name) for item in (*FIELDS, *DERIVED, *MONITORS) if item.recorded]
        for item in OF_SLIDING:
            meanings = ", ".join(f"{number} {text}" for number, text in enumerate(item.meanings))
            text = f"{item.long_name} ({meanings})" if meanings else item.long_name
            rows.append((item.name, item.unit, f"sliding contact only: {text}"))
        return [table(("field", "unit", "what it is"), rows, (25, 10, 65))]


class Figures(SphinxDirective):
    """Every function that draws a figure."""

    def run(self) -> list[nodes.Node]:
        self.env.note_reread()  # made from the code, whatever files of docs changed
        functions = (f".. autofunction:: ruptfx.results.plots.{name}\n\n" for name in plots.FIGURES)
        return self.parse_text_to_nodes("".join(functions))


class Support(Directive):
    """Features against steppers, contact methods, planes or materials, with notes below the table."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        self.state.document.settings.env.note_reread()  # made from the code, whatever files of docs changed
        found = next((each for each in support_table.tables() if each.topic == self.arguments[0]), None)
        if found is None:
            raise self.error(f"no table of '{self.arguments[0]}'")
        rows, notes = found.numbered()
        first = 40 if len(found.columns) < 9 else 20
        widths = first, *([(100 - first) // len(found.columns)] * len(found.columns))
        listed = nodes.enumerated_list(enumtype="arabic", prefix="(", suffix=")")
        for note in notes:
            item = nodes.list_item()
            item += paragraph(note)
            listed += item
        # Long names may be broken behind an underscore: at a space of no width.
        columns = (name.replace("_", "_\u200b") for name in found.columns)
        return [table(("feature", *columns), rows, widths, literal=0), *([listed] if notes else [])]


class Bench(Directive):
    """Saved results of `ruptfx bench`: a summary, then a table for each problem; the argument is their folder."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        self.state.document.settings.env.note_reread()  # made from the code, whatever files of docs changed
        folder = Path(self.state.document.settings.env.srcdir, self.arguments[0])
        found = sorted(folder.glob("*.json"))
        if not found:
            raise self.error(f"no saved results in {folder}")
        for path in found:
            self.state.document.settings.env.note_dependency(str(path))
        saved = {path.stem: json.loads(path.read_text()) for path in found}
        physics = {name: each for name, each in saved.items() if name not in bench.OF_THE_MACHINE}
        return [summary(physics), *(self._problem(name, each) for name, each in saved.items())]

    @staticmethod
    def _problem(name: str, saved: dict[str, Any]) -> nodes.section:
        block = section(name, f"bench-{name}")
        block += paragraph(about(name))
        command = f"ruptfx bench {name}" + " --fine" * saved["fine"]
        block += paragraph(f"`{command}`, {duration(saved)} on the machine of these results")
        block += checks(saved)
        return block


def about(name: str) -> str:
    """Return the first paragraph of the docstring of a benchmark."""
    return " ".join(bench.description(bench.benchmarks()[name]).partition("\n\n")[0].split())


def linked(name: str, text: str, page: str = "") -> nodes.paragraph:
    """Return a link to the results of a benchmark."""
    block = nodes.paragraph()
    block += nodes.reference(text, text, refuri=f"{page}#{nodes.make_id(f'bench-{name}')}", internal=True)
    return block


def duration(saved: dict[str, Any]) -> str:
    """Return the time of a benchmark as text; results put together from several runs have none."""
    return "time not measured" if saved["seconds"] is None else f"{saved['seconds']:.0f} s"


def checks_of(saved: dict[str, Any]) -> list[bench.Check]:
    """Return the saved checks of a benchmark; numbers that could not be computed are NaN."""
    return [
        bench.Check(**{key: math.nan if value is None else value for key, value in row.items() if key != "passed"})
        for row in saved["checks"]
    ]


def use(check: bench.Check) -> float:
    """Return the part of the tolerance that an error uses: infinite for NaN; -1 or infinite for one-sided checks."""
    slack = check.tolerance * (abs(check.expected) if check.relative else 1.0)
    if check.relation != "within" or slack == 0:
        return -1.0 if check.passed else math.inf
    part = abs(check.found - check.expected) / slack
    return part if math.isfinite(part) else math.inf


def passed(found: list[bench.Check]) -> str:
    """Return how many checks pass, as text."""
    good = sum(check.passed for check in found)
    return f"{good} of {len(found)}" + (", missed" if good < len(found) else "")


def summary(saved: dict[str, dict[str, Any]]) -> nodes.table:
    """Return a table with a row for each benchmark: source, checks, largest used part of a tolerance, time."""
    rows: list[Cells] = []
    for name, each in saved.items():
        found = checks_of(each)
        cited = dict.fromkeys(check.source for check in found if any(year in check.source for year in ("(1", "(2")))
        sources = list(cited) or list(dict.fromkeys(check.source for check in found if check.source))
        largest = max(map(use, found))
        part = "above 100 %" if math.isinf(largest) else f"{100 * largest:.0f} %" if largest >= 0 else ""
        rows.append((linked(name, name), "; ".join(sources[:2]), passed(found), part, duration(each)))
    header = ("benchmark", "expected values from", "checks passed", "largest error over its tolerance", "time")
    return table(header, rows, (16, 44, 14, 16, 10), literal=0)


def checks(saved: dict[str, Any]) -> nodes.table:
    """Return the table of saved checks of a benchmark; of checks that are repeated for several runs the worst."""
    groups: dict[bench.Check, list[bench.Check]] = {}
    for check in checks_of(saved):
        groups.setdefault(replace(check, found=0.0), []).append(check)
    rows = []
    for group in groups.values():
        check = max(group, key=use)
        name = check.quantity + (f" (worst of {len(group)} runs)" if len(group) > 1 else "")
        numbers = f"{check.expected:.5g}", f"{check.found:.5g}", check.limit
        rows.append((name, *numbers, check.unit, check.source, "pass" if check.passed else "fails"))
    header = ("quantity", "expected", "found", "tolerance", "unit", "source", "")
    return table(header, rows, (30, 11, 12, 11, 7, 23, 6), literal=0, classes=("checks",))


def error_of(check: bench.Check) -> str:
    """Return the error of a check, or its one-sided bound, with the tolerance."""
    if check.relation != "within":
        return f"{check.found:.3g} ({check.relation} {check.expected:.3g})"
    error = abs(check.found - check.expected)
    if check.relative:
        return f"{100 * error / abs(check.expected):.2g} % (allowed {100 * check.tolerance:.3g} %)"
    if check.unit == "1" and check.expected == 0:
        return f"{100 * error:.2g} % (allowed {100 * check.tolerance:.3g} %)"
    if check.unit == "1":
        return f"{error:.2g} (allowed {check.tolerance:.3g})"
    if check.unit in ("m", "s"):
        return f"{with_prefix(error, check.unit)} (allowed {with_prefix(check.tolerance, check.unit)})"
    return f"{error:.2g} {check.unit} (allowed {check.tolerance:.3g} {check.unit})"


class Problems(Directive):
    """Verification problems of a TOML file beside the folder of results: picture, problem, source, error, verdict."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        self.state.document.settings.env.note_reread()  # made from the code, whatever files of docs changed
        path = Path(self.state.document.settings.env.srcdir, self.arguments[0])
        self.state.document.settings.env.note_dependency(str(path))
        return [table(("", "problem", "compared with", "error", "checks passed"), list(self._rows(path)),
                      (18, 24, 26, 20, 12), literal=0, classes=("problems",))]  # fmt: skip

    def _rows(self, path: Path) -> Iterator[Cells]:
        for problem in tomllib.loads(path.read_text())["problems"]:
            name = problem["benchmark"]
            results = path.with_name("results") / f"{name}.json"
            self.state.document.settings.env.note_dependency(str(results))
            found = checks_of(json.loads(results.read_text()))
            chosen = [check for check in found if fnmatch.fnmatchcase(check.quantity, problem["quantity"])]
            if not chosen:
                raise self.error(f"{name}: no check is named like '{problem['quantity']}'")
            picture = nodes.reference(refuri=f"benchmarks.html#{nodes.make_id(f'bench-{name}')}", internal=True)
            picture += nodes.image(uri=problem["picture"], alt=problem["title"])
            shown = nodes.paragraph()
            shown += picture
            error = f"{problem['what']}: {error_of(max(chosen, key=use))}"
            yield shown, linked(name, problem["title"], "benchmarks.html"), problem["source"], error, passed(found)


class Sources(Directive):
    """A table of what a document prints and what is computed here, from `ruptfx/app/reference/sources.toml`.

    The argument is the name of the document. `[[NAME|NUMBER]]` stands for the saved number of a check of a benchmark,
    or of the run of a demo.
    """

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        environment = self.state.document.settings.env
        environment.note_dependency(sources.__file__.replace(".py", ".toml"))
        cells: list[Cells] = []
        for row in sources.rows_of(self.arguments[0]):
            first = paragraph(row.what)
            if row.picture:  # named from the top of the site; its width makes Sphinx link it to its file
                first += nodes.image(uri=f"/{row.picture}", alt=row.what, width="9em")
            shown = nodes.paragraph()
            if row.command:
                shown += nodes.literal(text=row.command)
            computed = re.sub(r"\[\[(.+?)\|(.+?)\]\]", self._number, row.computed)
            cells.append((first, shown, row.printed, computed, row.agrees))
        header = ("figure or equation", "command", "printed", "here", "agrees")
        return [table(header, cells, (24, 22, 18, 24, 12), literal=0, classes=("sources",))]

    def _number(self, match: re.Match[str]) -> str:
        """Return a saved number with its unit."""
        name, wanted = match[1], match[2]
        environment = self.state.document.settings.env
        is_demo = name.endswith((".py", ".toml"))
        folder = ("pictures", "numbers.json") if is_demo else ("verification", "results", f"{name}.json")
        path = Path(environment.srcdir, *folder)
        environment.note_dependency(str(path))
        try:
            return saved_number(path, name, wanted)
        except LookupError as error:
            raise self.error(f"{name}: {error}") from None


def saved_number(path: Path, name: str, wanted: str) -> str:
    """Return the number of a check of a benchmark, or of the run of a demo, as text with its unit.

    Raises
    ------
    LookupError
        The file has no such number, or several.
    """
    saved = json.loads(path.read_text())
    if name.endswith(".py"):
        return number_text(saved[name][wanted])
    if name.endswith(".toml"):
        value = saved[name.removesuffix(".toml")][wanted]
        return number_text((value, UNITS[wanted]) if wanted in UNITS else value)
    named = [check for check in checks_of(saved) if fnmatch.fnmatchcase(check.quantity, wanted)]
    if len(named) != 1:
        raise LookupError(f"{len(named)} checks are named like '{wanted}'")
    (check,) = named
    return number_text((check.found, check.unit) if check.unit != "1" else check.found)


RATES = (600_000, 1_000_000)  # nodes of the rows of the short table
SHAPES = {"affine": "parallel edges", "general": "any edges"}


class Speed(Directive):
    """A table of the saved results of `ruptfx bench speed`: their file, and which table."""

    required_arguments = 2

    def run(self) -> list[nodes.Node]:
        self.state.document.settings.env.note_reread()  # made from the code, whatever files of docs changed
        path = Path(self.state.document.settings.env.srcdir, self.arguments[0])
        self.state.document.settings.env.note_dependency(str(path))
        saved = json.loads(path.read_text())
        if self.arguments[1] == "checks":
            return [checks(saved)]
        if self.arguments[1] == "aims":
            others = path.with_name("mode_map.json")
            found = [saved, *([json.loads(others.read_text())] if others.exists() else [])]
            return [table(_speed_tables.AIMS, _speed_tables.aim_rows(*found), (40, 10, 15, 10, 10), literal=0)]
        if self.arguments[1] == "rates":
            rows = [
                (f"{row['dim']}D, order {row['order']}, {SHAPES[row['geometry']]}", f"{row['nodes'] / 1e6:.2g} million",
                 f"{row['node_updates_per_second_per_core'] / 1e6:.0f} million")
                for row in saved["rows"]
                if "order" in row and row["ranks"] == 1 and (row["asked"] in RATES or row["geometry"] == "general")
            ]  # fmt: skip
            return [table(("elements", "nodes", "node updates per second and core"), rows, (50, 20, 30), literal=0)]
        if self.arguments[1] == "choice":
            precision = json.loads(path.with_name("precision.json").read_text())
            whole = [json.loads(each.read_text()) for each in sorted(path.parent.glob("tpv5_time*.json"))]
            chosen = _speed_tables.choice_rows(saved, precision, whole)
            return [table(_speed_tables.CHOICE, chosen, (50, 15, 15, 20), literal=0)]
        if self.arguments[1] == "sizes":
            header, rows = _speed_tables.SIZES, _speed_tables.size_rows(saved["rows"])
        elif self.arguments[1] == "ranks":
            header, rows = _speed_tables.RANKS, _speed_tables.rank_rows(saved["rows"])
        elif self.arguments[1] == "steps":
            header, rows = _speed_tables.STEPS, _speed_tables.step_rows(saved["rows"])
        else:
            header, rows = _speed_tables.phase_table(saved["rows"])
        return [table(header, rows, (24, *(10,) * (len(header) - 1)), literal=0)]


def rounded(seconds: float) -> str:
    """Return a time as rounded text; the rounding is coarser than the scatter between machines."""
    if seconds < 1.5:
        return "1 s"
    if seconds < 10:
        return f"{seconds:.0f} s"
    if seconds < 90:
        return f"{5 * round(seconds / 5)} s"
    return f"{round(seconds / 30) / 2:g} min"


class Time(SphinxRole):
    """Processor time of a demo, from the saved results of `ruptfx bench demo_times`."""

    def run(self) -> tuple[list[nodes.Node], list[nodes.system_message]]:
        path = Path(self.env.srcdir, "verification", "results", "demo_times.json")
        self.env.note_dependency(str(path))
        seconds = {row["demo"]: row["seconds"] for row in json.loads(path.read_text())["rows"]}
        if self.text not in seconds:
            raise ValueError(f"{self.text}: no time of it in {path.name}; has it been run by ruptfx bench demo_times?")
        return [nodes.Text(rounded(seconds[self.text]))], []


def without_keys(app: Sphinx, what: str, name: str, obj: object, *_: object) -> tuple[str, None] | None:
    """Return no signature for tables of a case: their keys have pages of their own."""
    return ("", None) if what == "class" and isinstance(obj, type) and issubclass(obj, BaseModel) else None


def setup(app: Sphinx) -> dict[str, int]:
    """Register the directives and the role in Sphinx."""
    for directive in (Entries, Commands, Fields, Figures, Support, Bench, Problems, Sources, Speed):
        app.add_directive(f"ruptfx-{directive.__name__.lower()}", directive)
    app.add_role("ruptfx-time", Time())
    app.connect("autodoc-process-signature", without_keys)
    # With another version Sphinx reads all pages again.
    return {"parallel_read_safe": True, "parallel_write_safe": True, "env_version": 1}
