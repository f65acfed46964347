"""Draw the diagrams of `docs/developers`: `python docs/make_drawings.py` writes them as SVG.

A box names a file of the package and a name in it; the tests look both up, and compare the files with this script.
"""

from __future__ import annotations

import sys
import tomllib
from dataclasses import dataclass
from html import escape
from pathlib import Path

ROOT = Path(__file__).parents[1]
OUT = Path(__file__).parent / "developers"
WIDTH, GAP, LINE, CHARACTER = 760, 22, 16, 6.6  # [CSS pixels]
FILLS = {"python": "#eaf1f8", "c": "#f8efe2", "file": "#e9f5ea", "plain": "#f4f4f4"}


@dataclass(frozen=True)
class Box:
    """A box: where in the code, and what happens there.

    Attributes
    ----------
    where : str
        File below `ruptfx`, and after a colon names in it; or a title.
    text : str
        Lines below.
    fill : str
        Key of `FILLS`.
    """

    where: str
    text: str
    fill: str = "python"


STEP = [
    [Box("run/simulation.py: _run", "the only time loop")],
    [Box("stepping/steppers/leapfrog.py: LeapfrogMotion, step, _advance", "calls the phases below in this order;\n"
         "of each phase the mechanisms that have it, in ascending `order`")],
    [Box("interfaces/mechanisms/__init__.py: prepare, add_first", "geometry, pairing; forces of facets"),
     Box("bodies/operators/matrix_free.py: step", "forces of elements; v and u of plain nodes",
         "c")],
    [Box("interfaces/mechanisms/__init__.py: add_internal, add_external", "damping, loads, attachments"),
     Box("interfaces/mechanisms/stepped_nodes.py: kick", "v += dt f / m at the other nodes", "c")],
    [Box("interfaces/mechanisms/faults.py: after_kick", "contact corrects the velocities"),
     Box("interfaces/faults/points.c: project", "trial, projection, slip, state", "c")],
    [Box("interfaces/mechanisms/stepped_nodes.py: drift", "u += dt v"),
     Box("run/recording/recorder.py: observe, record", "rows of files; then stop rules and checkpoints")],
]  # fmt: skip
NUMBER = [
    [Box("case.toml", 'D_c = "10 um"', "file")],
    [Box("case/__init__.py: read_case, friction", "the table [faults.main.friction]")],
    [Box("input/schema.py: alternative, Unit, read", "`kind` chooses the class, text becomes SI: 1e-5 m")],
    [Box("laws/friction/_slip_weakening.py: D_c", "field of the law, with unit and bound; number or profile")],
    [Box("run/faults.py: make_fault, friction", "law.at(points): profiles become arrays, one value per point")],
    [Box("interfaces/faults/projection.py: TracedLaw, parameters_as_symbols",
         "the formula runs once with the symbol p_D_c; the value is kept beside it")],
    [Box("interfaces/faults/point_code.py: PointCode, numbers, fixed",
         "value: `numbers`, or `fixed` if it varies; symbol: a macro, number[k] or FIXED(p_D_c)")],
    [Box("interfaces/faults/points.c: RESISTANCE", "the formula as C, for LANES points at a time", "c")],
]  # fmt: skip
RESULT = [
    [Box("bodies/state.py: State, faults", "arrays of this rank, in memory")],
    [Box("run/recording/recorder.py: record", "when a time is due: asks the records of every mechanism")],
    [Box("run/recording/mechanisms/faults.py: FaultRecords, read, append",
         "gathers the fields in the order of the points, on rank 0")],
    [Box("run/recording/interface_file.py: InterfaceFile, append", "50 rows at once, on a thread"),
     Box("interface.h5", "NetCDF4: names, units, positions", "file")],
    [Box("results/record.py: Files, Record", "reads arrays on demand; without MPI and DOLFINx")],
    [Box("results/analysis/__init__.py: summarise", "numbers of the run"),
     Box("summary.json", "written last: the run is complete", "file")],
    [Box("results/plots/__init__.py: save_all, suits", "figures that suit the run"),
     Box("figures/space_time.png", "results/plots/space_time.py", "file")],
]  # fmt: skip
RANKS = [
    [Box("rank 0", "nodes it owns, and ghosts", "plain"), Box("rank 1", "nodes it owns, and ghosts", "plain")],
    [Box("elements at shared nodes", "first", "plain"), Box("elements at shared nodes ", "first", "plain")],
    [Box("platform/fem.py: SharedVector, begin, end",
         "sums of shared nodes travel while both compute the other elements")],
    [Box("kick, contact, drift", "at all local nodes, ghosts included,\nwithout a message", "plain"),
     Box("kick, contact, drift ", "at all local nodes, ghosts included,\nwithout a message", "plain")],
    [Box("platform/parallel.py: raise_on_all",
         "every 25 steps, and at a record: the error of one rank becomes that of all")],
    [Box("platform/parallel.py: gather_fields", "points in an order that no partition changes"),
     Box("rank 0 writes", "each rank writes its part of bulk.h5", "file")],
]  # fmt: skip


