"""`ruptfx.plugin` offers what plug-ins need, and modules are found by their names of the last version."""

from __future__ import annotations

import importlib
import subprocess
import sys
import warnings

import pytest

from ruptfx import plugin
from ruptfx.platform.former_modules import ROOMS, SINGLE, present_name

FORMER = [*SINGLE, *(name for names in ROOMS.values() for name in names.split())]


@pytest.mark.fem
def test_every_name_of_the_door_exists_and_is_public() -> None:
    for name in plugin.__all__:
        assert getattr(plugin, name) is not None and not name.startswith("_")
    assert {"FrictionLaw", "ContactMethod", "Material", "Stepper", "VaryingLength"} < set(plugin.__all__)
    with pytest.raises(AttributeError, match=r"Nothing.*FrictionLaw"):
        plugin.Nothing  # noqa: B018


def test_the_door_alone_loads_neither_figures_nor_the_finite_element_stack() -> None:
    code = (
        "import sys; from ruptfx.plugin import FrictionLaw, VaryingLength; "
        "print([name for name in ('matplotlib', 'dolfinx', 'mpi4py', 'typer') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.fem
def test_modules_of_the_last_version_are_the_present_ones() -> None:
    """In the same process: what a former name gives is the module of the present name, whose spec stays its own."""
    for former in FORMER:
        present = present_name(f"ruptfx.{former}")
        assert present is not None
        sys.modules.pop(f"ruptfx.{former}", None)
        with pytest.warns(DeprecationWarning, match=f"ruptfx.{former} is now {present};"):
            module = importlib.import_module(f"ruptfx.{former}")
        assert module is importlib.import_module(present)
        assert module.__spec__ is not None and module.__spec__.name == module.__name__ == present
    from ruptfx.friction.coulomb import Coulomb  # type: ignore[import-not-found]
    from ruptfx.laws.friction import coulomb

    assert Coulomb is coulomb.Coulomb


def test_other_names_are_not_found() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        for name in ("ruptfx.nothing", "ruptfx.friction.nothing"):
            with pytest.raises(ModuleNotFoundError):
                importlib.import_module(name)
