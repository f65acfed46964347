"""Inputs of SEM2DPACK as cases: runs compared with its own output and with exact solutions, and complete refusals.

The inputs are written for these tests from the description of its blocks; none is one of its examples.
"""

from __future__ import annotations

import csv
import os
import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.messages import facts, says
from typer.testing import CliRunner

from ruptfx.app.cli import app
from ruptfx.case import parse_case, read_case
from ruptfx.input.profiles import evaluate
from ruptfx.interfaces.faults.initial_stress import InitialStress

pytest.importorskip("f90nml")
from ruptfx.app.convert.sem2dpack import ConversionError, convert, convert_file, distributions
from ruptfx.app.convert.sem2dpack.blocks import Block, Input, read
from ruptfx.app.convert.sem2dpack.fault_line import FaultLine
from ruptfx.app.convert.sem2dpack.materials import _elastic

ROOT = Path(__file__).parents[2]
DEMO = ROOT / "demos" / "antiplane.toml"
PAGE = ROOT / "docs" / "peers.md"
SERIES = ROOT / "tests" / "data" / "sem2dpack_series.csv"
# demos/antiplane.toml in the words of SEM2DPACK: elements of 1 km, 5 nodes a side.
INPUT = """
# a comment, 'with' quotes & signs /
&GENERAL iexec=1, ngll=5, fmax=3.d0 , ndof=1 ,
  title = 'Antiplane / rupture', verbose='1111' , ItInfo = 400/
&MESH_DEF  method = 'CARTESIAN'/
&MESH_CART xlim=-15.d3,15.d3, zlim=0d0,12d3 , nelem=30,12, fztag=2/
&MATERIAL tag=1, kind='ELAST' /
&MATERIAL tag=2, kind='ELAST','KV'  /
&MAT_ELASTIC rho=2670.d0, cp=6000.d0, cs=3464.d0 /
&MAT_KV eta=0.2d0 /
&BC_DEF  tag = 1, kind = 'DYNFLT' /
&BC_DYNFLT friction='SWF', Tn=-120.d6,TtH='PWCONR' /   ! the shear stress follows
&DIST_PWCONR num=2, ref=0d0,0d0 / # radius, then inside and outside
     1.5d3
81.6d6 70.d6
&BC_DYNFLT_SWF Dc=0.4d0, MuS=0.677d0, MuD=0.525d0 /
&BC_DEF  tag = 2 , kind = 'ABSORB' /
&BC_DEF  tag = 3 , kind = 'ABSORB' /
&BC_DEF  tag = 4 , kind = 'ABSORB' /
&TIME  TotalTime=1.0d0, courant = 0.5d0, kind='newmark' /
&REC_LINE number = 2 , first = -10d3,0d3, last = 10d3,0d3, isamp=20, AtNode=F /
&SNAP_DEF itd=200, fields ='DVS',bin=T,ps=F /
"""
# A box without a fault: a column of two layers of one material, with a wave from below.
COLUMN = """
&GENERAL ngll=5, ndof=1, title='Column' /
&MESH_DEF method='LAYERED' /
&MESH_LAYERED xlim=0d0,100d0, zmin=-1000d0, nx=2, nlayer=2 /
&MESH_LAYER nz=8, ztopH='LINEAR' /
&DIST_LINEAR n=2 /
0d0 0d0
100d0 0d0
&MESH_LAYER nz=12, ztop=-400d0 /
&MATERIAL tag=1, kind='ELAST' /
&MAT_ELASTIC rho=2d3, cp=1.8d3, cs=1d3 /
&MATERIAL tag=2, kind='ELAST' /
&MAT_ELASTIC rho=2d3, cp=1.8d3, cs=1d3 /
&BC_DEF tag=1, kind='ABSORB' /
&BC_DEF tags=2,4, kind='PERIOD' /
&TIME TotalTime=2d0, dt=2d-3 /
&SRC_DEF stf='RICKER', mechanism='WAVE', coord=0d0,0d0 /
&STF_RICKER f0=2d0, onset=0.6d0, ampli=0.5d0 /
&SRC_WAVE angle=0d0, phase='S' /
&REC_LINE number=2, first=50d0,-1000d0, last=50d0,1d3, isamp=2 /
"""


def table(text: str = INPUT, **options: Any) -> dict[str, Any]:
    return tomllib.loads(convert(text, **options).text)


def converted(text: str = INPUT, **options: Any):
    return parse_case(table(text, **options))


def changed(old: str, new: str, text: str = INPUT) -> str:
    assert text.count(old) == 1, old
    return text.replace(old, new)


def test_namelists_are_those_of_fortran() -> None:
    found = read("&A x=1.5d3, 2*-.5 Y = T, z='a, b=/' ! c=1\n q=.false. /\n 1.0d0 2 # 9\n3\n&B T=3d0, L=1 /")
    assert [block.name for block in found] == ["A", "B"]
    assert found[0].values == {"x": [1500.0, -0.5, -0.5], "y": [True], "z": ["a, b=/"], "q": [False]}
    assert found[0].numbers == [1.0, 2.0, 3.0]
    assert found[1].values == {"t": [3.0], "l": [1.0]}


@pytest.mark.fem
def test_it_runs_as_the_case_written_by_hand(tmp_path: Path) -> None:
    pytest.importorskip("dolfinx")
    from ruptfx import simulate

    quiet = ["output.figures=false", "output.bulk_interval=1.0"]
    by_hand = read_case(DEMO, ['mesh.element_size="1 km"', 'duration="1 s"', *quiet])
    (tmp_path / "Par.toml").write_text(convert(INPUT).text)
    mine = read_case(tmp_path / "Par.toml", quiet)
    one = simulate(by_hand, tmp_path / "by_hand", progress=False)
    with one, simulate(mine, tmp_path / "mine", progress=False) as other:
        for name in ("slip", "slip_rate", "shear_traction", "normal_stress"):
            expected, found = one.interface[name].values, other.interface[name].values
            np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * np.abs(expected).max())
        assert float(one.interface["slip"].max()) > 0.1  # m: it ruptures


