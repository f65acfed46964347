"""Real contact area from normal stress and age."""

import numpy as np
import pytest
from helpers import synthetic
from helpers.messages import facts

from ruptfx import RuptfxError
from ruptfx.results.analysis.contact_light import contact_light, real_contact_area
from ruptfx.results.record import Record


def test_area_of_a_known_contact():
    # 6 MPa on 600 MPa: one per cent; after e - 1 cut-off times one more B of it. Open contacts do not touch.
    area = real_contact_area(np.array([6e6, 6e6, -1e6]), 600e6, np.array([0.0, 2 * (np.e - 1), 5.0]), 0.05, 2.0)
    np.testing.assert_allclose(area, [0.01, 0.0105, 0.0])


def test_a_run_gets_darker_where_it_slides(tmp_path):
    """The state of the synthetic crack is exp(-slip / 10 um) s under a constant 6 MPa."""
    time, position = synthetic.times(31), synthetic.points(10)
    run = synthetic.write_run(tmp_path / "run", synthetic.crack(time, position), time, position)
    with Record(run) as record:
        found = contact_light(record, 600e6, growth=0.1, cutoff=1e-2)
        theta = np.exp(-record.interface.slip.values / 1e-5)
        np.testing.assert_allclose(found, 0.01 * (1 + 0.1 * np.log1p(theta / 1e-2)), rtol=1e-9)
        assert found.attrs["units"] == "1" and found.dims == ("time", "position")
        assert float(found[-1, 0]) < 0.7 * float(found[0, 0]) < 0.02
        with pytest.raises(RuptfxError, match=r"slip:.*theta"):
            contact_light(record, 600e6, growth=0.1, state="slip")
        np.testing.assert_allclose(contact_light(record, 600e6), 0.01)


@pytest.mark.parametrize("wrong", [{"hardness": 0.0}, {"growth": -0.1}, {"cutoff": 0.0}])
def test_what_is_refused(wrong):
    with pytest.raises(RuptfxError, match=facts(f"{next(iter(wrong))} = ")):
        real_contact_area(np.ones(1), **{"hardness": 1e9, **wrong})
