"""Units and packed values of the variables of NetCDF files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ruptfx.input.quantities import factor

if TYPE_CHECKING:
    import h5netcdf


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


def unpacked(variable: h5netcdf.Variable) -> np.ndarray:
    """Return the numbers of a variable in its unit, NaN where they are missing.

    The attributes `_FillValue` and `missing_value` name stored values that are missing; the others are multiplied by
    `scale_factor`, and `add_offset` is added (CF conventions).
    """
    stored, attributes = np.asarray(variable[...]), variable.attrs
    scale, offset = float(attributes.get("scale_factor", 1.0)), float(attributes.get("add_offset", 0.0))
    values = stored.astype(float) * scale + offset
    for name in ("_FillValue", "missing_value"):
        if name in attributes:
            values[np.isin(stored, attributes[name])] = np.nan
    return values
