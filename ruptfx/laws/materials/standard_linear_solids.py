"""Viscoelasticity with a constant quality factor over a band of frequencies."""

from __future__ import annotations

from functools import cached_property
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from ruptfx.input.quantities import at_most
from ruptfx.input.units import Frequency
from ruptfx.laws.materials._relaxing import Relaxing

Mechanisms = Annotated[int, Field(ge=1, le=8)]
Band = Annotated[float, Field(gt=1)]
Quality = Annotated[float, Field(gt=3, lt=1e4)]


class StandardLinearSolids(Relaxing):
    """Isotropic viscoelasticity: springs and dashpots in parallel, fitted to quality factors of P and S waves.

    Bulk and shear modulus relax: M(omega) = M_U (1 - sum_l Y_l omega_l / (omega_l + i omega)), with frequencies omega_l
    spaced evenly on a logarithmic scale over the band. The moduli of the case are those without relaxation, M_U: waves
    of low frequency are slower. The coefficients Y_l, none below zero, fit 1 / Q at 2 n - 1 frequencies by least
    squares.
    Source: Emmerich and Korn (1987), Geophysics 52, 1252-1264; anelastic functions: Kristek and Moczo (2003), BSSA 93,
    2273-2280.
    """

    Q_p: Quality
    """Quality factor of P waves (in plane strain and 3D)."""
    Q_s: Quality
    """Quality factor of S waves."""
    lowest_frequency: Frequency
    """Lower end of the band."""
    frequency_ratio: Band
    """Upper over lower end of the band."""
    mechanisms: Mechanisms = 3
    """Number n of relaxation mechanisms; one for each decade and one more keep Q within 5 %."""

    def check_values(self) -> None:
        first, shear = self.lame("strain")
        if self.Q_p > (bound := float(np.min(0.75 * (first + 2 * shear) / shear)) * self.Q_s):
            raise ValueError(
                f"Q_p = {self.Q_p:g}: the bulk modulus would not dissipate; with Q_s = {self.Q_s:g} use at most "
                f"{at_most(bound)}"
            )
        if any(np.min(y) < 0 for of_wave in self.coefficients for y in of_wave) or any(
            np.max(sum(of_wave)) >= 1 for of_wave in self.coefficients
        ):
            raise ValueError(
                f"mechanisms = {self.mechanisms}: they cannot fit Q_p = {self.Q_p:g} and Q_s = {self.Q_s:g} over the "
                "band; use another number of mechanisms, a narrower band or larger quality factors"
            )

    @cached_property
    def rates(self) -> tuple[float, ...]:
        """Relaxation rates omega_l [rad/s]."""
        low = 2 * np.pi * self.lowest_frequency
        high = self.frequency_ratio * low
        if self.mechanisms == 1:
            return (float(np.sqrt(low * high)),)
        return tuple(np.geomspace(low, high, self.mechanisms).tolist())

    @cached_property
    def coefficients(self) -> tuple[tuple[Any, ...], tuple[float, ...]]:
        """Coefficients Y_l of bulk and shear modulus; the former vary with the ratio of the moduli."""
        of_p, of_s = self._fitted(self.Q_p).tolist(), self._fitted(self.Q_s).tolist()
        first, shear = self.lame("strain")
        bulk, four_thirds = first + 2 * shear / 3, 4 * shear / 3
        of_bulk = (((bulk + four_thirds) * p - four_thirds * s) / bulk for p, s in zip(of_p, of_s, strict=True))
        return tuple(of_bulk), tuple(of_s)

    def _fitted(self, quality: float) -> np.ndarray:
        """Return Y_l from 1/Q = sum_l (omega_l omega + omega_l^2 / Q) / (omega_l^2 + omega^2) Y_l."""
        rate = np.array(self.rates)
        count = max(2 * self.mechanisms - 1, 1)
        low = 2 * np.pi * self.lowest_frequency
        high = self.frequency_ratio * low
        at = np.geomspace(low, high, count)[:, None] if count > 1 else np.array([[np.sqrt(low * high)]])
        rows = (rate * at + rate**2 / quality) / (rate**2 + at**2)
        from scipy.optimize import nnls

        return np.asarray(nnls(rows, np.full(count, 1 / quality))[0])

    def quality(self, frequency: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return Q of P and S waves at frequencies [1/s], as the fitted mechanisms have it."""
        of_bulk, of_shear = self.relaxed(frequency)
        of_p = of_bulk + 4 / 3 * of_shear
        return of_p.real / of_p.imag, of_shear.real / of_shear.imag

    def relaxed(self, frequency: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the complex bulk and shear modulus at frequencies [Pa]."""
        omega = 2 * np.pi * np.asarray(frequency)[..., None]
        first, shear = self.lame("strain")
        rate = np.array(self.rates)
        falls = [np.sum(np.array(y) * rate / (rate + 1j * omega), axis=-1) for y in self.coefficients]
        return (first + 2 * shear / 3) * (1 - falls[0]), shear * (1 - falls[1])
