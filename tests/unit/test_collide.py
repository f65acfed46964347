"""Two triangles that overlap: forces are the gradient of the energy, and that is the integral it is meant to be."""

from __future__ import annotations

import ctypes
from importlib.resources import files

import numpy as np
import pytest

from ruptfx.platform.codegen import native

REST = np.array([0.8, 1.3])
MODULUS = 3.0


class Pair:
    """The compiled functions for one pair of triangles, corners x of shape (2, 6)."""

    def __init__(self, friction: float = 0.0) -> None:
        parts = "interfaces/faults/return_map.c", "interfaces/collisions/collide.c"
        source = "".join(files("ruptfx").joinpath(part).read_text() for part in parts)
        self.library = native.load("collide", source)
        self.pair, self.one = np.array([[0, 1]], dtype=np.int32), np.ones(1)
        self.friction, self.traction, self.taken = np.array([friction]), np.zeros(1), np.zeros(1)
        self.held, self.stored = np.zeros(1), np.zeros(1)

    def force(self, x: np.ndarray, moved: np.ndarray | None = None) -> np.ndarray:
        force = np.zeros_like(x)
        self.stored[:] = 0
        arrays = (self.pair, x, np.zeros_like(x) if moved is None else moved, REST, MODULUS * self.one, self.friction,
                  self.one, self.held, self.traction, force, self.taken, self.stored)  # fmt: skip
        self.library.collide(ctypes.c_long(1), *(ctypes.c_void_p(array.ctypes.data) for array in arrays))
        return force

    def energy(self, x: np.ndarray) -> float:
        arrays, found = (self.pair, x, REST, MODULUS * self.one), np.zeros(1)
        self.library.overlaps(ctypes.c_long(1), *(ctypes.c_void_p(a.ctypes.data) for a in (*arrays, found)))
        return float(found[0])


def triangles(seed: int) -> np.ndarray:
    """Two that overlap somehow, of either sense."""
    rng = np.random.default_rng(seed)
    while True:
        x = rng.uniform(-1, 1, (2, 3, 2)) + rng.uniform(-0.3, 0.3, (2, 1, 2))
        side = x[:, 1:] - x[:, :1]
        area = side[:, 0, 0] * side[:, 1, 1] - side[:, 0, 1] * side[:, 1, 0]
        found = np.ascontiguousarray(x.reshape(2, 6))
        if np.abs(area).min() > 0.3 and Pair().energy(found) > 1e-3:
            return found


def barycentric(x: np.ndarray, points: np.ndarray) -> np.ndarray:
    corners = x.reshape(3, 2)
    rest = np.linalg.solve((corners[1:] - corners[0]).T, (points - corners[0]).T).T
    return np.column_stack([1 - rest.sum(axis=1), rest])


@pytest.mark.parametrize("seed", range(6))
def test_energy_is_the_integral_of_both_potentials(seed: int) -> None:
    x = triangles(seed)
    n = 1500
    low, high = x.reshape(-1, 2).min(axis=0), x.reshape(-1, 2).max(axis=0)
    axes = [low[c] + (high[c] - low[c]) * (np.arange(n) + 0.5) / n for c in (0, 1)]
    points = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    phi = np.array([3 * barycentric(each, points).min(axis=1) for each in x])
    inside = (phi > 0).all(axis=0)
    corners = x.reshape(2, 3, 2)
    twice = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1]))
    cell = np.prod((high - low) / n)
    expected = MODULUS * cell * sum(REST[i] / twice[i] * phi[i][inside].sum() for i in (0, 1))
    assert Pair().energy(x) == pytest.approx(expected, rel=2e-3, abs=1e-6)


@pytest.mark.parametrize("seed", range(12))
def test_forces_are_the_gradient(seed: int) -> None:
    """Also of triangles that deform; their sum and moment are nothing."""
    pair, x = Pair(), triangles(seed)
    force, rng = pair.force(x), np.random.default_rng(seed)
    assert np.abs(force).max() > 1e-4
    for _ in range(4):
        way, step = rng.normal(size=x.shape), 1e-5
        slope = (pair.energy(x + step * way) - pair.energy(x - step * way)) / (2 * step)
        assert slope == pytest.approx(-np.sum(force * way), rel=1e-6, abs=1e-7 * np.abs(force).max())
    total, arm = force.reshape(-1, 2), x.reshape(-1, 2)
    scale = np.abs(force).max()
    assert np.abs(total.sum(axis=0)).max() < 1e-13 * scale
    assert abs(np.sum(arm[:, 0] * total[:, 1] - arm[:, 1] * total[:, 0])) < 1e-13 * scale


def test_flush_faces_push_as_springs() -> None:
    """3 p d (1 / h_1 + 1 / h_2) for a small overlap d, times the length of the face, along its normal."""
    length, h = 2.0, (0.8, 1.3)  # twice the area is length times height
    for depth in (1e-6, 1e-4):
        x = np.array([[0, 0, length, 0, 0.7, h[0]], [0, depth, 0.9, depth - h[1], length, depth]])
        rest = [length * height for height in h]
        pair = Pair()
        force = pair.force(x).reshape(2, 3, 2).sum(axis=1)
        expected = 3 * MODULUS * depth * length * (REST[0] / rest[0] / h[0] + REST[1] / rest[1] / h[1])
        assert force[0, 1] == pytest.approx(expected, rel=10 * depth)
        assert abs(force[0, 0]) < 1e-3 * expected + 10 * depth * expected


