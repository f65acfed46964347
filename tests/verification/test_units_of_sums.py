"""Forces and energies are per metre of thickness in a plane, and those of the bodies in three dimensions."""

import json

import numpy as np
import pytest
from helpers.small_cases import case

pytest.importorskip("dolfinx")

from ruptfx.case import parse_case
from ruptfx.input.fields import extensive_unit
from ruptfx.results import plots
from ruptfx.run.simulation import simulate

pytestmark = pytest.mark.fem

SPEED, DENSITY = 0.1, 1246.0
CELL = {"kind": "load_cell", "name": "cell", "edge": "upper.top", "interval": 1e-6}
PLATES = {"plane": "strain", "order": 1, "duration": 4e-6, "boundaries": [], "instruments": [CELL]}
AREA = 12e-3 * 4e-3  # of a plate [m2]


@pytest.mark.parametrize("plane, extent, energy, force", [("strain", 1.0, "J/m", "N/m"), ("solid", 3e-3, "J", "N")])
def test_two_plates_that_fly(plane, extent, energy, force, tmp_path):
    """Both fly along x at 0.1 m/s: rho v^2 / 2 on twice 12 x 4 mm is 5.98e-4 J/m, times 3 mm it is 1.79e-6 J."""
    table = case(PLATES).table()
    table["initial_velocity"] = {name: [SPEED, 0.0, 0.0][: 2 + (plane == "solid")] for name in ("upper", "lower")}
    if plane == "solid":
        table["plane"] = "solid"
        table["mesh"] = {"kind": "extruded", "thickness": extent, "layers": 1, "section": table["mesh"]}
    with simulate(parse_case(table), tmp_path / "run", progress=False) as record:
        assert record.energy.kinetic.attrs["units"] == energy == record.sum_unit("J")
        expected = 0.5 * DENSITY * SPEED**2 * 2 * AREA * extent
        np.testing.assert_allclose(record.energy.kinetic.values, expected, rtol=1e-9)
        assert record.instruments["cell"].force_x.attrs["units"] == force == record.sum_unit("N")
        (panel, _) = plots.energy_budget(record).figure.axes
        label = panel.get_ylabel()
        assert label.endswith(f"J{'/m' * (plane == 'strain')})") and ("thickness" in label) == (plane == "strain")
    first, second = (tmp_path / "run" / "energy.csv").read_text().splitlines()[:2]
    assert f"energies in {energy}, " in first and second.startswith("time,")
    assert "energy" not in json.loads((tmp_path / "run" / "summary.json").read_text())


def test_around_an_axis_sums_are_those_of_the_bodies():
    planes = ("stress", "strain", "antiplane", "axisymmetric", "solid")
    assert [extensive_unit("N", plane) for plane in planes] == ["N/m", "N/m", "N/m", "N", "N"]
