"""Every history of prescribed slip: from rest, its rate is the derivative of its slip, and steps follow it."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from helpers.messages import facts
from helpers.small_cases import COMPLIANT, HOMALITE

from ruptfx.case import Case, parse_case
from ruptfx.input.schema import CaseError, alternatives
from ruptfx.interfaces.slip_histories._subfaults import FiniteFault
from ruptfx.interfaces.slip_histories.fsp import Fsp
from ruptfx.interfaces.slip_histories.srf import Srf
from ruptfx.platform import fem
from ruptfx.run.model import Model

pytestmark = pytest.mark.fem

KINDS = alternatives("ruptfx.interfaces.slip_histories")
PLATES = {"kind": "two_plates", "length": 8e-3, "height": 4e-3, "element_size": 2e-3}
BLOCKS = {"kind": "extruded", "section": PLATES, "thickness": 4e-3, "layers": 2}
END = 5e-6


def table(mesh: dict[str, Any], slip: list[dict[str, Any]]) -> dict[str, Any]:
    """Two bodies whose whole interface has prescribed slip, without stress and friction."""
    return {
        "plane": "solid" if mesh["kind"] == "extruded" else "strain", "order": 2, "duration": 2e-6, "mesh": mesh,
        "materials": {"default": HOMALITE}, "output": {"figures": False},
        "faults": {"main": {"contact": {"kind": "split_node"}, "prescribed_slip": slip}},
    }  # fmt: skip


def example(kind: str, folder: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the example of a kind, with its files in a folder, and a mesh on which it fits."""
    for name, text in KINDS[kind].files_of_example.items():
        (folder / name).write_text(text)
    return tomllib.loads(f"example = {KINDS[kind].example}")["example"], BLOCKS if issubclass(
        KINDS[kind], FiniteFault
    ) else PLATES


def case_of(kind: str, folder: Path) -> Case:
    entry, mesh = example(kind, folder)
    case = parse_case(table(mesh, [entry]), folder)
    assert isinstance(case, Case)
    return case


@pytest.mark.parametrize("kind", KINDS)
def test_slip_is_the_integral_of_its_rate(kind: str, tmp_path: Path) -> None:
    model = Model(case_of(kind, tmp_path), fem.MPI.COMM_SELF)
    slip = model.faults[0].prescribed
    assert slip is not None and slip.held.all() and not slip.slip(0.0).any()
    times = np.linspace(0.0, END, 4001)
    slips, rates = (np.array([course(time) for time in times]) for course in (slip.slip, slip.rate))
    assert np.abs(slips[-1]).max() > 1e-8
    summed = np.concatenate([0 * slips[:1], np.cumsum(0.5 * (rates[1:] + rates[:-1]), axis=0)]) * times[1]
    np.testing.assert_allclose(summed, slips, rtol=0, atol=3e-5 * np.abs(slips).max())
    # A jump is at most the one that the history states; others change in 1 of 4000 parts of the time.
    assert np.abs(np.diff(rates, axis=0)).max() < 0.02 * np.abs(rates).max() + slip.jump.max()


@pytest.mark.parametrize("kind", KINDS)
def test_steps_follow_it(kind: str, tmp_path: Path) -> None:
    """Explicit steps of rigid contact: the jump of the bodies is the slip, and energies are balanced."""
    case = case_of(kind, tmp_path)
    model = Model(case, fem.MPI.COMM_SELF)
    motion, state = case.stepper.bind(model), model.initial_state()
    while state.time < case.duration:
        motion.step(state)
    fault = model.faults[0]
    assert fault.prescribed is not None
    wanted = fault.prescribed.slip(state.time)
    opening, jump = fault.interface.split(fault.interface.jump(state.displacement))
    assert np.abs(wanted).max() > 1e-8
    np.testing.assert_allclose(jump, wanted, rtol=0, atol=1e-13 * np.abs(wanted).max())
    np.testing.assert_allclose(opening, 0, atol=1e-13 * np.abs(wanted).max())
    energy = model.energies(state)
    assert energy.pop("boundary_work") == 0
    assert energy["prescribed_slip"] < 0 < energy["kinetic"]
    assert abs(sum(energy.values())) < 1e-12 * energy["kinetic"]


@pytest.mark.parametrize("kind", sorted(kind for kind in KINDS if KINDS[kind].files_of_example))
def test_a_cut_or_damaged_file_is_refused(kind: str, tmp_path: Path) -> None:
    """Any part of the file, and any byte changed, is read or refused with its name; never another error."""
    (name,) = KINDS[kind].files_of_example
    face = Model(case_of(kind, tmp_path), fem.MPI.COMM_SELF).faults[0].interface
    whole, width = (tmp_path / name).read_bytes(), 0.0 if face.across is None else float(face.across.max())
    rng, refused = np.random.default_rng(1), 0
    for trial in range(60):
        damaged = bytearray(whole[: rng.integers(1, len(whole))] if trial % 2 else whole)
        for _ in range(int(rng.integers(1, 4))):
            damaged[rng.integers(len(damaged))] = rng.choice(list(b"0x-. \n\x00\xff9e,%"))
        path = tmp_path / f"damaged_{trial}{Path(name).suffix}"
        path.write_bytes(bytes(damaged))
        history = KINDS[kind].model_validate({"file": str(path)})
        try:
            bound = history.bind(face, width)
            assert np.isfinite(bound.slip(1e-6)).all() and np.isfinite(bound.rate(1e-6)).all()
        except CaseError as error:
            assert str(path) in str(error)
            refused += 1
    assert refused > 20


