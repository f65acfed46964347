"""Mortar pairing of surfaces: the identities of the dual mortar on two meshes of quadrilaterals, without bodies."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from helpers.messages import facts
from helpers.reference_mortar_surfaces import SurfaceMortarReference, dense
from numpy.typing import NDArray

from ruptfx import RuptfxError
from ruptfx.bodies.meshes.lobatto import nodes_between
from ruptfx.interfaces.sliding.mortar import Mortar
from ruptfx.interfaces.sliding.surface import Surface, corners_of, lattice_numbers, surface_of_facets

Floats = NDArray[np.float64]
every_order = pytest.mark.parametrize("order", [1, 2, 4])
unit = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def flat(x: Floats, y: Floats) -> Floats:
    return np.zeros_like(x + y)


def plate(
    x: Floats, y: Floats, order: int, height: Callable[[Floats, Floats], Floats] = flat, shape: Floats = unit
) -> Surface:
    """Return a lattice in the unit square, which is mapped to a quadrilateral, at a height."""
    s, t = (each.ravel() for each in np.meshgrid(nodes_between(x, order), nodes_between(y, order), indexing="ij"))
    corners = np.stack([(1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t], axis=1)
    across = corners @ shape
    points = np.column_stack([across, height(*across.T)])
    return Surface(np.arange(len(points)), points, order, lattice_numbers((len(x) - 1, len(y) - 1), order))


def even(facets: int) -> Floats:
    return np.linspace(0, 1, facets + 1)


def turned(angle: float) -> Floats:
    """Return the rotation about a skew axis."""
    axis = np.array([1.0, 2.0, 0.5]) / np.linalg.norm([1.0, 2.0, 0.5])
    cross = np.cross(np.eye(3), axis)
    matrix: Floats = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return matrix


def consistent_load(side: Surface) -> Floats:
    """Return int N dA of a lattice of squares, the products of Gauss-Lobatto weights."""
    area = np.linalg.norm(np.cross(*(np.diff(side.points[corners_of(side.numbers, side.order)][:, [0, 1, 3]], axis=1)
                                     .transpose(1, 0, 2))), axis=1)  # fmt: skip
    weights = np.outer(side.basis.weights, side.basis.weights).ravel() / 4
    return np.bincount(side.numbers.ravel(), np.outer(area, weights).ravel(), len(side.points))


@pytest.mark.parametrize("orders", [(1, 1), (2, 1), (1, 2), (2, 2)])
@pytest.mark.parametrize("tilt", [0.0, 0.5])
def test_compiled_is_the_same_with_arrays(orders: tuple[int, int], tilt: float) -> None:
    """On wavy surfaces of distorted elements that have slid off each other; the reference is NumPy without a tree."""
    rng = np.random.default_rng(3)
    skew = unit + 0.1 * rng.normal(size=(4, 2))
    plus = plate(even(4), even(3), orders[0], lambda x, y: 0.02 * np.cos(4 * x + y), skew)
    minus = plate(even(3), even(4), orders[1], lambda x, y: -0.02 * np.sin(3 * y - x) - 0.03, unit + 0.13)
    places = [(side.points + 2e-3 * np.sin(20 * side.points[:, ::-1])) @ turned(tilt).T for side in (plus, minus)]
    result, expected = (kind(plus, minus).find(*places) for kind in (Mortar, SurfaceMortarReference))
    assert 0.4 < expected.covered.mean() < 1
    np.testing.assert_array_equal(result.covered, expected.covered)
    np.testing.assert_allclose(dense(result.coupling), dense(expected.coupling), atol=1e-12)
    np.testing.assert_allclose(result.weight, expected.weight, atol=1e-14)
    np.testing.assert_allclose(result.normal, expected.normal, atol=1e-12)


@every_order
@pytest.mark.parametrize("facets", [(3, 2), (16, 11)])
@pytest.mark.parametrize("tilt", [0.0, np.pi / 6])
def test_identities_on_a_plane(order: int, facets: tuple[int, int], tilt: float) -> None:
    """Constants and linear fields pass, a constant traction is the consistent load of both sides, moments are equal."""
    own, other = (n if order < 4 else -(-n // 2) for n in facets)
    turn = turned(tilt)
    sides = [plate(even(n), even(n + 1), order) for n in (own, other)]
    plus, minus = (Surface(side.nodes, side.points @ turn.T, order, side.numbers) for side in sides)
    result = Mortar(plus, minus).find(plus.points, minus.points)
    assert result.covered.all()
    np.testing.assert_allclose(result.coupling.values.sum(axis=1), 1.0, atol=1e-13)
    np.testing.assert_allclose(result.coupling @ minus.points, plus.points, atol=1e-12)
    np.testing.assert_allclose(result.normal, np.tile(turn[:, 2], (len(plus.points), 1)), atol=1e-12)
    matrix = dense(result.coupling)
    np.testing.assert_allclose(result.weight, consistent_load(plus), atol=1e-14)
    np.testing.assert_allclose(matrix.T @ result.weight, consistent_load(minus), atol=1e-14)
    # Forces of any tractions are opposite, and so are their moments.
    force = result.weight[:, None] * np.random.default_rng(1).normal(size=(len(plus.points), 3))
    opposite = matrix.T @ force
    np.testing.assert_allclose(opposite.sum(axis=0), force.sum(axis=0), atol=1e-12 * np.abs(force).sum())
    moment, expected = (np.cross(side.points, each).sum(axis=0) for side, each in ((minus, opposite), (plus, force)))
    np.testing.assert_allclose(moment, expected, atol=1e-12 * np.abs(force).sum())


@every_order
def test_distorted_facets_of_a_plane_pass_linear_fields(order: int) -> None:
    """Trapezia on both sides, and a diamond on a rectangle: no side is parallel to another."""
    plus = plate(even(5), even(4), order, shape=np.array([[0.3, 0.3], [0.8, 0.2], [0.7, 0.75], [0.2, 0.6]]))
    minus = plate(even(4), even(3), order, shape=np.array([[0.0, 0.1], [1.0, -0.2], [1.3, 1.0], [-0.1, 0.9]]))
    result = Mortar(plus, minus).find(plus.points, minus.points)
    assert result.covered.all()
    np.testing.assert_allclose(result.coupling.values.sum(axis=1), 1.0, atol=1e-13)
    np.testing.assert_allclose(result.coupling @ minus.points, plus.points, atol=1e-12)
    # Area of the first quadrilateral by the cross product of its diagonals, (0.4, 0.45) and (-0.6, 0.4).
    np.testing.assert_allclose(result.weight.sum(), 0.5 * (0.4 * 0.4 + 0.45 * 0.6), rtol=1e-12)


@every_order
def test_matching_nodes_of_curved_surfaces_are_paired(order: int) -> None:
    wavy = plate(even(3), even(4), order, lambda x, y: 0.05 * np.cos(3 * x + 2 * y), unit + 0.1 * unit[::-1] ** 2)
    result = Mortar(wavy, wavy).find(wavy.points, wavy.points)
    np.testing.assert_allclose(dense(result.coupling), np.eye(len(wavy.points)), atol=1e-13)
    assert np.count_nonzero(result.coupling.values) == len(wavy.points)


@pytest.mark.parametrize(("orders", "height"), [
    ((1, 1), 0.05), ((2, 2), 0.0), ((4, 4), 0.0), ((1, 2), 0.0), ((4, 1), 0.0), ((2, 2), 5e-3),
])  # fmt: skip
def test_an_extruded_line_is_paired_as_in_a_plane(orders: tuple[int, int], height: float) -> None:
    """B is that of the chains times the identity where the lines along the extrusion coincide; also off the end."""
    along, across = np.array([0.0, 0.3, 0.55, 1.0]), {1: 5, 2: 3, 4: 2}

    def line(ends: Floats, order: int) -> Surface:
        x = nodes_between(ends, order)
        return Surface(np.arange(len(x)), np.column_stack([x, height * np.sin(4 * x)]), order)

    def extruded(ends: Floats, order: int, count: int) -> Surface:
        return plate(ends, along if orders[0] == orders[1] else even(count), order, lambda x, y: height * np.sin(4 * x))

    ends = even(7), np.array([-0.1, 0.22, 0.4, 0.61, 0.88])
    chains = [line(*each) for each in zip(ends, orders, strict=True)]
    surfaces = [extruded(x, order, across[max(orders)]) for x, order in zip(ends, orders, strict=True)]
    plane = Mortar(*chains).find(*(side.points for side in chains))
    space = Mortar(*surfaces).find(*(side.points for side in surfaces))
    many = [len(surface.points) // len(chain.points) for surface, chain in zip(surfaces, chains, strict=True)]
    assert 0.5 < plane.covered.mean() < 1
    np.testing.assert_array_equal(space.covered.reshape(-1, many[0]), np.tile(plane.covered[:, None], (1, many[0])))
    blocks = dense(space.coupling).reshape(len(chains[0].points), many[0], len(chains[1].points), many[1])
    if orders[0] == orders[1]:
        expected = np.einsum("ij,kl->ikjl", dense(plane.coupling), np.eye(many[0]))
        np.testing.assert_allclose(blocks, expected, atol=1e-12)
    np.testing.assert_allclose(blocks.sum(axis=3), np.tile(dense(plane.coupling)[:, None], (1, many[0], 1)), atol=1e-12)
    normal = space.normal.reshape(-1, many[0], 3)
    np.testing.assert_allclose(normal[..., [0, 2]], np.tile(plane.normal[:, None], (1, many[0], 1)), atol=1e-12)


@every_order
def test_an_edge_that_slides_off(order: int) -> None:
    """Facets that reach over an edge or a corner are paired node by node, each node once."""
    plus = plate(even(6), even(5), order)
    minus = plate(even(7), even(4), order, shape=np.array([[-0.5, -0.5], [0.73, -0.5], [0.73, 0.64], [-0.5, 0.64]]))
    result = Mortar(plus, minus).find(plus.points, minus.points)
    x, y, _ = plus.points.T
    # Facets of the minus side are 1.23 / 7 and 1.14 / 4 long; 0.02 of each counts as covered beyond the edges.
    inside = (x < 0.73 + 0.02 * 1.23 / 7) & (y < 0.64 + 0.02 * 1.14 / 4)
    np.testing.assert_array_equal(result.covered, inside)
    np.testing.assert_allclose(result.coupling.values.sum(axis=1), inside.astype(float), atol=1e-13)
    np.testing.assert_allclose((result.coupling @ minus.points)[inside], plus.points[inside], atol=1e-12)
    # The facets 4/6 < 0.73 and 3/5 < 0.64 are covered whole: inside of them weights are those of Lobatto points, and
    # on their rim the covered nodes of the next facets add their own weights.
    load = consistent_load(plus)
    whole = (x < 4 / 6 - 1e-9) & (y < 3 / 5 - 1e-9)
    np.testing.assert_allclose(result.weight[whole], load[whole], atol=1e-14)
    assert np.all(result.weight > 0) and np.all(result.weight <= load * (1 + 1e-12))


def test_a_node_above_an_edge_of_the_minus_side_counts_once() -> None:
    """Squares of 1/2 above ones of 1/4 that end at 3/4: the second row is covered in part, its nodes lie on edges."""
    plus, minus = plate(even(2), even(2), 2), plate(even(3), even(4), 2, shape=unit * [0.75, 1.0])
    result = Mortar(plus, minus).find(plus.points, minus.points)
    weight = result.weight.reshape(5, 5)[:, 2]  # at y = 1/2, a side of two facets
    # Lobatto weights of order 2 on a length of 1/2 are 1/12, 1/3, 1/12; across: 1/12 from both facets.
    np.testing.assert_allclose(weight, np.array([1 / 12, 1 / 3, 1 / 6, 1 / 3, 1 / 12]) / 6, rtol=1e-12)
    assert result.covered.reshape(5, 5)[:, 2].tolist() == [True, True, True, True, False]
    np.testing.assert_allclose((result.coupling @ minus.points)[:20], plus.points[:20], atol=1e-13)


@pytest.mark.parametrize("order", [1, 2])
def test_partners_on_a_warped_surface_converge_with_the_second_order(order: int) -> None:
    """The same curved surface with meshes 3 : 2: distance of the points and their partners, error of the normals."""

    def height(x: Floats, y: Floats) -> Floats:
        return 0.1 * np.cos(2 * x) * np.sin(1 + 2 * y)

    apart, tilted = [], []
    for refined in (2, 4, 8):
        plus, minus = (plate(even(n * refined), even(n * refined), order, height) for n in (3, 2))
        result = Mortar(plus, minus).find(plus.points, minus.points)
        assert result.covered.all()
        apart.append(np.linalg.norm(result.coupling @ minus.points - plus.points, axis=1).max())
        x, y, _ = plus.points.T
        slope = 0.2 * np.stack([-np.sin(2 * x) * np.sin(1 + 2 * y), np.cos(2 * x) * np.cos(1 + 2 * y)])
        normal = np.stack([-slope[0], -slope[1], np.ones_like(x)], axis=1)
        tilted.append(np.linalg.norm(result.normal - normal / np.linalg.norm(normal, axis=1)[:, None], axis=1).max())
    assert np.all(np.divide(apart[:-1], apart[1:]) > 3.4), apart
    assert np.all(np.divide(tilted[:-1], tilted[1:]) > 1.8 * order - 0.1), tilted


def test_a_frozen_operator_is_the_gradient_of_the_gap() -> None:
    """|g(u + d) - g(u) - n J d| falls with the square of d in sliding along a skew direction."""

    def height(x: Floats, y: Floats) -> Floats:
        return 0.02 * np.cos(2 * np.pi * x) * np.cos(np.pi * y)

    shape = np.array([[-0.2, -0.2], [1.2, -0.2], [1.2, 1.2], [-0.2, 1.2]])
    plus, minus = plate(even(6), even(6), 4, height), plate(even(12), even(12), 4, height, shape)
    mortar = Mortar(plus, minus)

    def gap(motion: Floats) -> tuple[Floats, Floats]:
        result = mortar.find(plus.points + motion, minus.points)
        return np.sum(result.normal * (plus.points + motion - result.coupling @ minus.points), axis=1), result.normal

    closed, normal = gap(np.zeros(3))
    remainder = []
    for size in np.array([2e-2, 1e-2, 5e-3]):
        motion = size * np.array([0.8, 0.6, 0.1])
        remainder.append(np.abs(gap(motion)[0] - closed - normal @ motion).max())
    assert np.all(np.divide(remainder[:-1], remainder[1:]) > 3.6), remainder


def test_bodies_apart_are_paired_with_nothing() -> None:
    """Farther apart than ten facets of 1/3; at the beginning, surfaces at any distance may face each other."""
    plus, minus = plate(even(4), even(4), 2), plate(even(3), even(3), 1)
    result = Mortar(plus, minus).find(plus.points + np.array([0, 0, 4.0]), minus.points)
    assert not result.covered.any() and not np.any(result.coupling.values)
    np.testing.assert_allclose(result.weight.sum(), 1.0)
    np.testing.assert_allclose(result.normal, np.tile([0.0, 0.0, 1.0], (81, 1)), atol=1e-14)
    assert Mortar(plus, minus).find(plus.points + np.array([0, 0, 3.0]), minus.points).covered.all()


def test_surfaces_that_do_not_face_each_other_are_refused() -> None:
    """Side by side, or turned away from each other."""
    plus, minus = plate(even(2), even(2), 1), plate(even(3), even(3), 1)
    beside = Surface(minus.nodes, minus.points + np.array([2.0, 0, 0]), 1, minus.numbers)
    turned_away = Surface(minus.nodes, minus.points, 1, minus.numbers[:, [0, 2, 1, 3]])
    for other, at in ((beside, r"2\.5, 0\.5, 0"), (turned_away, r"0\.5, 0\.5, 0")):
        with pytest.raises(RuptfxError, match=facts(rf"around \(0\.5, 0\.5, 0\) m, lies .* around \({at}\) m; move")):
            Mortar(plus, other)


@pytest.mark.parametrize(("folded", "place"), [("plus", r"0\.375, 0\.35, 0"), ("minus", r"0\.[2-5]")])
def test_a_folded_facet_is_an_error(folded: str, place: str) -> None:
    """A middle node of one facet lies beyond its neighbours."""
    plus, minus = plate(even(4), even(4), 2), plate(even(3), even(3), 2)
    places = {"plus": plus.points.copy(), "minus": minus.points.copy()}
    node = {"plus": 3 * 9 + 3, "minus": 3 * 7 + 3}[folded]
    places[folded][node, 1] -= 0.225
    with pytest.raises(RuptfxError, match=rf"\({place}"):
        Mortar(plus, minus).find(**places)


def test_a_surface_that_folds_back() -> None:
    """Three layers below one another, the middle one turned away: the plus side faces the first and the third."""
    x, z = np.array([-0.1, 0.6, 0.62, 0.3, 0.3, 1.1]), np.array([0.0, 0.0, -0.1, -0.1, -0.2, -0.2])
    points = np.array([[a, y, b] for a, b in zip(x, z, strict=True) for y in (-0.1, 1.1)])
    plus, folded = plate(even(5), even(5), 1), Surface(np.arange(12), points, 1, lattice_numbers((5, 1), 1))
    with pytest.raises(RuptfxError, match=facts(r"faces two parts of the other surface at \(0\.[3-7].* must not fold")):
        Mortar(plus, folded).find(plus.points, points)


@pytest.mark.parametrize(("along", "across"), [(1e-2, -5e-3), (-1e-2, 5e-3)])
def test_aligned_bodies_that_open_with_a_tilt_stay_covered(along: float, across: float) -> None:
    """Edges one above the other, apart and tilted: normals of the plus side pass by the edge of the other.

    Facets at the edges are integrated as without a tilt, whose weights differ by its square.
    """
    plus = plate(even(5), even(4), 2, lambda x, y: 2e-3 + along * x + across * y)
    minus = plate(even(4), even(3), 1, lambda x, y: along * x + across * y)
    result = Mortar(plus, minus).find(plus.points, minus.points)
    assert result.covered.all()
    gap = np.sum(result.normal * (plus.points - result.coupling @ minus.points), axis=1)
    np.testing.assert_allclose(gap, 2e-3 / np.sqrt(1 + 1e-4 + 25e-6), rtol=1e-10)
    level = [side.points * [1, 1, 0] for side in (plus, minus)]
    np.testing.assert_allclose(dense(result.coupling), dense(Mortar(plus, minus).find(*level).coupling), atol=1e-3)


def test_the_transpose_lists_points() -> None:
    plus, minus = plate(even(5), even(4), 2), plate(even(3), even(7), 1, shape=unit * 0.8)
    coupling = Mortar(plus, minus).find(plus.points, minus.points).coupling
    np.testing.assert_array_equal(dense(coupling.transposed()), dense(coupling).T)
    np.testing.assert_array_equal(dense(coupling.squared()), dense(coupling) ** 2)
    np.testing.assert_array_equal(coupling.nearest()[:9], np.argmax(dense(coupling), axis=1)[:9])
    assert coupling.values.shape[1] % 8 == 0 and coupling.columns.shape == coupling.values.shape


def box_facets(order: int, turn: list[int]) -> tuple[Floats, NDArray[np.int64], Floats]:
    """Return coordinates and facets of the top of a block, directions swapped, facets and nodes in another order."""
    side = plate(even(3), even(2), order, lambda x, y: 0.1 * x * y)
    lattice = side.numbers.reshape(-1, order + 1, order + 1)
    facets = np.array([lattice[f].T if k % 2 else lattice[f] for k, f in enumerate(turn)]).reshape(len(turn), -1)
    inside = side.points[facets].mean(axis=1) - [0, 0, 0.2]
    if turn[0]:
        return side.points[::-1], len(side.points) + 6 - facets, inside
    return side.points, facets + 7, inside


@every_order
@pytest.mark.parametrize("inward", [False, True])
def test_facets_in_any_order_and_direction_are_one_surface(order: int, inward: bool) -> None:
    results = []
    for turn in ([0, 1, 2, 3, 4, 5], [5, 2, 0, 3, 1, 4, 2, 2]):  # facets 2 are listed three times
        points, facets, inside = box_facets(order, turn)
        coordinates = np.concatenate([np.full((7, 3), np.nan), points])
        results.append(surface_of_facets(facets, coordinates, inside, order=order, inward=inward, name="a.minus"))
    for surface in results:
        assert surface.facets == 6 and sorted(surface.nodes) == list(range(7, 7 + len(points)))
        assert np.all(np.sign(surface.directions(surface.points)[..., 2]) == (-1 if inward else 1))
    np.testing.assert_array_equal(results[0].points, results[1].points)
    np.testing.assert_array_equal(np.sort(results[0].numbers, axis=1), np.sort(results[1].numbers, axis=1))
    # Sum of the weights: the area of z = x y / 10, int sqrt(1 + (x^2 + y^2) / 100) = 1 + (1/3 + 1/3) / 200 - 8e-6.
    assert results[1].measures.sum() == pytest.approx(1 + 1 / 300, abs=2e-5 if order > 1 else 5e-4)


def test_facets_that_are_no_surface_are_refused() -> None:
    """A cube, three facets on one side, and a body that changes sides."""
    cube = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
    faces = np.array([[0, 1, 2, 3], [4, 5, 6, 7], [0, 1, 4, 5], [2, 3, 6, 7], [0, 2, 4, 6], [1, 3, 5, 7]])
    inside = np.tile([0.5, 0.5, 0.5], (6, 1))

    def surface(chosen: list[int], inside: Floats, points: Floats = cube, of: NDArray[np.int64] = faces) -> Surface:
        return surface_of_facets(of[chosen], points, inside[chosen], order=1, inward=True, name="f.plus")

    assert surface([0, 2, 4], inside).facets == 3
    with pytest.raises(RuptfxError, match=facts(r"f\.plus: 6 facets")):
        surface([0, 1, 2, 3, 4, 5], inside)
    wrong = inside.copy()
    wrong[2] = [0.5, -1.0, 0.5]
    with pytest.raises(RuptfxError, match=facts(r"f\.plus: .*at \(0, 0, 0\.5\) m")):
        surface([0, 2], wrong)
    branch = np.concatenate([cube, [[-1.0, -1.0, 0.0], [-1.0, -1.0, 1.0]]])
    of = np.concatenate([faces, [[0, 1, 8, 9]]])
    with pytest.raises(RuptfxError, match=facts(r"f\.plus: .*at \(0, 0, 0\.5\) m")):
        surface([0, 2, 6], np.concatenate([inside, [[0.0, -1.0, 0.5]]]), branch, of)
