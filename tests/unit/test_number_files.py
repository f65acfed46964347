"""Units in the headers of files with numbers: read in usual spellings, refused where they are unknown."""

from __future__ import annotations

import os
import random
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from helpers.messages import facts
from helpers.small_cases import merged, plates

from ruptfx import RuptfxError
from ruptfx.case import parse_case
from ruptfx.input.number_files import describe_reading, named_histories, two_columns, with_units
from ruptfx.input.profiles.table import Table
from ruptfx.input.schema import CaseError
from ruptfx.input.surface_files import of_csv
from ruptfx.lumped.maxwell_slip.roughness import read_profile
from ruptfx.lumped.spring_slider.fit import read_trace
from ruptfx.results.analysis.emission import read_catalogue


def written(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    "header, time, velocity",
    [  # SI values of a row "60, 3", to the last bit
        ("time (us), velocity (m/s)", 60e-6, 3.0),
        ("time [us];velocity [mm/s]", 60e-6, 3e-3),
        ("t/us,v/(km/s)", 60e-6, 3e3),
        ("t / ms, v / (mm s^-1)", 60e-3, 3e-3),
        ("time us, velocity mm/s", 60e-6, 3e-3),
        ("time_us,velocity_mm_s", 60e-6, 3e-3),
        ("time_min,v_m_per_s", 3600.0, 3.0),
        ("time (\u03bcs), velocity (\u00b5m/s)", 60e-6, 3e-6),
        ('"Time (ms)","v (cm/s)"', 60e-3, 3e-2),
        ("# time (us), velocity (m/s)", 60e-6, 3.0),
        ("# one comment, two\n# time (us), velocity (m/s)\n# filtered", 60e-6, 3.0),
        ("Time,Velocity\n(us),(km/s)", 60e-6, 3e3),
        ("Time,Velocity\nus,km/s", 60e-6, 3e3),
        ("time (us), velocity (m/s)\nchannel A, channel B", 60e-6, 3.0),
        ("time (us), velocity", 60e-6, 3.0),
        # Without units the numbers are in SI units, whatever the names.
        ("time, velocity", 60.0, 3.0),
        ("t, v_1", 60.0, 3.0),
        ("time_s,velocity_m_s", 60.0, 3.0),
        ("", 60.0, 3.0),
    ],
)
def test_units_of_two_columns(tmp_path: Path, header: str, time: float, velocity: float) -> None:
    mark = ";" if ";" in header else ","
    path = written(tmp_path / "v.csv", f"{header}\n60{mark}3\n70{mark}4\n")
    times, values = two_columns(path, "time", ("s", "m/s"))
    assert (times[0], values[0]) == (time, velocity)


@pytest.mark.parametrize(
    "header, column, unit",
    [
        ("time (fortnight), velocity (m/s)", 1, "fortnight"),
        ("time (us), velocity (V)", 2, "V"),
        ("time (mm), velocity (m/s)", 1, "mm"),  # of another kind
        ("time (us), displacement (mm)", 2, "mm"),
        ("time_us, velocity_MPa", 2, "MPa"),
        ("t/us, v/c_R", 2, "c_R"),
        ("# time (us), velocity (arbitrary)", 2, "arbitrary"),
    ],
)
def test_other_units_are_refused(tmp_path: Path, header: str, column: int, unit: str) -> None:
    path = written(tmp_path / "v.csv", f"title\n{header}\n60,3\n70,4\n")
    with pytest.raises(ValueError, match=facts(rf"line 2 of .*v\.csv, column {column}, .*\b{unit}\b.*in brackets")):
        two_columns(path, "time", ("s", "m/s"))


