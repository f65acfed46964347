"""`ruptfx check-law`: what a friction law promises, checked on examples of it, in one table and one picture."""

from __future__ import annotations

import copy
from collections.abc import Iterable
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from pydantic import ValidationError

from ruptfx import RuptfxError
from ruptfx.case import override
from ruptfx.check_law import examples
from ruptfx.check_law.checks import CHECKS, missing
from ruptfx.friction import FrictionLaw
from ruptfx.plugins import active, load
from ruptfx.schema import CaseError, find, kinds, nearest
from ruptfx.tracing import located

PACKAGE = "ruptfx.friction"
SEEDS = (0, 1, 2)


class Row(NamedTuple):
    """One line of the table."""

    check: str
    verdict: Literal["passed", "failed", "missing", "does not apply"]
    note: str = ""


class Report(NamedTuple):
    """What was found.

    Attributes
    ----------
    law : FrictionLaw
        The example that is drawn.
    rows : list of Row
    """

    law: FrictionLaw
    rows: list[Row]

    @property
    def sound(self) -> bool:
        return all(row.verdict in ("passed", "does not apply") for row in self.rows)


def check_law(law: str, changes: Iterable[str] = ()) -> list[Report]:
    """Check all friction laws of a file, or the one of that kind.

    Parameters
    ----------
    law : str
        A Python file, or a kind.
    changes : iterable of str
        ``"mu_s=0.6"``: parameters of the examples, whose numbers are arbitrary otherwise.

    Raises
    ------
    RuptfxError
        No such file or kind, no friction law in it, or parameters that it refuses.
    """
    plugins = [load(law)] if law.endswith(".py") else []
    with active(plugins):
        if plugins:
            names = list(plugins[0].classes.get(PACKAGE, {}))
        elif law in kinds(PACKAGE):
            names = [law]
        else:
            raise RuptfxError(f"check-law {law}: no file (its name ends with .py), and no kind: "
                              f"{nearest(law, kinds(PACKAGE))}")  # fmt: skip
        if not names:
            raise RuptfxError(f"check-law {law}: defines no class derived from FrictionLaw")
        return [_report(kind, list(changes)) for kind in names]


def _report(kind: str, changes: list[str]) -> Report:
    cls = find(PACKAGE, kind)
    assert issubclass(cls, FrictionLaw)
    tables = [examples.table(cls, seed) for seed in SEEDS]
    for table in tables:
        for item in changes:
            override(table, item)
    try:
        laws = [cls.model_validate(copy.deepcopy(table)) for table in tables]
    except ValidationError as error:
        raise CaseError.from_validation(error, kind) from None
    said = missing(cls)
    rows = [Row("what it says of itself", "missing" if said else "passed", ", ".join(said))]
    for name, check in CHECKS.items():
        rows.append(Row(name, "passed"))
        for seed, law in zip(SEEDS, laws, strict=True):
            try:
                with np.errstate(all="ignore"):
                    reason = check(law, seed)
            except Exception as error:  # whatever a law does is a finding
                shown = str(error) if isinstance(error, RuptfxError) else located(error, check)
                rows[-1] = Row(name, "failed", shown)
                break
            if reason:
                rows[-1] = Row(name, "does not apply", reason)
    return Report(laws[0], rows)


def save_figure(law: FrictionLaw, path: Path) -> None:
    """Draw a law into a picture.

    Raises
    ------
    RuptfxError
        It cannot be evaluated, or the file not be written.
    """
    from ruptfx.check_law.figure import draw

    try:
        with np.errstate(all="ignore"):
            draw(law).savefig(path)
    except Exception as error:
        raise RuptfxError(f"{path}: no picture ({type(error).__name__}: {error})") from error
