"""Gradient of the objective of a case by its unknowns."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ruptfx import RuptfxError
from ruptfx.case import Case
from ruptfx.input.schema import CaseError
from ruptfx.many_runs.adjoint.bodies import ConstantChange
from ruptfx.many_runs.adjoint.comparison import SIZE, Comparison
from ruptfx.many_runs.adjoint.differences import check_use, runs_at_once
from ruptfx.many_runs.adjoint.history import LARGEST
from ruptfx.many_runs.adjoint.sweeps import Sweeps, Told
from ruptfx.many_runs.adjoint.unknowns import (
    Place,
    at_points,
    changed_model,
    chosen,
    hats,
    single_changes,
    untied,
    whole,
)
from ruptfx.platform import fem, parallel
from ruptfx.platform.progress import Progress, working
from ruptfx.readings.instruments.model_readings import ModelReadings
from ruptfx.readings.misfits import Misfit, Request, Sample, Trace, Unknown
from ruptfx.run.model import Model
from ruptfx.run.simulation import interruptible_progress

if TYPE_CHECKING:
    import xarray

Floats = NDArray[np.float64]
Runs = Callable[[Sequence[tuple[Place, float]], Callable[[int], None]], list[float]]
"""Makes runs in which one unknown each is changed, tells how many are finished, and returns their objectives."""


@dataclass(frozen=True)
class Derivative:
    """Derivative of the objective by one unknown, at all points of its interface in their order; on all ranks.

    By a constant of bodies it is one value.

    Attributes
    ----------
    unknown : Unknown
    place : Place
    values : ndarray, shape (n,)
        By the value at each point.
    """

    unknown: Unknown
    place: Place
    values: Floats


class Objective:
    """The objective of a case: a run, its value and its gradient.

    Parameters
    ----------
    comm : MPI communicator
    most : float
        Largest memory of the history of the interfaces and of checkpoints on all ranks [bytes].
    tell : callable
        Called with the finished fraction of the run and a text.
    model : Model, optional
        Of the case, with other initial tractions or parameters.
    record : bool
        Whether a gradient is needed.

    Attributes
    ----------
    value : float
    unit : str
    samples : list of (str, Sample)
        Readings of all terms with their names.
    sweeps : Sweeps
    """

    def __init__(
        self, case: Case, terms: Sequence[Misfit], comm: fem.MPI.Comm | None = None, most: float = LARGEST,
        tell: Told = lambda done, text: None, model: Model | None = None, record: bool = True,
    ) -> None:  # fmt: skip
        self.case, self.terms = case, list(terms)
        self.unit = _unit(self.terms)
        self.model = model or Model(case, comm)
        refuse(self.model)
        self._counts: list[int] = []
        names: list[str] = []

        def requests(model: Model, dt: float, steps: int) -> list[Request]:
            # Stress of one everywhere: what contains the initial stress has an offset.
            bodies = ModelReadings(model, lambda points: np.ones((len(points), 6)))
            items = [term.requests(bodies, f"objective.{number}") for number, term in enumerate(self.terms)]
            self._counts = [len(each) for each in items]
            terms_of_all = [each for of_term in items for each in of_term]
            names.extend(each.channel.name if isinstance(each, Trace) else each.field for each in terms_of_all)
            return terms_of_all

        self.sweeps = Sweeps(self.model, requests, most, tell, record)
        self.samples = list(zip(names, self.sweeps.samples, strict=True))
        self.value, self._factors = self._evaluate()

    def _evaluate(self) -> tuple[float, list[Floats]]:
        total, factors = 0.0, []
        for term, samples in self._samples():
            value, slopes = term.evaluate(samples)
            total += value
            factors += slopes
        return total, factors

    def gradient(self, unknowns: Sequence[Unknown] = (), tell: Told = lambda done, text: None) -> list[Derivative]:
        """Return the derivatives by the given unknowns, or all of the case; collective."""
        return self._derivatives(self._factors, unknowns, tell)

    def _derivatives(self, factors: list[Floats], unknowns: Sequence[Unknown], tell: Told) -> list[Derivative]:
        every = chosen(self.sweeps.model, unknowns, self.terms)
        single = self._by_places(factors, [member for _, place in every for member, _ in place.members], tell)
        result = []
        for unknown, place in every:
            if place.tied:
                values = np.array([sum(part * single[member.key].sum() for member, part in place.tied)])
            else:
                values = single[place.key]
            result.append(Derivative(unknown, place, values))
        return result

    def _by_places(self, factors: list[Floats], every: Sequence[Place], tell: Told) -> dict[str, Floats]:
        """Return the derivatives by untied keys."""
        result = self._by_constants(factors, [place for place in every if place.constant is not None], tell)
        items = [place for place in every if place.of_points]
        points = self.sweeps.points
        loaded = {place.key: np.zeros(len(points[place.fault].fault.interface.weight)) for place in items}

        def each_step(fault: int, time: float, of_parameters: Floats) -> None:
            for place in items:
                if place.nucleation is not None and place.fault == fault:
                    acts_on = points[fault].fault
                    of_shear = np.einsum("nk,kn->n", acts_on.shear_direction, of_parameters[1 : 1 + acts_on.tangents])
                    loaded[place.key] += place.nucleation.shear_traction(acts_on.interface.locations, time) * of_shear

        gradient = self.sweeps.adjoint(factors, each_step, tell) if items else []
        for place in every:
            if place.term is not None:
                result[place.key] = np.array([float(np.concatenate(factors) @ self._by_term(*place.term))])
        for place in items:
            names = list(points[place.fault].parameters)
            slope = sum(part * gradient[place.fault][names.index(name)] for name, part in place.rows)
            result[place.key] = self._whole(place.fault, loaded[place.key] + slope)
        return result

    def _by_constants(self, factors: list[Floats], items: list[Place], tell: Told) -> dict[str, Floats]:
        """Return the derivatives by constants of bodies, by key: a tangent-linear sweep for each, all in one run."""
        sweeps = self.sweeps
        changes = [ConstantChange(sweeps.model, *place.constant) for place in items if place.constant is not None]
        readings = sweeps.tangents_of_bodies(changes, tell)
        return {
            place.key: np.array([sum(float(a @ b) for a, b in zip(factors, of_constant, strict=True))])
            for place, of_constant in zip(items, readings, strict=True)
        }  # fmt: skip

    def _samples(self) -> Iterator[tuple[Misfit, list[Sample]]]:
        """Yield every term with its samples."""
        for term, (begin, end) in zip(self.terms, pairwise(np.cumsum([0, *self._counts]).tolist()), strict=True):
            yield term, self.sweeps.samples[begin:end]

    def expected(self) -> list[Floats]:
        """Return what the data of all readings would be without noise."""
        return [values for term, samples in self._samples() for values in term.expected(samples)]

    def _by_term(self, number: int, name: str) -> Floats:
        """Return the derivative of all readings, one after the other, by a parameter of a term."""
        result = list[Floats]()
        for index, (term, samples) in enumerate(self._samples()):
            if index == number:
                result += term.change(name, samples)
            else:
                result += [np.zeros(len(sample.values)) for sample in samples]
        return np.concatenate(result)

    def residuals(self) -> tuple[Floats, Floats] | None:
        """Return the residuals of all readings and their derivatives by the values; None if a term has none."""
        result = []
        for term, samples in self._samples():
            if (of_term := term.residuals(samples)) is None:
                return None
            result += of_term
        return np.concatenate([r for r, _ in result]), np.concatenate([factor for _, factor in result])

    def change(self, changes: Sequence[tuple[Place, Floats]], tell: Told = lambda done, text: None) -> Floats:
        """Return the changes of all readings, one after the other, from those of unknowns; collective.

        Parameters
        ----------
        changes : sequence of (Place, ndarray)
            Changes at all points of the interface of the place in their order, or of a number.
        tell : callable
            Called with the finished fraction and a text.
        """
        of_parameters = [np.zeros_like(each) for each in self.sweeps.parameters]
        of_nucleations = []
        of_terms = np.zeros(sum(len(sample.values) for sample in self.sweeps.samples))
        for place, values in untied(changes):
            if place.term is not None:
                of_terms = of_terms + float(values[0]) * self._by_term(*place.term)
                continue
            points = self.sweeps.points[place.fault]
            here = at_points(values, points.fault.interface)
            if place.nucleation is not None:
                of_nucleations.append((place.fault, place.nucleation, here))
            names = list(points.parameters)
            for name, part in place.rows:
                of_parameters[place.fault][names.index(name)] += part * here

        def loads(fault: int, time: float) -> Floats | None:
            places = self.sweeps.points[fault].fault.interface.locations
            mine = [each.shear_traction(places, time) * here for which, each, here in of_nucleations if which == fault]
            return np.sum(mine, axis=0) if mine else None

        if not any(place.of_points for place, _ in untied(changes)):
            return of_terms
        return of_terms + np.concatenate(self.sweeps.tangent(of_parameters, loads, tell))

    def pull(
        self, factors: Floats, unknowns: Sequence[Unknown], tell: Told = lambda done, text: None
    ) -> list[Derivative]:
        """Return the factors of unknowns from those of all readings, one after the other; collective."""
        ends = np.cumsum([len(each.values) for each in self.sweeps.samples])[:-1]
        return self._derivatives(np.split(factors, ends), unknowns, tell)

    def _whole(self, number: int, values: Floats) -> Floats:
        return whole(self.sweeps.model, self.sweeps.points[number].fault.interface, values)

    def dataset(self, derivatives: Sequence[Derivative]) -> xarray.Dataset:
        """Return value and derivatives with positions and units; collective."""
        import xarray

        data: dict[str, object] = {"objective": ((), self.value, {"units": self.unit, "long_name": "objective"})}
        coordinates: dict[str, object] = {}
        for number in sorted({each.place.fault for each in derivatives if each.place.of_points}):
            fault = self.sweeps.points[number].fault
            face, dim = fault.interface, f"point_{fault.name}"
            coordinates[f"position_{fault.name}"] = (
                dim,
                self._whole(number, face.position),
                {"units": "m", "long_name": f"position, {face.line.meaning}"},
            )
            if face.across is not None:
                coordinates[f"across_{fault.name}"] = (
                    dim,
                    self._whole(number, face.across),
                    {"units": "m", "long_name": "position along tangent 2"},
                )
            area = "m2" if face.across is not None else "m"
            data[f"weight_{fault.name}"] = (
                dim,
                self._whole(number, face.weight),
                {"units": area, "long_name": "tributary length or area"},
            )
        for index, each in enumerate(derivatives):
            by = f"({each.place.unit})" if set(each.place.unit) & set("/ ") else each.place.unit
            unit = f"{self.unit}/{by}" if by != "1" else self.unit
            about = {"units": unit, "unknown": each.unknown.key, "uniform_change": float(each.values.sum())}
            if each.unknown.shape == "number" or not each.place.of_points:
                data[each.unknown.key] = ((), float(each.values.sum()), {
                    **about, "long_name": f"derivative by {each.unknown.key}, a number",
                })  # fmt: skip
            elif each.unknown.shape == "knots":
                face = self.sweeps.points[each.place.fault].fault.interface
                of_knots = hats(each.unknown, face, self._whole(each.place.fault, face.position), f"unknowns.{index}")
                dim = f"knot_{index}"
                coordinates[dim] = (
                    dim,
                    np.array(each.unknown.knots),
                    {"units": "m", "long_name": f"knots of {each.unknown.key}"},
                )
                data[each.unknown.key] = (dim, of_knots.T @ each.values, {
                    **about, "long_name": f"derivative by {each.unknown.key} at each knot",
                })  # fmt: skip
            else:
                name = self.sweeps.points[each.place.fault].fault.name
                data[each.unknown.key] = (f"point_{name}", each.values, {
                    **about, "long_name": f"derivative by {each.unknown.key} at each point",
                })  # fmt: skip
        about = {"case_hash": self.case.hash, "title": self.case.title, **self.sweeps.made.attributes}
        return xarray.Dataset(data, coordinates, about)


def gradient(  # noqa: PLR0913
    case: Case, objective: Sequence[Misfit] | Misfit | None = None, unknowns: Sequence[Unknown | str] = (),
    comm: fem.MPI.Comm | None = None, progress: bool = True, memory: float = LARGEST, check: bool = False, *,
    cores: int = 1, scheduler: str | None = None,
) -> xarray.Dataset:  # fmt: skip
    """Return the objective of a case and its exact gradient; one run forward and one sweep backward; collective.

    Parameters
    ----------
    objective : Misfit or sequence of Misfit, optional
        Default is `[[objective]]` of the case.
    unknowns : sequence of Unknown or str
        Default is `[[unknowns]]` of the case; without any, all of its interfaces. Constants of bodies
        (`materials.default.young_modulus`) and the time shift of data (`objective.0.time_shift`) are given.
    comm : MPI communicator, optional
        Default is all ranks of the job.
    progress : bool
        Show progress bars on rank 0.
    memory : float
        Largest memory of the history of the interfaces and of checkpoints on all ranks [bytes]; what does not fit is
        computed again from the checkpoints, with the same result.
    check : bool
        Compare with differences of two more runs for each unknown of an interface, changed uniformly by 1e-4 of its
        value: attributes `by_differences` and `difference_step` beside `uniform_change`.
    cores : int
        With more than one, processes as those of a study make these runs at once. The result does not depend on it.
    scheduler : str, optional
        Address of a dask scheduler whose workers make these runs.

    Returns
    -------
    xarray.Dataset
        `objective`; for each unknown a variable of the name of its key: the derivative by the value at each
        point, by a number, or by the number at each knot. Attribute `uniform_change` is the derivative by a
        change that is the same at all points. Divide by `weight_FAULT` for the sensitivity per length, which
        does not depend on the mesh. The dataset's attributes `memory` [bytes], `checkpoints`, `forward_runs`
        and `history` say what the gradient took: `forward_runs` counts the steps forward over those of the run.

    Raises
    ------
    RuptfxError
        On all ranks, before the first step: no objective, unknowns that the case does not have, data outside of the
        run, features without an adjoint, `cores` or `scheduler` without `check` or on several ranks; after the sweep:
        a given unknown that the objective does not depend on, or a misfit of zero.
    """
    comm = fem.world(comm)
    terms = [objective] if isinstance(objective, Misfit) else list(objective or case.objective)
    if not terms:
        raise CaseError("objective: there is none; add an entry [[objective]], such as kind = 'final_slip'")
    items = [Unknown(key=each) if isinstance(each, str) else each for each in unknowns] or list(case.unknowns)
    show = progress and comm.rank == 0
    if cores > 1 or scheduler is not None:
        check_use(check, comm)
    with working("building the model", show):
        model = Model(case, comm)
    refuse(model)
    chosen(model.in_steps("explicit"), items, terms)  # refuses unknown keys before the first step
    with interruptible_progress(comm, show) as report:
        made = Objective(case, terms, comm, memory, report, model)
    if not np.isfinite(made.value):
        raise RuptfxError(
            f"objective = {made.value:g}: its gradient is no number; give a larger sigma, in the SI unit of the data"
        )
    with interruptible_progress(comm, show) as report:
        result = made.gradient(items, report)
    for each in items:
        values = next(one.values for one in result if one.unknown.key == each.key)
        if np.any(values):
            continue
        if made.value == 0 and any(np.any(sample.values) for _, sample in made.samples):
            raise RuptfxError(
                "objective = 0: the misfit is zero, the data are fitted exactly, and so is its gradient by "
                f"'{each.key}' zero at all points; differentiate at another value of an unknown, with --set KEY=VALUE, "
                "or give other data"
            )
        raise RuptfxError(
            f"unknowns: the objective does not depend on '{each.key}', its gradient is zero at all points; remove "
            "it, or choose an objective that feels it"
        )
    dataset = made.dataset(result)
    if check:
        with ExitStack() as stack:
            at_once = None
            if cores > 1 or scheduler is not None:
                at_once = stack.enter_context(runs_at_once(case, terms, cores, scheduler))
            compared = compare(made, result, tell=stack.enter_context(Progress(show)).update, at_once=at_once)
        for other in compared:
            dataset[other.key].attrs |= {"by_differences": other.by_differences, "difference_step": other.change}
    return dataset


def compare(
    made: Objective, derivatives: Sequence[Derivative], size: float = SIZE, tell: Told = lambda done, text: None,
    at_once: Runs | None = None,
) -> list[Comparison]:  # fmt: skip
    """Return derivatives by uniform changes of unknowns, and central differences; collective.

    Two runs are made for each unknown. Constants of bodies and of contact are left out: the time step depends on them.

    Parameters
    ----------
    made : Objective
        With the run of which the gradient is.
    size : float
        Change over the largest value of the unknown; of an unknown that is zero, over that of the normal stress if it
        is a stress, else 1 in its unit.
    tell : callable
        Called with the finished fraction and a text.
    at_once : callable, optional
        Makes the runs at once (`ruptfx.many_runs.adjoint.differences`); without it one is made after the other.
    """
    steps: list[tuple[Derivative, float]] = []
    for each in derivatives:
        place = each.place
        if not place.of_constant and not place.of_contact:
            steps.append((each, size * _scale(made, each)))
    changes = [(each.place, sign * step) for each, step in steps for sign in (1, -1)]
    count, values = len(changes), list[float]()
    if at_once is not None:
        values = at_once(changes, lambda done: tell(done / max(count, 1), f"differences  run {done} of {count}"))
    else:
        for number, (place, change) in enumerate(changes):

            def told(done: float, text: str, number: int = number) -> None:
                tell((number + done) / count, f"differences  run {number + 1} of {count}, {text}")

            single = single_changes(place, change)
            values.append(value_of_change(made.case, made.terms, made.sweeps.model, single, told))
    return [
        Comparison(each.place.key, each.place.unit, step, float(each.values.sum()), (up - down) / (2 * step))
        for (each, step), up, down in zip(steps, values[::2], values[1::2], strict=True)
    ]


def value_of_change(
    case: Case, terms: Sequence[Misfit], model: Model, changes: Sequence[tuple[Place, float]],
    tell: Told = lambda done, text: None,
) -> float:  # fmt: skip
    """Return the objective of a run in which unknowns are changed by the same at all points; collective.

    Parameters
    ----------
    model : Model
        Of the case, with the contact methods of explicit steps.
    changes : sequence of (Place, float)
        Of single keys, in their units.
    tell : callable
        Called with the finished fraction and a text.
    """
    terms = list(terms)
    for place, change in changes:
        if place.term is not None:
            number, name = place.term
            terms[number] = terms[number].substituted({name: float(getattr(terms[number], name)) + change})
    view = changed_model(model, [(place, np.array([change])) for place, change in changes])
    return Objective(case, terms, model.comm, tell=tell, model=view, record=False).value


def _scale(made: Objective, derivative: Derivative) -> float:
    """Return the largest size of an unknown along its interface, the duration for a time of data; collective."""
    place, factor = derivative.place.members[0]
    if place.term is not None:
        return made.case.duration if place.unit == "s" else 1.0
    parameters = made.sweeps.points[place.fault].parameters
    names = [name for name, _ in place.rows]
    if place.unit == "Pa":
        names.append("normal_stress_0")
    own = [float(np.abs(parameters[name]).max()) for name in names if np.size(parameters[name])]
    none = made.case.duration if place.unit == "s" else 1.0
    return (parallel.largest(made.model.comm, max(own, default=0.0)) or none) / abs(factor)


def refuse(model: Model) -> None:
    """Refuse what has no adjoint in a model.

    Raises
    ------
    CaseError
    """
    case = model.case
    if "adjoint" not in case.stepper.offers:
        raise CaseError(f"stepper.kind = '{case.stepper.kind()}': has no adjoint; use 'leapfrog'")
    if not model.faults:
        raise CaseError(
            "objective: the case has no interface, whose initial stress and law are the unknowns; add [faults.NAME]"
        )
    if case.stop_when is not None:
        raise CaseError("stop_when: the end of the run would depend on the unknowns; remove it")
    for each in model.mechanisms:
        if not each.adjoint:
            name = type(each).__module__.rpartition(".")[2]
            raise CaseError(f"objective: '{name}' has no adjoint ({type(each).__name__}); remove it from the case")
    for fault in model.faults:
        if fault.cohesion is not None:
            raise CaseError(f"faults.{fault.name}.cohesion: has no adjoint; remove it")
        if any(each.follows_motion for each in fault.fields.contributions):
            raise CaseError(
                f"faults.{fault.name}.pore_pressure: follows the motion and has no adjoint; use kind = 'given', or "
                "remove it"
            )
    if case.stages:
        raise CaseError("stages: have no adjoint; remove them")
    if not model.quadratic:
        raise CaseError("large_rotations: have no adjoint; remove the line")


def _unit(terms: Sequence[Misfit]) -> str:
    units = {term.unit: number for number, term in enumerate(terms)}
    if len(units) > 1:
        (one, first), (other, second) = list(units.items())[:2]
        raise CaseError(
            f"objective.{second}.kind = '{terms[second].kind()}': is in {other}, and objective.{first} in {one}; terms "
            "of one objective have the same unit; remove one of them"
        )
    return next(iter(units))
