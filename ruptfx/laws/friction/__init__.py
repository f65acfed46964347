"""Friction laws, one per file; the file name is the `kind` in a case.

A law contains its formula only: no mesh, no MPI, no time scheme and no output. `strength` and `advance` are written
with NumPy operations that act point by point, without branches on values (`numpy.where` instead of `if`). They are
*traced* (`ruptfx.platform.codegen.tracing`): the same lines give the exact derivative for the implicit solvers and the
C code of the explicit path, so that a new law is fast and consistently linearised.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np
from pydantic import model_validator

from ruptfx import RuptfxError, Table
from ruptfx.input.fields import INTERFACE_FIELDS, reserved_names
from ruptfx.input.fields import Array as Array
from ruptfx.input.schema import Alternative, alternative
from ruptfx.laws.friction.lengths import Breakdown, RateDependence

LawState = Table

AT_REST = 1e-100
"""Slip rate [m/s] far below any other: states do not change there, and what lies below it is not told apart."""

RESERVED = reserved_names() | {"weight", "gap", "time", "position", "x", "y", "z"}
"""What a fault and its files call their own: a state variable of that name would overwrite it."""
COMMON = frozenset(["clock", "coefficient_at_start", *INTERFACE_FIELDS])
"""State variables that are the same whichever law keeps them, so that a law may hold one that has them too: the time
since the start [s], the friction coefficient of the innermost law before the first slip, and fields of the interface
such as `temperature` [K], which the interface sets where it has the field."""


class FrictionLaw(Alternative):
    """Contract of a friction law; parameters are the fields of the subclass."""

    state_fields: ClassVar[Mapping[str, str]] = {}
    """State variables of the law: name -> unit."""
    formula: ClassVar[str] = ""
    """The law in one line, for `ruptfx describe friction`."""
    source: ClassVar[str] = ""
    """Source of the formula."""

    @classmethod
    def __pydantic_init_subclass__(cls, **options: object) -> None:
        super().__pydantic_init_subclass__(**options)
        for name in sorted(RESERVED.intersection(cls.state_fields)):
            raise RuptfxError(
                f"friction law {cls.kind()}: the state variable '{name}' would overwrite what the fault calls so; "
                f"give it another name in state_fields of {cls.__name__}, for example '{name}_of_law'"
            )

    @model_validator(mode="after")
    def _keeps_its_state(self) -> Self:
        for wrapped in self._wrapped():
            for name in sorted(wrapped.state_fields.keys() & self.state_fields.keys() - COMMON):
                raise ValueError(
                    f"{self.kind()} holds {wrapped.kind()}, and both call a state variable '{name}': one would "
                    f"overwrite the other; hold a law without '{name}'"
                )
        return self

    def _wrapped(self) -> Iterator[FrictionLaw]:
        """Yield the wrapped law, the law wrapped by that one, and so on."""
        law = getattr(self, "law", None)
        while law is not None:
            yield law
            law = getattr(law, "law", None)

    def all_state_fields(self) -> dict[str, str]:
        """Return the state fields of this law and of the laws that it wraps."""
        inner = getattr(self, "law", None)
        return {**(inner.all_state_fields() if inner is not None else {}), **self.state_fields}

    def initial_state(self, normal_stress: np.ndarray, shear_stress: np.ndarray, slip_rate: np.ndarray) -> LawState:
        """Return the state consistent with the given stresses and slip rate.

        Parameters
        ----------
        normal_stress, shear_stress : ndarray, shape (n,)
            Interface stresses [Pa]; normal stress positive in compression.
        slip_rate : ndarray, shape (n,)
            Magnitude of the slip rate [m/s].

        Returns
        -------
        dict of str to ndarray, shape (n,)
        """
        raise NotImplementedError

    def strength(self, slip_rate: Array, normal_stress: Array, state: LawState) -> Array:
        """Return the shear traction [Pa] of the interface while it slides at `slip_rate` >= 0 [m/s].

        At 0, the largest traction without sliding. Never negative.
        """
        raise NotImplementedError

    def advance(self, state: LawState, slip_rate: Array, normal_stress: Array, dt: Array) -> LawState:
        """Return the state after a step `dt` [s] at constant slip rate and normal stress; exact at any step size."""
        raise NotImplementedError

    def given_slip_rate(self) -> Array | None:
        """Return the initial slip rate [m/s] of a law with a given initial state; else None.

        State and slip rate together fix the initial shear stress.
        """
        inner = getattr(self, "law", None)
        return inner.given_slip_rate() if inner is not None else None

    def carried_slip_rate(self, shear_stress: Array, normal_stress: Array, state: LawState) -> Array:
        """Return the slip rate [m/s] at which the interface carries a stress below its strength at rest.

        Zero for laws without creep.
        """
        return 0.0 * normal_stress

    def largest_initial_slip_rate(self) -> Array:
        """Return the largest slip rate [m/s] at which an interface begins to carry its initial stress.

        Bodies are at rest at the start: an interface whose stress needs a larger slip rate, or whose law names none,
        accelerates to it in the first steps.
        """
        inner = getattr(self, "law", None)
        return inner.largest_initial_slip_rate() if inner is not None else 0.0

    def steady_strength(self, slip_rate: Array, normal_stress: Array) -> Array:
        """Return the shear traction [Pa] in steady sliding at `slip_rate` [m/s].

        Laws without a steady state do not define it.
        """
        raise NotImplementedError

    def lengths(self, normal_stress: Array, slip_rate: Array) -> Breakdown | RateDependence | None:
        """Return energy and lengths of fronts, for `ruptfx check`; None for a law without a length.

        Parameters
        ----------
        normal_stress : ndarray or float
            [Pa], constant.
        slip_rate : ndarray or float
            Slip rate behind the front [m/s], positive; unused by laws that depend on the slip only.
        """
        inner = getattr(self, "law", None)
        return inner.lengths(normal_stress, slip_rate) if inner is not None else None


if TYPE_CHECKING:
    AnyFriction = FrictionLaw
else:
    AnyFriction = alternative("ruptfx.laws.friction")

SHARED = ("in_fields", "lengths", "pressurised", "rate_and_state_base")
"""Files of this folder that are no kinds."""
FORMER_KINDS = {"pressurised": "pore_pressure.given"}
"""Those that cases of the last version name as kinds: inside other laws, and on facets."""
