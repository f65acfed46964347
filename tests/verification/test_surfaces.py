"""Three dimensions: sections extruded along z against the two-dimensional runs, patches and directions on surfaces."""

from __future__ import annotations

import copy
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w
from helpers.small_cases import COMPLIANT, HOMALITE, branched, march, slip_weakening, strike_slip
from scipy.spatial import cKDTree
from typer.testing import CliRunner

pytest.importorskip("dolfinx")

from helpers.messages import facts

from ruptfx import simulate
from ruptfx.app.cli import app
from ruptfx.case import parse_case
from ruptfx.input.schema import CaseError
from ruptfx.interfaces.faults.interface import local_frame
from ruptfx.readings.instruments.model_readings import ModelReadings
from ruptfx.run.model import Model

pytestmark = pytest.mark.fem

BODIES = ("upper", "lower")


def extruded(flat: dict[str, Any], layers: int, fixed: str) -> dict[str, Any]:
    """The solid above a plane case, with components of the motion fixed on both faces."""
    mesh = {"kind": "extruded", "section": flat["mesh"], "thickness": 3e-3, "layers": layers}
    bodies = ("plus", "minus", "wedge") if flat["mesh"]["kind"] == "branched_fault" else BODIES
    faces = [
        {"kind": "driven", "edge": f"{body}.{face}", "component": component, "velocity": 0.0}
        for body in bodies for face in ("front", "back") for component in fixed
    ]  # fmt: skip
    return {**copy.deepcopy(flat), "mesh": mesh, "plane": "solid", "boundaries": [*flat.get("boundaries", []), *faces]}


@pytest.mark.parametrize("plane, fixed, rake", [("strain", "z", 0.0), ("antiplane", "xy", 90.0)])
def test_an_extruded_section_moves_as_the_plane(plane: str, fixed: str, rake: float) -> None:
    """Modes II and III: slip, tractions and rupture times of a spontaneous rupture in the plane, to 1e-9.

    The second tangent of the surface is -z, and the positive antiplane slip is along +z.
    """
    flat = slip_weakening(
        {"plane": plane, "order": 3, "duration": 6e-6, "mesh.element_size": 2e-3, "stepper.time_step": 6e-8}
    )
    solid = extruded(flat, 2, fixed)
    solid["faults"]["main"]["initial_stress"]["rake"] = rake
    model_2, _, state_2 = march(parse_case(flat))
    model_3, _, state_3 = march(parse_case(solid))
    face_2, face_3 = model_2.faults[0].interface, model_3.faults[0].interface
    fields_2, fields_3 = state_2.faults["main"], state_3.faults["main"]
    column = np.searchsorted(face_2.position, face_3.position - 1e-9)
    np.testing.assert_allclose(face_2.position[column], face_3.position, atol=1e-12)
    slips, other = ("slip_1", "slip_2") if rake == 0 else ("slip_2", "slip_1")
    assert fields_2["slip"].max() > 5e-7 and np.isfinite(fields_2["rupture_time"]).sum() >= 9
    for of_2, of_3 in (
        ("slip", slips),
        ("slip_rate", slips.replace("slip", "slip_rate")),
        ("shear_traction", slips.replace("slip", "shear_traction")),
        ("rupture_time", "rupture_time"),
    ):
        scale = np.nanmax(np.abs(fields_2[of_2]))
        np.testing.assert_allclose(fields_3[of_3], fields_2[of_2][column], atol=1e-9 * scale, err_msg=of_3)
    assert np.abs(fields_3[other]).max() < 1e-12 * fields_2["slip"].max() + 1e-18
    for name in ("kinetic", "strain", "frictional_dissipation", "boundary_work"):
        wanted, found = (model.energies(state)[name] for model, state in ((model_2, state_2), (model_3, state_3)))
        np.testing.assert_allclose(found, 3e-3 * wanted, rtol=1e-9, err_msg=name)


