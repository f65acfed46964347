"""Who faces whom: the identities of the dual mortar on two chains of facets, without bodies."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from helpers.messages import facts
from helpers.reference_mortar import MortarReference
from numpy.typing import NDArray

from ruptfx import RuptfxError
from ruptfx.bodies.meshes.lobatto import basis_of_order
from ruptfx.interfaces.sliding.coupling import Coupling
from ruptfx.interfaces.sliding.mortar import Mortar
from ruptfx.interfaces.sliding.surface import Surface

Floats = NDArray[np.float64]
every_order = pytest.mark.parametrize("orders", [(1, 1), (2, 1), (1, 4), (4, 2), (4, 4), (8, 8)])


def chain(ends: Floats, order: int, height: Callable[[Floats], Floats] = np.zeros_like) -> Surface:
    part = 0.5 * (basis_of_order(order).points[:-1] + 1)
    x = np.append((ends[:-1, None] + np.diff(ends)[:, None] * part).ravel(), ends[-1])
    return Surface(np.arange(len(x)), np.stack([x, height(x)], axis=1), order)


def uneven(seed: int, facets: int) -> Floats:
    return np.sort(np.concatenate([[0.0, 1.0], np.random.default_rng(seed).uniform(0.05, 0.95, facets - 1)]))


def dense(coupling: Coupling) -> Floats:
    """B as a matrix."""
    return coupling @ np.eye(coupling.nodes)


@every_order
@pytest.mark.parametrize("tilt", [0.0, 0.3])
def test_compiled_is_the_same_with_arrays(orders: tuple[int, int], tilt: float) -> None:
    """On wavy surfaces that open and turn, where one has slid off the other; the reference is NumPy."""
    rng = np.random.default_rng(5)
    plus = chain(uneven(6, 40), orders[0], lambda x: 0.01 * np.cos(9 * x))
    minus = chain(0.9 * uneven(7, 31), orders[1], lambda x: -0.01 * np.cos(9 * x) - 0.02)
    turn = np.array([[np.cos(tilt), np.sin(tilt)], [-np.sin(tilt), np.cos(tilt)]])
    places = [(x.points + 1e-3 * rng.normal(size=2) * np.sin(3 * x.points)) @ turn for x in (plus, minus)]
    found, expected = (kind(plus, minus).find(*places) for kind in (Mortar, MortarReference))
    assert 0.5 < expected.covered.mean() < 1
    np.testing.assert_array_equal(found.covered, expected.covered)
    np.testing.assert_allclose(dense(found.coupling), dense(expected.coupling), atol=1e-12)
    np.testing.assert_allclose(found.weight, expected.weight, atol=1e-14)  # of a length of 1
    np.testing.assert_allclose(found.normal, expected.normal, atol=1e-12)


@pytest.mark.parametrize("folded, near", [("plus", "0.46"), ("minus", "0.3")])
def test_a_folded_facet_is_an_error(folded: str, near: str) -> None:
    """A node of one facet lies 0.2 before the others: coordinates along it do not grow, Newton's method has no end."""
    plus, minus = chain(np.linspace(0, 1, 6), 4), chain(np.linspace(0, 1, 8), 4)
    places = {"plus": plus.points.copy(), "minus": minus.points.copy()}
    Mortar(plus, minus).find(**places)
    places[folded][9, 0] -= 0.2
    # Mean of the nodes of the third facet of the plus side, 0.5 - 0.2 / 5, or of the second one, which faces the other.
    with pytest.raises(RuptfxError, match=facts(rf"faces at \({near}, 0\) m was not found")):
        Mortar(plus, minus).find(**places)


def test_a_node_above_a_facing_vertex_counts_once() -> None:
    """Facets of 0.2 above ones of 0.05 that end at 0.75: the fourth is partly faced, its middle node is above a vertex.

    Weights of a partly faced facet are those of its nodes: half of its length, 0.1, times Gauss-Lobatto weights.
    """
    plus, minus = chain(np.linspace(0, 1, 6), 4), chain(np.linspace(0, 0.75, 16), 4)
    found = Mortar(plus, minus).find(plus.points, minus.points)
    # Of order 4: weights 1/10, 49/90, 32/45, 49/90, 1/10 at 0.6, 0.6345, 0.7, 0.7655, 0.8; 0.75 cuts off the last two.
    lumped = 0.1 * np.array([1 / 10, 49 / 90, 32 / 45])
    shared = lumped + np.array([0.1 / 10, 0, 0])  # with the third facet
    np.testing.assert_allclose(found.weight[12:15], shared, rtol=1e-12)
    assert found.weight[found.covered].sum() == pytest.approx(0.6 + lumped.sum(), rel=1e-12)


@every_order
def test_identities_on_a_straight_line(orders: tuple[int, int]) -> None:
    """Constants and polynomials of the lower order pass exactly; a constant traction is the consistent load of both."""
    plus, minus = chain(uneven(1, 6), orders[0]), chain(uneven(2, 7), orders[1])
    found = Mortar(plus, minus).find(plus.points, minus.points)
    assert found.covered.all()
    x, y = plus.points[:, 0], minus.points[:, 0]
    for degree in range(min(orders) + 1):
        np.testing.assert_allclose(found.coupling @ y**degree, x**degree, atol=1e-13)
    # int N_j ds is the GLL weight of the node, half the length of its facets times their weights.
    for side, load in ((plus, found.weight), (minus, dense(found.coupling).T @ found.weight)):
        expected = np.zeros(len(side.nodes))
        sizes = np.diff(side.points[:: side.order, 0])
        np.add.at(expected, side.numbers, 0.5 * sizes[:, None] * side.basis.weights)
        np.testing.assert_allclose(load, expected, atol=1e-13)
    np.testing.assert_allclose(found.normal, np.tile([0.0, 1.0], (len(x), 1)), atol=1e-13)


