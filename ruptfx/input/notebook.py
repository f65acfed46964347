"""HTML of cases in notebooks, with units, and descriptions of keys as tooltips."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape

from ruptfx.input.schema import Alternative, Part, descriptions, first_line, unit_of

MOST_NUMBERS = 6  # largest number of entries shown of a list


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
            text = shown(value) + (f" {unit}" if unit != "1" else "")
            rows.append(row(key, text, said.get(key, ""), key in part.model_fields_set))
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


def row(name: str, text: str, meaning: str, is_set: bool = True) -> str:
    """Return a row of a table: a name with its meaning as tooltip, and a text, which is grey by default."""
    style = "text-align:left" if is_set else "text-align:left;opacity:.55"
    title = escape(" ".join(meaning.split()))
    cells = f'<td style="{style}" title="{title}">{escape(name)}</td><td style="{style}">{escape(text)}</td>'
    return f"<tr>{cells}</tr>"


def shown(value: object) -> str:
    """Return a value as text, long lists shortened."""
    if isinstance(value, list):
        text = ", ".join(shown(item) for item in value[:MOST_NUMBERS])
        return f"[{text}, ... {len(value)} in all]" if len(value) > MOST_NUMBERS else f"[{text}]"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
