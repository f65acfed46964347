"""A law as a Fortran 2008 module, a program that tests it, and the subroutine VFRICTION of Abaqus/Explicit around it.

The functions have the names and arguments of those in C, by `bind(c)`. Functions of C's library that Fortran has not
are called from there.
"""

from __future__ import annotations

import numpy as np

from ruptfx import RuptfxError
from ruptfx.app.export_law import TOLERANCE, ExportedLaw, Function, Sample, wrapped
from ruptfx.platform.codegen.tracing import Expression, statements

LIBRARY = {"expm1": 1, "log1p": 1, "exp2": 1, "log2": 1, "cbrt": 1, "floor": 1, "ceil": 1, "trunc": 1, "rint": 1}
"""Functions of C's library with their number of arguments."""

TEXTS = {
    "add": "{0} + {1}", "subtract": "{0} - {1}", "multiply": "{0} * {1}", "divide": "{0} / {1}", "negative": "-{0}",
    "power": "{0}**{1}", "exp": "exp({0})", "log": "log({0})", "log10": "log10({0})", "sqrt": "sqrt({0})",
    "hypot": "hypot({0}, {1})", "fabs": "abs({0})", "sin": "sin({0})", "cos": "cos({0})", "tan": "tan({0})",
    "sinh": "sinh({0})", "cosh": "cosh({0})", "tanh": "tanh({0})", "arcsin": "asin({0})", "arccos": "acos({0})",
    "arctan": "atan({0})", "arctan2": "atan2({0}, {1})", "arcsinh": "asinh({0})", "arccosh": "acosh({0})",
    "arctanh": "atanh({0})", **{name: f"c_{name}({{0}})" for name in LIBRARY},
    "logaddexp": "merge({0} + log(2.0_dp), max({0}, {1}) + c_log1p(exp(-abs({0} - {1}))), {0} == {1})",
    "maximum": "merge({0}, {1}, {0} > {1})", "minimum": "merge({0}, {1}, {0} < {1})",
    "sign": "merge(1.0_dp, merge(-1.0_dp, 0.0_dp, {0} < 0), {0} > 0)", "where": "merge({1}, {2}, {0} /= 0)",
    "less": "merge(1.0_dp, 0.0_dp, {0} < {1})", "less_equal": "merge(1.0_dp, 0.0_dp, {0} <= {1})",
    "greater": "merge(1.0_dp, 0.0_dp, {0} > {1})", "greater_equal": "merge(1.0_dp, 0.0_dp, {0} >= {1})",
    "equal": "merge(1.0_dp, 0.0_dp, {0} == {1})", "not_equal": "merge(1.0_dp, 0.0_dp, {0} /= {1})",
    "logical_and": "merge(1.0_dp, 0.0_dp, {0} /= 0 .and. {1} /= 0)",
    "logical_or": "merge(1.0_dp, 0.0_dp, {0} /= 0 .or. {1} /= 0)",
    "logical_xor": "merge(1.0_dp, 0.0_dp, ({0} /= 0) .neqv. ({1} /= 0))",
    "logical_not": "merge(1.0_dp, 0.0_dp, {0} == 0)", "isfinite": "merge(1.0_dp, 0.0_dp, abs({0}) <= huge({0}))",
    "isinf": "merge(1.0_dp, 0.0_dp, abs({0}) > huge({0}))", "isnan": "merge(1.0_dp, 0.0_dp, {0} /= {0})",
}  # fmt: skip
"""Fortran text of every operation."""


def text(node: Expression, args: list[str]) -> str:
    """Return the Fortran text of an operation."""
    return TEXTS[node.op].format(*args)


def literal(value: float) -> str:
    """Return the Fortran text of a number."""
    if np.isnan(value):
        return "not_a_number"
    return f"({value!r}_dp)" if np.isfinite(value) else f"({'-' * (value < 0)}infinity)"


def write(law: ExportedLaw) -> dict[str, str]:
    """Return the module, its test and the subroutine for Abaqus.

    Raises
    ------
    RuptfxError
        Two parameters whose names differ in upper and lower case only.
    """
    for names in ([each.name for each in law.parameters], list(law.states)):
        lower = [name.lower() for name in names]
        same = [name for name in names if lower.count(name.lower()) > 1]
        if same:
            raise RuptfxError(f"export-law {law.kind} --to fortran: {' and '.join(same)} are one name in Fortran; "
                              "rename one of them in the law, or use --to c")  # fmt: skip
    kind = law.kind
    return {f"{kind}.f90": _module(law), f"{kind}_test.f90": _test(law), f"{kind}_vfriction.f90": _vfriction(law)}


