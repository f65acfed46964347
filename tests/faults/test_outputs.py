"""Files that commands write: every command of the registry never replaces what it did not write, nor loses it.

A command that writes needs a line in `WRITERS`, one that does not in `READERS`.
"""

from __future__ import annotations

import os
import resource
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w
from helpers import synthetic
from helpers.small_cases import merged, slip_weakening
from PIL import Image
from typer.main import get_command
from typer.testing import CliRunner, Result

from ruptfx.app.cli import app
from ruptfx.case import parse_case
from ruptfx.laws.friction.rate_and_state_ageing import RateAndStateAgeing
from ruptfx.lumped import simulate
from ruptfx.lumped.spring_slider.fit import modelled
from ruptfx.lumped.spring_slider.slider import Slider
from ruptfx.results.directories import LOCK

pytestmark = pytest.mark.usefixtures("blank_pictures")

COMMANDS: dict[str, Any] = dict(get_command(app).commands)  # type: ignore[attr-defined]
CAMERA = '{kind = "speckles", frame_rate = "100 kHz", exposure = "0.2 us", pixel = "1 mm"}'
WRITERS = {
    "new": ["new", "mine", "--from", "gmsh", "--schema"],
    "demos": ["demos", "copied"],
    "convert": ["convert", "Par.inp"],
    "film": ["film", "run", "--camera", CAMERA, "--out", "pics"],
    "movie": ["movie", "run", "--what", "slip_rate", "--frames", "3"],
    "plot": ["plot", "run", "--figure", "space_time"],
    "plot, lumped": ["plot", "slider", "--format", "svg"],
    "export": ["export", "run", "--format", "csv"],
    "export, netcdf": ["export", "run", "--format", "netcdf"],
    "export, vtk": ["export", "run", "--format", "vtk"],
    "export, vtkhdf": ["export", "run", "--format", "vtkhdf"],
    "compare": ["compare", "run", "other"],
    "compare, measured": ["compare", "run", "signal.csv", "--instrument", "cell"],
    "events": ["events", "catalogue.csv"],
    "events, run": ["events", "cracked", "--csv"],
    "dic": ["dic", "before.png", "after.png"],
    "check-law": ["check-law", "coulomb", "--out", "laws"],
    "export-law": ["export-law", "coulomb", "--to", "c", "--out", "exported"],
    "run, lumped": ["run", "slider.toml", "--out", "sliding"],
    "infer, lumped": ["infer", "fit.toml"],
    "bench": ["bench", "one", "--from", "own"],
    "mesh": ["mesh", "case.toml"],
    "run": ["run", "case.toml"],
    "study": ["study", "study.toml", "--cores", "1"],
    "infer": ["infer", "gradient.toml"],
    "gradient": ["gradient", "gradient.toml"],
    "converge": ["converge", "case.toml", "--levels", "2", "--cores", "1"],
    "reconstruct": ["reconstruct", "gauge.toml", "--responses", "../responses"],
}
"""Arguments by command; behind a comma what is special. The last ones need DOLFINx."""
NEED_FEM = ("mesh", "run", "study", "infer", "gradient", "converge", "reconstruct")
READERS = ("check", "cite", "data", "describe", "list", "resume")  # `resume` writes into the directory of its run only
OWN_DIRECTORY = (
    "demos",
    "run",
    "run, lumped",
    "infer",
    "infer, lumped",
    "study",
    "converge",
)  # begun only where nothing is
NEVER_AGAIN = ("new", "demos", "convert", "run", "run, lumped")  # what they wrote is edited, or expensive
MINE = b"MINE"

PAR_INP = """
&GENERAL iexec=1, ngll=5, fmax=3.d0, ndof=1, title='Antiplane', verbose='1111', ItInfo=400 /
&MESH_DEF method='CARTESIAN' /
&MESH_CART xlim=-15.d3,15.d3, zlim=0d0,12d3, nelem=30,12 /
&MATERIAL tag=1, kind='ELAST' /
&MAT_ELASTIC rho=2670.d0, cp=6000.d0, cs=3464.d0 /
&BC_DEF tag=1, kind='DYNFLT' /
&BC_DYNFLT friction='SWF', Tn=-120.d6, Tt=70.d6 /
&BC_DYNFLT_SWF Dc=0.4d0, MuS=0.677d0, MuD=0.525d0 /
&BC_DEF tag=2, kind='ABSORB' /
&TIME TotalTime=1.0d0, courant=0.5d0, kind='newmark' /
"""
BENCHMARK = '''
"""One number."""
from matplotlib.figure import Figure
from ruptfx.app.bench import Check, Outcome


def run(fine, comm):
    return Outcome([Check("one", 1.0, 1.0, 1e-9)], draw=lambda: Figure())
'''


