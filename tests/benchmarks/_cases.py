"""Cases of benchmarks: a TOML file of the same name beside each, which `ruptfx run` takes, too."""

from __future__ import annotations

from pathlib import Path

from ruptfx import Table
from ruptfx.case import Case, parse_case, read_toml
from ruptfx.input.schema import set_key


def table_of(name: str) -> Table:
    """Return the tables of the case of a benchmark, unchecked."""
    return read_toml(Path(__file__).with_name(f"{name}.toml"))


def case_of(name: str, changes: Table) -> Case:
    """Return the case of a benchmark with other values of dotted keys."""
    table = table_of(name)
    for key, value in changes.items():
        set_key(table, key, value)
    case = parse_case(table)
    assert isinstance(case, Case)
    return case
