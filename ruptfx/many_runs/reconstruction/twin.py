"""Bodies whose interface slips as prescribed: impulse responses of sensors, and runs with a slip rate.

With R the inverse of J m J', J the jump of the interface and m the velocity per impulse, a step with the slip rate V is

    v* = keep v + push (loads - K u - eta K_v v)        v = v* - m J' R (J v* - V)        u = u + dt v

where V has no normal component. Its transpose gives the factor of V at every lag in one backward run,

    b += dt a        g_V = R J m b        b -= J' g_V        a -= K push b        b = keep b - eta K_v push b

from the factors a and b of displacement and velocity that one reading of a sensor has.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import NDArray

from ruptfx.case import Case
from ruptfx.input.schema import CaseError
from ruptfx.interfaces.faults.fault import Fault
from ruptfx.interfaces.faults.prescribed_slip import History, PrescribedSlip
from ruptfx.interfaces.mechanisms import mechanisms_of
from ruptfx.laws.friction.coulomb import Coulomb
from ruptfx.many_runs.adjoint.gradients import refuse
from ruptfx.many_runs.adjoint.readings import Readings
from ruptfx.many_runs.adjoint.sweeps import (
    Backward,
    Told,
    add_jump,
    diagonal_factors,
    refuse_coupled_points,
    scaled_jump,
)
from ruptfx.many_runs.adjoint.unknowns import whole
from ruptfx.many_runs.reconstruction.geometry import Geometry
from ruptfx.platform import fem, parallel
from ruptfx.readings.misfits import Request, Sample, Trace
from ruptfx.run.model import Model

if TYPE_CHECKING:
    from ruptfx.stepping.steppers.leapfrog import Leapfrog, LeapfrogMotion

Floats = NDArray[np.float64]
PLANES = ("strain", "stress", "antiplane", "solid")
FIRST = 2
"""Steps at the start whose coefficients differ from those of all others; slip begins after them."""
ROUNDING = 1e-10
"""Part of the largest traction below which all changes of the normal stress are those of rounding."""
ALIGNED = 1e-6
"""Difference of times over the interval of knots below which they are equal."""


@dataclass(frozen=True)
class Knots:
    """Times at which the slip rate is unknown; between them it is linear, and before `begin` it is zero.

    Attributes
    ----------
    dt : float
        Time step [s].
    every : int
        Steps from knot to knot.
    first : int
        Step with which the interval before the first knot begins.
    count : int
    """

    dt: float
    every: int
    first: int
    count: int

    @property
    def interval(self) -> float:
        """Time between knots [s]."""
        return self.every * self.dt

    @property
    def begin(self) -> float:
        """Time before which the slip rate is zero [s]."""
        return self.first * self.dt

    @property
    def times(self) -> Floats:
        """Times of the knots [s], shape (count,)."""
        return np.asarray(self.begin + self.interval * (1.0 + np.arange(self.count)), np.float64)

    @property
    def steps(self) -> int:
        """Steps until the interface is known at the last knot."""
        return self.first + self.count * self.every + 2

    def lags(self, times: Floats) -> tuple[NDArray[np.int64], Floats]:
        """Return the last knot on which readings at times depend, negative before the first, and their delays.

        Delays are in intervals after the beginning of the rise to that knot. They are negative within the last step
        before it: velocities and accelerations are interpolated between times that are up to a step later.
        """
        at = (times - self.begin) / self.interval
        lag = np.floor(at + 1 / self.every + ALIGNED).astype(int)
        return lag, at - lag

    @property
    def hat(self) -> Floats:
        """Slip rate in the middle of the steps from `first` on where the first knot is 1 and all others are 0."""
        part = (np.arange(2 * self.every) + 0.5) / self.every
        return np.minimum(part, 2.0 - part)

    def in_steps(self, values: Floats) -> Floats:
        """Return the slip rate in every step, shape (steps, n), from that at the knots, shape (count, n)."""
        result = np.zeros((self.first + (self.count + 1) * self.every + 1, values.shape[1]))
        for step, weight in enumerate(self.hat):
            result[self.first + step :: self.every][: self.count] += weight * values
        return result[: self.steps]


@dataclass(frozen=True)
class Motion:
    """A run with a slip rate: readings, and the interface at the knots; on all ranks.

    Attributes
    ----------
    samples : list of Sample
    slip : ndarray, shape (knots, columns)
        [m]
    tractions : ndarray, shape (tangents + 1, 1 + knots, n)
        Shear tractions and normal stress, compression positive, from the beginning of the first interval on [Pa].
    """

    samples: list[Sample]
    slip: Floats
    tractions: Floats

    @property
    def shear_traction(self) -> Floats:
        """Shear traction at the knots, shape (knots, columns)."""
        return np.concatenate(self.tractions[:-1, 1:], axis=-1)

    @property
    def normal_stress(self) -> Floats:
        """Normal stress at the knots."""
        return np.asarray(self.tractions[-1, 1:])


class Twin:
    """The bodies of a case with an interface that slips as prescribed.

    Parameters
    ----------
    case : Case
    comm : MPI communicator, optional
    interval : float
        Time between knots of the slip rate [s].
    begin : float
        Time before which the slip rate is zero [s].
    end : float
        Last time of the data [s].

    Attributes
    ----------
    model : Model
        Its interface has neither friction nor nucleation.
    knots : Knots
    geometry : Geometry
        Points of the interface.
    normal_stress, shear_traction : ndarray, shape (n,)
        Initial stresses there, the shear traction in the direction of the points [Pa].

    Raises
    ------
    CaseError
        On all ranks: what is not linear, or no single interface.
    """

    def __init__(
        self, case: Case, comm: fem.MPI.Comm | None = None, *, interval: float, begin: float = 0.0, end: float
    ) -> None:
        model = Model(case, comm)
        _refuse(model)
        self._slip = _Slip()
        self.model = _held(model, self._slip)
        self.fault = self.model.faults[0]
        self.knots = _knots(self.model, interval, begin, end)
        self._slip.dt = self.knots.dt
        stepper = cast("Leapfrog", case.stepper).model_copy(update={"time_step": self.knots.dt})
        self._motion: LeapfrogMotion = stepper.bind(self.model)
        self._keep, self._push, mobility = diagonal_factors(self._motion)
        self._mobility = mobility[-1]
        refuse_coupled_points(self.model, self._mobility)
        face = self.fault.interface
        self.geometry = Geometry.of_fault(self.model, self.fault)
        self.normal_stress = whole(self.model, face, self.fault.normal_stress_0)
        self.shear_traction = self.geometry.along(
            np.concatenate([whole(self.model, face, each) for each in self.fault.shear_traction_0.T])
        )

    @property
    def position(self) -> Floats:
        """Positions of the points along the interface [m]."""
        return self.geometry.position

    def readings(self, requests: Sequence[Request]) -> Readings:
        """Return the readings of a run; collective.

        Raises
        ------
        CaseError
            A request of fields of the interface, or of forces of materials with memory.
        """
        for number, each in enumerate(requests):
            for share in each.channel.shares if isinstance(each, Trace) else ():
                if share.source not in ("displacement", "velocity", "acceleration"):
                    raise CaseError(
                        f"objective: reading {number} is a field of the interface ({share.source}); remove it, or use "
                        "receivers and strain gauges in the bodies beside it"
                    )
        return Readings(self.model, self.knots.dt, self.knots.steps, requests)

    def lags(self, readings: Readings, number: int, clock: str, tell: Told = lambda done, text: None) -> Floats:
        """Return the reading of a source from a slip rate of 1 m/s in one step, shape (steps, columns); collective.

        Row l has the reading after the step that is l steps later.

        Parameters
        ----------
        readings : Readings
        number : int
            Of the request.
        clock : str
            Of its source.
        tell : callable
        """
        face, steps = self.fault.interface, self.knots.steps
        fields = Backward(self._motion, self._keep, self._push)
        for _, (places, weights) in readings.sources(number)[clock]:
            fields.add("displacement" if clock == "displacement" else "velocity", places, weights)
        compliance = np.einsum("ikc,ic->ik", face.rows**2, self._inverse())
        compliance = np.maximum(compliance, 1e-8 * compliance.max(initial=1e-100))  # as `impedances`
        own = np.zeros((steps, face.tangents, len(face.weight)))
        for lag in range(steps):
            fields.drift()
            factors = scaled_jump(face, fields.b, self._mobility) / compliance
            own[lag] = factors[:, -face.tangents :].T
            add_jump(face, fields.b, None, -factors.T)
            fields.step(FIRST)
            tell((lag + 1) / steps, f"backward  step {lag + 1} of {steps}")
        return self._gathered(own).reshape(steps, -1)

    def _gathered(self, own: Floats) -> Floats:
        """Return values at all points from those of every rank, shape (..., n); collective."""
        face = self.fault.interface
        result = np.zeros((*own.shape[:-1], face.total))
        result[..., face.number[face.owned]] = own[..., face.owned]
        return parallel.total(self.model.comm, result)

    def _inverse(self) -> Floats:
        face, nodal = self.fault.interface, self._mobility.reshape(-1, self.model.components)
        return np.asarray(nodal[face.plus] + (0 if face.one_sided else nodal[face.minus]))

    def kernel(self, readings: Readings, number: int, lags: dict[str, Floats], phase: float) -> Floats:
        """Return a trace from a first knot of 1 m/s, at times `phase` intervals after the knots, (knots, columns).

        Parameters
        ----------
        readings : Readings
        number : int
            Of the request.
        lags : dict of ndarray, shape (steps, columns)
            Of its sources, by clock.
        phase : float
            From minus a step over the interval to one minus that.
        """
        knots, series = self.knots, {}
        for clock, values in lags.items():
            steps = np.zeros((knots.steps + 1, values.shape[1]))
            for step, weight in enumerate(knots.hat):
                start = knots.first + 1 + step
                steps[start:] += weight * values[: len(steps) - start]
            series[clock] = steps
        times = knots.times + knots.interval * (phase - 1.0)
        return readings.trace_of(number, series, times)

    def traction_kernels(self, still: Motion, shapes: Floats, tell: Told = lambda done, text: None) -> Floats:
        """Return the kernels of `Tractions` of modes of space, shape (columns, modes), by one run each; collective."""
        nothing, count = Readings(self.model, self.knots.dt, self.knots.steps, []), shapes.shape[1]
        result = np.zeros((*still.tractions.shape, count))
        slip_rate = np.zeros((self.knots.count, len(shapes)))
        for mode in range(count):
            slip_rate[0] = shapes[:, mode]
            motion = self.run(nothing, slip_rate, lambda done, text, mode=mode: tell((mode + done) / count, text))  # type: ignore[misc]
            result[..., mode] = motion.tractions - still.tractions
        size = np.abs(result).max(axis=(1, 2, 3), keepdims=True)
        result[size[:, 0, 0, 0] <= ROUNDING * size.max()] = 0.0  # normal stress of a plane of symmetry
        return result

    def slip(self, slip_rate: Floats) -> Floats:
        """Return the slip at the knots of slip rates, shape (..., knots, columns) [m]: it is linear between them."""
        return np.asarray(self.knots.interval * (np.cumsum(slip_rate, axis=-2) - 0.5 * slip_rate))

    def run(self, readings: Readings, slip_rate: Floats | None = None, tell: Told = lambda done, text: None) -> Motion:
        """Make a run with known loads and a slip rate at the knots, (knots, columns); without it nothing slips."""
        knots, face, fault = self.knots, self.fault.interface, self.fault
        count, tangents = len(face.weight), face.tangents
        self._slip.values = np.zeros((knots.steps + 2, count, tangents))
        if slip_rate is not None:
            in_steps = knots.dt * knots.in_steps(slip_rate[:, self.geometry.columns(face.number)])
            in_steps = np.moveaxis(in_steps.reshape(len(in_steps), tangents, count), 1, 2)
            self._slip.values[1:] = np.concatenate([np.cumsum(in_steps, axis=0), in_steps.sum(axis=0)[None]])
        own = np.zeros((2 * tangents + 1, 1 + knots.count, count))
        state = self.model.initial_state()
        readings.observe(0, state)
        for step in range(1, knots.steps + 1):
            self._motion.step(state)
            readings.observe(step, state)
            knot, odd = divmod(step - 1 - knots.first, knots.every)
            if not odd and 0 <= knot <= knots.count:
                fields = state.faults[fault.name]
                own[:, knot] = (
                    *fault.components(fields, "slip").T, *fault.components(fields, "shear_traction").T,
                    fields["normal_stress"],
                )  # fmt: skip
            tell(step / knots.steps, f"run  step {step} of {knots.steps}")
        result = self._gathered(own)
        slip = np.concatenate(result[:tangents, 1:], axis=-1)
        return Motion(readings.samples(), slip, result[tangents:])


@dataclass(frozen=True)
class Tractions:
    """Tractions of a run with any slip rate of some modes of space.

    Attributes
    ----------
    shear_traction, normal_stress : ndarray, shapes (knots, columns) and (knots, n)
        Of a run without slip [Pa].
    kernels : ndarray, shape (tangents + 1, 1 + knots, n, modes)
        Changes of all by the mode of 1 m/s at the first knot, from one knot before it on [Pa s/m]: a traction is that
        between two steps, and the slip rate of the second one is already that of the next interval.
    """

    shear_traction: Floats
    normal_stress: Floats
    kernels: Floats

    def of(self, rates: Floats, points: NDArray[np.int64] | slice = slice(None)) -> tuple[Floats, Floats]:
        """Return shear traction and normal stress, shapes (samples, knots, columns) and (samples, knots, points) [Pa].

        Parameters
        ----------
        rates : ndarray, shape (samples, knots, modes)
            Factors of the modes [m/s].
        points : ndarray of int or slice
            Points of the interface.
        """
        shear, normal = self.changes(rates, points)
        still = self.shear_traction.reshape(len(self.shear_traction), len(self.kernels) - 1, -1)[..., points]
        return still.reshape(len(still), -1) + shear, self.normal_stress[:, points] + normal

    def changes(self, rates: Floats, points: NDArray[np.int64] | slice = slice(None)) -> tuple[Floats, Floats]:
        """Return what `of` returns without the tractions of a run without slip: linear in the rates."""
        from scipy import fft

        knots = rates.shape[1]
        length = fft.next_fast_len(2 * knots + 1, real=True)
        spectrum = np.moveaxis(fft.rfft(rates, length, axis=1), 0, -1)  # (frequencies, modes, samples)
        results = []
        for kernel in self.kernels[:, :, points]:
            if not np.any(kernel):  # normal stress of a plane of symmetry
                results.append(np.zeros((len(rates), knots, kernel.shape[1])))
                continue
            both = fft.rfft(kernel, length, axis=0) @ spectrum
            results.append(np.moveaxis(fft.irfft(both, length, axis=0)[1 : knots + 1], -1, 0))
        return np.concatenate(results[:-1], axis=-1), results[-1]


class _Slip:
    """Slip at the points of this rank after every step, which runs exchange."""

    dt = 1.0
    values: Floats = np.zeros((1, 1, 1))

    def at(self, time: float) -> Floats:
        """Return the slip at the beginning of a step [m], shape (n, tangents)."""
        return np.asarray(self.values[min(round(time / self.dt), len(self.values) - 1)])


def _refuse(model: Model) -> None:
    """Refuse what is not linear, and several interfaces.

    Raises
    ------
    CaseError
    """
    case = model.case
    if case.plane not in PLANES:
        raise CaseError(f"plane = '{case.plane}': reconstruct knows 'strain', 'stress', 'antiplane' and 'solid'; use "
                        "one of these, or ruptfx infer")  # fmt: skip
    refuse(_with(model, prescribed=None, nucleation=(), cohesion=None))
    if len(model.faults) > 1:
        names = ", ".join(fault.name for fault in model.faults)
        raise CaseError(f"faults: {names}; reconstruct knows one interface of unknown slip; remove the others from the "
                        "mesh, or use ruptfx infer")  # fmt: skip
    (fault,) = model.faults
    if fault.contact.traction_ends_slip:
        raise CaseError(f"faults.{fault.name}.contact.kind = '{fault.contact.kind()}': has an elastic jump beside "
                        "slip; reconstruct needs rigid contact, use 'split_node'")  # fmt: skip
    if fault.gap is not None:
        raise CaseError(f"faults.{fault.name}.gap: reconstruct needs a closed interface; remove the gap")


def _with(model: Model, **changes: object) -> Model:
    """Return a model whose interfaces have other values."""
    view = copy.copy(model)
    view.faults = [replace(fault, **changes) for fault in model.faults]  # type: ignore[arg-type]
    view.mechanisms = mechanisms_of(view)
    return view


def _held(model: Model, slip: _Slip) -> Model:
    """Return a model for explicit steps whose interface slips as prescribed."""

    def prescribed(fault: Fault) -> PrescribedSlip:
        count = len(fault.interface.weight)
        still = np.zeros((count, fault.tangents))
        return PrescribedSlip([History(np.ones(count, bool), slip.at, lambda time: still, np.zeros(count))])

    (fault,) = model.faults
    slip.values = np.zeros((1, len(fault.interface.weight), fault.tangents))
    law = Coulomb(mu_d=0.0).at(fault.interface.locations)
    return _with(
        model,
        prescribed=prescribed(fault),
        nucleation=(),
        cohesion=None,
        friction=law,
        fields=type(fault.fields)([], 0),
    ).in_steps("explicit")


def _knots(model: Model, interval: float, begin: float, end: float) -> Knots:
    """Return the knots of the slip rate between `begin` and the last time of the data; collective.

    Raises
    ------
    CaseError
        The interval does not fit a time step of the case, or nothing is between both times.
    """
    stepper = cast("Leapfrog", model.case.stepper)
    dt = cast(float, cast("Leapfrog", stepper.fixed(model)).time_step)
    if stepper.time_step is None:
        every = int(np.ceil(interval / dt * (1 - ALIGNED)))
        dt = interval / every
    else:
        every = round(interval / dt)
        if every < 1 or abs(every * dt - interval) > ALIGNED * interval:
            raise CaseError(
                f"stepper.time_step = {dt:.6g} s: the interval of reconstruct, {interval:.6g} s, is no multiple of "
                "it; remove time_step, or set reconstruction.interval to a multiple"
            )
    first = max(int(np.ceil(begin / dt * (1 - ALIGNED))), FIRST)
    count = int(np.ceil((end - first * dt) / interval + 2 / every - ALIGNED))  # rounding adds no knot
    if end <= first * dt:
        raise CaseError(f"reconstruction.begin = {begin:.6g} s: the data end at {end:.6g} s, before any slip; set "
                        "begin to an earlier time")  # fmt: skip
    return Knots(dt, every, first, count)