@pytest.mark.parametrize("angle", [-35.0, 140.0, -150.0])
def test_an_extruded_branch_moves_as_the_plane(angle: float) -> None:
    """Both faults have the tangents, positions and motion of the section, also where a branch points backwards."""
    flat = branched({
        "order": 2, "duration": 4e-6, "mesh.angle": angle, "mesh.element_size": 2e-3, "mesh.growth": 1.3,
        "stepper.time_step": 2e-8,
    })  # fmt: skip
    flat["faults"]["main"]["initial_stress"]["shear"]["center"] = -2e-3
    solid = extruded(flat, 2, "z")
    (model_2, _, state_2), (model_3, _, state_3) = march(parse_case(flat)), march(parse_case(solid))
    assert state_2.faults["main"]["slip"].max() > 5e-7
    for one, other in zip(model_2.faults, model_3.faults, strict=True):
        distance, column = cKDTree(one.interface.points).query(other.interface.points[:, :2])
        assert distance.max() < 1e-12
        np.testing.assert_allclose(other.interface.position, one.interface.position[column], atol=1e-12)
        np.testing.assert_allclose(other.interface.across, 3e-3 - other.interface.points[:, 2], atol=1e-12)
        fields_2, fields_3 = state_2.faults[one.name], state_3.faults[other.name]
        for of_2, of_3 in (("slip", "slip_1"), ("shear_traction", "shear_traction_1"), ("normal_stress",) * 2):
            scale = np.abs(fields_2[of_2]).max()
            np.testing.assert_allclose(fields_3[of_3], fields_2[of_2][column], atol=1e-9 * scale, err_msg=of_3)


def test_frames_of_a_curved_surface_are_continuous() -> None:
    """A vertical surface that bends by 120 degrees around the mean normal, and one that dips from 20 to 80 degrees."""
    bend = np.deg2rad(np.linspace(-60, 60, 121))
    for turn in np.deg2rad(np.arange(0, 360, 15)):
        mean = np.array([np.cos(turn), np.sin(turn), 0.0])
        vertical = np.stack([np.cos(turn + bend), np.sin(turn + bend), 0 * bend], axis=1)
        dipping = np.deg2rad(50 + bend * 90 / np.pi)[:, None]
        listric = np.sin(dipping) * mean + np.cos(dipping) * [0.0, 0.0, 1.0]
        for normals in (vertical, listric):
            frame = local_frame(normals, normals.mean(axis=0) / np.linalg.norm(normals.mean(axis=0)))
            np.testing.assert_allclose(frame @ frame.transpose(0, 2, 1), np.broadcast_to(np.eye(3), frame.shape),
                                       atol=1e-12)  # fmt: skip
            assert np.all(np.linalg.det(frame) > 0)
            np.testing.assert_allclose(frame[:, 1, 2], 0, atol=1e-12)  # horizontal
            assert np.all(frame[:, 2, 2] < -0.3)  # down: sin(20 degrees) at least
            # A degree from point to point.
            assert np.abs(np.diff(frame, axis=0)).max() < 1.01 * np.deg2rad(1)


