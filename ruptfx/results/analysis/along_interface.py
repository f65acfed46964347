"""Stresses in a body along an interface, in addition to the tractions of the interface."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy

from ruptfx import RuptfxError
from ruptfx.results.analysis.raster import body_of_cells

if TYPE_CHECKING:
    from ruptfx.results.record import Files

Array = np.ndarray
NEAR = 1e-6  # of the length of an interface: largest distance of a body node from its interface point


def body_stress(record: Files, time: float, body: str = "") -> tuple[float, dict[str, Array]]:
    """Return the stress in a body at the points of `record.interface`, at the snapshot nearest to a time.

    The components across the interface equal its traction up to the discretisation error; the one along it is new.

    Parameters
    ----------
    record : Record or Files
        With `stress` in its snapshots.
    time : float
        [s]
    body : str
        Name; default is the first body that has nodes on the interface.

    Returns
    -------
    time : float
        Of the snapshot [s].
    stress : dict of ndarray, shape (points,)
        ``xx``, ``yy`` and ``xy`` [Pa], positive in tension; NaN where the body has no node.

    Raises
    ------
    RuptfxError
        No stresses of a plane were saved, or no such body.
    """
    bulk, data = record.bulk, record.interface
    if "stress" not in bulk or bulk["points"].shape[1] != 2 or bulk["stress"].shape[-1] != 3:
        raise RuptfxError(f"{record.path}: no stresses of a plane were saved; add 'stress' to output.bulk_fields")
    if not bulk.sizes["time"]:
        raise RuptfxError(f"{record.path}: no snapshot of the bodies was saved; give output.bulk_interval")
    names = [str(name) for name in np.atleast_1d(bulk.attrs.get("bodies", []))]
    if body and body not in names:
        raise RuptfxError(f"body = {body}: no such body, there are {', '.join(names)}")
    points, cells, owner = bulk["points"].values, bulk["cells"].values, body_of_cells(bulk)
    places = np.stack([data["x"].values, data["y"].values], axis=1)
    reach = NEAR * float(np.ptp(places, axis=0).max())
    row = int(np.abs(bulk["time"].values - time).argmin())
    stress = bulk["stress"].isel(time=row).values
    for name in [body] if body else names:
        nodes = np.unique(cells[owner == names.index(name)])
        distance, nearest = scipy.spatial.cKDTree(points[nodes]).query(places)
        there = distance <= reach
        if there.any() or body:
            break
    values = np.where(there[:, None], stress[nodes[nearest]], np.nan)
    return float(bulk["time"].values[row]), dict(zip(("xx", "yy", "xy"), values.T, strict=True))
