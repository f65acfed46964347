"""Frictional contact and rupture on FEniCSx.

    from ruptfx import read_case, simulate
    from ruptfx.results import plots

    case = read_case("demos/impact.toml", overrides=["mesh.element_size=4e-3"])
    record = simulate(case, out="runs/short")            # DOLFINx; lumped models do without it
    print(record.summary["mode"], record.interface.slip_rate)
    plots.space_time(record).figure.savefig("impact.pdf")

read_case, Case     a case of a TOML file; case.changed(key, value) is another one
simulate            run a case; the record of the run, or the result of a lumped model
Record              a run directory as arrays with units: interface, bulk, energy, instruments, summary
plots               figures of a record
gradient, infer     derivatives of an objective by its unknowns, and the unknowns from data
reconstruct         slip rate and traction along an interface from sensors
RuptfxError         base of all errors: what is wrong, where, and what to do

help(ruptfx.simulate), help(ruptfx.Record) ... say more. In a terminal: ruptfx --help, ruptfx describe, ruptfx demos.
The pages are in docs/ of a checkout; make docs builds them as a site.
"""

import os
from importlib import import_module
from typing import Any

from ruptfx.platform import former_modules
from ruptfx.platform.errors import RuptfxError as RuptfxError

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
# No __all__: `help(ruptfx)` would print the whole of every class in it.


def __getattr__(name: str) -> Any:
    if name not in _PUBLIC:
        raise AttributeError(f"module 'ruptfx' has no attribute '{name}'")
    module = import_module(_PUBLIC[name])
    return getattr(module, name, module)


def __dir__() -> list[str]:
    return sorted(["RuptfxError", "__version__", *_PUBLIC])
