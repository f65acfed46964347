"""C code, compiled at first use with the compiler that FFCx needs anyway, for the widest vectors, and cached.

RUPTFX_MARCH=x86-64-v3, or another value of the compiler's `-march`, compiles for that processor instead.

NaN is preserved: the flags allow contraction and explicit `omp simd` loops, never finite-math assumptions.
"""

from __future__ import annotations

import ctypes
import hashlib
import math
import os
import platform
import shlex
import shutil
import stat
import subprocess
import sysconfig
import tempfile
import warnings
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import numpy as np

from ruptfx import RuptfxError

FLAGS = (
    "-std=gnu11", "-O3", "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=fast", "-fopenmp-simd",
    "-fPIC", "-shared",
)  # fmt: skip
WIDEST = ("-march=native", "-mprefer-vector-width=512")
"""Options for the processor at hand with its widest vectors."""

DOUBLE, SINGLE = np.dtype(np.float64), np.dtype(np.float32)
"""Types of floating-point numbers in C."""

_loaded: dict[str, ctypes.CDLL] = {}


def load(name: str, source: str, defines: Mapping[str, object] | None = None) -> ctypes.CDLL:
    """Return the shared library of a C source, compiled now or taken from the cache.

    Parameters
    ----------
    name : str
        Readable part of the file name in the cache.
    source : str
        C source text.
    defines : mapping, optional
        Preprocessor macros, ``{"ORDER": 4}`` is ``#define ORDER 4``.

    Raises
    ------
    RuptfxError
        No compiler, or a source that does not compile (its messages are quoted).
    """
    # Macros are part of the text, so that the cached file shows all there is to know.
    macros = "".join(f"#define {key} {value}\n" for key, value in (defines or {}).items())
    text = f'{macros}#line 1 "{name}.c"\n{source}'
    compiler = find_compiler()
    identity = "\0".join([text, *FLAGS, *map(str, _choices()), *compiler, _version(compiler), _processor()])
    key = f"{name}-{hashlib.sha256(identity.encode()).hexdigest()[:20]}"
    if key not in _loaded:
        file = cache_directory() / f"{key}.so"
        if not file.exists():
            _compile(compiler, text, file)
        elif danger := _danger(file):
            warnings.warn(f"{danger}: it is not loaded but compiled again", stacklevel=2)
            _compile(compiler, text, file)
        _loaded[key] = ctypes.CDLL(str(file))
    return _loaded[key]


def target() -> str:
    """Return the processor that code is compiled for, as in `-march`: $RUPTFX_MARCH, else native."""
    return os.environ.get("RUPTFX_MARCH") or "native"


def _choices() -> tuple[tuple[str, ...], ...]:
    """Return options for the target, fastest first; an empty one is the portable build."""
    return (WIDEST, WIDEST[:1], ("-mcpu=native",), ()) if target() == "native" else ((f"-march={target()}",),)


