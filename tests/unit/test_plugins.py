"""Laws from outside: plug-ins of a case, classes of a script, entry points of packages; files that do not load."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w
from helpers.a_law import LAW
from helpers.messages import facts, says
from helpers.small_cases import plates, slip_weakening
from typer.testing import CliRunner

import ruptfx.laws.friction
from ruptfx import RuptfxError
from ruptfx.app.cli import app
from ruptfx.app.reference.describe import describe_topic
from ruptfx.case import parse_case, read_case
from ruptfx.input import schema
from ruptfx.input.plugins import load
from ruptfx.input.schema import CaseError, alternatives, broken, find, kinds
from ruptfx.laws.friction.coulomb import Coulomb
from ruptfx.many_runs.study.definition import read_study

USED = {"kind": "my_law", "mu_s": 0.6}


def written(folder: Path, text: str = LAW, name: str = "my_law.py", **changes: Any) -> Path:
    """A case file that uses the law of a file beside it."""
    folder.mkdir(exist_ok=True)
    (folder / name).write_text(text)
    table = slip_weakening({"faults.main.friction": USED, "duration": 3e-6, **changes})
    (folder / "case.toml").write_text(tomli_w.dumps({"plugins": [name], **table}))
    return folder / "case.toml"


def ruptfx_says(*arguments: Any) -> str:
    return " ".join(CliRunner(env={"COLUMNS": "200"}).invoke(app, [str(a) for a in arguments]).output.split())


# -- what a case may name --------------------------------------------------------------------------------------------


def test_a_file_beside_the_case(tmp_path: Path) -> None:
    case = read_case(written(tmp_path))
    law = case.faults["main"].friction
    assert law.kind() == "my_law" and law.L == 1e-5
    assert case.table()["plugins"] == [str(tmp_path / "my_law.py")]
    assert "my_law" not in kinds("ruptfx.laws.friction")  # known to its case alone
    assert parse_case(case.table()) == case
    with pytest.raises(CaseError, match=facts("unknown kind 'my_law'")):
        parse_case({**case.table(), "plugins": []})
    with pytest.raises(CaseError, match=facts(r"unknown kind 'my_lav', did you mean 'my_law'\?")):
        read_case(tmp_path / "case.toml", ["faults.main.friction.kind=my_lav"])


def test_the_content_is_part_of_the_case_and_the_place_is_not(tmp_path: Path) -> None:
    one, other = (read_case(written(tmp_path / name)) for name in ("a", "b"))
    assert one.hash == other.hash and one.table() != other.table()
    changed = read_case(written(tmp_path / "b", LAW.replace("/ (1 +", "/ (2 +")))
    assert changed.hash != one.hash
    # Both laws live side by side: each case has its own.
    at = np.ones(1), np.ones(1), {"own_slip": np.zeros(1)}
    assert [c.faults["main"].friction.strength(*at)[0] for c in (one, changed)] == [0.6, 0.3]
    # What was read stays, whatever becomes of the file.
    (tmp_path / "a" / "my_law.py").unlink()
    assert one.model_copy(update={"duration": 2e-6}).model_copy(update={"duration": 3e-6}).hash == one.hash


def test_cases_without_plugins_are_as_before() -> None:
    case = parse_case(plates())
    assert "plugins" not in case.table() and "plugins" not in case.to_toml()


BAD = {
    "import nothing_of_that_name": r"my_law\.py, line 1: ModuleNotFoundError: No module named 'nothing_of_that_name'",
    "x = 1\nclass A(:\n": r"my_law\.py, line 2: SyntaxError: invalid syntax",
    "x = 1": "defines no alternative; derive a class from FrictionLaw",
    "import sys\nsys.exit(3)": r"my_law\.py, line 2: SystemExit: 3",
    LAW.replace("class MyLaw", "class Coulomb"): "Coulomb would hide the friction 'coulomb' that is",
    LAW.replace('"own_slip": "m"', '"slip": "m"'): r"line 10: friction law my_law: the state variable 'slip'",
    LAW + "\nfrom ruptfx import read_case\nread_case('case.toml')": (
        r'my_law\.py, line 27: .*makes a case when my_law\.py is loaded .* under: if __name__ == "__main__":'
    ),
}


@pytest.mark.parametrize("text", BAD)
def test_files_that_are_refused(text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = written(tmp_path, text)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(CaseError, match=r"plugins: .*" + BAD[text]):
        read_case(path)


def test_a_file_that_is_not_there_or_no_python(tmp_path: Path) -> None:
    path = written(tmp_path)
    (tmp_path / "my_law.py").rename(tmp_path / "my_law.txt")
    with pytest.raises(CaseError, match=facts(r"my_law\.py: cannot be read: No such file")):
        read_case(path)
    with pytest.raises(CaseError, match=facts(r"its name must end with \.py")):
        read_case(path, ['plugins=["my_law.txt"]'])
    with pytest.raises(CaseError, match=facts(r"plugins = 'my_law\.txt': input should be a valid list")):
        read_case(path, ['plugins="my_law.txt"', "faults.main.friction={kind='coulomb', mu_d=0.5}"])


def test_two_of_one_name(tmp_path: Path) -> None:
    path = written(tmp_path)
    shutil.copy(tmp_path / "my_law.py", tmp_path / "other.py")
    with pytest.raises(
        CaseError, match=facts(r"my_law\.py and .*other\.py: both define the friction 'my_law'; rename one")
    ):
        read_case(path, ['plugins=["my_law.py", "other.py"]'])
    written(tmp_path / "sub")
    with pytest.raises(CaseError, match=facts(r"my_law\.py and .*sub/my_law\.py: ")):
        read_case(path, ['plugins=["my_law.py", "sub/my_law.py"]'])
    assert read_case(path, ['plugins=["my_law.py", "./my_law.py"]']).hash == read_case(path).hash


def test_modules_beside_a_plugin_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """They would be found today, and not from the run directory."""
    (tmp_path / "beside_my_law.py").write_text("def half(x):\n    return x / 2\n")
    monkeypatch.syspath_prepend(tmp_path)
    path = written(tmp_path, "from beside_my_law import half\n" + LAW.replace("from __future__ import annotations", ""))
    with pytest.raises(CaseError, match=facts(r"imports beside_my_law\.py beside it, .* put both into one file")):
        read_case(path)


def test_several_classes_of_several_folders(tmp_path: Path) -> None:
    text = (
        LAW
        + '''

from ruptfx.laws.nucleation import Nucleation


class SmallPush(Nucleation):
    """A constant."""

    push: float = 1.0

    def shear_traction(self, position, time):
        return self.push + 0 * position
'''
    )
    path = written(tmp_path, text, **{"faults.main.nucleation": {"kind": "small_push", "push": 2.0}})
    case = read_case(path)
    assert case.faults["main"].nucleation[0].shear_traction(np.zeros(2), 0.0).tolist() == [2.0, 2.0]
    assert load(tmp_path / "my_law.py").listed() == "friction my_law, nucleation small_push"


# -- runs ------------------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.fem
def test_a_run_directory_needs_nothing_else(tmp_path: Path) -> None:
    pytest.importorskip("dolfinx")
    from ruptfx.results.record import Record
    from ruptfx.run.simulation import simulate

    quick = {"output.checkpoint_steps": 20, "output.interface_interval": 2e-7}
    path, whole, out = written(tmp_path / "a", **quick), tmp_path / "whole", tmp_path / "run"
    assert "error" not in ruptfx_says("run", path, "--out", whole)
    simulate(read_case(path), out, progress=False)
    shutil.rmtree(tmp_path / "a")
    # As if it had been killed after its last checkpoint.
    (out / "summary.json").unlink()
    moved = out.rename(tmp_path / "moved")
    assert "my_law" in ruptfx_says("check", moved / "case.toml")
    said = ruptfx_says("run", moved / "case.toml", "--out", moved, "--resume")
    assert "error" not in said and (moved / "summary.json").is_file()
    with Record(moved) as resumed, Record(whole) as once:
        assert resumed.summary["case_hash"] == once.summary["case_hash"]
        np.testing.assert_array_equal(resumed.interface.own_slip.values, once.interface.own_slip.values)
        assert float(resumed.interface.own_slip.max()) > 0
    assert "figures" in ruptfx_says("plot", moved)
    # Another law is another case.
    (moved / "summary.json").unlink()
    (moved / "plugins" / "my_law.py").write_text(LAW.replace("/ (1 +", "/ (2 +"))
    assert says("my_law.py was changed", ruptfx_says("run", moved / "case.toml", "--out", moved, "--resume"))


@pytest.mark.fem
def test_an_operator_from_outside(tmp_path: Path) -> None:
    pytest.importorskip("dolfinx")
    from ruptfx.run.model import Model

    text = """
