"""Files of a run with pore pressure and temperature: export, figures, and studies over a key of a field."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
import tomli_w
from helpers.small_cases import case, plates

pytest.importorskip("dolfinx")

from ruptfx.app.convert import vtk_files
from ruptfx.many_runs.study.definition import read_study
from ruptfx.many_runs.study.execute import run_study
from ruptfx.platform import fem
from ruptfx.results import plots
from ruptfx.results.record import Record
from ruptfx.run.simulation import simulate

pytestmark = [
    pytest.mark.fem, pytest.mark.skipif(fem.MPI.COMM_WORLD.size > 1, reason="files are written by the first rank"),
]  # fmt: skip

HEATED = {
    "order": 2, "duration": 4e-6, "mesh.element_size": 2e-3, "output": {"figures": False, "interface_interval": 1e-6},
    "faults.main.contact": {"kind": "compliant", "C_n": 1e14, "C_s": 1e14},
    "faults.main.friction": {"kind": "coulomb", "mu_d": 0.4},
    "faults.main.initial_stress": {"normal": 6e6, "shear": 3e6},
    "faults.main.pore_pressure": {
        "kind": "thermal_pressurisation", "heat_capacity": 2.7e6, "thermal_diffusivity": 1e-6,
        "hydraulic_diffusivity": 4e-4, "pressure_per_temperature": 1e6, "width": 1e-6,
    },
    "faults.main.temperature": {"kind": "given", "temperature": 300.0},
}  # fmt: skip


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("heated") / "run"
    simulate(case(HEATED), out, progress=False)
    return out


def test_exported_fields_are_those_of_the_record(run: Path, tmp_path: Path) -> None:
    with Record(run) as record:
        data = record.interface
        assert data["temperature"].values[-1].max() > 300.0 and data["pore_pressure"].values[-1].max() > 0
        paths = [path for path in vtk_files.whole(record, tmp_path) if "bulk" not in path.name]
        with h5py.File(paths[0]) as file:
            root = file["VTKHDF"]
            for name in ("pore_pressure", "temperature", "frictional_heat"):
                rows = root[f"PointData/{name}"][:].reshape(data[name].shape)
                np.testing.assert_array_equal(rows, data[name].values)


def test_profiles_show_both_fields(run: Path) -> None:
    """By default beside the slip; the last line is that of the last record."""
    with Record(run) as record:
        data = record.interface
        axes = plots.slip_profiles(record).figure.axes
        shown = {name: ax for ax in axes for name in ("Pore pressure", "Temperature") if name in ax.get_ylabel()}
        assert set(shown) == {"Pore pressure", "Temperature"}
        heights = shown["Temperature"].lines[-1].get_ydata()
        np.testing.assert_allclose(heights, data["temperature"].values[-1], rtol=1e-12)


@pytest.mark.slow
def test_a_study_varies_a_key_of_a_field(tmp_path: Path) -> None:
    """The runs of its points have the pressures of the axis."""
    base = {key: value for key, value in HEATED.items() if "temperature" not in key}
    table = plates({**base, "faults.main.pore_pressure": {"kind": "given", "pressure": 1e6}})
    (tmp_path / "case.toml").write_text(tomli_w.dumps(table))
    (tmp_path / "study.toml").write_text(
        'case = "case.toml"\nkeep = ["run"]\n'
        '[[axes]]\nname = "p"\nkey = "faults.main.pore_pressure.pressure"\nunit = "Pa"\nvalues = [1e6, 2e6]\n'
    )
    run_study(read_study(tmp_path / "study.toml"), tmp_path / "out", show=False, cores=1)
    pressures = []
    for path in sorted((tmp_path / "out").glob("**/interface.h5")):
        with Record(path.parent) as record:
            pressures.append(np.unique(record.interface["pore_pressure"].values[-1]).tolist())
    assert sorted(pressures) == [[1e6], [2e6]]
