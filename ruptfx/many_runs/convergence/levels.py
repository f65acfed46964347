"""The runs of `ruptfx converge`, as a study over coarser meshes and longer steps, and its products."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from pydantic import ValidationError

from ruptfx import RuptfxError, Table
from ruptfx.case import Case, override, read_case
from ruptfx.input.schema import CaseError, dotted_keys, value_at
from ruptfx.many_runs.convergence.estimates import Estimate, Row, estimate, unresolved
from ruptfx.many_runs.convergence.readings import readings, shared
from ruptfx.many_runs.study.definition import Study
from ruptfx.many_runs.study.execute import run_study
from ruptfx.platform.run_files import SUMMARY, replace_summary, write_json
from ruptfx.results.outputs import Outputs

RATIO = 2.0  # of the spacings of two levels
FAMILIES = ("mesh", "step")
STEP_KEYS = ("time_step", "tolerance", "rate_tolerance")
"""Keys of steppers that set the length of their steps, in the order of their preference."""
PRODUCTS = ("converge.json", "converge.csv", "converge.png")


@dataclass(frozen=True)
class Convergence:
    """Result of `converge`.

    Attributes
    ----------
    rows : list of Row
    run : Path
        Directory of the run of the case as it is.
    spacings : dict of str to list of float
        Spacing over that of the case, by family.
    notes : list of str
        Levels without a result, with the reason.
    files : list of Path
    warning : str
        Why the levels do not resolve the case; empty if they do.
    """

    rows: list[Row]
    run: Path
    spacings: Mapping[str, list[float]]
    notes: list[str]
    files: list[Path]
    warning: str


def converge(
    case: Path, out: Path, *, changes: Iterable[str] = (), levels: int = 3, of: Sequence[str] = ("mesh",),
    **options: bool | int | str | None,
) -> Convergence:  # fmt: skip
    """Run a case and coarser ones, and estimate the error of every number; the finest run keeps them in its summary.

    Parameters
    ----------
    case, out : Path
        Case file, and directory of the runs; an existing one of the same case is continued.
    changes : iterable of str
        ``"mesh.element_size=2e-3"``: keys of the case.
    levels : int
        Number of spacings of each family, at least 2.
    of : sequence of str
        mesh, step.
    options
        `ranks`, and those of `run_study`: scheduler, cores, retry, show, overwrite.

    Raises
    ------
    RuptfxError
        The case has no spacing, or the run of the case or those of all coarser ones failed.
    """
    items = list(changes)
    parsed = read_case(case, overrides=items)
    if not isinstance(parsed, Case):
        raise RuptfxError(f"converge {case}: {parsed.kind()} is a lumped model without a mesh; use a case with bodies")
    ranks = options.pop("ranks", 1)
    study, factors = _study(case, parsed, items, levels, of, ranks)
    outcome = run_study(study, out, **options)  # type: ignore[arg-type]
    results = {point.coordinates["level"]: (point, result) for point, result in outcome.points}
    name = _label(1.0, of[0])
    point, first = results[name]
    if first["status"] == "failed":
        raise RuptfxError(f"converge {case}: the run of the case failed: {first['error']}")
    notes = [f"{label}: {result['error']}" for label, (_, result) in results.items() if result["status"] == "failed"]
    read = {
        label: readings(out / "points" / each.hash / "run", result["values"], parsed.plane)
        for label, (each, result) in results.items() if result["status"] != "failed"
    }  # fmt: skip
    families: dict[str, dict[str, tuple[str, Estimate]]] = {}
    spacings: dict[str, list[float]] = {}
    for family in of:
        known = [factor for factor in factors if _label(factor, family) in read]
        if len(known) < 2:
            raise RuptfxError(
                f"converge {case}: no coarser level of {family} has a result ({'; '.join(notes)}); use a case whose "
                f"spacing may be {RATIO:g} times larger"
            )
        spacings[family] = known
        table = shared([read[_label(factor, family)] for factor in known])
        families[family] = {quantity: (unit, estimate(values, known)) for quantity, unit, values in table}
    rows = list(_rows(families))
    run = out / "points" / point.hash / "run"
    attach(run, rows)
    warning = unresolved(rows)
    files = _write(out, rows, spacings, warning, bool(options.get("overwrite")))
    return Convergence(rows, run, spacings, notes, files, warning)


def _label(factor: float, family: str) -> str:
    return "as given" if factor == 1 else f"{family} x {factor:g}"


def _study(
    path: Path, case: Case, changes: Iterable[str], levels: int, of: Sequence[str], ranks: object
) -> tuple[Study, list[float]]:
    """Return the study of all levels and the factors of the spacing."""
    if levels < 2:
        raise RuptfxError(
            f"--levels {levels}: an error bar needs 2 levels or more; use 3, with which the order is known"
        )
    keys: dict[str, float] = {}
    members: dict[str, list[str]] = {}
    for family in of:
        if family not in FAMILIES:
            raise RuptfxError(f"--of {family}: give {', '.join(FAMILIES)}, or {','.join(FAMILIES)}")
        values = _mesh_keys(case) if family == "mesh" else _step_keys(case)
        keys |= values
        members[family] = list(values)
    factors = [RATIO**level for level in range(levels)]
    rows, labels = [], []
    for family in of:
        for factor in factors:
            if _label(factor, family) not in labels:
                labels.append(_label(factor, family))
                rows.append([value * (factor if key in members[family] else 1.0) for key, value in keys.items()])
    table: Table = {}
    for item in changes:
        override(table, item)
    for key in keys:
        _remove(table, key)  # the axis has its value
    try:
        study = Study.model_validate(
            {
                "title": f"convergence of {path.name}", "case": str(path.resolve()), "set": table, "ranks": ranks,
                "axes": [{"key": list(keys), "name": "level", "values": rows, "labels": labels}], "keep": ["run"],
            },
            context={"directory": path.resolve().parent},
        )  # fmt: skip
    except ValidationError as error:
        raise CaseError.from_validation(error) from None
    return study, factors


def _remove(table: Table, key: str) -> None:
    """Remove the value of a dotted key from nested tables that may not have it."""
    *parents, last = key.split(".")
    node: object = table
    for name in parents:
        node = node.get(name) if isinstance(node, dict) else None
    if isinstance(node, dict):
        node.pop(last, None)


def _mesh_keys(case: Case) -> dict[str, float]:
    keys = [f"mesh.{key}" for key in dotted_keys(case.mesh) if key.rpartition(".")[2] == "element_size"]
    values = {key: value for key in keys if isinstance(value := value_at(case, key), float)}
    if not values:
        raise RuptfxError(
            f"converge: mesh.kind = '{case.mesh.kind()}' has no element_size to make larger; use a mesh that has one, "
            "or --of step"
        )
    return values


def _step_keys(case: Case) -> dict[str, float]:
    for name in STEP_KEYS:
        value = getattr(case.stepper, name, None)
        if isinstance(value, float):
            return {f"stepper.{name}": value}
    raise RuptfxError(
        f"converge --of step: stepper.kind = '{case.stepper.kind()}' chooses its step itself; give stepper.time_step, "
        "or use --of mesh: explicit steps follow the mesh, and its bar contains their error"
    )


def _rows(families: Mapping[str, Mapping[str, tuple[str, Estimate]]]) -> Iterable[Row]:
    first = next(iter(families.values()))
    for name, (unit, one) in first.items():
        zero = all(value == 0 for family in families.values() if name in family for value in family[name][1].values)
        if not zero and all(name in family for family in families.values()):
            by = {family: table[name][1] for family, table in families.items()}
            yield Row(name, unit, one.value, sum(each.bar for each in by.values()), by)


def attach(run: Path, rows: Iterable[Row]) -> None:
    """Write the error bars into the summary of a complete run."""
    bars = {row.name: {"bar": row.bar, "of": " and ".join(row.by), "outside": row.outside} for row in rows}
    summary = json.loads((run / SUMMARY).read_text(encoding="utf-8"))
    replace_summary(run, {**summary, "error_bars": bars})


def _write(
    out: Path, rows: list[Row], spacings: Mapping[str, list[float]], warning: str, overwrite: bool
) -> list[Path]:
    from ruptfx.many_runs.convergence import figure

    with Outputs(out, overwrite=overwrite) as files:
        numbers = [{**asdict(row), "outside": row.outside} for row in rows]
        write_json(
            files.claim(PRODUCTS[0]),
            {"spacings": dict(spacings), "warning": warning, "numbers": [_finite(each) for each in numbers]},
        )
        with files.claim(PRODUCTS[1]).open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(["quantity", "unit", "value", "bar", "family", "extrapolated", "order", "outside"])
            for row in rows:
                for family, each in row.by.items():
                    order = "" if each.order is None else f"{each.order:.6g}"
                    writer.writerow([row.name, row.unit, repr(row.value), repr(row.bar), family,
                                     repr(each.extrapolated), order, each.outside])  # fmt: skip
        figure.draw(rows, spacings).savefig(files.claim(PRODUCTS[2]))
    return [out / name for name in PRODUCTS]


def _finite(node: object) -> object:
    """Return a table in which numbers that JSON does not have are null."""
    if isinstance(node, Mapping):
        return {key: _finite(value) for key, value in node.items()}
    if isinstance(node, list | tuple):
        return [_finite(value) for value in node]
    return None if isinstance(node, float) and not math.isfinite(node) else node
