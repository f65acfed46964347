"""HTML of records in notebooks, with units, and descriptions of numbers as tooltips."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Protocol

from ruptfx.input.notebook import row, shown
from ruptfx.results import summary_fields

PICTURE = 560  # largest width and height of a picture [pixels]; those of the run directory are larger


class Shown(Protocol):
    """Contract of a record that is shown."""

    @property
    def summary(self) -> Mapping[str, object] | None:
        """Scalars of the run; none before its end."""

    @property
    def figures(self) -> Sequence[Path]:
        """Files of its pictures."""


def shown_record(record: Shown) -> str:
    """Return a record as HTML: its content, its numbers, and small pictures."""
    rows = []
    for name, value in summary_fields.flat(dict(record.summary or {})).items():
        if isinstance(value, int | float | str) and not isinstance(value, bool):
            text = f"{shown(value)} {summary_fields.unit(name)}".strip()
            rows.append(row(name, text, summary_fields.DESCRIPTIONS.get(name.rpartition(".")[2], "")))
    numbers = f"<details><summary><b>summary</b></summary><table>{''.join(rows)}</table></details>" * bool(rows)
    pictures = "".join(
        f'<img alt="{escape(path.stem)}" src="data:image/png;base64,{_small(path)}">'
        for path in record.figures if path.suffix == ".png"
    )  # fmt: skip
    gallery = f'<div style="display:flex;flex-wrap:wrap;gap:8px">{pictures}</div>' * bool(pictures)
    return f"<pre>{escape(repr(record))}</pre>{numbers}{gallery}"


def _small(path: Path) -> str:
    """Return a small picture for the page, as base64."""
    from PIL import Image

    with Image.open(path) as picture, io.BytesIO() as buffer:
        small = picture.convert("RGB")
        small.thumbnail((PICTURE, PICTURE))
        small.save(buffer, format="png", optimize=True)
        return base64.b64encode(buffer.getvalue()).decode()
