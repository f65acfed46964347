"""The tangent stiffness of a material from its energy."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from ruptfx import RuptfxError


@lru_cache
def tangent_stiffness(material: Any, plane: str) -> np.ndarray:
    """Second derivative of the strain energy density at zero strain [Pa].

    Parameters
    ----------
    material : Material
    plane : str

    Returns
    -------
    ndarray, shape (d, d, d, d); in antiplane (d, d)
        C_ijkl with the symmetries of strain.

    Raises
    ------
    RuptfxError
        An energy that depends on more than the strain.
    """
    import ufl

    dim = 3 if plane == "solid" else 2
    at_rest = np.zeros((dim,) if plane == "antiplane" else (dim, dim))
    strain = ufl.variable(ufl.as_tensor(at_rest.tolist()))
    try:
        slope = ufl.diff(material.energy_density(strain, plane), strain)
        tangent = ufl.algorithms.expand_derivatives(ufl.diff(slope, strain))
        origin = (0.0,) * dim
        values = [float(tangent(origin, component=entry)) for entry in np.ndindex(tangent.ufl_shape)]
        stiffness = np.reshape(values, tangent.ufl_shape)
        if not np.all(np.isfinite(stiffness)):
            raise ValueError("it is not finite at zero strain")
        _refuse_places(tangent)
    except Exception as error:
        raise RuptfxError(
            f"material '{material.kind()}': its stiffness does not follow from its energy alone ({error}), which "
            "absorbing edges and radiation damping need; define its method `impedance`"
        ) from None
    if stiffness.ndim == 4:
        stiffness = 0.5 * (stiffness + stiffness.swapaxes(0, 1))
        stiffness = 0.5 * (stiffness + stiffness.swapaxes(2, 3))
    stiffness.setflags(write=False)
    return stiffness


def _refuse_places(expression: Any) -> None:
    """What varies from place to place has a value at the origin, but that is not the one of an edge."""
    from ufl.corealg.traversal import traverse_unique_terminals
    from ufl.geometry import GeometricQuantity

    if any(isinstance(item, GeometricQuantity) for item in traverse_unique_terminals(expression)):
        raise ValueError("it varies from place to place")