@pytest.mark.parametrize(
    "header, facts_of_error",
    [
        ("time (fortnight),slip (um)", r"line 3 of .*v\.csv, column 1, 'time \(fortnight\)': .*'fortnight'.*\(s\)"),
        ("time (mm),slip (um)", r"line 3 of .*v\.csv, column 1, 'time \(mm\)': .* in s .* mm .*\(s\)"),
        ("time (us),slip (furlong)", r"line 3 of .*v\.csv, column 2, 'slip \(furlong\)': .*'furlong'; .*\(m\)"),
        ("time (us),slip", r"line 3 of .*v\.csv, column 2, 'slip': has no unit.*\(us\)"),
    ],
)
def test_columns_without_a_known_unit_are_refused(tmp_path: Path, header: str, facts_of_error: str) -> None:
    path = written(tmp_path / "v.csv", f"title\n\n# {header}\n60,3\n\n70,4\n")
    with pytest.raises(ValueError, match=facts(facts_of_error)):
        with_units(path, "s")


def test_all_columns_with_their_units(tmp_path: Path) -> None:
    path = written(tmp_path / "v.csv", "title\n\n# time (us),slip (um),friction (-)\n60,3,0.5\n\n70,4,0.6\n")
    assert with_units(path, "s") == {
        "time": ([60.0, 70.0], "us"), "slip": ([3.0, 4.0], "um"), "friction": ([0.5, 0.6], "1")
    }  # fmt: skip
    with pytest.raises(ValueError, match=facts(r"line 3 of .*v\.csv, column 3, .* in m .*\(m\)")):
        with_units(path, "s", "m")
    written(path, "time (us),slip (um)\n\n60,3\n70,4,5\n")
    with pytest.raises(ValueError, match=facts(r"line 4 of .*v\.csv: 3 cells, and 2 in line 3")):
        with_units(path)


def test_the_remedy_works(tmp_path: Path) -> None:
    path = written(tmp_path / "v.csv", "t/us, v/c_R (m/s)\n60,3\n70,4\n")
    assert two_columns(path, "time", ("s", "m/s")) == ([60e-6, 70e-6], [3.0, 4.0])


def test_a_moved_edge(tmp_path: Path) -> None:
    written(tmp_path / "v.csv", "time (us), velocity (mm/s)\n0,0\n20,5\n")
    written(tmp_path / "u.csv", "time (us), displacement (um)\n0,0\n20,5\n")
    given = {"kind": "moved", "edge": "upper.left", "component": "x"}
    for name, quantity, last in (("v", "velocity", 5e-3), ("u", "displacement", 5e-6)):
        edge = parse_case(
            plates({"boundaries": [{**given, "quantity": quantity, "file": f"{name}.csv"}]}), tmp_path
        ).boundaries[0]
        assert edge.times == [0.0, 20e-6] and edge.values == [0.0, last]
    wrong = {**given, "quantity": "displacement", "file": "v.csv"}
    with pytest.raises(CaseError, match=facts(r"boundaries\.0.*column 2.*mm/s")):
        parse_case(plates({"boundaries": [wrong]}), tmp_path)


def test_a_profile_has_the_unit_of_its_key(tmp_path: Path) -> None:
    written(tmp_path / "p.csv", "x (mm), p (MPa)\n-100,7\n200,3\n")
    key = "faults.main.initial_stress.normal"
    case = parse_case(plates({key: {"kind": "table", "file": "p.csv"}}), tmp_path)
    profile = case.faults["main"].initial_stress.normal
    assert profile.positions == [-0.1, 0.2] and profile.values == [7e6, 3e6] and profile.file is None
    law = {"faults.main.friction": {"kind": "coulomb", "mu_d": {"kind": "table", "file": "p.csv"}}}
    with pytest.raises(CaseError, match=facts(r"friction\.mu_d.*column 2.*MPa")):
        parse_case(merged(plates(), law), tmp_path)
    assert Table(file=str(tmp_path / "p.csv")).values == [7e6, 3e6]  # in Python, without a key


