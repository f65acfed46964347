"""Units of the numbers in the files of a run, by name: a table that is written by hand."""

from __future__ import annotations

import re
from pathlib import Path

import h5py

COMPONENT = re.compile(r"_([xyz]{1,2}|\d)$")
UNITS = {
    "m": "x y z position dip slip cumulative_slip opening displacement displacement_jump deformed paired "
         "paired_position points length largest_opening largest_slip",
    "s": "time rupture_time time_of_yield time_of_failure theta",
    "m/s": "velocity slip_rate mean_slip_rate peak_slip_rate c_p c_s c_R c_s_dip fastest_wave",
    "Pa": "stress traction normal_stress shear_traction normal_traction fringe theta_p psi "
          "shear_modulus shear_modulus_11 shear_modulus_22 shear_modulus_12",
    "J/m2": "friction_work",
    "m2": "potency",
    "J": "energy",
    "degree": "inclination",
    "1": "strain extension contact cells body body_of_cell damage status lines normal bodies joint magnitude mode pair "
         "tensile_share plastic_strain equivalent_plastic_strain",
}  # fmt: skip
"""Unit: names without their components."""
PER_DEPTH = {"area": ("m", "m2"), "force": ("N/m", "N")}
"""Names whose unit is another one in three dimensions and around an axis."""


def unit_of(name: str, whole: bool = False) -> str:
    """Return the unit of a name; `whole` bodies have no thickness."""
    stem = COMPONENT.sub("", name)
    if stem in PER_DEPTH:
        return PER_DEPTH[stem][whole]
    known = [unit for unit, names in UNITS.items() if name in names.split() or stem in names.split()]
    assert len(known) == 1, f"{name} is not in the table of units"
    return known[0]


def check_units(path: Path, whole: bool = False, but: tuple[str, ...] = ()) -> int:
    """Compare the units of all numbers in the HDF5 files of a run with the table; return how many there are.

    Parameters
    ----------
    path : Path
    whole : bool
        The bodies are those of three dimensions, or around an axis.
    but : tuple of str
        Names with units of their own.
    """
    names: list[str] = []

    def compare(name: str, item: h5py.Dataset | h5py.Group) -> None:
        last = name.rpartition("/")[2]
        if not isinstance(item, h5py.Dataset) or item.dtype.kind not in "fiu" or last in but:
            return
        if "_Netcdf4Dimid" in item.attrs and "long_name" not in item.attrs and "units" not in item.attrs:
            return  # a dimension without a coordinate
        names.append(last)
        assert str(item.attrs["units"]) == unit_of(last, whole), name

    for file in sorted(path.glob("*.h5")):
        with h5py.File(file) as data:
            data.visititems(compare)
    return len(names)
