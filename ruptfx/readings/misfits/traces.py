"""Traces of an instrument against data."""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Self

import numpy as np
from pydantic import Field, ModelWrapValidatorHandler, ValidationInfo, model_validator

from ruptfx.input import number_files
from ruptfx.input.data_files import Column, mapped
from ruptfx.input.netcdf_units import opened, unit_and_factor, unpacked
from ruptfx.input.quantities import factor, si_and_units
from ruptfx.input.schema import CaseError, Name, Unit, nearest
from ruptfx.input.units import Duration, Frequency, Instant, Positive, without_unit
from ruptfx.readings.filter import filtered
from ruptfx.readings.instruments import Channel, Instrument
from ruptfx.readings.misfits import Floats, Measured, Misfit, Request, Sample, Trace

if TYPE_CHECKING:
    from ruptfx.readings.instruments.model_readings import ModelReadings


_ANGLE = re.compile(r"at (-?[\d.e+-]+) degrees")  # in the long name of the grid of a strain gauge


class Traces(Misfit):
    """Traces of an instrument: half the sum of ((gain reading + offset - data) / sigma)^2 over channels and times.

    The readings have the filter of the instrument (`bandwidth`) and are interpolated linearly to the times of the data.
    Columns of a CSV file are the time and channels of the instrument, each with its unit in the header:
    `time (us), slip_rate (m/s)`; of a file of several instruments those with its name, `G1 (um/m)` of a single channel,
    `G1.extension_1 (um/m)`, `G1 45 deg (um/m)`. Another file is NetCDF, of which the group of the instrument is read,
    as `instruments.h5` of a run has one, or the variables of the file, if it has no groups; `time` and every channel
    have an attribute `units`. A case contains the data, not the file. Cells of a channel that are empty or not a number
    (NaN) are missing samples, which do not count; the other channels have theirs. Data before the start of the run or
    after its end are refused; `begin` and `end` leave them out.
    """

    example: ClassVar[str] = (
        '{ kind = "traces", instrument = "fault", times = [1e-6, 2e-6, 3e-6], sigma = 1e-6, '
        'data = { slip = [1e-6, 2e-6, 3e-6] }, units = { slip = "m" } }'
    )

    instrument: Name
    """Name of the instrument."""
    file: str | None = None
    """CSV or NetCDF file, such as `instruments.h5`, relative to the case file; with `map` also another HDF5 file or one
    of MATLAB."""
    map: dict[str, Column] = {}
    """Place of `time` and of each channel in the file, where it has other names; `ruptfx data` proposes it."""
    times: list[float] = []
    """Times of the data [s], in place of a file."""
    data: dict[str, list[float]] = {}
    """Values at these times by channel, in place of a file."""
    units: dict[str, str] = {}
    """Unit of each channel of `data`."""
    missing: dict[str, list[Annotated[int, Field(ge=0)]]] = {}
    """Numbers, from 0, of the times at which a channel has no sample; its data there do not count. Data that are not a
    number are added to them."""
    channels: Annotated[list[str], Field(min_length=1)] | None = None
    """Channels that count; default is all of the data."""
    sigma: Annotated[Positive, without_unit("the channels")]
    """Standard deviation of the noise, a number in the SI unit of the channels or a text with a unit."""
    begin: Instant | None = None
    """Start of the window of times that count [s]; default is the first time of the data."""
    end: Duration | None = None
    """End of that window [s]; default is the last time of the data."""
    time_shift: Annotated[float, Unit("s")] = 0.0
    """Time of the run minus that of the data, such as the delay of a trigger; may be an unknown. `begin` and `end`
    are times of the data."""
    gain: Positive = 1.0
    """Data over reading, such as the error of a calibration; may be an unknown."""
    offset: Annotated[float, without_unit("the channels")] = 0.0
    """Data where the reading is zero, such as a baseline, in the SI unit of the channels or a text with a unit; may be
    an unknown."""
    bandwidth: Frequency | None = None
    """Frequency of half power of a low-pass filter with one pole, which acts on data and readings alike, before the
    window. The instrument then has none. Default: readings have the filter of the instrument, and data none."""

    @model_validator(mode="wrap")
    @classmethod
    def _from_file(cls, values: object, handler: ModelWrapValidatorHandler[Self], info: ValidationInfo) -> Self:
        if not isinstance(values, Mapping):
            return handler(values)
        units_of: list[tuple[str, str]] = []
        for key in ("sigma", "offset"):
            number, units = si_and_units(values.get(key))
            units_of += [(key, unit) for unit in units]
            values = {**values, key: number} if units else values
        has_file = isinstance(values.get("file"), str)
        file = cls._read(values, handler, info) if has_file else handler(_without_gaps(values))
        for (key, unit), name in itertools.product(units_of, file._chosen):
            try:
                factor(unit, file.units.get(name, "1"))
            except ValueError as error:
                raise ValueError(f"{key} in {unit}: {error} for the channel {name}") from None
        return file

    @classmethod
    def _read(cls, values: Mapping[str, Any], handler: ModelWrapValidatorHandler[Self], info: ValidationInfo) -> Self:
        """Return the term with the data of its file."""
        if values.get("data") or values.get("times"):
            raise ValueError("give either a file, or times, data and units")
        path = Path((info.context or {}).get("directory") or ".", values["file"])
        if values.get("map"):
            columns = {str(name): Column.model_validate(each) for name, each in dict(values["map"]).items()}
            seconds, arrays, units = mapped(path, columns, gaps=True)
            times, data = seconds.tolist(), {name: each.tolist() for name, each in arrays.items()}
        else:
            read = _from_run if path.suffix in (".h5", ".nc") else _from_text
            times, data, units = read(path, str(values.get("instrument")), values.get("channels"))
        entries = {
            **{k: v for k, v in values.items() if k not in ("file", "map")},
            "times": times,
            "data": data,
            "units": units,
        }
        result = handler(_without_gaps(entries))
        result.__dict__["_read_from"] = str(path)
        return result

    @cached_property
    def _read_from(self) -> str:
        """File of the data, for messages; no private attribute, because terms with the same data are equal."""
        return ""

    @model_validator(mode="after")
    def _complete(self) -> Traces:
        if self.map:
            raise ValueError("map: names places in a file; add the file, or remove map")
        if not self.data or len(self.times) < 1:
            raise ValueError("there are no data; give a file, or times, data and units")
        if len(late := np.flatnonzero(np.diff(self.times) <= 0)):
            before, after = self.times[late[0] : late[0] + 2]
            remedy = "remove one of the two" if after == before else "sort the data"
            raise ValueError(f"times: {after:g} s after {before:g} s; they must increase, {remedy}")
        for name, values in self.data.items():
            if len(values) != len(self.times):
                raise ValueError(f"data.{name}: {len(values)} values at {len(self.times)} times; give one for each")
            if name not in self.units:
                raise ValueError(f"data.{name}: has no unit; add it to units, or to the header of the file")
            try:
                factor(self.units[name], None)
            except ValueError as error:
                raise ValueError(f"units.{name} = '{self.units[name]}': {error}") from None
        self._check_missing()
        return self

    def _check_missing(self) -> None:
        """Refuse numbers of samples that a channel does not have, and a filter over gaps.

        Raises
        ------
        ValueError
        """
        for name, numbers in self.missing.items():
            if name not in self.data:
                raise ValueError(f"missing.{name}: no channel of the data, {nearest(name, list(self.data))}")
            if numbers and max(numbers) >= len(self.times):
                raise ValueError(f"missing.{name}: sample {max(numbers)} of {len(self.times)}, which are counted from "
                                 "0; remove it")  # fmt: skip
            if name in self._chosen and len(set(numbers)) == len(self.times):
                raise ValueError(f"data.{name}: all samples are missing; leave out the channel by naming the others in "
                                 "channels")  # fmt: skip
            if numbers and name in self._chosen and self.bandwidth is not None:
                raise ValueError(
                    f"bandwidth = {self.bandwidth:g} Hz: filters the data of all times, and '{name}' has no sample at "
                    f"{self.times[numbers[0]]:g} s; remove bandwidth, or leave the channel out with channels"
                )

    @property
    def _inside(self) -> np.ndarray:
        times = np.array(self.times)
        begin, end = -np.inf if self.begin is None else self.begin, np.inf if self.end is None else self.end
        return (times >= begin) & (times <= end)

    def _counts(self, name: str) -> np.ndarray:
        """Return whether the sample of a channel counts, at every time."""
        counts = self._inside
        counts[self.missing.get(name, [])] = False
        return counts

    def requests(self, bodies: ModelReadings, key: str) -> list[Request]:
        case = bodies.model.case
        listed = enumerate(case.instruments)
        named = {each.name: (number, each) for number, each in listed if isinstance(each, Instrument)}
        if self.instrument not in named:
            hint = nearest(self.instrument, list(named))
            raise CaseError(f"{key}.instrument = '{self.instrument}': no such instrument, {hint}")
        times = np.array(self.times)[self._inside]
        if not len(times):
            name = "end" if self.begin is None else "begin"
            raise CaseError(
                f"{key}.{name} = {getattr(self, name):g} s: there are no data in the window, and they go from "
                f"{self.times[0]:g} s to {self.times[-1]:g} s; change begin or end"
            )
        self._check_inside(times, case.duration, key)
        number, instrument = named[self.instrument]
        if self.bandwidth is not None and instrument.bandwidth is not None:
            raise CaseError(
                f"{key}.bandwidth = {self.bandwidth:g} Hz: '{self.instrument}' has a filter of its own, "
                f"{instrument.bandwidth:g} Hz; remove one of them"
            )
        if instrument.grid is not None:
            raise CaseError(
                f"{key}.instrument = '{self.instrument}': a grid of receivers has no traces; add an instrument of "
                "kind = 'receiver' where the data are"
            )
        channels = instrument.channels(bodies, f"instruments.{number}")
        value = _aliases(channels, self.instrument)
        chosen = self._chosen
        units = set()
        for name in chosen:
            if name not in value:
                hint = nearest(name, [channel.name for channel in channels])
                raise CaseError(f"{key}.data.{name}: '{self.instrument}' has no such channel, {hint}")
            if name not in self.data:
                raise CaseError(f"{key}.channels: there are no data of '{name}'; add them, or remove it")
            if value[name].offset != 0:
                raise CaseError(
                    f"{key}.data.{name}: contains the initial stress of the bodies, which is not differentiated; use "
                    "channels of motion, strain or the interface"
                )
            if not self._counts(name).any():
                raise CaseError(f"{key}.data.{name}: all samples in the window are missing; leave out the channel with "
                                "channels, or change begin or end")  # fmt: skip
            units.add(value[name].unit)
            try:
                factor(self.units[name], value[name].unit)
            except ValueError as error:
                where = f" (column '{name}' of {self._read_from})" if self._read_from else ""
                raise CaseError(
                    f"{key}.units.{name} = '{self.units[name]}'{where}: {error}; write {value[name].unit} or a multiple"
                ) from None
        if len(units) > 1:
            raise CaseError(
                f"{key}.sigma: one number for channels in {' and '.join(sorted(units))}; give an entry for the "
                "channels of each unit, with `channels`"
            )
        bandwidth = self.bandwidth or instrument.bandwidth
        times = np.array(self.times) + self.time_shift
        return [Trace(value[name], times[self._counts(name)], bandwidth) for name in chosen]

    def _check_inside(self, times: Floats, duration: float, key: str) -> None:
        shifted = times + self.time_shift
        early, late = np.count_nonzero(shifted < 0), np.count_nonzero(shifted > duration * (1 + 1e-9))
        if not early and not late:
            return
        outside, remedies = [], []
        if early:
            outside.append(f"{early} before it")
            remedies.append(f"leave the early ones out with begin = {0.0 - self.time_shift:.12g}")
        if late:
            outside.append(f"{late} after its end")
            end = duration - self.time_shift
            remedies.append(f"make the run longer or leave the late ones out with end = {end:.12g}")
        shift = f" with time_shift = {self.time_shift:.6g} s" if self.time_shift else ""
        narrower = ", or narrow the bounds of the shift" if self.time_shift else ""
        raise CaseError(
            f"{key}.times: data from {shifted[0]:.6g} s to {shifted[-1]:.6g} s{shift}, and the run lasts from 0 s to "
            f"{duration:.6g} s: {' and '.join(outside)}, of {len(times)} times; {' and '.join(remedies)}{narrower}"
        )

    @property
    def parameters(self) -> dict[str, str]:
        return {"time_shift": "s", "gain": "1", "offset": _si_unit(self.units.get(self._chosen[0], "1"))}

    def expected(self, samples: Sequence[Sample]) -> list[Floats]:
        return [self.gain * sample.values + self.offset for sample in samples]

    def change(self, parameter: str, samples: Sequence[Sample]) -> list[Floats]:
        if parameter == "gain":
            return [sample.values / self.gain for sample in samples]
        if parameter == "offset":
            return [np.full(len(sample.values), 1 / self.gain) for sample in samples]
        return [np.zeros(len(sample.values)) if sample.slopes is None else sample.slopes for sample in samples]

    @property
    def _chosen(self) -> list[str]:
        return list(self.data) if self.channels is None else self.channels

    def evaluate(self, samples: Sequence[Sample]) -> tuple[float, list[Floats]]:
        total, slopes = 0.0, []
        for residual, slope in self.residuals(samples):
            total += 0.5 * float(residual @ residual)
            slopes.append(slope * residual)
        return total, slopes

    def residuals(self, samples: Sequence[Sample]) -> list[tuple[Floats, Floats]]:
        return [
            ((values - wanted.values) / self.sigma, np.full(len(values), self.gain / self.sigma))
            for wanted, values in zip(self.measured(), self.expected(samples), strict=True)
        ]

    def measured(self) -> list[Measured]:
        times, result = np.array(self.times), []
        for name in self._chosen:
            values = np.array(self.data[name]) * float(factor(self.units[name], None))  # SI
            if self.bandwidth is not None:
                values = filtered(times, values, self.bandwidth)
            label, unit, counts = f"{self.instrument}, {name}", _si_unit(self.units[name]), self._counts(name)
            lost = int(self._inside.sum() - counts.sum())
            result.append(Measured(label, times[counts], values[counts], unit, lost))
        return result