def test_a_height_profile(tmp_path: Path) -> None:
    rows = "".join(f"{i} {(-1) ** i}\n" for i in range(9))
    for header, size in (("x[mm] z[um]", (1e-3, 1e-6)), ("x (mm), z (um)", (1e-3, 1e-6)), ("x z", (1.0, 1.0))):
        position, height = read_profile(written(tmp_path / "z.txt", f"{header}\n{rows}"))
        np.testing.assert_array_equal(position, size[0] * np.arange(9), strict=False)
        assert height[0] == size[1]
    column = "".join(f"{(-1) ** i}\n" for i in range(9))
    assert read_profile(written(tmp_path / "z.txt", f"heights (um)\n{column}"))[1][0] == 1e-6
    assert read_profile(written(tmp_path / "z.txt", f"heights\n{column}"), 1e-6)[1][0] == 1e-6
    with pytest.raises(RuptfxError, match=facts(r"1e-06 m.*profile_unit = 0\.001 m")):
        read_profile(written(tmp_path / "z.txt", f"heights (um)\n{column}"), 1e-3)


def test_a_friction_trace(tmp_path: Path) -> None:
    rows = "".join(f"{i},10,0.5\n" for i in range(20))
    time, speed, friction = read_trace(written(tmp_path / "f.csv", f"time (ms),drive_speed [um/s],friction\n{rows}"))
    assert time[3] == 3e-3 and speed[0] == 10e-6 and friction[0] == 0.5
    with pytest.raises(RuptfxError, match=facts(r"column 2.*mm")):
        read_trace(written(tmp_path / "f.csv", f"time (ms),drive_speed (mm),friction\n{rows}"))


def test_a_catalogue(tmp_path: Path) -> None:
    found = read_catalogue(written(tmp_path / "c.csv", "x (mm),y (mm),time (us),energy (mJ),x_error\n1,2,3,4,5\n"))
    assert (found.x[0], found.y[0], found.time[0], found.energy[0]) == (1e-3, 2e-3, 3e-6, 4e-3)


LAYOUTS = {  # of one table
    "commas": b"time (us), velocity (mm/s)\n60,3\n70,4\n", "tabs": b"time (us)\tvelocity (mm/s)\n60\t3\n70\t4\n",
    "semicolons": b"time (us);velocity (mm/s)\r\n60;3\r\n70;4\r\n",
    "blanks": b"time (us)   velocity (mm/s)\n  60.0   3.0E+00\n  70.0   4.0E+00\n",
    "of numpy": b"# time (us), velocity (mm/s)\n6.0e+01 3.0e+00\n7.0e+01 4.0e+00\n",
    "quoted": b'"time (us)","velocity (mm/s)"\n"60","3"\n"70","4"\n',
    "of Fortran": b"time (us) velocity (mm/s)\n0.6D+02 3.0d0\n0.7D+02 0.4D1\n",
    "separator at the end": b"time (us),velocity (mm/s),\n60,3,\n70,4,\n",
    "by names": b"velocity (mm/s),time (us)\n3,60\n4,70\n",
    "more columns": b"time (us),load (N),velocity (mm/s)\n60,1,3\n70,1,4\n",
    "of SCEC": b"# 12 stations, two\n# Column #1 = time (us)\n# Column #2 = velocity along x (mm/s), to the right\n"
               b"t v-x\n  60   3\n  70   4\n",
    "of Matlab": b"% time (us), velocity (mm/s)\n60,3\n70,4\n",
    "of SEAS": b"# code = any\n# Column #1 = Time (us)\n# Column #2 = velocity (mm/s)\nt velocity\n6.0E+01 3.0E+00\n"
               b"7.0E+01 4.0E+00\n",
    "decimal commas and semicolons": b"time (us);velocity (mm/s)\n60,0;3,0\n70,0;4,00\n",
    "decimal commas and tabs": b"time (us)\tvelocity (mm/s)\n60,0\t3\n70,0\t4\n",
    "decimal commas and blanks": b"time (us)  velocity (mm/s)\n60,0  3,0\n70,0  0,4e1\n",
    "decimal commas in quotes": b'"time (us)";"velocity (mm/s)"\n"60,0";"3,0"\n"70,0";"4,0"\n',
    "of LabVIEW": b"LabVIEW Measurement\t\nSeparator\tTab\nX_Columns\tOne\n***End_of_Header***\t\n\nChannels\t1\t\n"
                  b"Samples\t2\t\nX0\t0.0E+0\t\n***End_of_Header***\t\t\nX_Value\tvelocity\tComment\n6.0E-5\t3.0E-3\n"
                  b"7.0E-5\t4.0E-3\n",
    "lines of settings": b"Model,TBS1052\nSample Interval,1.0E-5\nSource,CH1,CH2\n\n"
                         b"time (us),velocity (mm/s)\n60,3\n70,4\n",
    "UTF-8 with mark": "\ufefftime (\u00b5s),velocity (mm/s)\n60,3\n70,4\n".encode(),
    "UTF-16": "time (\u00b5s),velocity (mm/s)\n60,3\n70,4\n".encode("utf-16"),
    "Latin-1": "time (\u00b5s),velocity (mm/s)\n60,3\n70,4\n".encode("latin-1"),
}  # fmt: skip


