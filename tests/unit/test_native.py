"""The cache of compiled C: whose it must be to be loaded."""

from __future__ import annotations

import ctypes
import os
import platform
import stat
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from helpers.messages import facts

from ruptfx import RuptfxError
from ruptfx.platform.codegen import native

SEVEN = "int number(void) { return 7; }\n"
root_only = pytest.mark.skipif(os.geteuid() != 0, reason="only root can give files away")


@pytest.fixture
def use(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[Path], Path]]:
    """Makes a folder the XDG_CACHE_HOME of what is loaded next, as in a new process; returns the cache in it."""

    def use(base: Path) -> Path:
        monkeypatch.setenv("XDG_CACHE_HOME", str(base))
        monkeypatch.setattr(native, "_loaded", {})
        native.cache_directory.cache_clear()
        return base / "ruptfx"

    yield use
    native.cache_directory.cache_clear()
    native.find_compiler.cache_clear()


def compiled(folder: Path) -> Path:
    return next(folder.glob("seven-*.so"))


@pytest.fixture
def planted(tmp_path: Path, use: Callable[[Path], Path]) -> Path:
    """A cache in use where the library that returns 7 is somebody else's, which returns 13."""
    first = use(tmp_path / "first")
    native.load("seven", SEVEN)
    strange = tmp_path / "strange.c"
    strange.write_text(SEVEN.replace("7", "13"))
    cache = use(tmp_path / "second")
    cache.mkdir(parents=True, mode=0o700)
    file = cache / compiled(first).name
    native._compile(native.find_compiler(), strange.read_text(), file)
    return file


def test_the_cache_is_this_users_alone(tmp_path: Path, use: Callable[[Path], Path]) -> None:
    cache, before = use(tmp_path), os.umask(0)
    try:
        with warnings.catch_warnings(action="error"):
            assert native.load("seven", SEVEN).number() == 7
    finally:
        os.umask(before)
    assert stat.S_IMODE(cache.stat().st_mode) == 0o700
    assert compiled(cache).stat().st_mode & 0o022 == 0
    # What is there is used: the next process compiles nothing.
    made = compiled(cache).stat().st_mtime_ns
    use(tmp_path)
    assert native.load("seven", SEVEN).number() == 7 and compiled(cache).stat().st_mtime_ns == made


def test_what_lies_in_the_cache_is_loaded(planted: Path) -> None:
    """The others could not fail if it were not."""
    assert native.load("seven", SEVEN).number() == 13


@pytest.mark.parametrize("mode", [0o770, 0o703, 0o1777])
def test_nothing_is_loaded_from_a_directory_that_others_may_write_to(planted: Path, mode: int) -> None:
    planted.parent.chmod(mode)
    with pytest.warns(UserWarning) as said:
        assert native.load("seven", SEVEN).number() == 7
    words = str(said[0].message)
    assert f"{planted.parent} may be written to by others (mode {mode:o})" in words
    assert "remove it, or point XDG_CACHE_HOME" in words
    private = native.cache_directory()
    assert private != planted.parent and stat.S_IMODE(private.stat().st_mode) == 0o700 and compiled(private).exists()


def test_nothing_is_loaded_from_the_directory_of_another_user(planted: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    owner = os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: owner + 1)
    with pytest.warns(
        UserWarning, match=facts(f"belongs to user {owner}, not to {owner + 1}: compiled code in it is not")
    ):
        assert native.cache_directory() != planted.parent


@pytest.mark.parametrize(
    "change, said",
    [
        (lambda file: file.chmod(0o777), r"may be written to by others \(mode 777\)"),
        pytest.param(lambda file: os.chown(file, 4321, 4321), "belongs to user 4321, not to 0", marks=root_only),
    ],
)
def test_a_file_that_another_user_may_have_written_is_compiled_again(
    planted: Path, change: Callable[[Path], None], said: str
) -> None:
    change(planted)
    with pytest.warns(UserWarning, match=facts(f"{planted.name} {said}: it is not loaded")):
        assert native.load("seven", SEVEN).number() == 7
    assert ctypes.CDLL(str(planted)).number() == 7 and planted.stat().st_uid == os.geteuid()


def test_without_a_home_a_temporary_directory_does(tmp_path: Path, use: Callable[[Path], Path]) -> None:
    (tmp_path / "file").write_text("")
    use(tmp_path / "file" / "below")  # not even root can make a directory there
    with warnings.catch_warnings(action="error"):
        assert native.load("seven", SEVEN).number() == 7


def test_the_target_is_part_of_what_is_cached(
    tmp_path: Path, use: Callable[[Path], Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Code for another processor is another library, and a processor that nobody knows is an error."""
    seen = "int number(void) {\n#ifdef __AVX2__\nreturn 3;\n#else\nreturn 1;\n#endif\n}\n"
    if platform.machine() != "x86_64":
        pytest.skip("names of x86-64 processors")
    cache = use(tmp_path)
    found = []
    for target in ("x86-64", "x86-64-v3", "x86-64"):
        monkeypatch.setenv("RUPTFX_MARCH", target)
        if target == "x86-64-v3" and "avx2" not in native._processor():
            pytest.skip("a processor without AVX2")
        found.append(native.load("seen", seen).number())
    assert found == [1, 3, 1] and len(list(cache.glob("seen-*.so"))) == 2
    monkeypatch.setenv("RUPTFX_MARCH", "abacus")
    with pytest.raises(RuptfxError, match=r"RUPTFX_MARCH = 'abacus'"):
        native.load("seen", seen)


def test_code_that_crashes_a_compiler_is_optimised_less(
    tmp_path: Path, use: Callable[[Path], Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The compiler here crashes on -O3 alone; one that always crashes is an error."""
    real, crash = " ".join(native.find_compiler()), "echo 'internal compiler error: in isel' >&2; exit 4"
    script = tmp_path / "cc"
    for last, works in (("-O2", True), ("-O1", False)):
        use(tmp_path / last)
        script.write_text(f'#!/bin/sh\ncase "$*" in *{last}|--version) exec {real} "$@";; esac\n{crash}\n')
        script.chmod(0o700)
        monkeypatch.setenv("CC", str(script))
        native.find_compiler.cache_clear()
        if works:
            assert native.load("seven", SEVEN).number() == 7
        else:
            with pytest.raises(RuptfxError, match=facts("cc cannot compile seven.c: .*isel")):
                native.load("seven", SEVEN)


def test_a_macro_that_another_source_has_is_refused(tmp_path: Path, use: Callable[[Path], Path]) -> None:
    """The later one would change the code of the earlier one, with a warning that nobody reads."""
    use(tmp_path)
    source = "#define PARTS 1\nint number(void) { return PARTS; }\n"
    assert native.load("parts", source).number() == native.load("parts", source, {"PARTS": 1}).number() == 1
    with pytest.raises(RuptfxError, match=facts("cannot compile parts.c: .*PARTS.*redefined")):
        native.load("parts", source, {"PARTS": 3})
