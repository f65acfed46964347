"""The wheel: built from a copy of the sources, installed without them, used in an empty directory."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from zipfile import ZipFile

import pytest

ROOT = Path(__file__).resolve().parents[2]
NEEDED = ("pyproject.toml", "README.md", "LICENSE", "ruptfx", "demos")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(find_spec("setuptools") is None or find_spec("pip") is None, reason="needs setuptools and pip"),
]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    (folder / "source").mkdir()
    for name in NEEDED:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, folder / "source" / name, symlinks=True,
                            ignore=shutil.ignore_patterns("__pycache__", "out", "runs"))  # fmt: skip
        else:
            shutil.copy(ROOT / name, folder / "source" / name)
    subprocess.run(
        [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation", "--no-index",
         "--wheel-dir", folder, folder / "source"], check=True, timeout=300,
    )  # fmt: skip
    shutil.rmtree(folder / "source")
    (found,) = folder.glob("*.whl")
    return found


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the wheel alone; it comes before the clone on the path."""
    target = tmp_path_factory.mktemp("installed")
    subprocess.run(
        [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index", "--target", target, wheel],
        check=True, timeout=300,
    )  # fmt: skip
    return target


def test_it_holds_every_file_of_the_package(wheel: Path) -> None:
    """Modules, C, pages and demos; no tests, runs or caches."""
    tracked = subprocess.run(["git", "ls-files", "ruptfx", "demos"], cwd=ROOT, capture_output=True, text=True)
    if tracked.returncode:
        pytest.skip("no clone")
    kinds = (".py", ".c", ".h", ".html", ".toml", ".geo", ".csv")
    wanted = {
        f"ruptfx/{name}" if name.startswith("demos/") else name
        for name in tracked.stdout.splitlines() if name.endswith(kinds) and (ROOT / name).exists()
    }  # fmt: skip
    names = {name for name in ZipFile(wheel).namelist() if ".dist-info/" not in name}
    missing = {name for name in wanted - names if name.count("/") < 3 or not name.startswith("ruptfx/demos/")}
    assert not missing and "ruptfx/py.typed" in names and not {name for name in names if "tpv101" in name}
    assert not [name for name in names if not name.startswith("ruptfx/") or "__pycache__" in name]


def test_it_works_without_a_clone(installed: Path, tmp_path: Path) -> None:
    """Demos are copied, a case is written, checked and run, and its figures are drawn."""
    pytest.importorskip("dolfinx")
    environment = {**os.environ, "PYTHONPATH": str(installed)}

    def run(*arguments: str) -> str:
        done = subprocess.run([sys.executable, *arguments], cwd=tmp_path, env=environment, capture_output=True,
                              text=True, timeout=300)  # fmt: skip
        assert done.returncode == 0, done.stderr
        return done.stdout

    assert run("-c", "import ruptfx; print(ruptfx.__file__)").startswith(str(installed))
    run("-m", "ruptfx", "demos", "mine")
    copied = {path.name for path in (tmp_path / "mine").iterdir()}
    assert copied >= {"impact.toml", "impact_figures.py", "spring_slider.toml"}
    run("-m", "ruptfx", "run", "mine/spring_slider.toml", "--out", "slider", "--quiet")
    assert (tmp_path / "slider" / "result.nc").is_file()
    run("-m", "ruptfx", "new", "own", "--materials", "pmma")
    small = ["--set", "mesh.element_size=4e-3", "--set", "duration=5e-6"]
    assert "stable time step" in run("-m", "ruptfx", "check", "own.toml", *small)
    run("-m", "ruptfx", "run", "own.toml", *small, "--quiet")
    assert list((tmp_path / "runs" / "own" / "figures").glob("*.png"))


def test_benchmarks_of_a_checkout_run_with_the_wheel(installed: Path, tmp_path: Path) -> None:
    """The core set alone, with the others where their folder is given."""
    environment = {**os.environ, "PYTHONPATH": str(installed)}

    def bench(*arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run([sys.executable, "-m", "ruptfx", "bench", *arguments], cwd=tmp_path, env=environment,
                              capture_output=True, text=True, timeout=300)  # fmt: skip

    others = str(ROOT / "tests" / "benchmarks")
    pytest.importorskip("dolfinx")
    assert bench("waves").returncode == 0
    missing = bench("impact_bar")
    assert missing.returncode == 1 and "--from" in missing.stderr
    assert bench("impact_bar", "--from", others).returncode == 0
    alone, both = bench().stdout, bench("list", "--from", others).stdout
    assert "stress_barrier" in alone and "impact_bar" not in alone and "impact_bar" in both
