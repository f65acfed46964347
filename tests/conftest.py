"""Shared by all tests: what to skip without DOLFINx, and what goes to the same place for all of them."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from importlib.util import find_spec

import matplotlib
import pytest

os.environ.setdefault("OMP_NUM_THREADS", "1")
for name in ("COLUMNS", "LINES"):  # of a terminal, or 80 in each of several processes; tests give a width of their own
    os.environ.pop(name, None)
matplotlib.use("Agg")

if find_spec("dolfinx") is not None:
    # First of all imports: the order of h5py, DOLFINx's own libraries and petsc4py matters.
    from ruptfx.fem import MPI  # noqa: F401


@pytest.fixture(autouse=True)
def no_figure_is_left_open(request: pytest.FixtureRequest) -> Iterator[None]:
    """Those of pyplot are global: the next test would find them. What a page shows its reader may use pyplot."""
    yield
    if (pyplot := sys.modules.get("matplotlib.pyplot")) is not None:
        left = pyplot.get_fignums()
        pyplot.close("all")
        assert left == [] or request.node.get_closest_marker("docs")


@pytest.fixture(scope="session")
def shared_tmp_path(tmp_path_factory: pytest.TempPathFactory):
    """A directory that all ranks of an MPI job agree on."""
    from ruptfx import fem

    comm = fem.MPI.COMM_WORLD
    path = tmp_path_factory.mktemp("shared") if comm.rank == 0 else None
    return comm.bcast(path, root=0)
