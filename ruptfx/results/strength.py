"""Shear strength of the laws of a run along its interface, the upper limit of its shear traction."""

from __future__ import annotations

import numpy as np
from pydantic import ValidationError

from ruptfx import RuptfxError
from ruptfx.input.plugins import active, named
from ruptfx.input.quantities import with_prefix
from ruptfx.input.schema import Part
from ruptfx.laws.cohesion import AnyCohesion
from ruptfx.laws.friction import AnyFriction
from ruptfx.laws.nucleation import AnyNucleation
from ruptfx.results.record import Files


def strength(record: Files, rows: np.ndarray) -> np.ndarray | None:
    """Return the shear strength at some saved times along `record.interface` [Pa].

    Computed from the law of the case, weakened by its nucleation, at the saved slip rate, normal stress and state, and
    from the remaining cohesion at the saved damage. It is zero where the interface is open and has failed.

    Parameters
    ----------
    rows : ndarray of int, shape (times,)
        Indices of the saved times.

    Returns
    -------
    ndarray, shape (times, n), or None
        None if it cannot be computed: the record has no case, the case gives positions as coordinates, or its law is a
        plug-in that is not trusted.
    """
    data = record.interface
    position = data["position"].values
    name = str(data.attrs.get("fault", ""))
    try:
        laws = _laws(record, name)
        if laws is None or laws.friction is None:
            return None
        law = laws.friction.at(position)
        for nucleation in laws.nucleation:
            law = nucleation.weaken(law, position)
        cohesive: np.ndarray | float = 0.0
        if laws.cohesion is not None:
            cohesive = laws.cohesion.at(position).remaining_cohesion(data["damage"].isel(time=rows).values)
    except (RuptfxError, TypeError):  # a position given as a point has no scalar coordinate
        return None
    states = law.all_state_fields()
    names = ["slip_rate", "normal_stress", *states]
    if any(each not in data for each in names):
        return None
    rate, normal, *values = (np.asarray(data[each].isel(time=rows).values) for each in names)
    state = dict(zip(states, values, strict=True))
    with np.errstate(all="ignore"):  # a law with a direct effect has no strength at rest
        result = law.strength(np.abs(rate), np.maximum(normal, 0.0), state) + cohesive + np.zeros_like(rate)
    return np.where(np.isfinite(result), result, np.nan)


class Strength(Part):
    """The keys of an interface on which its shear strength depends."""

    friction: AnyFriction | None = None
    """Friction law."""
    cohesion: AnyCohesion | None = None
    """Cohesive law."""
    nucleation: list[AnyNucleation] = []
    """Nucleation, which may weaken the law."""


def _laws(record: Files, name: str) -> Strength | None:
    """Return the laws of an interface of the case, with the code of plug-ins only if the record is trusted."""
    table = record.case.get("faults", {}).get(name)
    if table is None:
        return None
    plugins = named(record.case, record.path) if record.trust else []
    try:
        with active(plugins):
            keys = {key: table[key] for key in Strength.model_fields if key in table}
            return Strength.model_validate(keys, context={"directory": record.path})
    except ValidationError:
        if record.case.get("plugins") and not record.trust:
            record.omitted.append(f"the strength of interface '{name}', in the figure snapshots")
        return None


def closest_to_slip(record: Files) -> str:
    """Return how near a run that never slipped came to it, and where; empty where its strength is not known."""
    data = record.interface
    if "rupture_time" not in data or np.isfinite(data["rupture_time"].values).any():
        return ""
    limit = strength(record, np.arange(len(data["time"].values)))
    if limit is None or not (limit > 0).any():
        return ""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(limit > 0, np.abs(data["shear_traction"].values) / limit, 0.0)
    when, where = np.unravel_index(np.nanargmax(ratio), ratio.shape)
    place, time = float(data["position"].values[where]), float(data["time"].values[when])
    return (
        f"largest shear traction over strength {ratio[when, where]:.2f} "
        f"at {with_prefix(place, 'm')}, {with_prefix(time, 's')}"
    )
