"""A chamfered block pressed unevenly, held and sheared on a rigid base: where slip begins, and stresses in it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from helpers.messages import facts

from ruptfx import RuptfxError, read_case, simulate
from ruptfx.results.analysis.along_interface import body_stress

pytestmark = pytest.mark.fem

DEMO = Path(__file__).parents[2] / "demos" / "chamfered_block.toml"
LENGTH, ELEMENT = 0.2, 8e-3  # m


def test_slip_begins_where_the_ratio_of_stresses_peaks(tmp_path: Path) -> None:
    """Inside of the block, within one element; until then the stresses in the block are the tractions of its base."""
    coarse = [f"mesh.element_size={ELEMENT}", "mesh.chamfer=4e-3", "output.figures=false"]
    with simulate(read_case(DEMO, coarse), tmp_path / "run", progress=False) as record:
        data = record.interface.load()
        time, x = data.time.values, data.position.values
        slides = np.abs(data.slip_rate.values) > 1e-3
        row = int(slides.any(axis=1).argmax())
        assert time[row] > 1.2e-3 and slides[row].any()  # not while it is pressed and held
        before = data.isel(time=row - 1)
        ratio = before.shear_traction.values / before.normal_stress.values
        peak = x[np.argmax(ratio)]
        assert 0.1 * LENGTH < peak < 0.9 * LENGTH
        assert np.median(x[slides[row]]) == pytest.approx(peak, abs=ELEMENT)
        # Away from the chamfers, where nodes are in equilibrium with the edge beside them.
        at, stress = body_stress(record, 1.2e-3)
        held = data.sel(time=at, method="nearest")
        inner = (x > 0.1 * LENGTH) & (x < 0.9 * LENGTH)
        pressure = held.normal_stress.values[inner].mean()
        np.testing.assert_allclose(-stress["yy"][inner], held.normal_stress.values[inner], atol=0.02 * pressure)
        np.testing.assert_allclose(stress["xy"][inner], held.shear_traction.values[inner], atol=0.02 * pressure)
        # What sticks cannot widen: sigma_xx = nu (sigma_yy - sigma_yy,0) in plane stress; 0.1 MPa are there before.
        middle = np.abs(x - 0.5 * LENGTH) < ELEMENT
        np.testing.assert_allclose(stress["xx"][middle], 0.37 * (stress["yy"][middle] + 0.1e6), rtol=0.02)
        with pytest.raises(RuptfxError, match=facts(r"body = lower: no such body, there are upper")):
            body_stress(record, 0.0, "lower")
