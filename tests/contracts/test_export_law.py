"""Every law as C, Fortran and Python is that of the package; a new law or language is tested without an edit here."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.messages import facts
from helpers.small_cases import friction_laws, merged, plates

from ruptfx import RuptfxError, __version__
from ruptfx.app.check_law.examples import friction
from ruptfx.app.export_law import ExportedLaw, exported, files_of, languages, law_of
from ruptfx.app.export_law.fortran import TEXTS
from ruptfx.laws.friction import FrictionLaw
from ruptfx.platform.codegen.tracing import _C

LAWS = friction_laws()
every_law = pytest.mark.parametrize("kind, wrapped", LAWS, ids=["-".join(filter(None, law)) for law in LAWS])
every_language = pytest.mark.parametrize("language", languages())
COUNT = 1000
Functions = dict[str, Callable[..., Any]]


def fortran_compiler() -> str:
    compiler = os.environ.get("FC", "gfortran")
    if shutil.which(compiler) is None:
        pytest.skip("no Fortran compiler: neither $FC nor gfortran (apt install gfortran)")
    return compiler


def c_compiler() -> str:
    compiler = os.environ.get("CC", "gcc")
    if shutil.which(compiler) is None:
        pytest.skip("no C compiler: neither $CC nor gcc (apt install gcc)")
    return compiler


def written(law: ExportedLaw, language: str, folder: Path) -> Path:
    for name, text in files_of(law, language).items():
        (folder / name).write_text(text)
    return folder


def build(folder: Path, *command: str) -> None:
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0 and "warning" not in done.stderr, done.stderr[-2000:]


def library(law: ExportedLaw, language: str, folder: Path) -> Functions:
    """Functions of arrays of a compiled language, by name."""
    if language == "c":
        build(folder, c_compiler(), "-std=c11", "-Wall", "-Wextra", "-Werror", "-O1", "-ffp-contract=off", "-fPIC",
              "-shared", f"{law.kind}.c", "-lm", "-o", "law.so")  # fmt: skip
    else:
        build(folder, fortran_compiler(), "-std=f2008", "-O1", "-ffp-contract=off", "-fPIC", "-shared",
              f"{law.kind}.f90", "-o", "law.so")  # fmt: skip
    loaded = ctypes.CDLL(str(folder / "law.so"))
    parameters = (ctypes.c_double * max(len(law.parameters), 1))(*(each.value for each in law.parameters))
    names = list(law.states)

    def of_arrays(name: str, inputs: tuple[str, ...], reads: bool, returns_state: bool) -> Callable[..., Any]:
        function = getattr(loaded, f"{law.kind}_{name}")
        function.restype = None if returns_state else ctypes.c_double

        def call(state: Mapping[str, np.ndarray], x: Mapping[str, np.ndarray]) -> Any:
            result = np.empty((COUNT, max(len(names), 1)))
            values = np.empty(COUNT)
            for i in range(COUNT):
                s = (ctypes.c_double * max(len(names), 1))(*(state[name][i] for name in names))
                new = (ctypes.c_double * max(len(names), 1))()
                arguments = [parameters, *([s] if reads else []), *(ctypes.c_double(x[name][i]) for name in inputs)]
                values[i] = function(*arguments, *([new] if returns_state else [])) or 0.0
                result[i] = new[:]
            return {name: result[:, k] for k, name in enumerate(names)} if returns_state else values

        return call

    return {
        each.name: of_arrays(each.name, each.inputs, each.reads_state, each.returns_state) for each in law.functions
    }


def module(law: ExportedLaw, folder: Path) -> Functions:
    """Functions of arrays of the Python file, by name."""
    scope: dict[str, Any] = {"__name__": "law"}
    sys.modules["law"] = type(sys)("law")  # for its dataclass
    exec((folder / f"{law.kind}.py").read_text(), scope)
    p = scope["Parameters"]()

    def of_arrays(name: str, inputs: tuple[str, ...], reads: bool) -> Callable[..., Any]:
        return lambda state, x: scope[name](p, *([state] if reads else []), *(x[each] for each in inputs))

    return {each.name: of_arrays(each.name, each.inputs, each.reads_state) for each in law.functions}


@cache
def points(kind: str, wrapped: str | None) -> tuple[FrictionLaw, dict[str, np.ndarray], dict[str, np.ndarray]]:
    """A law, random arguments, and states after a few random steps."""
    law = friction(kind, wrapped)
    random = np.random.default_rng(7)
    x = {
        "slip_rate": 10 ** random.uniform(-9, 2, COUNT), "normal_stress": 10 ** random.uniform(4, 8.5, COUNT),
        "dt": 10 ** random.uniform(-9, 2, COUNT),
    }  # fmt: skip
    x["shear_stress"] = x["normal_stress"] * random.uniform(0.1, 0.9, COUNT)
    x["slip_rate"][:20] = 0.0
    x["normal_stress"][10:30] = 0.0
    state = law.initial_state(x["normal_stress"], x["shear_stress"], x["slip_rate"])
    for _ in range(3):
        rate = 10 ** random.uniform(-9, 1, COUNT)
        state = law.advance(state, rate, 10 ** random.uniform(4, 8.5, COUNT), 10 ** random.uniform(-9, 0, COUNT))
    return law, x, {name: np.broadcast_to(value, COUNT).astype(float) for name, value in state.items()}


@every_law
@every_language
def test_an_exported_law_is_that_of_the_package(language: str, kind: str, wrapped: str | None, tmp_path: Path) -> None:
    """At 1000 random states and steps, at rest and open as well; relative 1e-14."""
    with np.errstate(all="ignore"):
        law, x, state = points(kind, wrapped)
        made = exported(law)
        folder = written(made, language, tmp_path)
        functions = module(made, folder) if language == "python" else library(made, language, folder)
        rate, stress = x["slip_rate"], x["normal_stress"]
        strength = functions["strength"](state, x)
        expected = {"strength": (strength, law.strength(rate, stress, state))}
        if made.states:
            new, start = functions["advance"](state, x), functions["initial_state"](state, x)
            advanced = law.advance(state, rate, stress, x["dt"])
            initial = law.initial_state(stress, x["shear_stress"], rate)
            expected |= {f"advance {name}": (new[name], advanced[name]) for name in made.states}
            expected |= {f"initial_state {name}": (start[name], initial[name]) for name in made.states}
        for name, (value, known) in expected.items():
            # A state that passes zero in a step is compared with the one before.
            before = np.abs(state[name.removeprefix("advance ")]) if name.startswith("advance") else 0.0
            near = np.abs(value - known) <= 1e-14 * np.maximum(np.abs(known), before)
            i = int(np.argmin(near | (value == known)))
            assert np.all(near | (value == known)), f"{name}: {value[i]!r}, {known[i]!r}" if np.ndim(value) else name
        # The slope by central differences: relative error 1e-10 of the strength over the step.
        h = 1e-5
        moving = np.flatnonzero((rate > 0) & (stress > 0))
        high, low = (law.strength(rate * f, stress, state) + 0 * rate for f in (1 + h, 1 - h))
        slope = (functions["strength_slope"](state, x) + 0 * rate) * rate
        near = np.abs(slope - (high - low) / (2 * h)) <= 1e-8 * np.abs(high) + 1e-300
        assert np.all(near[moving])


@every_language
@pytest.mark.parametrize(("kind", "wrapped"), [LAWS[0], ("rate_and_state_two_states", None)])
def test_the_test_of_an_exported_law(language: str, kind: str, wrapped: str | None, tmp_path: Path) -> None:
    """It passes, and fails for a parameter that is wrong in the ninth digit."""
    made = exported(friction(kind, wrapped))
    folder = written(made, language, tmp_path)
    ending = {"c": "c", "fortran": "f90", "python": "py"}[language]
    source = folder / f"{kind}.{ending}"
    command = {
        "c": lambda: [c_compiler(), f"{kind}.c", f"{kind}_test.c", "-lm", "-o", "test"],
        "fortran": lambda: [fortran_compiler(), f"{kind}.f90", f"{kind}_test.f90", "-o", "test"],
        "python": list,
    }[language]()  # fmt: skip
    run = [sys.executable, str(source)] if language == "python" else [str(folder / "test")]
    value = made.parameters[0].value
    for wrong in (False, True):
        if wrong:
            text = source.read_text()
            assert repr(value) in text
            source.write_text(text.replace(repr(value), repr(value * (1 + 1e-8))))
        if command:
            build(folder, *command)
        done = subprocess.run(run, cwd=folder, capture_output=True, text=True, timeout=60, check=False)
        assert done.returncode == int(wrong), done.stdout
        assert kind in done.stdout


@every_language
def test_a_file_says_where_it_comes_from(language: str) -> None:
    law = friction("prakash_clifton", "linear_slip_weakening")
    made = exported(law)
    (text, *_) = [text for name, text in files_of(made, language).items() if name.startswith("prakash_clifton.")]
    plain = " ".join(text.replace("#", " ").replace("!", " ").replace("*", " ").split())
    for part in (law, law.law):
        for said in (part.formula, part.source):
            assert " ".join(said.replace("*", " ").split()) in plain
    assert __version__ in text
    units = {each.name: each.unit for each in made.parameters}
    assert units["law_D_c"] == "m" and units["law_mu_s"] == "1" and f"[{units['law_D_c']}]" in text


def test_every_operation_has_a_text_in_fortran() -> None:
    assert set(TEXTS) == set(_C)


DRIVER = """program main
  implicit real*8 (a-h,o-z)
  dimension force(2,2), state(2,1,2), jflags(3), rdata(4), ju(2), props({count}), slip(3,2), stick(2), before(3,2)
  dimension pressed(2), area(2), vectors(3,2), one(2)
  character*80 name
{values}  props({count}) = 1d-9
  state = 0; before = 0; vectors = 0; one = 0; jflags = 1; rdata = 1d-3; ju = 1; name = ' '
  slip = 0; slip(1,:) = 1d-3; stick = (/ 3d5, 9d9 /); pressed = 2d6; area = 2d0
  call vfriction(force, state, 2, 2, 1, 1, 1, 1, 2, 3, 2, {count}, 1, 1, jflags, rdata, name, name, name, ju, ju, &
    props, slip, stick, before, pressed, area, vectors, vectors, one, one, vectors, vectors, vectors, vectors, &
    one, one, one, one)
  print *, force(1,1), force(1,2), force(2,2), state(1,1,2), state(2,1,2)
