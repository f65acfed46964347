"""Definition of a study: a case, its axes, and their sampling; read from one TOML file."""

from __future__ import annotations

import copy
import hashlib
import itertools
import json
import math
import shlex
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, ModelWrapValidatorHandler, ValidationError, ValidationInfo, model_validator

from ruptfx import Table
from ruptfx.case import Case, override, parse_case, read_toml
from ruptfx.input.plugins import active, named
from ruptfx.input.quantities import at_least, at_most, require_units, si_and_units
from ruptfx.input.schema import CaseError, CasePath, Name, Part, nearest, set_key, unit_of_key
from ruptfx.input.units import Duration, Fraction
from ruptfx.many_runs.study.goals import Search

if TYPE_CHECKING:
    from ruptfx.lumped import LumpedModel

Coordinates = Table
MOST_POINTS = 1_000_000
BOOKKEEPING = ("origin", "status", "fine_mesh", "seconds", "error", "point")
"""Columns of the table besides axes and quantities."""
OF_SETS = ("set", "generation", "score")
"""Columns of the scores of a search besides its axes."""


class Axis(Part):
    """One direction of a study: a key of the case and the values it takes.

    `values` are listed explicitly; `range` and `points` generate evenly spaced ones, linearly or logarithmically.
    Several keys can change together: `key` is then a list and every value a list of the same length.
    """

    key: str | Annotated[list[str], Field(min_length=1)]
    """Dotted key of the case, or several that take the same value."""
    name: Name | None = None
    """Column of the table; default is the last word of the key."""
    label: str = ""
    """Label in figures."""
    unit: str = "1"
    """Unit of the values in figures; default is that of the key."""
    values: Annotated[list[Any], Field(min_length=1)] | None = None
    """The values, of any type the key takes; texts with a unit are read as numbers in the SI unit of the key."""
    labels: list[str] | list[float] | None = None
    """Labels of the values in tables and figures: names or numbers."""
    range: Annotated[list[float], Field(min_length=2, max_length=2)] | None = None
    """First and last value, instead of `values`; numbers or texts with a unit."""
    points: Annotated[int, Field(ge=2)] | None = None
    """Number of values in the range."""
    spacing: Literal["linear", "log"] = "linear"
    """Spacing of the values in the range."""

    @model_validator(mode="after")
    def _consistent(self) -> Axis:
        if (self.values is None) == (self.range is None):
            raise ValueError("give either values or range")
        if self.range is not None:
            low, high = self.range
            if not low < high or (self.spacing == "log" and low <= 0):
                raise ValueError(f"range = [{low:g}, {high:g}]: must increase, and be positive where spacing is log")
        twice = next((v for i, v in enumerate(self.values or []) if v in (self.values or [])[:i]), None)
        if twice is not None:
            raise ValueError(f"values: {twice} is there twice; remove one")
        rows = self.values or [None]
        if isinstance(self.key, list) and any(not isinstance(v, list) or len(v) != len(self.key) for v in rows):
            raise ValueError(f"key names {len(self.key)} keys; give a list of as many values at each place")
        if self.labels is not None and len(self.labels) != len(self.values or []):
            raise ValueError(f"labels: {len(self.labels)} for {len(self.values or [])} values; give one for each value")
        shown = self.labels or []
        same = next((label for i, label in enumerate(shown) if label in shown[:i]), None)
        if same is not None:
            raise ValueError(f"labels: {same!r} is there twice; rename one, so that tables tell the values apart")
        return self

    @property
    def keys(self) -> list[str]:
        """Dotted keys of the case."""
        return self.key if isinstance(self.key, list) else [self.key]

    @property
    def column(self) -> str:
        """Name of the column in the table."""
        return self.name or self.keys[0].rpartition(".")[2]

    @property
    def repeats(self) -> bool:
        """True if the values are seeds, hence further draws of the same point."""
        return all(key.rpartition(".")[2] == "seed" for key in self.keys)

    @property
    def numeric(self) -> bool:
        """True if the coordinates are numbers."""
        shown = self.labels if self.labels is not None else self.values or []
        return all(isinstance(value, int | float) and not isinstance(value, bool) for value in shown)

    def sequence(self) -> list[Any]:
        """Return the values of a grid, in the order of the file."""
        if self.values is not None:
            return list(self.values)
        if self.points is None:
            raise CaseError(f"axes: {self.column}: a range on a grid needs points; give their number")
        return [self.value(part) for part in np.linspace(0, 1, self.points)]

    def value(self, part: float) -> float:
        """Return the value at a fraction `part` of the range, rounded to six digits for portability."""
        low, high = self.range or (0.0, 1.0)
        value = low * (high / low) ** part if self.spacing == "log" else low + (high - low) * part
        return {0.0: low, 1.0: high}.get(float(part), float(f"{value:.6g}"))

    def part(self, value: float) -> float:
        """Return the fraction of the range at a value, from 0 to 1: the inverse of `value`."""
        low, high = self.range or (0.0, 1.0)
        return math.log(value / low) / math.log(high / low) if self.spacing == "log" else (value - low) / (high - low)

    def middle(self, low: float, high: float) -> float:
        """Return the midpoint of two values, in the spacing of the axis."""
        value = np.sqrt(low * high) if self.spacing == "log" else 0.5 * (low + high)
        return float(f"{value:.6g}")

    def distance(self, low: float, high: float) -> float:
        """Return the distance of two values as a fraction of the whole axis."""
        ends = self.range or [min(self.values or []), max(self.values or [])]
        scale = np.log if self.spacing == "log" else np.asarray
        return float(abs(scale(high) - scale(low)) / (scale(ends[1]) - scale(ends[0])))

    def coordinate(self, value: object) -> Any:
        """Return the table entry of a value: the number, its label, or the text of a list."""
        if self.labels is not None and value in (self.values or []):
            return self.labels[(self.values or []).index(value)]
        return value if isinstance(value, str | int | float) else json.dumps(value, default=str)


