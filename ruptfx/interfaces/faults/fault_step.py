"""The explicit step of a fault.

Input of a step are the displacement at the time t of the traction and the velocity half a step earlier. It computes the
traction at t, and with it the velocity half a step later; all of `FaultState` is then at time t.

`FaultStep` is C: `points.c` and `fault_step.c` after the macros of `PointCode`, and `held_points.c` for points whose
mass couples normal and tangential motion (`held_points`). The tests have the same step written with arrays
(`tests/helpers/reference_step.py`).
"""

from __future__ import annotations

import ctypes
from typing import ClassVar

import numpy as np

from ruptfx.bodies.state import FaultState
from ruptfx.input.fields import component_names
from ruptfx.interfaces.faults.fault import Fault
from ruptfx.interfaces.faults.held_points import HeldPoints, coupled_points, coupling_columns
from ruptfx.interfaces.faults.interface import Interface
from ruptfx.interfaces.faults.point_code import FAILURE, PointCode, filled
from ruptfx.interfaces.faults.points import Clock, frictional_power
from ruptfx.platform.codegen.native import DOUBLE, address
from ruptfx.platform.codegen.tracing import constant, symbol


def impedances(interface: Interface, inverse_mass: np.ndarray, kick: float) -> tuple[np.ndarray, np.ndarray]:
    """Return normal and shear impedance 1 / (kick w (1/m+ + 1/m-)) of every point [Pa s/m].

    Shapes (n,) and (n, tangents). They are exact where `coupled_points` has none.

    Parameters
    ----------
    inverse_mass : ndarray, shape (nodes * components,)
        Inverse lumped mass of every degree of freedom [1/kg]; zero where the motion is prescribed.
    kick : float
        Time the traction acts for [s].
    """
    inverse = inverse_mass.reshape(-1, interface.frame.shape[2])
    both = inverse[interface.plus] + (0 if interface.one_sided else inverse[interface.minus])
    mobility = np.einsum("ikc,ic->ik", interface.rows**2, both)
    # If both sides are driven the impedance is infinite. It is limited to 1e8 times that of others: tractions are
    # small differences of terms with this factor, and would be lost in rounding.
    mobility = np.maximum(mobility, 1e-8 * mobility.max(initial=1e-100))
    z = 1 / (kick * interface.weight[:, None] * mobility)
    return z[:, 0], z[:, interface.frame.shape[1] - interface.tangents :]


