"""Energy budget and its closure."""

import numpy as np
import pytest

from ruptfx.results.analysis import energy

WORK = np.array([0.0, 10.0, 20.0])


def test_closure_is_relative_to_the_largest_work():
    parts = {"kinetic": np.array([0.0, 4.0, 8.0]), "strain": np.array([0.0, 5.0, 11.8])}
    # 10 - 9 = 1 and 20 - 19.8 = 0.2, over 20.
    np.testing.assert_allclose(energy.closure(WORK, parts), [0, 0.05, 0.01])


def test_without_work_the_largest_part_is_the_scale():
    # A spontaneous rupture: 5 J of strain energy became 3 J of heat and 1.9 J of motion; 0.1 of 5 are
    # missing.
    parts = {"strain": np.array([0.0, -5.0]), "frictional_dissipation": np.array([0.0, 3.0])}
    parts["kinetic"] = np.array([0.0, 1.9])
    np.testing.assert_allclose(energy.closure(np.zeros(2), parts), [0, 0.02])
    np.testing.assert_array_equal(energy.closure(np.zeros(1), {"strain": np.zeros(1)}), [0])


def test_budget():
    found = energy.budget({"boundary_work": WORK, "kinetic": 0.5 * WORK, "strain": 0.4 * WORK, "closure": WORK})
    # A tenth of the final work is missing; a column that is no energy does not count.
    assert found["energy_closure"] == pytest.approx(0.1)
    assert found["kinetic"] == 10 and found["boundary_work"] == 20 and "closure" not in found


def test_budget_of_a_run_without_rows():
    assert np.isnan(energy.budget({"boundary_work": np.array([]), "kinetic": np.array([])})["energy_closure"])
