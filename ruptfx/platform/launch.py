"""Start of a run on several ranks with the mpiexec that matches mpi4py of this environment."""

from __future__ import annotations

import ctypes
import os
import secrets
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from ruptfx import RuptfxError

if TYPE_CHECKING:
    from mpi4py.MPI import Comm

STOP = "RUPTFX_STOP"  # path of the file with which the launcher asks the ranks to stop
STOPPING = (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1, signal.SIGXCPU)
PR_SET_PDEATHSIG = 1  # of prctl(2)
RANKS = "RUPTFX_RANKS"  # number of ranks requested by the launcher, which the ranks compare with the actual one


def no_fem(missing: str) -> RuptfxError:
    """Return the error of a missing DOLFINx, with commands that install it."""
    return RuptfxError(
        f"DOLFINx is not installed here ({missing}). Install it, in a clone of ruptfx, with: make env; or with: "
        f"{shlex.quote(sys.executable)} -m pip install 'ruptfx[fem]' (Linux x86-64); "
        "on Debian 13: sudo apt-get install python3-dolfinx"
    )


def need_fem() -> None:
    """Refuse to start ranks if DOLFINx is missing.

    Raises
    ------
    RuptfxError
        DOLFINx is not installed.
    """
    if find_spec("dolfinx") is None:
        raise no_fem("No module named 'dolfinx'")


def is_first_rank() -> bool:
    """Return whether this process is rank 0, or runs alone, without loading MPI: from what its launcher has set."""
    set_by = ("OMPI_COMM_WORLD_RANK", "PMI_RANK", "PMIX_RANK", "SLURM_PROCID")  # Open MPI, MPICH, others
    return next((os.environ[name] for name in set_by if name in os.environ), "0") == "0"


def end_all(comm: Comm) -> None:
    """End all ranks after an error of this one: others may wait for it."""
    sys.stderr.flush()
    time.sleep(0.5)  # let mpiexec forward the message before the abort
    comm.Abort(RuptfxError.exit_code)


def find_mpiexec() -> str:
    """Return `mpiexec` next to this Python, else `mpirun` of the system.

    Raises
    ------
    RuptfxError
    """
    # Not resolved: in a virtual environment sys.executable is a link that leads out of it.
    beside = Path(sys.executable).parent / "mpiexec"
    mpiexec = str(beside) if beside.exists() else shutil.which("mpirun") or shutil.which("mpiexec")
    if mpiexec is None:
        raise RuptfxError("no mpiexec found: install MPI (it comes with DOLFINx), or run on one rank")
    return mpiexec


def mpi_command(ranks: int, module: str, *arguments: str) -> list[str]:
    """Return the command line of ``python -m MODULE ARGUMENTS`` on `ranks` ranks."""
    return [find_mpiexec(), "-n", str(ranks), sys.executable, "-m", module, *arguments]


def mpi_environment(ranks: int) -> dict[str, str]:
    """Return the environment of a run on `ranks` ranks: one thread per rank, any number of ranks."""
    environment = dict(os.environ, **{RANKS: str(ranks), "OMP_NUM_THREADS": os.environ.get("OMP_NUM_THREADS", "1")})
    # Open MPI: allow root (in containers) and more ranks than cores.
    environment.setdefault("OMPI_ALLOW_RUN_AS_ROOT", "1")
    environment.setdefault("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1")
    environment.setdefault("PRTE_MCA_rmaps_default_mapping_policy", ":oversubscribe")
    return environment


def run_on(ranks: int, arguments: list[str], **variables: str) -> int:
    """Run ``python -m ruptfx ARGUMENTS`` on `ranks` ranks with further variables; return the exit code.

    Raises
    ------
    RuptfxError
        DOLFINx is not installed, or no mpiexec is.
    """
    need_fem()
    environment = mpi_environment(ranks) | variables
    if sys.stderr.isatty():
        environment["RUPTFX_TERMINAL"] = "1"
        environment.setdefault("COLUMNS", str(shutil.get_terminal_size().columns))
    # Created only when the ranks are asked to stop: a killed launcher leaves no file.
    asked = Path(tempfile.gettempdir(), f"ruptfx_stop_{secrets.token_hex(8)}")
    environment[STOP] = str(asked)
    # A session of its own: Open MPI's mpirun would kill the ranks at the first Ctrl-C of the terminal, before they
    # have written anything. They are asked through a file instead, whatever the MPI library.
    process = subprocess.Popen(
        mpi_command(ranks, "ruptfx", *arguments), env=environment, start_new_session=True,
        preexec_fn=ends_with_parent(),
    )  # fmt: skip

    def stop(number: int, _: object) -> None:
        if asked.exists():
            if number in (signal.SIGINT, signal.SIGTERM):  # second request: end the ranks immediately
                process.send_signal(number)
        else:
            part = asked.with_suffix(".new")
            part.write_text("Ctrl-C" if number == signal.SIGINT else signal.Signals(number).name)
            part.replace(asked)

    before = {number: signal.signal(number, stop) for number in STOPPING}
    try:
        return process.wait()
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        asked.unlink(missing_ok=True)


def ends_with_parent() -> Callable[[], None]:
    """Return what a child process calls first, so that the kernel ends it when its parent ends, however that comes.

    On Linux; elsewhere it does nothing. There the parent is the thread that starts the child.
    """
    # Loaded before the fork, after which a child of a process with several threads must not take locks.
    libc = ctypes.CDLL(None) if sys.platform == "linux" else None
    return partial(_end_with, os.getpid(), libc)


def _end_with(parent: int, libc: ctypes.CDLL | None) -> None:
    if libc is None:
        return
    libc.prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent:  # the parent has already ended
        os._exit(1)


def asked_to_stop() -> str:
    """Return the name of the signal with which the launcher asked to stop; empty without a request."""
    path = os.environ.get(STOP)
    return Path(path).read_text() if path and os.path.exists(path) else ""


def check_size(size: int) -> None:
    """Refuse to run if the launcher and mpi4py use different MPI libraries.

    Raises
    ------
    RuptfxError
    """
    asked = int(os.environ.get(RANKS, size))
    if asked != size:
        raise RuptfxError(
            f"{asked} ranks were asked for, but mpi4py sees {size}: mpiexec is not the one of mpi4py's MPI library. "
            f"Use the mpiexec beside {sys.executable}, or reinstall mpi4py for this MPI"
        )