def _module(law: ExportedLaw) -> str:
    kind = law.kind
    build = (f"!\n! gfortran {kind}.f90 {kind}_test.f90 -o {kind}_test && ./{kind}_test   compares with the numbers of "
             "ruptfx.\n")  # fmt: skip
    fields = "".join(
        f"    real(dp) :: {each.name} = {each.value!r}_dp\n      "
        + wrapped(f"! [{each.unit}] {each.description}", 110, "").replace("\n", "\n      ! ") + "\n"
        for each in law.parameters
    )  # fmt: skip
    states = "".join(f"    real(dp) :: {name} = 0.0_dp ! [{unit}]\n" for name, unit in law.states.items())
    library = "".join(
        f'    pure function c_{name}(x) bind(c, name="{name}") result(y)\n      import :: dp\n'
        "      real(dp), value :: x\n      real(dp) :: y\n    end function\n"
        for name in LIBRARY
    )
    public = ", ".join(f"{kind}_{each.name}" for each in law.functions)
    return f"""{law.head("!")}{build}
module {kind}_law
  use, intrinsic :: iso_c_binding, only: dp => c_double
  use, intrinsic :: iso_fortran_env, only: int64
  implicit none
  private
{wrapped(f"public :: {public}", 110, "  ", " &")}

  type, public, bind(c) :: {kind}_parameters
{fields or "    real(dp) :: unused = 0.0_dp\n"}  end type

  type, public, bind(c) :: {kind}_state
{states or "    real(dp) :: unused = 0.0_dp\n"}  end type

  real(dp), parameter :: infinity = transfer(9218868437227405312_int64, 1.0_dp)
  real(dp), parameter :: not_a_number = transfer(9221120237041090560_int64, 1.0_dp)

  interface
{library}  end interface

contains

{"".join(_function(law, each) for each in law.functions)}end module
"""


def _function(law: ExportedLaw, function: Function) -> str:
    kind = law.kind
    lines, results = statements(function.outputs, text, literal, law.names("p%{}", "s%{}"))
    result = "new" if function.returns_state else "value"
    arguments = ", ".join(["p", *(["s"] if function.reads_state else []), *function.inputs])
    name = f"{kind}_{function.name}"
    if function.returns_state:
        begin, end = f"pure subroutine {name}({arguments}, new) bind(c)", "end subroutine"
        returned = f"    type({kind}_state), intent(out) :: new\n"
        # The variables keep the outputs, because in C the new state may be the one that is read.
        last = [f"new%{field} = n{i}" for i, field in enumerate(results)]
        assigned = [*((f"n{i}", value) for i, value in enumerate(results.values()))]
    else:
        begin, end = f"pure function {name}({arguments}) result(value) bind(c)", "end function"
        returned, last, assigned = "    real(dp) :: value\n", [f"value = {results[result]}"], []
    declared = f"    type({kind}_parameters), intent(in) :: p\n"
    if function.reads_state:
        declared += f"    type({kind}_state), intent(in) :: s\n"
    declared += "".join(f"    real(dp), value :: {each}\n" for each in function.inputs) + returned
    local = ", ".join(each for each, _ in [*lines, *assigned])
    declared += wrapped(f"real(dp) :: {local}", 110, "    ", " &") + "\n" if local else ""
    body = "".join(wrapped(f"{each} = {value}", 120, "    ", " &") + "\n" for each, value in [*lines, *assigned])
    body += "".join(f"    {line}\n" for line in last)
    about = wrapped(f"! {function.description}", 110, "  ").replace("\n      ", "\n  ! ")
    return f"{about}\n{wrapped(begin, 110, '  ', ' &')}\n{declared}{body}  {end}\n\n"


def _test(law: ExportedLaw) -> str:
    kind = law.kind
    blocks = "".join(_block(law, each) for each in law.samples)
    return f"""! Compares {kind} with the numbers of ruptfx.
program {kind}_test
  use, intrinsic :: iso_c_binding, only: dp => c_double
  use {kind}_law
  implicit none
  integer :: failures = 0
  type({kind}_parameters) :: p
  type({kind}_state) :: s, new

{blocks}
  print '(a, i0, a)', '{kind}: ', failures, ' numbers differ'
  if (failures > 0) stop 1

contains

  subroutine compare(name, value, expected)
    character(*), intent(in) :: name
    real(dp), intent(in) :: value, expected
    if (.not. abs(value - expected) <= {TOLERANCE!r}_dp * abs(expected)) then
      failures = failures + 1
      print *, name, value, ' expected ', expected
    end if
  end subroutine
end program
"""


def _block(law: ExportedLaw, sample: Sample) -> str:
    lines = [f"s%{name} = {value!r}_dp" for name, value in sample.state.items()]
    for function in law.functions:
        if function.name not in sample.expected:
            continue
        arguments = ["p", *(["s"] if function.reads_state else [])]
        arguments += [f"{sample.inputs[name]!r}_dp" for name in function.inputs]
        call, expected = f"{law.kind}_{function.name}", sample.expected[function.name]
        if not function.returns_state:
            call = f"{call}({', '.join(arguments)})"
            lines.append(f"call compare('{function.name}', {call}, {expected['value']!r}_dp)")
            continue
        lines.append(f"call {call}({', '.join([*arguments, 'new'])})")
        lines += [f"call compare('{function.name} {name}', new%{name}, {value!r}_dp)"
                  for name, value in expected.items()]  # fmt: skip
    return "".join(wrapped(line, 120, "  ", " &") + "\n" for line in lines)


