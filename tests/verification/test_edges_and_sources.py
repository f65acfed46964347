"""What single boundaries do, against closed forms."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.small_cases import HOMALITE, SPLIT, advance, blocks, case, plates, tilted
from helpers.strike_cases import faulted

pytest.importorskip("dolfinx")

from helpers.messages import facts, facts_of

from ruptfx.bodies.boundaries.moment import Moment
from ruptfx.bodies.boundaries.moved import Moved
from ruptfx.bodies.spectrum import stable_time_step
from ruptfx.case import parse_case
from ruptfx.input.schema import CaseError
from ruptfx.run.model import Model
from ruptfx.stepping.steppers.leapfrog import what_limits

pytestmark = pytest.mark.fem

EDGES = [f"{body}.{side}" for body in ("upper", "lower") for side in ("left", "right")] + ["upper.top", "lower.bottom"]


# -- spring ------------------------------------------------------------------------------------------------------------

SOFT = {"kind": "spring", "edge": "lower.bottom", "normal": 1e9, "tangential": 1e9}


@pytest.mark.parametrize("plane", ["stress", "antiplane"])
def test_a_mass_on_a_spring(plane: str) -> None:
    """Plates of 8 mm in all on a soft foundation: omega^2 = k / (rho H), 1e4 rad/s, where waves take 4 us across."""
    spring = {**SOFT, "normal" if plane == "antiplane" else "tangential": 0.0}  # pushed across, it would rock
    hung = case({"plane": plane, "order": 2, "boundaries": [spring], "faults.main.contact": SPLIT})
    model = Model(hung)
    motion, state = hung.stepper.bind(model), model.initial_state()
    omega = np.sqrt(1e9 / (HOMALITE["density"] * 8e-3))
    up = slice(model.components - 1, None, model.components)
    state.velocity[up] = 1.0
    advance(motion, state, 0.5 * np.pi / omega)
    np.testing.assert_allclose(state.displacement[up], 1 / omega, rtol=5e-3)
    # What was kinetic is strain energy now: rho H L v^2 / 2.
    assert motion.energies(state)["strain"] == pytest.approx(0.5 * 1246 * 8e-3 * 12e-3, rel=1e-2)


@pytest.mark.parametrize(("normal", "tangential"), [(1e9, 0.0), (1e9, 2e9)])
def test_a_spring_on_an_edge_of_a_section_along_strike(normal: float, tangential: float) -> None:
    """The far edge of 8 m: its stiffness across is that along the normal, y, and along strike that along the edge."""
    spring = {"kind": "spring", "edge": "upper.top", "normal": normal, "tangential": tangential}
    section = Model(faulted({"boundaries": [spring]})).section
    stiffness = sum(support.stiffness.sum(axis=0) for support in section.loads.supports)
    np.testing.assert_allclose(stiffness, 8.0 * np.diag([tangential, normal, tangential]), atol=1e-3, rtol=1e-9)


# -- springs of bodies -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("plane", "factor"), [("antiplane", 1.0), ("strain", 1 - 0.35)])
def test_free_bodies_on_springs_of_a_width(plane: str, factor: float) -> None:
    """All points move alike: omega = pi c_s / W, times 1 - nu in plane strain."""
    width = 2.0
    table = {"plane": plane, "order": 2, "boundaries": [{"kind": "body_spring", "width": width}]}
    hung = case({**table, "faults.main.contact": SPLIT})
    model = Model(hung)
    motion, state = hung.stepper.bind(model), model.initial_state()
    (material,) = {id(each): each for each in model.materials}.values()
    first, shear = material.lame("strain")
    assert first / (first + shear) / 2 == pytest.approx(0.35, rel=1e-9)
    omega = np.pi * np.sqrt(shear / material.density) * factor / width
    state.velocity[:] = 1.0
    advance(motion, state, 0.5 * np.pi / omega)
    np.testing.assert_allclose(state.displacement, 1 / omega, rtol=1e-6)


def test_static_shear_of_a_width_decays_from_the_edge() -> None:
    """u'' = (pi / W)^2 u: a traction tau on the top moves it by tau W / (pi G) coth(pi H / W), H of both bodies."""
    width, tau = 8e-3, 1e6
    still = case({
        "plane": "antiplane", "order": 4, "duration": 1e-6, "stepper": {"kind": "quasi_static", "first_step": 1e-6},
        "boundaries": [{"kind": "body_spring", "width": width},
                       {"kind": "traction", "edge": "upper.top", "traction": [tau]}],
        "faults.main.contact": {"kind": "compliant", "C_n": 1e16, "C_s": 1e16},
    })  # fmt: skip
    model = Model(still)
    motion, state = still.stepper.bind(model), model.initial_state()
    motion.step(state)
    shear = model.materials[0].lame("strain")[1]
    top = np.isclose(model.coordinates[:, 1], 4e-3)
    expected = tau * width / (np.pi * shear) / np.tanh(np.pi * 8e-3 / width)
    np.testing.assert_allclose(state.displacement[top], expected, rtol=1e-5)


@pytest.mark.parametrize(("changes", "message"), [
    ({"plane": "stress"}, "boundaries.0.width: is for plane = 'strain' and 'antiplane'"),
    ({"plane": "strain", "boundaries.0.stiffness": 1e9}, "give one of them"),
    ({"plane": "strain", "boundaries.0.body": "uper"}, "no such body, did you mean 'upper'"),
])  # fmt: skip
def test_springs_of_bodies_that_cannot_be(changes: dict[str, Any], message: str) -> None:
    spring = {"kind": "body_spring", "width": 2.0}
    for key in [key for key in changes if key.startswith("boundaries.0.")]:
        spring[key.rpartition(".")[2]] = changes.pop(key)
    with pytest.raises(Exception, match=facts_of(message)):
        Model(case({**changes, "boundaries": [spring]}))


def test_a_spring_on_a_turned_edge(tmp_path: Path) -> None:
    """The bottom goes from (0, -3) to (10, -5) mm, turned by 0.6: along its normal all push back with k_n."""
    pytest.importorskip("gmsh")
    table = plates({"mesh": tilted(tmp_path, 0.6), "order": 2})
    model = Model(parse_case({**table, "boundaries": [{**SOFT, "tangential": 3e9}]}))
    length, turn = np.hypot(10e-3, 2e-3), 0.6 - np.arctan2(2, 10)
    along, normal = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
    for direction, k in ((normal, 1e9), (along, 3e9)):
        force = np.zeros(2 * model.nodes)
        model.loads.add_support_force(np.tile(direction, model.nodes), force)
        np.testing.assert_allclose(force.reshape(-1, 2).sum(axis=0), -k * length * direction, rtol=1e-9, atol=1e-3)


def test_a_stiff_spring_shortens_the_step() -> None:
    plain, stiff = (Model(case({"boundaries": given})) for given in ([], [{**SOFT, "normal": 1e16}]))
    assert stable_time_step(stiff) < 0.5 * stable_time_step(plain)
    assert what_limits(stiff, stable_time_step(stiff)) == "set by the elements and the elastic supports of boundaries"
    with pytest.raises(CaseError, match=facts(r"boundaries\.0\.normal = 1e\+09: plane = 'antiplane' moves in z only")):
        case({"plane": "antiplane", "boundaries": [SOFT]})


# -- moved -------------------------------------------------------------------------------------------------------------

MOVED = {"edge": "upper.left", "component": "x"}


@pytest.mark.parametrize("quantity", ["displacement", "velocity"])
def test_a_table_is_a_motion(quantity: str) -> None:
    """Velocity and acceleration are the derivatives; samples are met; nothing is beyond them in between."""
    times, values = [1e-6, 2e-6, 4e-6, 5e-6], [0.0, 1.0, 1.0, -2.0]
    moved = Moved(quantity=quantity, times=times, values=values, **MOVED)
    motion = moved.motion(np.zeros(0, dtype=int))
    given = getattr(motion, quantity)
    assert [given(time) for time in times] == pytest.approx(values, abs=1e-15)
    assert given(3e-6) == pytest.approx(1.0) and given(9e-6) == -2.0 and given(0.0) == 0.0
    step = 1e-12
    for time in (0.5e-6, 1.3e-6, 2.7e-6, 4.6e-6, 7e-6):
        for low, high in ((motion.displacement, motion.velocity), (motion.velocity, motion.acceleration)):
            slope = (low(time + step) - low(time - step)) / (2 * step)
            assert high(time) == pytest.approx(slope, rel=1e-5, abs=1e-3)
    # Steeper than between the last samples, 3 over 1 us.
    speeds = [abs(motion.velocity(time)) for time in np.linspace(0, 6e-6, 4001)]
    assert moved.largest_speed == pytest.approx(max(speeds), rel=1e-5)


def test_a_ramp_as_a_table_is_that_of_a_driven_edge() -> None:
    ramp = [{"kind": "driven", **MOVED, "velocity": 2.0, "ramp": 2e-6}]
    table = [{"kind": "moved", **MOVED, "quantity": "velocity", "times": [0.0, 2e-6], "values": [0.0, 2.0]}]
    ends = []
    for boundaries in (ramp, table):
        moved = case({"boundaries": boundaries})
        assert moved.impact_speed == 2.0 and moved.driven_edges == ["upper.left"]
        model = Model(moved)
        ends.append(advance(moved.stepper.bind(model), model.initial_state(), 4e-6).displacement)
    np.testing.assert_allclose(ends[1], ends[0], atol=1e-9 * np.abs(ends[0]).max())


def test_a_table_from_a_file(tmp_path: Path) -> None:
    (tmp_path / "motion.csv").write_text("time, u\n0, 0\n1e-6, 2e-9\n")
    given = {"kind": "moved", **MOVED, "quantity": "displacement", "file": "motion.csv"}
    read = parse_case(plates({"boundaries": [given]}), tmp_path)
    assert read.boundaries[0].times == [0, 1e-6] and read.boundaries[0].values == [0, 2e-9]
    assert read.boundaries[0].file is None
    for changes, message in (
        ({"times": [0.0, 1.0]}, "give either a file or times and values"),
        ({"file": None, "times": [0.0, 0.0], "values": [0.0, 1.0]}, "times = 0"),
        ({"file": None, "times": [0.0], "values": [0.0, 1.0]}, "times = 1, values = 2"),
        ({"file": "none.csv"}, r"none\.csv: cannot be read"),
    ):
        wrong = {key: value for key, value in (given | changes).items() if value is not None}
        with pytest.raises(CaseError, match=facts(message)):
            parse_case(plates({"boundaries": [wrong]}), tmp_path)


# -- incident_wave -----------------------------------------------------------------------------------------------------

WAVE = {"kind": "incident_wave", "velocity": 2.0, "history": {"kind": "ricker", "frequency": 4e5, "delay": 4e-6}}


@pytest.mark.parametrize("plane, wave, angle", [
    ("stress", "P", 0.0), ("stress", "P", 0.4), ("strain", "S", 0.4), ("strain", "S", -1.2), ("antiplane", "S", 0.7),
])  # fmt: skip
def test_a_plane_wave_passes(plane: str, wave: str, angle: float) -> None:
    """Through all edges of a homogeneous body, as if there were none: v = V p f(t - d . (x - x_0) / c)."""
    d = np.array([np.sin(angle), np.cos(angle)])
    entering = [{**WAVE, "edge": edge, "wave": wave, "direction": (3 * d).tolist()} for edge in EDGES]
    table = case({
        "plane": plane, "order": 4, "faults.main.contact": SPLIT, "boundaries": entering,
        "mesh.element_size": 1e-3, "stepper": {"kind": "leapfrog", "safety": 0.3},
    })  # fmt: skip
    model = Model(table)
    motion, state = table.stepper.bind(model), model.initial_state()
    advance(motion, state, 7e-6)
    speed = getattr(model.materials[0].wave_speeds(table.plane), "c_p" if wave == "P" else "c_s")
    p = {"P": d, "S": np.array([-d[1], d[0]])}[wave] if plane != "antiplane" else np.ones(1)
    along = model.coordinates @ d
    time = state.at_velocity()[0]
    exact = 2.0 * table.boundaries[0].history(time - (along - along.min()) / speed)[:, None] * p
    assert np.abs(exact).max() > 0.5
    assert np.abs(state.velocity.reshape(exact.shape) - exact).max() < 0.01 * 2.0


@pytest.mark.parametrize("changes, message", [
    ({"direction": [0.0, 0.0]}, r"boundaries\.0\.direction = \[0\.0, 0\.0\]: must not be zero"),
    ({"direction": [1.0, 0.0, 0.0]}, r"boundaries\.0\.direction: 2 components are needed \(xy\), 3 given"),
    ({"polarisation": [1.0, 0.0]}, r"polarisation: S waves in plane = 'solid' need it"),
])  # fmt: skip
def test_waves_that_cannot_be(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(CaseError, match=facts(message)):
        case({"boundaries": [{**WAVE, "edge": "upper.top", "wave": "S", "direction": [1.0, 1.0], **changes}]})


def test_an_edge_of_two_materials(tmp_path: Path) -> None:
    pytest.importorskip("gmsh")
    mesh = blocks(tmp_path, {"a": "1", "b": "2", "c": "3", "d": "4"}, {"main": "11, 21"},
                  {"main": {"plus": ["c", "d"], "minus": ["a", "b"]}})  # fmt: skip
    wave = {**WAVE, "edge": "top", "wave": "P", "direction": [0.0, -1.0]}
    table = plates({"mesh": mesh, "order": 2, "boundaries": [wave]})
    Model(parse_case(table))
    table["materials"] = {"default": HOMALITE, "d": {**HOMALITE, "young_modulus": 3e9}}
    with pytest.raises(CaseError, match=facts(r"boundaries\.0\.edge = 'top': a plane wave has one material, .* split")):
        Model(parse_case(table))


def test_antiplane_has_s_waves_only() -> None:
    wave = {**WAVE, "edge": "upper.top", "wave": "P", "direction": [0.0, -1.0]}
    with pytest.raises(CaseError, match=facts(r"wave = 'P': plane = 'antiplane' has S waves only")):
        case({"plane": "antiplane", "boundaries": [wave]})


# -- point_force, moment -----------------------------------------------------------------------------------------------

MESHES = ["two_plates", "graded", "tilted", "triangles"]


def point_model(mesh: str, folder: Path, boundary: dict[str, Any]) -> Model:
    """A model with a source; its elements are squares, rectangles, general quadrilaterals or triangles."""
    changes: dict[str, Any] = {"order": 4}
    if mesh == "graded":
        changes |= {"mesh.growth": 1.5, "mesh.element_size": 1e-3}
    if mesh in ("tilted", "triangles"):
        pytest.importorskip("gmsh")
        changes = {"mesh": tilted(folder, 0.3), "order": 3}
    if mesh == "triangles":
        file = Path(__file__).parents[1] / "data" / "two_bodies.geo"
        sides = {"main": {"plus": "upper", "minus": "lower"}}
        changes = {"mesh": {"kind": "gmsh_file", "file": str(file), "interfaces": sides}, "order": 1}
    return Model(case({**changes, "boundaries": [boundary]}))


@pytest.mark.parametrize("mesh", MESHES)
def test_point_sources_work_as_they_should(mesh: str, tmp_path: Path) -> None:
    """The work done on a displacement u is F . u(x) and M : grad u(x), exactly for what the elements hold: linear u."""
    point, gradient = np.array([4.3e-3, 1.7e-3]), np.array([[2.0, -1.0], [0.5, 3.0]])
    force = {"kind": "point_force", "point": point.tolist(), "force": [3.0, -2.0]}
    moment = {"kind": "moment", "point": point.tolist(), "moment": [2.0, -1.0, 4.0]}
    offset = np.array([1.0, 2.0])
    # M : grad u = 2 * 2 - 1 * 3 + 4 (-1 + 0.5)
    for source, work in ((force, np.dot([3.0, -2.0], offset + gradient @ point)), (moment, 4.0 - 3.0 - 2.0)):
        model = point_model(mesh, tmp_path, source)
        nodal = model.loads.force(0.0)
        u = offset + model.coordinates @ gradient.T
        assert nodal @ u.ravel() == pytest.approx(work, rel=1e-9)
        if source is moment:  # no net force, and no net torque
            x = model.coordinates - point
            pulls = nodal.reshape(-1, 2)
            size = np.abs(pulls).max()
            np.testing.assert_allclose(pulls.sum(axis=0), 0, atol=1e-12 * size)
            assert abs(np.sum(x[:, 0] * pulls[:, 1] - x[:, 1] * pulls[:, 0])) < 1e-9


def test_a_moment_is_exact_for_the_order_of_the_elements() -> None:
    """Of u_x = x^3 y, u_y = x y^3 in elements of order 4, also on a side that elements share."""
    for x, y in ((4.3e-3, 1.7e-3), (4e-3, 1.7e-3), (4e-3, 2e-3)):
        model = Model(case({"boundaries": [{"kind": "moment", "point": [x, y], "moment": [2.0, -1.0, 4.0]}]}))
        a, b = model.coordinates.T
        u = np.column_stack([a**3 * b, a * b**3]).ravel()
        expected = 2 * 3 * x**2 * y - 3 * x * y**2 + 4 * (x**3 + y**3)
        assert model.loads.force(0.0) @ u == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("components, tensor", [
    ("xyz", [[1.0, 4.0, 6.0], [4.0, 2.0, 5.0], [6.0, 5.0, 3.0]]), ("xy", [[1.0, 3.0], [3.0, 2.0]]), ("z", [[1.0, 2.0]]),
])  # fmt: skip
def test_the_order_of_the_entries_of_a_moment(components: str, tensor: list[list[float]]) -> None:
    """xx, yy, zz, xy, yz, xz; in 2D xx, yy, xy; in antiplane zx, zy."""
    entries = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0][: {"xyz": 6, "xy": 3, "z": 2}[components]]
    assert Moment(point=[0.0, 0.0, 0.0], moment=entries).tensor(components).tolist() == tensor


def test_antiplane_sources() -> None:
    """M_zj dw / dx_j of w = 3 x - 2 y."""
    source = {"kind": "moment", "point": [4.3e-3, 1.7e-3], "moment": [5.0, 1.0]}
    model = Model(case({"plane": "antiplane", "boundaries": [source]}))
    assert model.loads.force(0.0) @ (model.coordinates @ [3.0, -2.0]) == pytest.approx(13.0, rel=1e-9)
    with pytest.raises(CaseError, match=facts(r"boundaries\.0\.moment: 2 entries are needed \(zx, zy\)")):
        case({"plane": "antiplane", "boundaries": [{**source, "moment": [1.0, 2.0, 3.0]}]})


def test_places_of_sources() -> None:
    force = {"kind": "point_force", "point": [4e-3, 0.0], "force": [0.0, 1.0]}
    with pytest.raises(
        CaseError, match=facts(r"boundaries\.0\.point = \(0\.004, 0\) m: '.*' and '.*' meet there; say in")
    ):
        Model(case({"boundaries": [force]}))
    model = Model(case({"boundaries": [{**force, "body": "upper"}]}))
    nodal = model.loads.force(0.0).reshape(-1, 2)
    assert nodal[:, 1].sum() == pytest.approx(1.0)
    # It is a node, of which the lower plate has its own.
    loaded = np.abs(nodal[:, 1]) > 1e-12
    np.testing.assert_array_equal(model.layout.body[loaded], model.bodies.names.index("upper"))
    assert loaded.sum() == 1
    for changes, message in (
        ({"point": [4e-3, 5e-3]}, r"boundaries\.0\.point = \(0\.004, 0\.005\) m: .* y from -0\.004 to 0\.004 m"),
        ({"point": [4e-3, 2e-3], "body": "lower"}, r"is not inside of lower"),
        ({"body": "uper"}, r"boundaries\.0\.body = 'uper': no such body, did you mean 'upper'\?"),
    ):
        with pytest.raises(CaseError, match=facts(message)):
            Model(case({"boundaries": [{**force, **changes}]}))


# -- gravity -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("plane, acceleration", [("strain", [3e5, -4e5]), ("antiplane", [2e5])])
def test_what_is_free_falls(plane: str, acceleration: list[float]) -> None:
    """Every node by g t^2 / 2, which explicit steps take exactly."""
    falling = case({
        "plane": plane, "order": 3, "boundaries": [{"kind": "gravity", "acceleration": acceleration}],
    })  # fmt: skip
    model = Model(falling)
    motion, state = falling.stepper.bind(model), model.initial_state()
    advance(motion, state, 5e-6)
    wanted = np.tile(0.5 * np.array(acceleration) * state.time**2, model.nodes)
    np.testing.assert_allclose(state.displacement, wanted, rtol=1e-9)


@pytest.mark.parametrize("mu", [0.2, 0.7])
def test_a_block_on_an_incline(mu: float) -> None:
    """On a rigid base turned by 30 degrees: a = g (sin - mu cos), or nothing where mu is above tan(30) = 0.577."""
    g, angle = 1e5, np.pi / 6
    weight = {"kind": "gravity", "acceleration": [g * np.sin(angle), -g * np.cos(angle)], "ramp": 20e-6}
    block = case({
        "order": 2, "mesh": {"kind": "block_on_rigid", "length": 12e-3, "height": 4e-3, "element_size": 2e-3},
        "faults.main.contact": SPLIT, "faults.main.friction": {"kind": "coulomb", "mu_d": mu},
        "faults.main.initial_stress.normal": 0.0, "boundaries": [weight],
        "damping": {"kelvin_voigt": {"fraction": 0.2}},
    })  # fmt: skip
    model = Model(block)
    motion, state = block.stepper.bind(model), model.initial_state()
    speeds = []
    for _ in range(2):  # until 30 us, and 80 us more
        advance(motion, state, 30e-6 if not speeds else 80e-6)
        speeds.append(float(model.mass[::2] @ state.velocity[::2] / model.mass[::2].sum()))
    gained = (speeds[1] - speeds[0]) / 80e-6
    if mu < np.tan(angle):
        assert gained == pytest.approx(g * (np.sin(angle) - mu * np.cos(angle)), rel=5e-3)
    else:
        # At the upper end, where it would lift, points slip a little; what slides goes 200 um.
        slip = state.faults["main"]["slip"]
        assert slip.min() == 0 and slip.max() < 0.2e-6 and abs(gained) < 5e-3 * g


# -- driven, by a profile ----------------------------------------------------------------------------------------------


def test_an_edge_that_turns() -> None:
    """The top goes down by a linear profile of x, the left side to the right by one of y."""
    line = {"kind": "table", "positions": [0.0, 12e-3], "values": [1.0, -1.0]}
    side = {"kind": "table", "positions": [0.0, 4e-3], "values": [0.0, 2.0]}
    model = Model(case({"order": 2, "boundaries": [
        {"kind": "driven", "edge": "upper.top", "component": "y", "velocity": -3.0, "ramp": 2e-6, "profile": line},
        {"kind": "driven", "edge": "upper.left", "component": "x", "velocity": 5.0, "profile": side},
    ]}))  # fmt: skip
    x, y = model.coordinates.T
    top, left = np.isclose(y, 4e-3), np.isclose(x, 0) & (model.layout.body == model.bodies.names.index("upper"))
    velocity = np.zeros(2 * model.nodes)
    model.loads.drive(velocity, 1e-6)  # half of the ramp
    np.testing.assert_allclose(velocity[1::2][top], -1.5 * (1 - x[top] / 6e-3), atol=1e-12)
    np.testing.assert_allclose(velocity[::2][left], 5.0 * 2 * y[left] / 4e-3, atol=1e-12)
    moved = model.loads.moved(np.zeros_like(velocity), 0.0, 4e-6)
    # 3 m/s for 4 us less half of the ramp.
    np.testing.assert_allclose(moved[1::2][top], -9e-6 * (1 - x[top] / 6e-3), atol=1e-15)
    assert model.case.impact_speed == 5.0
    short = {**line, "positions": [0.0, 10e-3]}
    with pytest.raises(CaseError, match=facts(r"boundaries\.0\.profile: the table from 0 to 0\.01 m does not cover")):
        Model(case({"boundaries": [
            {"kind": "driven", "edge": "upper.top", "component": "y", "velocity": 1.0, "profile": short},
        ]}))  # fmt: skip
