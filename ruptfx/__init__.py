"""Frictional contact and rupture on FEniCSx.

The pipeline, one module per arrow::

    Case -> mesh -> Model -> stepper -> recorder -> (files) -> Record -> analysis -> plots

Nothing heavy is imported here: the lumped models, `Record`, `analysis` and `plots` work without DOLFINx.
"""

import os
from importlib import import_module
from typing import Any, ClassVar

from ruptfx.platform import former_modules

# MPI ranks are the parallelism: threads inside NumPy would only get in each other's way. Before NumPy is imported.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

Table = dict[str, Any]  # with text as keys, as in TOML and JSON

__version__ = "0.2.0"

former_modules.install()

_PUBLIC = {
    "Case": "ruptfx.case",
    "read_case": "ruptfx.case",
    "simulate": "ruptfx.run.simulation",
    "gradient": "ruptfx.many_runs.adjoint.gradients",
    "infer": "ruptfx.many_runs.inference.inversion",
    "reconstruct": "ruptfx.many_runs.reconstruction.reconstruct",
    "Record": "ruptfx.results.record",
    "plots": "ruptfx.results.plots",
}
__all__ = ["RuptfxError", "__version__", *_PUBLIC]


class RuptfxError(Exception):
    """Anything the user can act upon: the message says what is wrong, where, and what to do.

    Attributes
    ----------
    exit_code : int
        Exit code of a command that ends with it.
    at_once : bool
        True if a command must end without the clean-up of its libraries.
    """

    exit_code: ClassVar[int] = 1
    at_once: ClassVar[bool] = False


def __getattr__(name: str) -> Any:
    if name not in _PUBLIC:
        raise AttributeError(f"module 'ruptfx' has no attribute '{name}'")
    module = import_module(_PUBLIC[name])
    return getattr(module, name, module)


def __dir__() -> list[str]:
    return sorted(__all__)