end program
"""


def test_the_subroutine_of_abaqus(tmp_path: Path) -> None:
    """Two contacts of 2 m2 under 1 MPa that slip 1 mm in 1 ms: mu = 0.2 sticks at most with 0.3 MN, the other slides.

    Weakening is linear over 4 mm, from 0.6 to 0.2: after 1 mm of slip 0.5, hence 1 MN.
    """
    compiler = fortran_compiler()
    law = law_of("linear_slip_weakening", ["mu_s=0.6", "mu_d=0.2", "D_c=4e-3"])
    made = exported(law)
    written(made, "fortran", tmp_path)
    (tmp_path / "vaba_param.inc").write_text("      implicit real*8 (a-h,o-z)\n      parameter (j_sys_Dimension = 2)\n")
    values = "".join(f"  props({i}) = {each.value!r}d0\n" for i, each in enumerate(made.parameters, 1))
    (tmp_path / "main.f90").write_text(DRIVER.format(values=values, count=len(made.parameters) + 1))
    build(tmp_path, compiler, f"{law.kind()}_vfriction.f90", "main.f90", "-o", "main")
    shown = subprocess.run([str(tmp_path / "main")], capture_output=True, text=True, timeout=60, check=True).stdout
    np.testing.assert_allclose([float(each) for each in shown.split()], [-3e5, -1e6, 0, 1e-3, 1], rtol=1e-12)


def test_the_law_of_a_case_and_what_is_refused(tmp_path: Path) -> None:
    import tomli_w

    path = tmp_path / "case.toml"
    varying = {"kind": "gaussian", "background": 0.6, "amplitude": 0.1, "center": 0.0, "width": 0.01}
    path.write_text(tomli_w.dumps(merged(plates(), {"faults.main.friction": {"kind": "coulomb", "mu_d": 0.37}})))
    assert [(each.name, each.value) for each in exported(law_of(str(path))).parameters] == [("mu_d", 0.37)]
    with pytest.raises(RuptfxError, match=facts("main.*other")):
        law_of(str(path), fault="other")
    path.write_text(tomli_w.dumps(merged(plates(), {"faults.main.friction": {"kind": "coulomb", "mu_d": varying}})))
    with pytest.raises(RuptfxError, match=facts("mu_d .* coulomb")):
        exported(law_of(str(path)))
    with pytest.raises(RuptfxError, match=facts("coulom")):
        law_of("coulom")
    with pytest.raises(RuptfxError, match=facts("--to basic")):
        files_of(exported(law_of("coulomb")), "basic")