def test_a_fault_inside_of_the_box() -> None:
    """Plane strain, the fault in the middle at z = 0; h is along x, v across; every tag is an edge of both bodies."""
    text = changed("ndof=1", "ndof=2").replace("zlim=0d0,12d3 , nelem=30,12", "zlim=-6d3,6d3, nelem=30,12, ezflt=-1")
    text = text.replace("tag = 1, kind = 'DYNFLT'", "tags = 5,6, kind = 'DYNFLT'")
    top, below = "&BC_DEF tag=3, kind='DIRNEU'/\n&BC_DIRNEU h='N', v='D'/", "&BC_DEF tag=1, kind='ABSORB'/\n"
    text = text.replace("&BC_DEF  tag = 3 , kind = 'ABSORB' /", top)
    text = text.replace("&BC_DEF  tag = 4 , kind = 'ABSORB' /", f"{below}&BC_ABSORB stacey=T/")
    case = converted(text)
    assert case.plane == "strain" and case.mesh.kind() == "two_plates" and case.mesh.height == 6e3
    assert {(b.kind(), b.edge) for b in case.boundaries} == {
        ("absorbing", "upper.right"), ("absorbing", "lower.right"), ("driven", "upper.top"),
        ("absorbing", "lower.bottom"),
    }  # fmt: skip
    assert next(b.component for b in case.boundaries if b.kind() == "driven") == "y"
    assert says("absorbing edges are Lysmer's dashpots, also where stacey = T", "\n".join(convert(text).notes))


def test_two_materials_at_the_fault_are_two_bodies() -> None:
    text = changed("zlim=0d0,12d3 , nelem=30,12, fztag=2", "zlim=-6d3,6d3, nelem=30,12, ezflt=6").replace(
        "tag = 1, kind = 'DYNFLT'", "tags = 5,6, kind = 'DYNFLT'")  # fmt: skip
    text = text.replace("&MATERIAL tag=2, kind='ELAST','KV'  /\n", "").replace("&MAT_KV eta=0.2d0 /", (
        "&MATERIAL tag=2, kind='ELAST' /\n&MAT_ELASTIC rho=2500d0, cp=5d3, cs=3d3 /\n"
        "&MESH_CART_DOMAIN tag=1, ex=1,30, ez=1,6 /\n&MESH_CART_DOMAIN tag=2, ex=1,30, ez=7,12 /"
    ))  # fmt: skip
    case = converted(text)
    assert case.mesh.kind() == "two_plates" and set(case.materials) == {"upper", "lower"}
    assert case.materials["upper"].density == 2500 and case.materials["lower"].density == 2670
    # The border one row off the fault: three bodies, two of them above it.
    other = convert(text.replace("ez=1,6", "ez=1,7").replace("ez=7,12", "ez=8,12"))
    made = tomllib.loads(other.text)
    assert made["mesh"]["interfaces"]["main"] == {"minus": ["lower"], "plus": ["upper_1"]}
    assert set(made["materials"]) == {"lower", "upper_1", "upper_2"} and '"upper_2.right"' in (other.mesh or "")


def test_periodic_edges_go_across_welded_bodies() -> None:
    text = COLUMN.replace("&MATERIAL tag=2, kind='ELAST' /\n&MAT_ELASTIC rho=2d3", "&MATERIAL tag=2, kind='ELAST' /\n"
                          "&MAT_ELASTIC rho=3d3")  # fmt: skip
    found = convert(text)
    ties = [each for each in tomllib.loads(found.text)["boundaries"] if each["kind"] == "periodic"]
    assert ties == [{"kind": "periodic", "first": "body.left", "second": "body.right"}]
    names = re.findall(r'^1 \d+ "(.*)"$', found.mesh or "", re.M)
    assert set(names) == {"body_1.top", "body_2.bottom", "body.left", "body.right"}


def test_other_words() -> None:
    text = changed("TotalTime=1.0d0, courant = 0.5d0", "NbSteps=100, Dt=1d-3").replace("zlim=0d0,12d3", "zlim=1d3,13d3")
    text = text.replace("ref=0d0,0d0", "ref=2d3,1d3").replace("Tn=-120.d6", "Tn=-120.d6, cohesion=1d6")
    text = text.replace("&BC_DYNFLT_SWF Dc", "&BC_DYNFLT_SWF kind=2, Dc")
    text = text.replace("tag = 2 , kind = 'ABSORB'", "tags = 4,2 , kind = 'PERIOD'").replace(
        "&BC_DEF  tag = 4 , kind = 'ABSORB' /", ""
    )
    case = converted(text)
    fault = case.faults["main"]
    assert case.duration == pytest.approx(0.1) and case.stepper.time_step == 1e-3
    assert fault.initial_stress.shear.center == 2e3 and fault.initial_stress.normal == 120e6
    assert fault.friction.c == 1e6 and fault.friction.law.kind() == "exponential_slip_weakening"
    assert [boundary.kind() for boundary in case.boundaries] == ["periodic", "absorbing"]
    assert says("the fault at z = 1000 m is y = 0 here", "\n".join(convert(text).notes))
    # Two receivers at 0.5 times the smallest node distance over c_s, times 20.
    assert [each.point for each in case.instruments] == [[-1e4, 0.0], [1e4, 0.0]]
    assert case.instruments[0].interval == pytest.approx(20e-3)


LINE = FaultLine.of(np.array([[[0.0, -1.0], [2.0, -1.0]], [[2.0, -1.0], [4.0, -1.0]]]), np.array([0.0, 1.0]), 2)