class Refine(Part):
    """Refinement of mode boundaries with `--refine`."""

    width: Fraction = 0.05
    """Width to which a boundary between two modes is located, as a part of the axis."""
    by: str = "mode"
    """Quantity whose change defines a boundary."""
    fine: Table = {}
    """Keys of the case for the second, finer mesh on which boundary points run again."""


class Mark(Part):
    """A point marked in figures, for example a published one."""

    label: str
    """Text beside the mark."""
    point: Annotated[list[float], Field(min_length=2, max_length=2)]
    """Its values on the first two axes."""


@dataclass(frozen=True)
class Point:
    """One run of a study.

    Attributes
    ----------
    coordinates : dict
        Table entries, by axis.
    values : dict
        Value of every axis.
    case : Case or lumped model
    origin : str
        sample, refined or fine.
    """

    coordinates: Coordinates
    values: Table = field(repr=False)
    case: Case | LumpedModel = field(repr=False)
    origin: str = "sample"

    @property
    def hash(self) -> str:
        """Hash of the case, which identifies the point."""
        return self.case.hash


class Study(Part):
    """A case and its variation.

    On a grid all values of all axes are combined. In a Latin hypercube the axes given by a range are sampled
    together and each sample is combined with all values of the other axes; so is each set of a search (`cma_es`).

    Raises
    ------
    CaseError
        Naming the key, its value and the remedy.
    """

    title: str = ""
    """Title of figures."""
    case: CasePath
    """Case file, relative to the study file."""
    plugins: list[CasePath] = []
    """Python files that define further kinds, relative to the study file, besides those of the case."""
    set: Table = {}
    """Keys of the case that differ from the file at every point; a table with a `kind` replaces the file's one."""
    axes: Annotated[list[Axis], Field(min_length=1)]
    """Axes, one table each."""
    sampling: Literal["grid", "latin_hypercube", "search", "cma_es"] = "grid"
    """All combinations (grid); or, over the axes with a range, a Latin hypercube or a search for the best set by
    `search.method`, for which `cma_es` is the method of that name."""
    samples: Annotated[int, Field(ge=1)] | None = None
    """Number of points of the hypercube, or of sets of the search."""
    seed: Annotated[int, Field(ge=0)] = 0
    """Seed of the hypercube or the search."""
    search: Search | None = None
    """Goals and options of a search."""
    ranks: Annotated[int, Field(ge=1)] = 1
    """MPI ranks of every run."""
    time_limit: Duration | None = None
    """Wall-clock time after which a point counts as failed [s]."""
    keep: list[Literal["pictures", "run"]] = ["pictures"]
    """Kept besides the scalars: pictures for the page, or the whole run directory."""
    quantities: list[str] = []
    """Columns of the table; default is every scalar of the summary."""
    refine: Refine = Refine()
    """Accuracy of boundaries, and the finer mesh on which boundary points run again."""
    marks: list[Mark] = []
    """Points marked in figures."""

    @model_validator(mode="wrap")
    @classmethod
    def _with_plugins(cls, values: object, handler: ModelWrapValidatorHandler[Self], info: ValidationInfo) -> Self:
        loaded = named(values, (info.context or {}).get("directory")) if isinstance(values, Mapping) else []
        with active(loaded):
            return handler(values)

    @model_validator(mode="after")
    def _consistent(self) -> Study:
        columns = [axis.column for axis in self.axes]
        twice = next((c for c in columns if columns.count(c) > 1), None)
        if twice:
            raise ValueError(f"two axes are called '{twice}'; give them different names")
        reserved = [*BOOKKEEPING, *self.quantities, *(OF_SETS if self.search is not None else ())]
        match = next((c for c in columns if c in reserved), None)
        if match:
            raise ValueError(f"axes: the table has a column '{match}' of its own; give the axis another name")
        self._require_single_writers()
        if self.sampling != "grid" and (self.samples is None or not self.sampled):
            raise ValueError(f"a {self.sampling} needs samples and at least one axis with a range")
        if (self.sampling in ("search", "cma_es")) != (self.search is not None):
            raise ValueError('sampling = "search" or "cma_es", and the table [search]: give both or none of them')
        if self.search is not None:
            if self.sampling == "cma_es" and self.search.method.kind() != "cma_es":
                kind = self.search.method.kind()
                raise ValueError(f'search.method = "{kind}": needs sampling = "search", not "cma_es"')
            self._check_search(self.search)
        crossed = [len(axis.values or []) or axis.points or 1 for axis in self.axes if axis not in self.sampled]
        count = math.prod(crossed) * (self.samples or 1 if self.sampled else 1)
        if count > MOST_POINTS:
            raise ValueError(f"{count} points, the most are {MOST_POINTS}: take fewer values, points or samples")
        return self

    def _require_single_writers(self) -> None:
        """Refuse a study that writes the same value of the case twice, as the last one would win."""
        try:
            table = self.base()
        except CaseError:  # `points` raises it
            table = {}
        keys = [
            (f"axes.{number}", key, _path(key, table)) for number, axis in enumerate(self.axes) for key in axis.keys
        ]
        for (where, key, path), (later, other, other_path) in itertools.combinations(keys, 2):
            if _begins(path, other_path) or _begins(other_path, path):
                raise ValueError(
                    f"{later}.key = '{other}': {where}.key = '{key}' writes the same value; remove one of them, or "
                    "make one axis of both (a list as key, lists as values)"
                )
        # A list in [set] may contain an element that an axis varies: the element exists only with the list.
        written = [("set", key) for key in _flat(self.set, whole=False)]
        written += [("refine.fine", key) for key in _flat(self.refine.fine)]
        for (where, key, path), (table_name, other) in itertools.product(keys, written):
            other_path = _path(other, table)
            if _begins(other_path, path) or (table_name == "refine.fine" and _begins(path, other_path)):
                raise ValueError(
                    f"{table_name}.{other}: {where}.key = '{key}' writes the same value; remove it from {table_name}"
                )

    def require_quantities(self, case: Case | LumpedModel, collection: Collection[str] = ()) -> None:
        """Refuse quantities that no run of this case has.

        Parameters
        ----------
        case : Case or lumped model
            Case of a point. The scalars of a case with bodies are known before a run, those of a lumped model are not.
        collection : collection of str
            Names of the scalars of finished runs.

        Raises
        ------
        CaseError
            Names each wrong key and the nearest scalar.
        """
        from ruptfx.many_runs.study.harvest import scalars

        known = {*collection, *(scalars(case.faults) if isinstance(case, Case) else ())}
        names = [(f"quantities.{number}", name) for number, name in enumerate(self.quantities)]
        goals = self.search.goals if self.search is not None else []
        names += [(f"search.goals.{number}.quantity", goal.quantity) for number, goal in enumerate(goals)]
        names += [("refine.by", self.refine.by)] if "by" in self.refine.model_fields_set else []
        wrong = [f"{key} = '{name}': no run has it, {nearest(name, list(known))}" for key, name in names
                 if name not in known]  # fmt: skip
        if known and wrong:
            raise CaseError("\n".join(wrong))

    def _check_search(self, search: Search) -> None:
        sampled = {axis.column: axis for axis in self.sampled}
        crossed = {axis.column: axis for axis in self.axes if axis.column not in sampled}
        for name, value in search.start.items():
            if name not in sampled:
                raise ValueError(f"search.start.{name}: no axis with a range, {nearest(name, list(sampled))}")
            low, high = sampled[name].range or (-math.inf, math.inf)
            if not low <= value <= high:
                raise ValueError(
                    f"search.start.{name} = {value:g}: outside of its range, {at_least(low)} to {at_most(high)}; give "
                    "a value in it"
                )
        for number, goal in enumerate(search.goals):
            for name, value in goal.where.items():
                where = f"search.goals.{number}.where.{name}"
                if name not in crossed:
                    raise ValueError(f"{where}: no axis without a range, {nearest(name, list(crossed))}")
                known = [crossed[name].coordinate(one) for one in crossed[name].sequence()]
                if value not in known:
                    raise ValueError(f"{where} = {value}: known are {', '.join(map(str, known))}; use one of these")

    @property
    def sampled(self) -> list[Axis]:
        """Axes sampled by a Latin hypercube or a search; empty on a grid."""
        return [axis for axis in self.axes if axis.range is not None] if self.sampling != "grid" else []

    def axis(self, column: str) -> Axis:
        """Return the axis of a column."""
        return next(axis for axis in self.axes if axis.column == column)

    def base(self, overrides: Mapping[str, object] | None = None) -> Table:
        """Return the tables of the case with `set` and further dotted keys; not yet checked."""
        path = Path(self.case)
        try:
            table = read_toml(path)
        except CaseError as error:
            raise CaseError(f"case = {error}") from None
        quiet = {} if "kind" in table else {"output.figures": False}
        for key, value in {**quiet, **_flat(self.set), **(overrides or {})}.items():
            set_key(table, key, copy.deepcopy(value))
        plugins = table.get("plugins", [])
        if self.plugins and isinstance(plugins, list):
            table["plugins"] = [*plugins, *self.plugins]
        return table

    @property
    def plane(self) -> str:
        """Plane of the cases; empty for lumped models, where it varies, and where the case file is gone."""
        if any("plane" in axis.keys for axis in self.axes):
            return ""
        try:
            return str(self.base().get("plane", ""))
        except CaseError:
            return ""

    def identity(self) -> Table:
        """Return what identifies a study: the hash of its case without the axes, and the keys of the axes."""
        table = self.base()
        table.pop("title", None)
        table.pop("plugins", None)  # the hash of every point includes their content
        keys = sorted(key for axis in self.axes for key in axis.keys)
        case = {key: value for key, value in _flat(table, whole=False).items() if key not in keys}
        text = json.dumps(case, sort_keys=True, default=str)
        return {"axes": keys, "case": hashlib.sha256(text.encode()).hexdigest()[:16]}

    def combinations(self) -> Iterator[Table]:
        """Yield the values of the axes, point by point; for a search those of its first set."""
        samples = self._hypercube() if self.search is None else [self.start(self.search)]
        for sample in samples:
            yield from self.crossed(sample)

    def crossed(self, sample: Mapping[str, float]) -> Iterator[Table]:
        """Yield a sample of the axes with a range, combined with all values of the others."""
        axes = [axis for axis in self.axes if axis not in self.sampled]
        for row in itertools.product(*(axis.sequence() for axis in axes)):
            values = {**sample, **dict(zip((axis.column for axis in axes), row, strict=True))}
            yield {axis.column: values[axis.column] for axis in self.axes}

    def start(self, search: Search) -> dict[str, float]:
        """Return the first set of a search."""
        return {axis.column: search.start.get(axis.column, axis.value(0.5)) for axis in self.sampled}

    def _hypercube(self) -> Iterator[dict[str, float]]:
        if not self.sampled:
            yield {}
            return
        from scipy.stats import qmc

        unit = qmc.LatinHypercube(len(self.sampled), rng=self.seed).random(self.samples or 1)
        for row in unit:
            yield {axis.column: axis.value(part) for axis, part in zip(self.sampled, row, strict=True)}

    def points(self) -> list[Point]:
        """Return all points of the grid or of the hypercube, checked.

        Raises
        ------
        CaseError
            The case file cannot be used, an axis names no key, a value is refused, or no run has a quantity.
        """
        table = self.base()
        points = [self.point(values, table=table) for values in self.combinations()]
        self.require_quantities(points[0].case)
        return points

    def point(
        self,
        values: Mapping[str, Any],
        origin: str = "sample",
        overrides: Mapping[str, object] | None = None,
        table: Table | None = None,
    ) -> Point:
        """Return the point with these values of the axes and, optionally, further keys of the case."""
        table = copy.deepcopy(table or self.base())
        coordinates = {axis.column: axis.coordinate(values[axis.column]) for axis in self.axes}
        shown = ", ".join(f"{name} = {value}" for name, value in coordinates.items())
        try:
            for axis in self.axes:
                value = values[axis.column]
                for key, one in zip(axis.keys, value if isinstance(axis.key, list) else [value], strict=True):
                    set_key(table, key, one)
            for key, value in _flat(overrides or {}).items():
                set_key(table, key, value)
            return Point(coordinates, dict(values), parse_case(table, Path(self.case).parent), origin)
        except CaseError as error:
            astray = [hint for axis in self.axes for key in axis.keys if (hint := _astray(key, self.base()))]
            raise CaseError("\n".join([*astray, f"point {shown}: {error}"])) from None


