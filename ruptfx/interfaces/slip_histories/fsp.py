"""Finite-fault models in the FSP format of the SRCMOD database."""

from __future__ import annotations

import re
from pathlib import Path
from typing import ClassVar

import numpy as np

from ruptfx.input.number_files import number, text_of
from ruptfx.input.units import Duration
from ruptfx.interfaces.slip_histories._growth import ramp
from ruptfx.interfaces.slip_histories._subfaults import MOST_SUBFAULTS, FiniteFault, Model
from ruptfx.interfaces.slip_histories.ramp import SMOOTHED
from ruptfx.platform.files import read_once

UNKNOWN = 999.0
"""What the database writes for numbers that it does not have."""
HEADERS = frozenset(
    ["STRK", "DIP", "RAKE", "Htop", "HypX", "HypZ", "Nx", "Nz", "Dx", "Dz", "Nsg", "Ntw", "inDx", "inDz"]
)
"""Names of the numbers of a header that are read."""


class Fsp(FiniteFault):
    """A finite-fault model of one segment and one time window in the FSP format of the SRCMOD database.

    Slip of a subfault grows linearly over its rise time, from its rupture time on; the slip rate begins and ends over a
    tenth of the rise time. A file without rupture or rise times needs `rupture_speed` and `rise_time`.
    Source: Mai and Thingbaijam (2014).
    """

    source: ClassVar[str] = "Mai and Thingbaijam (2014)"
    example: ClassVar[str] = '{ kind = "fsp", file = "model.fsp" }'
    files_of_example: ClassVar[dict[str, str]] = {"model.fsp": (
        "% Mech : STRK = 0 DIP = 90 RAKE = 0 Htop = 0 km\n% Rupt : HypX = 1e-6 km HypZ = 1e-6 km\n"
        "% Invs : Nx = 2 Nz = 1\n% Invs : Dx = 2e-6 km Dz = 2e-6 km\n% Nsg = 1\n"
        "%   LAT  LON  X==EW  Y==NS  Z  SLIP  RAKE  TRUP  RISE\n"
        " 34 -118 0 1e-6 0 1e-6 0 0 1e-6\n 34 -118 0 3e-6 0 1e-6 0 1e-7 1e-6\n"
    )}  # fmt: skip

    rise_time: Duration | None = None
    """Rise time of all subfaults, if the file has none."""
    rupture_speed: float | None = None
    """Speed of the rupture from the hypocentre [m/s], if the file has no rupture times."""

    def model(self) -> Model:
        return _read(self.file, self.rise_time, self.rupture_speed)


def _headers(path: Path, lines: list[str]) -> dict[str, float]:
    """Return the numbers `name = value` of the header, by name."""
    entries: dict[str, float] = {}
    for line, content in enumerate(lines, 1):
        if content.startswith("%"):
            for name, word in re.findall(r"([A-Za-z]+)\s*=\s*([-+0-9.eEdD]+)", content):
                if name in HEADERS:
                    entries.setdefault(name.removeprefix("in"), number(word, path, line))
    return entries


