"""Old joints of a body, and interfaces that cohesion holds: the same on one rank and two."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from crack_cases import RUBS, WEAK, block
from small_cases import HOMALITE, SPLIT, plates
from whole_runs import run_on, starts_jobs, write

from ruptfx.record import Record

pytestmark = starts_jobs


def runs(table: dict[str, Any], folder: Path) -> tuple[Path, Path]:
    """The same case on one rank and on two."""
    case = write(folder, table)
    return run_on(1, case, folder / "on1"), run_on(2, case, folder / "on2")


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


def test_a_bond_breaks_alike(tmp_path: Path) -> None:
    table = plates({
        "faults.main": {
            "contact": SPLIT, "friction": {"kind": "coulomb", "mu_d": 0.3}, "initial_stress": {"normal": 0.0},
            "cohesion": {"kind": "munjiza", "f_t": 4e6, "c": 8e6, "G_Ic": 10.0, "G_IIc": 20.0},
        },
        "materials": {"default": HOMALITE}, "duration": 12e-6,
        "boundaries": [{"kind": "driven", "edge": "upper.left", "component": "x", "velocity": 20.0, "ramp": 1e-6}],
    })  # fmt: skip
    one, two = runs(table, tmp_path)
    with Record(one) as a, Record(two) as b:
        for name in ("damage", "slip", "opening", "shear_traction", "normal_stress"):
            x, y = a.interface[name].values, b.interface[name].values
            assert np.abs(x).max() > 0, name
            np.testing.assert_allclose(x, y, rtol=1e-9, atol=1e-9 * np.abs(x).max(), err_msg=name)
        assert a.interface["damage"].values[-1].max() == 1
        assert abs(a.energy.closure).max() < 1e-11 and abs(b.energy.closure).max() < 1e-11
