"""Stress, events and pieces of a specimen, from files whose content is known."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import tomli_w
import xarray
from helpers.messages import facts

from ruptfx.results import plots
from ruptfx.results.analysis import summarise
from ruptfx.results.analysis.compression import Loading, emission_of, fragments, loading, slowest
from ruptfx.results.record import Record

MODULUS, HEIGHT, WIDTH = 50e9, 0.1, 0.05
SHEAR_WAVE = 2773.5009811261457  # sqrt(E / (2 (1 + nu) rho)) = sqrt(50e9 / (2.5 x 2600)) [m/s]
ROCK = {"kind": "isotropic_elastic", "young_modulus": MODULUS, "poisson_ratio": 0.25, "density": 2600.0}


def write(
    path: Path, platens: bool = False, peak: bool = True, sign: float = 1.0, c_s: Sequence[float] = (SHEAR_WAVE,),
    bodies: Sequence[int] = (0, 0), **events: Any,
) -> Path:  # fmt: skip
    """Two triangles and the facet between them; a specimen that carries 100 MPa at 0.2 % and then a fifth less."""
    body = "steel" if platens else "specimen"
    path.mkdir()
    mesh: dict[str, Any] = {
        "kind": "specimen", "shape": {"kind": "rectangle", "width": WIDTH, "height": HEIGHT}, "element_size": 0.01,
    }  # fmt: skip
    if platens:
        mesh["platens"] = {"thickness": 4e-3, "body": body}
    (path / "case.toml").write_text(tomli_w.dumps({"plane": "stress", "mesh": mesh, "materials": {"default": ROCK}}))
    time = np.linspace(0, 1e-3, 101)
    strain = 3e-3 * time / time[-1]
    stress = MODULUS * np.minimum(strain, 2e-3) - (2e10 * np.maximum(strain - 2e-3, 0) if peak else 0)
    stress[5] = 40e6  # a wave: a maximum that says nothing
    half, force = sign * 0.5 * HEIGHT * strain, sign * WIDTH * stress
    rows = np.column_stack([time, half, force, -half, -force])
    names = [f"{body}.{side}.{what}_y" for side in ("bottom", "top") for what in ("displacement", "force")]
    np.savetxt(path / "edges.csv", rows, delimiter=",", header=",".join(["time", *names]), comments="")
    corners = np.array([[0, 0], [WIDTH, 0], [WIDTH, HEIGHT], [0, HEIGHT]])
    with h5py.File(path / "bulk.h5", "w") as file:
        file["points"], file["time"] = corners[[0, 1, 2, 0, 2, 3]], [0.0, 1e-3]
        file["cells"], file["body"] = [[0, 1, 2], [3, 4, 5]], np.zeros(6)
    with h5py.File(path / "cracks.h5", "w") as file:
        file["points"], file["lines"], file["length"] = corners[[0, 2]], [[0, 1]], [np.hypot(WIDTH, HEIGHT)]
        file["time"], file["status"] = [0.0, 1e-3], np.array([[0], [2]], dtype=np.int8)
        file["bodies"] = [bodies]
        if c_s:
            file.attrs["c_s_of_bodies"] = c_s
    count = len(events.get("time", []))
    names = ("x", "y", "time", "time_of_failure", "energy", "inclination", "length")
    table = {name: ("event", events.get(name, np.ones(count))) for name in names}
    modes = events.get("mode", np.array([], dtype=object))
    xarray.Dataset({**table, "mode": ("event", modes)}).to_netcdf(path / "events.h5", engine="h5netcdf")
    return path


@pytest.mark.parametrize("platens", [False, True])
def test_strength_and_modulus(platens: bool, tmp_path: Path) -> None:
    with Record(write(tmp_path / "run", platens)) as record:
        found = loading(record)
        assert found is not None and found.peak is not None
        assert found.stress[found.peak] == pytest.approx(100e6, rel=0.02)
        assert found.strain[found.peak] == pytest.approx(2e-3, rel=0.03)
        assert found.modulus == pytest.approx(MODULUS, rel=1e-6)


def test_the_modulus_is_that_between_20_and_50_percent_of_the_peak() -> None:
    """A curve of three slopes: 10 GPa until 19 MPa, 50 GPa until 51 MPa, 20 GPa until the peak of 100 MPa."""
    stress = np.linspace(0, 100e6, 401)
    strain = np.interp(stress, [0, 19e6, 51e6, 100e6], np.cumsum([0, 19e6 / 10e9, 32e6 / 50e9, 49e6 / 20e9]))
    assert Loading(np.arange(401.0), strain, stress, 400).modulus == pytest.approx(50e9, rel=1e-9)


def test_stress_between_edges_at_rest_has_no_modulus() -> None:
    """Waves along x reach edges that do not move yet."""
    assert np.isnan(Loading(np.arange(9.0), np.zeros(9), np.linspace(0, 1e6, 9), None).modulus)


def test_bodies_without_facets_do_not_slow_the_waves_of_cracks(tmp_path: Path) -> None:
    """c_s of platens, grains and matrix are 900, 2500 and 3000 m/s; the facet is between grains and matrix."""
    with Record(write(tmp_path / "run", c_s=[900.0, 2500.0, 3000.0], bodies=[1, 2])) as record:
        assert slowest(record.cracks, "c_s") == 2500.0


def test_without_wave_speeds_no_events_are_linked(tmp_path: Path) -> None:
    """A run of an earlier version: the b-value of clusters says why there is none; other results remain."""
    time = np.array([1e-4, 1.001e-4])
    seen = {"time": time, "time_of_failure": time, "energy": np.array([1e-6, 1e-6]), "x": np.zeros(2),
            "y": np.zeros(2), "mode": np.array(["tensile", "shear"], dtype=object)}  # fmt: skip
    with Record(write(tmp_path / "run", c_s=[], **seen)) as record:
        found = emission_of(record)
        assert len(found.linked) == 0 and len(found.seismic) == 2
        assert re.search(facts(r"cracks\.h5: .* c_s_of_bodies.*--link DISTANCE SPEED"), str(found.of_clusters))
        assert summarise(record)["events"] == 2 and summarise(record)["b_value"] is None
        assert len(emission_of(record, link=(1e-3, 1e3)).linked) == 1


@pytest.mark.parametrize("later, clusters", [(0.99, 1), (1.01, 2)])
def test_the_default_link_of_clusters(later: float, clusters: int, tmp_path: Path) -> None:
    """Two events at one place are one if the second comes before a wave at half the slowest speed has passed three
    facets: 3 x sqrt(0.05^2 + 0.1^2) m / (0.5 x 2773.5 m/s) = 241.87 us."""
    time = np.array([1e-4, 1e-4 + later * 241.87e-6])
    seen = {"time": time, "time_of_failure": time, "energy": np.array([1e-6, 1e-6]), "x": np.zeros(2),
            "y": np.zeros(2), "mode": np.array(["tensile", "shear"], dtype=object)}  # fmt: skip
    with Record(write(tmp_path / "run", **seen)) as record:
        assert len(emission_of(record).linked) == clusters


def test_the_tensile_share_depends_on_where_before_ends(tmp_path: Path) -> None:
    """Until 95, 98 and 100 % of the time of the peak 1 of 2, 2 of 4 and 2 of 5 events are tensile.

    The stress bends at 0.667 ms, and the maximum of its smoothed curve is the sample at 0.68 ms.
    """
    peak = 0.68e-3
    time = peak * np.array([0.5, 0.94, 0.96, 0.97, 0.99, 1.01])
    modes = np.array(["tensile", "shear", "tensile", "shear", "mixed", "tensile"], dtype=object)
    seen = {"time": time, "time_of_failure": time, "energy": np.full(6, 1e-6), "mode": modes,
            "x": 1e-2 * np.arange(6), "y": np.zeros(6)}  # fmt: skip
    with Record(write(tmp_path / "run", **seen)) as record:
        found, values = emission_of(record, failure_time=peak), summarise(record)
        nowhere = emission_of(record, failure_time=1e-9)
    assert found.tensile_shares == {0.95: 0.5, 0.98: 0.5, 1.0: 0.4}
    assert values["tensile_share_until_95"] == 0.5 and values["tensile_share"] == 0.4
    assert np.isnan(list(nowhere.tensile_shares.values())).all()


def test_a_curve_that_only_rises_has_no_peak(tmp_path: Path) -> None:
    with Record(write(tmp_path / "run", peak=False)) as record:
        found, values = loading(record), summarise(record)
    assert found is not None and found.peak is None
    assert values["first_peak_stress"] is None and values["largest_stress"] == pytest.approx(100e6)
    assert values["tensile_share_until_95"] is None and values["tensile_share_until_98"] is None


def test_a_specimen_that_is_pulled_has_a_peak_as_well(tmp_path: Path) -> None:
    path = write(tmp_path / "run")
    lines = (path / "edges.csv").read_text().splitlines()
    rows = -np.array([line.split(",") for line in lines[1:]], dtype=float)
    rows[:, 0] *= -1
    np.savetxt(path / "edges.csv", rows, delimiter=",", header=lines[0], comments="")
    with Record(path) as record:
        found, values = loading(record), summarise(record)
    assert found is not None and found.peak is not None and found.modulus == pytest.approx(MODULUS, rel=1e-6)
    assert values["first_peak_stress"] == pytest.approx(-100e6, rel=0.02)
    assert values["largest_stress"] == pytest.approx(100e6, rel=0.01)


def test_events_before_the_peak_are_counted(tmp_path: Path) -> None:
    """Of six, one comes after it, one radiates nothing and one too little; two of the others are one cluster."""
    seen = {
        "time": np.array([1e-4, 1.0001e-4, 3e-4, 4e-4, 5e-4, 9e-4]),
        "energy": np.array([1e-6, 2e-6, 4e-6, 0, 1e-12, 1e-6]),
        "x": np.array([0.0, 1e-3, 4e-2, 0, 0, 0.0]), "y": np.array([0.0, 0, 0.9, 0, 0, 0.0]),
        "mode": np.array(["tensile", "tensile", "shear", "shear", "shear", "mixed"], dtype=object),
    }  # fmt: skip
    seen["time_of_failure"] = seen["time"]
    with Record(write(tmp_path / "run", **seen)) as record:
        found, values = emission_of(record, link=(5e-3, 1e3)), summarise(record)
    assert found.before.tolist() == [True] * 5 + [False] and len(found.seismic) == 3
    assert found.shares == {"tensile": pytest.approx(2 / 3), "shear": pytest.approx(1 / 3), "mixed": 0.0}
    assert sorted(found.linked.energy) == pytest.approx([1e-6, 3e-6, 4e-6])
    assert values["events"] == 6 and values["events_before_peak"] == 3
    assert values["aseismic_share"] == pytest.approx(0.4)
    assert values["b_value"] is None and values["fractal_dimension"] is None  # too few
    assert values["largest_magnitude"] == pytest.approx(2 / 3 * (np.log10(4e-6) - 4.8))


def test_a_failed_facet_parts_two_triangles(tmp_path: Path) -> None:
    path = write(tmp_path / "run")
    with Record(path) as record:
        assert fragments(record) == 2
    with h5py.File(path / "cracks.h5", "a") as file:
        file["status"][:] = 1
    with Record(path) as record:
        assert fragments(record) == 1


@pytest.mark.parametrize("sign, way", [(1.0, "Compressive"), (-1.0, "Tensile")])
def test_the_figure_has_stress_over_strain_in_percent(sign: float, way: str, tmp_path: Path) -> None:
    """50 GPa up to 0.2 %, the force against the approach of the ends or their distance; one failure at 0.15 %."""
    event = {"time": [5e-4], "time_of_failure": [5e-4], "energy": [1e-6], "mode": ["tensile"]}
    with Record(write(tmp_path / "run", sign=sign, **event)) as record:
        axes = plots.emission(record, field="load", units={"stress": "kPa"})
        strain, stress = axes.lines[0].get_data()
        rising = (strain > 0.03) & (strain < 0.19)
        np.testing.assert_allclose(stress[rising], 5e5 * strain[rising], rtol=1e-6)
        assert (axes.get_xlabel(), axes.get_ylabel()) == (f"{way} strain (%)", f"{way} stress (kPa)")
        (count,) = axes.figure.axes[1].lines
        np.testing.assert_allclose([*count.get_xdata(), *count.get_ydata()], [0.15, 1.0], rtol=1e-6)
