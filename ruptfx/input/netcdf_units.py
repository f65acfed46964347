"""Units of the variables of NetCDF files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from ruptfx.input.quantities import factor


def unit_and_factor(path: Path, name: str, attributes: Mapping[str, object], unit: str | None) -> tuple[str, float]:
    """Return the unit of a variable and its factor to another unit.

    Parameters
    ----------
    path : Path
        The file.
    name : str
        The variable.
    attributes : mapping of str to object
        Attributes of the variable.
    unit : str or None
        Target unit; None for the SI unit.

    Raises
    ------
    ValueError
        No unit, an unknown one, or one of another kind.
    """
    if "units" not in attributes:
        raise ValueError(f"{path}: '{name}' has no unit; give it an attribute units")
    given = str(attributes["units"])
    try:
        return given, float(factor(given, unit))
    except ValueError as error:
        wanted = f", write {unit} or a multiple" if unit else ""
        raise ValueError(f"{path}: '{name}' has units = '{given}': {error}; correct this attribute{wanted}") from None
