"""Memory of this process and of this machine."""

from __future__ import annotations

import resource
from pathlib import Path
from typing import TYPE_CHECKING

from ruptfx import RuptfxError
from ruptfx.platform import parallel

if TYPE_CHECKING:
    from ruptfx.platform import fem


def largest_memory() -> float:
    """Return the peak memory of this program [bytes]; getrusage would include the program that started it."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024.0
    return next(float(line.split()[1]) * 1024 for line in lines if line.startswith("VmHWM:"))


def available(root: Path = Path("/")) -> float | None:
    """Return the free memory for this process [bytes], of the machine and of its control group; None if unknown."""
    try:
        lines = (root / "proc/meminfo").read_text().splitlines()
    except OSError:
        return None
    free = [float(line.split()[1]) * 1024 for line in lines if line.startswith("MemAvailable:")]
    groups = root / "sys/fs/cgroup"
    for limit, used in (("memory.max", "memory.current"),
                        ("memory/memory.limit_in_bytes", "memory/memory.usage_in_bytes")):  # fmt: skip
        try:
            free.append(float((groups / limit).read_text()) - float((groups / used).read_text()))
        except (OSError, ValueError):  # no such group, or its limit is "max"
            continue
    return max(min(free), 0.0) if free else None


def shortage(key: str, use: str, needed: float, remedy: str, note: str = "") -> str:
    """Return the refusal of a use of memory that is not free here; empty where it fits or the memory is not known.

    Parameters
    ----------
    key : str
        Of the case, with its value where it has one.
    use : str
        Plural noun: what takes the memory.
    needed : float
        Memory that all ranks on this machine take [bytes].
    remedy : str
        What the user can do.
    note : str
        Of the needed memory, after its number.
    """
    free = available()
    if free is None or needed <= free:
        return ""
    return f"{key}: {use} take {needed / 1e9:.3g} GB{note}, and {free / 1e9:.3g} GB are free here; {remedy}"


def refuse_shortage(comm: fem.MPI.Comm, key: str, use: str, needed: float, remedy: str, note: str = "") -> None:
    """Refuse a use of memory that is not free here, before it is taken; collective, with the arguments of `shortage`.

    Raises
    ------
    RuptfxError
        On all ranks.
    """
    text = shortage(key, use, needed, remedy, note)
    parallel.raise_on_all(comm, RuptfxError(text) if text else None)