from ruptfx.bodies.operators import Operator
from ruptfx.bodies.operators.ufl_form import UflForm


class Twice(Operator):
    def __init__(self, bulk):
        self.inner = UflForm(bulk)

    def add_internal_force(self, *arguments):
        self.inner.add_internal_force(*arguments)
        self.inner.add_internal_force(*arguments)
"""
    (tmp_path / "twice.py").write_text(text)
    case = parse_case({"plugins": ["twice.py"], **plates({"operator": "twice"})}, tmp_path)
    assert type(Model(case).operator).__name__ == "Twice"


@pytest.mark.slow
@pytest.mark.fem
def test_a_study_keeps_its_plugins(tmp_path: Path) -> None:
    pytest.importorskip("dolfinx")
    pytest.importorskip("distributed")
    from ruptfx.many_runs.study import run_study

    path = written(tmp_path)
    path.write_text(tomli_w.dumps(plates({"faults.main.friction": USED, "duration": 5e-7})))  # the study names the file
    axes = [{"key": "faults.main.friction.mu_s", "values": [0.5, 0.6]}]
    file = tmp_path / "study.toml"
    file.write_text(tomli_w.dumps({"case": "case.toml", "plugins": ["my_law.py"], "keep": ["run"], "axes": axes}))
    study, out = read_study(file), tmp_path / "out"
    found = run_study(study, out, cores=1, show=False)
    assert [result["status"] for _, result in found.points] == ["done", "done"]
    (tmp_path / "my_law.py").unlink()
    kept = list(out.glob("points/*/run/case.toml"))
    assert {read_case(file).hash for file in kept} == {point.hash for point, _ in found.points}


# -- classes of a script ---------------------------------------------------------------------------------------------

SCRIPT = (
    LAW
    + """

