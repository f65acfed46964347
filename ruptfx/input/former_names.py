"""Names of the last version, which this one reads with a note.

Keys and kinds of a case are declared where they are (`Part.former_keys`, `Alternative.former_kinds`), columns here.
"""

from __future__ import annotations

import warnings

FORMER_COLUMNS = {
    "impact": "impact_loss", "facing": "pairing_update_loss", "turning": "rotation_error",
    "facing_position": "paired_position", "facing_x": "paired_x", "facing_y": "paired_y",
}  # fmt: skip
"""Columns of the energy table and fields of interfaces by their names in the last version."""


class FormerName(FutureWarning):
    """Warning of a name of the last version."""


def warn_of_former(what: str, former: str, name: str) -> None:
    """Warn that a key, a kind or a column was renamed."""
    message = f"{what} '{former:.60}' is now called '{name}'; the next version will not read the former name"
    warnings.warn(message, FormerName, stacklevel=2)
