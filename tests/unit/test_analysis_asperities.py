"""When a rupture reaches contacts."""

import numpy as np
import pytest

from ruptfx.results.analysis.asperities import asperities, first_slip


def test_planted_contacts():
    """Contacts of 1 mm every 4 mm; a front at 2 m/s from 2 mm that skips the middle of the second one."""
    position = np.linspace(0, 12, 49) * 1e-3  # every quarter of a millimetre
    closed = np.abs((position - 2e-3 + 2e-3) % 4e-3 - 2e-3) <= 0.5e-3 + 1e-9
    arrival = np.where(position <= 8e-3, np.abs(position - 2e-3) / 2, np.nan)
    arrival[np.isclose(position, 6e-3)] = np.nan
    found = asperities(position, closed, arrival)
    assert [each.center for each in found] == pytest.approx([2e-3, 6e-3, 10e-3])
    assert [each.width for each in found] == pytest.approx([1e-3] * 3)
    assert [each.slipped for each in found] == pytest.approx([1.0, 0.8, 0.0])
    # The second one begins at 5.5 mm.
    assert [each.arrival for each in found[:2]] == pytest.approx([0.0, 1.75e-3]) and np.isnan(found[2].arrival)
    assert position[found[1].points][0] == pytest.approx(5.5e-3)


def test_first_slip_after_a_time():
    """Rates at 0, 1, 2, 3 s; the threshold of 1 m/s is passed a quarter after 1 s, not at all, before, backwards."""
    rate = np.array([[5, 0, 0, 0], [0, 0, 3, 0], [4, 0.9, 3, -2], [0, 0, 3, -2.0]])
    np.testing.assert_allclose(first_slip(np.arange(4.0), rate, 0.5, 1.0), [1.25, np.nan, 1.0, 1.5])
    assert np.isnan(first_slip(np.arange(4.0), rate, 3.5, 1.0)).all()
