"""Numbers of a circular rupture at constant speed, whose moment, area and speed are known."""

import numpy as np
import pytest
import xarray
from helpers import synthetic

from ruptfx import Record
from ruptfx.app.commands.export import tables
from ruptfx.results import analysis
from ruptfx.results.analysis.surface import (
    grid,
    moment,
    moment_rate,
    radiated_energy,
    rupture_time_difference,
    rupture_velocity,
    stress_drop,
)
from ruptfx.results.analysis.verdict import verdict


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
        by_height = np.argsort(np.abs(np.arange(41) - 20), kind="stable")  # of a paraboloid
        assert grid(data.isel(point=np.arange(3321).reshape(81, 41)[:, by_height].ravel())) is None
        radius = np.hypot(data.position.values, data.dip.values - 10e3)
        velocity = rupture_velocity(data)[0]
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


def test_points_without_a_grid_have_the_same_speed(tmp_path):
    """A circular front at 2500 m/s, below c_s = 3464 m/s, on points of which every seventh is missing."""
    with Record(synthetic.write_surface_run(tmp_path / "run", structured=False)) as record:
        found = analysis.summarise(record)
        assert grid(record.interface) is None
        assert found["rupture_speed"] == pytest.approx(2500.0, rel=0.01) and found["supershear_share"] < 0.03
        assert found["rupture_area"] > 0 and found["moment_magnitude"] > 6


def test_the_rupture_speed_does_not_depend_on_the_axes(tmp_path):
    """Turned by 0.4 rad in the plane of the surface, the points form no grid, and have the same speeds."""
    with Record(synthetic.write_surface_run(tmp_path / "run")) as record:
        data = record.interface.load()
    turned, c, s = data.copy(deep=True), np.cos(0.4), np.sin(0.4)
    for new, old, sign in (("position", "dip", -1), ("dip", "position", 1)):
        turned[new] = c * data[new] + sign * s * data[old]
    turned["x"], turned["z"] = turned["position"], -turned["dip"]
    assert grid(data) is not None and grid(turned) is None
    np.testing.assert_allclose(rupture_velocity(turned)[0], rupture_velocity(data)[0], rtol=1e-9)


def test_the_modulus_of_the_moment_is_that_of_the_points_and_of_the_direction_of_slip(tmp_path):
    """Moduli of 10 and 30 GPa along both tangents, coupled by 5 GPa, twice that in the lower half: slip at 45 degrees
    has the modulus (10 + 30) / 2 + 5 = 25 GPa in the upper half, 50 GPa in the lower one."""
    with Record(synthetic.write_surface_run(tmp_path / "run")) as record:
        data = record.interface.load()
    lower = 1.0 + (data.dip.values > 10e3)
    for index, modulus in (("11", 10e9), ("22", 30e9), ("12", 5e9)):
        data[f"shear_modulus_{index}"] = ("point", modulus * lower)
    for name in ("slip", "slip_rate"):
        data[f"{name}_1"] = data[f"{name}_2"] = data[f"{name}_1"] / np.sqrt(2)
    area, slip, rate = (data[name].values for name in ("area", "slip_1", "slip_rate_1"))
    assert moment(data) == pytest.approx(25e9 * float((lower * area) @ slip[-1]) * np.sqrt(2), rel=1e-12)
    assert moment_rate(data)[-1] == pytest.approx(25e9 * float((lower * area) @ rate[-1]) * np.sqrt(2), rel=1e-12)


