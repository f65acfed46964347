"""Numbers of a circular rupture at constant speed, whose moment, area and speed are known."""

import numpy as np
import pytest
from helpers import synthetic

from ruptfx import Record, analysis
from ruptfx.analysis.surface import grid, moment_rate, rupture_velocity
from ruptfx.analysis.verdict import verdict
from ruptfx.commands.export import tables


@pytest.mark.parametrize("speed, regime", [(2500.0, 0.0), (5000.0, 1.0)])
def test_a_circular_rupture(tmp_path, speed, regime):
    with Record(synthetic.write_surface_run(tmp_path / "run", speed)) as record:
        found = analysis.summarise(record)
        data = record.interface
        assert "8 fields, 3321 points x 41 times, until 10 s" in repr(record)
        names = {path.name for path in tables(record, tmp_path)}
        assert {"main.csv", "main_slip_1.csv", "main_normal_stress.csv"} <= names
        first = np.loadtxt(tmp_path / "main.csv", delimiter=",")
        np.testing.assert_allclose(first[:, :2], np.column_stack([data.position, data.dip]), rtol=1e-8)
        assert [len(each) for each in grid(data)] == [81, 41]
        # Columns of a fault begin at its lowest point: a map drawn from above would be upside down.
        upwards = data.isel(point=np.arange(3321).reshape(81, 41)[:, ::-1].ravel())
        for each in (data, upwards):
            strike, dip = np.meshgrid(*grid(each), indexing="ij")
            np.testing.assert_allclose(strike.ravel(), each.position, atol=0.1)
            np.testing.assert_allclose(dip.ravel(), each.dip, atol=0.1)
        assert grid(data.isel(point=np.random.default_rng(0).permutation(3321))) is None
        radius = np.hypot(data.position.values, data.dip.values - 10e3)
        velocity = rupture_velocity(data).ravel()
        away = (radius > 6e3) & np.isfinite(velocity)
        # At the rim differences are one-sided: there the error is of first order.
        np.testing.assert_allclose(velocity[away], speed, rtol=0.1)
        assert found["rupture_speed"] == pytest.approx(speed, rel=0.01)
        assert found["supershear_share"] == pytest.approx(regime, abs=0.03)
        area = 40e3 * 20e3
        assert found["rupture_area"] == pytest.approx(area, rel=1e-9)
        slip = 10.0 - radius / speed
        moment = 32e9 * float(data.area.values @ slip)
        assert found["moment"] == pytest.approx(moment, rel=1e-9)
        assert found["moment_magnitude"] == pytest.approx((np.log10(moment) - 9.1) / 1.5)
        assert found["max_slip"] == pytest.approx(10.0)
        np.testing.assert_allclose(moment_rate(data)[-1], 32e9 * area, rtol=1e-9)
        assert f"magnitude {found['moment_magnitude']:.2f}" in verdict(found)


def test_points_without_a_grid_have_no_speed(tmp_path):
    with Record(synthetic.write_surface_run(tmp_path / "run", structured=False)) as record:
        found = analysis.summarise(record)
        assert grid(record.interface) is None and "rupture_speed" not in found
        assert found["rupture_area"] > 0 and found["moment_magnitude"] > 6
