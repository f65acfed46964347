"""Conversion between measured roughness and the disorder of a Maxwell-slip ensemble."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field, field_validator, model_validator
from scipy.signal import fftconvolve

from ruptfx import RuptfxError
from ruptfx.input.number_files import NumberTable, read_table, require_increasing
from ruptfx.input.schema import CasePath, Part
from ruptfx.input.units import Fraction as Share
from ruptfx.input.units import Length, Modulus, Positive

Pressure = Modulus
_GAUSSIAN_TO_RA = np.sqrt(2 / np.pi)  # R_a / R_q of Gaussian heights
_ISO_SIGMA = np.sqrt(np.log(2) / 2) / np.pi  # standard deviation of the ISO 16610-21 filter over its cutoff


class ContactLayer(Part):
    """Sheared layer that converts heights to spring extensions; the real-contact fraction is uncertain."""

    h: Length = 5e-5
    """Thickness [m]."""
    shear_modulus: Modulus = 1.1e9
    """Shear modulus of the sheared layer."""
    pressure: Pressure = 2.67e6
    """Nominal pressure p [Pa]; the contacts carry p / f. The default is fitted: it gives the published critical R_a."""
    contact_fraction_min: Share = 0.011
    """Smallest real-contact fraction."""
    contact_fraction_max: Share = 0.015
    """Largest real-contact fraction."""
    alpha_c: Positive | None = None
    """Shape parameter at the transition; default is the one computed by the run."""

    @model_validator(mode="after")
    def _ordered(self) -> ContactLayer:
        if self.contact_fraction_min > self.contact_fraction_max:
            raise ValueError(
                f"contact_fraction_min = {self.contact_fraction_min:g} must not exceed contact_fraction_max = "
                f"{self.contact_fraction_max:g}"
            )
        return self

    def scale(self, mu_s: float, fraction: float, pressure: float | None = None) -> float:
        """Return R_a sqrt(2 alpha + 1) [m] = 2 mu_s p / (f G sqrt(pi)) h."""
        loaded = (self.pressure if pressure is None else pressure) / fraction
        return 2 * mu_s * loaded * self.h / (self.shear_modulus * np.sqrt(np.pi))

    def roughness(self, alpha: np.ndarray | float, mu_s: float, fraction: float, pressure: float | None = None):  # type: ignore[no-untyped-def]
        """Return R_a [m] of a shape parameter.

        Source: Baygeldi, Amireghbali, Gurel, Ozcan, Coker (2026), R_a = 2 mu_s p_e h / (G sqrt(pi (2 alpha + 1))).
        """
        return self.scale(mu_s, fraction, pressure) / np.sqrt(2 * np.asarray(alpha) + 1)

    def critical(self, alpha_c: float, mu_s: float, pressure: float | None = None) -> tuple[float, float]:
        """Return smallest and largest R_a,crit [m] over the range of the real-contact fraction."""
        at = [self.roughness(alpha_c, mu_s, f, pressure) for f in self.fractions[::-1]]
        return float(at[0]), float(at[1])

    @property
    def fractions(self) -> tuple[float, float]:
        return self.contact_fraction_min, self.contact_fraction_max

    def alpha(self, R_a: float, mu_s: float, pressure: float | None = None) -> tuple[float, float]:
        """Return smallest and largest shape parameter over the range of the fraction; 0 beyond every ensemble."""
        values = [((self.scale(mu_s, f, pressure) / R_a) ** 2 - 1) / 2 for f in self.fractions[::-1]]
        return max(values[0], 0.0), max(values[1], 0.0)

    def verdict(self, R_a: float, alpha_c: float, mu_s: float, pressure: float | None = None) -> str:
        """Return `stick-slip` below every R_a,crit of the uncertain range, `steady` above all, else `undecided`.

        Without alpha_c (NaN) the verdict is `undecided`, too.
        """
        low, high = self.critical(alpha_c, mu_s, pressure)
        return "stick-slip" if R_a < low else "steady" if R_a > high else "undecided"


class Surface(Part):
    """A surface to classify, by R_a, R_q or a measured height profile."""

    name: str
    """Name in figures."""
    R_a: Length | None = None
    """Mean absolute height."""
    R_q: Length | None = None
    """RMS height [m]; R_a = R_q sqrt(2 / pi), Gaussian heights."""
    profile: CasePath | None = None
    """Text or CSV file: heights, or positions and heights."""
    profile_unit: Length | None = None
    """Metres per unit of the file, 1e-6 for micrometres; by default that of its header, as `x (um), z (um)`, or 1."""
    cutoff: Length | None = None
    """Waviness cutoff [m] of the Gaussian filter ISO 16610-21; needs positions."""
    pressure: Pressure | None = None
    """Nominal pressure [Pa]; default is that of the layer."""
    observed: Annotated[str, Field(pattern="^(stick-slip|steady|)$")] = ""
    """Kind of sliding observed in an experiment."""

    @field_validator("profile")
    @classmethod
    def _found(cls, profile: str | None) -> str | None:
        if profile is not None and not Path(profile).is_file():
            raise ValueError(f"no such file ({profile}); give the path of a height profile")
        return profile

    @model_validator(mode="after")
    def _one_measure(self) -> Surface:
        if sum(value is not None for value in (self.R_a, self.R_q, self.profile)) != 1:
            items = [key for key in ("R_a", "R_q", "profile") if getattr(self, key) is not None]
            raise ValueError(f"give exactly one of R_a, R_q, profile, not {' and '.join(items) or 'none'}")
        if self.cutoff is not None and self.profile is None:
            raise ValueError(f"cutoff = {self.cutoff:g} m filters a profile; give profile, or remove cutoff")
        return self

    def roughness(self) -> float:
        """Return R_a [m].

        Raises
        ------
        RuptfxError
            The profile cannot be read.
        """
        if self.R_a is not None:
            return self.R_a
        if self.R_q is not None:
            return float(self.R_q * _GAUSSIAN_TO_RA)
        position, height = read_profile(str(self.profile), self.profile_unit)
        return roughness_of(height, position, self.cutoff)


def read_profile(path: str | Path, unit: float | None = None) -> tuple[np.ndarray | None, np.ndarray]:
    """Read positions (None if the file has heights only) and heights [m] of a text or CSV file.

    Parameters
    ----------
    path : str or Path
    unit : float, optional
        Metres per unit of the file; default is the unit that its header gives, else 1.

    Raises
    ------
    RuptfxError
        Not a table of one or two columns of at least 8 numbers, positions that do not increase, or a header whose unit
        is no length or not the one given.
    """
    try:
        table = read_table(Path(path))
        if table.width > 2:
            raise ValueError(f"line {table.lines[0]} of {path}: {table.width} columns; every row must have one or two")
        if len(table.rows) < 8:
            raise ValueError(
                f"{path}: {len(table.rows)} rows; a profile must have at least 8, of heights, or of positions and "
                "heights"
            )
        *position, height = (table.column(i, scale) for i, scale in enumerate(_scales(table, unit)))
        if position:
            require_increasing(position[0], table.lines, path)
    except ValueError as error:
        raise RuptfxError(str(error)) from None
    return np.array(position[0]) if position else None, np.array(height)


def _scales(table: NumberTable, unit: float | None) -> list[Fraction]:
    """Return metres per unit of each column, from the header or the given unit."""
    items = list(table.factors(dict.fromkeys(range(table.width), "m")).values())
    if unit is None:
        return [scale or Fraction(1) for scale in items]
    wrong = next((scale for scale in items if scale not in (None, Fraction(str(unit)))), None)
    if wrong is not None:
        raise ValueError(
            f"{table.path}: its header gives a unit of {float(wrong):g} m, and profile_unit = {unit:g} m; remove "
            "profile_unit"
        )
    return [Fraction(str(unit))] * table.width


def roughness_of(height: np.ndarray, position: np.ndarray | None = None, cutoff: float | None = None) -> float:
    """Return R_a = (1/L) int |z| dx [m] about the mean line, with waviness removed if a cutoff is given.

    Parameters
    ----------
    height : ndarray, shape (n,)
    position : ndarray, shape (n,), optional
        Equal spacing is assumed without it.
    cutoff : float, optional
        Cutoff wavelength [m].

    Raises
    ------
    RuptfxError
        A cutoff without positions, or one longer than the profile.
    """
    x = np.arange(len(height), dtype=float) if position is None else position
    if cutoff is not None:
        if position is None:
            raise RuptfxError(f"cutoff = {cutoff:g} m needs positions; give a profile of two columns, or remove cutoff")
        if cutoff >= np.ptp(x):
            raise RuptfxError(
                f"cutoff = {cutoff:g} m must be shorter than the profile ({np.ptp(x):g} m); decrease it, or remove it"
            )
        even = np.linspace(x[0], x[-1], len(x))
        height, x = np.interp(even, x, height), even
        height = height - _waviness(height, _ISO_SIGMA * cutoff / (x[1] - x[0]))
    else:
        height = height - np.polyval(np.polyfit(x - x[0], height, 1), x - x[0])
    # The mean line is the average of the height over length.
    height = height - np.trapezoid(height, x) / np.ptp(x)
    return float(np.trapezoid(np.abs(height), x) / np.ptp(x))


def _waviness(height: np.ndarray, sigma: float) -> np.ndarray:
    """Return the Gaussian mean over a standard deviation of `sigma` points; end values are continued."""
    reach = int(np.ceil(4 * sigma))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    return fftconvolve(np.pad(height, reach, mode="edge"), kernel / kernel.sum(), mode="valid")