@pytest.mark.parametrize("layout", LAYOUTS)
def test_layouts_of_one_table(layout: str, tmp_path: Path) -> None:
    path = tmp_path / "v.txt"
    path.write_bytes(LAYOUTS[layout])
    assert two_columns(path, "time", ("s", "m/s"), "velocity") == ([60e-6, 70e-6], [3e-3, 4e-3])
    aliases = {"velocity": (("velocity", "v-x"), "m/s")}
    times, columns = named_histories(path, aliases)
    assert times == pytest.approx([60e-6, 70e-6]) and columns["velocity"] == pytest.approx([3e-3, 4e-3])


@pytest.mark.parametrize("text, error", [
    ("position (mm),normal (MPa)\n-30,5,7,5\n10,4,6,5\n", "line 2 of .*: 4 cells under 2 names in line 1; .*decimal"),
    ("time (s), velocity (m/s), quality\n60,3\n70,4\n", "line 2 of .*: 2 cells under 3 names in line 1"),
    ("60,3\n70,4,5\n", "line 2 of .*: 3 cells, and 2 in line 1"),
    ("60,3\n70\n", "line 2 of .*: 1 cells, and 2 in line 1"),
    ("60,1,3\n70,1,4\n", "line 1 of .*: 3 columns; .*, or call one of them velocity"),
    ("time,velocity (mm/s),velocity\n60,1,3\n70,1,4\n", "line 2 of .*: 3 columns"),
    ("time (us);v (m/s)\n0,0;0.25\n1,0;0.5\n", "line 2 of .*: '0,0' must be .*decimal point"),
    ("time (s),v (m/s)\n1,3\n2,4\n3,-9999\n", "line 4 of .*: -9999 .* 4 "),
    ("time (s),v (m/s)\n1,3\n2,9.91E+37\n3,4\n", r"line 3 of .*: 9\.91e\+37 .* 4 "),
    ("time (s),v (m/s)\n1,3\n2,#OVF\n3,4\n", "line 3 of .*: '#OVF' must be a finite number"),
    ("time (s),v (m/s)\n1,3\n2,nan\n3,4\n", "line 3 of .*: 'nan' must be a finite number"),
    (",,,0.00000075,0.0\n,,,0.000001,0.0\n", "line 2 of .*: its first column is empty"),
    ("time,v\n12h30:05.1,1\n12:30:5:2,2\n", "line 3 of .*: '12:30:5:2' is no time of day"),
    ("time,v\n2026-02-30 12:30:05,1\n2026-02-30 12:30:06,2\n", "line 2 of .*: '2026-02-30 12:30:05' is no date"),
    ("\n\n# nothing\n", "v.txt: has no line with numbers"),
    ("a title\n", "line 1 of .*: 'a' is no number"),
    ("1_0,2\n3,4\n", "line 1 of .*: '1_0' must be a finite number"),
    ("t\0,v\n1,2\n3,4\n", "v.txt: is no text in UTF-8, UTF-16 or Latin-1"),
    ("1,2\n" + 100_001 * "3", "line 2 of .*: has 100001 characters, .* 100000"),
    (1_000_001 * "1,2\n", "v.txt: has 1000001 lines, .* 1000000"),
])  # fmt: skip
def test_what_is_wrong_with_a_table(text: str, error: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=facts(error)):
        two_columns(written(tmp_path / "v.txt", text), "time", ("s", "m/s"), "velocity")