from pathlib import Path

from ruptfx import Case, read_case

%s
    table = read_case("plain.toml").table()
    table["faults"]["main"]["friction"] = MyLaw(mu_s=0.6)
    case = Case(**table)
    Path("again.toml").write_text(case.to_toml())
    print(case.hash, read_case("again.toml").hash, read_case("again.toml").faults["main"].friction.kind())
"""
)


def run_script(folder: Path, text: str, *how: str) -> subprocess.CompletedProcess[str]:
    (folder / "my_script.py").write_text(text)
    (folder / "plain.toml").write_text(tomli_w.dumps(plates()))
    return subprocess.run(
        [sys.executable, *how], cwd=folder, capture_output=True, text=True, input=text if how == ("-",) else None,
        env={**os.environ, "PYTHONPATH": str(Path(ruptfx.__file__).parents[1])},
    )  # fmt: skip


def test_objects_of_a_script_make_a_case_that_can_be_read_again(tmp_path: Path) -> None:
    done = run_script(tmp_path, SCRIPT % 'if __name__ == "__main__":', "my_script.py")
    assert done.returncode == 0, done.stderr
    first, again, kind = done.stdout.split()
    assert first == again == read_case(tmp_path / "again.toml").hash and kind == "my_law"


def test_what_cannot_be_read_again_is_refused(tmp_path: Path) -> None:
    said = run_script(tmp_path, SCRIPT % "if True:", "my_script.py").stderr.splitlines()[-1]
    assert says("my_script.py is loaded as a plug-in; put what is not to run then under: if", said)
    said = run_script(tmp_path, SCRIPT % "if True:", "-").stderr.splitlines()[-1]
    assert says("MyLaw is not defined in a file; save it, for example in my_law.py", said)
    text = SCRIPT % 'if __name__ == "__main__":'
    text = text.replace(
        "    case =",
        """
    class Hidden(MyLaw):
        pass

    table["faults"]["main"]["friction"] = Hidden(mu_s=0.6)
    case =""",
    )
    said = run_script(tmp_path, text, "my_script.py").stderr.splitlines()[-1]
    assert "Hidden is not defined at the top level of " in said and says("for example hidden.py", said)


# -- packages --------------------------------------------------------------------------------------------------------


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Installs a package with laws and entry points, for the time of a test."""

    def install(entries: str, source: str = LAW) -> None:
        (tmp_path / "laws_of_others.py").write_text(source)
        folder = tmp_path / "laws_of_others-1.0.dist-info"
        folder.mkdir()
        (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: laws-of-others\nVersion: 1.0\n")
        (folder / "entry_points.txt").write_text(f"[ruptfx.friction]\n{entries}\n")
        monkeypatch.syspath_prepend(tmp_path)
        schema.offered.cache_clear()

    yield install
    sys.modules.pop("laws_of_others", None)
    monkeypatch.undo()
    schema.offered.cache_clear()


def test_entry_points(package: Any, tmp_path: Path) -> None:
    package("my_law = laws_of_others:MyLaw")
    case = parse_case(plates({"faults.main.friction": USED}))
    law = case.faults["main"].friction
    assert type(law).__module__ == "laws_of_others" and "my_law" in alternatives("ruptfx.laws.friction")
    assert "plugins" not in case.table() and parse_case(case.table()) == case  # also for objects given in Python
    with pytest.raises(CaseError, match=facts("MyLaw would hide the friction 'my_law' that is there already")):
        read_case(written(tmp_path / "sub"))


@pytest.mark.parametrize(
    "entries, message",
    [
        ("coulomb = laws_of_others:MyLaw", "'coulomb' of laws-of-others: would hide the 'coulomb' that"),
        ("my_lav = laws_of_others:MyLaw", "must be a class with the contract of ruptfx.laws.friction called 'my_lav'"),
        ("my_law = laws_of_others:TheirLaw", "AttributeError: module 'laws_of_others' has no attribute 'TheirLaw'"),
    ],
)
def test_entry_points_that_are_refused(entries: str, message: str, package: Any) -> None:
    package(entries)
    kind = entries.split()[0]
    with pytest.raises(RuptfxError, match=facts(message)):
        find("ruptfx.laws.friction", kind)
    assert says(message, broken("ruptfx.laws.friction")[kind])
    assert "cohesion" in alternatives("ruptfx.laws.friction")


FUNCTIONS = """[ruptfx.figures]
opening = opening_of_others
broken = nothing_there
[ruptfx.movies]
displacement = displacement
[ruptfx.commands]
size = size
run = size
"""
USE = """
from pathlib import Path
from helpers import synthetic
from ruptfx.results import movies, plots
from ruptfx.results.record import Record

time, position = synthetic.times(3), synthetic.points(4)
with Record(synthetic.write_run(Path("run"), synthetic.crack(time, position), time, position, snapshots=3)) as record:
    film = movies.film(record, "displacement")
    axes = plots.opening(record)
    print(plots.suits("opening", record), len(film.times), axes.get_ylabel(), "broken" in plots.FIGURES)
"""


@pytest.fixture
def functions_of_others(tmp_path: Path) -> Callable[..., subprocess.CompletedProcess[str]]:
    """A package with a figure, a movie and a command, which a process finds; the figure is one of the demos."""
    root = Path(ruptfx.__file__).parents[1]
    for kind, name in (("plots", "opening"), ("movies", "displacement"), ("commands", "size")):
        source = root / "demos" / "plugins" / kind / f"{name}.py"
        shutil.copy(source, tmp_path / ("opening_of_others.py" if kind == "plots" else f"{name}.py"))
    folder = tmp_path / "functions_of_others-1.0.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: functions-of-others\nVersion: 1.0\n")
    (folder / "entry_points.txt").write_text(FUNCTIONS)
    paths = os.pathsep.join(map(str, (tmp_path, root, root / "tests", *sys.path)))

    def python(*arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run([sys.executable, *arguments], cwd=tmp_path, capture_output=True, text=True, timeout=120,
                              env={**os.environ, "PYTHONPATH": paths, "COLUMNS": "200"})  # fmt: skip

    return python


def test_packages_add_figures_and_movies(functions_of_others: Callable[..., Any]) -> None:
    """Also beside one that does not load, which is named."""
    done = functions_of_others("-c", USE)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["True", "3", "Largest", "opening", "(m)", "False"]
    assert says("ruptfx.figures 'broken' of functions-of-others: No module named 'nothing_there'", done.stderr)


def test_packages_add_commands(functions_of_others: Callable[..., Any], tmp_path: Path) -> None:
    """One that would hide a command of the program is named and left out."""
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "file").write_bytes(bytes(3_000_000))
    done = functions_of_others("-m", "ruptfx", "size", "data")
    assert done.returncode == 0 and done.stdout.split() == ["3", "MB"]
    assert says("command 'run' of functions-of-others, size", done.stderr)
    assert "displacement" in functions_of_others("-m", "ruptfx", "movie", "--help").stdout


