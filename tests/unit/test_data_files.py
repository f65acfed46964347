"""Files of laboratories: contents, guesses, mappings, in every format; what cannot be read is refused."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
import tomli_w
import xarray
from helpers.messages import facts
from helpers.small_cases import merged, plates
from typer.testing import CliRunner

from ruptfx.app.cli import app
from ruptfx.case import parse_case
from ruptfx.input.data_files import Column, Variable, as_csv, contents, events_of, mapped, mapping_of
from ruptfx.input.data_guesses import guess, proposal
from ruptfx.input.schema import CaseError, load_toml

COUNT = 200
TIME = np.arange(COUNT) * 1e-6
STRAIN = 1e-6 * np.column_stack([np.sin(TIME * 1e5), np.cos(TIME * 1e5), 300 * TIME / TIME[-1]])


def write(path: Path) -> Path:
    """The same signals in the format of an ending: micrometres per metre, microseconds."""
    us, ue = TIME * 1e6, STRAIN * 1e6
    match path.suffix:
        case ".csv":
            rows = np.column_stack([us, ue])
            np.savetxt(path, rows, fmt="%.17g", delimiter=",", header="t (us),a (um/m),b (um/m),c (um/m)", comments="")
        case ".nc":
            data = {"strain": (("time", "gauge"), ue, {"units": "um/m"}), "t": ("time", us, {"units": "us"})}
            xarray.Dataset(data).to_netcdf(path, engine="h5netcdf")
        case ".h5":
            with h5py.File(path, "w") as file:
                file["run1/strain"], file["run1/t"] = ue.T, us
                file["run1/strain"].attrs["units"], file["run1/t"].attrs["units"] = "um/m", "us"
        case ".mat":  # version 7.3: axes in reverse order
            with h5py.File(path, "w") as file:
                for name, values in {
                    "strain": ue.T,
                    "t": us[None, :],
                    "fs": [[1e6]],
                    "xpos": [[10.0, 20.0, 30.0]],
                }.items():
                    file[name] = values
                    file[name].attrs["MATLAB_class"] = np.bytes_("double")
                file["note"] = np.array([[104, 105]], dtype=np.uint16)
                file["note"].attrs["MATLAB_class"] = np.bytes_("char")
    return path


MAPS = {
    ".csv": {"time": Column(variable="t"), "extension_1": Column(variable="c", sign=-1)},
    ".nc": {"time": Column(variable="t"), "extension_1": Column(variable="strain", column=3, sign=-1)},
    ".h5": {"time": Column(variable="run1/t"), "extension_1": Column(variable="run1/strain", column=3, sign=-1)},
    ".mat": {
        "time": Column(variable="t", unit="us"), "extension_1": Column(variable="strain", column=3, unit="ue", sign=-1),
    },
}  # fmt: skip


@pytest.mark.parametrize("ending", MAPS)
def test_one_mapping_for_every_format(ending: str, tmp_path: Path) -> None:
    times, data, units = mapped(write(tmp_path / f"event{ending}"), MAPS[ending])
    np.testing.assert_allclose(times, TIME, rtol=1e-14, atol=1e-20)
    np.testing.assert_allclose(data["extension_1"], -1e6 * STRAIN[:, 2], rtol=1e-12)
    assert units["extension_1"] in ("um/m", "ue")


def test_matlab_files_before_version_7_3(tmp_path: Path) -> None:
    from scipy.io import savemat

    savemat(tmp_path / "old.mat", {"strain": STRAIN * 1e6, "t": TIME[:, None]})
    found = {each.name: each.shape for each in contents(tmp_path / "old.mat")}
    assert found == {"strain": (COUNT, 3), "t": (COUNT,)}


def test_contents_and_guesses(tmp_path: Path) -> None:
    """Microseconds with a rate of 1 MHz; strains of 300 are um/m; positions of 30 are mm; text is no array."""
    variables = contents(write(tmp_path / "event.mat"))
    shapes = {each.name: each.shape for each in variables}
    assert shapes == {"strain": (COUNT, 3), "t": (COUNT,), "fs": (1,), "xpos": (3,)}
    guesses = {each.name: guess(each, COUNT) for each in variables}
    time = guesses["t"]
    assert (time.kind, time.unit, time.is_guess) == ("time", "us", True) and time.rate == pytest.approx(1e6)
    assert {name: (each.kind, each.unit) for name, each in guesses.items() if name != "t"} == {
        "strain": ("strain", "um/m"), "fs": ("rate", "Hz"), "xpos": ("positions", "mm"),
    }  # fmt: skip
    entry = load_toml("\n".join(proposal(variables, "G1")))["objective"][0]
    assert entry["map"]["time"] == {"variable": "t", "unit": "us"} and entry["instrument"] == "G1"
    assert entry["map"]["strain_3"] == {"variable": "strain", "column": 3, "unit": "um/m", "sign": 1}
    assert set(entry["map"]) == {"time", "strain_1", "strain_2", "strain_3"}


@pytest.mark.parametrize(("name", "values", "kind", "unit"), [
    ("slip", np.linspace(0, 40, 50), "displacement", "um"), ("slip", np.linspace(0, 1e-4, 50), "displacement", "m"),
    ("tau", np.linspace(5, 6, 50), "stress", "MPa"), ("V", np.linspace(5, 6, 50) ** 2, "", ""),
    ("eps_xy", np.sin(np.arange(50)) * 1e-3, "strain", "1"), ("time", np.arange(50) * 2e-5, "time", "s"),
])  # fmt: skip
def test_a_unit_is_guessed_by_name_and_size(
    name: str, values: np.ndarray, kind: str, unit: str, tmp_path: Path
) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file[name] = values if name == "time" else values * (1 + 1e-2 * np.cos(np.arange(50)))
    (variable,) = contents(tmp_path / "a.h5")
    known = guess(variable, 50)
    assert (known.kind, known.unit) == (kind, unit)


def test_the_proposed_noise_is_the_scatter_between_samples() -> None:
    """Noise of 3 um/m on a smooth signal: within 20 % for 400 samples; none where nothing scatters."""
    noise = np.random.default_rng(3).normal(0, 3.0, 400)
    signal = 500 * np.sin(np.arange(400) / 60) + noise
    lines = proposal([Variable("strain", (400,), "um/m", signal)])
    sigma = load_toml("\n".join(lines))["objective"][0]["sigma"]
    assert float(sigma.split()[0]) == pytest.approx(3.0, rel=0.2) and sigma.endswith("um/m")
    assert load_toml("\n".join(proposal([Variable("slip", (9,), "m", np.ones(9))])))["objective"][0]["sigma"] == 1.0


def test_arrays_of_several_instruments_have_an_entry_each(tmp_path: Path) -> None:
    """Two gauges of two grids with noise of 2 um/m, in the unit of the file; the case reads the entries as they are."""
    random, names = np.random.default_rng(1), [f"{gauge} {angle} deg" for gauge in ("G1", "G2") for angle in (0, 90)]
    noisy = 50 * TIME[:, None] / TIME[-1] + 2 * random.normal(size=(COUNT, 4))
    np.savetxt(tmp_path / "both.csv", np.column_stack([1e6 * TIME, noisy]), fmt="%.17g", delimiter=",", comments="",
               header=",".join(["time (us)", *(f"{name} (ue)" for name in names)]))  # fmt: skip
    entries = load_toml("\n".join(proposal(contents(tmp_path / "both.csv"), file="both.csv")))["objective"]
    assert [(each["instrument"], list(each["map"])) for each in entries] == [
        (gauge, ["time", "0 deg", "90 deg"]) for gauge in ("G1", "G2")
    ]
    assert all(float(each["sigma"].split()[0]) == pytest.approx(2.0, rel=0.2) for each in entries)
    gauges = [{**GAUGE, "name": gauge, "angles": [0.0, 90.0]} for gauge in ("G1", "G2")]
    case = parse_case(merged(plates(), {"instruments": gauges, "objective": entries, "duration": 1e-3}), tmp_path)
    np.testing.assert_allclose(case.objective[1].measured()[0].values, 1e-6 * noisy[:, 2], rtol=1e-12)
    # One instrument, and names without a common pattern: one entry.
    for chosen, count in (("G1", 4), (None, 1)):
        variables = contents(tmp_path / "both.csv")[: count + 1]
        (entry,) = load_toml("\n".join(proposal(variables, chosen)))["objective"]
        assert len(entry["map"]) == 1 + count


def test_a_rate_in_place_of_times(tmp_path: Path) -> None:
    path = write(tmp_path / "event.mat")
    columns = {**MAPS[".mat"], "time": Column(rate=50e3, start=-1e-3)}
    times, _, _ = mapped(path, columns)
    np.testing.assert_allclose(times[[0, -1]], [-1e-3, -1e-3 + 199 * 20e-6], rtol=1e-12)


@pytest.mark.parametrize(("change", "message"), [
    ({"extension_1": Column(variable="strains", unit="ue")}, "map.extension_1.variable = 'strains'.*strain"),
    ({"extension_1": Column(variable="strain", column=4, unit="ue")}, "map.extension_1.column = 4.* 3"),
    ({"extension_1": Column(variable="strain")}, "map.extension_1.*strain.*unit"),
    ({"time": Column(variable="t", unit="MPa")}, "map.time.unit = 'MPa'"),
    ({"extension_1": Column(variable="xpos", unit="ue")}, "map.extension_1.* 3 .* 200"),
])  # fmt: skip
def test_a_mapping_that_does_not_fit_is_refused(change: dict[str, Column], message: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=facts(message)):
        mapped(write(tmp_path / "event.mat"), {**MAPS[".mat"], **change})


def test_a_damaged_file_and_an_unknown_ending_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.mat").write_bytes(b"MATLAB 7.3 MAT-file" + bytes(600))
    (tmp_path / "a.xlsx").write_bytes(b"PK")
    for name in ("a.mat", "a.xlsx"):
        with pytest.raises(ValueError, match=facts(name)):
            contents(tmp_path / name)


GAUGE = {"kind": "strain_gauge", "name": "G1", "interval": 1e-6, "point": [6e-3, 1e-3], "angles": [0.0]}


def test_a_case_reads_the_mapped_data(tmp_path: Path) -> None:
    """The term is that of the numbers, and the resolved case needs neither file nor mapping."""
    write(tmp_path / "event.mat")
    columns = {name: each.model_dump(exclude_none=True) for name, each in MAPS[".mat"].items()}
    term = {"kind": "traces", "instrument": "G1", "file": "event.mat", "sigma": "1 ue", "map": columns}
    table = merged(plates(), {"instruments": [GAUGE], "objective": [term], "duration": 1e-3})
    case = parse_case(table, tmp_path)
    (measured,) = case.objective[0].measured()
    np.testing.assert_allclose(measured.values, -STRAIN[:, 2], rtol=1e-12)
    np.testing.assert_allclose(measured.times, TIME, rtol=1e-12, atol=1e-20)
    assert case.objective[0].map == {} and case.objective[0].file is None
    without = {key: value for key, value in term.items() if key != "file"}
    with pytest.raises(CaseError, match=facts("objective.0.*map")):
        parse_case(merged(table, {"objective": [without]}), tmp_path)


def test_the_mapping_of_a_case_is_that_of_compare(tmp_path: Path) -> None:
    columns = {name: each.model_dump(exclude_none=True) for name, each in MAPS[".mat"].items()}
    entry = {"kind": "traces", "instrument": "G1", "map": columns}
    (tmp_path / "map.toml").write_text(tomli_w.dumps({"objective": [entry, {**entry, "instrument": "G2"}]}))
    as_csv(write(tmp_path / "event.mat"), mapping_of(tmp_path / "map.toml", "G1"), tmp_path / "event.csv")
    (time, signal) = contents(tmp_path / "event.csv")
    assert (time.unit, signal.name, signal.unit) == ("s", "extension_1", "ue")
    np.testing.assert_allclose(signal.values, -1e6 * STRAIN[:, 2], rtol=1e-12)
    with pytest.raises(ValueError, match=facts("2 .*G1, G2")):
        mapping_of(tmp_path / "map.toml", None)


def test_the_command(tmp_path: Path) -> None:
    folder = tmp_path / "events"
    folder.mkdir()
    for name in ("a.mat", "b.mat"):
        write(folder / name)
    with h5py.File(folder / "c.mat", "w") as file:
        file["other"] = np.arange(4.0)
    (folder / "readme.txt").write_text("1 2\n3 4\n")
    assert [path.name for path in events_of(folder)] == ["a.mat", "b.mat", "c.mat"]
    result = CliRunner(env={"COLUMNS": "200"}).invoke(app, ["data", str(folder), "--instrument", "G1"])
    assert result.exit_code == 0, result.output
    lines = result.output.splitlines()
    assert any(line.split()[:4] == ["t", "200", "us?", "time"] and "1e+06 Hz" in line for line in lines)
    assert any("c.mat" in line and line.startswith("1 ") for line in lines)
    begin = lines.index("[[objective]]")
    entry = load_toml("\n".join(lines[begin:]))["objective"][0]
    assert entry["file"].endswith("a.mat") and entry["map"]["strain_2"]["column"] == 2
    refused = CliRunner().invoke(app, ["data", str(tmp_path / "none.csv")])
    assert refused.exit_code == 1