@pytest.mark.parametrize(
    ("text", "expected"),
    [  # at x = 0, 1, 2, 3, 4 and z = -1
        ("&DIST_ORDER0 xn=3, zn=2 /\n1d0 2.5 \n 0.\n 5 6 7\n 8 9 10\n", [5, 6, 6, 7, 7]),
        ("&DIST_PWCONR num=3, ref=1d0,-1d0 /\n 0.5 1.0\n 7 8 9\n", [8, 7, 8, 9, 9]),
        # Within a circle of radius 1.5 around a point 1 m above the fault: |x - 2| <= sqrt(1.25).
        ("&DIST_PWCONR num=2, ref=2d0,0d0 /\n 1.5\n 7 8\n", [8, 7, 7, 7, 8]),
        # Of radius 1.3: |x - 2| <= sqrt(0.69).
        ("&DIST_PWCONR num=2, ref=2d0,0d0 /\n 1.3\n 7 8\n", [8, 8, 7, 8, 8]),
        ("&DIST_GAUSSIAN centered_at=1d0,-2d0, length=2d0,1d0, offset=1d0, ampli=2d0 /",
         1 + 2 * np.exp(-1 - ((np.arange(5) - 1) / 2) ** 2)),
        ("&DIST_GAUSSIAN centered_at=1d0,-1d0, length=2d0,1d0, order=2 /", np.exp(-(((np.arange(5) - 1) / 2) ** 4))),
        ("&DIST_LINEAR n=3 /\n0 1\n1 3\n3 3", [1, 3, 3, 3, 3]),
        ("&DIST_LINEAR n=2, dim=2 /\n-2 1\n0 3", [2, 2, 2, 2, 2]),
        ("&DIST_LINEAR file='line.tab' /", [0, 2, 4, 6, 8]),
        # Cubic of slope zero at 0 and 4: 3 s^2 - 2 s^3, s = x / 4.
        ("&DIST_SPLINE file='step.tab' /", [3 * s**2 - 2 * s**3 for s in np.arange(5) / 4]),
        # 2 per metre below the line z = 0 to x / 4: (x / 4 + 1) 2 + 10.
        ("&DIST_GRADIENT file='slope.tab', valref=10d0, grad=2d0 /", 12 + np.arange(5) / 2),
        ("&DIST_HETE1 file='grid.tab', col=2 /", [x + 10 for x in range(5)]),
    ],
)  # fmt: skip
def test_distributions_become_profiles(tmp_path: Path, text: str, expected: Any) -> None:
    (tmp_path / "line.tab").write_text("0 0\n1d0 2d0\n")
    (tmp_path / "step.tab").write_text("0 0\n4 1\n")
    (tmp_path / "slope.tab").write_text("0 0\n4 1\n")
    grid = [f"{-x} {x + 10 * (1 + z)}" for z in (-1, 0, 1) for x in (0, 2, 4)]
    (tmp_path / "grid.tab").write_text("2 3 3 0. -2. 2. 1.\n" + "\n".join(grid))
    given = Input(read(text), tmp_path)
    found = distributions.profile(distributions.field(given, given.blocks[0]), given.blocks[0], LINE)
    stress = InitialStress.model_validate({"normal": 1.0, "shear": found}).shear
    np.testing.assert_allclose(evaluate(stress, np.arange(5.0)), expected, rtol=1e-9, atol=1e-12)


def test_laws_of_friction() -> None:
    two = "friction='SWF','TWF'"
    front = "&BC_DYNFLT_TWF kind=1, MuS=0.677, MuD=0.525, Mu0=0.601, X=1d3, V=2d3, L=5d2, T=3d0 /\n&BC_DEF  tag = 2"
    fault = converted(changed("friction='SWF'", two).replace("&BC_DEF  tag = 2", front)).faults["main"]
    (forced,) = fault.nucleation
    # The front is (MuS - Mu0) / (MuS - MuD) L = 250 m ahead: it starts 0.125 s before, and ends as much earlier.
    assert (forced.kind(), forced.center, forced.speed) == ("forced_rupture", 1e3, 2e3)
    assert (forced.mu_d, forced.t_w) == (0.525, 0.25)
    assert forced.start == pytest.approx(-0.125) and forced.end == pytest.approx(2.875)
    alone = "&BC_DYNFLT_TWF MuS=0.7, MuD=0.5, Mu0=0.7, V=2d3, L=5d2 /"
    law = "&BC_DYNFLT_SWF Dc=0.4d0, MuS=0.677d0, MuD=0.525d0 /"
    time = converted(changed("friction='SWF'", "friction='TWF'").replace(law, alone)).faults["main"].friction
    assert time.kind() == "time_weakening" and time.arrival.slope == 5e-4 and time.t_w == 0.25
    kinds = {2: "rate_and_state_ageing", 3: "rate_and_state_slip", 4: "rate_and_state_saturating"}
    for kind, name in kinds.items():
        state = f"&BC_DYNFLT_RSF kind={kind}, Dc=1d-2, a=0.01, b=0.015, Vstar=1d-6, thetaH='ORDER0', Vc=0.1 /\n"
        zones = "&DIST_ORDER0 xn=2, zn=1 /\n 0d0\n 1d0 2d0"
        friction = converted(changed("friction='SWF'", "friction='RSF'").replace(law, state + zones)).faults[
            "main"].friction  # fmt: skip
        assert friction.kind() == name and friction.D_c == 0.01 and (friction.a, friction.b) == (0.01, 0.015)
        np.testing.assert_allclose(friction.theta_initial(np.array([-15e3, 0.0, 15e3])), [1, 2, 2])
        assert kind != 4 or friction.theta_c == pytest.approx(0.1)  # Dc / Vc
    weakening = "&BC_DYNFLT_RSF Dc=1d-2, a=0.001, b=0.1, Vstar=0.1d0 /"
    velocity = converted(changed("friction='SWF'", "friction='RSF'").replace(law, weakening)).faults["main"].friction
    assert velocity.kind() == "rate_and_state_velocity_weakening" and (velocity.mu_s, velocity.V_w) == (0.6, 0.1)
    without_state = "&BC_DYNFLT_RSF kind=2, Dc=1d-2 /"
    text = changed("friction='SWF'", "friction='RSF', V=1d-3").replace(law, without_state)
    assert converted(text).faults["main"].friction.V_initial == 1e-3
    for words, kind in (("kind=2, T=1d-3", "memory_constant_time"), ("kind=3, L=0.1, V=2d0", "prakash_clifton")):
        memory = converted(changed(law, f"{law}\n&BC_DYNFLT_NOR {words} /")).faults["main"].friction
        assert memory.kind() == kind and memory.law.kind() == "linear_slip_weakening"


def test_initial_stress_may_be_a_tensor() -> None:
    """On a horizontal fault inside, T_n = s_zz and T_t = s_yz in antiplane, s_xz in the plane; on an edge -s_yz."""
    stress = "Tn=-120.d6, Tt=1d6, Szz=-5d6, Syz=2d6, Sxz=4d6"
    for ndof, inside, shear in ((1, True, 3e6), (2, True, 5e6), (1, False, -1e6), (2, False, 5e6)):
        text = changed("Tn=-120.d6,TtH='PWCONR'", stress).replace("ndof=1", f"ndof={ndof}")
        text = re.sub(r"&DIST_PWCONR[^&]*", "", text)
        if inside:
            text = text.replace("nelem=30,12", "nelem=30,12, ezflt=-1").replace("tag = 1, kind", "tags = 5,6, kind")
            text = text.replace("zlim=0d0,12d3", "zlim=-6d3,6d3")
        found = converted(text).faults["main"].initial_stress
        assert found.normal == pytest.approx(125e6) and found.shear == pytest.approx(shear), (ndof, inside)