ARGUMENTS = (
    "fTangential, state, nBlock, nBlockAnal, nBlockEdge, nNodState, nNodSlv, nNodMst, nFricDir, nDir, nStates, nProps, "
    "nTemp, nFields, jFlags, rData, surfInt, surfSlv, surfMst, jConSlvUid, jConMstUid, props, dSlipFric, fStickForce, "
    "fTangPrev, fNormal, areaCont, dircosN, dircosSl, shapeSlv, shapeMst, coordSlv, coordMst, velSlv, velMst, tempSlv, "
    "tempMst, fieldSlv, fieldMst"
)
"""Arguments of VFRICTION, Abaqus User Subroutines Reference Guide."""


def _vfriction(law: ExportedLaw) -> str:
    kind, count = law.kind, len(law.parameters)
    properties = "\n".join(f"!   props({i}) {each.name} [{each.unit}]" for i, each in enumerate(law.parameters, 1))
    variables = "\n".join(f"!   state({i}) {name} [{unit}]" for i, (name, unit) in enumerate(law.states.items(), 1))
    read = "".join(f"  p%{each.name} = dble(props({i}))\n" for i, each in enumerate(law.parameters, 1))
    last = len(law.states) + 1
    load = "".join(f"      s%{name} = dble(state({i},1,k))\n" for i, name in enumerate(law.states, 1))
    save = "".join(f"    state({i},1,k) = s%{name}\n" for i, name in enumerate(law.states, 1))
    begin = f"""    if (state({last},1,k) == 0) then
      carried = sqrt(sum(dble(fTangPrev(:,k))**2)) / area
      call {kind}_initial_state(p, stress, carried, slowest, s)
      state({last},1,k) = 1
    else
{load}    end if
    call {kind}_advance(p, s, rate, stress, step, next)
    s = next
{save}""" if law.states else ""  # fmt: skip
    return f"""!DIR$ FREEFORM
{law.head("!")}!
! Subroutine VFRICTION of Abaqus/Explicit, for surface interaction ... friction, user={count + 1}, depvar={last}.
! The states are solution-dependent variables; the last one is 1 after the first contact, where the state begins as that
! of the shear stress at the least slip rate. Friction is the strength at the slip rate of the increment, and not more
! than the force that sticks. Run with double precision; surfaces of nodes (one node per contact).
{properties}
!   props({count + 1}) least slip rate [m/s], positive: at rest a law that creeps has no strength
{variables}
include '{kind}.f90'

subroutine vfriction( &
{wrapped(ARGUMENTS, 110, "    ", " &")})
  use {kind}_law
  include 'vaba_param.inc'
  dimension fTangential(nFricDir,nBlock), state(nStates,nNodState,nBlock), jFlags(3), rData(4)
  dimension jConSlvUid(nNodSlv,nBlock), jConMstUid(nNodMst,nBlockAnal), props(nProps)
  dimension dSlipFric(nDir,nBlock), fStickForce(nBlock), fTangPrev(nDir,nBlock), fNormal(nBlock), areaCont(nBlock)
  dimension dircosN(nDir,nBlock), dircosSl(nDir,nBlock), shapeSlv(nNodSlv,nBlockEdge), shapeMst(nNodMst,nBlockAnal)
  dimension coordSlv(nDir,nNodSlv,nBlock), coordMst(nDir,nNodMst,nBlockAnal)
  dimension velSlv(nDir,nNodSlv,nBlock), velMst(nDir,nNodMst,nBlockAnal)
  dimension tempSlv(nBlock), tempMst(nBlockAnal), fieldSlv(nFields,nBlock), fieldMst(nFields,nBlockAnal)
  character*80 surfInt, surfSlv, surfMst
  type({kind}_parameters) :: p
  type({kind}_state) :: s, next
  double precision :: area, carried, rate, slowest, step, stress

{read}  slowest = dble(props({count + 1}))
  step = dble(rData(3))
  do k = 1, nBlock
    fTangential(:,k) = 0
    area = dble(areaCont(k))
    if (fNormal(k) <= 0 .or. area <= 0) cycle
    stress = dble(fNormal(k)) / area
    rate = slowest
    if (step > 0) rate = max(slowest, sqrt(sum(dble(dSlipFric(:,k))**2)) / step)
{begin}    fTangential(1,k) = -min({kind}_strength(p, s, rate, stress) * area, dble(fStickForce(k)))
  end do
end subroutine
"""