# -- files that do not load ------------------------------------------------------------------------------------------


def test_a_broken_file_in_a_folder_harms_nothing_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "half_done.py").write_text("import numpy as np\n\nclass HalfDone(FrictionLaw):\n    pass\n")
    monkeypatch.setattr(ruptfx.laws.friction, "__path__", [*ruptfx.laws.friction.__path__, str(tmp_path)])
    reason = f"{tmp_path / 'half_done.py'}, line 3: NameError: name 'FrictionLaw' is not defined"
    assert broken("ruptfx.laws.friction") == {"half_done": reason}
    laws = alternatives("ruptfx.laws.friction")
    assert laws["coulomb"] is Coulomb and "half_done" not in laws
    titles = [panel.title.plain for panel in describe_topic("friction")]
    assert titles[-1] == "half_done (broken)" and "coulomb" in titles
    said = ruptfx_says("describe", "friction")
    assert "half_done (broken)" in said and says("NameError: name 'FrictionLaw' is not defined", said)
    assert '"coulomb"' in ruptfx_says("describe", "--schema")
    parse_case(plates())
    with pytest.raises(RuptfxError, match=facts(r"half_done\.py, line 3: NameError")):
        parse_case(plates({"faults.main.friction": {"kind": "half_done"}}))


# -- code that is not trusted ----------------------------------------------------------------------------------------