@pytest.mark.parametrize("order", [1, 2, 4, 8])
def test_matching_nodes_face_each_other(order: int) -> None:
    wavy = chain(uneven(3, 5), order, lambda x: 0.02 * np.cos(5 * x))
    found = Mortar(wavy, wavy).find(wavy.points, wavy.points)
    np.testing.assert_allclose(dense(found.coupling), np.eye(len(wavy.nodes)), atol=1e-12)


def test_a_frozen_operator_is_the_gradient_of_the_gap() -> None:
    """|g(u + d) - g(u) - n J d| falls with the square of d, sliding included; plus-side normals give a first order.

    A closed wavy pair: the facing side of order 4 on facets a third smaller, so that the gap is that of interpolation.
    """

    def height(x: Floats) -> Floats:
        return 0.02 * np.cos(2 * np.pi * x)

    plus, minus = chain(np.linspace(0, 1, 7), 4, height), chain(np.linspace(-0.1, 1.1, 11), 4, height)
    mortar = Mortar(plus, minus)

    def gap(u: Floats, v: Floats) -> tuple[Floats, Floats, Floats]:
        found = mortar.find(plus.points + u, minus.points + v)
        normal = found.normal
        jump = np.sum(normal * (plus.points + u - found.coupling @ (minus.points + v)), axis=1)
        return jump, normal, dense(found.coupling)

    closed, normal, coupling = gap(np.zeros_like(plus.points), np.zeros_like(minus.points))
    left = []
    for size in np.array([2e-2, 1e-2, 5e-3, 2.5e-3]) * plus.spacing:
        x, y = plus.points[:, :1], minus.points[:, :1]
        u = size * np.hstack([1 + 0.3 * np.sin(3 * x), 0.5 * np.cos(2 * x)])
        v = size * np.hstack([0.2 * np.sin(5 * y), 0.3 * np.cos(4 * y)])
        linear = np.sum(normal * (u - coupling @ v), axis=1)
        left.append(np.abs(gap(u, v)[0] - closed - linear).max())
    assert np.all(np.divide(left[:-1], left[1:]) > 3.8), left


def test_an_end_that_slides_off() -> None:
    """Facets that reach over the end are taken node by node: weights stay positive and sum up to what is covered."""
    plus, minus = chain(np.linspace(0, 1, 6), 4), chain(np.linspace(-1, 0.73, 9), 2)
    found = Mortar(plus, minus).find(plus.points, minus.points)
    assert np.all(found.covered == (plus.points[:, 0] <= 0.73)) and found.weight.min() > 0
    spacing = np.diff(plus.points[:, 0]).max()
    assert abs(found.weight[found.covered].sum() - 0.73) < spacing
    sums = found.coupling.values.sum(axis=1)
    np.testing.assert_allclose(sums, found.covered.astype(float), atol=1e-14)
    # What is covered reproduces the place.
    np.testing.assert_allclose((found.coupling @ minus.points)[found.covered], plus.points[found.covered], atol=1e-13)


def test_ends_one_above_the_other() -> None:
    """Bodies that end at one wall, apart and tilted: what is normal to a facet there passes by the end of the other."""
    plus = chain(np.linspace(0, 1, 6), 4, lambda x: 2e-3 + 1e-2 * x)
    minus = chain(np.linspace(0, 1, 9), 2, lambda x: 1e-2 * x)
    found = Mortar(plus, minus).find(plus.points, minus.points)
    assert found.covered.all()
    # As if both went on: the constant gap of 2e-3 along y, seen along the normal (-1e-2, 1) / |..|.
    normal = found.normal
    gap = np.sum(normal * (plus.points - found.coupling @ minus.points), axis=1)
    np.testing.assert_allclose(gap, 2e-3 / np.hypot(1, 1e-2), rtol=1e-10)


def test_bodies_apart_face_nothing() -> None:
    plus, minus = chain(np.linspace(0, 1, 6), 2, lambda x: 5 + 0 * x), chain(np.linspace(0, 1, 9), 2)
    found = Mortar(plus, minus).find(plus.points, minus.points)
    assert not found.covered.any() and not np.any(found.coupling.values)
    # They keep the length and the tangent of their own side.
    np.testing.assert_allclose([found.weight.sum(), found.normal[:, 1].min()], 1.0)


def test_a_surface_that_folds_back() -> None:
    plus = chain(np.linspace(0, 1, 6), 1)
    with pytest.raises(
        RuptfxError, match=facts(r"faces two parts of the other surface at \(0\.[3-7].* must not fold back")
    ):
        folded = np.array([[-0.1, 0.0], [0.6, 0.0], [0.62, -0.1], [0.3, -0.1], [0.3, -0.2], [1.1, -0.2]])
        Mortar(plus, Surface(np.arange(6), folded, 1)).find(plus.points, folded)
