"""Memory of this process and of this machine."""

from __future__ import annotations

import resource
from pathlib import Path


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
