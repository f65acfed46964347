"""Inputs of SEM2DPACK as cases: the same run as of a case written by hand, and plain refusals."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from ruptfx.case import parse_case, read_case
from ruptfx.cli import app
from ruptfx.sem2dpack import ConversionError, blocks, convert

DEMO = Path(__file__).parents[2] / "demos" / "antiplane.toml"
# demos/antiplane.toml in the words of SEM2DPACK: elements of 1 km, 5 nodes a side.
INPUT = """
# a comment, 'with' quotes & signs /
&GENERAL iexec=1, ngll=5, fmax=3.d0 , ndof=1 ,
  title = 'Antiplane / rupture', verbose='1111' , ItInfo = 400/
&MESH_DEF  method = 'CARTESIAN'/
&MESH_CART xlim=-15.d3,15.d3, zlim=0d0,12d3 , nelem=30,12/
&MATERIAL tag=1, kind='ELAST','KV'  /
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
&REC_LINE number = 11 , first = -10d3,0d3, last = 10d3,0d3, isamp=20, AtNode=F /
&SNAP_DEF itd=200, fields ='DVS',bin=T,ps=F /
"""


def converted(text: str = INPUT):
    return parse_case(tomllib.loads(convert(text)))


def changed(old: str, new: str) -> str:
    assert INPUT.count(old) == 1, old
    return INPUT.replace(old, new)


def test_namelists_are_those_of_fortran() -> None:
    found = list(blocks("&A x=1.5d3, 2*-.5 Y = T, z='a, b=/' ! c=1\n q=.false. /\n 1.0d0 2\n3\n&B /"))
    assert [block.name for block in found] == ["A", "B"]
    assert found[0].values == {"x": [1500.0, -0.5, -0.5], "y": [True], "z": ["a, b=/"], "q": [False]}
    assert found[0].numbers == [1.0, 2.0, 3.0]


@pytest.mark.fem
def test_it_runs_as_the_case_written_by_hand(tmp_path: Path) -> None:
    pytest.importorskip("dolfinx")
    from ruptfx import simulate

    quiet = ["output.figures=false", "output.bulk_interval=1.0"]
    by_hand = read_case(DEMO, ['mesh.element_size="1 km"', 'duration="1 s"', *quiet])
    (tmp_path / "Par.toml").write_text(convert(INPUT))
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
    assert "# - absorbing edges are Lysmer's dashpots" in convert(text)


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
    assert "# - the fault at z = 1000 m is y = 0 here" in convert(text)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("'CARTESIAN'", "'EMC2'", "method: only 'CARTESIAN'"),
        ("nelem=30,12", "nelem=30,13", "nelem: elements of 1000 by 923.077 m"),
        ("nelem=30,12", "nelem=30,12, ezflt=5", "the fault must be in the middle"),
        ("friction='SWF'", "friction='SWF','TWF'", "friction = ['SWF', 'TWF']: only 'SWF'"),
        ("Tn=-120.d6", "Tn=120.d6", "Tn: must be negative"),
        ("Tn=-120.d6", "Tn=-120.d6, Sxx=1d6", "sxx = 1000000.0: has no counterpart"),
        ("num=2, ref=0d0,0d0", "num=2, ref=0d0,5d2", "ref: z = 500 m is not on the fault"),
        ("81.6d6 70.d6", "81.6d6 70.d6 60.d6", "only 'PWCONR' with num = 2"),
        ("TtH='PWCONR'", "TtH='GAUSSIAN'", "ttH = 'GAUSSIAN'"),
        ("kind='ELAST','KV'", "kind='PLAST'", "kind = PLAST: only"),
        ("&SNAP_DEF", "&SRC_DEF", "&SRC_DEF: only"),
        ("TotalTime=1.0d0, ", "", "nbsteps is required"),
        ("tag = 2 , kind = 'ABSORB'", "tag = 1 , kind = 'ABSORB'", "tag = 1: edges of this box"),
        ("tag = 1, kind = 'DYNFLT'", "tag = 1, kind = 'LISFLT'", "kind = 'LISFLT'"),
        ("ndof=1", "ndof=1, W=10d3", "W: 2.5 dimensions"),
    ],
)  # fmt: skip
def test_what_a_case_cannot_say_is_refused_by_name(old: str, new: str, said: str) -> None:
    with pytest.raises(ConversionError) as caught:
        convert(changed(old, new))
    assert said in str(caught.value)


def test_the_command_writes_the_case_and_says_what_is_different(tmp_path: Path) -> None:
    (tmp_path / "Par.inp").write_text(INPUT)
    done = CliRunner().invoke(app, ["convert", str(tmp_path / "Par.inp")])
    assert done.exit_code == 0 and "left out: &REC_LINE" in done.output and "newmark is leapfrog here" in done.output
    assert read_case(tmp_path / "Par.toml").title == "Antiplane / rupture"
    again = CliRunner().invoke(app, ["convert", str(tmp_path / "Par.inp")])
    assert again.exit_code == 1 and "exists already" in again.output
    (tmp_path / "other.txt").write_text("nothing of the kind")
    assert "is it an input of SEM2DPACK" in CliRunner().invoke(app, ["convert", str(tmp_path / "other.txt")]).output
