"""What records cost and hold on any number of ranks."""

from __future__ import annotations

import errno
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from helpers.messages import facts
from helpers.sliding_cases import rough
from helpers.small_cases import impact, slip_weakening

from ruptfx.case import parse_case
from ruptfx.platform import distributed_rows, fem, parallel
from ruptfx.run.model import Model
from ruptfx.run.recording.bulk_fields import BulkFields
from ruptfx.run.recording.recorder import DiskError
from ruptfx.run.simulation import simulate

pytestmark = [pytest.mark.fem, pytest.mark.mpi]

DAMPED = {"damping": {"mass": 1e4, "kelvin_voigt": {"fraction": 0.1}}}
COMM = fem.MPI.COMM_WORLD
SUPPORTED = {"boundaries": [{"kind": "spring", "edge": "lower.bottom", "normal": 1e13, "tangential": 1e12}]}


@pytest.mark.parametrize("operator", ["matrix_free", "ufl_form"])
@pytest.mark.parametrize("table", [
    slip_weakening(DAMPED), slip_weakening(SUPPORTED), impact(6e6, 2.0),
], ids=["damped", "supported", "driven"])  # fmt: skip
def test_watched_steps_sum_their_energies(table: dict[str, Any], operator: str, monkeypatch: Any) -> None:
    """They are those of a force evaluation of the whole model, which they do without."""
    given = parse_case({**table, "operator": operator})
    model = Model(given)
    motion, state = given.stepper.bind(model), model.initial_state()
    found = []
    for number in range(40):
        state.wants_energies = number % 3 != 1
        motion.step(state)
        if state.wants_energies:
            expected = model.energies(state)
            with monkeypatch.context() as without:
                without.setattr(model, "internal_force", None)
                energies = motion.energies(state)
            # Sums of some thousand numbers in another order.
            assert energies == pytest.approx(expected, rel=1e-12, abs=1e-13 * max(map(abs, expected.values())))
            found.append(energies["kinetic"])
    assert parallel.total(model.comm, min(found)) > 0
    state.wants_energies = False
    motion.step(state)
    assert motion.energies(state) == model.energies(state)  # of this step, not of the last one watched


def keys_of_this_rank() -> np.ndarray:
    """Rows that differ in the last column by a few values only; ranks have different numbers of them, one none."""
    everything = np.random.default_rng(0).permutation(900)
    mine = everything[np.minimum(everything % 7, COMM.size) == COMM.rank] if COMM.size > 1 else everything
    return np.column_stack([mine % 30, mine // 30 % 10, mine // 300]).astype(float)


def test_slabs_hold_the_rows_in_order_and_give_them_back() -> None:
    keys = keys_of_this_rank()
    place = parallel.places(COMM, keys)
    total = int(parallel.total(COMM, len(keys)))
    order = distributed_rows.RowDistribution(COMM, place, total)
    block = order.collect(keys)
    np.testing.assert_array_equal(parallel.share_rows(COMM, block)[place], keys)
    np.testing.assert_array_equal(order.spread(block), keys)
    # Blocks are as large as each other, to one row: no rank holds the whole.
    assert abs(len(block) - total / COMM.size) < 1
    # Several ranks may ask for one place.
    wanted = np.arange(COMM.rank, total, 3)
    np.testing.assert_array_equal(
        distributed_rows.RowDistribution(COMM, wanted, total).spread(block), parallel.share_rows(COMM, block)[wanted]
    )


def test_only_what_is_along_interfaces_is_gathered(shared_tmp_path: Path, monkeypatch: Any) -> None:
    largest = [0]

    def watched(gather: Callable[..., Any]) -> Callable[..., Any]:
        def gathered(comm: Any, rows: np.ndarray) -> Any:
            largest[0] = max(largest[0], int(parallel.total(comm, len(rows))))
            return gather(comm, rows)

        return gathered

    # Neither node numbers nor snapshots nor checkpoints; `share_rows` is for samples of the former, too.
    given = parse_case(slip_weakening({"duration": 2e-6, "output.bulk_interval": 1e-6, "output.checkpoint_steps": 20}))
    for name in ("gather_rows", "share_rows"):
        monkeypatch.setattr(parallel, name, watched(getattr(parallel, name)))
    with simulate(given, shared_tmp_path / "gathered", COMM, progress=False) as record:
        assert record.bulk.sizes["time"] == 2
        assert 0 < largest[0] <= 2 * record.interface.sizes["position"] < 0.1 * record.bulk.sizes["point"]


def test_stresses_of_a_rough_and_a_flat_body_come_from_one_method_on_all_ranks(monkeypatch: Any) -> None:
    """Stretched by 1e-5 along x in plane strain; a rank with elements of the flat body only has straight ones."""
    moduli = {"kind": "isotropic_elastic", "young_modulus": 2.5e9, "poisson_ratio": 0.25, "density": 1000.0}
    flat = {"left": -0.3e-3, "length": 2.4e-3, "height": 0.5e-3, "element_size": 0.137e-3}
    model = Model(parse_case(rough({
        "mesh.lower": flat, "mesh.curve_order": 1, "materials": {"default": moduli},
    })))  # fmt: skip
    stretched = np.column_stack([1e-5 * model.coordinates[:, 0], np.zeros(model.nodes)]).ravel()
    nodal, forms = BulkFields(model).nodal, []
    with monkeypatch.context() as without:  # forms are collective: ranks would wait for each other
        without.setattr(type(nodal), "_add_stress", lambda self, *_: forms.append(self))
        nodal.stress(stretched, model.initial_state())
    assert model.comm.allgather(len(forms)) == [1] * COMM.size
    stress = nodal.stress(stretched, model.initial_state())
    # lambda = mu = 1 GPa: (lambda + 2 mu) 1e-5, lambda 1e-5, no shear.
    np.testing.assert_allclose(stress, np.tile([30e3, 10e3, 0.0], (model.nodes, 1)), rtol=1e-9, atol=1e-6)


def test_a_disk_that_is_full_on_one_rank_stops_all(shared_tmp_path: Path, monkeypatch: Any) -> None:
    def full(*_: Any) -> None:
        if COMM.rank == COMM.size - 1:
            raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(BulkFields, "append", full)
    given = parse_case(slip_weakening({"duration": 4e-6, "output.bulk_interval": 1e-6}))
    with pytest.raises(
        DiskError, match=facts(r"cannot be written \(No space left on device\); free some space and go on")
    ):
        simulate(given, shared_tmp_path / "full", COMM, progress=False)
