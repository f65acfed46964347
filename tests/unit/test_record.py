"""Reading run directories: finished, killed, damaged, or no run at all."""

import shutil
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray
from helpers import synthetic
from helpers.messages import facts

from ruptfx import RuptfxError, lumped
from ruptfx.input.former_names import FormerName
from ruptfx.results.record import Files, Record, RecordError

TIME, POSITION = synthetic.times(31), synthetic.points(20)


@pytest.fixture
def run(tmp_path):
    return synthetic.write_run(tmp_path / "run", synthetic.crack(TIME, POSITION), TIME, POSITION)


def test_a_complete_run(run):
    with Record(run) as record:
        assert record.complete and record.summary == {"mode": "crack"}
        assert record.case["plane"] == "stress"
        assert record.interface["slip_rate"].dims == ("time", "position")
        assert record.interface["slip_rate"].attrs["units"] == "m/s"
        np.testing.assert_array_equal(record.interface["position"], POSITION)
        # The rate is 2 m/s at 10 mm from 5 us + 11 mm / 2100 m/s = 10.2 us on.
        rate = record.interface["slip_rate"].sel(position=0.01, method="nearest")
        np.testing.assert_allclose(rate.sel(time=slice(10.5e-6, None)), 2.0)
        assert list(record.interfaces) == ["main"]
        assert record.figures == []


def test_bulk_is_named_and_lazy(run):
    with Record(run) as record:
        bulk = record.bulk
        assert bulk["stress"].dims == ("time", "point", "stress_component")
        assert bulk["stress"].attrs["units"] == "Pa"
        np.testing.assert_array_equal(bulk["stress"].sel(stress_component="yy"), -6e6)
        # 6 MPa of compression and shear s: sqrt(6^2 + 4 s^2) MPa.
        shear = bulk["stress"].sel(stress_component="xy").isel(time=3).values
        np.testing.assert_allclose(bulk["fringe"].isel(time=3), np.hypot(6e6, 2 * shear))
        assert bulk["cells"].shape == (2 * 100 * 20, 4)
        # Pieces are read without the whole.
        assert not bulk["velocity"].variable._in_memory


@pytest.mark.parametrize("reader", [Files, Record])
def test_a_run_of_the_last_version_is_read_by_the_names_of_this_one(tmp_path, reader):
    run = synthetic.write_run(tmp_path / "run", synthetic.crack(TIME, POSITION), TIME, POSITION, slides=True)
    with reader(run) as record:
        expected = record.energy["damping"].values, record.interface["paired_x"].values
    table = (run / "energy.csv").read_text()
    (run / "energy.csv").write_text(table.replace("damping", "impact"))
    with h5py.File(run / "interface.h5", "a") as file:
        for name in ("x", "y", "position"):
            file.move(f"paired_{name}", f"facing_{name}")
    with reader(run) as record:
        with pytest.warns(FormerName, match="'impact'.*'impact_loss'"):
            np.testing.assert_array_equal(record.energy["impact_loss"].values, expected[0])
        with pytest.warns(FormerName, match="'facing_x'.*'paired_x'"):
            np.testing.assert_array_equal(record.interface["paired_x"].values, expected[1])
        assert "impact" not in record.energy and "facing_x" not in record.interface


@pytest.mark.parametrize("whole", [True, False])
def test_files_hold_the_numbers_of_a_record(tmp_path, whole):
    run = synthetic.write_run(tmp_path / "run", synthetic.crack(TIME, POSITION), TIME, POSITION)
    if not whole:  # killed: the last saved times were never filled in
        for name in ("interface.h5", "bulk.h5"):
            with h5py.File(run / name, "a") as file:
                file["time"][-2:] = 0.0
    with Files(run) as plain, Record(run) as record:
        for what in ("interface", "bulk", "energy"):
            found, wanted = getattr(plain, what), getattr(record, what)
            names = [*wanted.data_vars, *(set(wanted.coords) - {"component", "stress_component"})]
            assert set(found) == set(names)
            for name in names:
                np.testing.assert_array_equal(found[name].values, wanted[name].values)
                assert (found[name].dims, found[name].shape) == (wanted[name].dims, wanted[name].shape)
            assert found.sizes == dict(wanted.sizes)
            for key, value in wanted.attrs.items():
                np.testing.assert_array_equal(found.attrs[key], value)
        for time in (-1, slice(1, 3), np.array([2, 0])):
            for name in ("velocity", "body"):
                wanted = record.bulk[name].isel(time=time) if name == "velocity" else record.bulk[name]
                np.testing.assert_array_equal(plain.bulk[name].isel(time=time).values, wanted.values)