LONG = (
    "study",
    "infer, lumped",
    "film",
    "run, lumped",
    "converge",
    "reconstruct",
)  # commands that take seconds, at each of their runs


def each_of(names: Iterable[str], slow: tuple[str, ...] = ()) -> pytest.MarkDecorator:
    """Try some of the commands."""
    return pytest.mark.parametrize("name", [
        pytest.param(name, marks=[pytest.mark.fem] * (name in NEED_FEM) + [pytest.mark.slow] * (name in slow))
        for name in names
    ])  # fmt: skip


def takes_out(name: str) -> bool:
    """Whether a command has the option --out."""
    return any("--out" in each.opts for each in COMMANDS[WRITERS[name][0]].params)


writers = each_of(WRITERS)


def table_of_gradient() -> dict[str, Any]:
    """A short run, whose slip at the end depends on the friction coefficient."""
    changes = {"duration": 1e-6, "output.figures": False, "objective": [{"kind": "final_slip", "sigma": 1e-6}],
               "unknowns": [{"key": "faults.main.friction.mu_d", "shape": "number"}],
               "inference.iterations": 1}  # fmt: skip
    return merged(slip_weakening(), changes)


def table_of_gauge() -> dict[str, Any]:
    """A strain gauge that has seen something, and lengths of the slip rate."""
    gauge = {"kind": "strain_gauge", "name": "gauge", "interval": 1e-7, "point": [10e-3, 1.3e-3], "angles": [45.0]}
    times = np.arange(3e-7, 2e-6, 3e-7)
    data = {"kind": "traces", "instrument": "gauge", "times": times.tolist(), "sigma": 2e-6,
            "units": {"extension_1": "1"}, "data": {"extension_1": (1e-5 * np.sin(2e6 * times)).tolist()}}  # fmt: skip
    return slip_weakening({
        "instruments": [gauge], "objective": [data], "output.figures": False,
        "reconstruction": {"amplitude": 0.5, "length": 4e-3, "time": 1.2e-6, "samples": 2},
    })  # fmt: skip


def _write_trace(path: Path) -> None:
    """The response of a spring slider to a faster drive."""
    times, friction = np.linspace(0, 10, 100), RateAndStateAgeing(a=0.013, b=0.026, D_c=0.42e-6, f_0=0.36, V_0=1e-6)
    drive = np.where((times > 4) & (times < 4.5), 1e-5, 1e-6)
    values = modelled(Slider(friction, 16.0, 2e6), np.array([*np.log([0.013, 0.026, 0.42e-6]), 0.36]), times, drive)
    rows = np.column_stack([times, drive, values])
    np.savetxt(path, rows, delimiter=",", header="time,drive_speed,friction", comments="")