TELLS = """
from pathlib import Path

import os

with Path(os.environ["RUPTFX_TEST_MARK"]).open("a") as file:
    file.write("ran ")
"""


@pytest.fixture(scope="module")
def foreign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The run of somebody else, whose plug-in writes to a file whenever its code runs."""
    pytest.importorskip("dolfinx")
    from ruptfx.run.simulation import simulate

    folder = tmp_path_factory.mktemp("foreign")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RUPTFX_TEST_MARK", str(folder / "mark"))
        case = written(folder / "case", LAW + TELLS, **{"output.bulk_interval": 1e-6})
        simulate(read_case(case), folder / "run", progress=False).close()
    assert (folder / "mark").read_text() == "ran "
    return folder / "run"


def in_a_new_process(mark: Path, *arguments: Any) -> subprocess.CompletedProcess[str]:
    """A command where the plug-in has not been loaded before."""
    return subprocess.run(
        [sys.executable, "-m", "ruptfx", *map(str, arguments)], capture_output=True, text=True, timeout=180,
        check=False,
        env={**os.environ, "RUPTFX_TEST_MARK": str(mark), "COLUMNS": "200"},
    )  # fmt: skip


@pytest.mark.fem
@pytest.mark.parametrize("command", [
    pytest.param(["plot", "RUN", "--figure", "snapshots"], marks=pytest.mark.slow), ["list", "RUN"],
    ["compare", "RUN", "RUN", "--out", "OUT/both.png"],
    ["export", "RUN", "--out", "OUT/export"], ["movie", "RUN", "--out", "OUT/movie.gif"],
], ids=lambda command: command[0])  # fmt: skip
def test_reading_a_run_runs_none_of_its_code(command: list[str], foreign: Path, tmp_path: Path) -> None:
    given = [word.replace("RUN", str(foreign)).replace("OUT", str(tmp_path)) for word in command]
    done = in_a_new_process(tmp_path / "mark", *given)
    assert done.returncode == 0, done.stderr
    assert not (tmp_path / "mark").exists()
    assert ("--trust" in done.stderr) == (command[0] == "plot")  # what is left out, and how to get it
    if command[0] == "plot":
        trusted = in_a_new_process(tmp_path / "mark", *given, "--trust")
        assert trusted.returncode == 0 and (tmp_path / "mark").read_text() == "ran "
        assert trusted.stdout == done.stdout  # the same figures
        named = [line for line in trusted.stderr.splitlines() if line.startswith("plug-in")]
        assert named == [f"plug-in {foreign}/plugins/my_law.py: friction my_law"]


@pytest.mark.fem
def test_mesh_of_a_run_runs_none_of_its_code(foreign: Path, tmp_path: Path) -> None:
    given = ["mesh", foreign / "case.toml", "--out", tmp_path / "mesh.png"]
    done = in_a_new_process(tmp_path / "mark", *given)
    assert done.returncode == 1 and "--trust" in done.stderr and "plugins/my_law.py" in done.stderr
    assert not (tmp_path / "mark").exists() and not (tmp_path / "mesh.png").exists()
    trusted = in_a_new_process(tmp_path / "mark", *given, "--trust")
    assert trusted.returncode == 0 and (tmp_path / "mark").read_text() == "ran "
    assert (tmp_path / "mesh.png").exists()


@pytest.mark.fem
def test_a_record_that_is_trusted_has_the_strength(foreign: Path, tmp_path: Path, monkeypatch: Any) -> None:
    from ruptfx.results.record import Record
    from ruptfx.results.strength import strength

    monkeypatch.setenv("RUPTFX_TEST_MARK", str(tmp_path / "mark"))
    with Record(foreign) as record, Record(foreign, trust=True) as trusted:
        rows = np.array([0, record.interface.sizes["time"] - 1])
        assert strength(record, rows) is None and len(record.omitted) == 1
        data = trusted.interface.isel(time=rows)
        # mu_s = 0.6, L = 10 um: the formula of the law.
        expected = 0.6 * data.normal_stress.values / (1 + data.own_slip.values / 1e-5)
        np.testing.assert_allclose(strength(trusted, rows), expected)
        assert trusted.omitted == []


@pytest.mark.fem
def test_laws_of_the_package_need_no_plug_in(tmp_path: Path) -> None:
    """A run that names one for something else has its strength without it."""
    from ruptfx.results.record import Record
    from ruptfx.results.strength import strength
    from ruptfx.run.simulation import simulate

    own = {"faults.main.friction": {"kind": "linear_slip_weakening", "mu_s": 0.6, "mu_d": 0.3, "D_c": 5e-6}}
    simulate(read_case(written(tmp_path / "case", **own)), tmp_path / "run", progress=False).close()
    (tmp_path / "run" / "plugins" / "my_law.py").write_text("raise SystemExit")
    (tmp_path / "run" / "files.json").unlink()  # as a run of before it was written: nothing to compare the file with
    with Record(tmp_path / "run") as record:
        assert strength(record, np.array([0])) is not None and record.omitted == []


@pytest.mark.fem
@pytest.mark.parametrize("command", [
    ["check", "CASE"], ["mesh", "CASE", "--out", "OUT/mesh.png"], ["run", "CASE", "--out", "OUT/run", "--quiet"],
    ["resume", "OUT/stopped", "--quiet"], ["resume", "OUT/stopped", "--quiet", "--duration", "4 us"],
], ids=lambda command: " ".join(command[:1] + command[3:]))  # fmt: skip
def test_commands_that_run_code_name_its_file_once(
    command: list[str], foreign: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also when they are quiet, and before the code runs."""
    monkeypatch.setenv("RUPTFX_TEST_MARK", str(tmp_path / "mark"))
    case = written(tmp_path / "case", LAW + TELLS)
    shutil.copytree(foreign, tmp_path / "stopped")
    given = [word.replace("CASE", str(case)).replace("OUT", str(tmp_path)) for word in command]
    done = in_a_new_process(tmp_path / "mark", *given)
    assert done.returncode == 0, done.stderr
    file = tmp_path / "stopped" / "plugins" / "my_law.py" if command[0] == "resume" else tmp_path / "case" / "my_law.py"
    # The copy that a longer run has until it is complete has the same content.
    named = [line for line in done.stderr.splitlines() if line.startswith("plug-in")]
    assert named == [f"plug-in {file}: friction my_law"]
    assert (tmp_path / "mark").read_text() == "ran "