def test_friction_sticks_then_slides_and_takes_what_work_is_done() -> None:
    pair, depth = Pair(friction=0.4), 1e-3
    at = np.array([[0, 0, 2.0, 0, 0.7, 0.8], [-1.0, depth, 0.9, depth - 1.3, 3.0, depth]])
    normal = np.linalg.norm(pair.force(at)[0].reshape(3, 2).sum(axis=0))
    step, work, before = 0.02 * 0.4 * normal / MODULUS, 0.0, 0.0
    for number in range(120):
        moved = np.zeros((2, 6))
        moved[0, ::2] = step * (1 if number < 80 else -1)
        force = pair.force(at, moved)  # at the same place: only what friction does is looked at
        assert np.abs(force.reshape(-1, 2).sum(axis=0)).max() < 1e-12 * normal
        now = -(force[0].reshape(3, 2).sum(axis=0)[0])
        work, before = work + 0.5 * (now + before) * moved[0, 0], now
        assert abs(pair.traction[0]) <= 0.4 * normal * (1 + 1e-12)
        if number == 40:
            assert abs(pair.traction[0]) == pytest.approx(0.82 * 0.4 * normal, rel=1e-3)
        if number == 79:
            assert abs(pair.traction[0]) == pytest.approx(0.4 * normal, rel=1e-9)
    stored = 0.5 * pair.traction[0] ** 2 / MODULUS
    assert pair.taken[0] > 0 and work == pytest.approx(pair.taken[0] + stored, rel=1e-3)


def test_friction_of_a_large_step_takes_the_mean_traction() -> None:
    """Steps of eight times the slip to the limit, back and forth: each trapezoidal work is taken or stored."""
    pair, depth = Pair(friction=0.4), 1e-3
    at = np.array([[0, 0, 2.0, 0, 0.7, 0.8], [-1.0, depth, 0.9, depth - 1.3, 3.0, depth]])
    push = pair.force(at)[0].reshape(3, 2).sum(axis=0)
    normal = np.linalg.norm(push)
    along, before, stored = np.array([-push[1], push[0]]) / normal, 0.0, 0.0
    for way in (1, -1, 1, 0.05, -1):  # times twice the slip from one limit to the other
        moved, taken = np.zeros((2, 6)), pair.taken[0]
        moved[0] = np.tile(way * 8 * 0.4 * normal / MODULUS * along, 3)
        now = -(pair.force(at, moved)[0].reshape(3, 2).sum(axis=0) @ along)
        kept = 0.5 * now**2 / MODULUS
        work = 0.5 * (before + now) * (moved[0, :2] @ along)
        assert work == pytest.approx(pair.taken[0] - taken + kept - stored, abs=1e-12 * normal)
        before, stored = now, kept
    assert abs(before) == pytest.approx(0.4 * normal) and pair.taken[0] > 0


def test_triangles_apart_exert_nothing() -> None:
    x = triangles(0)
    x[1, ::2] += 5.0
    assert not Pair(0.5).force(x).any() and Pair().energy(x) == 0


def test_an_overlap_at_rest_pushes_only_beyond_it() -> None:
    """The energy is (sqrt(E) - sqrt(E_0))^2; less of an overlap is a smaller one at rest, and costs nothing."""
    pair, x = Pair(), triangles(3)
    pair.held[:] = at_rest = pair.energy(x)
    assert np.abs(pair.force(x)).max() == 0
    out = Pair().force(x)
    deeper = x - 0.01 * out / np.abs(out).max()
    way, step = np.random.default_rng(1).normal(size=x.shape), 1e-6

    def energy(at: np.ndarray) -> float:
        return float((np.sqrt(pair.energy(at)) - np.sqrt(at_rest)) ** 2)

    slope = (energy(deeper + step * way) - energy(deeper - step * way)) / (2 * step)
    assert pair.energy(deeper) > at_rest and pair.held[0] == at_rest
    assert slope == pytest.approx(-np.sum(pair.force(deeper) * way), rel=1e-6)
    apart = x + 0.01 * out / np.abs(out).max()
    assert not pair.force(apart).any() and pair.held[0] == pair.energy(apart) < at_rest


def test_contact_that_begins_or_ends_between_two_steps_works_as_much_as_it_holds() -> None:
    """Over a flush face that comes from outside, or leaves; in between nothing is scaled."""
    length, h, way = 2.0, (0.8, 1.3), 1e-5
    for first in (0.1, 0.4, 0.9):  # of a step, the depth after the first one inside
        depths = way * np.concatenate([first + np.arange(-1, 4), first + np.arange(3, -2, -1) - 0.5])
        pair, work, before = Pair(), 0.0, np.zeros((2, 6))
        for depth, moved in zip(depths, np.diff(depths, prepend=depths[0] - way), strict=True):
            low = [0, depth, 0.9, depth - h[1], length, depth]
            x, by = np.array([[0, 0, length, 0, 0.7, h[0]], low]), np.zeros((2, 6))
            by[1, 1::2] = moved
            force = pair.force(x, by)
            work, before = work + 0.5 * float(np.sum((before + force) * by)), force
            if depth > 0:
                deep = abs(moved) < depth
                assert np.allclose(force, Pair().force(x), rtol=1e-4) == deep
                assert pair.stored[0] == pytest.approx(pair.energy(x), rel=1e-9)
        most = pair.energy(np.array([[0, 0, length, 0, 0.7, h[0]], [0, 4 * way, 0.9, 4 * way - h[1], length, 4 * way]]))
        assert abs(work) < 2e-3 * most
