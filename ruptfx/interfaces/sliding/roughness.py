"""Roughness of the surfaces of a sliding interface, and their pressure, in the initial state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ruptfx.bodies.meshes.block_on_rigid import BlockOnRigid
from ruptfx.bodies.meshes.rough_plates import RoughPlates
from ruptfx.input.profiles.constant import Constant
from ruptfx.input.profiles.places import parts
from ruptfx.input.profiles.random import Random
from ruptfx.input.profiles.self_affine import SelfAffine
from ruptfx.input.profiles.self_affine_surface import SelfAffineSurface
from ruptfx.input.profiles.sinusoid import Sinusoid
from ruptfx.input.profiles.surface_table import SurfaceTable
from ruptfx.input.profiles.table import Table
from ruptfx.input.schema import Part
from ruptfx.interfaces.faults.interface import local_frame
from ruptfx.interfaces.faults.sides import Sides, sides_of
from ruptfx.interfaces.sliding.interface import SlidingInterface
from ruptfx.interfaces.sliding.surface import Floats, Surface

if TYPE_CHECKING:
    from ruptfx.bodies.boundaries.loading import Loads
    from ruptfx.bodies.space.discretisation import Discretisation
    from ruptfx.interfaces.faults.fault import Fault

SMOOTH = 1e-9  # root mean square slope caused by rounding
IRREGULAR = SelfAffine, SelfAffineSurface, Random, SurfaceTable, Table
"""Profiles of random or of measured heights."""


@dataclass(frozen=True)
class Roughness:
    """Roughness of two opposite surfaces.

    Attributes
    ----------
    modulus : float
        E* of the two bodies beside the interface [Pa].
    slope : float
        Root mean square slope of their distance.
    wave : (float, float), or None
        Amplitude and wavelength of their distance [m], if it is a sinusoid.
    shortest : float or None
        Shortest wavelength of the profiles [m], if they have one.
    spacing : (float, float)
        Median distance of nodes of the plus and the minus side [m].
    pressure : float or None
        Largest mean pressure [Pa]; None if it depends on the motion of edges.
    random : bool
        The theory of random roughness is for these surfaces.
    """

    modulus: float
    slope: float
    wave: tuple[float, float] | None
    shortest: float | None
    spacing: tuple[float, float]
    pressure: float | None
    random: bool = True


def roughness(
    model: Discretisation, mesh: Part, fault: Fault, loads: Sequence[tuple[float, Loads]]
) -> Roughness | None:
    """Return the roughness of an interface, None if it is smooth or a side has several materials or anisotropic ones.

    Parameters
    ----------
    model : Discretisation
        On one rank.
    mesh : Part
        Table of the mesh.
    loads : sequence of (float, Loads)
        Times [s], and the loads on the bodies for each.
    """
    face = fault.interface
    assert isinstance(face, SlidingInterface)
    sides = face.geometry.plus, face.geometry.minus
    slope = _slope(*sides)
    if slope < SMOOTH or not all(_is_isotropic(model, side) for side in sides):
        return None
    spacing = sides[0].spacing, sides[1].spacing
    profiles = _profiles(mesh)
    wave, shortest = _waves(profiles)
    modulus, pressure = _modulus(sides_of(model, face)), _pressure(model, fault, face, loads)
    random = face.geometry.dim == 2 or any(map(_is_random, profiles))
    return Roughness(modulus, slope, wave, shortest, spacing, pressure, random)


def welded_nodes(model: Discretisation, side: Surface) -> np.ndarray:
    """Return which nodes are of the bodies of a surface or of bodies welded to them, shape (nodes,) of bool."""
    layout = model.layout
    return np.asarray(np.isin(layout.welded[layout.body], layout.welded[layout.body[side.nodes]]))


def mean_frame(side: Surface) -> Floats:
    """Return the mean normal and the tangents of a surface, or the chord of a chain as its tangent; rows."""
    if side.points.shape[1] == 2:
        chord = side.points[-1] - side.points[0]
        return np.asarray(local_frame(np.array([[-chord[1], chord[0]]]) / np.linalg.norm(chord))[0])
    normal = (side.shares[..., None] * _normals(side)).sum(axis=(0, 1))
    frame: Floats = local_frame(normal[None] / np.linalg.norm(normal))[0]
    return frame


def largest_slope(side: Surface) -> float:
    """Return the largest slope of a surface to its mean plane, or of a chain to its chord."""
    frame = mean_frame(side)
    if len(frame) == 2:
        steps = np.diff(side.points, axis=0)
        return float(np.max(np.abs(steps @ frame[0]) / np.maximum(steps @ frame[1], 1e-300)))
    upright = np.clip(_normals(side) @ frame[0], 1e-300, 1.0)
    return float(np.max(np.sqrt(1 - upright**2) / upright))


def _normals(side: Surface) -> Floats:
    """Return the unit normals at the nodes of the facets of a surface, shape (facets, nodes of a facet, 3)."""
    directions = side.directions(side.points)
    return np.asarray(directions / np.linalg.norm(directions, axis=2, keepdims=True))


def _slope(plus: Surface, minus: Surface) -> float:
    """Return the root mean square slope of the distance of two surfaces where they overlap along the tangents."""
    frame = mean_frame(plus)
    if len(frame) == 3:
        return _slope_in_space(plus, minus, frame)
    (here, above), (there, below) = ((side.points @ frame[1], side.points @ frame[0]) for side in (plus, minus))
    low, high = max(here[0], there[0]), min(here[-1], there[-1])
    s = np.unique(np.clip(np.concatenate([here, there]), low, high))
    apart = np.interp(s, here, above) - np.interp(s, there, below)
    step = np.diff(s)
    return float(np.sqrt(np.sum(np.diff(apart) ** 2 / step) / step.sum()))


def _slope_in_space(plus: Surface, minus: Surface, frame: Floats) -> float:
    """Return the root mean square slope of the distance of two surfaces, at the nodes of the plus side.

    The gradient of the opposite surface is that at its nearest node in the mean plane.
    """
    from scipy.spatial import cKDTree  # imported late: ordinary runs do not need it

    gradients = []
    for side in (plus, minus):
        sums = side.sum_at_nodes(_normals(side) * side.shares[..., None]) @ frame.T
        gradients.append(-sums[:, 1:] / sums[:, :1])
    (here, there) = (side.points @ frame[1:].T for side in (plus, minus))
    apart, nearest = cKDTree(there).query(here, distance_upper_bound=2 * max(plus.spacing, minus.spacing))
    faces = np.isfinite(apart)
    difference = gradients[0][faces] - gradients[1][nearest[faces]]
    weight = plus.measures[faces]
    return float(np.sqrt(weight @ np.sum(difference**2, axis=1) / weight.sum())) if weight.sum() else 0.0


def _is_isotropic(model: Discretisation, side: Surface) -> bool:
    """Return whether the bodies of a side, if it has any, are of one isotropic material."""
    beside = [model.materials[body] for body in np.flatnonzero(model.layout.touches[:, side.nodes].any(axis=1))]
    return all(each.lame(model.plane) is not None and each == beside[0] for each in beside)


def _modulus(sides: Sides) -> float:
    """Return E* [Pa], one over the mean along the interface of the sum of (1 - nu^2) / E beside it.

    In plane stress without nu; a rigid side adds nothing. E / (1 - nu^2) is 4 G (1 - (c_s / c_p)^2).
    """
    modulus = 4 * sides.moduli[..., 0, 0] * (1 - (sides.along[..., 1] / sides.along[..., 0]) ** 2)
    return float(1 / np.mean(np.sum(1 / modulus, axis=0)))


def _profiles(mesh: Part) -> tuple[object, ...]:
    """Return the profiles of both surfaces, none if the mesh has other shapes."""
    if isinstance(mesh, RoughPlates):
        return mesh.upper.profile, mesh.lower.profile
    if isinstance(mesh, BlockOnRigid) and mesh.base is not None:
        return 0.0, mesh.base.profile
    return ()


def _is_random(profile: object) -> bool:
    """Return whether a profile is of random or measured heights, or a profile inside it is."""
    return isinstance(profile, Part) and any(isinstance(part, IRREGULAR) for _, part in parts(profile, ""))


def _waves(profiles: tuple[object, ...]) -> tuple[tuple[float, float] | None, float | None]:
    """Return amplitude and wavelength of a sinusoidal distance, and the shortest wavelength of profiles, or None."""
    lengths = [p.wavelength if isinstance(p, Sinusoid) else p.shortest for p in profiles
               if isinstance(p, Sinusoid | SelfAffine | SelfAffineSurface)]  # fmt: skip
    shortest = min(lengths, default=None)
    plain = all(isinstance(p, Sinusoid | Constant | float | int) for p in profiles)
    if shortest is None or not plain or max(lengths) > shortest * (1 + 1e-9):
        return None, shortest
    upper, lower = (p.amplitude * np.exp(1j * p.phase) if isinstance(p, Sinusoid) else 0.0 for p in profiles)
    return (float(abs(upper - lower)), shortest), shortest


def _pressure(
    model: Discretisation, fault: Fault, face: SlidingInterface, loads: Sequence[tuple[float, Loads]]
) -> float | None:
    """Return the largest mean pressure of initial stress and loads [Pa], None if motion of edges determines it."""
    area: Floats = (face.weight[:, None] * face.frame[:, 0]).sum(axis=0)
    length = float(np.linalg.norm(area))
    initial = float(face.weight @ fault.normal_stress_0) / length
    across = int(np.argmax(np.abs(area)))
    for side, sign in ((face.geometry.plus, -1.0), (face.geometry.minus, 1.0)):
        if not len(side.nodes):  # rigid
            continue
        nodes = np.flatnonzero(welded_nodes(model, side))
        dim = len(area)
        if any(each.prescribed.reshape(-1, dim)[nodes, across].any() or each.supports for _, each in loads):
            continue
        pushes = [each.force(time).reshape(-1, dim)[nodes].sum(axis=0) @ area for time, each in loads]
        return initial + max(sign * float(push) for push in pushes) / length**2
    return None
