"""Tables of saved speeds from their rows, for the terminal and the site; does not need DOLFINx."""

from __future__ import annotations

from collections.abc import Sequence

from ruptfx import Table

Cells = tuple[str, ...]

STEPS = (
    "element", "nodes", "ranks", "M updates /s /core", "bytes /node", "x ufl_form", "x stock ufl", "x PETSc",
    "of bandwidth", "interface", "x double", "speed-up",
)  # fmt: skip


def _number(value: float | None, form: str) -> str:
    return "" if value is None else format(value, form)


def step_rows(rows: Sequence[Table]) -> list[Cells]:
    """Return the cells below the header `STEPS` for the rows of steps."""
    return [
        (
            f"{row['dim']}D order {row['order']} {row['geometry']}", f"{row['nodes'] / 1e6:.2f} M", str(row["ranks"]),
            f"{row['node_updates_per_second_per_core'] / 1e6:.0f}", f"{row['bytes_per_node']:.0f}",
            _number(row["ratio_to_ufl_form"], ".0f"), _number(row["ratio_to_stock_ufl_form"], ".0f"),
            _number(row["ratio_to_petsc"], ".1f"), _number(row["ratio_to_bandwidth"], ".0%"),
            _number(row["interface_share"], ".1%"), _number(row.get("ratio_of_single"), ".2f"),
            _number(row["efficiency"], ".2f"),
        )
        for row in rows if "order" in row
    ]  # fmt: skip


def phase_table(rows: Sequence[Table]) -> tuple[Cells, list[Cells]]:
    """Return header and cells: one column per whole command, one row per phase, seconds with the share."""
    entries = {(row["problem"], row["ranks"], row["phase"]): row for row in rows if "phase" in row}
    commands = list(dict.fromkeys((problem, ranks) for problem, ranks, _ in entries))

    def cell(command: tuple[str, int], name: str) -> str:
        row = entries.get((*command, name))
        if row is None:
            return ""
        return f"{row['seconds']:.2f}" + ("" if name in OUTSIDE else f" ({row['share']:.0%})")

    header = ("phase, seconds (share)", *(f"{problem}, {ranks} rank{'s' * (ranks > 1)}" for problem, ranks in commands))
    names = dict.fromkeys(name for *_, name in entries)
    return header, [(name, *(cell(command, name) for command in commands)) for name in names]


OUTSIDE = ("wall",)  # rows of whole commands that are not phases

# First measured value of every aim, by quantity.
FIRST = (
    ("fault problem, 100 m: whole command over its steps", 5.3),
    ("fault problem, 50 m: whole command over its steps", 2.7),
    ("fault problem, 50 m: time loop on 1 rank over 2", 1.36),
    ("impact demo, 2 ranks, figures included", 11.0),
    ("fault problem, 100 m: command to first step", 2.5),
    ("fault problem, 100 m: figures", 3.0),
    ("3D order 4 affine, 1 M nodes, interface share of a step", 0.32),
    ("mode map of 180 runs, 2 cores", 418.0),
)
AIMS = ("quantity", "at first", "aim", "reached", "")


def aim_rows(*saved: Table) -> list[Cells]:
    """Return the cells below `AIMS` from the checks of saved benchmarks; unmeasured aims are marked."""
    checks = {check["quantity"]: check for each in saved for check in each["checks"]}
    rows: list[Cells] = []
    for quantity, first in FIRST:
        check = checks.get(quantity)
        if check is None:
            rows.append((quantity, f"{first:g}", "", "not measured", ""))
            continue
        unit = "" if check["unit"] == "1" else f" {check['unit']}"
        aim, result = f"{check['relation']} {check['expected']:g}{unit}", f"{check['found']:.3g}{unit}"
        rows.append((quantity, f"{first:g}{unit}", aim, result, "reached" if check["passed"] else "missed"))
    return rows


CHOICE = ("elements or run", "precision", "time (s)", "bytes per node")
# Rows of `CHOICE`: dimension, order, geometry, nodes, text, end of the check of `bench precision` with their ratio.
CHOSEN = (
    (2, 4, "affine", 350_000, "2D, order 4, parallel edges", "2D order 4"),
    (2, 5, "affine", 350_000, "2D, order 5, parallel edges", ""),
    (2, 4, "general", 350_000, "2D, order 4, any edges", ""),
    (3, 4, "affine", 1_000_000, "3D, order 4, parallel edges", "3D order 4"),
    (3, 4, "general", 1_000_000, "3D, order 4, any edges", ""),
)


def choice_rows(speed: Table, precision: Table, whole: Sequence[Table]) -> list[Cells]:
    """Return the cells below `CHOICE`: a million nodes and 1000 steps of both precisions, then whole runs.

    Parameters
    ----------
    speed, precision : dict
        Saved results of `bench speed` and `bench precision`; the latter have ratios for rows of the former without one.
    whole : sequence of dict
        Saved results of `bench tpv5_time`, on one and on two ranks.
    """
    ratios = {check["quantity"].rpartition(", ")[2]: check["found"] for check in precision["checks"]}
    rows: list[Cells] = []
    for *wanted, text, also in CHOSEN:
        for row in speed["rows"]:
            if [row.get(key) for key in ("dim", "order", "geometry", "asked")] != wanted or row["ranks"] > 1:
                continue
            seconds = 1e9 / row["node_updates_per_second_per_core"]
            rows.append((text, "double", f"{seconds:.1f}", f"{row['bytes_per_node']:.0f}"))
            ratio = row.get("ratio_of_single") or ratios.get(also)
            if ratio:
                held = _number(row.get("single_bytes_per_node"), ".0f")
                rows.append((text, "single", f"{seconds / ratio:.1f}", held))
    for check in (check for each in whole for check in each["checks"]):
        what, nodes, kind, ranks = check["quantity"].split(", ")
        rows.append((f"TPV5, {what}, {nodes}, {ranks}", kind, f"{check['found']:.0f}", ""))
    return rows


SIZES = ("million nodes", "time per node and step (ns)", "largest memory per node (bytes)")
RANKS = (
    "million nodes", "ranks", "elements", "ghost nodes", "read and written in a step (MB)", "over an equal share",
    "messages in a step", "sent in a step (MB)",
)  # fmt: skip


def size_rows(rows: Sequence[Table]) -> list[Cells]:
    """Return the cells below `SIZES` for the rows of `bench scaling`."""
    return [
        (f"{row['nodes'] / 1e6:.2f}", f"{1e9 * row['seconds_per_node']:.1f}", f"{row['peak_per_node']:.0f}")
        for row in rows if "seconds_per_node" in row
    ]  # fmt: skip


def rank_rows(rows: Sequence[Table]) -> list[Cells]:
    """Return the cells below `RANKS` for the rows of `bench scaling`."""
    counted = [row for row in rows if "held" in row]
    share = next((row["held"] for row in counted if row["ranks"] == 1), None)
    return [
        (
            f"{row['nodes'] / 1e6:.2f}", str(row["ranks"]), str(row["elements"]), str(row["ghosts"]),
            f"{row['held'] / 1e6:.1f}", "" if share is None else f"{row['held'] * row['ranks'] / share:.2f}",
            str(row["messages"]), f"{row['sent'] / 1e6:.2f}",
        )
        for row in counted
    ]  # fmt: skip