def test_linear_slip_is_compliant() -> None:
    text = changed("nelem=30,12, fztag=2", "nelem=30,12, ezflt=-1").replace("&MATERIAL tag=2, kind='ELAST','KV'  /", "")
    slip = "&BC_DEF tags=5,6, kind='LISFLT' /\n&BC_LSF Ctang=1d-7, Knorm=2d7 /\n&BC_DEF  tag = 2"
    text = re.sub(r"&BC_DEF  tag = 1, kind[\s\S]*?&BC_DEF  tag = 2", slip, text)
    contact = converted(text).faults["main"].contact
    assert contact.kind() == "compliant" and contact.C_s == pytest.approx(1e7) and contact.C_n == 2e7


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("mechanism='FORCE' /\n&SRC_FORCE angle=90d0 /", {"kind": "point_force", "force": [2.0, 0.0]}),
        ("mechanism='EXPLOSION' /", {"kind": "moment", "moment": [-2.0, -2.0, 0.0]}),
        # A vertical fault whose right side moves up: M_xz = M_zx = M_0.
        ("mechanism='DOUBLE_COUPLE' /\n&SRC_DOUBLE_COUPLE dip=90d0 /", {"kind": "moment", "moment": [0, 0, -2.0]}),
        # A thrust that dips to the right by 45 degrees: compression along x, M_zz = -M_xx = M_0.
        ("mechanism='DOUBLE_COUPLE' /\n&SRC_DOUBLE_COUPLE dip=45d0 /", {"kind": "moment", "moment": [2.0, -2.0, 0]}),
        ("mechanism='MOMENT' /\n&SRC_MOMENT Mxx=1d0, Mzz=3d0, Mxz=2d0, Mzx=2d0 /",
         {"kind": "moment", "moment": [-2.0, -6.0, -4.0]}),
    ],
)  # fmt: skip
def test_sources_at_a_point(source: str, expected: dict[str, Any]) -> None:
    """The central peak of their Ricker wavelet is minus the amplitude, which is 2; sources move to the nearest node."""
    text = re.sub(r"&SRC_DEF[\s\S]*?&REC", f"&SRC_DEF stf='RICKER', coord=51d0,-299d0, {source}\n"
                  "&STF_RICKER f0=2d0, onset=0.6d0, ampli=2d0 /\n&REC", COLUMN.replace("ndof=1", "ndof=2"))  # fmt: skip
    found = next(each for each in table(text)["boundaries"] if each["kind"] == expected["kind"])
    value = next(key for key in ("force", "moment") if key in expected)
    np.testing.assert_allclose(found[value], expected[value], atol=1e-12)
    assert found["point"] == [50.0, -300.0] and found["history"]["frequency"] == 2


def test_waves_and_courses_in_time() -> None:
    wave = COLUMN.replace("ndof=1", "ndof=2").replace("angle=0d0", "angle=-30d0")
    for phase, sign in (("P", 1), ("S", -1)):
        found = next(each for each in table(wave.replace("'S'", f"'{phase}'"))["boundaries"] if "wave" in each)
        # From the bottom left; our S waves move to the left of their direction, theirs to the right.
        np.testing.assert_allclose(found["direction"], [0.5, 0.75**0.5])
        assert found["velocity"] == -0.5 * sign and found["wave"] == phase
    ricker = "&STF_RICKER f0=2d0, onset=0.6d0, ampli=0.5d0 /"
    t = np.linspace(0, 2, 2000)
    for kind, block, values in (
        ("GAUSSIAN", "f0=2d0, onset=0.6d0", np.exp(-((2 * np.pi * (t - 0.6)) ** 2))),
        ("BRUNE", "fc=0.5d0", 1 - (1 + np.pi * t) * np.exp(-np.pi * t)),
        ("GAUSSXSIN", "f0=3d0, onset=1d0, std=0.2d0", np.exp(-12.5 * (t - 1) ** 2) * np.sin(3 * (t - 1))),
    ):
        text = COLUMN.replace("stf='RICKER'", f"stf='{kind}'").replace(ricker, f"&STF_{kind} ampli=0.5, {block} /")
        found = next(each for each in table(text)["boundaries"] if "wave" in each)
        assert found["velocity"] == 0.5
        np.testing.assert_allclose(found["history"]["values"], values, atol=1e-12)


@pytest.mark.fem
def test_a_wave_from_below_is_doubled_at_the_surface(tmp_path: Path) -> None:
    """Exact: v = f(t) at the bottom until the reflection is back, 2 f(t - H / c) at the surface, f the wavelet."""
    pytest.importorskip("dolfinx")
    from ruptfx import simulate

    found = convert(COLUMN)
    assert found.mesh is not None
    (tmp_path / "Par.msh").write_text(found.mesh)
    (tmp_path / "Par.toml").write_text(found.text)
    case = read_case(tmp_path / "Par.toml", ["output.figures=false"])
    with simulate(case, tmp_path / "run", progress=False) as record:
        bottom, top = (record.instruments[f"receiver_0{n}"] for n in (1, 2))
        a = (np.pi * 2 * (bottom["time"].values - 0.6)) ** 2
        wave = -0.5 * (1 - 2 * a) * np.exp(-a)
        a = (np.pi * 2 * (top["time"].values - 1.6)) ** 2
        doubled = -(1 - 2 * a) * np.exp(-a)
        early = bottom["time"].values < 1.9
        np.testing.assert_allclose(bottom["velocity_z"].values[early], wave[early], atol=5e-3)
        np.testing.assert_allclose(top["velocity_z"].values, doubled, atol=1e-2)


LINEAR_SLIP = """
&GENERAL ngll=6, ndof=1, title='Linear slip' /
&MESH_DEF method='CARTESIAN' /
&MESH_CART xlim=0d0,100d0, zlim=-500d0,500d0, nelem=2,20, ezflt=-1 /
&MATERIAL tag=1, kind='ELAST' /
&MAT_ELASTIC rho=2d3, cp=1.8d3, cs=1d3 /
&BC_DEF tag=1, kind='ABSORB' /
&BC_DEF tag=3, kind='ABSORB' /
&BC_ABSORB let_wave=F /
&BC_DEF tags=2,4, kind='PERIOD' /
&BC_DEF tags=5,6, kind='LISFLT' /
&BC_LSF Ctang=2d-8, Cnorm=1d-8 /
&TIME TotalTime=2d0, dt=1d-3 /
&SRC_DEF stf='RICKER', mechanism='WAVE', coord=0d0,0d0 /
&STF_RICKER f0=2d0, onset=0.6d0, ampli=-1d0 /
&SRC_WAVE angle=0d0, phase='S' /
&REC_LINE number=1, first=50d0,250d0, last=50d0,250d0, isamp=2 /
"""


