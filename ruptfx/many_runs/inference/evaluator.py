"""Runs of a case with other values of its unknowns: misfit, gradient and Jacobian by the variables."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise, product

import numpy as np
from numpy.typing import NDArray

from ruptfx import RuptfxError
from ruptfx.case import Case
from ruptfx.input.schema import CaseError, value_at
from ruptfx.interfaces.faults.projection import ProjectionError
from ruptfx.many_runs.adjoint.gradients import Derivative, Objective, refuse
from ruptfx.many_runs.adjoint.sweeps import Told
from ruptfx.many_runs.adjoint.unknowns import Place, changed_model, chosen
from ruptfx.many_runs.inference.evaluations import Derivatives, Evaluation
from ruptfx.many_runs.inference.variables import Variable
from ruptfx.platform import fem
from ruptfx.platform.progress import working
from ruptfx.readings.instruments.model_readings import ModelReadings
from ruptfx.readings.misfits import Misfit
from ruptfx.run.model import Model

Floats = NDArray[np.float64]

INWARD = 1e-6  # of the distance between bounds of a field: values as close to them are checked


class Evaluator:
    """A case with its unknowns as variables z, which makes runs at given z; collective.

    Parameters
    ----------
    comm : MPI communicator
    memory : float
        Largest memory of the history of the interfaces and of checkpoints on all ranks [bytes].
    progress : bool
        Say that the model is built.
    model : Model, optional
        Of the case; else it is built.

    Attributes
    ----------
    variables : list of Variable
    has_prior : ndarray of bool, shape (n,)
    bounds : ndarray, shape (n, 2)

    Raises
    ------
    RuptfxError
        On all ranks: no data, no unknowns, features without an adjoint, and what `Variable` refuses.
    """

    def __init__(
        self, case: Case, comm: fem.MPI.Comm, memory: float, progress: bool = False, model: Model | None = None
    ) -> None:
        self.case, self.comm, self._memory = case, comm, memory
        _check(case)
        with working("building the model", progress and comm.rank == 0):
            model = model or Model(case, comm)
        refuse(model)
        self._model = model.in_steps("explicit")
        for number, (unknown, place) in enumerate(chosen(self._model, case.unknowns)):
            if place.of_constant:
                raise CaseError(
                    f"unknowns.{number}.key = '{unknown.key}': infer recovers quantities of interfaces, and this is a "
                    "constant of bodies; remove it, ruptfx gradient has its sensitivity"
                )
            if place.of_contact:
                raise CaseError(
                    f"unknowns.{number}.key = '{unknown.key}': the stable time step depends on it, and infer keeps the "
                    "step; remove it, ruptfx gradient has its sensitivity"
                )
        self.variables = [
            Variable(self._model, unknown, place, f"unknowns.{number}")
            for number, (unknown, place) in enumerate(chosen(self._model, case.unknowns))
        ]
        self._ends = np.cumsum([0, *(each.size for each in self.variables)]).tolist()
        self._check_terms()
        self._check_bounds()
        self.case_with(np.zeros(self._ends[-1]))  # refuses keys that take no profile before the first run
        self.has_prior = np.concatenate([np.full(each.size, each.has_prior) for each in self.variables])
        self.bounds = np.concatenate([np.tile(each.box, (each.size, 1)) for each in self.variables])
        self._last: tuple[Floats, Objective] | None = None

    def _check_terms(self) -> None:
        """Refuse data that the run does not have, also with a parameter of a term at its bounds; collective."""
        # Stress of one everywhere, so that readings of the initial stress are found, which have no derivative.
        bodies = ModelReadings(self._model, lambda points: np.ones((len(points), 6)))
        for number, term in enumerate(self.case.objective):
            term.requests(bodies, f"objective.{number}")
        for each in self.variables:
            for (member, factor), bound in product(each.place.members, each.unknown.bounds or []):
                if member.term is not None:
                    number, name = member.term
                    term = self.case.objective[number].substituted({name: factor * bound})
                    term.requests(bodies, f"objective.{number}")

    def _check_bounds(self) -> None:
        """Refuse bounds that the key of an unknown does not accept.

        A field with bounds stays between them, so that a bound itself may be outside of those of the key.
        """
        for number, each in enumerate(self.variables):
            unknown = each.unknown
            if unknown.bounds is None:
                continue
            inward = INWARD * (unknown.bounds[1] - unknown.bounds[0]) if unknown.shape == "field" else 0.0
            for bound, step in zip(unknown.bounds, (inward, -inward), strict=True):
                try:
                    self._case_with_value(self.case, each, bound + step)
                except CaseError as error:
                    for line in str(error).splitlines():
                        key = next((key for key, _ in each.keys if f"{key} = " in line), None)
                        if key is not None:  # contradictions between keys depend on the values of both
                            raise CaseError(
                                f"unknowns.{number}.bounds = {unknown.bounds}: {bound:g} is refused, "
                                f"{line[line.index(key) :]}; give bounds that the key accepts"
                            ) from None

    # -- runs --------------------------------------------------------------------------------------------------------

    def split(self, z: Floats) -> list[tuple[Variable, Floats]]:
        """Return every unknown with its part of the variables, the first axis of z."""
        return [(each, z[a:b]) for each, (a, b) in zip(self.variables, pairwise(self._ends), strict=True)]

    def _changed(self, z: Floats) -> Model:
        """Return the model with the values of z."""
        return changed_model(
            self._model, [(each.place, each.values(part) - each.start) for each, part in self.split(z)]
        )

    def _terms(self, z: Floats) -> list[Misfit]:
        """Return the terms of the objective with the values of z."""
        terms = list(self.case.objective)
        for each, part_of_z in self.split(z):
            for place, factor in each.place.members:
                if place.term is not None:
                    number, name = place.term
                    terms[number] = terms[number].substituted({name: factor * float(each.values(part_of_z)[0])})
        return terms

    def evaluate(
        self, z: Floats, derivatives: Derivatives = "gradient", first: bool = False,
        tell: Told = lambda done, text: None,
    ) -> Evaluation:  # fmt: skip
        """Make a run; collective.

        Parameters
        ----------
        z : ndarray, shape (n,)
            The same bitwise on all ranks.
        derivatives : str
            "none"; "gradient"; or "history", for products that follow.
        first : bool
            Refuse unknowns that the objective does not depend on.
        tell : callable
            Called with the finished fraction and a text.
        """
        forward = 0.5 if derivatives == "gradient" else 1.0
        try:
            made = Objective(
                self.case, self._terms(z), self.comm, self._memory, lambda done, text: tell(forward * done, text),
                self._changed(z), record=derivatives != "none",
            )  # fmt: skip
        except ProjectionError as error:
            if not np.any(z) or not np.all(np.isfinite(z)):
                raise
            raise RuptfxError(
                f"{error}; the search has reached {self._told_values(z)}: give bounds without these values"
            ) from None
        self._last = (z, made) if derivatives == "history" else None
        prior = 0.5 * float(np.sum(np.square(z[self.has_prior])))
        gradient = np.zeros(0)
        if derivatives == "gradient":
            backward = made.gradient(self.case.unknowns, lambda done, text: tell(forward + (1 - forward) * done, text))
            # Readings that fit the data exactly have a gradient of zero by all unknowns.
            fits = made.value == 0 and any(np.any(sample.values) for _, sample in made.samples)
            of_misfit = self._pull(z, backward, first and not fits)
            gradient = of_misfit + np.where(self.has_prior, z, 0.0)
        readings = np.concatenate(made.expected())
        residuals = made.residuals()
        if not np.isfinite(made.value) or not np.all(np.isfinite(gradient)):
            raise RuptfxError("infer: misfit or gradient are not finite; give bounds to the unknowns")
        of_terms = np.zeros(0) if residuals is None else residuals[0]
        return Evaluation(z, made.value, prior, gradient, readings, of_terms, np.zeros((0, 0)))

    def _told_values(self, z: Floats) -> str:
        """Return the range of each unknown for messages."""
        items = []
        for each, part in self.split(z):
            values = each.values(part)
            low, high, unit = values.min(), values.max(), f" {each.place.unit}" if each.place.unit != "1" else ""
            items.append(f"{each.unknown.key} = {low:g}{'' if low == high else f' to {high:g}'}{unit}")
        return ", ".join(items)

    def jacobian(self, z: Floats, first: bool = False, tell: Told = lambda done, text: None) -> Floats:
        """Return the derivative of the residuals, by a tangent-linear sweep for each variable; collective."""
        count, result = self._ends[-1], []
        for number in range(count):

            def told(done: float, text: str, number: int = number) -> None:
                tell((number + done) / count, f"variable {number + 1} of {count}, {text}")

            result.append(self.column(z, number, told))
        return self.assembled(result, first)

    def column(self, z: Floats, number: int, tell: Told = lambda done, text: None) -> Floats:
        """Return the derivative of the residuals by one variable; collective."""
        made, factor = self._linearised(z)
        return factor * made.change(self._push(z, np.eye(self._ends[-1])[number]), tell)

    def assembled(self, columns: Sequence[Floats], first: bool = False) -> Floats:
        """Return the derivative of the residuals from its columns; collective.

        Raises
        ------
        RuptfxError
            A column is not finite, or with `first` zero.
        """
        result = np.array(columns).T
        for each, (a, b) in zip(self.variables, pairwise(self._ends), strict=True):
            if first and not np.any(result[:, a:b]):
                _refuse_unfelt(each)
        if not np.all(np.isfinite(result)):
            raise RuptfxError("infer: the sensitivities are not finite; give bounds to the unknowns")
        return np.asarray(self.comm.bcast(result, root=0))

    def curvature_times(self, z: Floats, change: Floats) -> Floats:
        """Return J'J times a change of the variables, J being the Jacobian; collective."""
        made, factor = self._linearised(z)
        of_readings = factor**2 * made.change(self._push(z, change))
        return np.asarray(self.comm.bcast(self._pull(z, made.pull(of_readings, self.case.unknowns)), root=0))

    def _linearised(self, z: Floats) -> tuple[Objective, Floats]:
        """Return a run with its history, and the derivative of its residuals by the readings; collective."""
        if self._last is None or not np.array_equal(self._last[0], z):
            self._last = z, Objective(self.case, self._terms(z), self.comm, self._memory, model=self._changed(z))
        residuals = self._last[1].residuals()
        assert residuals is not None
        return self._last[1], residuals[1]

    def _pull(self, z: Floats, derivatives: Sequence[Derivative], first: bool = False) -> Floats:
        """Return the derivative by z from those by the unknowns at all points."""
        items = []
        for (each, part), of_points in zip(self.split(z), derivatives, strict=True):
            if first and not np.any(of_points.values):
                _refuse_unfelt(each)
            items.append(each.pull(part, of_points.values))
        return np.concatenate(items)

    def _push(self, z: Floats, change: Floats) -> list[tuple[Place, Floats]]:
        """Return the changes of the unknowns at all points from that of z."""
        both = zip(self.split(z), self.split(change), strict=True)
        return [(each.place, each.push(part, by)) for (each, part), (_, by) in both if np.any(by)]

    @staticmethod
    def _case_with_value(case: Case, variable: Variable, value: object) -> Case:
        for key, factor in variable.keys:
            case = case.changed(key, factor * value if isinstance(value, float) else value)
        return case

    def case_with(self, z: Floats) -> Case:
        """Return the case with the values of z: numbers, and tables along the interface."""
        case = self.case
        for each, part in self.split(z):
            values = each.values(part)
            uniform = each.unknown.shape == "number" and float(np.ptp(each.start)) == 0
            order = np.argsort(each.position)
            if uniform:
                new: object = float(values[0])
            elif each.on_surface:
                new = each.profile_on_surface(value_at(case.table(), each.unknown.key), values)
            else:
                new = {
                    "kind": "table", "positions": each.position[order].tolist(), "values": values[order].tolist(),
                    "extend": True,
                }  # fmt: skip
            try:
                case = self._case_with_value(case, each, new)
            except CaseError as error:
                if not np.any(z):
                    if uniform:
                        raise
                    number = self.variables.index(each)
                    raise CaseError(
                        f"unknowns.{number}.shape = '{each.unknown.shape}': '{each.unknown.key}' takes no profile "
                        f"({error}); use shape = 'number'"
                    ) from None
                raise CaseError(
                    f"{error}; the search has reached this value: give '{each.unknown.key}' bounds without it"
                ) from None
        return case


def _refuse_unfelt(variable: Variable) -> None:
    raise RuptfxError(
        f"unknowns: the objective does not depend on '{variable.unknown.key}', its gradient is zero at all "
        "points; remove it, or choose data that feel it"
    )


def _check(case: Case) -> None:
    """Refuse a case without data or unknowns."""
    if not case.objective:
        raise CaseError("objective: there are no data; add an entry [[objective]], such as kind = 'traces'")
    if not case.unknowns:
        raise CaseError("unknowns: there are none; add entries [[unknowns]] with the keys to recover")
    for number, term in enumerate(case.objective):
        if term.unit != "1":
            raise CaseError(
                f"objective.{number}.kind = '{term.kind()}': is a quantity in {term.unit} and no misfit of data; use "
                "'traces' or 'final_slip'"
            )
    for number, unknown in enumerate(case.unknowns):
        fault = case.faults.get(unknown.key.split(".")[1]) if unknown.key.count(".") > 1 else None
        if fault is not None and ".initial_stress." in unknown.key and fault.initial_stress.normal is None:
            raise CaseError(
                f"unknowns.{number}.key = '{unknown.key}': the case gives the tensor of the bodies in its place; give "
                "normal and shear"
            )