@pytest.fixture(scope="session")
def template(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Inputs of all commands."""
    folder = tmp_path_factory.mktemp("inputs")
    time, position = synthetic.times(16), synthetic.points(10)
    for name in ("run", "other", "cracked"):
        synthetic.write_run(folder / name, synthetic.crack(time, position), time, position, snapshots=3)
    synthetic.write_cracks(folder / "cracked", failed=40)
    random = np.random.default_rng(1)
    grey = random.integers(0, 255, (60, 60)).astype(np.uint8)
    for name, picture in (("before", grey), ("after", np.roll(grey, 1, axis=1))):
        Image.fromarray(picture).save(folder / f"{name}.png")
    rows = np.column_stack([random.random(60), random.random(60), random.random(60), -random.random(60)])
    np.savetxt(folder / "catalogue.csv", rows, delimiter=",", header="time,x,y,magnitude", comments="")
    wave = np.sin(200 * 1200.0 * time)
    np.savetxt(folder / "signal.csv", np.column_stack([time, wave]), delimiter=",", header="time,force_x", comments="")
    slider = {"kind": "spring_slider", "stiffness": 2e6}
    (folder / "slider.toml").write_text(tomli_w.dumps(slider))
    simulate(parse_case(slider), folder / "slider")  # type: ignore[arg-type]
    fit = {**slider, "experiment": {"kind": "fit", "trace": "trace.csv"}}
    (folder / "fit.toml").write_text(tomli_w.dumps(fit))
    _write_trace(folder / "trace.csv")
    (folder / "Par.inp").write_text(PAR_INP)
    (folder / "own").mkdir()
    (folder / "own" / "one.py").write_text(BENCHMARK)
    case = merged(slip_weakening(), {"duration": 1e-6, "output.figures": False})
    (folder / "case.toml").write_text(tomli_w.dumps(case))
    (folder / "gradient.toml").write_text(tomli_w.dumps(table_of_gradient()))
    (folder / "gauge.toml").write_text(tomli_w.dumps(table_of_gauge()))
    axes = [{"key": "faults.main.friction.mu_d", "values": [0.2, 0.3]}]
    (folder / "study.toml").write_text(tomli_w.dumps({"case": "case.toml", "axes": axes}))
    return folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of all tests: what a command wrote in one of them is as it would be in the others."""
    return tmp_path_factory.mktemp("tests") / "w"


@pytest.fixture
def place(folder: Path, template: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder.mkdir(exist_ok=True)
    put(folder, template)
    monkeypatch.chdir(folder)
    for name in [each for each in sys.modules if each.partition(".")[0] == "own"]:  # benchmarks of another test
        monkeypatch.delitem(sys.modules, name)
    return folder


@pytest.fixture(scope="module")
def made_by(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], list[str]]:
    """Run a command where nothing is yet, or copy what it wrote in an earlier test; return its files.

    Lists of files and logs are not among them.
    """
    copies: dict[str, tuple[Path, list[str]]] = {}

    def made_by(name: str) -> list[str]:
        if name not in copies:
            before = contents(folder)
            result = ruptfx(*WRITERS[name])
            assert result.exit_code == 0, result.output
            after = contents(folder)
            assert {file: after[file] for file in before} == before, "a file that was there has changed"
            made = [file for file in after if file not in before and not Path(file).name.startswith(".")]
            copies[name] = tmp_path_factory.mktemp("copy"), made
            put(copies[name][0], folder)
        put(folder, copies[name][0])
        return copies[name][1]

    return made_by


def ruptfx(*arguments: str) -> Result:
    return CliRunner(env={"COLUMNS": "200"}).invoke(app, list(arguments))


def contents(folder: Path) -> dict[str, bytes]:
    files = (path for path in sorted(folder.rglob("*")) if path.is_file() and path.name != LOCK)
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def put(place: Path, template: Path) -> None:
    """Make the folder as it was; links and times of files are kept."""
    for path in place.iterdir():
        shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()
    shutil.copytree(template, place, symlinks=True, dirs_exist_ok=True)


def refused(result: Result) -> None:
    assert result.exit_code == 1 and "Traceback" not in result.output, result.output
    assert isinstance(result.exception, SystemExit), result.exception


def test_every_command_is_here() -> None:
    assert {name.partition(",")[0] for name in WRITERS} | set(READERS) == set(COMMANDS)
    with_out = {name for name, each in COMMANDS.items() if any("--out" in param.opts for param in each.params)}
    assert not with_out & set(READERS)


@each_of(WRITERS, ("study", "converge"))
def test_a_file_of_the_user_stays(name: str, place: Path, template: Path, made_by: Callable[[str], list[str]]) -> None:
    """A file, a link and a folder in place of outputs; --overwrite replaces a link, not the file behind it."""
    made = made_by(name)
    assert made
    first, last = made[0], made[-1]
    for kind, file in dict.fromkeys([("file", first), ("file", last), ("link", first), ("folder", last)]):
        put(place, template)
        target = place / file
        target.parent.mkdir(parents=True, exist_ok=True)
        (place / "of_user").write_bytes(MINE)
        if kind == "file":
            target.write_bytes(MINE)
        elif kind == "link":
            target.symlink_to(place / "of_user")
        else:
            target.mkdir()
        before = contents(place)
        refused(ruptfx(*WRITERS[name]))
        assert contents(place) == before, f"{kind} in place of {file}"
        assert kind != "link" or target.is_symlink()
        if kind == "link" and name not in (*OWN_DIRECTORY, *NEVER_AGAIN):
            assert ruptfx(*WRITERS[name], "--overwrite").exit_code == 0
            assert target.is_file() and not target.is_symlink() and target.read_bytes() != MINE
            assert (place / "of_user").read_bytes() == MINE


@each_of(name for name in WRITERS if name not in NEVER_AGAIN)
def test_a_command_replaces_what_it_wrote(name: str, place: Path, made_by: Callable[[str], list[str]]) -> None:
    """And says so, until the user changes it."""
    made = made_by(name)
    again = ruptfx(*WRITERS[name])
    assert again.exit_code == 0, again.output
    if name not in OWN_DIRECTORY:
        assert "replacing in" in again.output
        (place / made[-1]).write_bytes(MINE)
        before = contents(place)
        refused(ruptfx(*WRITERS[name]))
        assert contents(place) == before


@each_of(NEVER_AGAIN)
def test_a_command_keeps_what_is_edited_or_expensive(
    name: str, place: Path, made_by: Callable[[str], list[str]]
) -> None:
    assert made_by(name)
    refused(ruptfx(*WRITERS[name]))


@each_of(filter(takes_out, WRITERS), LONG)
def test_an_input_is_no_output(name: str, place: Path) -> None:
    """Each file and directory among the arguments given as --out, also through a link and without its ending."""
    arguments, before = WRITERS[name], contents(place)
    options = arguments[: arguments.index("--out")] if "--out" in arguments else arguments
    inputs = [place / each for each in arguments[1:] if (place / each).is_file()]
    (place / "link").symlink_to([*inputs, place / "run"][0])
    for given in {*arguments[1:], "link"}:
        for out in {given, given.rpartition(".")[0]} - {""} if (place / given).exists() else ():
            ruptfx(*options, "--out", out)
            after = contents(place)
            assert {file: after.get(file) for file in before} == before, out


@each_of(filter(takes_out, WRITERS), LONG)
def test_names_that_are_not_ascii_and_folders_that_cannot_be_written(name: str, place: Path) -> None:
    arguments = WRITERS[name]
    options = arguments[: arguments.index("--out")] if "--out" in arguments else arguments
    ending = {"movie": ".gif", "convert": ".toml"}.get(name, "")
    assert ruptfx(*options, "--out", f"größe 応力/v 1{ending}").exit_code == 0
    assert [path for path in (place / "größe 応力").rglob("*") if path.is_file()]
    refused(ruptfx(*options, "--out", f"/proc/nothing/v{ending}"))
    (place / "file").write_bytes(MINE)
    refused(ruptfx(*options, "--out", f"file/v{ending}"))
    assert (place / "file").read_bytes() == MINE


def limited(size: int, arguments: list[str], apart: bool) -> tuple[int, str]:
    """Run a command with a limit of the size of files; `apart` in a process of its own, which may crash at its end."""
    hard = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
    if not apart:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(os, "_exit", sys.exit)  # of a run, which does not wait for other ranks
            resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
            try:
                result = ruptfx(*arguments)
            finally:
                resource.setrlimit(resource.RLIMIT_FSIZE, (hard, hard))
        assert result.exit_code == 0 or isinstance(result.exception, SystemExit), result.exception
        return result.exit_code, result.output
    done = subprocess.run(
        [sys.executable, "-m", "ruptfx", *arguments], capture_output=True, text=True, timeout=300,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard)),
    )  # fmt: skip
    return done.returncode, done.stdout + done.stderr