@pytest.mark.fem
def test_a_wave_passes_a_linear_slip_fault(tmp_path: Path) -> None:
    """Exact: with [v] = 2 v_in - 2 v and tau = Z v = [u] / C, the wave behind is Z C / 2 dv/dt + v = v_in."""
    pytest.importorskip("dolfinx")
    from ruptfx import simulate

    (tmp_path / "Par.toml").write_text(convert(LINEAR_SLIP).text)
    case = read_case(tmp_path / "Par.toml", ["output.figures=false"])
    with simulate(case, tmp_path / "run", progress=False) as record:
        trace = record.instruments["receiver_01"]
        time, velocity = trace["time"].values, trace["velocity_z"].values
    relaxation = 2e3 * 1e3 * 2e-8 / 2  # Z C / 2 = 0.02 s
    fine = np.linspace(0, 2, 200_001)
    a = (np.pi * 2 * (fine - 0.6 - 0.75)) ** 2
    wave = (1 - 2 * a) * np.exp(-a)
    step = fine[1] - fine[0]
    share = step / (step + 2 * relaxation)  # trapezoidal rule
    passed = np.zeros_like(wave)
    for n in range(1, len(wave)):
        passed[n] = passed[n - 1] + share * (wave[n] + wave[n - 1] - 2 * passed[n - 1])
    expected = np.interp(time, fine, passed)
    assert 0.8 < expected.max() < 0.97  # the fault is felt
    np.testing.assert_allclose(velocity, expected, atol=1e-2)


# -- the series of its own output --------------------------------------------------------------------------------------

VERTICAL = """
&GENERAL ngll=6, ndof=1, title='Vertical fault below a surface' /
&MESH_DEF method='MESH2D' /
&MESH_MESH2D file='section.mesh2d' /
&MATERIAL tag=1, kind='ELAST' /
&MATERIAL tag=2, kind='ELAST','KV' /
&MAT_ELASTIC rho=2670d0, cp=6d3, cs=3464d0 /
&MAT_KV eta=0.2d0 /
&BC_DEF tag=1, kind='ABSORB' /
&BC_DEF tag=2, kind='ABSORB' /
&BC_DEF tag=4, kind='ABSORB' /
&BC_DEF tags=5,6, kind='DYNFLT' /
&BC_DYNFLT friction='SWF', Tn=-120d6, TtH='PWCONR' /
&DIST_PWCONR num=2, ref=0d0,-7.5d3 /
1.5d3
81.6d6 70d6
&BC_DYNFLT_SWF Dc=0.4d0, MuS=0.677d0, MuD=0.525d0 /
&TIME TotalTime=2.1d0, courant=0.5d0 /
"""
VISCOUS_ZONE = """
&GENERAL ngll=5, ndof=1, title='Viscous fault zone, forced front' /
&MESH_DEF method='CARTESIAN' /
&MESH_CART xlim=0d0,60d3, zlim=0d0,40d3, nelem=120,80 /
&MESH_CART_DOMAIN tag=1, ex=1,120, ez=1,10 /
&MESH_CART_DOMAIN tag=2, ex=1,120, ez=11,80 /
&MATERIAL tag=1, kind='ELAST','KV' /
&MAT_ELASTIC rho=2705d0, cp=5768.16d0, cs=3330.25d0 /
&MAT_KV eta=0.02d0, ETAxDT=F /
&MATERIAL tag=2, kind='ELAST' /
&MAT_ELASTIC rho=2705d0, cp=5768.16d0, cs=3330.25d0 /
&BC_DEF tag=1, kind='DYNFLT' /
&BC_DYNFLT friction='SWF','TWF', Tn=-50d6, Tt=26.7247d6 /
&BC_DYNFLT_SWF Dc=0.0848826d0, MuS=0.6d0, MuD=0.51d0 /
&BC_DYNFLT_TWF kind=1, MuS=0.6d0, MuD=0.51d0, Mu0=0.6d0, V=1.665d3, L=0.5d3, T=24.024d0 /
&BC_DEF tag=2, kind='ABSORB' /
&BC_DEF tag=3, kind='ABSORB' /
&BC_DEF tag=4, kind='DIRNEU' /
&BC_DIRNEU h='N', v='D' /
&TIME TotalTime=10d0, courant=0.1d0 /
"""
SLIP_LAW = """
&GENERAL ngll=5, ndof=1, title='Rate and state, slip law' /
&MESH_DEF method='CARTESIAN' /
&MESH_CART xlim=0d0,20d3, zlim=0d0,7.5d3, nelem=120,45 /
&MATERIAL tag=1, kind='ELAST' /
&MAT_ELASTIC rho=2673d0, cp=6d3, cs=3464d0 /
&BC_DEF tag=1, kind='DYNFLT' /
&BC_DYNFLT friction='RSF', Tn=-120d6, TtH='ORDER0', V=1d-3 /
&DIST_ORDER0 xn=3, zn=1 /
1.5d3 10d3
81.6d6 70d6 1d4
&BC_DYNFLT_RSF kind=3, Dc=3.7d-2, MuS=0.6d0, a=0.0125d0, b=0.0172d0, Vstar=1d-6, thetaH='ORDER0' /
&DIST_ORDER0 xn=2, zn=1 /
10d3
92.713d0 4.0036d-14
&BC_DEF tag=3, kind='ABSORB' /
&TIME TotalTime=2d0, courant=0.6d0 /
"""


