"""The shear strength that the laws of a run give along its interface: what its shear traction comes up to."""

from __future__ import annotations

import numpy as np
from pydantic import ValidationError

from ruptfx import RuptfxError
from ruptfx.case import FaultCase
from ruptfx.plugins import active, named
from ruptfx.record import Files


def strength(record: Files, rows: np.ndarray) -> np.ndarray | None:
    """Shear strength at some saved times along the first interface [Pa].

    From the law of the case, weakened as its nucleation does, at the saved slip rate, normal stress and state, and
    from the cohesion that its damage has left. It is zero where the interface is open and broken.

    Parameters
    ----------
    record : Record or Files
    rows : ndarray of int, shape (times,)
        Numbers of the saved times.

    Returns
    -------
    ndarray, shape (times, n), or None
        None where the record does not tell it: its case is not there, names places by coordinates, or has a law of a
        plug-in and is not trusted.
    """
    data = record.interface
    position = data["position"].values
    name = str(data.attrs.get("fault", ""))
    try:
        fault = _fault(record, name)
        if fault is None:
            return None
        law = fault.friction.at(position)
        for nucleation in fault.nucleation:
            law = nucleation.weaken(law, position)
        bond = fault.cohesion
        held = 0.0 if bond is None else bond.at(position).left_strength(data["damage"].isel(time=rows).values)
    except (RuptfxError, TypeError):  # a place that is a point on the interface is no number
        return None
    states = law.all_state_fields()
    names = ["slip_rate", "normal_stress", *states]
    if any(each not in data for each in names):
        return None
    rate, normal, *values = (np.asarray(data[each].isel(time=rows).values) for each in names)
    state = dict(zip(states, values, strict=True))
    with np.errstate(all="ignore"):  # a law with a direct effect has no strength at rest
        found = law.strength(np.abs(rate), np.maximum(normal, 0.0), state) + held + np.zeros_like(rate)
    return np.where(np.isfinite(found), found, np.nan)


def _fault(record: Files, name: str) -> FaultCase | None:
    """Return the interface as its case has it, with the code of plug-ins only where the record is trusted."""
    table = record.case.get("faults", {}).get(name)
    if table is None:
        return None
    plugins = named(record.case, record.path) if record.trust else []
    try:
        with active(plugins):
            return FaultCase.model_validate(table, context={"directory": record.path})
    except ValidationError:
        if record.case.get("plugins") and not record.trust:
            record.omitted.append(f"the strength of interface '{name}', in the figure snapshots")
        return None
