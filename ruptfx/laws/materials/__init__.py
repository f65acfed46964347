"""Bulk materials, one per file: strain energy density in UFL, density and wave speeds."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, NamedTuple, Self, cast, get_args

import numpy as np
from pydantic import BeforeValidator, model_validator

from ruptfx import RuptfxError
from ruptfx.input.profiles import PointsError, Profile
from ruptfx.input.schema import Alternative, Bound, CaseError, OwnJsonSchema, alternative, by_name
from ruptfx.input.units import FringeConstant, VaryingDensity
from ruptfx.laws.materials.library import LIBRARY, constants_of
from ruptfx.laws.materials.stiffness import christoffel, in_frame, surface_wave_speed, tangent_stiffness
from ruptfx.laws.materials.tensor import IDENTITY, Tensor

Plane = Literal["stress", "strain", "antiplane", "solid", "axisymmetric"]
IN_PLANE: tuple[Plane, ...] = ("stress", "strain")
"""Where bodies move in a plane."""
WITH_MEMORY: tuple[Plane, ...] = ("strain", "antiplane", "solid")
"""Where any material with memory works."""
"""What the displacement is: two components in plane stress or strain, the one out of plane, all three in 3D, or two in
the section of bodies of revolution, along the axis and the radius."""


class WaveSpeeds(NamedTuple):
    """Body and Rayleigh wave speeds [m/s] along x, or along an interface.

    The direction matters in anisotropic bodies only. `c_p` is the plate speed c_l in plane stress, and in antiplane
    `c_p` and `c_R` equal c_s.
    """

    c_p: float
    c_s: float
    c_R: float


class StateField(NamedTuple):
    """A state variable of every point of a material.

    Attributes
    ----------
    unit : str
    start : float
        Initial value, of a tensor that of all components.
    tensor : bool
        A symmetric tensor, `Tensor`; else a number.
    """

    unit: str
    start: float = 0.0
    tensor: bool = False


class RecordedState(NamedTuple):
    """A number of the state of a material that snapshots of the bodies contain.

    Attributes
    ----------
    unit, long_name : str
    """

    unit: str
    long_name: str


class PointError(ValueError):
    """Parameters of a material that contradict each other at a point; `index` is that of the point."""

    def __init__(self, message: str, index: int) -> None:
        super().__init__(message)
        self.index = index


class Waves:
    """Speeds and impedances of small waves in a material, from the second derivative of its energy."""

    if TYPE_CHECKING:
        density: Any
        offers: ClassVar[frozenset[str]]

        @classmethod
        def kind(cls) -> str: ...

    def wave_speeds(self, plane: Plane) -> WaveSpeeds:
        """Return the speeds of small waves about the initial state, along x at surfaces with the normal y [m/s].

        Raises
        ------
        RuptfxError
            A stiffness that does not follow from the energy alone, or that is not positive.
        """
        return self._wave_speeds_in(np.eye(3 if plane == "solid" else 2), plane)

    def wave_speeds_along(self, frame: np.ndarray, plane: Plane) -> WaveSpeeds:
        """Return the speeds of small waves along an interface [m/s].

        Of a material that computes `wave_speeds` itself these are the same in all directions.

        Parameters
        ----------
        frame : ndarray, shape (dim, dim)
            Unit vectors: the direction along the interface, its normal, and in 3D the one across both.
        plane : str
        """
        if "wave speeds" in self.offers:  # of isotropic bodies, and of plug-ins
            return self.wave_speeds(plane)
        return self._wave_speeds_in(frame, plane)

    def _wave_speeds_in(self, frame: np.ndarray, plane: Plane) -> WaveSpeeds:
        """Return fastest and slowest plane wave along the first direction, and the wave along the free surface.

        Computed from the second derivative of the energy.
        """
        speeds = np.linalg.eigvalsh(self.impedance(frame[0], plane)) / self.density
        if plane == "antiplane":
            return WaveSpeeds(*np.repeat(speeds, 3).tolist())
        surface = surface_wave_speed(in_frame(tangent_stiffness(cast("Material", self), plane), frame), self.density)
        return WaveSpeeds(float(speeds[-1]), float(speeds[0]), surface)

    def mach_free_speed(self, plane: Plane, frame: np.ndarray | None = None) -> float:
        """Return the speed of a shear rupture along x behind which no shear Mach front travels [m/s].

        A plane wave (1, -m) f(x + m y - v t) has no shear stress on y = 0. It is a wave of the body at rho v^2 =
        (C_11 C_22 - C_12^2) / (C_12 + C_22), with m^2 = (C_12 + rho v^2) / C_22: sqrt(2) c_s if the body is isotropic.
        NaN in antiplane, where x and y are no axes of symmetry, and without a stiffness. With a frame, as in
        `wave_speeds_along`, x and y are its first two directions.
        Source: Coker and Rosakis (2001), Phil. Mag. A 81, 571.
        """
        if plane == "antiplane":
            return np.nan
        try:
            C = tangent_stiffness(cast("Material", self), plane)
        except RuptfxError:  # of a plug-in that has wave speeds of its own
            return np.nan
        C = C if frame is None else in_frame(C, frame)
        if max(abs(C[0, 0, 0, 1]), abs(C[1, 1, 0, 1])) > 1e-9 * C[0, 0, 0, 0]:
            return np.nan
        modulus = (C[0, 0, 0, 0] * C[1, 1, 1, 1] - C[0, 0, 1, 1] ** 2) / (C[0, 0, 1, 1] + C[1, 1, 1, 1])
        return float(np.sqrt(modulus / self.density))

    def impedance(self, normal: np.ndarray, plane: Plane) -> np.ndarray:
        """Return the traction per velocity of plane waves that travel along a direction [Pa s/m].

        Z = sum_k rho c_k p_k p_k', with rho c_k^2 and p_k the eigenvalues and vectors of the Christoffel tensor
        n_j C_ijkl n_l: an absorbing boundary needs the traction Z times the velocity. Computed from the
        second derivative of the energy; isotropic, Z = rho c_p n n' + rho c_s (1 - n n').
        Source: Auld (1973), Acoustic fields and waves in solids.

        Parameters
        ----------
        normal : ndarray, shape (..., d)
            Unit vectors.
        plane : str

        Returns
        -------
        ndarray, shape (..., components, components)

        Raises
        ------
        RuptfxError
            A stiffness that does not follow from the energy alone, or that is not positive.
        """
        modulus, direction = np.linalg.eigh(christoffel(tangent_stiffness(cast("Material", self), plane), normal))
        if np.any(modulus <= 0):
            raise RuptfxError(
                f"material '{self.kind()}': some plane waves have a modulus of {modulus.min():.4g} Pa, which must be "
                "positive; change its elastic constants"
            )
        return np.einsum("...ik,...k,...jk->...ij", direction, np.sqrt(self.density * modulus), direction)


class Material(Waves, Alternative):
    """Contract of a material.

    `energy_density` is the elastic energy. A material with memory also has `stress`, `state_fields` and `stored`: its
    stress is written as a NumPy formula, which is traced into the sweep over the elements. `recorded_states` names what
    snapshots show of its state.
    """

    needs_with: ClassVar[dict[str, str]] = {"stress": "memory"}
    offers_with: ClassVar[dict[str, str]] = {"stored": "stored energy", "wave_speeds": "wave speeds"}
    isotropic: ClassVar[bool] = False
    """Whether its elastic energy is isotropic and linear, given by Young's modulus and Poisson's ratio."""
    linear: ClassVar[bool] = False
    """Whether `stress` is linear in strain and state; with memory only such a material works in plane stress."""
    needs_initial_stress: ClassVar[bool] = False
    """True if it cannot start without its field `initial_stress`, or the table `[initial_stress]`."""

    density: VaryingDensity
    """Mass per volume."""
    fringe_constant: FringeConstant | None = None
    """Fringe constant f_sigma: stress difference times thickness of one isochromatic fringe. Fringes are
    drawn if it and `output.plate_thickness` are given."""

    def energy_density(self, strain: Expr, plane: Plane) -> Expr:
        """Return the strain energy per volume [J/m3] as a UFL expression.

        Parameters
        ----------
        strain : UFL expression
            Symmetric gradient, shape (d, d); in antiplane the gradient of the out-of-plane displacement, shape (2,).
        plane : str
            For axisymmetric bodies `solid`; for short waves in them `strain`.
        """
        raise NotImplementedError

    def __hash__(self) -> int:
        return hash(self.model_dump_json())  # lists in profiles and tensors have no hash of their own

    @property
    def varying(self) -> dict[str, Profile]:
        """The parameters that vary in the bodies, by key; `initial_stress.0` is the first item of a list."""
        entries: dict[str, Profile] = {}
        for name in type(self).model_fields:
            value = getattr(self, name)
            items = {f"{name}.{number}": item for number, item in enumerate(value)} if isinstance(value, list) else {}
            entries |= {key: item for key, item in (items or {name: value}).items() if isinstance(item, Profile)}
        return entries

    def values_at(self, points: np.ndarray) -> dict[str, np.ndarray]:
        """Return the values of parameters that vary, by key as in `varying`, at points of the bodies; shape (n,).

        Parameters
        ----------
        points : ndarray, shape (n, dimensions)
            [m].

        Raises
        ------
        CaseError
            A profile that does not cover the points, or values outside the bounds of the key.
        """
        values = {}
        for key, profile in self.varying.items():
            try:
                values[key] = profile.in_body(points)
            except PointsError:  # names its own keys
                raise
            except CaseError as error:
                raise CaseError(f"{key}: {error}") from None
            for bound in _bounds(type(self), key.partition(".")[0]):
                bound.check(key, values[key], points)
        return values

    def with_values(self, values: Mapping[str, Any]) -> Material:
        """Return the material with unchecked numbers, arrays or expressions, by key as in `varying`."""
        changes: dict[str, Any] = {}
        for key, value in values.items():
            name, _, number = key.partition(".")
            if number:
                changes.setdefault(name, list(getattr(self, name)))[int(number)] = value
            else:
                changes[name] = value
        fields = {name: getattr(self, name) for name in type(self).model_fields}
        return type(self).model_construct(self.model_fields_set, **(fields | changes))  # without cached properties

    def check_values(self) -> None:
        """Refuse parameters that contradict each other; they are numbers, or arrays at points of the bodies.

        Raises
        ------
        ValueError
        """

    def yielded(self) -> np.ndarray | None:
        """Return the initial stress over the strength of a material that yields [1], by point; None for others."""
        return None

    @model_validator(mode="after")
    def _values_fit(self) -> Self:
        if not self.varying:
            self.check_values()
        return self

    @classmethod
    def has_memory(cls) -> bool:
        """Return whether the stress depends on more than the present strain."""
        return "memory" in cls.needs

    @classmethod
    def planes(cls) -> tuple[Plane, ...]:
        """Return the planes in which it works."""
        if not cls.has_memory():
            return ("stress", "strain", "antiplane", "solid", "axisymmetric")
        return ("stress", *WITH_MEMORY) if cls.linear else WITH_MEMORY

    def state_fields(self) -> dict[str, StateField]:
        """Return the state variables of `stress` by name."""
        return {}

    def stress(self, strain: Tensor, state: dict[str, Any], dt: Any) -> tuple[Tensor, dict[str, Any]]:
        """Return the stress at the end of a step and the new state, in NumPy operations without branches.

        With dt = 0 it must return the present stress, and the state without change. The stress must not grow faster
        with strain than that of `energy_density`, which determines the stable time step.

        Parameters
        ----------
        strain : Tensor
            At the end of the step.
        state : dict
            Numbers and tensors by name, at its beginning.
        dt : float
            Length of the step [s].

        Returns
        -------
        Tensor, dict
            Stress less the initial one [Pa], tension positive.
        """
        raise NotImplementedError

    def stored(self, strain: Tensor, state: dict[str, Any]) -> Any:
        """Return the stored energy per volume [J/m3]; the rest of the work of the stress is dissipated."""
        raise NotImplementedError

    def recorded_states(self) -> dict[str, RecordedState]:
        """Return what snapshots contain of the state, by name."""
        return {}

    def recorded(self, state: dict[str, Any]) -> dict[str, Any]:
        """Return the values of `recorded_states`, in NumPy operations without branches; default: state fields.

        Parameters
        ----------
        state : dict
            Numbers and tensors by name.

        Returns
        -------
        dict
            Numbers by the names of `recorded_states`.
        """
        return {name: state[name] for name in self.recorded_states()}

    def lame(self, plane: Plane) -> tuple[float, float] | None:
        """Return the Lamé parameters lambda and G [Pa] of a linear isotropic material; None for others.

        In plane stress lambda is the effective one. Code for isotropic bodies only calls this method; the operator
        `matrix_free` takes the stiffness of other materials from their energy.
        """
        return None

    def young_modulus_along(self, direction: np.ndarray) -> np.ndarray:
        """Young's modulus under tension along directions in the plane [Pa].

        Parameters
        ----------
        direction : ndarray, shape (n, 2)
            Unit vectors.

        Returns
        -------
        ndarray, shape (n,)
        """
        pairs = [(0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)]
        stiffness = tangent_stiffness(self, "solid")
        compliance = np.linalg.inv([[stiffness[(*row, *column)] for column in pairs] for row in pairs])
        x, y = direction.T
        stress = np.stack([x**2, y**2, 0 * x, 0 * x, 0 * x, x * y], axis=1)
        return np.asarray(1 / np.einsum("ni,ij,nj->n", stress, compliance, stress))

    def spring_share(self, plane: Plane, compliance: Callable[[float], float]) -> float | None:
        """Return the largest part of a compliance of the material that springs between its cells have.

        Parameters
        ----------
        plane : str
        compliance : callable
            Of springs on facets of all directions [1/Pa], from the Young's modulus that they are made for: their strain
            is that times the stress.

        Returns
        -------
        float or None
            None where `stiffened` knows no material.
        """
        return None

    def stiffened(self, plane: Plane, compliance: Callable[[float], float]) -> Material:
        """Return the material less compliant by the compliance of springs; arguments as of `spring_share`."""
        raise NotImplementedError


def _bounds(cls: type[Material], name: str) -> Iterator[Bound]:
    """Yield the bounds of the numbers of a key, also where it is a list of them."""
    waiting = [*cls.model_fields[name].metadata, cls.model_fields[name].annotation]
    while waiting:
        item = waiting.pop()
        if isinstance(item, Bound):
            yield item
        waiting += [*getattr(item, "__metadata__", ()), *get_args(item)]


if TYPE_CHECKING:
    from ruptfx.platform.fem import Expr

    AnyMaterial = Material
else:
    AnyMaterial = Annotated[
        alternative("ruptfx.laws.materials"),
        BeforeValidator(constants_of),
        OwnJsonSchema(by_name("materials", [*LIBRARY])),
    ]

SHARED = ("library", "stiffness", "tensor", "traced")
"""Files of this folder that are no kinds."""

__all__ = [
    "IDENTITY", "IN_PLANE", "AnyMaterial", "Material", "Plane", "PointError", "RecordedState", "StateField", "Tensor",
    "WaveSpeeds",
]  # fmt: skip