class FaultStep:
    """The explicit step as compiled C, equal to `advance_reference` of the tests.

    Parameters
    ----------
    fault : Fault
    inverse_mass : ndarray, shape (nodes * components,)
        As for `impedances`.
    clock : Clock
    threshold : float
        Slip rate [m/s] whose first passage is a rupture.
    real : dtype
        Type of the velocities and forces of nodes.

    Attributes
    ----------
    work : float
        Work of the nucleation in the last step, points of this rank [J].
    prescribed_work : float
        Energy that prescribed slip took from the bodies in the last step, points of this rank [J].
    """

    sources: ClassVar[tuple[str, ...]] = ("interfaces/faults/fault_step.c",)

    def __init__(
        self, fault: Fault, inverse_mass: np.ndarray, clock: Clock, threshold: float, real: np.dtype = DOUBLE
    ) -> None:
        self.fault, self.clock, self.work, self.prescribed_work = fault, clock, 0.0, 0.0
        self._real = real
        law, face = fault.traced_law(), fault.interface
        index = np.zeros(0, np.int64) if fault.contact.traction_ends_slip else coupled_points(face, inverse_mass)
        columns = point_columns(fault, inverse_mass, clock)
        self._code = PointCode(fault, law, _without(columns, index), real)
        self._nodes = [
            np.ascontiguousarray(filled(side * face.frame.shape[2]), np.int64) for side in (face.plus, face.minus)
        ]
        tangents = range(face.tangents)
        known = {
            "opening_velocity": symbol("points->velocity[0][l]") if face.has_normal else constant(0),
            "slip_velocity": [symbol(f"points->velocity[NORMAL + {k}][l]") for k in tangents],
            "normal_impedance": symbol("FIXED(normal_impedance)"),
            "shear_impedance": [symbol(f"FIXED(shear_impedance + {k})") for k in tangents],
        }
        self._library = self._code.compile("fault_step", self.sources, known)
        # Points that depend on their neighbours are solved together, after all others, from fields that `keep` has
        # copied: the vectorised step computes them, too, without effect on the bodies, as its blocks have no gaps.
        self._coupled: HeldPoints | None = None
        if len(index):
            code = PointCode(fault, law, columns | coupling_columns(face, inverse_mass, clock.kick), real)
            library = code.compile("held_points", HeldPoints.sources, known)
            self._coupled = HeldPoints(code, library, index, (self._nodes[0], self._nodes[1]), real)
        carried = law.carried(clock.extrapolation)
        self._times = np.array([clock.dt, clock.kick, clock.since, clock.extrapolation, carried, threshold, 0.0])
        self._threshold = threshold
        self._result = np.zeros(4 + len(FAILURE))
        self._held = (np.zeros(0), np.zeros(0))  # tension and opening before
        self._bound: tuple[object, ...] = ()

    def opening_rate(self, state: FaultState, velocity: np.ndarray, is_first: bool) -> np.ndarray | None:
        """Return the opening rate of every point [m/s], or None if all stay closed and no impact can occur.

        Initial velocities may close in the first step of a run what touches.
        """
        # A gap that has closed in the last step still has a rate, which this step takes.
        collides = self.fault.interface.has_normal and (
            is_first or self.fault.cohesion is not None
            or np.any(state["normal_stress"] <= 0) or np.any(state["opening"] > 0)
        )  # fmt: skip
        return self.fault.interface.split(self.fault.interface.rate(velocity))[0] if collides else None

    def impact_loss(self, state: FaultState, velocity: np.ndarray, rate_old: np.ndarray | None) -> float:
        """Return the energy lost in closing gaps over a step, points of this rank [J]."""
        if self.fault.contact.traction_ends_slip:
            return float(self._result[7])
        if rate_old is None:
            return 0.0
        face = self.fault.interface
        rate, _ = face.split(face.rate(velocity))
        power = self.fault.contact.lost_in_impact(np.maximum(state["normal_stress"], 0.0), rate_old, rate)
        return float((face.owned * face.weight) @ power) * self.clock.kick

    def fractured(self, state: FaultState, velocity: np.ndarray, rate_old: np.ndarray | None) -> float:
        """Return the energy dissipated by cohesion over a step, work minus stored energy, points of this rank [J]."""
        if self.fault.cohesion is None:
            return 0.0
        shear = float(self._result[6])
        if rate_old is None or self.fault.contact.traction_ends_slip:
            return shear
        face, (tension_old, opening_old) = self.fault.interface, self._held
        tension, opening = np.maximum(-state["normal_stress"], 0.0), state["opening"]
        rate, _ = face.split(face.rate(velocity))
        # The velocities before and after the kick are half a step from the tension, so that their mean is at its time.
        work = 0.5 * tension * (rate_old + rate) * self.clock.kick
        kept = 0.5 * (tension * opening - tension_old * opening_old)
        return shear + float((face.owned * face.weight) @ (work - kept))

    def _bind(self, state: FaultState, displacement: np.ndarray, velocity: np.ndarray, force: np.ndarray) -> None:
        """Collect the pointers once; the arrays of a run do not move in memory."""
        self._table = self._code.table(state)
        self._pointers = [
            ctypes.c_long(len(self.fault.interface.weight)), *map(address, (self._times, *self._nodes, displacement)),
            address(velocity, self._real), address(force, self._real), address(self._code.fixed),
            address(self._code.numbers), ctypes.byref(self._table), address(self._result),
        ]  # fmt: skip
        self._bound = (state, displacement, velocity, force)
        if self._coupled is not None:
            self._coupled.bind(state)

    def __call__(
        self, state: FaultState, displacement: np.ndarray, velocity: np.ndarray, force: np.ndarray, time: float
    ) -> float:
        """Advance `state`, `velocity` and `force` in place; return the energy dissipated on this rank [J].

        Raises
        ------
        ProjectionError
            If a point has no admissible traction; `state` and `velocity` are then invalid.
        """
        fault, since = self.fault, self.clock.since
        if fault.is_loaded:
            load, rate_old = fault.load(time), fault.components(state, "mean_slip_rate") * (since > 0)
            self._code.put("shear_traction_0", fault.shear_traction_0 + load)
            if self._coupled is not None:
                self._coupled.put("shear_traction_0", fault.shear_traction_0 + load)
        if fault.cohesion is not None:
            self._held = (np.maximum(-state["normal_stress"], 0.0), state["opening"].copy())
        before = self._prescribe(state, time)
        self._update(state, displacement, velocity, force, time)
        if fault.is_loaded:
            self._add_work(state, fault.load(time - since), load, rate_old)
        if fault.prescribed is not None:
            duration = since if fault.contact.traction_ends_slip else self.clock.kick
            self.prescribed_work = (
                fault.prescribed.power(fault.interface, frictional_power(fault, before, state, since)) * duration
            )
        return float(self._result[0]) - self.prescribed_work

    def _prescribe(self, state: FaultState, time: float) -> FaultState:
        """Set the prescribed slip rates of a step; return copies of the fields of which its work depends."""
        fault, since = self.fault, self.clock.since
        if fault.prescribed is None:
            return {}
        slip, rate = (fault.components(state, name) for name in ("slip", "mean_slip_rate"))
        if fault.contact.traction_ends_slip:
            rates = fault.prescribed.mean_rate(time, slip, since)
        else:
            # The slip of the state is one step behind, and this kick decides the rate until time + dt.
            rates = fault.prescribed.mean_rate(time + self.clock.dt, slip + since * rate, self.clock.dt)
        self._code.put("prescribed_rate", rates)
        if self._coupled is not None:
            self._coupled.put("prescribed_rate", rates)
        fields = "mean_slip_rate", "shear_traction"
        return {name: state[name].copy() for field in fields for name in component_names(field, fault.tangents)}

    def _update(
        self, state: FaultState, displacement: np.ndarray, velocity: np.ndarray, force: np.ndarray, time: float
    ) -> None:
        """Call the compiled step.

        Raises
        ------
        ProjectionError
            If a point has no admissible traction.
        """
        items = (state, displacement, velocity, force)
        if not self._bound or any(a is not b for a, b in zip(self._bound, items, strict=True)):
            self._bind(*items)
        self._times[-2:] = self.fault.threshold_at(time, self._threshold), time
        coupled = self._coupled
        if coupled is not None:
            coupled.keep()
        self._library.update(*self._pointers)
        if coupled is not None and self._result[1] < 0:
            coupled(self._times, displacement, velocity, force)
            sums = [0, 6, 7]
            self._result[sums] += coupled.result[sums]
            self._result[1:6] = coupled.result[1:6]
        if self._result[1] >= 0:
            self._code.fail(state, time, self._result)

    def _add_work(self, state: FaultState, load_old: np.ndarray, load: np.ndarray, rate_old: np.ndarray) -> None:
        """Set `work` to that of the nucleation over the step."""
        fault, rate = self.fault, self.fault.components(state, "mean_slip_rate")
        power = np.asarray(fault.contact.dissipated(load_old, load, rate_old, rate))
        work = float((fault.interface.owned * fault.interface.weight) @ power.sum(axis=1))
        self.work = work * (self.clock.since if fault.contact.traction_ends_slip else self.clock.kick)


def _without(columns: dict[str, np.ndarray], index: np.ndarray) -> dict[str, np.ndarray]:
    """Return the columns with points that see no motion and exert no force at some indices."""
    unused = {name: columns[name].copy() for name in ("weight", "owned_area", "frame")} if len(index) else {}
    for values in unused.values():
        values[index] = 0.0
    return columns | unused


def point_columns(fault: Fault, inverse_mass: np.ndarray, clock: Clock) -> dict[str, np.ndarray]:
    """Return the constant data of the points, shapes (n,) and (n, k)."""
    face = fault.interface
    components = face.frame.shape[2]
    normal_impedance, shear_impedance = impedances(face, inverse_mass, clock.kick)
    mobility = inverse_mass.reshape(-1, components)
    return {
        "weight": face.weight, "owned_area": face.owned * face.weight,
        "frame": face.rows.reshape(len(face.weight), face.frame.shape[1] * components),
        "normal_impedance": normal_impedance, "shear_impedance": shear_impedance,
        "mobility_plus": mobility[face.plus], "mobility_minus": mobility[face.minus],
    }  # fmt: skip
