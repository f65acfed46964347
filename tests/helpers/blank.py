"""Pictures without contents, for tests of the files that they are in."""

from __future__ import annotations

import pytest
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine


def leave_blank(monkeypatch: pytest.MonkeyPatch) -> None:
    """Write pictures without contents, which take most of the time of their drawing."""
    monkeypatch.setattr(Figure, "draw", lambda figure, renderer: None)
    monkeypatch.setattr(ConstrainedLayoutEngine, "execute", lambda engine, figure: None)
