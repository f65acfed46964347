"""Positions along an interface: x where it lies along x, else an arc length from an origin; points; old cases."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers.small_cases import HOMALITE, SPLIT, merged, plates, tilted, two_boxes, wavy_plates

pytest.importorskip("dolfinx")

from helpers.messages import facts, says

from ruptfx import RuptfxError, simulate
from ruptfx.app.checks.preflight import preflight
from ruptfx.bodies.meshes.two_plates import TwoPlates
from ruptfx.bodies.space.bodies import distribute
from ruptfx.bodies.space.nodes import Nodes
from ruptfx.case import parse_case
from ruptfx.input.schema import CaseError
from ruptfx.interfaces.faults.interface import Interface, build_interface
from ruptfx.interfaces.faults.nearest import nearest_on_line
from ruptfx.platform import fem
from ruptfx.results.plots._record import along
from ruptfx.run.model import Model
from ruptfx.stepping.steppers.quasi_static import slip_to_resolve

pytestmark = pytest.mark.fem

LEFT = -6e-3
BOX = {"kind": "boxcar", "inside": 1.5e6, "outside": 0.0, "center": 0.0, "half_width": 1e-3}


def rupture(changes: dict[str, Any]) -> dict[str, Any]:
    """A patch at x = 0 pushed over its strength, on plates from -6 to 6 mm."""
    return merged(plates(), {
        "mesh.left": LEFT, "mesh.element_size": 1e-3, "positions": "x", "faults.main.contact": SPLIT, "duration": 3e-6,
        "faults.main.friction": {"kind": "linear_slip_weakening", "mu_s": 0.6, "mu_d": 0.3, "D_c": 1e-6},
        "faults.main.initial_stress.shear": 2.4e6,
        "faults.main.nucleation": [{"kind": "overstress", "extra": BOX}], **changes,
    })  # fmt: skip


def face_of(source: Any, order: int = 2) -> Interface:
    bodies = distribute(fem.MPI.COMM_WORLD, source)
    return build_interface(Nodes(fem.lagrange(bodies.mesh, order, bodies.mesh.geometry.dim), bodies), "main")


def test_position_is_x_along_x() -> None:
    face = face_of(TwoPlates(length=12e-3, height=4e-3, element_size=1e-3, left=-2e-3))
    np.testing.assert_array_equal(face.position, face.points[:, 0])
    assert face.line.meaning == "x" and (face.line.first, face.line.last) == pytest.approx((-2e-3, 10e-3), rel=1e-12)


def test_position_is_x_on_a_plane_along_x() -> None:
    face = face_of(two_boxes())
    np.testing.assert_array_equal(face.position, face.points[:, 0])
    assert face.line.measure == "x" and face.line.origin.tolist() == [0, 0, 0]


def test_position_has_an_origin_elsewhere(tmp_path: Any) -> None:
    pytest.importorskip("gmsh")
    for angle in (0.6, np.pi):
        table = tilted(tmp_path, angle=angle)
        case = parse_case(merged(plates(), {"mesh": table, "order": 2}))
        line = Model(case).faults[0].interface.line
        # The line from (0, 0) to (10, 0) mm turned about (2, 1) mm. Upside down the normal points to -y, the tangent
        # (n_y, -n_x) to -x: the arc length begins at the right.
        turned = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        start = np.array([2e-3, 1e-3]) + turned @ np.array([-2e-3, -1e-3])
        assert line.measure == "arc length" and (line.first, line.last) == (0, pytest.approx(10e-3, rel=1e-9))
        np.testing.assert_allclose(line.origin, start, atol=1e-9)


def test_nearest_point_of_a_wavy_interface() -> None:
    face = face_of(wavy_plates())
    # Vertices at x = 0, 1, 2 ... mm on the sine of amplitude 0.4 mm and period 6 mm. Half-way between the first two,
    # 0.05 mm off across the line.
    a, b = np.array([0.0, 0.0]), np.array([1e-3, 4e-4 * np.sin(np.pi / 3)])
    across = np.array([-(b - a)[1], (b - a)[0]]) / np.linalg.norm(b - a)
    position, foot = nearest_on_line(face, fem.MPI.COMM_WORLD, 0.5 * (a + b) + 5e-5 * across)
    np.testing.assert_allclose(foot, 0.5 * (a + b), atol=1e-12)
    assert position == pytest.approx(0.5 * np.linalg.norm(b - a), rel=1e-9)
    with pytest.raises(
        RuptfxError,
        match=facts(
            r"\(0.006, 0.001\) m is .* m from the interface, at most 0.00012 m .* \(0\.00[0-9]+, [-0-9.e]+\) m"
        ),
    ):
        nearest_on_line(face, fem.MPI.COMM_WORLD, np.array([6e-3, 1e-3]))


def test_a_patch_is_where_its_x_says(tmp_path: Any) -> None:
    """The same rupture on plates that begin at x = 0, and from a point instead of a position."""

    def centered(name: str, center: Any, **changes: Any) -> Any:
        patch = {"kind": "overstress", "extra": {**BOX, "center": center}}
        table = rupture({"faults.main.nucleation": [patch], **changes})
        return simulate(parse_case(table), tmp_path / name, progress=False)

    record = centered("x", 0.0)
    other = centered("zero", 6e-3, positions=None, **{"mesh.left": 0.0})
    third = centered("point", {"x": 0.0, "y": 5e-5}, positions=None)
    x, slip = record.interface["position"].values, record.interface["slip"].values[-1]
    assert np.abs(slip[np.abs(x) < 0.9e-3]).min() > 1e-7 and slip.max() == pytest.approx(slip[np.abs(x).argmin()])
    np.testing.assert_array_equal(x, record.interface["x"].values)
    np.testing.assert_allclose(x + 6e-3, other.interface["position"].values, atol=1e-15)
    np.testing.assert_allclose(slip, other.interface["slip"].values[-1], rtol=1e-6, atol=1e-15)
    np.testing.assert_array_equal(slip, third.interface["slip"].values[-1])
    assert record.interface["position"].attrs["long_name"] == "position along the interface: x"
    assert record.interface.attrs["position_measure"] == "x" and record.interface.attrs["origin"].tolist() == [0, 0]
    assert record.interface.attrs["loaded_end"] == pytest.approx(LEFT) and along(record, 1e-3, "mm") == "x (mm)"


def test_axes_say_where_an_arc_length_begins() -> None:
    def label(*others: str, **attrs: Any) -> str:
        interfaces = {name: SimpleNamespace(attrs=attrs) for name in ("main", *others)}
        record = SimpleNamespace(interface=interfaces["main"], interface_name="main", interfaces=interfaces)
        return along(record, 1e-3, "mm")  # type: ignore[arg-type]

    origin = np.array([0.9e-3, -0.25e-3])
    assert label(position_measure="arc length", origin=origin) == "Arc length from (0.9, -0.25) (mm)"
    assert label() == "Position along the interface (mm)"  # of a run by version 0.1
    assert label("branch", position_measure="x") == "x on main (mm)"


@pytest.mark.parametrize(
    "changes, said",
    [
        ({}, "faults.main.nucleation.0.extra.center = 0 becomes -0.006"),
        ({"faults.main.nucleation": [], "stop_when": {"tip_beyond": 8e-3}},
         "stop_when.tip_beyond = 0.008 becomes 0.002"),
        ({"faults.main.nucleation": [], "faults.main.initial_stress.shear": {
            "kind": "table", "positions": [0.0, 6e-3, 12e-3], "values": [1e6, 2e6, 1e6], "extend": True}},
         "add -0.006 to every one of faults.main.initial_stress.shear.positions"),
        ({"faults.main.nucleation": [], "faults.main.friction.mu_d": {
            "kind": "random", "mean": 0.3, "standard_deviation": 0.01, "correlation_length": 1e-3, "seed": 1}},
         "faults.main.friction.mu_d is drawn by position and becomes another sample"),
        ({"faults.main.nucleation": [{"kind": "smooth_patch", "extra": 1e6, "center": 6e-3, "radius": 1e-3,
                                      "rise": 1e-6}]}, "faults.main.nucleation.0.center = 0.006 becomes 0"),
    ],
)  # fmt: skip
def test_positions_that_changed_their_meaning_are_refused(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(CaseError) as caught:
        Model(parse_case(rupture({"positions": None, **changes})))
    assert str(caught.value).endswith(said) and says('add the line positions = "x"', str(caught.value))
    Model(parse_case(rupture(changes)))  # said to be x
    Model(parse_case(rupture({"positions": None, "mesh.left": 0.0, **changes})))  # never changed
    Model(parse_case(rupture({"positions": None, "faults.main.nucleation": []})))  # gives none


def test_positions_cannot_be_x_off_x(tmp_path: Any) -> None:
    pytest.importorskip("gmsh")
    with pytest.raises(CaseError, match=facts(r"no interface is flat and along x.*main: arc length from \(")):
        Model(parse_case(merged(plates(), {"mesh": tilted(tmp_path), "order": 2, "positions": "x"})))


def test_points_far_from_the_interface_are_refused() -> None:
    far = {"kind": "friction_drop", "center": {"x": 1e-3, "y": 1e-3}, "half_width": 1e-3}
    with pytest.raises(CaseError, match=facts(r"faults.main.nucleation.0.center = \(0.001, 0.001\) m is 0.001 m from")):
        Model(parse_case(rupture({"faults.main.nucleation": [far]})))


def test_a_center_in_3d_is_a_position() -> None:
    def boxes(center: Any) -> Any:
        drop = {"kind": "friction_drop", "center": center, "half_width": 1e-3}
        table = plates({"plane": "solid", "order": 1, "faults.main.nucleation": [drop]})
        return parse_case(table).substituted({"mesh": two_boxes()})

    rows = {row.quantity: row for row in preflight(boxes(2e-3))}
    row = rows["faults.main: nucleation.0, friction_drop"]
    assert (row.text, row.note) == ("0.001 to 0.003", "a strip across the interface")
    with pytest.raises(CaseError, match=facts(r"nucleation.0.center: a point of a surface has x, y and z")):
        Model(boxes({"x": 2e-3, "y": 0.0}))


def test_lengths_do_not_depend_on_where_x_is_zero() -> None:
    """Without a length in the law: 2 % of the slip that relaxes a hundredth of 6 MPa over 12 mm, 0.01 L sigma / G."""
    for left in (LEFT, 0.0):
        model = Model(parse_case(plates({"mesh.left": left})))
        modulus = HOMALITE["young_modulus"] / 2.7  # 2 (1 + nu)
        assert slip_to_resolve(model, model.faults[0]) == pytest.approx(0.02 * 0.01 * 12e-3 * 6e6 / modulus, rel=1e-6)


def test_check_shows_patches_in_positions_and_coordinates(tmp_path: Any) -> None:
    drop = {"kind": "friction_drop", "center": {"x": 1e-3, "y": 0.0}, "half_width": 1e-3}
    off = {"kind": "friction_drop", "center": 20e-3, "half_width": 1e-3}
    rows = {row.quantity: row for row in preflight(parse_case(rupture({"faults.main.nucleation": [drop, off]})))}
    assert rows["faults.main: position"].text == "-0.006 to 0.006" and rows["faults.main: position"].note == "x"
    assert rows["faults.main: initial stress"].note == "shear 2.4e+06 Pa, at x = 0.001 m"  # of the nucleation
    patch, lost = (rows[f"faults.main: nucleation.{number}, friction_drop"] for number in (0, 1))
    assert (patch.text, patch.note) == ("0 to 0.002", "(0, 0) to (0.002, 0)")
    assert (lost.text, lost.note) == ("0.019 to 0.021", "beyond the end to beyond the end")

    pytest.importorskip("gmsh")
    # Along the line from (0, 0) at 0.6 rad about (2, 1) mm: 2 mm from its end.
    turned = plates({"mesh": tilted(tmp_path), "order": 2, "faults.main.nucleation": [{**drop, "center": 2e-3}]})
    rows = {row.quantity: row for row in preflight(parse_case(turned))}
    begin = np.array([2e-3 - 2e-3 * np.cos(0.6) + 1e-3 * np.sin(0.6), 1e-3 - 2e-3 * np.sin(0.6) - 1e-3 * np.cos(0.6)])
    ends = [begin + s * np.array([np.cos(0.6), np.sin(0.6)]) for s in (1e-3, 3e-3)]
    said = rows["faults.main: nucleation.0, friction_drop"].note
    assert said == " to ".join(f"({x:.6g}, {y:.6g})" for x, y in ends)
    assert rows["faults.main: position"].note == f"arc length from ({begin[0]:.6g}, {begin[1]:.6g}) m"
