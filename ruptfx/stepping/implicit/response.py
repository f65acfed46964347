"""Response of a fault to a displacement at the end of an implicit step: traction, exact tangent, new state.

The code of `FaultResponse` is C: `points.c`, as for explicit steps, and `response.c`. The tests have a NumPy version
(`tests/helpers/reference_step.py`).
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ruptfx.input.fields import PRESCRIBED
from ruptfx.interfaces.faults.fault import Fault
from ruptfx.interfaces.faults.point_code import FAILURE, PointCode
from ruptfx.interfaces.faults.points import Clock, closed_and_stuck, frictional_power
from ruptfx.interfaces.faults.projection import TracedLaw
from ruptfx.platform.codegen.native import address
from ruptfx.platform.codegen.tracing import constant, symbol

if TYPE_CHECKING:
    from ruptfx.bodies.state import FaultState, State


@dataclass
class Response:
    """Tractions and fields of a fault at the end of a step for a given displacement; nothing is committed.

    Attributes
    ----------
    traction : ndarray, shape (n, local)
        T - T_0 in the local frame [Pa], tension positive, as for `Interface.assemble`.
    tangent : ndarray, shape (n, local, local)
        dT / d[u] [Pa/m], with the state advanced inside the solve; unsymmetric where friction depends on pressure.
    state : dict of ndarray
        All fields at the end of the step.
    """

    traction: np.ndarray
    tangent: np.ndarray
    state: FaultState


class FaultResponse:
    """Response of one fault: `FaultResponse(fault, threshold)(state, jump, dt, time, ...)`.

    Parameters
    ----------
    fault : Fault
    threshold : float
        Slip rate [m/s] whose first crossing is a rupture.
    radiation : float or ndarray, shape (n,)
        Impedance [Pa s/m] of waves that are not computed, mu / (2 c_s) for quasi-dynamic steps: the traction is the
        strength plus this times the slip rate.
    """

    def __init__(self, fault: Fault, threshold: float, radiation: float | np.ndarray = 0.0) -> None:
        self.fault, face = fault, fault.interface
        self._law = TracedLaw(fault.friction, at_end=True, bonded=fault.cohesion is not None)
        self.radiation = np.array(np.broadcast_to(radiation, len(face.weight)), float)
        self._code = PointCode(fault, self._law, {"owned_area": face.owned * face.weight})
        each = range(face.tangents)
        unknown = constant(np.nan)
        known = {
            "opening_velocity": unknown, "slip_velocity": [unknown for _ in each],
            "normal_impedance": unknown, "shear_impedance": [unknown for _ in each],
            "normal_multiplier": symbol("points->multiplier[0][l]"),
            "shear_multiplier": [symbol(f"points->multiplier[{1 + k}][l]") for k in each],
            "body_stiffness": symbol("points->body_stiffness[l]"),
        }  # fmt: skip
        self._library = self._code.compile(
            "response", ("stepping/implicit/response.c",), known, radiation=symbol("points->radiation[l]"),
            guess=symbol("points->near[l]"),
        )  # fmt: skip
        self._times, self._result = np.zeros(7), np.zeros(2 + len(FAILURE))
        self._threshold = threshold
        self._state: FaultState | None = None

    def __call__(  # noqa: PLR0913
        self,
        state: FaultState,
        jump: np.ndarray,
        dt: float,
        dt_before: float,
        time: float,
        multiplier: tuple[np.ndarray, np.ndarray],
        body_stiffness: np.ndarray,
        guess: FaultState | None = None,
    ) -> Response:
        """Return the response at the end of a step.

        Parameters
        ----------
        state : FaultState
            State at the beginning of the step; unchanged.
        jump : ndarray, shape (n, local)
            Displacement jump at the end of the step [m].
        dt, dt_before, time : float
            Lengths of the step and of the previous one, zero at the start, and the time of its end [s].
        multiplier : (ndarray, ndarray), shapes (n,) and (n, tangents)
            Normal stress and shear traction of the last outer iteration [Pa].
        body_stiffness : ndarray, shape (n,)
            As in `contact.Point`.
        guess : FaultState, optional
            Initial fields of the iteration; default: the beginning of the step.

        Raises
        ------
        ProjectionError
            On the rank of a point without an admissible traction.
        """
        fault, code = self.fault, self._code
        n, local = jump.shape
        e = Clock.implicit(dt, dt_before).extrapolation
        self._times[:] = dt, dt, dt, e, self._law.carried(e), fault.threshold_at(time, self._threshold), time
        if fault.is_loaded:
            code.put("shear_traction_0", fault.driving_shear(time))
        if fault.prescribed is not None:
            code.put("prescribed_rate", fault.prescribed.mean_rate(time, fault.components(state, "slip"), dt))
        new = dict(zip(code.names, np.empty((len(code.names), n)), strict=True))
        change, tangent = np.empty((n, local)), np.empty((n, local, local))
        items = (
            np.ascontiguousarray(jump), np.column_stack(multiplier), np.ascontiguousarray(body_stiffness),
            self.radiation, np.linalg.norm(fault.components(guess or state, "mean_slip_rate"), axis=1), code.fixed,
            code.numbers,
        )  # fmt: skip
        if self._state is not state:  # the arrays of a run keep their memory
            self._state, self._table = state, code.table(state)
        tables = self._table, code.table(new)
        pointers = [*map(address, (self._times, *items))]
        results = [*map(address, (change, tangent, self._result))]
        self._library.respond(ctypes.c_long(n), *pointers, *map(ctypes.byref, tables), *results)
        if self._result[1] >= 0:
            code.fail(state, time, self._result)
        return Response(change, tangent, new)

    def stuck(self, body_stiffness: np.ndarray) -> np.ndarray:
        """Return dT / d[u] [Pa/m] for closed points that do not slide, shape (n, local, local)."""
        fault = self.fault
        none = np.zeros((len(body_stiffness), fault.tangents))
        jump = np.zeros((len(none), fault.interface.frame.shape[1]))
        trial = closed_and_stuck(  # in a step of one second, so that the result is bitwise the same for any step
            fault, jump, none, Clock.implicit(1.0, 1.0), 0.0, normal_multiplier=none[:, 0],
            shear_multiplier=list(none.T), body_stiffness=body_stiffness,
        )  # fmt: skip
        stiffness = list(trial.impedance)
        if fault.interface.has_normal:
            stiffness.insert(0, 1 / trial.normal_compliance)
        return np.stack(stiffness, axis=1)[:, :, None] * np.eye(len(stiffness))

    def commit(self, state: State, new: FaultState, dt: float) -> tuple[float, float]:
        """Set the fields at the end of a step and `state.time`, and count energies.

        The energies are losses in friction, cohesion and closing gaps and work of nucleation at the points of this
        rank. The follower of a sliding interface counts further losses.

        Returns
        -------
        float, float
            Frictional dissipation and fracture energy [J].
        """
        fault, face = self.fault, self.fault.interface
        old, time = state.faults[fault.name], state.time
        area, power = face.owned * face.weight, frictional_power(fault, old, new, dt)
        prescribed, fractured = 0.0 if fault.prescribed is None else fault.prescribed.power(face, power) * dt, 0.0
        dissipated = float(area @ power) * dt - prescribed
        # Mean pressure times growth of the gap.
        pressure = 0.5 * (old["normal_stress"] + new["normal_stress"])
        rigid = fault.contact.stiffness()[0] == 0 and not fault.slides  # normal
        impact = -float(area @ (pressure * (new["opening"] - old["opening"]))) if rigid else 0.0
        if fault.cohesion is not None:
            losses = fault.cohesive_losses(old, new, dt)
            shear = float(area @ losses.shear)
            dissipated, fractured = dissipated - shear, shear + float(area @ losses.tension)
            state.energy["fracture"] += fractured
            impact = 0.0 if fault.slides else float(area @ losses.met)
        worked = 0.0
        if fault.is_loaded:
            load_old, load = fault.load(time - dt), fault.load(time)
            rate_old, rate = (fault.components(fields, "mean_slip_rate") for fields in (old, new))
            worked = float(area @ np.asarray(fault.contact.dissipated(load_old, load, rate_old, rate)).sum(axis=1)) * dt
        fault.fields.complete(fault, state, old, new, dt, time, self.radiation)
        state.add_energy(fault.name, "frictional_dissipation", dissipated)
        state.add_energy(fault.name, PRESCRIBED, prescribed)
        state.add_energy(fault.name, "impact_loss", impact)
        state.energy["boundary_work"] += worked
        for name, values in new.items():
            old[name][:] = values
        return dissipated, fractured