@pytest.mark.slow
def test_the_end_of_a_run_needs_neither_xarray_nor_dolfinx_nor_mpi(tmp_path):
    """Its import would take longer than all that is read; all figures are drawn, and one is saved."""
    run = synthetic.write_run(tmp_path / "run", synthetic.crack(TIME, POSITION), TIME, POSITION, slides=True)
    program = (
        "import sys; sys.modules.update(dict.fromkeys(['dolfinx', 'mpi4py', 'petsc4py', 'basix', 'ufl']))\n"
        "from ruptfx import plots; from ruptfx.results.analysis import summarise\n"
        "from ruptfx.results.record import Files\n"
        f"with Files({str(run)!r}) as record:\n"
        "    summarise(record); plots.save_all(record, only=['fringes'])\n"
        "    print(*[name for name in plots.all_figures(record) if plots.FIGURES[name](record) is not None])\n"
        "print(sorted({'xarray', 'pandas', 'matplotlib.pyplot'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=600)
    *drawn, late = done.stdout.split()
    assert late == "[]", done.stderr
    assert {path.stem for path in (run / "figures").glob("*.png")} == {"fringes"}
    assert set(drawn) >= {"wavefield", "instruments", "surfaces", "contact", "forces", "fringes"}, drawn


def test_antiplane_components(tmp_path):
    run = synthetic.write_run(tmp_path / "run", synthetic.crack(TIME, POSITION), TIME, POSITION, plane="antiplane")
    with Record(run) as record:
        assert list(record.bulk["component"].values) == ["z"]
        assert list(record.bulk["stress_component"].values) == ["xz", "yz"]


def test_energy(run):
    with Record(run) as record:
        energy = record.energy
        # 100 J/m at the end, 0.4 of it kinetic.
        assert float(energy["kinetic"][-1]) == pytest.approx(40)
        assert energy["kinetic"].attrs["units"] == "J/m" and energy["time"].attrs["units"] == "s"


def test_several_interfaces(run):
    (run / "interface.h5").rename(run / "interface_lower.h5")
    shutil.copy(run / "interface_lower.h5", run / "interface_upper.h5")
    with h5py.File(run / "interface_upper.h5", "a") as file:
        file.attrs["fault"] = "upper"
    with Record(run) as record:
        assert list(record.interfaces) == ["main", "upper"]
        assert record.interface is record.interfaces["main"]


@pytest.mark.parametrize("first, second", [("main", "upper"), ("upper", "main")])
def test_the_first_interface_of_the_case_comes_first(run, first, second):
    test_several_interfaces(run)
    with (run / "case.toml").open("a") as file:
        file.write("".join(f'\n[faults.{name}.contact]\nkind = "split_node"\n' for name in (first, second)))
    with Record(run) as record:
        assert list(record.interfaces) == [first, second]
        assert record.interface is record.interfaces[first]


def test_a_record_can_be_closed_and_used_again(run):
    record = Record(run)
    first = record.interface["slip"].values
    record.close()
    np.testing.assert_array_equal(record.interface["slip"].values, first)
    assert record.bulk.sizes["time"] == 6
    record.close()


def test_repr_is_a_tree(run):
    (run / "figures").mkdir()
    (run / "figures" / "front.png").write_bytes(b"")
    lines = repr(Record(run)).splitlines()
    assert "complete" in lines[0] and len(lines) == 7
    assert "81 points x 31 times" in lines[2] and "front.png" in lines[-1]
    assert max(map(len, lines[1:])) < 80


def test_a_killed_run(tmp_path):
    run = synthetic.write_run(tmp_path / "run", synthetic.crack(TIME, POSITION), TIME, POSITION, complete=False)
    # The last row of the table is cut, and the last saved times were never filled in.
    text = (run / "energy.csv").read_text()
    (run / "energy.csv").write_text(text.rstrip()[:-60])
    with h5py.File(run / "interface.h5", "a") as file:
        file["time"][-3:] = 0.0
    with Record(run) as record:
        assert not record.complete and record.summary is None
        assert record.interface.sizes["time"] == 28
        assert record.energy.sizes["time"] == 30
        assert "not complete" in repr(record) and "none yet" in repr(record)


def test_a_run_that_is_being_written_can_be_read(run):
    # Another process holds the file open for writing, as the run itself does.
    hold = "import h5py, sys; f = h5py.File(sys.argv[1], 'a'); f['slip'][0] = 0; f.flush()"
    hold += "; print('open', flush=True); input()"
    command = [sys.executable, "-c", hold, str(run / "interface.h5")]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as writer:
        assert writer.stdout.readline() == "open\n"
        with Record(run) as record:
            assert record.interface.sizes["time"] == 31
        writer.communicate("\n")


@pytest.mark.parametrize(("make", "message"), [(False, "no such directory"), (True, "no case.toml")])
def test_no_run(tmp_path, make, message):
    path = tmp_path / "nothing"
    if make:
        path.mkdir()
    with pytest.raises(RuptfxError, match=facts(message)):
        Record(path)


@pytest.mark.parametrize(
    ("name", "ask"),
    [
        ("interface.h5", lambda record: record.interface),
        ("bulk.h5", lambda record: record.bulk),
        ("energy.csv", lambda record: record.energy),
    ],
)
def test_missing_and_damaged_files_are_named(run, name, ask):
    content = (run / name).read_bytes()
    (run / name).unlink()
    with pytest.raises(RecordError, match=facts(rf"{name}: missing; if the run .* run the case again")):
        ask(Record(run))
    assert "missing" in repr(Record(run))
    with pytest.raises(RecordError, match=facts(r"events.h5: missing; only runs with \[fracture\]")):
        _ = Record(run).events
    (run / name).write_bytes(b"time,kinetic\n1,what\n" if name == "energy.csv" else content[: len(content) // 3])
    with pytest.raises(RecordError, match=facts(rf"{name}: damaged")):
        ask(Record(run))
    assert "damaged" in repr(Record(run))


@pytest.mark.parametrize(
    ("name", "ask"), [("case.toml", lambda record: record.case), ("summary.json", lambda record: record.summary)]
)
def test_damaged_text_is_named(run, name, ask):
    (run / name).write_text("= {")
    with pytest.raises(RecordError, match=facts(rf"{name}: damaged")):
        ask(Record(run))


@pytest.mark.parametrize("text", ["x = " + 5000 * "[" + 5000 * "]", "x = 1" + 5000 * "0", "a" + 50_000 * ".a" + " = 1"],
                         ids=["brackets", "integer", "levels"])  # fmt: skip
def test_case_files_that_no_reader_can_hold_are_refused_by_records(run: Path, tmp_path: Path, text: str) -> None:
    """The parser alone raises RecursionError, or takes minutes and gigabytes for 50 000 levels."""
    (run / "case.toml").write_text(text)
    with pytest.raises(RecordError, match=facts(r"case\.toml: damaged")):
        _ = Record(run).case
    (tmp_path / "lumped").mkdir()
    (tmp_path / "lumped" / "case.toml").write_text(text)
    xarray.Dataset().to_netcdf(tmp_path / "lumped" / "result.nc", engine="h5netcdf")
    with pytest.raises(RuptfxError, match=facts(r"lumped: case\.toml is missing or damaged")):
        lumped.redraw(tmp_path / "lumped")
