"""What a model, its stepper and its solvers need is freed: MPI has some two thousand communicators in one process."""

from __future__ import annotations

import gc
import weakref
from typing import Any

import pytest
from helpers.small_cases import case, required

from ruptfx.case import Case
from ruptfx.input.schema import alternatives

pytest.importorskip("dolfinx")

from ruptfx.platform import fem
from ruptfx.platform.fem import MPI
from ruptfx.run import stages
from ruptfx.run.model import Model

pytestmark = pytest.mark.fem


def after_a_step(given: Case, freed: list[str]) -> list[weakref.ref[Any]]:
    """Return weak references to what a step needs; PETSc's communicator of the model says when it is freed."""
    model = Model(given)
    motion = stages.bind(model)
    motion.step(model.initial_state())
    vector: Any = fem.PETSc.Vec()
    key = MPI.Comm.Create_keyval(delete_fn=lambda _comm, _key, name: freed.append(name))
    vector.createMPI(1, comm=model.comm).comm.tompi4py().Set_attr(key, "PETSc's communicator")
    return [weakref.ref(model), weakref.ref(motion)]


@pytest.mark.parametrize("stepper", alternatives("ruptfx.stepping.steppers"))
def test_nothing_keeps_a_model_its_motion_or_a_matrix(stepper: str) -> None:
    freed: list[str] = []
    left = after_a_step(case({"stepper": {"kind": stepper, **required(stepper)}}), freed)
    gc.collect()
    assert [each() for each in left] == [None, None]
    assert freed == ["PETSc's communicator"]