@pytest.mark.parametrize("dip, top", [(90.0, 0.0), (60.0, 0.0), (45.0, 2e-3)])
def test_positions_and_patches_of_a_dipping_fault(dip: float, top: float) -> None:
    """Positions are x and the distance down dip; a patch has its area, and its load acts along the rake."""
    changes = {"mesh.dip": dip, "mesh.fault_top": top, "faults.main.initial_stress.rake": 30.0}
    model = Model(parse_case(strike_slip(changes)))
    fault = model.faults[0]
    face = fault.interface
    angle = np.deg2rad(dip)
    normal, strike, down = face.frame[0]
    np.testing.assert_allclose(normal, [0, np.sin(angle), np.cos(angle)], atol=1e-12)
    np.testing.assert_allclose(strike, [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(down, [0, np.cos(angle), -np.sin(angle)], atol=1e-12)
    first = 0.0 if top == 0 else face.across.min()  # nodes of the rim of a buried fault are welded
    expected = (-face.points[:, 2] - top) / np.sin(angle)
    np.testing.assert_allclose(face.across - first, expected - expected.min(), atol=1e-12)
    np.testing.assert_array_equal(face.position, face.points[:, 0])
    shear = np.linalg.norm(fault.shear_traction_0, axis=1)
    np.testing.assert_allclose(face.weight @ (shear - 2.8e6), 0.9e6 * 6e-3 * 4e-3, rtol=1e-9 if top == 0 else 0.1)
    np.testing.assert_allclose(fault.shear_traction_0[:, 1] / fault.shear_traction_0[:, 0], np.tan(np.pi / 6))


def test_the_center_of_a_patch_is_a_point_of_the_surface() -> None:
    table = strike_slip()
    table["faults"]["main"]["initial_stress"]["shear"] = 2.8e6
    patch = {"kind": "smooth_patch", "extra": 1e6, "radius": 2e-3, "rise": 1e-6}
    table["faults"]["main"]["nucleation"] = [{**patch, "center": {"x": 1e-3, "y": 0.0, "z": -4e-3}}]
    fault = Model(parse_case(table)).faults[0]
    points, load = fault.interface.points, fault.load(2e-6)[:, 0]
    distance = np.hypot(points[:, 0] - 1e-3, points[:, 2] + 4e-3)
    assert load[distance < 1e-9] == pytest.approx(1e6) and np.all(load[distance > 2e-3] < 1e-3)
    assert np.all(load[distance < 1.5e-3] > 0.2e6)
    table["faults"]["main"]["nucleation"] = [{**patch, "center": {"x": 1e-3, "y": 2e-3, "z": -4e-3}}]
    with pytest.raises(CaseError, match=facts(r"center = .*is not on the interface, whose nearest node is")):
        Model(parse_case(table))


@pytest.mark.parametrize("kind", ["leapfrog", "generalized_alpha"])
@pytest.mark.parametrize("rake", [30.0, -150.0])
def test_nucleations_push_along_the_rake(kind: str, rake: float) -> None:
    """Slip of a cube follows the rake, as the initial stress does, and the work of the push is counted."""
    cube = {"kind": "two_plates", "length": 4e-3, "height": 4e-3, "element_size": 2e-3}
    weakening = {"kind": "linear_slip_weakening", "mu_s": 0.6, "mu_d": 0.5, "D_c": 1e-6}
    model = Model(parse_case({
        "plane": "solid", "order": 1, "duration": 1e-5, "stepper": {"kind": kind}, "materials": {"default": HOMALITE},
        "mesh": {"kind": "extruded", "section": cube, "thickness": 4e-3, "layers": 2},
        "faults": {"main": {
            "contact": COMPLIANT, "friction": weakening, "nucleation": [{"kind": "overstress", "extra": 4e5}],
            "initial_stress": {"normal": 6e6, "shear": 3.5e6, "rake": rake},
        }},
    }))  # fmt: skip
    motion, state = model.case.stepper.bind(model), model.initial_state()
    for _ in range(12):
        motion.step(state)
    slip = model.faults[0].components(state.faults["main"], "slip")
    angle = np.deg2rad(rake)
    assert (slip @ [np.cos(angle), np.sin(angle)]).min() > 1e-7
    np.testing.assert_allclose(slip @ [-np.sin(angle), np.cos(angle)], 0.0, atol=5e-3 * np.abs(slip).max())
    energy = motion.energies(state)
    work = energy.pop("boundary_work")
    assert work > 0 and abs(sum(energy.values()) - work) < (1e-10 if kind == "leapfrog" else 1e-3) * work


def test_a_rake_in_two_dimensions_is_refused() -> None:
    with pytest.raises(CaseError, match=facts("rake = 30: in 2D shear has one direction; leave it out")):
        Model(parse_case(slip_weakening({"faults.main.initial_stress.rake": 30.0})))


def test_a_surface_inside_of_along_dip_is_refused() -> None:
    patch = {"kind": "rectangle", "inside": 3e6, "outside": 2e6, "strike": [-3e-3, 3e-3], "dip": [1e-3, 5e-3]}
    table = strike_slip({"faults.main.initial_stress.shear": {"kind": "along_dip", "profile": patch}})
    with pytest.raises(CaseError) as refused:
        Model(parse_case(table))
    assert "rectangle" in str(refused.value) and "along_dip" in str(refused.value)


def test_a_receiver_at_the_welded_end_of_a_fault_is_refused() -> None:
    """The rim of the fault is at x = 6 mm, its last nodes that slip half an element before it."""
    table = strike_slip({"instruments": [
        {"kind": "fault_receiver", "name": "rim", "interval": 3e-7, "point": [5.8e-3, 0.0, -3e-3]},
    ]})  # fmt: skip
    model = Model(parse_case(table))
    with pytest.raises(CaseError, match=facts(r"nearest node, \(0\.0055, 0, -0\.003\) m")) as refused:
        model.case.instruments[0].channels(ModelReadings(model, lambda points: np.zeros((len(points), 6))), "here")
    assert "welded" in str(refused.value)


def test_the_nearest_node_of_the_message_is_accepted() -> None:
    """On a dipping fault its coordinates are no short numbers: with 6 digits it would be beside the plane."""
    point = [1.234e-3, 0.5e-3, -2.1e-3]
    for attempt in range(2):
        table = strike_slip({"mesh.dip": 57.3, "instruments": [
            {"kind": "fault_receiver", "name": "one", "interval": 3e-7, "point": point}]})  # fmt: skip
        model = Model(parse_case(table))
        readings = ModelReadings(model, lambda points: np.zeros((len(points), 6)))
        try:
            assert model.case.instruments[0].channels(readings, "here") and attempt == 1
        except CaseError as error:
            text = re.search(r"nearest node, \((.*)\) m", str(error))
            assert text and attempt == 0, error
            point = [float(number) for number in text[1].split(",")]


def test_a_symmetric_rupture_of_a_box_closes_its_budget() -> None:
    """Slip is symmetric in x, largest at the surface of all depths, and energy is conserved."""
    model, _, state = march(parse_case(strike_slip()))
    face, fields = model.faults[0].interface, state.faults["main"]
    grid = fields["slip_1"].reshape(len(np.unique(face.position)), -1)
    np.testing.assert_allclose(grid, grid[::-1], atol=1e-9 * grid.max())
    assert grid.max() > 1e-7
    energies = model.energies(state)
    work = energies.pop("boundary_work")
    assert abs(work - sum(energies.values())) < 1e-12 * work


@pytest.mark.parametrize("half", [False, True])
def test_edges_take_the_energy_that_a_rupture_radiates(tmp_path: Path, half: bool) -> None:
    """In a box with dashpots all around they took at the end what the records of the fault say that it radiated.

    Bodies relax slowly on dashpots: both differ by 1 % after 0.1 ms, 1e-3 after 0.2 ms, and 1e-5 after the 0.3 ms here.
    The energies of a half model are those of both halves.
    """
    changes = {
        "mesh.element_size": 2e-3, "mesh.distance": 4e-3, "duration": 3e-4, "output.figures": False,
        "faults.main.friction.D_c": 4e-7, "faults.main.initial_stress.shear.inside": 3.61e6,
        "faults.main.initial_stress.shear.strike": [-4e-3, 4e-3],
        "faults.main.initial_stress.shear.dip": [2e-3, 6e-3],
    }  # fmt: skip
    table = strike_slip(changes)
    bodies = ("plus",) if half else ("plus", "minus")
    table["boundaries"] = [{"kind": "absorbing", "edge": f"{body}.{edge}"}
                           for body in bodies for edge in ("left", "right", "bottom", "far")]  # fmt: skip
    if half:
        table["mesh"]["half"] = True
        table["boundaries"] += [{"kind": "driven", "edge": "plus.plane", "component": each, "velocity": 0.0}
                                for each in "xz"]  # fmt: skip
    record = simulate(parse_case(table), out=tmp_path / "run")
    energy = {name: float(record.energy[name][-1]) for name in ("damping", "kinetic", "frictional_dissipation")}
    assert energy["kinetic"] < 1e-4 * energy["damping"] < energy["frictional_dissipation"]
    assert record.summary["radiated_energy"] == pytest.approx(energy["damping"], rel=1e-4)
    assert 1e6 < record.summary["stress_drop"] < 1.81e6  # from 2.8 or 3.61 to at least 1.8 MPa


def test_moment_rates_of_a_run_that_is_extended(tmp_path: Path) -> None:
    """1.05 us with records every 0.3 us, made 2 us long: a row for every step, as those of a run of 2 us."""
    output = {"figures": False, "interface_interval": 0.3e-6}
    for name, duration in (("whole", 2e-6), ("longer", 1.05e-6)):
        case = tmp_path / f"{name}.toml"
        case.write_text(tomli_w.dumps(strike_slip({"duration": duration, "output": output})))
        assert CliRunner().invoke(app, ["run", str(case), "--out", str(tmp_path / name), "--quiet"]).exit_code == 0
    done = CliRunner().invoke(app, ["resume", str(tmp_path / "longer"), "--duration", "2 us", "--quiet"])
    assert done.exit_code == 0, done.output
    one, other = ((tmp_path / name / "moment_rate.csv").read_text() for name in ("whole", "longer"))
    assert one == other and len(one.splitlines()) == 2 + 21  # steps of 0.1 us, and the start


def test_nothing_ruptures_at_the_surface_before_the_waves_arrive() -> None:
    """Normal stress that grows down dip from zero, as in TPV10: rounding opens the edge at the surface from the start.

    P waves of the patch, 4 to 6 mm down dip, need 4 mm / c_p = 1.5 us; the edge ruptures when it slides as fast as the
    threshold, in the run of 4 us.
    """
    profile = {"kind": "table", "positions": [0.0, 8e-3], "values": [0.0, 12e6]}
    normal = {"kind": "along_dip", "profile": profile}
    share = {"kind": "rectangle", "inside": 0.62, "outside": 0.55, "strike": [-2e-3, 2e-3], "dip": [4e-3, 6e-3]}
    model, motion, state = march(parse_case(strike_slip({
        "mesh.dip": 60.0, "duration": 4e-6, "faults.main.initial_stress.normal": normal,
        "faults.main.initial_stress.shear": {"kind": "product", "value": normal, "factor": share},
        "faults.main.initial_stress.rake": 90.0,
    })))  # fmt: skip
    face, fields = model.faults[0].interface, state.faults["main"]
    surface = face.across < 1e-9
    assert surface.sum() > 20 and not model.faults[0].has_strength[surface].any()
    arrival, waves = fields["rupture_time"], model.wave_speeds().c_p
    distance = np.hypot(np.maximum(np.abs(face.position) - 2e-3, 0), np.maximum(4e-3 - face.across, 0))
    assert np.isfinite(arrival[surface]).mean() > 0.3
    assert np.nanmin((arrival - distance / waves)[surface]) > -2 * motion.dt, np.nanmin(arrival[surface])


@pytest.mark.parametrize("inside", ["alone", "sum", "product", "friction"])
@pytest.mark.parametrize("kind", ["rectangle", "ellipse"])
def test_a_patch_without_a_point_of_the_surface_is_refused(kind: str, inside: str) -> None:
    """Points of the fault: strike -6 to 6 mm, dip 0 to 7.5 mm; a patch on its edge still has points."""
    rectangle = {"kind": kind, "inside": 1.4e6, "outside": 1e6, "strike": [-3e-3, 3e-3], "dip": [9e-3, 12e-3]}

    def model(patch: dict[str, Any]) -> Model:
        around = {"sum": {"terms": [1.0, patch]}, "product": {"factor": 2.0, "value": patch}}
        profile = {"kind": inside, **around[inside]} if inside in around else patch
        table = strike_slip()
        if inside == "friction":
            table["faults"]["main"]["friction"]["D_c"] = {**profile, "inside": 1e-6, "outside": 2e-6}
        else:
            table["faults"]["main"]["initial_stress"]["shear"] = profile
        return Model(parse_case(table))

    key = {"alone": "shear", "sum": r"shear\.terms\.1", "product": r"shear\.value", "friction": "D_c"}[inside]
    for patch in (rectangle, {**rectangle, "strike": [20e-3, 30e-3]}, {**rectangle, "dip": [0.1e-3, 0.2e-3]}):
        with pytest.raises(CaseError, match=facts(rf"{key}: no point of the surface is in the {kind}.*dip from 0 to")):
            model(patch)
    model({**rectangle, "dip": [7.4e-3, 12e-3]})
    model({**rectangle, "dip": [9e-3, 12e-3], "rim": 4e-3})


def test_check_warns_of_patches_that_the_mesh_does_not_resolve() -> None:
    """Elements of 1 mm and order 2 have nodes every 0.5 mm.

    In one direction the weights are 1/3 mm at ends of elements and 2/3 mm in their middles. From -1.2 to 1.2 mm
    there are 5 nodes with 3 x 1/3 + 2 x 2/3 = 7/3 mm of 2.4 mm; from -3 to 3 mm the ends count half, exactly 6 mm.
    """
    from ruptfx.app.checks.preflight import preflight

    def row(strike: list[float], dip: list[float]) -> Any:
        shear = {"kind": "rectangle", "inside": 3.7e6, "outside": 2.8e6, "strike": strike, "dip": dip}
        rows = preflight(parse_case(strike_slip({"faults.main.initial_stress.shear": shear})))
        return next(row for row in rows if row.quantity == "faults.main: initial_stress.shear, rectangle")

    good = row([-3e-3, 3e-3], [1e-3, 5e-3])
    assert (good.value, good.verdict) == ("13 x 9 points", "ok") and "100 % of its area" in good.note
    assert "its points reach its edges" in good.note
    close = row([-1.2e-3, 1.2e-3], [1e-3, 5e-3])
    assert (close.value, close.verdict) == ("5 x 9 points", "ok") and f"{700 / 7.2:.3g} % of its area" in close.note
    assert "patch: strike -0.0012 m to 0.0012 m, dip 0.001 m to 0.005 m" in close.note
    assert "points: strike -0.001 m to 0.001 m, dip 0.001 m to 0.005 m" in close.note
    both = row([-1.2e-3, 1.2e-3], [1.8e-3, 4.2e-3])  # 7/3 mm of 2.4 mm in both directions
    assert both.verdict == "warning" and f"{(700 / 7.2) ** 2 / 100:.3g} % of its area" in both.note
    narrow = row([-0.25e-3, 0.25e-3], [1e-3, 5e-3])
    assert (narrow.value, narrow.verdict) == ("1 x 9 points", "warning") and "reduce mesh.element_size" in narrow.note


@pytest.mark.parametrize("down_dip", [False, True])
def test_check_counts_the_points_of_a_strip(down_dip: bool) -> None:
    """Nodes every 0.5 mm, with 1/3 mm at ends of elements and 2/3 mm in their middles.

    The edge of a boxcar belongs to it: 7 points from -1.5 to 1.5 mm stand for 11/3 mm, and from -3 to 3 mm for 19/3 mm.
    """
    from ruptfx.app.checks.preflight import preflight

    def row(width: float, kind: str = "boxcar") -> Any:
        shape = {"boxcar": {"half_width": width}, "gaussian": {"width": width}}[kind]
        bell, box = {"amplitude": 0.9e6, "background": 2.8e6}, {"inside": 3.7e6, "outside": 2.8e6}
        values = bell if kind == "gaussian" else box
        strip = {"kind": kind, **values, "center": 4e-3 if down_dip else 0.0, **shape}
        shear = {"kind": "along_dip", "profile": strip} if down_dip else strip
        rows = preflight(parse_case(strike_slip({"faults.main.initial_stress.shear": shear})))
        key = "initial_stress.shear.profile" if down_dip else "initial_stress.shear"
        return next(row for row in rows if row.quantity == f"faults.main: {key}, strip")

    direction = "down dip" if down_dip else "along strike"
    good = row(2.75e-3)
    assert (good.value, good.verdict) == ("11 points across", "ok") and direction in good.note
    assert f"{100 * (17 / 3) / 5.5:.3g} % of its area" in good.note
    middle = 4.0 if down_dip else 0.0
    for name, half in (("strip", 2.75), ("points", 2.5)):
        first, last = ((middle + sign * half) / 1e3 + 0.0 for sign in (-1, 1))
        assert f"{name} from {first:g} m to {last:g} m" in good.note
    wide = row(3e-3)
    assert (wide.value, wide.verdict) == ("13 points across", "warning")
    assert f"{100 * (19 / 3) / 6:.3g} % of its area" in wide.note and "use rectangle" in wide.note
    narrow = row(0.2e-3)
    assert (narrow.value, narrow.verdict) == ("1 points across", "warning")
    smooth = row(3e-3, "gaussian")  # has no edge
    assert (smooth.value, smooth.verdict) == ("13 points across", "ok") and "area" not in smooth.note


def test_a_strip_without_a_point_of_the_surface_is_refused() -> None:
    def refused(changes: dict[str, Any], *words: str) -> None:
        with pytest.raises(CaseError, match=facts(*words)):
            Model(parse_case(strike_slip(changes)))

    boxcar = {"kind": "boxcar", "inside": 3.7e6, "outside": 2.8e6, "half_width": 0.05e-3, "center": 4.2e-3}
    down = {"kind": "along_dip", "profile": boxcar}
    refused({"faults.main.initial_stress.shear": boxcar}, r"stress\.shear: no point .*boxcar.*along strike")
    refused({"faults.main.initial_stress.shear": down}, r"shear\.profile: no point.*0.00415 to 0.00425 m down dip")
    drop = {"kind": "friction_drop", "center": 20e-3, "half_width": 1e-3}
    refused({"faults.main.nucleation": [drop]}, r"nucleation\.0: no point .*friction_drop from 0.019 to 0.021 m")


def test_check_warns_of_a_profile_whose_strip_is_beyond_the_surface() -> None:
    """It has its outer value; several interfaces may have the same profile."""
    from ruptfx.app.checks.preflight import preflight

    boxcar = {"kind": "boxcar", "inside": 3.7e6, "outside": 2.8e6, "half_width": 1e-3, "center": 20e-3}
    rows = preflight(parse_case(strike_slip({"faults.main.initial_stress.shear": boxcar})))
    row = next(row for row in rows if row.quantity.endswith("initial_stress.shear, strip"))
    assert (row.value, row.verdict) == ("0 points across", "warning") and "beyond the surface" in row.note


def test_the_area_of_a_patch_is_that_in_the_plane_of_a_rough_fault() -> None:
    """Slopes of 0.4 (RMS) add 8 % to the area of the surface; that in the plane follows from normals at nodes."""
    from ruptfx.app.checks.preflight import preflight

    wave = {"kind": "sinusoid", "mean": 0.0, "amplitude": 0.55e-3, "wavelength": 6e-3}
    shear = {"kind": "rectangle", "inside": 3.7e6, "outside": 2.8e6, "strike": [-3e-3, 3e-3], "dip": [1e-3, 5e-3]}
    case = parse_case(strike_slip({"faults.main.initial_stress.shear": shear, "mesh.height": wave}))
    face = Model(case).faults[0].interface
    assert face.area.sum() > 1.05 * 11e-3 * 7.5e-3  # without half a spacing at the rim
    row = next(row for row in preflight(case) if row.quantity.endswith("rectangle"))
    share = re.search(r"stand for ([\d.]+) % of its area", row.note)
    assert row.verdict == "ok" and share and abs(float(share[1]) - 100) <= 1, row


@pytest.mark.parametrize("rough", [False, True])
@pytest.mark.parametrize("dip, down", [(90.0, "(0, 0, -1)"), (60.0, "(0, 0.5, -0.866)")])
def test_check_prints_the_direction_of_positions_down_dip(dip: float, down: str, rough: bool) -> None:
    """(0, cos 60, -sin 60), also if the fault ends within a wave, so that the mean of its tangents is tilted."""
    from ruptfx.app.checks.preflight import preflight

    wave = {"kind": "sinusoid", "mean": 0.0, "amplitude": 0.5e-3, "wavelength": 6e-3}
    height = {"mesh.height": {"kind": "along_dip", "profile": wave}} if rough else {}
    case = parse_case(strike_slip({"mesh.dip": dip, **height}))
    row = next(row for row in preflight(case) if row.quantity == "faults.main: dip")
    assert f"down dip along {down}, from the upper edge" in row.note
    face = Model(case).faults[0].interface
    direction = [float(part) for part in down.strip("()").split(", ")]
    along = face.points @ direction
    np.testing.assert_allclose(face.across - along, face.across[0] - along[0], atol=2e-3 * np.ptp(face.across))
    if rough:
        mean = face.frame[:, 2].mean(axis=0)
        assert abs(mean[1] / np.linalg.norm(mean) - direction[1]) > 0.05


def test_check_counts_the_points_of_a_disc() -> None:
    """A nucleation around a point of the surface, on nodes every 0.5 mm."""
    from ruptfx.app.checks.preflight import preflight

    table = strike_slip({"faults.main.initial_stress.shear": 2.8e6})
    patch = {"kind": "smooth_patch", "extra": 1e6, "center": {"x": 0.0, "y": 0.0, "z": -4e-3}, "rise": 1e-6}
    for radius, points, verdict in ((3e-3, "13 x 13 points", "ok"), (0.4e-3, "1 x 1 points", "warning")):
        table["faults"]["main"]["nucleation"] = [{**patch, "radius": radius}]
        rows = {row.quantity: row for row in preflight(parse_case(table))}
        found = rows["faults.main: nucleation.0, disc"]
        assert (found.value, found.verdict) == (points, verdict), found


@pytest.mark.parametrize("kind, size, verdict", [
    ("smooth_patch", 3e-3, "ok"), ("smooth_patch", 0.75e-3, "warning"), ("gaussian", 0.6e-3, "ok"),
    ("taper", 1e-3, "ok"),
])  # fmt: skip
def test_check_judges_a_smooth_disc_by_its_integral(kind: str, size: float, verdict: str) -> None:
    """Nodes within 0.6 mm stand for 1 mm2 of a disc of 1.13 mm2, but those of a bell of this width for its integral.

    Weights along each direction are 1/3 mm at ends of elements, which are whole millimetres, and 2/3 mm between them.
    """
    from scipy.integrate import quad

    from ruptfx.app.checks.preflight import preflight

    def taper(r: float) -> float:
        if r <= size or r >= size + 2e-3:
            return float(r <= size)
        return float(0.5 * (1 + np.tanh(2e-3 / (r - size - 2e-3) + 2e-3 / (r - size))))

    shape = {
        "smooth_patch": lambda r: np.exp(r**2 / (r**2 - size**2)) if r < size else 0.0,
        "gaussian": lambda r: np.exp(-0.5 * (r / size) ** 2), "taper": taper,
    }[kind]  # fmt: skip
    center = {"x": 0.0, "y": 0.0, "z": -4e-3}
    key, changes = "initial_stress.shear", {
        "smooth_patch": {"faults.main.initial_stress.shear": 2.8e6, "faults.main.nucleation": [
            {"kind": "smooth_patch", "extra": 1e6, "center": center, "radius": size, "rise": 1e-6}]},
        "gaussian": {"faults.main.initial_stress.shear": {
            "kind": "gaussian", "background": 2.8e6, "amplitude": 0.5e6, "center": center, "width": size}},
        "taper": {"faults.main.initial_stress.shear": {
            "kind": "taper", "inside": 3.7e6, "outside": 2.8e6, "center": center, "half_width": size, "width": 2e-3}},
    }[kind]  # fmt: skip
    if kind == "smooth_patch":
        key = "nucleation.0"
    rows = {row.quantity: row for row in preflight(parse_case(strike_slip(changes)))}
    found = rows[f"faults.main: {key}, disc"]
    number = np.arange(-8, 9)
    weight = np.where(number % 2 == 0, 1e-3 / 3, 2e-3 / 3)
    at_nodes = np.array([[shape(0.5e-3 * np.hypot(i, j)) for i in number] for j in number])
    exact = 2 * np.pi * quad(lambda r: r * shape(r), 0, 4e-3, points=[size], limit=200)[0]
    share = re.search(r"sum to ([\d.]+) % of the integral", found.note)
    assert share is not None, found
    assert float(share[1]) == pytest.approx(100 * float(weight @ at_nodes @ weight) / exact, rel=5e-3)
    assert found.verdict == verdict and "edges of elements" not in found.note