def section_file(width: float = 15e3, depth: float = 30e3, fault: float = 15e3, h: float = 500.0) -> str:
    """A vertical section with a split fault from the surface down, as .mesh2d; elements at the fault have tag 2."""
    columns, rows, below = round(2 * width / h), round(depth / h), round((depth - fault) / h)
    number = np.arange((rows + 1) * (columns + 1)).reshape(rows + 1, columns + 1)
    points = [(i * h - width, j * h - depth) for j in range(rows + 1) for i in range(columns + 1)]
    right = number.copy()  # vertices as the elements right of the fault have them
    for j in range(below + 1, rows + 1):
        right[j, columns // 2] = len(points)
        points.append((0.0, j * h - depth))
    cells, sides = [], {side: [] for side in range(1, 7)}
    for j in range(rows):
        for i in range(columns):
            n = right if i >= columns // 2 else number
            beside = j >= below and i in (columns // 2 - 1, columns // 2)
            cells.append([n[j, i], n[j, i + 1], n[j + 1, i + 1], n[j + 1, i], 1 if beside else 0])
            where = {1: j == 0, 2: i == columns - 1, 3: j == rows - 1, 4: i == 0,
                     5: beside and i < columns // 2, 6: beside and i >= columns // 2}  # fmt: skip
            for side, on in where.items():
                if on:
                    sides[side].append((len(cells), {5: 2, 6: 4}.get(side, side)))
    lines = ["NEL NPEL NNOD NBC", f"{len(cells)} 4 {len(points)} 6", "NID X Y"]
    lines += [f"{n} {x} {z}" for n, (x, z) in enumerate(points, start=1)] + ["EID NODES TAG"]
    lines += [f"{n} {' '.join(str(v + 1) for v in cell)}" for n, cell in enumerate(cells, start=1)]
    for side, edges in sides.items():
        lines += ["BCTAG NBEL", f"{side} {len(edges)}", "BID EID EDGE"]
        lines += [f"{n} {cell} {edge}" for n, (cell, edge) in enumerate(edges, start=1)]
    return "\n".join(lines) + "\n"


def series(name: str) -> list[tuple[float, float, float]]:
    """Position [m], time [s] and slip [m] of the output of SEM2DPACK."""
    with SERIES.open() as file:
        rows = csv.DictReader(line for line in file if not line.startswith("#"))
        return [(float(r["position_m"]), float(r["time_s"]), float(r["slip_m"])) for r in rows if r["case"] == name]


@pytest.mark.fem
@pytest.mark.parametrize(
    ("name", "text", "tolerance"),
    [
        # Leapfrog on both sides, the same mesh, other steps.
        ("vertical", VERTICAL, 4e-3),
        # Two passes of Newmark against leapfrog with the law solved implicitly.
        pytest.param("slip_law", SLIP_LAW, 1e-2, marks=pytest.mark.slow),
        # A box of 60 km instead of 100 km, whose edges are not felt until 10 s.
        pytest.param("viscous_zone", VISCOUS_ZONE, 3e-3, marks=pytest.mark.slow),
    ],
)
def test_slip_is_that_of_sem2dpack(tmp_path: Path, name: str, text: str, tolerance: float) -> None:
    """Largest difference at some times and places over the largest slip of the place."""
    pytest.importorskip("dolfinx")
    from ruptfx import simulate

    (tmp_path / "section.mesh2d").write_text(section_file())
    (tmp_path / "Par.inp").write_text(text)
    found = convert_file(tmp_path / "Par.inp", "Par.msh")
    (tmp_path / "Par.toml").write_text(found.text)
    if found.mesh:
        (tmp_path / "Par.msh").write_text(found.mesh)
    expected = [row for row in series(name) if row[1] <= table_duration(found.text) + 1e-9]
    quiet = ["output.figures=false", "output.bulk_interval=10", "output.interface_interval=0.01"]
    with simulate(read_case(tmp_path / "Par.toml", quiet), tmp_path / "run", progress=False) as record:
        slip, time = record.interface["slip"], record.interface["time"].values
        positions = record.interface["position"].values
        # Places that the rupture has reached at the end.
        reached = sorted({place for place, _, each in expected if each > 0.05})
        assert len(reached) > 1
        for place in reached:
            rows = [row for row in expected if row[0] == place]
            mine = np.interp([t for _, t, _ in rows], time, slip.values[:, np.argmin(np.abs(positions - place))])
            theirs = np.array([each for *_, each in rows])
            assert np.abs(mine - theirs).max() < tolerance * theirs.max(), (place, mine, theirs)


def table_duration(text: str) -> float:
    return float(tomllib.loads(text)["duration"])


# -- widths, drag, relaxation, plasticity, viscous bodies --------------------------------------------------------------


def test_a_finite_width_is_a_spring_of_the_bodies() -> None:
    assert {"kind": "body_spring", "width": 1e4} in table(changed("ndof=1", "ndof=1, W=10d3"))["boundaries"]


def test_roughness_drag_wraps_slip_weakening() -> None:
    found = converted(changed(LAW, f"{LAW}, alpha=0.002")).faults["main"].friction
    assert (found.kind(), found.drag, found.law.kind()) == ("roughness_drag", 0.002, "linear_slip_weakening")
    # 1 m of slip, beyond Dc = 0.4 m.
    state = found.advance(found.initial_state(np.array([1e8]), np.array([0.0]), np.array([0.0])), 1.0, 1e8, 1.0)
    assert found.strength(1.0, 1e8, state)[0] == pytest.approx((0.525 + 0.002) * 1e8, rel=1e-12)


def viscoelastic(more: str) -> str:
    text = changed("&MATERIAL tag=1, kind='ELAST'", "&MATERIAL tag=1, kind='VISCO'").replace("ndof=1", "ndof=2")
    values = f"&MAT_VISCO rho=2d3, cp=3d3, cs=2d3, QP=30d0, QS=20d0, Nbody=3, fmin=1.8d0, fmax=180d0{more} /"
    return changed("&MATERIAL tag=2", f"{values}\n&MATERIAL tag=2", text.replace(", fztag=2", ""))


@pytest.mark.parametrize("f0", [0.0, 18.0])
def test_wave_speeds_of_attenuation_are_those_at_its_frequency(f0: float) -> None:
    """Phase velocity of the complex modulus of the case, against cp and cs of the input."""
    law = next(each for each in converted(viscoelastic(f", f0={f0}")).materials.values() if each.has_memory())
    bulk, shear = law.relaxed(np.array([f0]))
    for modulus, speed in ((bulk + 4 / 3 * shear, 3e3), (shear, 2e3)):
        assert 1 / np.real(np.sqrt(2e3 / modulus[0])) == pytest.approx(speed, rel=1e-9)
    assert (law.Q_p, law.Q_s, law.mechanisms) == (30, 20, 3)


def test_the_initial_strain_of_plastic_bodies_is_their_stress() -> None:
    values = "&MAT_PLASTIC cp=5770d0, cs=3330d0, rho=2705d0, phi=30d0, coh=9.67d6, Tv=0.05d0, e0=-4d-4, -4d-4, 3.5d-4 /"
    text = changed("&MATERIAL tag=1, kind='ELAST'", "&MATERIAL tag=1, kind='PLAST'").replace("ndof=1", "ndof=2")
    text = changed("&MATERIAL tag=2", f"{values}\n&MATERIAL tag=2", text.replace(", fztag=2", ""))
    law = next(each for each in converted(text).materials.values() if each.kind() == "mohr_coulomb")
    shear, first = 2705 * 3330**2, 2705 * (5770**2 - 2 * 3330**2)
    expected = [-8e-4 * first - 8e-4 * shear, -8e-4 * first - 8e-4 * shear, -8e-4 * first, 7e-4 * shear, 0, 0]
    np.testing.assert_allclose(law.initial_stress, expected, rtol=1e-12)
    assert law.friction_angle == pytest.approx(np.pi / 6)


def test_viscous_cells_away_from_the_fault_are_bodies() -> None:
    rows = "fztag=1/\n&MESH_CART_DOMAIN tag=1, ex=1,30, ez=1,12/\n&MESH_CART_DOMAIN tag=2, ex=1,30, ez=5,6/"
    inside = changed("zlim=0d0,12d3 , nelem=30,12", "zlim=-6d3,6d3, nelem=30,12, ezflt=-1")
    inside = inside.replace("tag = 1, kind = 'DYNFLT'", "tags = 5,6, kind = 'DYNFLT'")
    found = converted(inside.replace("fztag=2/", rows.replace("ez=5,6", "ez=2,3")))
    assert found.damping.kelvin_voigt.bodies == ["lower_2"] and found.mesh.kind() == "gmsh_file"
    # Rows next to the fault are a layer.
    near = converted(inside.replace("fztag=2/", "fztag=2, fznz=1/"))
    assert near.damping.kelvin_voigt.bodies is None and near.damping.kelvin_voigt.thickness is not None


# -- refusals ----------------------------------------------------------------------------------------------------------

LAW = "&BC_DYNFLT_SWF Dc=0.4d0, MuS=0.677d0, MuD=0.525d0"
FEATURES = {
    "MATERIAL.DMG": ("&MATERIAL tag=1, kind='ELAST'", "&MATERIAL tag=1, kind='DMG'"),
    "MATERIAL.VISLA": ("&MATERIAL tag=1, kind='ELAST'", "&MATERIAL tag=1, kind='VISLA'"),
    "MATERIAL.IWAN": ("&MATERIAL tag=1, kind='ELAST'", "&MATERIAL tag=1, kind='IWAN'"),
    "MESH_DEF.EMC2": ("'CARTESIAN'", "'EMC2'"),
    "BC_DYNFLT_SWF.healing": (LAW, f"{LAW}, healing=T"),
    "BC_DYNFLT.pp": ("Tn=-120.d6", "Tn=-120.d6, pp='GAUSSXSIN'"),
    "BC_DEF.KINFLT": ("tag = 2 , kind = 'ABSORB'", "tag = 2 , kind = 'KINFLT'"),
}  # fmt: skip


@pytest.mark.parametrize("name", FEATURES)
def test_a_feature_without_counterpart_is_refused_by_name(name: str) -> None:
    with pytest.raises(ConversionError) as caught:
        convert(changed(*FEATURES[name]))
    assert f"  {name}: " in str(caught.value)


@pytest.mark.parametrize("name", ["BC_DYNFLT_SWF.healing", "BC_DYNFLT.pp", "BC_DEF.KINFLT"])
def test_a_feature_is_left_out_on_request(name: str) -> None:
    found = convert(changed(*FEATURES[name]), without=[name.lower()])
    assert any(note.startswith(f"left out as asked: {name}") for note in found.notes)
    parse_case(tomllib.loads(found.text))


def test_every_reason_is_listed_at_once() -> None:
    text = INPUT
    for name in ("BC_DYNFLT.pp", "MATERIAL.DMG", "BC_DYNFLT_SWF.healing", "BC_DEF.KINFLT"):
        text = changed(*FEATURES[name], text)
    text = changed("&SNAP_DEF", "&SRC_DEF stf='NONE', mechanism='FORCE' /\n&CUSTOM /\n&SNAP_DEF", text)
    text = changed("TotalTime=1.0d0, ", "", text)
    with pytest.raises(ConversionError) as caught:
        convert(text, without=["material.dmg"])
    for said in ("&MATERIAL tag = 1: is required", "CUSTOM: a block without"):
        assert says(said, str(caught.value))
    text = changed("kind='DMG'", "kind='ELAST'", text)
    with pytest.raises(ConversionError) as caught:
        convert(text)
    for said in ("BC_DYNFLT.pp", "SWF.healing", "BC_DEF.KINFLT", "CUSTOM", "stf = 'NONE'", "&TIME nbsteps"):
        assert says(said, str(caught.value)), said


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("nelem=30,12", "nelem=30,13", "must be a box of square elements"),
        ("nelem=30,12", "nelem=0,12", "zlim = 0, 12000, nelem = 0, 12: limits must increase"),
        ("friction='SWF'", "friction='SWF','RSF'", "friction = ['SWF', 'RSF']: must be SWF, TWF, RSF, or one"),
        ("Tn=-120.d6", "Tn=120.d6", "Tn = 1.2e+08: must be negative"),
        ("81.6d6 70.d6", "81.6d6 70.d6 60.d6", "&DIST_PWCONR: 3 numbers must follow it, and 4 do; correct"),
        ("TtH='PWCONR'", "TtH='GAUSSIAN'", "ttH = 'GAUSSIAN': &DIST_GAUSSIAN must follow, and &DIST_PWCONR does"),
        ("courant = 0.5d0", "courant = 'half'", "&TIME courant: a number is required, and 'half' is none"),
        ("TotalTime=1.0d0, ", "", "&TIME nbsteps: a number is required"),
        ("tag = 2 , kind = 'ABSORB'", "tag = 7 , kind = 'ABSORB'", "tag = 7: no edge of this mesh; use one of 1, 2"),
        ("tag = 1, kind = 'DYNFLT'", "tag = 1, kind = 'LISFLT'", "tag = 1: a linear-slip fault needs both sides; use"),
        ("kind='newmark'", "kind='quasi-static'", "TIME.kind: kind = 'quasi-static'"),
        ("method = 'CARTESIAN'", "method = 'MESH2D'", "&MESH_MESH2D: occurs 0 times instead of once; add it"),
        ("tag=1, kind='ELAST' /", "tag=3, kind='ELAST' /", "&MATERIAL tag = 1: is required, because elements"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said(old: str, new: str, said: str) -> None:
    with pytest.raises(ConversionError) as caught:
        convert(changed(old, new))
    assert says(said, str(caught.value))


def test_a_refused_feature_is_left_out_as_the_message_says() -> None:
    text = changed(*FEATURES["BC_DYNFLT.pp"])
    with pytest.raises(ConversionError) as caught:
        convert(text)
    name = str(caught.value).rpartition("--without ")[2]
    assert name == "BC_DYNFLT.pp" and f"left out as asked: {name}" in "\n".join(convert(text, without=[name]).notes)


MATERIAL = (("kind='ELAST' /", "kind='SOIL' /"), ("&MAT_ELASTIC ", "&MAT_SOIL "))
FLUID = ("friction='SWF'", "friction='SWF','TP'"), ("&BC_DYNFLT_SWF", "&BC_DYNFLT_TP nz=80 /\n&BC_DYNFLT_SWF")


def test_what_is_proposed_to_be_left_out_works() -> None:
    """All names of a refusal together; a material without which there is no body is not proposed."""
    inputs = [[FEATURES[name]] for name in FEATURES] + [list(FLUID), list(MATERIAL), [*FLUID, FEATURES["BC_DYNFLT.pp"]]]
    proposed = []
    for changes in inputs:
        text = INPUT
        for old, new in changes:
            text = changed(old, new, text)
        with pytest.raises(ConversionError) as caught:
            convert(text)
        names = re.findall(r"--without (\S+)", str(caught.value))
        proposed.append(names)
        if names and all(line.strip().startswith(tuple(names)) for line in str(caught.value).splitlines()[1:-1]):
            parse_case(tomllib.loads(convert(text, without=names).text))
    assert proposed[-3:] == [["BC_DYNFLT_TP"], [], ["BC_DYNFLT_TP", "BC_DYNFLT.pp"]]


@pytest.mark.parametrize("strain", ["", ", e0=-3d-4,2d-4"])
def test_an_initial_strain_of_an_elastic_material_changes_notes_only(strain: str) -> None:
    text = INPUT.replace("'ELAST'", "'ELASM'").replace("&MAT_ELASTIC ", "&MAT_ELASTICM ")
    result = convert(changed("cs=3464.d0", f"cs=3464.d0{strain}", text))
    assert tomllib.loads(result.text) == tomllib.loads(convert(INPUT).text)
    assert any("-0.0003, 0.0002" in note for note in result.notes) == bool(strain)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    (tmp_path / "Par.inp").write_text(VERTICAL)
    with pytest.raises(
        ConversionError, match=facts(r"&MESH_MESH2D file = 'section.mesh2d': no such file beside the input")
    ):
        convert_file(tmp_path / "Par.inp", "Par.msh")


def test_the_command_writes_the_case_and_says_what_is_different(tmp_path: Path) -> None:
    (tmp_path / "Par.inp").write_text(COLUMN)
    done = CliRunner().invoke(app, ["convert", str(tmp_path / "Par.inp")])
    assert done.exit_code == 0, done.output
    assert read_case(tmp_path / "Par.toml").title == "Column" and (tmp_path / "Par.msh").is_file()
    again = CliRunner().invoke(app, ["convert", str(tmp_path / "Par.inp")])
    assert again.exit_code == 1 and "exists already" in again.output
    (tmp_path / "wet.inp").write_text(changed(*FEATURES["BC_DYNFLT.pp"]))
    done = CliRunner().invoke(app, ["convert", str(tmp_path / "wet.inp"), "--without", "BC_DYNFLT.pp"])
    assert done.exit_code == 0 and says("left out as asked: BC_DYNFLT.pp", done.output)
    (tmp_path / "other.txt").write_text("nothing of the kind")
    assert says("is it an input of SEM2DPACK", CliRunner().invoke(app, ["convert", str(tmp_path / "other.txt")]).output)


# -- the table of its examples -----------------------------------------------------------------------------------------


def verdicts() -> list[tuple[str, str, list[str]]]:
    """Example, verdict, and the features that are refused, of the table of the page."""
    rows = re.findall(r"^\| `([^`]+\.inp)` \| ([a-z ]+) \| ?(.*?) ?\|$", PAGE.read_text(), re.M)
    return [(name, verdict, re.findall(r"`([A-Z0-9_]+\.\w+)`", text)) for name, verdict, text in rows]


def test_the_table_of_examples_counts_and_names_what_is_refused() -> None:
    rows = verdicts()
    count = {verdict: sum(row[1] == verdict for row in rows) for verdict in {row[1] for row in rows}}
    said = re.search(r"Of (\d+) inputs (\d+) convert, (\d+) convert with `--without`, and (\d+)", PAGE.read_text())
    assert said is not None
    assert [int(number) for number in said.groups()] == [
        len(rows), count["converts"] + count["needs file"], count["left out"], count["refused"]]  # fmt: skip
    for name, verdict, features in rows:
        assert set(features) <= set(FEATURES), name
        assert bool(features) == (verdict in ("left out", "refused")), name


@pytest.mark.skipif("SEM2DPACK_EXAMPLES" not in os.environ, reason="set SEM2DPACK_EXAMPLES to the folder EXAMPLES")
@pytest.mark.parametrize(("name", "verdict", "features"), verdicts(), ids=[row[0] for row in verdicts()])
def test_the_table_of_examples_is_true(name: str, verdict: str, features: list[str]) -> None:
    folder = Path(os.environ["SEM2DPACK_EXAMPLES"])
    path = next(path for path in (folder / name, folder / name.replace("/", "__")) if path.is_file())
    try:
        convert_file(path, "Par.msh")
        found = []
    except ConversionError as error:
        found = re.findall(r"^  (.*?): ", str(error), re.M)
    missing = [each for each in found if each.startswith("&")]
    assert {each for each in found if not each.startswith("&")} == set(features)
    assert bool(missing) <= (verdict in ("needs file", "refused"))
    if verdict == "left out":
        convert_file(path, "Par.msh", without=features)


def test_constants_of_an_orthotropic_body() -> None:
    """E_1 = c11 - c13^2 / c33, E_2 = c33 - c13^2 / c11 and nu_12 = c13 / c33."""
    entries = {"rho": [1.0], "c11": [10.0], "c13": [2.0], "c33": [5.0], "c55": [1.0]}
    body = _elastic(Input([]), Block("MAT_ELASTIC", entries))
    assert (body["E_1"], body["E_2"], body["nu_12"]) == pytest.approx((10 - 4 / 5, 5 - 4 / 10, 2 / 5))
