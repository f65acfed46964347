"""The start of commands: what they import before they say something, and that they say it at once."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest
from helpers import synthetic

from ruptfx.platform import launch

ROOT = Path(__file__).parents[2]
HEAVY = {
    "numpy", "scipy", "h5py", "h5netcdf", "matplotlib", "xarray", "pandas", "dask", "mpi4py", "petsc4py", "dolfinx",
    "ufl", "basix", "ruptfx.case", "ruptfx.results.plots", "ruptfx.results.record",
}  # fmt: skip

# Ends the process when something is printed, and prints that with the loaded modules.
FIRST_OUTPUT = """
import io, json, os, sys
said = os.dup(1)
class Watched(io.StringIO):
    def write(self, text):
        if text.strip():
            os.write(said, json.dumps([text.strip(), sorted(sys.modules)]).encode())
            os._exit(0)
        return len(text)
sys.stdout, sys.stderr = Watched(), Watched()
from ruptfx.app.cli import program
program()
"""
AT_THE_END = """
import atexit, json, sys
from ruptfx.app.cli import program
atexit.register(lambda: print(json.dumps(["end", sorted(sys.modules)])))
program()
"""


def loaded(program: str, *arguments: str | Path, **variables: str) -> tuple[str, set[str]]:
    """Run a command; return what the program says about it, and the modules that are loaded then."""

    environment = {key: value for key, value in os.environ.items() if key not in ("PMI_RANK", launch.RANKS)} | variables
    done = subprocess.run(
        [sys.executable, "-c", program, *map(str, arguments)],
        capture_output=True, text=True, timeout=300, cwd=ROOT, env=environment,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    text, modules = json.loads(done.stdout.splitlines()[-1])
    return text, set(modules)


@pytest.mark.parametrize("arguments", [["--help"], ["--version"], ["run", "--help"]])
def test_the_help_needs_nothing_heavy(arguments: list[str]) -> None:
    text, modules = loaded(AT_THE_END, *arguments)
    assert text == "end" and not HEAVY & modules


CASE = "demos/impact.toml"


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["run", CASE], f"reading {CASE}"), (["check", CASE], f"reading {CASE}"), (["mesh", CASE], f"reading {CASE}"),
        (["plot", "runs/a"], "reading runs/a"), (["compare", "runs/a", "runs/b"], "reading runs/a and runs/b"),
        (["movie", "runs/a"], "reading runs/a"), (["export", "runs/a"], "reading runs/a"),
        (["study", "demos/mode_map.toml"], "reading demos/mode_map.toml"), (["gradient", CASE], f"reading {CASE}"),
    ],
)  # fmt: skip
def test_a_command_says_what_it_does_before_it_imports(arguments: list[str], text: str) -> None:
    said, modules = loaded(FIRST_OUTPUT, *arguments)
    assert said == text and not HEAVY & modules


@pytest.mark.skipif(find_spec("dolfinx") is None, reason="needs DOLFINx")
def test_a_run_says_that_it_loads_dolfinx_before_it_does(tmp_path: Path) -> None:
    """On a rank that mpiexec has started, where the launcher has said the rest; only on the first one."""
    case = [CASE, "--out", tmp_path / "run", "--set", "mesh.element_size=10e-3", "--set", "duration=1e-6"]
    said, modules = loaded(FIRST_OUTPUT, "run", *case, **{launch.RANKS: "1"})
    assert said == "loading DOLFINx"
    assert not {"dolfinx", "mpi4py", "scipy", "matplotlib", "xarray", "ruptfx.run.simulation"} & modules


def test_only_the_first_rank_says_it(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("OMPI_COMM_WORLD_RANK", "PMI_RANK", "PMIX_RANK", "SLURM_PROCID"):
        monkeypatch.delenv(name, raising=False)
    assert launch.is_first_rank()
    for name in ("OMPI_COMM_WORLD_RANK", "PMI_RANK", "PMIX_RANK"):
        with monkeypatch.context() as changed:
            changed.setenv(name, "1")
            assert not launch.is_first_rank()
            changed.setenv(name, "0")
            assert launch.is_first_rank()


@pytest.mark.slow
def test_figures_are_drawn_again_without_xarray_and_most_of_scipy(tmp_path: Path) -> None:
    position, time = synthetic.points(40), synthetic.times(61)
    run = synthetic.write_run(tmp_path / "run", synthetic.crack(time, position), time, position)
    text, modules = loaded(AT_THE_END, "plot", run)
    assert text == "end" and (run / "figures" / "space_time.png").exists()
    late = {"xarray", "pandas", "dask", "scipy.optimize", "scipy.integrate", "scipy.sparse", "scipy.spatial", "dolfinx"}
    assert "matplotlib" in modules and not late & modules


def test_a_case_is_read_without_what_computes_and_draws() -> None:
    program = f"import json, sys; from ruptfx.case import read_case; read_case('{CASE}'); " + (
        "print(json.dumps(['read', sorted(sys.modules)]))"
    )
    text, modules = loaded(program)
    assert text == "read" and "numpy" in modules
    assert not (HEAVY - {"numpy", "ruptfx.case"}) & modules


def test_the_analysis_of_fronts_imports_scipy_where_it_integrates() -> None:
    text, modules = loaded(
        "import json, sys; import ruptfx.laws.fracture, ruptfx.results.analysis.emission; "
        "print(json.dumps(['read', sorted(sys.modules)]))"
    )
    assert text == "read"
    assert not {"scipy.integrate", "scipy.optimize", "scipy.special", "scipy.sparse", "scipy.spatial"} & modules


@pytest.mark.fem
def test_a_communicator_of_mpi4py_alone_is_enough(tmp_path: Path) -> None:
    """A script that imports only mpi4py and passes its communicator: 2 us at 0.5 us or less are at least 4 steps."""
    pytest.importorskip("dolfinx")
    program = (
        "import sys; from mpi4py import MPI; from ruptfx import read_case, simulate; "
        "case = read_case('demos/impact.toml', ['mesh.element_size=10e-3', 'duration=2e-6', 'output.figures=false']); "
        "print(simulate(case, sys.argv[1], MPI.COMM_SELF, progress=False).summary['steps'])"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, str(tmp_path / "run")], capture_output=True, text=True, timeout=300, cwd=ROOT
    )
    assert done.returncode == 0 and int(done.stdout) >= 4, done.stderr
