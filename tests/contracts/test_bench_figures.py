"""Figures of all benchmarks, found by their names: no label lies on another or is cut off.

Those that take longer than a second to compute are drawn with `-m slow`.
"""

from __future__ import annotations

import ast
import importlib
from pathlib import Path

import pytest
from labels import label_faults

import ruptfx.bench
from ruptfx.bench import OF_THE_MACHINE, Outcome
from ruptfx.schema import own_kinds

pytest.importorskip("dolfinx")

FOLDER = Path(ruptfx.bench.__file__).parent
QUICK = ("waves", "cohesive_opening", "impact_bar")


def draws(name: str) -> bool:
    """Whether its outcome has a figure: read, as it takes the run to know."""
    tree = ast.parse((FOLDER / f"{name}.py").read_text())
    made = [node for node in ast.walk(tree) if isinstance(node, ast.Call) and ast.unparse(node.func) == "Outcome"]
    return any(len(call.args) > 1 or any(word.arg == "draw" for word in call.keywords) for call in made)


NAMES = [name for name in own_kinds("ruptfx.bench") if name not in OF_THE_MACHINE and draws(name)]


@pytest.mark.fem
@pytest.mark.parametrize(
    "name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in NAMES]
)
def test_labels_keep_apart(name: str) -> None:
    from ruptfx import fem

    outcome = importlib.import_module(f"ruptfx.bench.{name}").run(False, fem.MPI.COMM_WORLD)
    assert isinstance(outcome, Outcome) and outcome.draw is not None
    figure = outcome.draw()
    figure.set_dpi(150)
    assert label_faults(figure) == []
