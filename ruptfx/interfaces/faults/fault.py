"""Faults: an interface with its contact method, friction law and initial stress, and the fields of its points."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ruptfx.bodies.state import FaultState
from ruptfx.input.fields import FIELDS, MONITORS, component_names
from ruptfx.input.schema import CaseError
from ruptfx.interfaces.faults import cohesive_interface
from ruptfx.interfaces.faults.cohesive_interface import Losses, TracedCohesion
from ruptfx.interfaces.faults.fields import FaultFields
from ruptfx.interfaces.faults.interface import Interface
from ruptfx.interfaces.faults.prescribed_slip import PrescribedSlip
from ruptfx.interfaces.faults.projection import TracedLaw, explain, least_strength
from ruptfx.laws.cohesion import CohesiveLaw
from ruptfx.laws.contact import ContactMethod, Way
from ruptfx.laws.friction import FrictionLaw
from ruptfx.laws.nucleation import Nucleation

_TRIED_RATES = (0.0, 1e-9, 1e-6, 1e-3, 1.0, 10.0)  # m/s
_TRIED_TIMES = (0.0, 1e-6, 1.0, 1e3)  # s
_LARGEST_STATE = 1e100  # beyond, exponentials of the law overflow
_TRIED_STRESS = 1e6  # Pa; normal stress for points without compression at the start


@dataclass(frozen=True)
class Fault:
    """Data of one fault that do not change during a run.

    Attributes
    ----------
    name : str
    interface : Interface
    contact : ContactMethod
    friction : FrictionLaw
        Both with profiles evaluated at the points.
    normal_stress_0 : ndarray, shape (n,)
        Initial normal stress [Pa], compression positive.
    shear_traction_0 : ndarray, shape (n, tangents)
        Initial shear traction [Pa].
    shear_direction : ndarray, shape (n, tangents)
        Unit vectors along which nucleations add shear traction, those of the initial shear stress.
    nucleation : tuple of Nucleation
        Nucleations: load or weakening that is added in time.
    gap : ndarray, shape (n,), or None
        Opening in the undeformed state [m].
    cohesion : CohesiveLaw or None
        Cohesion in addition to friction, until the points have failed.
    rupture_after : float
        Time from which ruptures count [s].
    prescribed : PrescribedSlip or None
        Slip that is given at some or all points, where friction does not act.
    fields : FaultFields
        Pore pressure and temperature; friction reads them.
    """

    name: str
    interface: Interface
    contact: ContactMethod
    friction: FrictionLaw
    normal_stress_0: np.ndarray
    shear_traction_0: np.ndarray
    shear_direction: np.ndarray
    nucleation: tuple[Nucleation, ...] = ()
    gap: np.ndarray | None = None
    cohesion: CohesiveLaw | None = None
    rupture_after: float = 0.0
    prescribed: PrescribedSlip | None = None
    fields: FaultFields = field(default_factory=FaultFields)

    @property
    def slides(self) -> bool:
        """True if the pairing of the surfaces follows the motion (finite sliding)."""
        return self.interface.initial is not self.interface

    @property
    def has_strength(self) -> np.ndarray:
        """True where opening is a rupture, shape (n,).

        False where points touch without initial normal stress and cohesion, such as those of a fault at the surface of
        the Earth, where the smallest wave opens and closes it. In finite sliding contact begins later.
        """
        if self.slides or self.cohesion is not None:
            return np.ones(len(self.normal_stress_0), dtype=bool)
        pressed = self.normal_stress_0 > 0
        return pressed if self.gap is None else pressed | (self.gap > 0)

    @property
    def is_held(self) -> np.ndarray:
        """True where slip is prescribed, shape (n,)."""
        return np.zeros(len(self.normal_stress_0), dtype=bool) if self.prescribed is None else self.prescribed.held

    @property
    def is_loaded(self) -> bool:
        """True if a nucleation adds shear traction."""
        return any("loading" in item.offers for item in self.nucleation)

    def load(self, time: float) -> np.ndarray:
        """Return the shear traction that nucleations add [Pa], shape (n, tangents)."""
        places = self.interface.locations
        if not self.nucleation:
            return np.zeros((len(places), self.tangents))
        added: np.ndarray = sum((item.shear_traction(places, time) for item in self.nucleation), np.zeros(len(places)))
        return np.asarray(added[:, None] * self.shear_direction)

    def driving_shear(self, time: float) -> np.ndarray:
        """Return the initial shear traction plus that of nucleations [Pa], shape (n, tangents)."""
        shear: np.ndarray = self.shear_traction_0 + self.load(time)
        return shear

    def traced_law(self) -> TracedLaw:
        """Return the friction law as explicit steps of the contact method use it."""
        return TracedLaw(self.friction, self.contact.traction_ends_slip, self.cohesion is not None)

    def traced_cohesion(self) -> TracedCohesion | None:
        """Return the cohesive law recorded for a step, None without cohesion."""
        return None if self.cohesion is None else TracedCohesion(self.cohesion)

    def state_fields(self) -> dict[str, str]:
        """Return names and units of the state of friction and cohesion."""
        return {**self.friction.all_state_fields(), **({} if self.cohesion is None else cohesive_interface.STATE)}

    @property
    def tangents(self) -> int:
        return self.interface.tangents

    def initial_state(self, slip_rate: np.ndarray | None = None) -> FaultState:
        """Return the fields of all points before the first step.

        Parameters
        ----------
        slip_rate : ndarray, shape (n, tangents), optional
            Initial slip rate from the velocities of the bodies [m/s].
        """
        n = len(self.interface.plus)
        values = np.zeros((n, self.tangents)) if slip_rate is None else slip_rate
        shear, speed = (np.linalg.norm(vector, axis=1) for vector in (self.shear_traction_0, values))
        with np.errstate(over="ignore"):  # `require_strength` refuses an overflow of the state
            law_state = self.friction.initial_state(self.normal_stress_0, shear, speed)
            creep = self.friction.carried_slip_rate(shear, self.normal_stress_0, law_state)
        creep = np.minimum(creep, self.friction.largest_initial_slip_rate())
        direction = self.shear_traction_0 / np.maximum(shear, 1e-300)[:, None]
        rate = np.where(speed[:, None] > 0, values, creep[:, None] * direction)
        if self.prescribed is not None:
            rate = np.where(self.prescribed.held[:, None], self.prescribed.rate(0.0), rate)
        start = {
            "normal_stress": self.normal_stress_0, "opening": self.opening(self.interface.resting_jump),
            "slip": np.zeros_like(rate), "slip_rate": rate, "mean_slip_rate": rate,
            "shear_traction": self.driving_shear(0.0),
        }  # fmt: skip
        state = self.state_of(start) | {monitor.name: np.full(n, monitor.start) for monitor in MONITORS}
        if self.slides:
            state |= {
                name: np.zeros(n) for name in component_names("slip_followed", self.tangents)
            }  # of the last update
        if self.cohesion is not None:
            state |= {name: np.zeros(n) for name in cohesive_interface.STATE}
            state["damage"][~self.interface.touches(state["opening"])] = 1.0
        return state | {name: np.array(law_state[name], float) for name in self.friction.all_state_fields()}

    def require_strength(self) -> None:
        """Refuse an initial state that overflows, and a strength that is negative or not a number.

        The strength is tried at the start and after sliding at a few rates.

        Raises
        ------
        CaseError
            Names the key, the strength, and for which slip rate, time and normal stress it was found.
        """
        law = TracedLaw(self.friction, at_end=True)
        state = {name: value for name, value in self.initial_state().items() if name in law.state_names}
        for name, values in state.items():
            wrong = np.flatnonzero(~(np.abs(values) <= _LARGEST_STATE) & ~self.is_held)
            if len(wrong):
                point = int(wrong[0])
                shear, normal = float(np.linalg.norm(self.shear_traction_0[point])), float(self.normal_stress_0[point])
                key = f"{name}_initial" if f"{name}_initial" in type(self.friction).model_fields else ""
                given = (
                    f"faults.{self.name}.friction.{key}, the initial state" if key else "the initial state of the law"
                )
                raise CaseError(
                    f"faults.{self.name}.initial_stress: shear / normal = {shear:.6g} Pa / {normal:.6g} Pa = "
                    f"{shear / normal if normal else np.inf:.4g} at position {self.interface.position[point]:.6g} m "
                    f"({len(wrong)} such points): {self.friction.kind()} carries it with {name} = {values[point]:.3g} "
                    f"only, and at most {_LARGEST_STATE:g} is computed; lower the shear stress or raise the normal "
                    f"stress there, or give {given}"
                )
        pressed = np.where(self.normal_stress_0 > 0, self.normal_stress_0, _TRIED_STRESS)
        for time, rate in itertools.product(_TRIED_TIMES, _TRIED_RATES):
            rates = np.full(len(pressed), rate)
            strength = law(rates, pressed, state, time, before=rates, speed_before=rates).strength
            wrong = np.flatnonzero(~(strength >= 0) & ~self.is_held)
            if len(wrong):
                point = int(wrong[0])
                raise CaseError(
                    f"faults.{self.name}.friction: {self.friction.kind()} has a strength of {strength[point]:.6g} Pa "
                    f"after {time:g} s at a slip rate of {rate:g} m/s under {pressed[point]:.6g} Pa, at position "
                    f"{self.interface.position[point]:.6g} m; it must not be negative: correct its parameters or, in a "
                    "plug-in, its strength (ruptfx check-law tries a law)"
                )

    def state_of(self, values: Mapping[str, np.ndarray]) -> FaultState:
        """Return the declared fields, one new array per component.

        Parameters
        ----------
        values : dict of ndarray, shape (n,), tangential ones (n, tangents)
        """
        state: FaultState = {}
        for each in FIELDS:
            columns = values[each.name].T if each.tangential else values[each.name][None]
            state |= {name: np.array(v, float) for name, v in zip(each.names(self.tangents), columns, strict=True)}
        return state

    def threshold_at(self, time: float, threshold: float) -> float:
        """Return the slip rate whose first crossing is a rupture [m/s], infinite before ruptures count."""
        return threshold if time >= self.rupture_after else np.inf

    def opening(self, jump: np.ndarray) -> np.ndarray:
        """Return the distance of the two sides from their normal displacement jump [m], negative where they overlap."""
        return jump if self.gap is None else jump + self.gap

    def components(self, state: Mapping[str, np.ndarray], name: str) -> np.ndarray:
        """Return the shear components of a field, shape (n, tangents)."""
        return np.stack([state[key] for key in component_names(name, self.tangents)], axis=1)

    def elastic_energy(
        self, state: FaultState, added: np.ndarray, ahead: float, time: float
    ) -> tuple[float, float, float]:  # fmt: skip
        """Return the energy of the interface beyond that of the initial stress, and losses in friction and in slip [J].

        The last one is that of prescribed slip. Sums over the points of this rank, at a time `ahead` [s] after the
        tractions. `added` is the displacement jump since the tractions at `time` [s], shape (n, local).
        """
        face = self.interface
        opening, jump = face.split(added)
        traction = self.components(state, "shear_traction")
        # Between two tractions slip continues at the rate of the first one. Split nodes have counted that already.
        slip = ahead * self.components(state, "slip_rate") * self.contact.traction_ends_slip
        shear = traction - self.load(time) if self.is_loaded else traction
        now = self.contact.stored(state["normal_stress"], list(shear.T), opening, list((jump - slip).T))
        before = self.contact.stored(self.normal_stress_0, list(self.shear_traction_0.T), 0 * opening, list(0 * slip.T))
        if self.cohesion is not None:
            now = now + cohesive_interface.stored(state)
        area, taken = face.owned * face.weight, np.sum(shear * slip, axis=1)
        prescribed = 0.0 if self.prescribed is None else self.prescribed.power(face, taken)
        return float(np.sum(area * (now - before))), float(area @ taken) - prescribed, prescribed

    def cohesive_losses(self, old: FaultState, new: FaultState, since: float) -> Losses:
        """Return what cohesion takes in a step of the length `since` [s] that ends with the traction."""
        law = self.cohesion
        assert law is not None
        shares = []
        for fields in (old, new):
            traction = self.components(fields, "shear_traction")
            bond, size = law.remaining_cohesion(fields["damage"]), np.linalg.norm(traction, axis=1)
            shares.append(np.where(size > bond, bond / np.where(size > 0, size, 1.0), 1.0)[:, None] * traction)
        rates = [self.components(fields, "mean_slip_rate") for fields in (old, new)]
        shear = np.asarray(self.contact.dissipated(*shares, *rates)).sum(axis=1) * since
        opened = -0.5 * (old["normal_stress"] + new["normal_stress"]) * (new["opening"] - old["opening"])
        work = opened - (cohesive_interface.stored(new) - cohesive_interface.stored(old))
        work = np.where(self.interface.touches(np.zeros_like(work)), work, 0.0)  # not where a point lost its partner
        pressed = (old["normal_stress"] > 0) | (new["normal_stress"] > 0)
        return Losses(shear, np.where(pressed, 0.0, work), np.where(pressed, work, 0.0))

    def assemble(self, change: np.ndarray, out: np.ndarray) -> None:
        """Add to `out` the force J' W T - J_0' W T_0 of the interface on the bodies beyond its initial stress.

        The initial stress remains at the nodes of the initial state, also after sliding.

        Parameters
        ----------
        change : ndarray, shape (n, local)
            T - T_0 in the local frame, tension positive [Pa].
        out : ndarray, shape (nodes * components,)
            [N]
        """
        face = self.interface
        face.assemble(change, out)
        if self.slides:
            initial = np.column_stack([-self.normal_stress_0, self.shear_traction_0])
            face.assemble(initial, out)
            face.initial.assemble(-initial, out)

    def preload_work(self, displacement: np.ndarray) -> float:
        """Return the work of the initial stress on the displacement jump, points of this rank [J]."""
        face = self.interface.initial
        opening, slip = face.split(face.rate(displacement))
        density = np.sum(self.shear_traction_0 * slip, axis=1) - self.normal_stress_0 * opening
        return float(np.sum(face.owned * face.weight * density))


def fail(fault: Fault, state: FaultState, point: int, time: float, values: dict[str, float]) -> None:
    """Raise the error of a point that failed."""
    x = ", ".join(f"{value:.6g}" for value in fault.interface.points[point])
    where = f"of fault '{fault.name}' at ({x}) m, time {time:.6g} s"
    known = {name: float(state[name][point]) for name in fault.state_fields()}
    least = least_strength(fault.traced_law(), state, point, values)
    raise explain(fault.friction, int(fault.interface.number[point]), where, values | known, least)


def in_steps(faults: Iterable[Fault], way: Way, tied: bool) -> list[Fault]:
    """Return faults with the contact methods for steps of one kind (`ContactMethod.in_steps`).

    Parameters
    ----------
    tied : bool
        Whether facets tie the corners of the cells beside the faults.

    Raises
    ------
    CaseError
        Contact methods that have no counterpart there.
    """
    steps = []
    for fault in faults:
        contact = fault.contact.in_steps(way, fault.slides or tied)
        if contact is None:
            raise CaseError(
                f"faults.{fault.name}.contact.kind = '{fault.contact.kind()}': not for {way} steps; use 'compliant' "
                "or 'split_node'"
            )
        steps.append(fault if contact is fault.contact else replace(fault, contact=contact))
    return steps