def _without_gaps(values: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the entries of a term whose data are numbers: those that are not are interpolated, and missing."""
    data, missing = values.get("data"), values.get("missing") or {}
    if not isinstance(data, Mapping) or not isinstance(missing, Mapping):
        return values  # refused with its key
    filled, gaps = dict(data), dict(missing)
    for name, each in data.items():
        try:
            numbers = np.asarray(each, dtype=float)
        except (TypeError, ValueError):
            continue
        lost, before = np.isnan(numbers), gaps.get(name, [])
        if numbers.ndim != 1 or not lost.any() or not isinstance(before, list):
            continue
        at, known = np.arange(len(numbers)), ~lost
        numbers[lost] = np.interp(at[lost], at[known], numbers[known]) if known.any() else 0.0
        filled[name] = numbers.tolist()
        gaps[name] = [*before, *(each for each in at[lost].tolist() if each not in before)]
    return {**values, "data": filled, "missing": gaps} if gaps else values


def _si_unit(unit: str) -> str:
    """Return the SI unit of a channel in a unit, "1" where it has another name."""
    for name in ("1", "m", "m/s", "m/s2", "Pa", "N", "N/m"):
        try:
            factor(unit, name)
        except ValueError:
            continue
        return name
    return "1"


def _from_text(
    path: Path, instrument: str, channels: object
) -> tuple[list[float], dict[str, list[float]], dict[str, str]]:
    columns = number_files.with_units(path, "s", gaps=True)
    (_, (times, unit)), *rest = columns.items()
    if not rest:
        raise ValueError(f"{path}: has one column; it needs the time and one channel or more, as velocity (m/s)")
    seconds = (np.array(times) * float(factor(unit, "s"))).tolist()
    own = [(name, _own(name, instrument), values) for name, values in rest]
    if any(channel is not None for _, channel, _ in own):  # columns of several instruments
        own = [each for each in own if each[1] is not None]
    named = {channel or name: values for name, channel, values in own}
    data = {name: column for name, (column, _) in named.items()}
    return seconds, data, {name: unit for name, (_, unit) in named.items()}


def _own(column: str, instrument: str) -> str | None:
    """Return the channel of a column that is called `G1`, `G1.extension_1` or `G1 45 deg`; None of other columns."""
    first, rest = column[: len(instrument)], column[len(instrument) :]
    if first.lower() != instrument.lower() or (rest and rest[0] not in ". "):
        return None
    return rest[1:].strip() or instrument


def _aliases(channels: Sequence[Channel], instrument: str) -> dict[str, Channel]:
    """Return the channels by the names that columns of a file may have."""
    names = {instrument: channels[0]} if len(channels) == 1 else {}
    for channel in channels:
        if match := _ANGLE.search(channel.long_name):
            names |= {f"{float(match[1]):g}{unit}": channel for unit in (" deg", "deg", "°", " °")}
    return names | {channel.name: channel for channel in channels}


def _from_run(
    path: Path, instrument: str, channels: object
) -> tuple[list[float], dict[str, list[float]], dict[str, str]]:
    with opened(path) as file:
        if file.groups and instrument not in file.groups:
            raise ValueError(f"{path}: has no instrument '{instrument}', {nearest(instrument, list(file.groups))}")
        group = file[instrument] if file.groups else file
        names = [name for name in group.variables if name != "time" and group[name].dimensions == ("time",)]
        if "time" not in group.variables or not names:
            raise ValueError(f"{path}: needs a variable 'time' and channels with the dimension 'time'")
        if isinstance(channels, Sequence):  # others may have missing values
            names = [name for name in names if name in channels] or names
        _, seconds = unit_and_factor(path, "time", group["time"].attrs, "s")
        times = seconds * unpacked(path, group["time"], number_files.MOST_LINES)
        units = {name: unit_and_factor(path, name, group[name].attrs, None)[0] for name in names}
        data = {name: unpacked(path, group[name], number_files.MOST_LINES) for name in names}
        for name, each in (("time", times), *data.items()):
            wrong = ~np.isfinite(each) if name == "time" else np.isinf(each)
            if wrong.any():
                remedy = "leave out these times" if name == "time" else "write NaN for a missing sample"
                raise ValueError(
                    f"{path}: '{name}' has no finite number at {wrong.sum()} of {len(each)} times, the first at "
                    f"index {np.argmax(wrong)}; {remedy}"
                )
        return times.tolist(), {name: each.tolist() for name, each in data.items()}, units
