"""Jobs of studies, gradients and inferences on a dask.distributed cluster, by default one on this machine."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Protocol, TypeVar

from ruptfx import RuptfxError, Table, __version__
from ruptfx.many_runs.jobs import children

Key = TypeVar("Key", int, str)


class Interrupted(RuptfxError):  # noqa: N818
    """Stopped by a signal; finished runs are kept."""

    exit_code = 130


class Future(Protocol):
    """A task of a dask cluster."""

    def exception(self) -> BaseException | None: ...

    def result(self) -> Table: ...

    def release(self) -> None: ...


class Client(Protocol):
    """A dask cluster, as far as studies and inferences use it."""

    def submit(
        self, function: Callable[..., Table], /, *args: object, key: str, pure: bool, retries: int
    ) -> Future: ...

    def run(self, function: Callable[..., object], /, *args: object) -> dict[str, tuple[str, bool]]: ...


@contextmanager
def opened(marker: Path | None, address: str | None, cores: int | None, ranks: int) -> Iterator[Client]:
    """Open a dask client: of the scheduler at `address`, or of threads in this process that start the runs.

    Parameters
    ----------
    marker : Path or None
        A file in the directory of the results, which all workers must see; None where they need no directory.
    cores : int or None
        Cores of this machine, without an address; None is all that this process may use.
    ranks : int
        MPI ranks of each run.

    Raises
    ------
    RuptfxError
        dask.distributed is missing; the scheduler does not answer; its workers lack ruptfx or the directory.
    """
    try:
        import dask
        from distributed import Client, LocalCluster
    except ImportError as error:
        raise RuptfxError(
            f"runs at once on several cores need dask.distributed ({error}): pip install 'ruptfx[study]'"
        ) from None
    children.open_for_work()
    with dask.config.set({"distributed.comm.timeouts.connect": "10s"}):
        if address is None:
            slots = max(1, (cores or len(os.sched_getaffinity(0))) // ranks)
            local: Table = {"processes": False, "dashboard_address": "127.0.0.1:0"}
            with LocalCluster(n_workers=1, threads_per_worker=slots, **local) as cluster, Client(cluster) as client:
                try:
                    yield client
                finally:
                    children.close_children()
            return
        try:
            client = Client(address, timeout="10s")
        except (OSError, ValueError) as error:
            raise RuptfxError(
                f"--scheduler {address}: no dask scheduler answers there ({error}); start one with: dask scheduler, "
                "and give the address that it prints"
            ) from None
        with client:
            _check_workers(client, marker)
            try:
                yield client
            finally:
                client.run(children.close_children)


def completed(
    client: Client, function: Callable[..., Table], jobs: Mapping[Key, tuple[object, ...]], name: str
) -> Iterator[tuple[Key, Table | str]]:
    """Run a function for several jobs at once, and yield the results as they come.

    Parameters
    ----------
    function : callable
        Runs on a worker, with the arguments of a job.
    jobs : mapping of a key to tuple
        Arguments.
    name : str
        Of the jobs, unlike that of other jobs of the cluster.

    Yields
    ------
    key, result
        The reason as text in place of the result of a job that was lost.

    Raises
    ------
    RuptfxError
        That of a job.
    """
    from distributed import as_completed

    pending = {
        client.submit(function, *arguments, key=f"{name}-{key}", pure=False, retries=0): key
        for key, arguments in jobs.items()
    }
    for done in as_completed(list(pending)):
        error = done.exception()
        if isinstance(error, RuptfxError):
            raise error
        result = f"{type(error).__name__}: {error}" if error is not None else done.result()
        done.release()
        yield pending[done], result


def answers(
    client: Client, jobs: Mapping[int, Table], ranks: int, server: str, name: str,
    lost: Callable[[int, str], str], tell: Callable[[int], None] = lambda count: None,
) -> dict[int, Table]:  # fmt: skip
    """Make jobs at once by the children of the workers, and return the values of their answers.

    Parameters
    ----------
    jobs : mapping of int to dict
    ranks : int
        MPI ranks of each child.
    server : str
        Program of the children, which answers as `server.serve` does.
    name : str
        Of the jobs, unlike that of other jobs of the cluster.
    lost : callable
        Returns the message for the number of a job without an answer and the reason.
    tell : callable
        Called with the number of finished jobs.

    Raises
    ------
    RuptfxError
        A job has failed or was lost.
    """
    values: dict[int, Table] = {}
    calls = {number: (server, ranks, job) for number, job in jobs.items()}
    for number, answer in completed(client, children.on_child, calls, name):
        if isinstance(answer, str):
            raise RuptfxError(lost(number, answer))
        if answer["status"] != "done":
            raise RuptfxError(answer["error"])
        values[number] = answer["values"]
        tell(len(values))
    return values


def _check_workers(client: Client, marker: Path | None) -> None:
    try:
        seen = client.run(_version_and_file, marker and str(marker))
    except Exception as error:
        raise RuptfxError(
            f"the workers cannot import ruptfx {__version__}: {error}; install it in the Python that starts them"
        ) from None
    for worker, (version, there) in seen.items():
        if version != __version__:
            raise RuptfxError(f"worker {worker} has ruptfx {version}, this is {__version__}; install the same")
        if marker is not None and not there:
            raise RuptfxError(
                f"worker {worker} does not see {marker.parent}: --out must be on a file system that all share"
            )


def _version_and_file(marker: str | None) -> tuple[str, bool]:
    """Return the version of a worker, and whether it sees a file."""
    children.open_for_work()
    return __version__, marker is not None and Path(marker).is_file()


@contextmanager
def stoppable(kept: Callable[[], str]) -> Iterator[None]:
    """End the children and the work after Ctrl-C or SIGTERM.

    Parameters
    ----------
    kept : callable
        Returns what is kept, for the message.

    Raises
    ------
    Interrupted
    """

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    before = None
    with suppress(ValueError):  # not the main thread
        before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    except KeyboardInterrupt:
        children.close_children()
        raise Interrupted(f"stopped; {kept()}") from None
    finally:
        if before is not None:
            signal.signal(signal.SIGTERM, before)
