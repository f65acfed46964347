"""HTML of cases and records in notebooks, with units, and descriptions of keys as tooltips."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Protocol

from ruptfx.input.schema import Alternative, Part, descriptions, first_line, unit_of
from ruptfx.results import summary_fields

PICTURE = 560  # largest width and height of a picture [pixels]; those of the run directory are larger
MOST_NUMBERS = 6  # largest number of entries shown of a list


class Shown(Protocol):
    """Contract of a record that is shown."""

    @property
    def summary(self) -> Mapping[str, object] | None:
        """Scalars of the run; none before its end."""

    @property
    def figures(self) -> Sequence[Path]:
        """Files of its pictures."""


def shown_part(part: Part) -> str:
    """Return a part of a case as foldable tables; default values are grey."""
    name = part.kind() if isinstance(part, Alternative) else type(part).__name__
    return _unfolded(name, part, True)


def _unfolded(name: str, part: Part, unfold: bool) -> str:
    rows, inner, said = [], [], descriptions(type(part))
    for key in type(part).model_fields:
        value = getattr(part, key)
        parts = dict(_parts_in(key, value))
        if parts:
            inner += [_unfolded(where, item, False) for where, item in parts.items()]
        elif value is not None and value != []:
            unit = unit_of(type(part), key)
            text = _shown(value) + (f" {unit}" if unit != "1" else "")
            rows.append(_row(key, text, said.get(key, ""), key in part.model_fields_set))
    kind = f" <i>{escape(part.kind())}</i>" if isinstance(part, Alternative) and part.kind() != name else ""
    head = f'<summary title="{escape(first_line(type(part)))}"><b>{escape(name)}</b>{kind}</summary>'
    body = f"<table>{''.join(rows)}</table>" * bool(rows) + "".join(inner)
    return f'<details style="margin-left:1em"{" open" * unfold}>{head}{body}</details>'


def _parts_in(key: str, value: object) -> list[tuple[str, Part]]:
    """Return the parts inside a key, by their dotted keys."""
    if isinstance(value, Part):
        return [(key, value)]
    items = value.items() if isinstance(value, Mapping) else enumerate(value) if isinstance(value, list) else ()
    return [(f"{key}.{name}", item) for name, item in items if isinstance(item, Part)]


def _row(name: str, text: str, meaning: str, given: bool = True) -> str:
    style = "text-align:left" if given else "text-align:left;opacity:.55"
    title = escape(" ".join(meaning.split()))
    cells = f'<td style="{style}" title="{title}">{escape(name)}</td><td style="{style}">{escape(text)}</td>'
    return f"<tr>{cells}</tr>"


def _shown(value: object) -> str:
    if isinstance(value, list):
        text = ", ".join(_shown(item) for item in value[:MOST_NUMBERS])
        return f"[{text}, ... {len(value)} in all]" if len(value) > MOST_NUMBERS else f"[{text}]"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def shown_record(record: Shown) -> str:
    """Return a record as HTML: its content, its numbers, and small pictures."""
    rows = []
    for name, value in (record.summary or {}).items():
        if isinstance(value, int | float | str) and not isinstance(value, bool):
            text = f"{_shown(value)} {summary_fields.unit(name)}".strip()
            rows.append(_row(name, text, summary_fields.DESCRIPTIONS.get(name, "")))
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