@read_once
def _read(file: str, rise_time: float | None, rupture_speed: float | None) -> Model:  # noqa: C901
    path = Path(file)
    lines = text_of(path).splitlines()
    header = _headers(path, lines)
    missing = [name for name in ("STRK", "DIP", "Nx", "Nz", "Dx", "Dz") if name not in header]
    if missing:
        raise ValueError(f"{path}: the header does not give {', '.join(missing)}; is it a file of the FSP format?")
    for name in ("Nsg", "Ntw"):
        if header.get(name, 1.0) != 1.0:
            what = "segments" if name == "Nsg" else "time windows"
            raise ValueError(
                f"{path}: has {name} = {header[name]:g} {what}; only files with one are read: write one of them"
            )
    along, down = int(header["Nx"]), int(header["Nz"])
    length, width = 1e3 * header["Dx"], 1e3 * header["Dz"]
    if not (1 <= along <= MOST_SUBFAULTS and 1 <= down <= MOST_SUBFAULTS and along * down <= MOST_SUBFAULTS):
        raise ValueError(f"{path}: Nx = {along}, Nz = {down}: must be 1 or more, and Nx Nz at most {MOST_SUBFAULTS}")
    if min(length, width) <= 0:
        raise ValueError(f"{path}: Dx = {header['Dx']:g} km and Dz = {header['Dz']:g} km: must be positive")
    names = next((line.lstrip("% ").split() for line in lines if re.match(r"%\s*LAT\s+LON\s", line)), [])
    names = [name.partition("=")[0] for name in names]
    if not {"X", "Y", "Z", "SLIP"} <= set(names):
        raise ValueError(f"{path}: no line with the names of the columns, % LAT LON X==EW Y==NS Z SLIP ...; add it")
    rows = []
    for line, content in enumerate(lines, 1):
        words = content.split()
        if words and not content.startswith("%"):
            if len(words) < len(names):
                raise ValueError(
                    f"line {line} of {path}: has {len(words)} numbers, the columns are {len(names)}; fill the others"
                )
            rows.append([number(word, path, line) for word in words[: len(names)]])
    if len(rows) != along * down:
        raise ValueError(
            f"{path}: has {len(rows)} subfaults, and Nx Nz = {along * down}; correct the header, or add the lines"
        )
    columns = dict(zip(names, np.array(rows).T, strict=True))
    order = _order(path, columns, header, along, down)

    def grid(values: np.ndarray) -> np.ndarray:
        return np.asarray(values[order].reshape(down, along))

    slip = grid(columns["SLIP"])
    rake = grid(columns["RAKE"]) if "RAKE" in columns else np.full(slip.shape, header.get("RAKE", UNKNOWN))
    if np.any(rake == UNKNOWN):
        raise ValueError(f"{path}: has no rake, neither in a column RAKE nor in the header; add it")
    rise, start = _known(columns, "RISE"), _known(columns, "TRUP")
    if rise is None and rise_time is None:
        raise ValueError(f"{path}: has no rise times (RISE); give rise_time")
    rises = np.full(slip.shape, rise_time) if rise is None else grid(rise)
    if start is None:
        if rupture_speed is None or not rupture_speed > 0 or "HypX" not in header or "HypZ" not in header:
            raise ValueError(
                f"{path}: has no rupture times (TRUP); give rupture_speed, and HypX and HypZ in the header"
            )
        x = (np.arange(along) + 0.5) * length - 1e3 * header["HypX"]
        y = (np.arange(down) + 0.5) * width - 1e3 * header["HypZ"]
        starts = np.hypot(x[None], y[:, None]) / rupture_speed
    else:
        starts = grid(start)
    if np.any((rises <= 0) & (slip != 0)) or np.any(starts < 0):
        raise ValueError(f"{path}: rise times of subfaults that slip must be positive, and rupture times not negative")
    rises = np.where(rises > 0, rises, 1.0)

    def course(number: np.ndarray, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        of_ramp, rise = slip.ravel()[number], rises.ravel()[number]
        grown, growth = ramp(time, rise, SMOOTHED * rise)
        return np.stack([of_ramp * grown, 0 * grown]), np.stack([of_ramp * growth, 0 * growth])

    return Model(length, width, rake, starts, slip != 0, course)


def _known(columns: dict[str, np.ndarray], name: str) -> np.ndarray | None:
    """Return a column, None where the file does not know it."""
    values = columns.get(name)
    return None if values is None or np.all(values == UNKNOWN) else values


def _order(path: Path, columns: dict[str, np.ndarray], header: dict[str, float], along: int, down: int) -> np.ndarray:
    """Return the order of the rows, down dip and in each row along strike, from the places of the subfaults.

    Raises
    ------
    ValueError
        Places that are not a grid of Nx by Nz subfaults.
    """
    strike = np.radians(header["STRK"])
    x = columns["X"] * np.sin(strike) + columns["Y"] * np.cos(strike)
    i = np.rint((x - x.min()) / header["Dx"]).astype(int)
    dip = np.sin(np.radians(header["DIP"]))
    if dip > 0.05:
        j = np.rint((columns["Z"] - columns["Z"].min()) / (header["Dz"] * dip)).astype(int)
    else:
        across = columns["X"] * np.cos(strike) - columns["Y"] * np.sin(strike)
        j = np.rint((across - across.min()) / header["Dz"]).astype(int)
    number_of = j * along + i
    if np.any(i >= along) or np.any(j >= down) or len(np.unique(number_of)) != along * down:
        raise ValueError(
            f"{path}: X, Y and Z are not a plane grid of {along} x {down} subfaults of the header's size "
            "(in km); change the header or the columns"
        )
    return np.argsort(number_of)
