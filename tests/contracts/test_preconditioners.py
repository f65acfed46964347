"""Every preconditioner of the folder solves the same systems; multigrid over orders needs few iterations."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.messages import facts
from helpers.small_cases import plates, smooth_field, strike_slip

pytest.importorskip("dolfinx")

from ruptfx import RuptfxError
from ruptfx.case import parse_case
from ruptfx.input.schema import CaseError
from ruptfx.platform import fem, memory, parallel
from ruptfx.run.model import Model
from ruptfx.stepping.implicit import preconditioners
from ruptfx.stepping.implicit.equilibrium import Equilibrium
from ruptfx.stepping.implicit.forces import Forces
from ruptfx.stepping.implicit.preconditioners import lu
from ruptfx.stepping.implicit.solvers import CaseOptions

pytestmark = [pytest.mark.fem, pytest.mark.mpi]

STIFF = {"kind": "compliant", "C_n": 1e16, "C_s": 1e16}  # 1e4 times as stiff as an element of a millimetre
SOLID = {
    "order": 2, "mesh.element_size": 2e-3, "faults.main.contact": STIFF, "stepper": {"kind": "quasi_static"},
    "boundaries": [{"kind": "driven", "edge": f"{side}.far", "component": c, "velocity": 0.0}
                   for side in ("plus", "minus") for c in "xyz"],
}  # fmt: skip
PLATES = {
    "order": 4, "faults.main.contact": STIFF,
    "boundaries": [{"kind": "driven", "edge": "lower.bottom", "component": c, "velocity": 0.0} for c in "xy"],
}  # fmt: skip
SOFT = {"kind": "isotropic_elastic", "young_modulus": 5.3e8, "poisson_ratio": 0.35, "density": 1246.0}
FIBRES = {"kind": "orthotropic_elastic", "E_1": 9e9, "E_2": 2e9, "E_3": 1.5e9, "nu_12": 0.3, "nu_23": 0.4,
          "nu_13": 0.25, "G_12": 8e8, "G_13": 7e8, "G_23": 5e8, "angle": 30.0, "density": 1200.0}  # fmt: skip
VARYING = {"kind": "isotropic_elastic", "poisson_ratio": 0.3, "density": 1246.0, "young_modulus": {
    "kind": "along_axis", "axis": "x", "profile": {
        "kind": "boxcar", "inside": 5e10, "outside": 5e9, "center": 6e-3, "half_width": 2e-3}}}  # fmt: skip
CASES: dict[str, dict[str, Any]] = {
    "solid": strike_slip(SOLID),
    "order 4": strike_slip(SOLID | {"order": 4, "mesh.element_size": 4e-3}),
    "layered 1:10": strike_slip(SOLID | {"materials.minus": SOFT}),
    "graded": strike_slip(SOLID | {"mesh.growth": 1.2, "mesh.beyond": 12e-3, "mesh.distance": 12e-3}),
    "plates, order 4": plates(PLATES),
    "order 3": plates(PLATES | {"order": 3}),
    "long elements": plates(PLATES | {
        "order": 2, "mesh.element_size": 1e-3, "mesh.growth": 1.2, "mesh.height": 16e-3}),
    "fibres": plates(PLATES | {"materials.default": FIBRES}),
    "varying": plates(PLATES | {"materials.default": VARYING}),
    "antiplane": plates(PLATES | {"plane": "antiplane", "boundaries": [
        {"kind": "driven", "edge": "lower.bottom", "component": "z", "velocity": 0.0}]}),
    "periodic": plates(PLATES | {"boundaries": [*PLATES["boundaries"], *(
        {"kind": "periodic", "first": f"{body}.left", "second": f"{body}.right"} for body in ("upper", "lower"))]}),
    "damped layer": plates(PLATES | {"damping": {"kelvin_voigt": {"eta": 1e-7}}}),
}  # fmt: skip


def solve(model: Model, kind: str, factors: tuple[float, float] = (0.0, 0.0), tangential: float = 1.0) -> Any:
    """Return solution at owned unknowns, iterations, and relative residual, for a smooth load and random tractions."""
    chosen = preconditioners.kinds()[kind]
    tangent = chosen.make_tangent(model, Forces(model).dashpot)
    local = model.faults[0].interface.frame.shape[1]
    block = 1e16 * np.diag([1.0] + [tangential] * (local - 1))
    if tangential < 1:  # sliding: the shear traction follows the pressure
        block[1, 0] = 0.3e16
    blocks = {f.name: np.tile(block, (len(f.interface.plus), 1, 1)) for f in model.faults}
    symmetric = tangent.update(*factors, blocks, driven=tangent.unit)
    ksp: Any = fem.PETSc.KSP().create(model.comm)
    ksp.setOperators(tangent.matrix, tangent.matrix)
    options = CaseOptions({}, chosen.defaults)
    ksp.setOptionsPrefix(options.prefix)
    chosen.set_up(ksp, model, tangent)
    chosen.follow(ksp, symmetric, {})
    ksp.setTolerances(rtol=1e-10)
    force = model.mass * smooth_field(model)
    for fault in model.faults:
        x = fault.interface.points
        fault.interface.assemble(10 * np.sin(1e3 * x @ np.arange(1, x.shape[1] + 1))[:, None] * np.ones(local), force)
    force = model.layout.reduce_tied(force)
    force[model.loads.prescribed] = 0.0
    right, left = tangent.matrix.createVecLeft(), tangent.matrix.createVecRight()
    right.array[:] = force[: model.owned_nodes * model.components]
    with options:
        ksp.setFromOptions()
        ksp.solve(right, left)
    residual = right.duplicate()
    tangent.matrix.mult(left, residual)
    residual.axpy(-1.0, right)
    return left.array.copy(), ksp.getIterationNumber(), residual.norm() / right.norm(), right


def difference(model: Model, ours: np.ndarray, theirs: np.ndarray) -> float:
    sizes = [parallel.largest(model.comm, float(np.abs(each).max(initial=0.0))) for each in (ours - theirs, theirs)]
    return sizes[0] / sizes[1]


@pytest.mark.parametrize("name", [
    pytest.param(name, marks=[pytest.mark.slow] * (name == "graded")) for name in CASES
])  # fmt: skip
def test_multigrid_agrees_with_factors_in_few_iterations(name: str) -> None:
    model = Model(parse_case(CASES[name])).in_steps("implicit")
    ours, iterations, residual, _ = solve(model, "mg")
    theirs, *_ = solve(model, "lu")
    assert residual < 2e-10 and iterations <= 15
    assert difference(model, ours, theirs) < 1e-9


@pytest.mark.parametrize("kind", [
    pytest.param(kind, marks=[pytest.mark.slow] * (kind == "gamg")) for kind in preconditioners.kinds()
])  # fmt: skip
def test_inertia_and_sliding_are_on_every_level(kind: str) -> None:
    """Sliding leaves the matrix unsymmetric, without stiffness along the interface."""
    model = Model(parse_case(CASES["solid"])).in_steps("implicit")
    stiffness = 5.3e9 / 1246.0 / (2e-3) ** 2
    for factors in ((stiffness, 0.0), (0.0, 0.0)):
        ours, iterations, *_ = solve(model, kind, factors, tangential=1e-6)
        theirs, *_ = solve(model, "lu", factors, tangential=1e-6)
        assert difference(model, ours, theirs) < (1e-9 if kind == "mg" else 1e-6)
        assert kind != "mg" or iterations <= 15


def test_iterations_do_not_depend_on_the_stiffness_of_contact() -> None:
    counts = []
    for stiffness in (1e12, 1e16):
        table = strike_slip(SOLID | {"faults.main.contact": {"kind": "compliant", "C_n": stiffness, "C_s": stiffness}})
        equilibrium = Equilibrium(Model(parse_case(table)), {"pc_type": "mg", "ksp_rtol": 1e-10})
        state = equilibrium.model.initial_state()
        load = equilibrium.model.mass * smooth_field(equilibrium.model)
        solution = equilibrium.solve(state, 1.0, added=1e6 * load * ~equilibrium.driven)
        counts.append(equilibrium._solver._ksp.getIterationNumber())
        assert np.abs(solution.displacement).max() > 0
    assert abs(counts[0] - counts[1]) <= 3


def test_large_solids_are_solved_by_multigrid_and_options_change_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(lu.DIRECT, 3, 0)
    model = Model(parse_case(CASES["solid"]))
    assert preconditioners.choose(model, {}).__name__ == "Mg"
    first = Equilibrium(model)
    load = model.mass * smooth_field(model) * 1e6 * ~model.loads.prescribed
    solutions = [first.solve(model.initial_state(), 1.0, added=load)]
    solver = first._solver._ksp.getPC()
    assert solver.getType() == "mg" and solver.getMGCoarseSolve().getPC().getType() == "gamg"
    options = {"mg_levels_ksp_max_it": 2, "mg_coarse_pc_type": "lu"}
    second = Equilibrium(model, options)
    solutions.append(second.solve(model.initial_state(), 1.0, added=load))
    assert second._solver._ksp.getPC().getMGCoarseSolve().getPC().getType() == "lu"
    assert difference(model, *(each.displacement for each in solutions)) < 1e-8


def test_algebraic_multigrid_of_order_1_follows_stiff_contact(monkeypatch: pytest.MonkeyPatch) -> None:
    """As many iterations as with factors of order 1, also after the contact was soft and is stiff again."""
    model = Model(parse_case(strike_slip(SOLID | {"mesh.element_size": 1e-3}))).in_steps("implicit")
    factors = solve(model, "mg")[1]
    monkeypatch.setitem(lu.DIRECT, 3, 0)
    made = preconditioners.kinds()["mg"].make_tangent(model, Forces(model).dashpot)
    monkeypatch.setattr(preconditioners.kinds()["mg"], "make_tangent", lambda *_: made)
    counts = [solve(model, "mg", tangential=tangential)[1] for tangential in (1.0, 1e-6, 1.0)]
    assert counts[0] == counts[2] <= factors + 2


def test_levels_need_orders() -> None:
    model = Model(parse_case(plates(PLATES | {"order": 1})))
    with pytest.raises(CaseError, match=facts(r"stepper\.petsc_options\.pc_type = 'mg': .* 2 .* 'gamg'")):
        Equilibrium(model, {"pc_type": "mg"})


def test_levels_beyond_the_memory_are_refused_before_one_is_made(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(lu.DIRECT, 3, 0)
    model, multigrid = Model(parse_case(CASES["solid"])), preconditioners.kinds()["mg"]
    need = sum(level.bytes for level in multigrid.sizes(model))

    def make(*_: object) -> None:
        raise RuptfxError("made")

    monkeypatch.setattr(multigrid, "make_tangent", make)
    monkeypatch.setattr(memory, "available", lambda: 0.99 * need)
    unknowns, bytes_ = 3 * model.total_nodes, f"{need / 1e9:.3g} GB.*{0.99 * need / 1e9:.3g} GB"
    with pytest.raises(RuptfxError, match=facts(rf"mesh: {unknowns}.*{bytes_}.*mesh\.element_size")):
        Equilibrium(model)
    monkeypatch.setattr(memory, "available", lambda: 1.01 * need)
    with pytest.raises(RuptfxError, match="made"):
        Equilibrium(model)
