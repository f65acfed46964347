"""Study files: axes, sampling, what is refused and how it is said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ruptfx.schema import CaseError
from ruptfx.study import Axis, read_study
from ruptfx.study.refine import bisections

IMPACT = Path(__file__).parents[2] / "demos" / "impact.toml"
SIGMA = 'key = "faults.main.initial_stress.normal"'


def study(tmp_path, text, overrides=()):
    path = tmp_path / "study.toml"
    path.write_text(f'case = "{IMPACT}"\n{text}')
    return read_study(path, overrides)


def test_log_range_has_its_ends_and_a_constant_ratio():
    values = Axis(key="a", range=[0.9e6, 40e6], points=10, spacing="log").sequence()
    assert values[0] == 0.9e6 and values[-1] == 40e6
    # Six digits are kept.
    np.testing.assert_allclose(np.diff(np.log(values)), np.log(40 / 0.9) / 9, atol=1e-5)


def test_grid_is_every_combination_and_cases_carry_the_values(tmp_path):
    found = study(tmp_path, f'[[axes]]\n{SIGMA}\nvalues = [1e6, 2e6]\n[[axes]]\nkey = "boundaries.0.velocity"\n'
                  "values = [1.0, 3.0, 5.0]").points()  # fmt: skip
    assert len(found) == 6 == len({point.hash for point in found})
    pairs = {(p.case.faults["main"].initial_stress.normal, p.case.boundaries[0].velocity) for p in found}
    assert pairs == {(s, v) for s in (1e6, 2e6) for v in (1.0, 3.0, 5.0)}


def test_keys_that_change_together(tmp_path):
    text = f'[[axes]]\nname = "loading"\nkey = [{SIGMA[6:]}, "boundaries.0.velocity"]\n'
    text += 'labels = ["I", "II"]\nvalues = [[6e6, 2.0], [30e6, 4.0]]'
    one, two = study(tmp_path, text).points()
    assert (one.coordinates, two.coordinates) == ({"loading": "I"}, {"loading": "II"})
    assert two.case.boundaries[0].velocity == 4.0


def test_hypercube_has_one_sample_in_every_stratum(tmp_path):
    text = 'sampling = "latin_hypercube"\nsamples = 20\n'
    text += '[[axes]]\nkey = "faults.main.friction.law.mu_d"\nrange = [0.1, 0.5]\n'
    text += '[[axes]]\nkey = "faults.main.friction.L_p"\nrange = [1e-6, 1e-4]\nspacing = "log"\n'
    text += '[[axes]]\nkey = "boundaries.0.velocity"\nvalues = [1.0, 2.0]'
    found = study(tmp_path, text).points()
    assert len(found) == 40  # 20 samples, each with both speeds
    mu = np.array([p.coordinates["mu_d"] for p in found[::2]])
    length = np.array([p.coordinates["L_p"] for p in found[::2]])
    assert sorted(((mu - 0.1) / 0.4 * 20).astype(int)) == list(range(20))
    assert sorted((np.log(length / 1e-6) / np.log(100) * 20).astype(int)) == list(range(20))


def test_a_table_with_kind_replaces_that_of_the_case(tmp_path):
    text = f'[set.faults.main.friction]\nkind = "coulomb"\nmu_d = 0.3\n[[axes]]\n{SIGMA}\nvalues = [1e6]'
    assert study(tmp_path, text).points()[0].case.faults["main"].friction.mu_d == 0.3


def test_overrides_of_the_command_line_come_last(tmp_path):
    text = f"[set]\nduration = 1e-6\n[[axes]]\n{SIGMA}\nvalues = [1e6]"
    assert study(tmp_path, text, ["duration=2e-6"]).points()[0].case.duration == 2e-6


def test_identity_is_the_case_without_its_axes(tmp_path):
    def identity(text):
        return study(tmp_path, text).identity()

    base = f"[[axes]]\n{SIGMA}\nvalues = [1e6]"
    assert identity(base) == identity(base.replace("[1e6]", "[1e6, 2e6]")) == identity(f'title = "x"\n{base}')
    assert identity(base) != identity(f"[set]\nduration = 1e-6\n{base}")
    assert identity(base) != identity(f'{base}\n[[axes]]\nkey = "duration"\nvalues = [1e-6]')


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('[[axes]]\nkey = "faults.main.frction.L_p"\nvalues = [1e-6]', "did you mean 'friction'"),
        ('[[axes]]\nkey = "boundaries.3.velocity"\nvalues = [1.0]', "boundaries.3.velocity: does not lead to a value"),
        (f"[[axes]]\n{SIGMA}\nvalues = [1e6, -1e6]", "normal = -1000000.0: "),
        (f'[[axes]]\n{SIGMA}\nvalues = ["high"]', "normal = 'high'"),
        (f"[[axes]]\n{SIGMA}", "give either values or range"),
        (f"[[axes]]\n{SIGMA}\nrange = [1e6, 2e6]", "a range on a grid needs points"),
        (f'[[axes]]\n{SIGMA}\nrange = [0.0, 2e6]\npoints = 3\nspacing = "log"', "be positive where spacing is log"),
        (f"[[axis]]\n{SIGMA}\nvalues = [1e6]", "unknown key 'axis', did you mean 'axes'"),
        (f"[[axes]]\n{SIGMA}\nvalues = [1e6]\n[[axes]]\n{SIGMA}\nvalues = [1e6]", "two axes are called 'normal'"),
        (f'sampling = "latin_hypercube"\n[[axes]]\n{SIGMA}\nvalues = [1e6]', "needs samples"),
        ("axes = []", "axes"),
        ("[[axes]]\nkey = 'faults.man.contact.C_n'\nvalues = [1e11]", "no 'faults.man', did you mean 'main'"),
        ("[[axes]]\nkey = 'mesh.length'\nvalues = [0.1, -0.1]", "point length = -0.1: mesh.length = -0.1: "),
        (f"[[axes]]\n{SIGMA}\nvalues = [1e6, 2e6, 1e6]", "1000000.0 is there twice"),
        (f'case = "nowhere.toml"\n[[axes]]\n{SIGMA}\nvalues = [1e6]', "not valid TOML"),  # case given twice
    ],
)
def test_bad_studies_are_refused_with_the_key(tmp_path, text, message):
    with pytest.raises(CaseError, match=message.replace("[", r"\[").replace(".", r"\.")):
        study(tmp_path, text).points()


def test_missing_files(tmp_path):
    with pytest.raises(CaseError, match="cannot be read"):
        read_study(tmp_path / "none.toml")
    path = tmp_path / "study.toml"
    path.write_text(f'case = "nowhere.toml"\n[[axes]]\n{SIGMA}\nvalues = [1e6]')
    with pytest.raises(CaseError, match=r"nowhere\.toml.*cannot be read"):
        read_study(path).points()


@pytest.mark.parametrize(("spacing", "middle"), [("log", 3e6), ("linear", 5e6)])
def test_refinement_asks_half_way_in_the_spacing_of_the_axis(tmp_path, spacing, middle):
    # Between 1 and 9 MPa: sqrt(1 * 9) = 3 MPa where the axis is logarithmic, else (1 + 9) / 2 = 5 MPa.
    text = f'[[axes]]\n{SIGMA}\nrange = [1e6, 9e6]\npoints = 2\nspacing = "{spacing}"'
    asked = study(tmp_path, text)
    modes = [{"values": {"mode": mode}} for mode in ("crack", "pulse")]
    (point,) = bisections(asked, list(zip(asked.points(), modes, strict=True)))
    assert point.coordinates == {"normal": middle}
    assert point.case.faults["main"].initial_stress.normal == middle
