"""The image that the Dockerfile describes: built, run as root and as another user, and its numbers on DOLFINx 0.9."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
IMAGE = ROOT / ".ci" / "image"
# Code that tests compile in the image is kept for the next run: half of their time when nothing has been compiled yet.
COMPILED = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "ruptfx-ci" / "compiled"
# Stuck for the most part, and without sliding that would amplify rounding.
SMALL = ["--set", "mesh.element_size=4e-3", "--set", "duration=20e-6"]

pytestmark = pytest.mark.container


def image(*arguments: str, timeout: float = 900) -> subprocess.CompletedProcess[str]:
    return subprocess.run([str(IMAGE), *arguments], capture_output=True, text=True, timeout=timeout, check=False)


@pytest.fixture(scope="module", autouse=True)
def built(request: pytest.FixtureRequest) -> None:
    if "container" not in request.config.option.markexpr:
        pytest.skip("builds an image of 3.5 GB; ask for it with -m container")
    done = image("build", timeout=1500)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]


def test_default_command_leaves_a_run_of_two_ranks_in_out(tmp_path: Path):
    done = image("run", "--volume", f"{tmp_path}:/out")
    assert done.returncode == 0, done.stderr[-3000:]
    summary = json.loads((tmp_path / "impact" / "summary.json").read_text())
    assert summary["ranks"] == 2
    assert summary["versions"]["dolfinx_version"].startswith("0.9")
    assert list((tmp_path / "impact" / "figures").glob("*.png"))
    assert "figures" in done.stdout  # says where the pictures are


@pytest.mark.parametrize("user", ["1000:1000", "4321:4321"])
def test_runs_as_any_user(tmp_path: Path, user: str):
    tmp_path.chmod(0o777)
    command = ["ruptfx", "run", "demos/impact.toml", "--ranks", "2", "--out", "/out/run", *SMALL]
    done = image("run", "--user", user, "--volume", f"{tmp_path}:/out", "--", *command)
    assert done.returncode == 0, done.stderr[-3000:]
    assert (tmp_path / "run" / "summary.json").stat().st_uid == int(user.split(":")[0])
    assert "not loaded" not in done.stderr  # the cache is this user's own


def test_says_so_when_out_belongs_to_another_user(tmp_path: Path):
    out = tmp_path / "theirs"
    out.mkdir(mode=0o755)
    other = "4321:4321" if os.getuid() != 4321 else "4322:4322"
    done = image("run", "--user", other, "--volume", f"{out}:/out")
    assert done.returncode != 0
    said = done.stdout + done.stderr
    assert "/out/impact" in said and "Traceback" not in said, said[-3000:]
    assert not list(out.iterdir())


def test_same_numbers_as_here(tmp_path: Path):
    command = ["run", "demos/impact.toml", "--ranks", "2", "--quiet", *SMALL]
    done = image("run", "--volume", f"{tmp_path}:/out", "--", "ruptfx", *command, "--out", "/out/there")
    assert done.returncode == 0, done.stderr[-3000:]
    subprocess.run([sys.executable, "-m", "ruptfx", *command, "--out", str(tmp_path / "here")], cwd=ROOT, check=True)
    there, here = (json.loads((tmp_path / name / "summary.json").read_text()) for name in ("there", "here"))
    assert there["case_hash"] == here["case_hash"]
    assert there["steps"] == here["steps"]
    for key in ("peak_slip_rate", "max_slip"):
        # Other compilers and libraries order sums differently: rounding, grown over some hundred steps.
        assert there[key] == pytest.approx(here[key], rel=1e-8)


# What another DOLFINx, Python or processor can change: forms, compiled steps and solvers. Of the unit tests those that
# build bodies, without those of many whole runs and of what knows nothing of such changes.
BODIES = ("contact", "cracks", "held_points", "large_rotations", "materials", "memory_materials", "operators",
          "preconditioners", "sliding", "steppers", "varying_materials")  # fmt: skip
CONTRACTS = " ".join(f"tests/contracts/test_{name}.py" for name in BODIES)
LEFT_OUT = ("analysis_resolution", "convergence", "design", "local_steps", "plugins")
UNIT = " ".join(["-m 'fem and not slow'", *(f"--ignore=tests/unit/test_{name}.py" for name in LEFT_OUT), "tests/unit"])


@pytest.mark.parametrize(
    "tests",
    [
        # Code for other vectors, and other kernels of the BLAS, round otherwise. This is the only run of contracts
        # for the oldest x86-64; verification has its own (`make test-portable`).
        f"RUPTFX_MARCH=x86-64 OPENBLAS_CORETYPE=Haswell python3 -m pytest -n 2 --dist loadfile {CONTRACTS}",
        f"python3 -m pytest -n 2 --dist loadfile {UNIT}",
        "mpirun -n 2 python3 -m pytest tests/mpi",
    ],
    ids=["contracts", "unit", "two_ranks"],
)
def test_suite_passes_inside(tests: str):
    COMPILED.mkdir(parents=True, exist_ok=True)
    # The checkout is read-only there: what tests keep goes to /tmp.
    setting = (
        "export HOME=/tmp XDG_CACHE_HOME=/compiled HYPOTHESIS_STORAGE_DIRECTORY=/tmp/hypothesis "
        "PYTHONPYCACHEPREFIX=/tmp/compiled PYTHONDONTWRITEBYTECODE= "
        "PYTEST_ADDOPTS='-p no:cacheprovider --durations=20 --durations-min=3'"
    )
    volumes = [f"--volume={ROOT}:/src:ro", f"--volume={COMPILED}:/compiled"]
    done = image("run", *volumes, "--", "bash", "-c", f"cd /src && {setting} && {tests}", timeout=1500)
    print(done.stdout[-6000:])
    assert done.returncode == 0, done.stdout[-6000:] + done.stderr[-1000:]
