"""Modules by their names before version 0.2: `ruptfx.friction` is `ruptfx.laws.friction`, with a warning."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Sequence
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import spec_from_loader
from types import ModuleType

ROOMS = {
    "app": "bench check_law checks cli commands convert drawing reference script",
    "bodies": "boundaries initial_stress meshes operators phases space spectrum state",
    "case": "support",
    "input": "fields plugins profiles schema units",
    "interfaces": "attachments collisions cracks faults mechanisms sliding",
    "laws": "cohesion contact friction materials nucleation",
    "many_runs": "adjoint inference study",
    "platform": "codegen fem",
    "readings": "instruments misfits",
    "results": "analysis cameras figure_style movies plots record",
    "run": "model recording simulation stages",
    "stepping": "implicit steppers stopping",
}
"""Rooms and the modules that stood at the root of the package."""
SINGLE = {
    "analysis.fracture": "laws.fracture", "analysis.rough_contact": "laws.rough_contact", "checks.cost": "run.cost",
    "instruments._readings": "readings.instruments.model_readings", "results.run_files": "platform.run_files",
    "materials._stiffness": "laws.materials.stiffness", "materials._traced": "laws.materials.traced",
    "mechanisms._nodes": "interfaces.mechanisms.stepped_nodes", "profiles._places": "input.profiles.places",
    "mechanisms._system": "interfaces.mechanisms.system",
}  # fmt: skip
"""Modules that moved apart from their folder."""
_ROOM_OF = {name: f"{room}.{name}" for room, names in ROOMS.items() for name in names.split()}


def present_name(name: str) -> str | None:
    """Return the present name of a module of the last version; None for any other name."""
    package, _, path = name.partition(".")
    first, _, inner = path.partition(".")
    if package != "ruptfx" or (path not in SINGLE and first not in _ROOM_OF):
        return None
    moved = SINGLE.get(path) or _ROOM_OF[first] + (f".{inner}" if inner else "")
    return f"ruptfx.{moved}"


class FormerModules(MetaPathFinder, Loader):
    """Finder and loader of modules by their names of the last version; the next version will not have it."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return a spec where a name is one of the last version."""
        return None if present_name(fullname) is None else spec_from_loader(fullname, self)

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """Import the module by its present name."""
        present = present_name(spec.name)
        assert present is not None
        message = f"the module {spec.name} is now {present}; the next version will not have the former name"
        warnings.warn(f"{message}; plug-ins import from ruptfx.plugin", DeprecationWarning, stacklevel=2)
        module = import_module(present)
        self._specs[spec.name] = module.__spec__
        return module

    _specs: dict[str, ModuleSpec | None] = {}

    def exec_module(self, module: ModuleType) -> None:
        """Return the module to its own spec, which the import by the former name has replaced."""
        assert module.__spec__ is not None
        module.__spec__ = self._specs.pop(module.__spec__.name)


def install() -> None:
    """Let imports find modules by their names of the last version, after all other ways of finding them."""
    sys.meta_path.append(FormerModules())