def read_study(path: str | Path, overrides: Iterable[str] = ()) -> Study:
    """Read and check a study file.

    Parameters
    ----------
    path : str or Path
        TOML file.
    overrides : iterable of str
        ``"mesh.element_size=2e-3"``: keys of the case that change at every point.

    Raises
    ------
    CaseError
        File missing, not TOML or a case; unknown keys, wrong types, axes that do not fit together.
    """
    path = Path(path)
    table = read_toml(path)
    if "axes" not in table and ("duration" in table or "kind" in table):
        raise CaseError(f"{path}: a case, not a study; run it with: ruptfx run {shlex.quote(str(path))}")
    changes: Table = {}
    for item in overrides:
        override(changes, item)
    value = table.get("set", {})
    if changes and isinstance(value, Mapping):
        table["set"] = {**_flat(value), **_flat(changes)}
    table, units = _in_si(table)
    try:
        study = Study.model_validate(table, context={"directory": path.resolve().parent})
    except ValidationError as error:
        lines = str(CaseError.from_validation(error)).splitlines()
        raise CaseError("\n".join(f"{path}: {line}" for line in lines)) from None
    return _with_units(study, units)


def _in_si(table: Table) -> tuple[Table, list[tuple[str, int, int, list[str]]]]:
    """Return the tables of a study with quantities as numbers in SI units, and the units of the axes.

    The units are those of the key of a name in an axis: name, number of the axis, of its key, units.
    """
    axes, value = [], []
    for number, axis in enumerate(_list_of(table.get("axes"))):
        axis = dict(axis) if isinstance(axis, Mapping) else axis
        for name in ("values", "range") if isinstance(axis, dict) else ():
            together = name == "values" and isinstance(axis.get("key"), list)
            items = _list_of(axis.get(name))
            for place in range(len(axis["key"]) if together else 1):
                of_key = [row[place] if together and len(_list_of(row)) > place else row for row in items]
                value.append((name, number, place, si_and_units(of_key)[1]))
            if items:
                axis[name] = si_and_units(items)[0]
        axes.append(axis)
    search = table.get("search")
    changes: Table = {"axes": axes} if axes else {}
    if isinstance(search, Mapping) and isinstance(search.get("start"), Mapping):
        changes["search"] = {**search, "start": {k: si_and_units(v)[0] for k, v in search["start"].items()}}
    if marks := [mark for mark in _list_of(table.get("marks")) if isinstance(mark, Mapping)]:
        changes["marks"] = [{**mark, "point": si_and_units(mark.get("point"))[0]} for mark in marks]
    return {**table, **changes}, value


