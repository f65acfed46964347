"""A benchmark in parts, each on its own: what one cannot measure is a failed check, and the others are kept."""

from __future__ import annotations

import math
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from ruptfx import RuptfxError, Table
from ruptfx.bench import Check
from ruptfx.terminal import console


@dataclass
class Parts:
    """What came of all parts.

    Attributes
    ----------
    checks : list of Check
    rows : list of dict
        Of every part its name, `part`, and the time it took by the clock, `seconds`.
    """

    checks: list[Check] = field(default_factory=list)
    rows: list[Table] = field(default_factory=list)

    @contextmanager
    def one(self, name: str) -> Iterator[None]:
        """Measure a part inside; an error of the product, or a process that takes for ever, ends this part only."""
        began, known = time.perf_counter(), len(self.checks)
        try:
            yield
        except (RuptfxError, subprocess.TimeoutExpired) as error:
            self.checks.append(Check(f"{name}: was measured", 1.0, math.nan, source=str(error)[:300]))
        seconds = time.perf_counter() - began
        self.rows.append({"part": name, "seconds": seconds})
        said = console(stderr=True)
        said.print(f"{name}: {seconds:.0f} s", highlight=False)
        for check in self.checks[known:]:  # whoever does not wait for the end has them
            said.print(f"  {check.quantity}: {check.found:.4g}, expected {check.expected:.4g}", highlight=False)


def ratio(part: float, whole: float) -> float:
    """One over the other; not a number, which no check passes, over nothing."""
    return part / whole if whole else math.nan
