"""Independent parts of one benchmark: a part that raises an error is a failed check, the others are kept."""

from __future__ import annotations

import math
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from ruptfx import RuptfxError, Table
from ruptfx.app.bench import Check
from ruptfx.platform.terminal import console


@dataclass
class Parts:
    """Checks and rows of all parts of a benchmark.

    Attributes
    ----------
    checks : list of Check
    rows : list of dict
        Name (`part`) and wall-clock time (`seconds`) of every part.
    """

    checks: list[Check] = field(default_factory=list)
    rows: list[Table] = field(default_factory=list)

    @contextmanager
    def one(self, name: str) -> Iterator[None]:
        """Measure one part inside the context; an error or a time-out of a subprocess ends only this part."""
        began, known = time.perf_counter(), len(self.checks)
        try:
            yield
        except (RuptfxError, subprocess.TimeoutExpired) as error:
            self.checks.append(Check(f"{name}: was measured", 1.0, math.nan, source=str(error)[:300]))
        seconds = time.perf_counter() - began
        self.rows.append({"part": name, "seconds": seconds})
        said = console(stderr=True)
        said.print(f"{name}: {seconds:.0f} s", highlight=False)
        for check in self.checks[known:]:  # printed at once, so that an interrupted benchmark shows them
            said.print(f"  {check.quantity}: {check.found:.4g}, expected {check.expected:.4g}", highlight=False)


def ratio(part: float, whole: float) -> float:
    """Return part / whole, NaN (which no check passes) if `whole` is zero."""
    return part / whole if whole else math.nan
