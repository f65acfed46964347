"""The points of a fault in C: memory, and macros in front of `points.c`.

The macros contain the offsets of arrays and the traced formulas of contact method, law and monitors. Explicit and
implicit steps add code of their own.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from importlib.resources import files
from itertools import accumulate
from typing import Any, TypeVar

import numpy as np

from ruptfx import Table
from ruptfx.bodies.state import FaultState
from ruptfx.input.fields import FIELDS, MONITORS, Moment
from ruptfx.interfaces.faults import point_step
from ruptfx.interfaces.faults.cohesive_interface import DAMAGED, STATE, TracedCohesion
from ruptfx.interfaces.faults.fault import Fault, fail
from ruptfx.interfaces.faults.projection import TracedLaw, parameters_as_symbols
from ruptfx.laws.contact import Point, Trial
from ruptfx.platform.codegen import native
from ruptfx.platform.codegen.native import DOUBLE
from ruptfx.platform.codegen.tracing import (
    Expression,
    constant,
    derivative,
    directional,
    record,
    substituted,
    symbol,
    to_c,
)

ITERATION = {"MAX_ITERATIONS": point_step.MAX_ITERATIONS, "BISECT_EVERY": point_step.BISECT_EVERY}
LANES = 8  # points that the C code computes at a time
PRESCRIBED = "FIXED(prescribed_rate + {})"
UNLIMITED = 1e300  # Pa; strength of points with prescribed slip
FAILURE = ("trial_normal_stress", "trial_shear_traction", "Z", "last_slip_rate")


class PointCode:
    """Memory and macros of the points of one fault.

    Parameters
    ----------
    fault : Fault
    law : TracedLaw
    columns : dict of str to ndarray, shapes (n,) and (n, k)
        Constant data of the points, including `owned_area`; initial stress and gap are added.

    Attributes
    ----------
    fixed : ndarray
        The columns with all parameters that vary along the fault: blocks of points, in each column after column.
    numbers : ndarray
        The other parameters.
    names : list of str
        Names of the arrays of a `FaultState`, in the order of `table`.
    """

    def __init__(
        self, fault: Fault, law: TracedLaw, columns: Mapping[str, np.ndarray], real: np.dtype = DOUBLE
    ) -> None:
        self._fault, self._law, self._real = fault, law, real
        parameters, self._contact = parameters_as_symbols(fault.contact, "c_")
        parameters |= law.parameters
        self._cohesion = fault.traced_cohesion()
        parameters |= {} if self._cohesion is None else self._cohesion.parameters
        n = len(fault.normal_stress_0)
        columns = {
            "gap": np.zeros(n) if fault.gap is None else fault.gap, "normal_stress_0": fault.normal_stress_0,
            "shear_traction_0": fault.shear_traction_0, "has_strength": fault.has_strength.astype(float), **columns,
            **{name: np.broadcast_to(v, n) for name, v in parameters.items() if isinstance(v, np.ndarray)},
        }  # fmt: skip
        if fault.prescribed is not None:
            columns |= {"held": fault.prescribed.held.astype(float), "prescribed_rate": np.zeros((n, fault.tangents))}
        self._places = _places({name: int(np.prod(values.shape[1:])) for name, values in columns.items()})
        self.fixed = native.aligned((-(-n // LANES), self._places["COUNT"], LANES))
        for name, values in columns.items():
            self.put(name, values)
        numbers = {name: value for name, value in parameters.items() if name not in columns}
        self._number_names = list(numbers)
        self.numbers = np.array([*numbers.values(), 0.0])
        bond = [] if self._cohesion is None else list(STATE)
        self.names = [name for field in (*FIELDS, *MONITORS) for name in field.names(fault.tangents)]
        self.names += law.state_names + bond

    def put(self, name: str, values: np.ndarray) -> None:
        """Set the values of one column or several, shape (n,) or (n, k)."""
        columns = filled(values if values.ndim == 2 else values[:, None])
        place, many = self._places[name], columns.shape[1]
        self.fixed[:, place : place + many] = columns.reshape(-1, LANES, many).transpose(0, 2, 1)

    def table(self, state: FaultState) -> ctypes.Array[ctypes.c_void_p]:
        """Return the pointers to the arrays of a state."""
        return (ctypes.c_void_p * len(self.names))(*(state[name].ctypes.data for name in self.names))

    def fail(self, state: FaultState, time: float, result: np.ndarray) -> None:
        """Raise the error of the point that the C code returned in its result."""
        values = dict(zip(FAILURE, map(float, result[2 : 2 + len(FAILURE)]), strict=True))
        fail(self._fault, state, int(result[1]), time, values)

    def compile(
        self, name: str, sources: Sequence[str], known: Mapping[str, Any], radiation: Expression | None = None,
        guess: Expression | None = None,
    ) -> ctypes.CDLL:  # fmt: skip
        """Compile `points.c` with further sources and return the library.

        Parameters
        ----------
        name : str
            Name of the library.
        sources : sequence of str
            Source files of the steps.
        known : dict
            Further fields of `contact.Point` that the steps provide, as symbols.
        radiation : Expression, optional
            Traction per slip rate on top of the strength [Pa s/m].
        guess : Expression, optional
            Slip rate to begin with [m/s]; default: that of the previous step.
        """
        trial = self._trial(known)
        formulas = self._formulas(trial) | self._step_formulas(radiation, guess)
        if self._cohesion is not None:
            formulas |= self._cohesion_formulas(self._cohesion)
        if self._law.at_end and radiation is not None:
            formulas["TANGENT"] = self._tangent(trial)
        macros = self._sizes() | self._symbols()
        macros |= {name: to_c(outputs, end=" \\\n") for name, outputs in formulas.items()}
        parts = "interfaces/faults/return_map.c", "interfaces/faults/points.c", *sources
        source = "".join(files("ruptfx").joinpath(part).read_text() for part in parts)
        return native.load(name, source, macros)

    def _sizes(self) -> dict[str, object]:
        face = self._fault.interface
        return {
            "LANES": LANES, "COMPONENTS": face.frame.shape[2], "LOCAL": face.frame.shape[1], "TANGENTS": face.tangents,
            "NORMAL": int(face.has_normal), "ONE_SIDED": int(face.one_sided), "AT_END": int(self._law.at_end),
            "BONDED": int(self._cohesion is not None), "DAMAGED": DAMAGED,
            "IS_HELD": 0 if self._fault.prescribed is None else "(FIXED(held) > 0)",
            "TOLERANCE": point_step.TOLERANCE, "REAL": native.c_type(self._real), **ITERATION,
        }  # fmt: skip

    def _symbols(self) -> dict[str, object]:
        """Return macros with the offsets of arrays and the symbols of law and contact method."""
        law = self._law
        of_state = {field.name: len(field.names(self._fault.tangents)) for field in (*FIELDS, *MONITORS)}
        of_state |= dict.fromkeys([*law.state_names, *({} if self._cohesion is None else STATE)], 1)
        places = {
            "FIXED": self._places, "STATE": _places(of_state), "BEGUN": _places(dict.fromkeys(law.start, 1)),
        }  # fmt: skip
        symbols: dict[str, object] = {
            f"{kind}_PLACES": ", ".join(f"{kind}_{name} = {place}" for name, place in of_kind.items())
            for kind, of_kind in places.items()
        }
        symbols |= {name: f"FIXED({name})" for name in self._places if name.startswith(("b_", "c_", "p_"))}
        symbols |= {name: f"number[{place}]" for place, name in enumerate(self._number_names)}
        symbols |= {f"s_{name}": f"OLD({name})" for name in law.state_names}
        return symbols | {name: f"BEGUN({name})" for name in law.start}

    @property
    def _is_held(self) -> Any:
        """The condition that slip is prescribed at a point."""
        return np.False_ if self._fault.prescribed is None else symbol("FIXED(held)") > 0

    def _each(self, place: str) -> list[Any]:
        """Return a vector in memory."""
        return [symbol(place.format(k)) for k in range(self._fault.tangents)]

    def _jumps(self) -> list[Any]:
        """Return the jumps of which the trial is a function."""
        normal = [_in_points("opening")] if self._fault.interface.has_normal else []
        return normal + self._each("points->jump[NORMAL + {}][l]")

    def _trial(self, known: Mapping[str, Any]) -> Trial:
        """Return the recorded trial of the contact method."""
        each, jumps = self._each, self._jumps()
        trial: Trial = record(self._contact.trial, Point(
            normal_stress_0=symbol("FIXED(normal_stress_0)"), shear_traction_0=each("FIXED(shear_traction_0 + {})"),
            opening_jump=jumps[0] if self._fault.interface.has_normal else constant(0),
            slip_jump=jumps[-self._fault.tangents :], slip=each("OLD(slip + {})"), since=symbol("since"),
            dt=symbol("dt"), **known,
        ))  # fmt: skip
        if self._fault.prescribed is None:
            return trial
        shear = zip(trial.shear_traction, trial.impedance, self._each(PRESCRIBED), strict=True)
        return replace(trial, shear_traction=[t - z * v for t, z, v in shear])

    def _sigma(self, trial: Trial) -> Any:
        """Return the normal stress without cohesion [Pa], which is the trial one where slip is prescribed."""
        return np.where(self._is_held, trial.normal_stress, point_step.normal_stress(trial.normal_stress))

    def _formulas(self, trial: Trial) -> dict[str, Table]:
        """Return the traced formulas of contact method and monitors by the name of their macro."""
        tangents = range(self._fault.tangents)
        result: Expression = record(
            self._contact.dissipated, *map(symbol, ("traction_old", "traction", "rate_old", "rate"))
        )
        at = Moment(**{field.name: symbol(field.name) for field in fields(Moment)})
        return {
            "TRIAL": {
                "points->trial_normal[l]": trial.normal_stress, "points->compliance[l]": trial.normal_compliance,
                "points->sigma[l]": self._sigma(trial),
                **{f"points->trial_shear[{k}][l]": trial.shear_traction[k] for k in tangents},
                **{f"points->z[{k}][l]": trial.impedance[k] for k in tangents},
            },
            "DISSIPATED": {"dissipation": result},
            "MONITORS": {f"NEW({m.name})": m.update(symbol(f"OLD({m.name})"), at) for m in MONITORS},
        }  # fmt: skip

    def _cohesion_formulas(self, cohesion: TracedCohesion) -> dict[str, Table]:
        """Return the traced formulas of cohesion by the name of their macro.

        Where slip ends with the traction, `points->damage` is a trial damage, and opening and slip follow from it.
        """
        at_end, before = self._law.at_end, symbol("OLD(largest_opening)")
        opened, rates = _largest(before, _in_points("opening")), self._each("OLD(mean_slip_rate + {})")
        damage, known = symbol("NEW(damage)"), symbol("NEW(largest_opening)")
        if at_end:
            opened, rates = symbol("NEW(largest_opening)"), self._each("NEW(mean_slip_rate + {})")
            damage, known = _in_points("damage"), before
        normal, compliance = _in_points("trial_normal"), _in_points("compliance")
        tension, shear = cohesion.strength_of(damage)
        slip = self._damaging_slip(rates)
        (cohesion_before,) = substituted([cohesion.shear], {symbol("bond_damage"): symbol("OLD(damage)")})
        return {
            "DAMAGE": {
                **({} if at_end else {"NEW(largest_opening)": opened}), "NEW(damaging_slip)": slip,
                "damage": _largest(symbol("OLD(damage)"), cohesion.damage_of(opened, slip)),
            },
            "COHESIVE_STRENGTH": {
                "points->tension[l]": tension, "points->bond[l]": shear,
                "points->sigma[l]": point_step.normal_stress(normal, tension, known / compliance),
            },
            "OPENED": {"NEW(largest_opening)": _largest(before, (_in_points("sigma") - normal) * compliance)},
            "COHESION_BEFORE": {"cohesion": cohesion_before},
        }  # fmt: skip

    def _damaging_slip(self, rates: point_step.Vector) -> Any:
        """Return the slip which damages cohesion, after a step with mean slip rates."""
        return symbol("OLD(damaging_slip)") + symbol("since") * point_step.length(rates)

    def _tangent(self, trial: Trial) -> Table:
        """Return dT / d[u] [Pa/m] at the end of an implicit step, by its place in C.

        The slip rate V and the damage D of a step are roots of equations in which the jumps occur, too: their changes
        are those that keep the equations balanced. `points` has V, and the strength with its partial derivatives.
        """
        each, cohesion, normal = self._each, self._cohesion, int(self._fault.interface.has_normal)
        v, strength, slope = map(_in_points, ("rate", "strength", "slope"))
        damage, bond, opened = symbol("NEW(damage)"), constant(0), symbol("OLD(largest_opening)")
        before, z, compliance = each("OLD(mean_slip_rate + {})"), trial.impedance, trial.normal_compliance
        if cohesion is None:
            sigma = self._sigma(trial)
        else:
            tension, bond = cohesion.strength_of(damage)
            sigma = point_step.normal_stress(trial.normal_stress, tension, opened / compliance)
        is_closed = self._is_closed()
        slides, is_stuck = is_closed & (v > 0), is_closed & np.equal(v, 0.0)
        shifted = point_step.shifted_trial(trial.shear_traction, z, before, symbol("carried"))
        at = point_step.balance(shifted, v, strength, slope)
        end = point_step.sliding(
            shifted, trial.shear_traction, before, v, v, at.direction, is_open=np.logical_not(is_closed),
            is_stuck=is_stuck, at_end=True,
        )  # fmt: skip
        tractions = [*([-sigma] if normal else []), *end.shear_traction]
        by_v = derivative(at.residual, v) + derivative(at.residual, strength) * slope

        def moved(seeds: dict[Expression, Expression], outputs: Sequence[Any]) -> list[Any]:
            """Return the changes of outputs from those of jumps and damage, with that of V."""
            of_law = [point_step.normal_stress(sigma), shifted.rate_before, bond]
            by_stress, by_before, by_bond = directional(of_law, seeds)
            of_strength: Any = by_bond + _in_points("stress_slope") * by_stress + _in_points("before_slope") * by_before
            (of_balance,) = directional([at.residual], {**seeds, strength: of_strength})
            of_v: Any = np.where(slides, -of_balance / by_v, 0.0)
            return directional(outputs, {**seeds, v: of_v, strength: of_strength + slope * of_v})

        columns = [moved({jump: constant(1)}, tractions) for jump in self._jumps()]
        if cohesion is not None:
            largest = _largest(opened, (sigma - trial.normal_stress) * compliance)
            outputs = [largest, self._damaging_slip(end.mean_slip_rate)]
            # A damage that is not smooth in pure modes makes Newton's iteration slower there, no more.
            partials = [np.where(np.isfinite(each), each, 0.0) for each in cohesion.damage_slopes_of(*outputs)]
            by_damage = moved({damage: constant(1)}, tractions)
            damage_by_damage = point_step.dot(partials, moved({damage: constant(1)}, outputs))
            grows = (damage > symbol("OLD(damage)")) & (damage < 1)
            for column, jump in zip(columns, self._jumps(), strict=True):
                damages = point_step.dot(partials, moved({jump: constant(1)}, outputs)) / (1 - damage_by_damage)
                damages = np.where(grows, damages, 0.0)
                column[:] = [own + by * damages for own, by in zip(column, by_damage, strict=True)]
        local = range(len(columns))
        return {f"tangent[{i * len(local) + j}][l]": columns[j][i] for i in local for j in local}

    def _is_closed(self) -> Any:
        """Return the condition that a point has contact or cohesion."""
        is_closed: Any = (_in_points("sigma") > 0) | self._is_held
        return (
            is_closed
            if self._cohesion is None
            else (is_closed | (_in_points("tension") > 0) | (_in_points("bond") > 0))
        )

    def _step_formulas(self, radiation: Expression | None, guess: Expression | None) -> dict[str, Table]:
        """Return the traced formulas of `point_step` by the name of their macro, in the order of use in `points.c`.

        Each is in a loop over points of its own, which compilers vectorise; `struct points` keeps what later ones need.
        """
        law, each, tangents = self._law, self._each, range(self._fault.tangents)
        at_end, normal = law.at_end, int(self._fault.interface.has_normal)
        before, shear = each("OLD(mean_slip_rate + {})"), each("points->trial_shear[{}][l]")
        sigma, sigma_before = _in_points("sigma"), symbol("OLD(normal_stress)")
        is_closed = self._is_closed()
        bond, pressure, pressure_before = constant(0), sigma, sigma_before
        if self._cohesion is not None:
            bond = _in_points("bond")
            pressure, pressure_before = point_step.normal_stress(sigma), point_step.normal_stress(sigma_before)
        held = self._fault.prescribed is not None
        if held:
            pressure, pressure_before = point_step.normal_stress(sigma), point_step.normal_stress(sigma_before)

        shifted = point_step.shifted_trial(shear, each("points->z[{}][l]"), before, symbol("carried"))
        stored, trial = _stored(shifted, changes=False)
        entries = {
            symbol("rate_before"): trial.rate_before,
            symbol("speed_before"): _in_points("speed_before"),
            symbol("normal_stress"): pressure,
            symbol("normal_stress_before"): pressure_before,
            symbol("radiation"): constant(0) if radiation is None else radiation,
            symbol("bond"): bond,
        }
        begun = dict(zip(law.start, substituted(law.start.values(), entries), strict=True))
        (at_rest,) = substituted([law.outputs["strength"]], entries | {symbol("slip_rate"): constant(0)})
        at_rest = np.where(self._is_held, UNLIMITED, at_rest) if held else at_rest  # type: ignore[assignment]
        first = point_step.first_iterate(
            trial,
            _in_points("trial_normal"),
            sigma,
            symbol("at_rest[l]"),
            trial.rate_before if guess is None else guess,
            is_closed,
        )
        iterated, last = _stored(first, changes=True)

        entries[symbol("slip_rate")] = last.rate
        wanted = law.outputs | law.slopes
        at: Table = dict(zip(wanted, substituted(wanted.values(), entries), strict=True))
        spread = at["rate_now"] / at["rate_slope"]
        following = point_step.next_iterate(
            last, trial, sigma, *map(symbol, ("strength", "slope", "spread", "bisects"))
        )
        result = point_step.sliding(
            trial, shear, before, last.rate, at["rate_now"], last.direction, is_open=np.logical_not(is_closed),
            is_stuck=is_closed & np.equal(last.rate, 0.0), at_end=at_end,
        )  # fmt: skip
        mean, now = result.mean_slip_rate, result.slip_rate
        if held:  # friction acts on what is beyond the prescribed slip rate, which is zero elsewhere
            mean = [v + added for v, added in zip(mean, each(PRESCRIBED), strict=True)]
            # At the traction: half-way to the next step, or ahead of the middle of the step that ends there.
            ahead = symbol("extrapolation")
            now = [
                np.where(self._is_held, v + ahead * (v - then) if at_end else 0.5 * (then + v), rate)
                for v, then, rate in zip(mean, before, now, strict=True)
            ]
        if at_end:  # a step of zero length keeps the rates
            known = (mean, before), (now, each("OLD(slip_rate + {})"))
            mean, now = ([np.where(symbol("since") > 0, *pair) for pair in zip(*rates, strict=True)] for rates in known)
        slips = point_step.slip_after(
            each("OLD(slip + {})"), each("NEW(mean_slip_rate + {})") if at_end else before, symbol("since")
        )
        opening = point_step.opening_after(
            sigma, _in_points("trial_normal"), _in_points("compliance"), sigma_before, _in_points("opening"), at_end
        )
        opening = np.where(self._is_held, 0.0, opening) if held else opening
        changes = {"points->change[0][l]": symbol("FIXED(normal_stress_0)") - sigma} if normal else {}
        return {
            "SHIFTED_TRIAL": {
                **stored, "points->speed_before[l]": point_step.length(before),
                "points->speed_then[l]": point_step.length(each("OLD(slip_rate + {})")),
            },
            "BEGIN": {f"BEGUN({name})": value for name, value in begun.items()},
            "STRENGTH_AT_REST": {"at_rest[l]": at_rest},
            "FIRST_ITERATE": iterated,
            "RESISTANCE": {"strength": at["strength"], "slope": at["slope"], "spread": spread},
            "NEXT_ITERATE": _stored(following, changes=True)[0],
            "SLIDING": {
                **{f"NEW(mean_slip_rate + {k})": mean[k] for k in tangents},
                **{f"NEW(slip_rate + {k})": now[k] for k in tangents},
                **{f"NEW(shear_traction + {k})": result.shear_traction[k] for k in tangents},
                **{f"NEW({name})": at[f"n_{name}"] for name in law.state_names},
                **({} if radiation is None else {f"points->{name}[l]": at[name] for name in ("strength", *law.slopes)}),
            },
            "WRITE_BACK": {
                **{f"NEW(slip + {k})": slips[k] for k in tangents},
                "NEW(normal_stress)": sigma, "NEW(opening)": opening, **changes,
                **{f"points->change[NORMAL + {k}][l]": symbol(f"NEW(shear_traction + {k})")
                   - symbol(f"FIXED(shear_traction_0 + {k})") for k in tangents},
            },
        }  # fmt: skip


def normal_traction() -> Table:
    """Return the formula of the normal traction, tension positive, and of its derivative by a trial one."""
    trial, tension, softness = map(symbol, ("trial", "tension", "softness"))  # type: Any, Any, Any
    traction = -point_step.normal_stress(-trial, tension, softness)
    return {"traction": traction, "slope": derivative(traction, trial)}


def scalar_step() -> dict[str, Table]:
    """Return the formulas of a point with one tangent and no slip before, for `rated.c`, by the name of their macro."""
    zero, is_closed, strength = constant(0), np.True_, symbol("strength")
    trial = point_step.shifted_trial([symbol("trial")], [symbol("z")], [zero], 1.0)
    names = ("rate", "low", "high", "goes_on")
    last = point_step.Iterate(direction=trial.direction, **{name: symbol(name) for name in names})
    # The law sees V itself, without extrapolation.
    iterates = {
        "FIRST_ITERATE": point_step.first_iterate(trial, zero, zero, strength, zero, is_closed),
        "NEXT_ITERATE": point_step.next_iterate(
            last, trial, zero, strength, symbol("slope"), last.rate, symbol("bisects")
        ),
    }
    return {macro: {name: getattr(each, name) for name in names} for macro, each in iterates.items()}


def _in_points(name: str) -> Any:
    return symbol(f"points->{name}[l]")


def _largest(before: Any, now: Any) -> Any:
    return np.where(now > before, now, before)


Part = TypeVar("Part", point_step.ShiftedTrial, point_step.Iterate)


def _stored(part: Part, changes: bool) -> tuple[dict[str, Expression], Part]:
    """Return the values of a part of a step by their place in `struct points`, and the part as read from there.

    A part that does not change is read where its values are already.
    """
    outputs: dict[str, Expression] = {}
    read: Table = {}
    known: dict[Expression, Expression] = {}
    for name in (field.name for field in fields(part)):
        value = getattr(part, name)
        is_vector = isinstance(value, Sequence)
        values = value if is_vector else [value]
        places = [symbol(f"points->{name}{f'[{k}]' if is_vector else ''}[l]") for k in range(len(values))]
        for k, each in enumerate(values):
            if not changes and (each.op == "symbol" or each in known):
                places[k] = known.get(each, each)
            elif each is not places[k]:
                known[each] = places[k]
                outputs[places[k].args[0]] = each
        read[name] = places if is_vector else places[0]
    return outputs, replace(part, **read)


def filled(values: np.ndarray) -> np.ndarray:
    """Return values, shape (n, ...), padded along the points to whole blocks with those of the last point."""
    return np.concatenate([values, np.repeat(values[-1:], -len(values) % LANES, axis=0)])


def _places(widths: Mapping[str, int]) -> dict[str, int]:
    """Return the offset of each column, and the total width as `COUNT`."""
    return dict(zip([*widths, "COUNT"], accumulate(widths.values(), initial=0), strict=True))
