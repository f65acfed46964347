"""Fit of a, b and D_c to a measured friction trace, with confidence intervals."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import xarray
from pydantic import Field, field_validator
from scipy.optimize import least_squares
from scipy.stats import t as student

from ruptfx import RuptfxError
from ruptfx.input.number_files import read_table, require_increasing
from ruptfx.input.schema import CasePath
from ruptfx.lumped import Progress, variable
from ruptfx.lumped.spring_slider.protocols import Experiment
from ruptfx.lumped.spring_slider.slider import Slider, integrate

_COLUMNS = {"time": "s", "drive_speed": "m/s", "friction": "1"}
_FITTED = ("a", "b", "D_c", "f_0")


class Fit(Experiment):
    """Fit a, b, D_c and f_0 to a trace of friction under a drive of piecewise constant speed.

    Least squares in ln a, ln b, ln D_c (all positive) and f_0, from the values of `friction` in the case. The
    intervals follow from the curvature of the misfit and assume independent errors of equal size.
    """

    name = "fit"
    kind: Literal["fit"] = "fit"
    trace: CasePath
    """CSV file with the columns time [s], drive_speed [m/s] and friction, and a header that names them; it may give
    other units, as `time (ms)`."""
    confidence: Annotated[float, Field(gt=0.5, lt=1)] = 0.95
    """Level of the intervals."""

    @field_validator("trace")
    @classmethod
    def _found(cls, trace: str) -> str:
        if not Path(trace).is_file():
            raise ValueError(f"no such file ({trace}); give a CSV with the columns {', '.join(_COLUMNS)}")
        return trace

    def run(self, slider: Slider, progress: Progress) -> xarray.Dataset:
        time, drive, measured = read_trace(self.trace)
        law = slider.law
        start = np.array([*(np.log(float(getattr(law, name))) for name in _FITTED[:3]), float(law.f_0)])
        # The steady friction of the case is a poor guess for the sample; start from the measured level.
        start[3] += measured[0] - modelled(slider, start, time[:2], drive[:2])[0]
        calls = 0

        def misfit(parameters: np.ndarray) -> np.ndarray:
            nonlocal calls
            calls += 1
            progress(min(calls / 60, 0.95), f"fit, {calls} runs")
            try:
                return modelled(slider, parameters, time, drive) - measured
            except RuptfxError:  # this trial is unstable; return a large misfit
                return np.full(len(time), 1.0)

        result = least_squares(misfit, start, method="trf", x_scale=[0.3, 0.3, 0.5, 0.01], diff_step=1e-4, xtol=1e-9)
        if not result.success:
            raise RuptfxError(f"the fit of {self.trace} failed: {result.message}; start closer with friction.a, b, D_c")
        low, high = _interval(result.x, result.jac, result.fun, self.confidence)
        values, low, high = (np.array([*np.exp(x[:3]), x[3]]) for x in (result.x, low, high))
        fields = {
            "measured": variable("time", measured, "1", "measured friction coefficient"),
            "fitted": variable("time", measured + result.fun, "1", "fitted friction coefficient"),
            "drive_speed": variable("time", drive, "m/s", "speed of the drive"),
            "misfit": variable((), float(np.sqrt(np.mean(result.fun**2))), "1", "RMS misfit"),
        }
        for name, value, lower, upper in zip(_FITTED, values, low, high, strict=True):
            unit = "m" if name == "D_c" else "1"
            fields |= {
                name: variable((), value, unit, f"fitted {name}"),
                f"{name}_low": variable((), lower, unit, f"lower bound of {name}"),
                f"{name}_high": variable((), upper, unit, f"upper bound of {name}"),
            }
        coords = {"time": variable("time", time, "s", "time")}
        return xarray.Dataset(fields, coords, {"experiment": self.name, "confidence": self.confidence})

    def resulting(self, slider: Slider, dataset: xarray.Dataset) -> Slider:
        return replace(slider, law=slider.law.model_copy(update={name: float(dataset[name]) for name in _FITTED}))


def modelled(slider: Slider, parameters: np.ndarray, time: np.ndarray, drive: np.ndarray) -> np.ndarray:
    """Return the friction coefficient at the times, from steady sliding at first; `parameters` as in `Fit`."""
    values = dict(zip(_FITTED, (float(v) for v in (*np.exp(parameters[:3]), parameters[3])), strict=True))
    trial = replace(slider, law=slider.law.model_copy(update=values))
    # Speed i applies from time i to time i + 1.
    starts = [0, *(np.flatnonzero(np.diff(drive[:-1])) + 1), len(time) - 1]
    y, friction = trial.steady(drive[0]), np.empty(len(time))
    for first, last in pairwise(starts):
        motion = integrate(trial, y, time[first : last + 1], float(drive[first]), rtol=1e-9)
        friction[first : last + 1], y = motion.friction, motion.end
    return friction


def _interval(x: np.ndarray, jac: np.ndarray, residual: np.ndarray, level: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the bounds x -+ t sqrt(diag((J' J)^-1) s^2) with Student's t, s^2 = |r|^2 / (n - p)."""
    freedom = len(residual) - len(x)
    covariance = np.linalg.pinv(jac.T @ jac) * (residual @ residual) / freedom
    half = student.ppf(0.5 + level / 2, freedom) * np.sqrt(np.diag(covariance))
    return x - half, x + half


def read_trace(path: str | Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Read time [s], drive speed [m/s] and friction from a CSV file with a header.

    Raises
    ------
    RuptfxError
        Columns missing, entries that are no numbers, too few rows, times that do not increase.
    """
    try:
        result = read_table(Path(path), is_named=True)
        columns = result.named(_COLUMNS)
        if missing := [name for name in _COLUMNS if name not in columns]:
            raise ValueError(
                f"{path}: column {', '.join(missing)} is missing; the first line must name {', '.join(_COLUMNS)}"
            )
        table = np.array([result.column(*columns[name]) for name in _COLUMNS]).T
        require_increasing(table[:, 0], result.lines, path)
    except ValueError as error:
        raise RuptfxError(str(error)) from None
    if len(table) < 20:
        raise RuptfxError(
            f"{path}: at least 20 rows of numbers are needed to fit, found {len(table)}; sample the trace more often"
        )
    return table[:, 0], table[:, 1], table[:, 2]