@pytest.mark.parametrize("text", [
    "time,v\n23:59:59.9,1\n00:00:00.1,2\n00:00:01.1,3\n",
    "time (hh:mm:ss);v\n23:59:59,9;1\n00:00:00,1;2\n00:00:01,1;3\n",
    "v,time\n1,2026-11-28T23:59:59.9\n2,2026-11-29T00:00:00.1\n3,2026-11-29T00:00:01.1\n",
])  # fmt: skip
def test_times_of_day_are_seconds_since_the_first_row(text: str, tmp_path: Path) -> None:
    """Also over midnight, without a date."""
    path = written(tmp_path / "v.csv", text)
    assert two_columns(path, "time", ("s", "m/s")) == ([0.0, 0.2, 1.2], [1.0, 2.0, 3.0])
    assert "time of day" in describe_reading(path)[0]
    path = written(tmp_path / "v.csv", text.replace("v", "v (m/s)", 1))  # as data of an inference
    assert with_units(path)["time"] == ([0.0, 0.2, 1.2], "s")


def test_a_number_like_a_mark_of_missing_values_is_read_among_others_of_its_size(tmp_path: Path) -> None:
    path = written(tmp_path / "v.csv", "0,-9999\n1,-8000\n2,-7000\n")
    assert two_columns(path, "time", ("s", "m/s"))[1] == [-9999.0, -8000.0, -7000.0]


@pytest.mark.parametrize("end", ["", ","])
def test_settings_of_an_oscilloscope_are_no_columns(end: str, tmp_path: Path) -> None:
    lines = ["Record Length,3,Points,-1e-6,0.02", "Sample Interval,1e-6,s,0.0,0.04", ",,,1e-6,0.06"]
    path = written(tmp_path / "v.csv", "".join(f"{line}{end}\n" for line in lines))
    assert two_columns(path, "time", ("s", "m/s")) == ([-1e-6, 0.0, 1e-6], [0.02, 0.04, 0.06])
    first, second = describe_reading(path)
    assert "the last two of 5 columns" in first and first.endswith("3 rows of 2 columns from line 1 on")
    assert second == "time in column 1 (without a unit, hence in s), from -1 us to 1 us, 1 us apart"


def test_two_lines_say_how_a_file_is_read(tmp_path: Path) -> None:
    path = tmp_path / "v.txt"
    path.write_bytes("v (m/s);time (\u00b5s)\n1,5;10\n2,5;12\n2,5;15,5\n".encode("latin-1"))
    first, second = describe_reading(path)
    assert (
        first
        == "v.txt: columns separated by semicolons; text in Latin-1; decimal commas; 3 rows of 2 columns from line 2 on"
    )
    assert second == "time in column 2 (1 is 1 us), from 10 us to 15.5 us, 2 us to 3.5 us apart"


def test_an_exponent_of_many_digits_takes_no_time(tmp_path: Path) -> None:
    path = written(tmp_path / "v.csv", "time (us),v\n1e-999999999,0\n1,2\n")
    assert two_columns(path, "time", ("s", "m/s")) == ([0.0, 1e-6], [0.0, 2.0])