@pytest.mark.fem
def test_a_directory_is_judged_without_its_code(foreign: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A case of one's own is to go on in the run of somebody else, which has another plug-in, or the same one."""
    monkeypatch.setenv("RUPTFX_TEST_MARK", str(tmp_path / "made"))
    stranger = tmp_path / "stranger"
    shutil.copytree(foreign, stranger)
    (stranger / "summary.json").unlink()
    own = written(tmp_path / "own")
    done = in_a_new_process(tmp_path / "mark", "run", own, "--out", stranger, "--resume")
    assert done.returncode == 1 and not (tmp_path / "mark").exists()
    theirs = json.loads((foreign / "summary.json").read_text())["case_hash"]
    assert f"holds a run of case {theirs}, this is case {read_case(own).hash}" in " ".join(done.stderr.split())
    assert str(stranger / "plugins") not in done.stderr
    # The same code is no stranger's: the run is known as that of the case, whose own file alone is named.
    same = written(tmp_path / "same", LAW + TELLS, **{"output.bulk_interval": 1e-6})
    done = in_a_new_process(tmp_path / "mark", "run", same, "--out", stranger, "--resume", "--quiet")
    assert done.returncode == 0 and (stranger / "summary.json").is_file()
    assert done.stderr.splitlines() == [f"plug-in {same.parent / 'my_law.py'}: friction my_law"]


@pytest.mark.fem
@pytest.mark.parametrize("place", ["file", "method"])
@pytest.mark.parametrize("end", ["sys.exit(7)", "os._exit(0)"])
@pytest.mark.parametrize("command", ["check", "run"])
def test_a_plug_in_that_ends_the_program_is_an_error(end: str, place: str, command: str, tmp_path: Path) -> None:
    text = LAW.replace("import numpy as np", "import os\nimport sys\n\nimport numpy as np", 1)
    law = "        return self.mu_s *"
    text = f"{text}\n{end}\n" if place == "file" else text.replace(law, f"        {end}\n{law}")
    line = 1 + text[: text.index(end)].count("\n")
    case = written(tmp_path / "case", text)
    options = ["--out", tmp_path / "run", "--quiet"] if command == "run" else []
    done = in_a_new_process(tmp_path / "mark", command, case, *options)
    assert done.returncode == 1
    assert f"my_law.py, line {line}" in done.stderr.replace("\n", " ") and "Traceback" not in done.stderr
