"""The environment itself: versions, the launcher of this MPI, the set-up script and the image's packages."""

from __future__ import annotations

import gzip
import os
import re
import shutil
import subprocess
import sys
import tomllib
from importlib.util import find_spec
from pathlib import Path

import pytest
from helpers.messages import says

import ruptfx
from ruptfx.platform.launch import find_mpiexec

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def test_version_is_written_the_same_everywhere():
    version = PROJECT["version"]
    assert ruptfx.__version__ == version and f"ruptfx-{version}-py3-none-any.whl" in (ROOT / "README.md").read_text()
    citation = dict(re.findall(r"^([a-z-]+): (\S+)$", (ROOT / "CITATION.cff").read_text(), re.MULTILINE))
    assert citation["version"] == version
    released = re.findall(r"^## (\S+) \((\d{4}-\d\d-\d\d)\)$", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert released[0] == (version, citation["date-released"])  # the newest release comes first
    assert [when for _, when in released] == sorted((when for _, when in released), reverse=True)


@pytest.mark.skipif(shutil.which("git") is None, reason="git is not installed")
def test_a_release_needs_a_clean_checkout(tmp_path):
    """Uncommitted files, and changes without the version of the release, are refused before anything is built."""
    (tmp_path / ".ci").mkdir()
    shutil.copy(ROOT / ".ci" / "release", tmp_path / ".ci")
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    (tmp_path / "CHANGELOG.md").write_text("## Unreleased\n")
    git = ["git", "-c", "user.name=a", "-c", "user.email=a@b", "-C", str(tmp_path)]
    environment = os.environ | {"PYTHON": "/nonexistent"}

    def release() -> str:
        done = subprocess.run([tmp_path / ".ci" / "release"], capture_output=True, text=True, env=environment)
        assert done.returncode == 1 and not (tmp_path / "dist").exists()
        return done.stderr

    subprocess.run([*git, "init", "-q"], check=True)
    assert "commit" in release()
    subprocess.run([*git, "add", "."], check=True)
    subprocess.run([*git, "commit", "-q", "-m", "all"], check=True)
    assert f"has no section '## {PROJECT['version']} (DATE)'" in release()
    (tmp_path / "CHANGELOG.md").write_text(f"## Unreleased\n\n## {PROJECT['version']} (2026-01-01)\n")
    subprocess.run([*git, "commit", "-q", "-a", "-m", "changes"], check=True)
    assert "has a section Unreleased" in release()


@pytest.mark.skipif(find_spec("mpi4py") is None, reason="needs mpi4py")
@pytest.mark.skipif("PMI_SIZE" in os.environ or "OMPI_COMM_WORLD_SIZE" in os.environ, reason="inside mpiexec already")
def test_mpiexec_is_the_one_of_mpi4py():
    program = "from ruptfx.platform import fem; print(fem.MPI.COMM_WORLD.size)"
    done = subprocess.run(
        [find_mpiexec(), "-n", "2", sys.executable, "-c", program],
        capture_output=True, text=True, timeout=120, cwd=ROOT, check=True,
        env=os.environ | {
            "OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
            "PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe",
        },
    )  # fmt: skip
    # Each of two ranks sees two; with a foreign mpiexec each would see itself only. Their lines may be merged.
    assert "".join(done.stdout.split()) == "22"


def checkout(path: Path) -> Path:
    """A directory with all that the set-up script reads."""
    (path / ".ci").mkdir()
    shutil.copy(ROOT / ".ci" / "setup", path / ".ci")
    shutil.copy(ROOT / "pyproject.toml", path)
    return path


def script(path: Path, name: str, text: str) -> None:
    path.mkdir(exist_ok=True)
    (path / name).write_text(f"#!/bin/sh\n{text}\n")
    (path / name).chmod(0o755)


def setup(path: Path, programs: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run the set-up script where only `programs` and a few tools are found."""
    programs.mkdir(exist_ok=True)
    for tool in ("cat", "rm"):
        (programs / tool).symlink_to(shutil.which(tool) or tool)
    return subprocess.run(
        ["/bin/sh", str(path / ".ci" / "setup")], capture_output=True, text=True, timeout=60, cwd="/", check=False,
        env={"PATH": str(programs), "HOME": str(path)} | environment,
    )  # fmt: skip


def sentence(done: subprocess.CompletedProcess[str]) -> str:
    assert done.returncode == 1
    assert done.stdout == "" and done.stderr.count("\n") == 1 and done.stderr.startswith("setup: "), done.stderr
    return done.stderr


needs_no_system_dolfinx = pytest.mark.skipif(
    subprocess.run(["/usr/bin/env", "/usr/bin/python3", "-c", "import dolfinx"], capture_output=True).returncode == 0,
    reason="the set-up finds the system's DOLFINx",
)


def test_the_oldest_python_is_the_same_everywhere():
    floor = PROJECT["requires-python"].removeprefix(">=")
    major, minor = floor.split(".")
    tools = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]
    assert tools["ruff"]["target-version"] == f"py{major}{minor}" and tools["mypy"]["python_version"] == floor
    assert f"version_info < ({major}, {minor})" in (ROOT / ".ci" / "setup").read_text()
    pages = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md"), ROOT / ".ci" / "setup", ROOT / "Makefile"]
    named = {version for page in pages for version in re.findall(r"Python (3\.\d+)", page.read_text())}
    assert named == {floor}


@needs_no_system_dolfinx
def test_setup_without_a_python_says_what_to_install(tmp_path: Path):
    path = checkout(tmp_path)
    assert "no Python 3.12 or newer was found; install one" in sentence(setup(path, tmp_path / "bin"))


@needs_no_system_dolfinx
def test_setup_runs_candidates_before_it_believes_them(tmp_path: Path):
    path, programs = checkout(tmp_path), tmp_path / "bin"
    script(programs, "python3.13", 'echo "pyenv: python3.13: command not found" >&2; exit 127')  # a shim
    old = 'case "$2" in *version_info*) exit 1;; esac; exit 0'
    script(programs, "python3", old)
    assert "no Python 3.12 or newer was found" in sentence(setup(path, programs))


@needs_no_system_dolfinx
def test_setup_names_a_python_without_venv(tmp_path: Path):
    path, programs = checkout(tmp_path), tmp_path / "bin"
    script(programs, "python3.13", 'case "$2" in *ensurepip*|*dolfinx*) exit 1;; esac; exit 0')
    assert "python3.13 has no venv module; install it with" in sentence(setup(path, programs))


def test_setup_refuses_a_python_that_was_asked_for_and_does_not_fit(tmp_path: Path):
    path = checkout(tmp_path)
    said = sentence(setup(path, tmp_path / "bin", PYTHON="/nonexistent/python"))
    assert says("PYTHON=/nonexistent/python is not a Python 3.12 or newer", said)


@pytest.mark.skipif(find_spec("ensurepip") is None, reason="this Python cannot make environments")
@pytest.mark.skipif(sys.version_info < (3, 12), reason="the set-up wants a newer Python for DOLFINx")
@pytest.mark.parametrize(
    ("compiler", "words"),
    [
        (None, "no C compiler was found"),
        ('for a; do :; done; grep -q stdio.h "$a" && exit 1; exit 0', "apt-get install libc6-dev"),
        ('for a; do :; done; grep -q Python.h "$a" && exit 1; exit 0', "apt-get install python3-dev"),
    ],
)
def test_setup_says_what_compiling_lacks(tmp_path: Path, compiler: str | None, words: str):
    path, programs = checkout(tmp_path), tmp_path / "bin"
    environment = {"PYTHON": sys.executable}
    if compiler is not None:
        script(programs, "mycc", f"PATH=/usr/bin:/bin; {compiler}")
        environment["CC"] = str(programs / "mycc")
    assert words in sentence(setup(path, programs, **environment))


def test_installed_package_has_all_files_that_are_not_python():
    patterns = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["package-data"]["ruptfx"]
    package = ROOT / "ruptfx"
    shipped = {path for pattern in patterns for path in package.glob(pattern)}
    assert set((ROOT / "demos").glob("*.toml")) <= {path.resolve() for path in shipped}
    there = {path for path in package.rglob("*") if path.is_file() and path.suffix not in (".py", ".pyc")}
    assert there <= shipped, f"not in package-data: {there - shipped}"


def names(requirements: list[str]) -> set[str]:
    found = (re.match(r"[A-Za-z0-9_.-]+", requirement) for requirement in requirements)
    return {match[0].lower() for match in found if match}


def test_image_installs_every_dependency_from_apt():
    packages = set(re.findall(r"\bpython3-([a-z0-9-]+)", (ROOT / "Dockerfile").read_text()))
    extras = PROJECT["optional-dependencies"]
    wanted = names(PROJECT["dependencies"]) | names(extras["fem"]) | names(extras["study"])
    wanted = wanted - {"dolfinx-solver-real", "pillow"} | {"dolfinx", "pil"}  # Debian's names
    assert wanted <= packages, f"not in the Dockerfile: {wanted - packages}"


def test_image_has_the_version_as_tag_and_label():
    text = (ROOT / "Dockerfile").read_text()
    assert f"org.opencontainers.image.version={PROJECT['version']}" in text
    assert f"docker build -t ruptfx:{PROJECT['version']} " in text


def test_an_archive_of_the_image_has_the_version_as_its_tag(tmp_path: Path):
    """With a program in the place of Docker, which prints what it is called with."""
    script(tmp_path, "docker", f'echo "$@" >>{tmp_path}/calls; [ "$1" != save ] || echo layers')
    environment = os.environ | {"PATH": f"{tmp_path}:{os.environ['PATH']}"}

    def image(*arguments: object) -> subprocess.CompletedProcess[str]:
        command = [str(ROOT / ".ci" / "image"), *map(str, arguments)]
        return subprocess.run(command, capture_output=True, text=True, timeout=60, env=environment, check=False)

    archive, name = tmp_path / "image.tar.gz", f"ruptfx:{PROJECT['version']}"
    for action in ("save", "load"):
        assert "an archive is missing" in image(action).stderr
        assert image(action, archive).returncode == 0
    assert gzip.decompress(archive.read_bytes()) == b"layers\n"
    tag, save, load, back = (line for line in (tmp_path / "calls").read_text().splitlines() if line != "info")
    own = tag.split()[1]
    assert own.startswith("ruptfx-ci:") and (tag, back) == (f"tag {own} {name}", f"tag {name} {own}")
    assert (save, load) == (f"save {name}", f"load --quiet --input {archive}")


CONDA_NAMES = {"dolfinx-solver-real": "fenics-dolfinx", "gmsh": "python-gmsh", "matplotlib": "matplotlib-base"}


def test_conda_recipe_has_the_dependencies_of_the_project():
    yaml = pytest.importorskip("yaml")
    recipe = yaml.safe_load((ROOT / ".ci" / "conda" / "recipe.yaml").read_text())
    assert recipe["package"] == {"name": PROJECT["name"], "version": PROJECT["version"]}
    assert recipe["build"]["python"]["entry_points"] == ["ruptfx = " + PROJECT["scripts"]["ruptfx"]]
    assert recipe["about"]["summary"] == PROJECT["description"]
    given = [*PROJECT["dependencies"], *PROJECT["optional-dependencies"]["fem"]]
    wanted = set()
    for requirement in given:
        name, bounds = re.fullmatch(r"([\w-]+)([<>=.,\d]*)(;.*)?", requirement.strip()).group(1, 2)
        wanted.add(f"{CONDA_NAMES.get(name, name)} {bounds}")
    assert set(recipe["requirements"]["run"]) == wanted | {f"python {PROJECT['requires-python']}", "c-compiler"}
    build = tomllib.loads((ROOT / "pyproject.toml").read_text())["build-system"]["requires"]
    assert {each.replace(" ", "") for each in recipe["requirements"]["host"]} >= set(build)


@pytest.mark.skipif(find_spec("dolfinx") is None, reason="needs DOLFINx")
def test_an_ordinary_run_does_without_what_draws_and_without_scipy(tmp_path: Path):
    """Their import takes longer than a run of 0.2 million nodes to its first step."""
    program = (
        "import pathlib, sys; import ruptfx.app.cli, ruptfx.run.simulation; from ruptfx.case import read_case; "
        "given = ['mesh.element_size=10e-3', 'duration=20e-6', 'output.figures=false']; "
        "case = read_case(pathlib.Path('demos/impact.toml'), given); "
        f"ruptfx.run.simulation.simulate(case, {str(tmp_path / 'run')!r}, progress=False); "
        "late = {'xarray', 'pandas', 'matplotlib', 'scipy', 'dask', 'numpy.f2py'}; "
        "print(sorted(late & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=120, cwd=ROOT)
    assert done.stdout.strip() == "[]", done.stderr


@pytest.mark.skipif(find_spec("dolfinx") is None, reason="needs DOLFINx")
@pytest.mark.parametrize(("arguments", "code"), [(["--version"], 0), (["describe", "nothing"], 1)])
def test_a_program_that_ends_at_once_leaves_nothing_undone(arguments: list[str], code: int):
    """What was said is said, what others registered is done, and MPI is left in good order."""
    program = (
        "import atexit, ctypes, sys; from ruptfx.app import cli; from ruptfx.platform import fem; fem.MPI; "
        "atexit.register(lambda: print('left', fem.MPI.Is_finalized())); "
        "c = ctypes.CDLL(None); c.strdup.restype = ctypes.c_void_p; "
        "c.__cxa_atexit(c.puts, ctypes.c_void_p(c.strdup(b'left C')), None); "
        f"sys.argv = ['ruptfx', *{arguments!r}]; cli.program()"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=120, cwd=ROOT)
    assert done.returncode == code and "Traceback" not in done.stderr, done.stderr
    # Exit handlers of C, too: in one of them MPICH takes leave of mpiexec, which else kills the other ranks at times.
    assert done.stdout.splitlines()[-2:] == [f"left {code == 0}", "left C"]
    assert code or done.stdout.splitlines()[0] == ruptfx.__version__