@each_of((name for name in WRITERS if name != "run"), LONG)  # which tests/faults/test_restart.py tries
def test_a_full_disk_keeps_what_was_there(
    name: str, place: Path, template: Path, made_by: Callable[[str], list[str]]
) -> None:
    """Limits of the size of files below the largest output: one message, no crash, the earlier outputs unchanged."""
    sizes = {file: (place / file).stat().st_size for file in made_by(name)}
    again = name in ("study", "converge") or name not in (*NEVER_AGAIN, *OWN_DIRECTORY)  # its points are known
    # The HDF5 library may crash at the end of a process. MPI writes large files at its start.
    apart = name not in NEED_FEM and any(file.endswith((".nc", ".vtkhdf")) for file in sizes)
    failed = 0
    half = max(sizes.values()) // 2
    for limit in (half,) if apart else (0, half):
        if not again:
            put(place, template)
        before = contents(place)
        code, said = limited(limit, WRITERS[name], apart)
        assert "Traceback" not in said
        if code:
            failed += 1
            assert code == 1 and "rror: " in said, said
            after = contents(place)
            assert {file: each for file, each in after.items() if file in before} == before
            assert name in OWN_DIRECTORY or set(after) == set(before)
    assert failed


KILLED = ("film", "movie", "plot", "export", "export, netcdf", "export, vtk", "export, vtkhdf", "dic", "mesh")
KILL = """
import resource, signal, sys
signal.signal(signal.SIGXFSZ, signal.SIG_DFL)  # which Python ignores
resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
size = int(sys.argv.pop(1))
resource.setrlimit(resource.RLIMIT_FSIZE, (size, resource.getrlimit(resource.RLIMIT_FSIZE)[1]))
from ruptfx.app.cli import program
program()
"""


@each_of(KILLED, tuple(name for name in KILLED if name not in ("plot", "export")))
def test_a_command_killed_in_the_middle_of_a_file_keeps_what_was_there(
    name: str, place: Path, made_by: Callable[[str], list[str]]
) -> None:
    """The kernel kills a process at the byte that is one too many: half of the largest output is written then."""
    size = max((place / file).stat().st_size for file in made_by(name)) // 2
    before = contents(place)
    done = subprocess.run([sys.executable, "-c", KILL, str(size), *WRITERS[name]], capture_output=True, timeout=300)
    assert done.returncode == -signal.SIGXFSZ, done.stderr
    after = contents(place)
    assert {file: each for file, each in after.items() if file in before} == before
    assert all("/.ruptfx-" in f"/{file}" for file in set(after) - set(before))
    # What a killed command leaves does not stop the next one.
    assert subprocess.run([sys.executable, "-m", "ruptfx", *WRITERS[name]], capture_output=True).returncode == 0
