"""`ruptfx check-law`: check of the contract of a law or a material on examples; a table and a picture."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, Literal, NamedTuple, cast

import numpy as np
from pydantic import ValidationError

from ruptfx import RuptfxError, Table
from ruptfx.app.check_law import checks, cohesive, examples, materials
from ruptfx.case import override
from ruptfx.input.plugins import active, load
from ruptfx.input.schema import CaseError, find, kinds, nearest
from ruptfx.laws.cohesion import CohesiveLaw
from ruptfx.laws.friction import FrictionLaw
from ruptfx.laws.materials import Material
from ruptfx.platform.codegen.tracing import located

Law = FrictionLaw | CohesiveLaw | Material


class Contract(NamedTuple):
    """Contract of the laws of a folder: their name, required attributes of a class, checks of an example."""

    name: str
    missing: Callable[[Any], list[str]]
    checks: Mapping[str, Callable[[Any, int], str | None]]


CONTRACTS = {
    "ruptfx.laws.friction": Contract("friction law", checks.missing, checks.CHECKS),
    "ruptfx.laws.cohesion": Contract("cohesive law", cohesive.missing, cohesive.CHECKS),
    "ruptfx.laws.materials": Contract("material", materials.missing, materials.CHECKS),
}
SEEDS = (0, 1, 2)


class Row(NamedTuple):
    """One line of the table."""

    check: str
    verdict: Literal["passed", "failed", "missing", "does not apply"]
    note: str = ""


class Report(NamedTuple):
    """Result of the checks of a law.

    Attributes
    ----------
    name : str
        "friction law", "cohesive law" or "material".
    law : FrictionLaw, CohesiveLaw or Material
        Example for the picture.
    rows : list of Row
    """

    name: str
    law: Law
    rows: list[Row]

    @property
    def sound(self) -> bool:
        """True if no check failed."""
        return all(row.verdict in ("passed", "does not apply") for row in self.rows)


def check_law(law: str, changes: Iterable[str] = ()) -> list[Report]:
    """Check all friction laws, cohesive laws and materials of a file, or the one of that kind.

    Parameters
    ----------
    law : str
        A Python file, or a kind.
    changes : iterable of str
        ``"mu_s=0.6"``: parameters of the examples, whose numbers are arbitrary otherwise.

    Raises
    ------
    RuptfxError
        If there is no such file or kind, no law in it, or the parameters are invalid.
    """
    plugins = [load(law)] if law.endswith(".py") else []
    with active(plugins):
        defined = plugins[0].classes if plugins else {package: kinds(package) for package in CONTRACTS}
        items = [(package, kind) for package in CONTRACTS for kind in defined.get(package, {})]
        if not plugins:
            known = [kind for _, kind in items]
            items = [(package, kind) for package, kind in items if kind == law]
            if not items:
                raise RuptfxError(f"check-law {law}: no file (its name ends with .py), and no kind: "
                                  f"{nearest(law, known)}")  # fmt: skip
        if not items:
            raise RuptfxError(f"check-law {law}: defines no class derived from FrictionLaw, CohesiveLaw or Material")
        return [_report(package, kind, list(changes)) for package, kind in items]


def _report(package: str, kind: str, changes: list[str]) -> Report:
    cls, contract = find(package, kind), CONTRACTS[package]

    def change(table: Table) -> None:
        for item in changes:
            override(table, item)

    tables = examples.tables(cls, len(SEEDS), change)
    try:
        laws: list[Law] = [cast("Law", cls.model_validate(copy.deepcopy(table))) for table in tables]
    except ValidationError as error:
        raise CaseError.from_validation(error, kind) from None
    said = contract.missing(cls)
    rows = [Row("required attributes", "missing" if said else "passed", ", ".join(said))]
    for name, check in contract.checks.items():
        rows.append(Row(name, "passed"))
        for seed, law in zip(SEEDS, laws, strict=True):
            try:
                with np.errstate(all="ignore"):
                    reason = check(law, seed)
            except Exception as error:  # any error in a law is a failed check
                shown = str(error) if isinstance(error, RuptfxError) else located(error, check)
                rows[-1] = Row(name, "failed", shown)
                break
            if reason:
                rows[-1] = Row(name, "does not apply", reason)
    return Report(contract.name, laws[0], rows)


def save_figure(law: Law, path: Path) -> None:
    """Draw a law and save the picture.

    Raises
    ------
    RuptfxError
        If the law cannot be evaluated.
    OSError
        The file is not writable.
    """
    from ruptfx.app.check_law import figure

    try:
        with np.errstate(all="ignore"):
            drawn = (
                figure.draw_cohesive(law) if isinstance(law, CohesiveLaw)
                else figure.draw_material(law) if isinstance(law, Material) else figure.draw(law)
            )  # fmt: skip
            drawn.savefig(path)
    except OSError:
        raise
    except Exception as error:
        raise RuptfxError(f"{path.name}: no picture ({type(error).__name__}: {error})") from error