def _list_of(value: object) -> list[Any]:
    return value if isinstance(value, list) else []


def _with_units(study: Study, items: Iterable[tuple[str, int, int, list[str]]]) -> Study:
    """Return the study with the unit of the key for every axis without one; unchanged if its first point is refused.

    Raises
    ------
    CaseError
        A unit of an axis is of another kind than that of its key.
    """
    try:
        case = study.point(next(study.combinations())).case
    except CaseError:  # `points` raises it again
        return study
    for name, number, place, texts in items:
        key = study.axes[number].keys[place]
        try:
            require_units(f"axes.{number}.{name}, {key}", texts, unit_of_key(case, key))
        except ValueError as error:
            raise CaseError(str(error)) from None
    units = [axis.unit if axis.unit != "1" or axis.labels else unit_of_key(case, axis.keys[0]) for axis in study.axes]
    axes = [axis.model_copy(update={"unit": unit}) for axis, unit in zip(study.axes, units, strict=True)]
    return study.model_copy(update={"axes": axes})


def _path(key: str, table: object) -> tuple[str | int, ...]:
    """Return names and indices along a dotted key; list indices are counted from the start."""
    path: list[str | int] = []
    node: object = table
    for name in key.split("."):
        word: str | int = name
        if isinstance(node, list):
            try:
                word = int(name) % len(node)
                node = node[word]
            except (ValueError, ZeroDivisionError):
                node = None
        else:
            node = node.get(name) if isinstance(node, Mapping) else None
        path.append(word)
    return tuple(path)


