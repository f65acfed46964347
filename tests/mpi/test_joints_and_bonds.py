"""Old joints of a body, and interfaces that cohesion holds: the same on one rank and two, and after a stop."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.compare import largest_difference
from helpers.crack_cases import RUBS, WEAK, block
from helpers.small_cases import HOMALITE, SPLIT, merged, plates
from helpers.whole_runs import killed, run_of, run_on, starts_jobs, stopped, write

from ruptfx.case import read_case
from ruptfx.interfaces.faults.cohesive_interface import STATE as BOND
from ruptfx.platform import fem
from ruptfx.results.record import Record
from ruptfx.run.recording.checkpoint import Checkpoint
from ruptfx.run.simulation import simulate

pytestmark = starts_jobs


def runs(table: dict[str, Any], folder: Path) -> tuple[Path, Path]:
    """The same case on one rank and on two."""
    case = write(folder, table)
    return run_on(1, case, folder / "on1"), run_on(2, case, folder / "on2")


@pytest.mark.slow
def test_a_joint_breaks_to_the_same_bits(tmp_path: Path) -> None:
    weak = {**WEAK, "f_t": 0.2 * WEAK["f_t"], "G_Ic": 0.5, "G_IIc": 2.0}
    table = block({
        "mesh": {"kind": "specimen", "shape": {"kind": "rectangle", "width": 10e-3, "height": 10e-3},
                 "element_size": 1.2e-3, "joints": {"old": [-5e-3, -2e-3, 5e-3, 2e-3]}},
        "fracture.joints": {"old": {"cohesion": weak, "friction": RUBS}},
        "boundaries": [{"kind": "driven", "edge": f"specimen.{edge}", "component": "y", "velocity": v, "ramp": 1e-6}
                       for edge, v in (("top", 1.0), ("bottom", 0.0))],
    })  # fmt: skip
    one, two = runs(table, tmp_path)
    with Record(one) as a, Record(two) as b:
        assert a.events.identical(b.events) and a.cracks.identical(b.cracks)
        inclination = a.events["inclination"].values
        assert len(inclination) > 5  # the joint, and little else
        assert np.mean(np.abs(inclination - np.degrees(np.arctan(0.4))) < 1e-6) > 0.6


BONDED = plates({
    "faults.main": {
        "contact": SPLIT, "friction": {"kind": "coulomb", "mu_d": 0.3}, "initial_stress": {"normal": 0.0},
        "cohesion": {"kind": "munjiza", "f_t": 4e6, "c": 8e6, "G_Ic": 10.0, "G_IIc": 20.0},
    },
    "materials": {"default": HOMALITE}, "duration": 8.5e-6, "output.checkpoint_steps": 60,
    "boundaries": [{"kind": "driven", "edge": "upper.left", "component": "x", "velocity": 20.0, "ramp": 1e-6}],
})  # fmt: skip
IMPLICIT = merged(BONDED, {
    "stepper": {"kind": "generalized_alpha", "scheme": "average_acceleration", "courant": 2.0},
    "faults.main.contact": {"kind": "compliant", "C_n": 5e12, "C_s": 5e12}, "duration": 6e-6,
    "output.checkpoint_steps": 7,
})  # fmt: skip
case_file, alone = run_of(BONDED, IMPLICIT, marks=pytest.mark.slow)


@pytest.mark.slow
def test_a_bond_breaks_alike(case_file: Path, alone: Path, tmp_path: Path) -> None:
    breaks_alike(alone, run_on(2, case_file, tmp_path / "run"))


def breaks_alike(one: Path, two: Path) -> None:
    """To rounding."""
    with Record(one) as a, Record(two) as b:
        for name in (*BOND, "slip", "opening", "shear_traction", "normal_stress"):
            x, y = a.interface[name].values, b.interface[name].values
            assert np.abs(x).max() > 0, name
            np.testing.assert_allclose(x, y, rtol=1e-9, atol=1e-9 * np.abs(x).max(), err_msg=name)
        assert a.interface["damage"].values[-1].max() == 1
        assert abs(a.energy.closure).max() < 1e-11 and abs(b.energy.closure).max() < 1e-11


def half_broken(case_file: Path, out: Path) -> None:
    """The last checkpoint has points that are damaged and have not failed."""
    found = Checkpoint.latest(fem.MPI.COMM_WORLD, out, read_case(case_file))
    assert found is not None
    with Record(out) as record:
        damage = record.interface["damage"].values[record.interface["time"].values <= found.manifest["time"]]
    assert np.any((damage[-1] > 0) & (damage[-1] < 1))


@pytest.mark.faults
def test_a_bond_goes_on_from_a_checkpoint_to_the_same_bits(case_file: Path, alone: Path, tmp_path: Path) -> None:
    """In the middle of breaking; on two ranks from a checkpoint of one, to rounding."""
    out = stopped(alone, tmp_path / "run")
    half_broken(case_file, out)
    simulate(read_case(case_file), out, progress=False, resume=True)
    assert max(largest_difference(alone, out).values()) == 0
    breaks_alike(alone, run_on(2, case_file, stopped(alone, tmp_path / "other"), "--resume"))


@pytest.mark.slow
@pytest.mark.faults
def test_a_bond_that_was_killed_on_two_ranks_resumes_to_the_same_files(tmp_path: Path) -> None:
    """Long enough to be killed before it ends."""
    case_file = write(tmp_path, {**BONDED, "duration": 60e-6})
    whole = run_on(2, case_file, tmp_path / "whole")
    out = run_on(2, case_file, killed(case_file, tmp_path / "run", 2), "--resume")
    assert max(largest_difference(whole, out).values()) == 0
