"""What acts on the bodies: initial stress, driven, loaded and absorbing edges.

The initial stress is in equilibrium with what presses the bodies together; the displacement is measured from that
state, so a driven edge or a traction here is what comes on top of it. Edges that are not named are free to move under
their initial load.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Discriminator, Field, Tag, model_validator

from ruptfx import parallel
from ruptfx.profiles import evaluate
from ruptfx.schema import CaseError, Part, Unit
from ruptfx.units import Time, VaryingPressure, VaryingStress, Velocity

Component = Literal["x", "y", "z"]
MOST_COUPLING = 0.01  # of what dashpots leave out of the impedance, over its trace
Range = Annotated[list[float], Field(min_length=2, max_length=2), Unit("m")]


class InitialStress(Part):
    """Stress an interface carries before anything happens: its tractions, or the stress tensor of the bodies.

    The bodies' own stress does not act on the motion, but snapshots and fringes show it. Tractions do not tell all of
    it: without a tensor it is taken to be the uniform stress that carries the mean tractions of the first interface,
    with no stress along that interface. Give the tensor where the bodies are also loaded sideways.
    """

    normal: VaryingPressure | None = None
    """Normal stress, positive in compression."""
    shear: VaryingStress | None = None
    """Shear traction along the (first) tangent; without it, what a rate-and-state law carries whose slip rate and
    state are both given, else zero."""
    tensor: Annotated[list[float], Field(min_length=3, max_length=6), Unit("Pa")] | None = None
    """Uniform stress of the bodies instead, the same for all interfaces that give it, tension positive: xx, yy, xy, in
    3D xx, yy, zz, xy, yz, xz."""

    @model_validator(mode="after")
    def _one_way(self) -> InitialStress:
        if (self.normal is None) == (self.tensor is None):
            raise ValueError("give either normal (and shear) or tensor")
        if self.tensor is not None and (self.shear is not None or len(self.tensor) not in (3, 6)):
            raise ValueError("tensor has 3 components (xx, yy, xy), 6 in 3D, and stands alone")
        return self

    def matrix(self, dim: int) -> np.ndarray | None:
        """The tensor as a matrix, shape (dim, dim) [Pa]; None where tractions are given."""
        if self.tensor is None:
            return None
        entries = {2: [(0, 0), (1, 1), (0, 1)], 3: [(0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2)]}[dim]
        stress = np.zeros((dim, dim))
        for (i, j), value in zip(entries, self.tensor, strict=True):
            stress[i, j] = stress[j, i] = value
        return stress

    def tractions(self, face: Any, law: Any) -> tuple[np.ndarray, np.ndarray]:
        """Normal stress and shear traction at the points of an interface, shapes (n,) and (n, tangents) [Pa].

        Raises
        ------
        CaseError
            Shear stress, slip rate and state of a rate-and-state law that contradict each other.
        """
        shear = np.zeros((len(face.position), face.tangents))
        tensor = self.matrix(face.frame.shape[2])
        if tensor is not None:
            local = np.einsum("ikc,cd,id->ik", face.frame, tensor, face.frame[:, 0])
            return -local[:, 0], local[:, 1:]
        given = self.at(face.position)
        normal = evaluate(given.normal, face.position)
        rate = law.given_slip_rate()
        carried = None
        if rate is not None:
            state = law.initial_state(normal, np.zeros_like(normal), np.zeros_like(normal))
            carried = law.strength(rate, normal, state) + np.zeros_like(normal)
        if self.shear is not None:
            shear[:, 0] = evaluate(given.shear, face.position)
            if carried is not None and np.any(np.abs(np.abs(shear[:, 0]) - carried) > 1e-6 * normal):
                raise CaseError(
                    "initial_stress.shear: the law's initial slip rate and state carry another; give two of three"
                )
        elif carried is not None:
            shear[:, 0] = carried
        return normal, shear


class _Edge(Part):
    edge: str
    """``body.side``, for example ``upper.left``."""


class Driven(_Edge):
    """The edge moves with a given velocity in one direction and is free in the others."""

    kind: Literal["driven"]
    component: Component
    velocity: Velocity
    ramp: Time = 0.0
    """Time over which the velocity grows linearly from zero."""
    x_range: Range | None = None
    y_range: Range | None = None
    """Only the part of the edge within these coordinates moves."""

    def speed(self, time: float) -> float:
        """Velocity of the edge [m/s]."""
        return self.velocity * ramp(time, self.ramp)

    def travelled(self, time: float) -> float:
        """Displacement of the edge since time zero [m]."""
        if time < self.ramp:
            return 0.5 * self.velocity * time**2 / self.ramp
        return self.velocity * (time - 0.5 * self.ramp)


class Ricker(Part):
    """Ricker wavelet (1 - 2 a) exp(-a), a = (pi frequency (t - delay))^2."""

    kind: Literal["ricker"]
    frequency: Annotated[float, Field(gt=0), Unit("1/s")]
    """Of the peak of the spectrum."""
    delay: Time
    """Time of the peak; from 1.5 / frequency on nothing begins suddenly."""

    def __call__(self, time: float) -> float:
        a = (np.pi * self.frequency * (time - self.delay)) ** 2
        return float((1 - 2 * a) * np.exp(-a))


class Sampled(Part):
    """Linear interpolation between given times, constant beyond the ends."""

    kind: Literal["sampled"]
    times: Annotated[list[float], Field(min_length=2), Unit("s")]
    values: Annotated[list[float], Field(min_length=2), Unit("1")]

    @model_validator(mode="after")
    def _matching(self) -> Sampled:
        if len(self.values) != len(self.times) or np.any(np.diff(self.times) <= 0):
            raise ValueError("times must increase, with one value for each")
        return self

    def __call__(self, time: float) -> float:
        return float(np.interp(time, self.times, self.values))


class Traction(_Edge):
    """A traction on the edge on top of the initial load."""

    kind: Literal["traction"]
    traction: Annotated[list[float], Field(min_length=1, max_length=3), Unit("Pa")]
    ramp: Time = 0.0
    """Time over which the traction grows linearly from zero."""
    history: Annotated[Ricker | Sampled, Field(discriminator="kind")] | None = None
    """Factor of the traction in time."""
    x_range: Range | None = None
    y_range: Range | None = None
    """Only the sides of elements whose middle is within these coordinates are loaded."""

    def factor(self, time: float) -> float:
        """What the traction is multiplied with."""
        return ramp(time, self.ramp) * (self.history(time) if self.history is not None else 1.0)


class Absorbing(_Edge):
    """Lysmer dashpots: traction = impedance times velocity, rho c_p (normal) and rho c_s (tangential) where isotropic;
    exact for plane waves at normal incidence. Every component has its own dashpot, so the edge must be along an axis,
    and so must the axes of an anisotropic material.

    An interface may cross the edge and a rupture leave through it. Dashpots do not hold the static stress of the crack
    beyond, so that slip next to the edge becomes too large behind the front: keep it away from where slip is read.
    Source: Lysmer and Kuhlemeyer (1969).
    """

    kind: Literal["absorbing"]


class Free(_Edge):
    """No traction beyond the initial load: what an edge is when it is not named."""

    kind: Literal["free"]


BOUNDARIES: dict[str, type[_Edge]] = {
    "driven": Driven, "traction": Traction, "absorbing": Absorbing, "free": Free,
}  # fmt: skip


def _tag(value: Any) -> str:
    kind = value.get("kind") if isinstance(value, dict) else getattr(value, "kind", None)
    return f"<{kind}>"


AnyBoundary = Annotated[
    Annotated[Driven, Tag("<driven>")] | Annotated[Traction, Tag("<traction>")]
    | Annotated[Absorbing, Tag("<absorbing>")] | Annotated[Free, Tag("<free>")],
    Discriminator(
        _tag, custom_error_type="unknown_kind",
        custom_error_message=f"a boundary needs a 'kind', one of: {', '.join(BOUNDARIES)}",
    ),
]  # fmt: skip


def ramp(time: float, duration: float) -> float:
    """Linear growth from 0 to 1."""
    return 1.0 if duration <= 0 else min(max(time / duration, 0.0), 1.0)


class Loads:
    """The boundaries of a case as arrays over the local degrees of freedom.

    Attributes
    ----------
    driven : list of (dofs, Driven)
    dashpot : ndarray, shape (nodes * components,)
        Damping force per velocity [N s/m].
    force : list of (ndarray, Traction)
        Nodal force of the full traction [N].
    """

    def __init__(self, model: Any, boundaries: Sequence[_Edge]) -> None:
        self._model = model
        self.driven: list[tuple[np.ndarray, Driven]] = []
        self.force: list[tuple[np.ndarray, Traction]] = []
        self.dashpot = np.zeros(model.nodes * model.components)
        for number, boundary in enumerate(boundaries):
            tag = model.bodies.tag(boundary.edge, f"boundaries.{number}.edge")
            if isinstance(boundary, Driven):
                self.driven.append((self._driven_dofs(boundary, tag), boundary))
            elif isinstance(boundary, Traction):
                self.force.append((self._edge_force(boundary, tag, number), boundary))
            elif isinstance(boundary, Absorbing):
                self.dashpot += self._dashpot(boundary, tag, number)

    def _dashpot(self, boundary: Absorbing, tag: int, number: int) -> np.ndarray:
        coupling = self._model.edge_coupling(tag)
        if coupling > MOST_COUPLING:
            raise CaseError(
                f"boundaries.{number}.edge = '{boundary.edge}': dashpots along x and y would send back {coupling:.1%} "
                f"of a wave at normal incidence, at most {MOST_COUPLING:.0%} is allowed; turn the edge, and the axes "
                "of an anisotropic material, along an axis"
            )
        return self._model.edge_dashpot(tag)

    def _edge_force(self, boundary: Traction, tag: int, number: int) -> np.ndarray:
        if not any(boundary.traction):
            return np.zeros_like(self.dashpot)  # of which UFL makes no form
        limits = [boundary.x_range, boundary.y_range]
        force = self._model.edge_force(tag, boundary.traction, limits)
        if any(limits) and not parallel.total(self._model.comm, np.abs(force).sum()):
            given = ", ".join(f"{n} = {v}" for n, v in zip(("x_range", "y_range"), limits, strict=True) if v)
            raise CaseError(f"boundaries.{number}: {boundary.edge} has no side with its middle in {given} m")
        return force

    def _driven_dofs(self, boundary: Driven, tag: int) -> np.ndarray:
        nodes = self._model.edge_nodes(tag)
        x = self._model.coordinates[nodes]
        slack = 1e-9 * np.ptp(self._model.coordinates, axis=0).max(initial=0)
        for axis, limits in enumerate((boundary.x_range, boundary.y_range)):
            if limits is not None:
                keep = (x[:, axis] >= limits[0] - slack) & (x[:, axis] <= limits[1] + slack)
                nodes, x = nodes[keep], x[keep]
        return nodes * self._model.components + self._model.component(boundary.component)

    @property
    def prescribed(self) -> np.ndarray:
        """True for every degree of freedom of a driven edge."""
        prescribed = np.zeros(len(self.dashpot), dtype=bool)
        for dofs, _ in self.driven:
            prescribed[dofs] = True
        return prescribed

    def drive(self, velocity: np.ndarray, time: float) -> None:
        """Give driven edges the velocity they have at a time [s], in place."""
        for dofs, drive in self.driven:
            velocity[dofs] = drive.speed(time)

    def moved(self, displacement: np.ndarray, start: float, end: float) -> np.ndarray:
        """A displacement at one time [s] with driven edges where they are at another [m]."""
        moved = displacement.copy()
        for dofs, drive in self.driven:
            moved[dofs] = displacement[dofs] + drive.travelled(end) - drive.travelled(start)
        return moved

    @property
    def acting(self) -> np.ndarray:
        """True for every degree of freedom a boundary acts on."""
        acting = (self.dashpot != 0) | self.prescribed
        for force, _ in self.force:
            acting |= force != 0
        return acting
