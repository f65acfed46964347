"""Contact light: real contact area along an interface, as seen on glass blocks lit along their interface.

Rough surfaces touch on a small part A of the nominal area only. The model is

    A / A_nominal = sigma_n / H (1 + B ln(1 + theta / theta_c)),

proportional to the normal stress over the indentation hardness H, as of plastic contacts (Bowden and Tabor), and
growing with the logarithm of the age theta of the contacts, as they creep (seen by Dieterich and Kilgore 1994); slip
renews them and lowers theta. H, B and the cut-off theta_c are material parameters of this model: no law of friction
contains them. It is a model of the light, not part of the run.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ruptfx import RuptfxError

if TYPE_CHECKING:
    import xarray

    from ruptfx.results.record import Record

Array = np.ndarray


def real_contact_area(
    normal_stress: Array, hardness: float, age: Array | float = 0.0, growth: float = 0.0, cutoff: float = 1.0
) -> Array:
    """Return the real over the nominal contact area; zero where the interface is open.

    Parameters
    ----------
    normal_stress : ndarray
        sigma_n [Pa], positive in compression.
    hardness : float
        H [Pa].
    age : ndarray or float
        theta [s].
    growth : float
        B, by which a factor e of the age adds to the area, 0 for contacts that do not age.
    cutoff : float
        theta_c [s].

    Raises
    ------
    RuptfxError
        A hardness or cut-off that is not above zero, or a growth below.
    """
    for name, value in (("hardness", hardness), ("cutoff", cutoff)):
        if not value > 0:
            raise RuptfxError(f"contact light: {name} = {value}: must be above 0")
    if not growth >= 0:
        raise RuptfxError(f"contact light: growth = {growth}: must not be below 0")
    return np.maximum(normal_stress, 0.0) / hardness * (1 + growth * np.log1p(np.maximum(age, 0.0) / cutoff))


def contact_light(
    record: Record,
    hardness: float,
    growth: float = 0.0,
    cutoff: float = 1.0,
    state: str | None = None,
    interface: str | None = None,
) -> xarray.DataArray:
    """Return the real over the nominal contact area of a run against time and position.

    Parameters
    ----------
    hardness, growth, cutoff : float
        As in `real_contact_area`.
    state : str, optional
        Name of the state variable that is the contact age; default is the only one in seconds.
    interface : str, optional
        Its name; default is the first.

    Raises
    ------
    RuptfxError
        Contacts that age where no state is an age, or where several may be.
    """
    data = record.interface if interface is None else record.interfaces[interface]
    age: Array | float = 0.0
    if growth:
        ages = [
            str(name) for name, field in data.data_vars.items()
            if field.attrs.get("units") == "s" and field.dims == ("time", "position")
        ]  # fmt: skip
        if state is None and len(ages) == 1:
            state = ages[0]
        if state not in ages:
            raise RuptfxError(
                f"contact light: state = {state}: the age of contacts must be a state in seconds; there "
                + ("is " + ", ".join(ages) if ages else "is none, so growth must be 0")
            )
        age = data[state].values
    area = real_contact_area(data["normal_stress"].values, hardness, age, growth, cutoff)
    result = data["normal_stress"].copy(data=area)
    return result.assign_attrs({"units": "1", "long_name": "real over nominal contact area"}).rename("contact_area")
