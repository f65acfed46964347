"""The stress formula of a material with memory, traced for one plane: C code, NumPy function, exact tangent.

Components of the strain that a plane does not have are zero, and so are components of state tensors that begin at zero
and stay there: they are found by tracing, and are not stored.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from ruptfx import RuptfxError
from ruptfx.laws.materials.stiffness import tangent_stiffness
from ruptfx.laws.materials.tensor import COMPONENTS, Tensor
from ruptfx.platform.codegen.tracing import (
    Expression,
    apply,
    by_reciprocals,
    constant,
    derivative,
    record,
    symbol,
    to_c,
    to_numpy,
    uniform_parts,
)

if TYPE_CHECKING:
    from ruptfx.laws.materials import Material, Plane

ACROSS = "strain_zz"  # state of plane stress: the strain at which sigma_zz is zero
IN_PLANE = ("xx", "yy", "xy")
OF_PLANE = {"stress": IN_PLANE, "strain": IN_PLANE, "antiplane": ("xz", "yz"), "solid": COMPONENTS}
"""Components of strain and stress of each plane, in the order of recorded stresses."""


def _tensor(strain: Mapping[str, Expression], across: Expression | None) -> Tensor:
    """Return the strain in three dimensions, with that across the plane."""
    of_plane = {name: strain.get(name, constant(0)) for name in COMPONENTS}
    return Tensor(**(of_plane | ({} if across is None else {"zz": across})))


class TracedMaterial:
    """The formulas of a material with memory at the points of one plane.

    Parameters
    ----------
    material : Material
        With a `stress` of its own.
    plane : str

    Attributes
    ----------
    components : tuple of str
        Those of strain and stress in the plane.
    state : dict of str to float
        Stored numbers of a point, ``"name"`` or ``"name_xy"``, and their initial values.
    stress, advanced, stored : dict or Expression
        Stress [Pa] by component, new state by name, stored energy [J/m3], of the symbols ``e_xx``, ``s_name``, ``dt``.
    recorded : dict of str to Expression
        Numbers of the state that snapshots contain, by name.
    inelastic : dict of str to Expression
        Stress less that of the elastic energy at the same strain [Pa].
    parameters : list of str
        Keys of the parameters that vary in the bodies, the symbols ``p_0``, ``p_1`` and so on.

    Raises
    ------
    RuptfxError
        A formula that cannot be traced, with file and line; a state or stress that it does not return.
    """

    def __init__(self, material: Material, plane: Plane) -> None:
        self.parameters = list(material.varying)
        symbols = {key: symbol(f"p_{place}") for place, key in enumerate(self.parameters)}
        self._material, self._plane = material.with_values(symbols) if symbols else material, plane
        self.components = OF_PLANE[plane]
        self._strain = {name: symbol(f"e_{name}") for name in self.components}
        self._dt = symbol("dt")
        self._begun = self._starts()
        live: set[str] = {name for name, value in self._begun.items() if value != 0}
        while True:
            stress, advanced = self._trace(live)
            grown = {name for name, value in advanced.items() if not _is_zero(value)}
            if grown <= live:
                break
            live |= grown
        self.state = {name: value for name, value in self._begun.items() if name in live}
        self.stress = {name: stress[name] for name in self.components}
        self.advanced = {name: advanced[name] for name in self.state}
        self.stored = self._energy(live)
        self.recorded = self._recorded(live)
        self.inelastic = {
            name: apply("subtract", stress[name], elastic) for name, elastic in self._elastic_stress().items()
        }

    def _starts(self) -> dict[str, float]:
        """Return all numbers of the state and their initial values."""
        entries: dict[str, float] = {}
        for name, field in self._material.state_fields().items():
            of_field = [f"{name}_{part}" for part in COMPONENTS] if field.tensor else [name]
            entries |= dict.fromkeys(of_field, float(field.start))
        if self._plane == "stress":
            entries[ACROSS] = 0.0
        return entries

    def _symbols(self, live: set[str]) -> dict[str, Expression]:
        return {name: symbol(f"s_{name}") if name in live else constant(0) for name in self._begun}

    def _packed(self, numbers: dict[str, Expression]) -> dict[str, Any]:
        """Return the state as the formula sees it."""
        return {
            name: Tensor(*(numbers[f"{name}_{part}"] for part in COMPONENTS)) if field.tensor else numbers[name]
            for name, field in self._material.state_fields().items()
        }

    def _trace(self, live: set[str]) -> tuple[dict[str, Expression], dict[str, Expression]]:
        """Return the stress and the new state of a point."""
        numbers = self._symbols(live)
        if self._plane != "stress":
            return self._called(_tensor(self._strain, None), numbers)
        # Linear formulas: one step of Newton's method solves sigma_zz = 0 exactly.
        guess = symbol(f"s_{ACROSS}")
        stress, _ = self._called(_tensor(self._strain, guess), numbers)
        across = guess - stress["zz"] / derivative(stress["zz"], guess)
        stress, advanced = self._called(_tensor(self._strain, across), numbers)
        return stress, advanced | {ACROSS: across}

    def _called(
        self, strain: Tensor, numbers: dict[str, Expression]
    ) -> tuple[dict[str, Expression], dict[str, Expression]]:
        material = self._material
        result: Any = record(material.stress, strain, self._packed(numbers), self._dt)
        wanted = material.state_fields()
        if not (isinstance(result, tuple) and len(result) == 2 and isinstance(result[0], Tensor)):
            raise RuptfxError(f"{material.kind()}.stress: return the stress, a Tensor, and the new state, a dict")
        stress, state = result
        if not isinstance(state, dict) or set(state) != set(wanted):
            raise RuptfxError(f"{material.kind()}.stress: the new state must have {', '.join(wanted) or 'no field'}")
        advanced: dict[str, Expression] = {}
        for name, field in wanted.items():
            if field.tensor != isinstance(state[name], Tensor):
                raise RuptfxError(f"{material.kind()}.stress: state '{name}' must be a " + (
                    "Tensor" if field.tensor else "number of each point, as declared in state_fields"))  # fmt: skip
            parts = state[name].components if field.tensor else (state[name],)
            names = [f"{name}_{part}" for part in COMPONENTS] if field.tensor else [name]
            advanced |= dict(zip(names, map(_expression, parts), strict=True))
        return dict(zip(COMPONENTS, map(_expression, stress.components), strict=True)), advanced

    def _energy(self, live: set[str]) -> Expression:
        numbers = self._symbols(live)
        across = symbol(f"s_{ACROSS}") if self._plane == "stress" else None
        return record(self._material.stored, _tensor(self._strain, across), self._packed(numbers), as_=_expression)

    def _recorded(self, live: set[str]) -> dict[str, Expression]:
        material, wanted = self._material, self._material.recorded_states()
        result: Any = record(material.recorded, self._packed(self._symbols(live)))
        if not isinstance(result, dict) or set(result) != set(wanted):
            raise RuptfxError(f"{material.kind()}.recorded: return a dict with {', '.join(wanted) or 'no name'}")
        if tensors := [name for name in wanted if isinstance(result[name], Tensor)]:
            raise RuptfxError(f"{material.kind()}.recorded: '{tensors[0]}' must be a number of each point, no Tensor")
        return {name: _expression(result[name]) for name in wanted}

    def _elastic_stress(self) -> dict[str, Expression]:
        """Return the stress of the elastic energy by component, from its second derivative."""
        if self.parameters:
            return self._isotropic_stress()
        stiffness = tangent_stiffness(self._material, self._plane)
        elastic_stress = {}
        for name in self.components:
            total = constant(0)
            for other, strain in self._strain.items():
                if self._plane == "antiplane":  # of the gradient, which is twice the strain
                    number = 2 * stiffness["xy".index(name[0]), "xy".index(other[0])]
                else:
                    place = tuple("xyz".index(axis) for axis in name + other)
                    number = stiffness[place] * (1 if other[0] == other[1] else 2)
                total = apply("add", total, apply("multiply", constant(number), strain))
            elastic_stress[name] = total
        return elastic_stress

    def _isotropic_stress(self) -> dict[str, Expression]:
        """Return the stress of linear isotropic elasticity with moduli that are expressions."""
        moduli = self._material.lame(self._plane)
        if moduli is None:
            raise RuptfxError(f"{self._material.kind()}: parameters vary in isotropic bodies only")
        first, shear = moduli
        normal = [self._strain[name] for name in self.components if name[0] == name[1]]
        pressure = first * sum(normal[1:], normal[0]) if normal else constant(0)
        return {
            name: _expression(2 * shear * strain + (pressure if name[0] == name[1] else 0))
            for name, strain in self._strain.items()
        }

    # -- what kernels and tests take -----------------------------------------------------------------------------------

    def as_c(self) -> dict[str, object]:
        """Return macros for `memory.c`: numbers of variables, and the formulas as C statements."""
        state, parts = list(self.state), self.components
        stress = {f"STRESS({place})": self.inelastic[name] for place, name in enumerate(parts)}
        new = {f"STATE({place})": self.advanced[name] for place, name in enumerate(state)}
        step, once = uniform_parts(by_reciprocals(stress | new), self._dt, "o_")  # such as exp(-dt / T)
        stress = {name: step[name] for name in stress}
        read = " ".join(f"const double s_{name} = STATE({place});" for place, name in enumerate(state))
        read += " ".join(f" const double e_{name} = STRAIN({place});" for place, name in enumerate(parts))
        read += " ".join(f" const double p_{place} = PARAMETER({place});" for place in range(len(self.parameters)))
        used = "".join(f" (void)p_{place};" for place in range(len(self.parameters)))
        used += "".join(f" (void){name};" for name in once)
        used += "".join(f" (void)s_{name};" for name in state) + "".join(f" (void)e_{name};" for name in parts)
        read += "".join(f" const double {name} = once[{place}];" for place, name in enumerate(once))
        return {
            "FIELDS": len(state), "PARAMETERS": len(self.parameters), "PARTS": len(parts), "LAW_READ": read + used,
            "LAW_STEP": to_c(step, end=" \\\n"), "LAW_PRESENT": to_c(stress, end=" \\\n"),
            "LAW_STORED": to_c({"stored": self.stored}, end=" \\\n"),
            "RECORDED": len(self.recorded), "ONCE": len(once),
            "LAW_ONCE": to_c({f"once[{place}]": part for place, part in enumerate(once.values())}, end=" \\\n"),
            "LAW_RECORDED": to_c(
                {f"STRESS({place})": value for place, value in enumerate(self.recorded.values())}, end=" \\\n"
            ),
        }  # fmt: skip

    def evaluate(
        self, strain: dict[str, np.ndarray], state: dict[str, np.ndarray], dt: float | np.ndarray,
        parameters: Mapping[str, np.ndarray] | None = None,
    ) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:  # fmt: skip
        """Return the stress [Pa] and the new state of points from their strain, by name."""
        outputs = {f"o_{name}": value for name, value in (self.stress | self.advanced).items()}
        numbers = self._numbers(outputs, strain, state, dt, parameters)
        like = np.zeros_like(strain[self.components[0]])
        rows = [value + like for value in numbers]
        count = len(self.components)
        return (
            dict(zip(self.components, rows[:count], strict=True)), dict(zip(self.state, rows[count:], strict=True))
        )  # fmt: skip

    def inelastic_stress(
        self, strain: dict[str, np.ndarray], state: dict[str, np.ndarray],
        parameters: Mapping[str, np.ndarray] | None = None,
    ) -> np.ndarray:  # fmt: skip
        """Return the present inelastic stress of points [Pa], shape (components, points)."""
        result = self._present(*self._values(strain, state, 0.0, parameters))
        return np.stack([value + np.zeros_like(strain[self.components[0]]) for value in result])

    @cached_property
    def _present(self) -> Any:
        """Function of the inputs of the formulas that returns the inelastic stress."""
        return to_numpy({f"o_{name}": value for name, value in self.inelastic.items()}, self._inputs)

    def tangent(
        self, strain: dict[str, np.ndarray], state: dict[str, np.ndarray], dt: float | np.ndarray,
        parameters: Mapping[str, np.ndarray] | None = None,
    ) -> np.ndarray:  # fmt: skip
        """Return the exact derivative of the stress by the strain [Pa], shape (components, components, points)."""
        return self._derivatives(self.stress, strain, state, dt, parameters)

    def inelastic_tangent(
        self, strain: dict[str, np.ndarray], state: dict[str, np.ndarray], dt: float | np.ndarray,
        parameters: Mapping[str, np.ndarray] | None = None,
    ) -> np.ndarray:  # fmt: skip
        """Return the same derivative of the inelastic stress [Pa]."""
        return self._derivatives(self.inelastic, strain, state, dt, parameters)

    def _derivatives(
        self, stress: dict[str, Expression], strain: dict[str, np.ndarray], state: dict[str, np.ndarray],
        dt: float | np.ndarray, parameters: Mapping[str, np.ndarray] | None,
    ) -> np.ndarray:  # fmt: skip
        outputs = {
            f"t_{row}_{column}": derivative(stress[row], self._strain[column])
            for row in self.components for column in self.components
        }  # fmt: skip
        like = np.zeros_like(strain[self.components[0]])
        items = [value + like for value in self._numbers(outputs, strain, state, dt, parameters)]
        count = len(self.components)
        return np.stack(items).reshape(count, count, *like.shape)

    def _numbers(
        self, outputs: dict[str, Expression], strain: dict[str, np.ndarray], state: dict[str, np.ndarray],
        dt: float | np.ndarray, parameters: Mapping[str, np.ndarray] | None,
    ) -> Any:  # fmt: skip
        """Return the values of expressions."""
        return to_numpy(outputs, self._inputs)(*self._values(strain, state, dt, parameters))

    @property
    def _inputs(self) -> list[str]:
        """Names of the inputs of the formulas."""
        of_point = [*(f"e_{name}" for name in self.components), *(f"s_{name}" for name in self.state)]
        return [*of_point, "dt", *(f"p_{place}" for place in range(len(self.parameters)))]

    def _values(
        self, strain: dict[str, np.ndarray], state: dict[str, np.ndarray], dt: float | np.ndarray,
        parameters: Mapping[str, np.ndarray] | None,
    ) -> list[Any]:  # fmt: skip
        """Return the inputs in the order of their names."""
        of_point = [*(strain[name] for name in self.components), *(state[name] for name in self.state)]
        return [*of_point, dt, *((parameters or {})[key] for key in self.parameters)]


@lru_cache
def traced(material: Material, plane: Plane) -> TracedMaterial:
    """Return the traced formulas of a material in a plane."""
    return TracedMaterial(material, plane)


def _expression(value: Any) -> Expression:
    return value if isinstance(value, Expression) else constant(value)


def _is_zero(value: Expression) -> bool:
    return value.op == "constant" and value.args[0] == 0
