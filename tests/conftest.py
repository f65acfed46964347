"""Shared by all tests: what to skip without DOLFINx, and what goes to the same place for all of them."""

from __future__ import annotations

import gc
import os
import re
import resource
import sys
from collections import Counter
from collections.abc import Iterator
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import matplotlib
import pytest
import typer.testing

# Modules, cases and parameters stay until the end: to look for garbage among them took a sixth of the time of tests.
gc.disable()  # until all are collected, see `pytest_collection_finish`
gc.set_threshold(10_000, 10, 10)
os.environ.setdefault("OMP_NUM_THREADS", "1")
for name in ("COLUMNS", "LINES"):  # of a terminal, or 80 in each of several processes; tests give a width of their own
    os.environ.pop(name, None)
matplotlib.use("Agg")
# The commands of an application do not change; the runner would build them anew, in 0.1 s, for every call.
typer.testing._get_command = cache(typer.testing._get_command)  # type: ignore[attr-defined]

if find_spec("dolfinx") is not None:
    # First of all imports: the order of h5py, DOLFINx's own libraries and petsc4py matters.
    from ruptfx.platform.fem import MPI  # noqa: F401


def keep_forms() -> None:
    """Keep the compiled forms of this process: FFCx lists a folder of some thousand files for each form of a model."""
    from ffcx.codegeneration import jit

    read, forms = jit.get_cached_module, dict[tuple[str, str], tuple[Any, Any]]()

    def read_once(name: str, objects: list[str], folder: Path, timeout: int) -> tuple[Any, Any]:
        key = name, str(folder)
        if key in forms and Path(folder, f"{name}.c.cached").exists():
            return forms[key]
        result = read(name, objects, folder, timeout)
        if result[0] is not None:  # else it is to be compiled
            forms[key] = result
        return result

    jit.get_cached_module = read_once


def shorten_rehearsals() -> None:
    """Let `ruptfx check` time each part of a run once; it repeats them for half a second, for one number of a row."""
    from ruptfx.run import cost

    cost.SECONDS, cost.FEWEST, cost.PACES = 0.0, 1, 1


if find_spec("dolfinx") is not None:
    keep_forms()
    shorten_rehearsals()


@pytest.fixture(autouse=True)
def no_figure_is_left_open(request: pytest.FixtureRequest) -> Iterator[None]:
    """Those of pyplot are global: the next test would find them. What a page shows its reader may use pyplot."""
    yield
    if (pyplot := sys.modules.get("matplotlib.pyplot")) is not None:
        left = pyplot.get_fignums()
        pyplot.close("all")
        assert left == [] or request.node.get_closest_marker("docs")


@pytest.fixture
def blank_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures are written without contents, which take most of the time of commands whose files are the test."""
    from helpers.blank import leave_blank

    leave_blank(monkeypatch)


@pytest.fixture(scope="session")
def shared_tmp_path(tmp_path_factory: pytest.TempPathFactory):
    """A directory that all ranks of an MPI job agree on."""
    from ruptfx.platform import fem

    comm = fem.MPI.COMM_WORLD
    path = tmp_path_factory.mktemp("shared") if comm.rank == 0 else None
    return comm.bcast(path, root=0)


# Reasons for which tests may skip, as regular expressions; a skip for another reason makes the run fail.
ALLOWED_SKIPS = (
    # of the contract: what a kind does not have or refuses, of which another test says that some kind has it
    "not isotropic", "absorbing edges refuse oblique axes", "has no interface",
    "what moves against a side that is not meshed has a jump",
    "matrix_free goes round an axis with quadrilaterals only", "refuses large rotations",
    "has neither stiffness nor frequency", "no state", "no steady_strength", "no state that other laws share",
    "no smooth solution",
    # another test runs it
    "a study, not a case", r"tests/contracts/test_lumped\.py runs lumped cases", "rank 0 reads the files",
    "starts MPI jobs itself", "compares two runs of one rank", "inside mpiexec already",
    # of files that are not ours
    "set SEM2DPACK_EXAMPLES to the folder EXAMPLES",
    # of the machine
    "names of x86-64 processors", "a processor without AVX2",
    "no chromium or google-chrome is installed", "no Fortran compiler", "only root can give files away",
    "git is not installed",
    "the set-up finds the system's DOLFINx", "this Python cannot make environments", "the set-up wants a newer Python",
    "vectors of exp and pow come with GCC and glibc on x86-64 with AVX2", "a processor without AVX2",
    "names of x86-64 processors",
    "builds an image of 3.5 GB; ask for it with -m container",
    r"could not import 'vtkmodules\.vtkIOHDF'",
)  # fmt: skip
# Only the environment of `make env` is sure to have all modules that tests need.
if Path(sys.prefix) != Path(__file__).parents[1] / ".venv":
    ALLOWED_SKIPS += ("could not import", "needs DOLFINx", "needs mpi4py", "this Gmsh has no MED")


class Skips:
    """Count of skipped tests by reason, printed after the run; a run fails for reasons that are not allowed."""

    def __init__(self, allowed: tuple[str, ...] = ALLOWED_SKIPS) -> None:
        self.count: Counter[str] = Counter()
        self._allowed = re.compile("|".join(f"(?:{reason})" for reason in allowed))

    def refused(self) -> list[str]:
        """Return the reasons that are not allowed."""
        return [reason for reason in sorted(self.count) if not self._allowed.match(reason)]

    def add(self, report: pytest.TestReport | pytest.CollectReport) -> None:
        if report.skipped and not hasattr(report, "wasxfail"):
            # (path, line, "Skipped: reason")
            text = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
            self.count[text.removeprefix("Skipped: ")] += 1

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self.add(report)

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        self.add(report)

    @pytest.hookimpl(wrapper=True)
    def pytest_sessionfinish(self, session: pytest.Session) -> Iterator[None]:
        if self.refused() and session.exitstatus == pytest.ExitCode.OK:
            session.exitstatus = pytest.ExitCode.TESTS_FAILED
        return (yield)

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        if self.count:
            terminalreporter.section(f"{self.count.total()} skipped")
        for reason, number in self.count.most_common():
            terminalreporter.line(f"{number:5d}  {reason}")
        for reason in self.refused():
            terminalreporter.line(f"not among ALLOWED_SKIPS of tests/conftest.py: {reason}", red=True)


def pytest_collection_finish() -> None:
    gc.freeze()
    gc.enable()


def cpu_time() -> float:
    """Return the CPU time of this process and of its children that have ended [s]."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)


START = pytest.StashKey[float]()


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    item.stash[START] = cpu_time()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[None]) -> Iterator[Any]:
    """Add the CPU time of a test to its report: unlike its duration it is nearly the same on a busy machine."""
    if call.when == "teardown":
        item.user_properties.append(("cpu", f"{cpu_time() - item.stash[START]:.3f}"))
    return (yield)


def pytest_configure(config: pytest.Config) -> None:
    if not hasattr(config, "workerinput"):  # with xdist the controller gets the reports of all
        config.pluginmanager.register(Skips(), "ruptfx-skips")