READERS: dict[str, Callable[[Path], object]] = {
    "two columns": lambda path: two_columns(path, "time", ("s", "m/s"), "velocity"),
    "with units": lambda path: with_units(path, "s"),
    "histories": lambda path: named_histories(path, {"v": (("v", "velocity"), "m/s")}, "v"),
    "description": describe_reading,
    "surface": lambda path: of_csv(path, "Pa"), "height profile": read_profile, "catalogue": read_catalogue,
    "friction trace": read_trace,
}  # fmt: skip
PIECES = [
    "1", "-2.5", "1e3", "3D-2", ",", ";", "\t", " ", "\n", "\r\n", '"', "'", "#", "%", "time", "velocity", "x", "y",
    "(us)", "[m/s]", "(", ")", "/", "_", "nan", "inf", "1,5", "12:30", "12:30:05,1", "2026-11-28",
    "-9999", "Comment", "strike", "energy", "friction", "drive_speed",
    "\0", "\u00b5", "# Column #1 = t (s)", "\u2028", "\x0b", "1e-999999999", "--", "1/s", "%\n", "e",
]  # fmt: skip
TABLES = [
    "time (us), velocity (m/s)\n1,2\n3,4\n",
    "time (s);x (m);y (m);energy (J)\n" + "".join(f"{i};2;3;4\n" for i in range(20)),
    "0 1\n" * 8,
    "1\n-1\n" * 5,
    "strike (m),dip (m),v (Pa)\n0,0,1\n1,0,2\n0,1,3\n1,1,4\n",
    "time;v (m/s)\n23:59:59,9;1,5\n00:00:01,9;2,5\n",
    "Points,3,,0.0,0.1\n,,,1.0,0.2\n",
    "time (s),drive_speed (um/s),friction\n" + "".join(f"{i},1,0.6\n" for i in range(20)),
]


@pytest.mark.parametrize("count", [100, pytest.param(500, marks=pytest.mark.slow)])
def test_random_files_are_read_or_refused(count: int, tmp_path: Path) -> None:
    """Random files for each reader: tables with a piece too much, pieces, and bytes. Others would be tracebacks."""
    rng, path, numbers = random.Random(7), tmp_path / "random.txt", dict.fromkeys(READERS, 0)
    for number in range(count):
        text = rng.choice(TABLES)
        at = rng.randrange(len(text) + 1)
        text = text[:at] + rng.choice(PIECES) + text[at:]
        text = text if number % 2 else "".join(rng.choices(PIECES, k=rng.randint(1, 60)))
        path.write_text(text, encoding="utf-16" if number % 7 == 0 else "utf-8")
        if number % 10 == 0:
            path.write_bytes(rng.randbytes(rng.randrange(200)))
        for reader, read in READERS.items():
            try:
                read(path)
                numbers[reader] += 1
            except (ValueError, RuptfxError) as error:
                assert str(path) in str(error), error
    assert min(numbers.values()) >= 3 or count == 100, numbers


@pytest.mark.parametrize("name", ["/dev/zero", "pipe"])
def test_devices_and_pipes_are_refused_at_once(name: str, tmp_path: Path) -> None:
    path = Path(name) if name.startswith("/") else tmp_path / name
    if name == "pipe":
        os.mkfifo(path)
    with pytest.raises(ValueError, match=facts(rf"{path}: cannot be read: it is no regular file")):
        two_columns(path, "position", ("m", None))


def test_files_beyond_the_limit_are_refused_before_they_are_read(tmp_path: Path) -> None:
    path = tmp_path / "large.csv"
    with path.open("wb") as file:
        file.truncate(101_000_000)  # a hole: no byte is written
    with pytest.raises(ValueError, match=facts(r"large.csv: has 101 MB, and files with numbers at most 100")):
        two_columns(path, "position", ("m", None))