def _begins(path: tuple[str | int, ...], beginning: tuple[str | int, ...]) -> bool:
    """Return whether a path equals or continues another one."""
    return path[: len(beginning)] == beginning


def _astray(key: str, table: object) -> str:
    """Return a message with the first table of a dotted key that the case does not have; empty if there is none."""
    seen: list[str] = []
    for name in key.split(".")[:-1]:
        if not isinstance(table, Mapping):
            return ""
        if name not in table and seen:
            where = ".".join(seen)
            return f"axes: '{key}': the case has no '{where}.{name}', {nearest(name, list(table))}"
        table = table.get(name)
        seen.append(name)
    return ""


def _flat(table: Mapping[str, object], prefix: str = "", whole: bool = True) -> Table:
    """Return dotted keys of nested tables and of lists of tables; tables with a `kind` stay whole on request."""
    flat: Table = {}
    for key, value in table.items():
        if isinstance(value, Mapping) and not (whole and "kind" in value):
            flat |= _flat(value, f"{prefix}{key}.", whole)
        elif isinstance(value, list) and any(isinstance(item, Mapping) for item in value):
            flat |= _flat({str(i): item for i, item in enumerate(value)}, f"{prefix}{key}.", whole)
        else:
            flat[f"{prefix}{key}"] = value
    return flat