def test_contact_with_springs_slips_as_prescribed(tmp_path: Path) -> None:
    """The elastic jump is the traction over the stiffness."""
    entry, mesh = example("yoffe", tmp_path)
    given = table(mesh, [entry])
    given["faults"]["main"]["contact"] = COMPLIANT
    case = Case.model_validate(given)
    model = Model(case, fem.MPI.COMM_SELF)
    motion, state = case.stepper.bind(model), model.initial_state()
    while state.time < case.duration:
        motion.step(state)
    fault, fields = model.faults[0], state.faults["main"]
    assert fault.prescribed is not None
    wanted, (time, displacement) = fault.prescribed.slip(state.fault_time), state.at_faults()
    np.testing.assert_allclose(fields["slip"], wanted[:, 0], rtol=1e-12)
    jump = fault.interface.jump(displacement)[:, 1]
    np.testing.assert_allclose(fields["shear_traction"], 100e9 * (jump - wanted[:, 0]), rtol=1e-9)
    assert time > 1e-6 and np.abs(fields["shear_traction"]).max() > 1e4


def test_delay_is_added_to_all_times(tmp_path: Path) -> None:
    """With a delay of 1 us slip at 2 us is that of 1 us without it, which is not that of 2 us."""
    entry, mesh = example("srf", tmp_path)
    early, late = (Model(made, fem.MPI.COMM_SELF).faults[0].prescribed for made in (
        parse_case(table(mesh, [{**entry, **more}]), tmp_path) for more in ({}, {"delay": 1e-7})
    ) if isinstance(made, Case))  # fmt: skip
    assert early is not None and late is not None
    for time in (0.5e-7, 2e-7, 4e-7):
        np.testing.assert_allclose(late.slip(time + 1e-7), early.slip(time), rtol=1e-9, atol=1e-16)
    assert np.abs(late.slip(2e-7) - early.slip(2e-7)).max() > 0.1 * np.abs(early.slip(2e-7)).max()


def test_planes_of_a_file_are_counted_from_zero(tmp_path: Path) -> None:
    """Two planes, of one and two subfaults: 2 and 3 m long, with rakes of 10, and of 20 and 30 degrees."""
    point = "-118 34 0 0 90 1 0.5 0.1\n{} 5 1 0 0 0 0\n50\n"  # 5 cm: one sample of 50 cm/s in 0.1 s
    (tmp_path / "two.srf").write_text(
        "1.0\nPLANE 2\n-118 34 1 1 0.002 0.001\n0 90 0 0 0\n-118 34 2 1 0.006 0.001\n0 90 0 0 0\nPOINTS 3\n"
        + "".join(point.format(rake) for rake in (10, 20, 30))
    )
    first, second = (Srf(file=str(tmp_path / "two.srf"), plane=plane).model() for plane in (0, 1))
    assert (first.length, second.length) == pytest.approx((2.0, 3.0))
    np.testing.assert_allclose(first.rake, [[10.0]])
    np.testing.assert_allclose(second.rake, [[20.0, 30.0]])
    np.testing.assert_allclose(second.course(np.array([0, 1]), np.array([0.05, 9.0]))[0][0], [0.00625, 0.05])
    with pytest.raises(ValueError, match=facts("two.srf: has 2 planes, and plane = 2")):
        Srf(file=str(tmp_path / "two.srf"), plane=2).model()


def test_rupture_speed_and_rise_time_stand_in_for_those_of_the_file(tmp_path: Path) -> None:
    """Subfaults of 2 km; the hypocentre is the middle of the first: the second begins 2 km / 2.5 km/s later."""
    rows = "".join(f" 34 -118 0 {y} 0 0.8 0 999 999\n" for y in (1, 3))
    (tmp_path / "unknown.fsp").write_text(
        "% Mech : STRK = 0 DIP = 90 RAKE = 0 Htop = 0 km\n% Rupt : HypX = 1 km HypZ = 1 km\n% Invs : Nx = 2 Nz = 1\n"
        "% Invs : Dx = 2 km Dz = 2 km\n% Nsg = 1\n%   LAT  LON  X==EW  Y==NS  Z  SLIP  RAKE  TRUP  RISE\n" + rows
    )
    file = str(tmp_path / "unknown.fsp")
    model = Fsp(file=file, rise_time=4.0, rupture_speed=2500.0).model()
    np.testing.assert_allclose(model.onset, [[0.0, 0.8]])
    # 0.2 m/s but for the first and the last 0.4 s, which lie half beyond the rise time: 0.4 m after 2.2 s.
    grown, rate = model.course(np.array([0, 1, 1]), np.array([2.2, 2.2, 4.5]))
    np.testing.assert_allclose(grown[0], [0.4, 0.4, 0.8], rtol=1e-9)
    np.testing.assert_allclose(rate[0], [0.2, 0.2, 0.0], rtol=1e-9)
    for entry, key in (({"rise_time": 4.0}, "rupture_speed"), ({"rupture_speed": 2500.0}, "rise_time")):
        with pytest.raises(ValueError, match=key):
            Fsp(file=file, **entry).model()