def rooms() -> list[list[Box]]:
    """Return the rooms of the package from the top, as the contract of imports orders them."""
    tools = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]
    contracts = tools["importlinter"]["contracts"]
    (layers,) = (contract["layers"] for contract in contracts if contract["type"] == "layers")
    text = {
        "app": "command line, checks, benchmarks", "many_runs": "studies, gradients, inference",
        "run": "model, time loop, recording", "case": "one run as a checked object",
        "lumped": "a few masses and springs",
        "readings": "instruments, misfits", "stepping": "time", "interfaces": "what acts on the bodies",
        "bodies": "elastic bodies", "results": "reading, analysis, figures", "laws": "formulas",
        "input": "text to values", "platform": "MPI, DOLFINx, compiler",
    }  # fmt: skip
    names = [line.replace("ruptfx.", "").split(" | ") for line in layers]
    return [[Box(f"{name}/: {text[name]}", "", "plain") for name in row] for row in names]


def drawings() -> dict[str, list[list[Box]]]:
    """Return the rows of boxes of every drawing, by name."""
    return {"step": STEP, "number": NUMBER, "result": RESULT, "parallel": RANKS, "where_to_add": rooms()}


def svg(rows: list[list[Box]], gap: int = GAP) -> str:
    """Return a drawing: rows of boxes with arrows from row to row, and from the first to the second box of a row."""
    shapes, top = [], 8.0
    middle = WIDTH / 2
    for number, row in enumerate(rows):
        height = 12 + LINE * max(len(lines_of(box, len(row))) for box in row)
        wide = (WIDTH - 16 - GAP * (len(row) - 1)) / len(row)
        if number:
            shapes.append(arrow(middle, top - gap, middle, top))
        for place, box in enumerate(row):
            left = 8 + place * (wide + GAP)
            shapes += drawn(box, left, top, wide, height, len(row))
            if place and box.fill != "plain":
                shapes.append(arrow(left - GAP, top + height / 2, left, top + height / 2))
        top += height + gap
    size = f'width="{WIDTH}" height="{top - gap + 8:g}"'
    head = f'<svg xmlns="http://www.w3.org/2000/svg" {size} font-family="sans-serif">'
    marker = (
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="8" markerHeight="8" orient="auto">'
        '<path d="M0,0 L8,4 L0,8 z" fill="#44566c"/></marker></defs>'
    )
    return "\n".join([head, marker, '<rect width="100%" height="100%" fill="#ffffff"/>', *shapes, "</svg>"]) + "\n"


def lines_of(box: Box, beside: int) -> list[tuple[str, str, str]]:
    """Return the lines of a box as bold, code and plain text; beside another box names have a line of their own."""
    file, _, names = box.where.partition(": ")
    apart = [(file, "", ""), *([("", names, "")] if names else [])]
    first = [(file, f"  {names}", "")] if beside == 1 or not box.text else apart
    return [*first, *(("", "", line) for line in box.text.splitlines())]


def drawn(box: Box, left: float, top: float, wide: float, height: float, beside: int) -> list[str]:
    """Return the shapes of a box.

    Raises
    ------
    ValueError
        A line is longer than its box.
    """
    shapes = [f'<rect x="{left:g}" y="{top:g}" width="{wide:g}" height="{height:g}" rx="5" fill="{FILLS[box.fill]}" '
              'stroke="#8193a8"/>']  # fmt: skip
    for number, (bold, code, plain) in enumerate(lines_of(box, beside)):
        if CHARACTER * len(bold + code + plain) > wide - 10:
            raise ValueError(f"{bold}{code}{plain}: longer than {wide:g} px")
        place = f'x="{left + 8:g}" y="{top + 18 + LINE * number:g}"'
        shapes.append(
            f'<text {place} font-size="12" fill="#12263a" xml:space="preserve">'
            f'<tspan font-weight="bold">{escape(bold)}</tspan>'
            f'<tspan font-family="monospace" font-size="11">{escape(code)}</tspan>{escape(plain)}</text>'
        )
    return shapes


def arrow(x0: float, y0: float, x1: float, y1: float) -> str:
    """Return an arrow between two points."""
    return f'<line x1="{x0:g}" y1="{y0:g}" x2="{x1:g}" y2="{y1:g}" stroke="#44566c" marker-end="url(#tip)"/>'


def main() -> None:
    """Write all drawings."""
    for name, rows in drawings().items():
        (OUT / f"{name}.svg").write_text(svg(rows, 10 if name == "where_to_add" else GAP), encoding="utf-8")
        sys.stdout.write(f"{OUT / name}.svg\n")


if __name__ == "__main__":
    main()