def resting_crack(drop, weakening=0.0):
    """A circular crack of 1 km radius in a grid, nu = 1/4: slip 24 / (7 pi) d / mu sqrt(a^2 - r^2) by a drop d.

    The second record is the end; the residual traction is 3 MPa, and `weakening` [J/m2] is spent above it. Source:
    Eshelby (1957).
    """
    x = np.linspace(-1.2e3, 1.2e3, 401)
    strike, dip = (each.ravel() for each in np.meshgrid(x, x, indexing="ij"))
    r = np.hypot(strike, dip)
    slip = 24 / (7 * np.pi) * 2e6 / 32e9 * np.sqrt(np.maximum(1e6 - r**2, 0))
    area = np.full(len(r), (x[1] - x[0]) ** 2)
    fall = drop(r)
    fields = {
        "slip_1": slip,
        "slip_2": 0 * r,
        "slip_rate_1": 0 * r,
        "slip_rate_2": 0 * r,
        "opening": 0 * r,
        "shear_traction_1": 3e6 + 0 * r,
        "shear_traction_2": 0 * r,
        "normal_stress": 1e7 + 0 * r,
    }
    before = dict.fromkeys(fields, 0 * r) | {
        "shear_traction_1": 3e6 + fall, "normal_stress": 1e7 + 0 * r, "slip_rate_1": (slip > 0) * 1.0
    }  # fmt: skip
    data = xarray.Dataset(
        {name: (("time", "point"), np.stack([before[name], fields[name]])) for name in fields}
        | {name: ("point", values) for name, values in (("position", strike), ("dip", dip), ("area", area))},
        {"time": [0.0, 1.0]}, attrs={"shear_modulus_of_bodies": [32e9, 32e9]},
    )  # fmt: skip
    friction = float(area @ (3e6 * slip)) + weakening
    work = float(area @ ((3e6 + fall) * slip))
    names = {"kinetic": 0.0, "strain": 0.5 * (work - friction), "frictional_dissipation": friction,
             "boundary_work": work, "closure": 0.0}  # fmt: skip
    return data, {name: np.array([0.0, value]) for name, value in names.items()}


def test_stress_drop_is_weighted_with_the_slip():
    """Of d (r / a)^2 under elliptical slip it is 2/5 d: the integrals of r^3 sqrt(1 - r^2) and r sqrt(1 - r^2)."""
    assert stress_drop(resting_crack(lambda r: 2e6 + 0 * r)[0]) == pytest.approx(2e6, rel=1e-12)
    assert stress_drop(resting_crack(lambda r: 2e6 * (r / 1e3) ** 2)[0]) == pytest.approx(0.8e6, rel=1e-3)


def test_what_a_nucleation_adds_counts_in_the_stress_drop():
    """A traction that rises by 5 MPa while a nucleation adds 7 MPa has fallen by 2 MPa."""
    data = resting_crack(lambda r: -5e6 + 0 * r)[0]
    assert stress_drop(data) == pytest.approx(-5e6, rel=1e-12)
    added = {"added_shear_1": ("point", np.full(data.sizes["point"], 7e6)),
             "added_shear_2": ("point", np.full(data.sizes["point"], 3e6))}  # fmt: skip
    assert stress_drop(data.assign(added)) == pytest.approx(2e6, rel=1e-12)


def test_a_crack_radiates_what_fracture_does_not_take():
    """Half of the drop works on the slip: 8/7 d^2 a^3 / mu. Slow growth takes all of it: the mean of G over the rim,
    12 / (7 pi) d^2 r / mu, integrated over the area."""
    released, fracture = 8 / 7 * 2e6**2 * 1e9 / 32e9, 12 / (7 * np.pi) * 2e6**2 / 32e9 * 2 * np.pi / 3 * 1e9
    assert fracture == pytest.approx(released, rel=1e-12)
    for share in (0.0, 0.4, 1.0):
        data, energy = resting_crack(lambda r: 2e6 + 0 * r, share * fracture)
        assert radiated_energy([data], energy) == pytest.approx((1 - share) * released, abs=1e-3 * released)


@pytest.mark.parametrize("change", ["loaded", "sliding", "yields"])
def test_radiated_energy_is_not_given_where_the_records_do_not_tell(change):
    data, energy = resting_crack(lambda r: 2e6 + 0 * r)
    if change == "sliding":
        data["slip_rate_1"][1] = 0.1 * data["slip_rate_1"][0]
    else:
        energy["boundary_work" if change == "loaded" else "plastic"] = 1.01 * energy["boundary_work"]
    assert np.isnan(radiated_energy([data], energy))


def test_the_mean_difference_of_rupture_times_is_over_the_area() -> None:
    """A surface of 3 m x 1 m whose last column, which stands for half of the area, is 1 s late: sqrt(6 / 10) s."""
    x, dip = (each.ravel() for each in np.meshgrid([0.0, 1.0, 3.0], [0.0, 1.0], indexing="ij"))

    def data(times):
        columns = {"position": x, "dip": dip, "area": np.where(x == 3.0, 3.0, 1.0), "rupture_time": times}
        return xarray.Dataset({name: ("point", values) for name, values in columns.items()})

    difference = rupture_time_difference(data(1 + 0 * x), data(1 + 1.0 * (x == 3.0)))
    assert difference == pytest.approx((np.sqrt(6 / 10), 1.0))
