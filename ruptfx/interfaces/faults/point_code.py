"""The points of a fault in C: memory, and macros in front of `points.c`.

The macros contain the offsets of arrays and the traced formulas of contact method, law and monitors. Explicit and
implicit steps add code of their own.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from dataclasses import fields
from importlib.resources import files
from itertools import accumulate
from typing import Any

import numpy as np

from ruptfx.bodies.state import FaultState
from ruptfx.input.fields import FIELDS, MONITORS, Moment
from ruptfx.interfaces.faults.cohesive_interface import DAMAGED, STATE
from ruptfx.interfaces.faults.fault import Fault
from ruptfx.interfaces.faults.point_step import BALANCED, BISECT_EVERY, MAX_ITERATIONS, TOLERANCE
from ruptfx.interfaces.faults.projection import TracedLaw, parameters_as_symbols
from ruptfx.laws.contact import Point, Trial
from ruptfx.laws.friction import AT_REST
from ruptfx.platform.codegen import native
from ruptfx.platform.codegen.tracing import Expression, constant, record, symbol, to_c

LANES = 8  # points that the C code computes at a time
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

    def __init__(self, fault: Fault, law: TracedLaw, columns: Mapping[str, np.ndarray]) -> None:
        self._fault, self._law = fault, law
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
        self._fault.fail(state, int(result[1]), time, values)

    def compile(
        self, name: str, sources: Sequence[str], known: Mapping[str, Any], macros: Mapping[str, object],
        at_end: Mapping[str, Expression] | None = None,
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
        macros : dict
            Macros of the start of a step, see `points.c`.
        at_end : dict of str to Expression, optional
            What else they need of the law at the slip rate that was found, by where it goes.
        """
        macros = self._sizes() | self._symbols() | self._formulas(known, at_end or {}) | dict(macros)
        parts = "interfaces/faults/return_map.c", "interfaces/faults/points.c", *sources
        source = "".join(files("ruptfx").joinpath(part).read_text() for part in parts)
        return native.load(name, source, macros)

    def _sizes(self) -> dict[str, object]:
        face = self._fault.interface
        return {
            "LANES": LANES, "COMPONENTS": face.frame.shape[2], "LOCAL": face.frame.shape[1], "TANGENTS": face.tangents,
            "NORMAL": int(face.has_normal), "ONE_SIDED": int(face.one_sided), "AT_END": int(self._law.at_end),
            "BONDED": int(self._cohesion is not None),
            "TOLERANCE": TOLERANCE, "BALANCED": BALANCED, "AT_REST": AT_REST, "MAX_ITERATIONS": MAX_ITERATIONS,
            "BISECT_EVERY": BISECT_EVERY, "DAMAGED": DAMAGED,
        }  # fmt: skip

    def _symbols(self) -> dict[str, object]:
        """Return macros with the offsets of arrays and the symbols of law and contact method."""
        law = self._law
        of_state = {field.name: len(field.names(self._fault.tangents)) for field in (*FIELDS, *MONITORS)}
        of_state |= dict.fromkeys([*law.state_names, *({} if self._cohesion is None else STATE)], 1)
        places = {
            "FIXED": self._places, "STATE": _places(of_state), "BEGUN": _places(dict.fromkeys(law.start, 1)),
        }  # fmt: skip
        found: dict[str, object] = {
            f"{kind}_PLACES": ", ".join(f"{kind}_{name} = {place}" for name, place in of_kind.items())
            for kind, of_kind in places.items()
        }
        found |= {name: f"FIXED({name})" for name in self._places if name.startswith(("b_", "c_", "p_"))}
        found |= {name: f"number[{place}]" for place, name in enumerate(self._number_names)}
        found |= {f"s_{name}": f"OLD({name})" for name in law.state_names}
        return found | {name: f"BEGUN({name})" for name in law.start}

    def _formulas(self, known: Mapping[str, Any], at_end: Mapping[str, Expression]) -> dict[str, object]:
        """Return the traced formulas as C statements."""
        law, tangents = self._law, range(self._fault.tangents)

        def each(place: str) -> list[Expression]:
            return [symbol(place.format(k)) for k in tangents]

        opening = symbol("points->opening[l]") if self._fault.interface.has_normal else constant(0)
        trial: Trial = record(self._contact.trial, Point(
            normal_stress_0=symbol("FIXED(normal_stress_0)"), shear_traction_0=each("FIXED(shear_traction_0 + {})"),
            opening_jump=opening, slip_jump=each("points->jump[NORMAL + {}][l]"), slip=each("OLD(slip + {})"),
            since=symbol("since"), dt=symbol("dt"), **known,
        ))  # fmt: skip
        taken: Expression = record(
            self._contact.dissipated, *map(symbol, ("traction_old", "traction", "rate_old", "rate"))
        )
        at = Moment(**{field.name: symbol(field.name) for field in fields(Moment)})
        formulas = {
            "TRIAL": {
                "points->trial_normal[l]": trial.normal_stress, "points->compliance[l]": trial.normal_compliance,
                **{f"points->trial_shear[{k}][l]": trial.shear_traction[k] for k in tangents},
                **{f"points->z[{k}][l]": trial.impedance[k] for k in tangents},
            },
            "BEGIN": {f"BEGUN({name})": value for name, value in law.start.items()},
            "STRENGTH": {"strength": law.outputs["strength"]},
            "SOLVED": {name: law.outputs[name] for name in ("strength", "slope", "rate_now", "rate_slope")},
            "ADVANCED": {
                "points->rate_now[l]": law.outputs["rate_now"],
                **{f"NEW({name})": law.outputs[f"n_{name}"] for name in law.state_names}, **at_end,
            },
            "DISSIPATED": {"taken": taken},
            "MONITORS": {f"NEW({m.name})": m.update(symbol(f"OLD({m.name})"), at) for m in MONITORS},
        }  # fmt: skip
        strengths: dict[str, object] = {}
        if self._cohesion is not None:
            bond = self._cohesion
            formulas |= {
                "DAMAGE": {"damage": bond.damage}, "LEFT": {"left": bond.remaining},
                "LEFT_SLOPE": {"left_slope": bond.remaining_slope},
                "DAMAGE_SLOPES": {"by_opening": bond.damage_by_opening, "by_slip": bond.damage_by_slip},
            }  # fmt: skip
            strengths = {"TENSILE_STRENGTH": "b_f_t", "COHESION": "b_c"}
        return strengths | {name: to_c(outputs, end=" \\\n") for name, outputs in formulas.items()}


def filled(values: np.ndarray) -> np.ndarray:
    """Return values padded to whole blocks with those of the last point."""
    return np.concatenate([values, np.repeat(values[-1:], -len(values) % LANES, axis=0)])


def _places(widths: Mapping[str, int]) -> dict[str, int]:
    """Return the offset of each column, and the total width as `COUNT`."""
    return dict(zip([*widths, "COUNT"], accumulate(widths.values(), initial=0), strict=True))