def aligned(shape: tuple[int, ...], real: np.dtype = DOUBLE) -> np.ndarray:
    """Return an uninitialised array aligned to a cache line, for vector loads."""
    size, line = math.prod(shape), 64 // real.itemsize
    raw = np.empty(size + line, dtype=real)
    offset = (-raw.ctypes.data // real.itemsize) % line
    return raw[offset : offset + size].reshape(shape)


def address(array: np.ndarray | None, real: np.dtype = DOUBLE) -> ctypes.c_void_p:
    """Return the address of the first value of an array, as an argument of a C function; NULL for None.

    Raises
    ------
    TypeError
        Floating-point numbers of another type than the C function reads.
    """
    if array is not None and array.dtype.kind == "f" and array.dtype != real:
        raise TypeError(f"an array of {array.dtype} where a C function reads {real}")
    return ctypes.c_void_p(None if array is None else array.ctypes.data)


def c_type(real: np.dtype) -> str:
    """Return the C type of floating-point numbers, the macro REAL of sources in which nodes may have either."""
    return {8: "double", 4: "float"}[real.itemsize]


@cache
def find_compiler() -> tuple[str, ...]:
    """Return the command of the C compiler: $CC, else that of the Python build, else gcc, cc or clang.

    Raises
    ------
    RuptfxError
        None of them is installed.
    """
    items = (os.environ.get("CC"), sysconfig.get_config_var("CC"), "gcc", "cc", "clang")
    for command in filter(None, items):
        words = shlex.split(command)
        if words and shutil.which(words[0]):
            return tuple(words)
    raise RuptfxError(
        "no C compiler found, and steps need one; install it with: apt install gcc libc6-dev "
        "(or point the variable CC to one)"
    )


@cache
def _version(compiler: tuple[str, ...]) -> str:
    return subprocess.run([*compiler, "--version"], capture_output=True, text=True, check=False).stdout


@cache
def _processor() -> str:
    """Return what `-march=native` depends on, model and instruction sets: a cache may be on a shared disk."""
    try:
        lines = Path("/proc/cpuinfo").read_text().split("\n\n")[0].splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    keys = ("vendor_id", "cpu family", "model", "model name", "flags", "Features", "CPU part")
    return "\n".join(line for line in lines if line.partition(":")[0].strip() in keys)


@cache
def cache_directory() -> Path:
    """Return $XDG_CACHE_HOME/ruptfx or ~/.cache/ruptfx, created for this user only.

    Libraries from the cache are loaded into this process: if others could write there, they could run any code. A
    directory of another user, or one that others may write to, is not used; a warning gives the
    remedy. In this case, and if the directory is not writable, a private temporary directory is used, so that
    every run compiles again.
    """
    base = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    try:
        directory = Path(base).expanduser() / "ruptfx"
        directory.mkdir(mode=0o700, parents=True, exist_ok=True)
        danger = _danger(directory)
        if not danger:
            with tempfile.TemporaryFile(dir=directory):
                return directory
        remedy = "remove it, or point XDG_CACHE_HOME to a directory of your own"
        warnings.warn(f"{danger}: compiled code in it is not loaded; {remedy}", stacklevel=2)
    except (OSError, RuntimeError):
        pass
    return Path(_private().name)


@cache
def _private() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix="ruptfx-", ignore_cleanup_errors=True)


def _danger(path: Path) -> str:
    """Return why other users may have changed a directory, by owner and mode; empty if they cannot."""
    result, user = path.stat(), os.geteuid()
    if result.st_uid != user:
        return f"{path} belongs to user {result.st_uid}, not to {user}"
    if result.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        return f"{path} may be written to by others (mode {stat.S_IMODE(result.st_mode):o})"
    return ""


def _compile(compiler: tuple[str, ...], text: str, file: Path) -> None:
    """Compile to a temporary name, then rename: several ranks may do this at the same time."""
    with tempfile.TemporaryDirectory(dir=file.parent) as work:
        source, built = Path(work) / f"{file.stem}.c", Path(work) / file.name
        source.write_text(text)
        refusals, choices = [], _choices()
        # libmvec holds the vector versions of exp, log and pow; not every system has it.
        for machine, libraries in ((m, li) for m in choices for li in (("-lmvec", "-lm"), ("-lm",))):
            command = [*compiler, *FLAGS, *machine, str(source), "-o", str(built), *libraries]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            if "internal compiler error" in done.stderr:  # gcc 12 crashes on vectors of comparisons before SSE 4.1
                done = subprocess.run([*command, "-O2"], capture_output=True, text=True, check=False)
            # A macro of one source that another one has, too, changes its code: no warning may hide that.
            if done.returncode == 0 and "redefined" not in done.stderr:
                break
            refusals.append(done.stderr.strip())
        else:
            message = refusals[0][:2000] or f"exit code {done.returncode}"
            if target() != "native":
                message += f"\nRUPTFX_MARCH = '{target()}': unset it if it is no processor that {compiler[0]} knows"
            raise RuptfxError(f"{compiler[0]} cannot compile {file.stem.partition('-')[0]}.c:\n{message}")
        if not machine:
            reason = (refusals[0].splitlines() or ["no message"])[0]
            warnings.warn(
                f"{compiler[0]} refuses -march=native ({reason}); using a portable build, which is slower",
                stacklevel=4,
            )
        built.chmod(0o700)  # independent of the umask
        kept = file.with_suffix(".c")
        os.replace(source, kept)
        os.replace(built, file)
