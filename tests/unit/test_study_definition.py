"""Study files: axes, sampling, what is refused and how it is said."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from helpers.messages import facts, facts_of

from ruptfx.input.schema import CaseError
from ruptfx.many_runs.study import Axis, read_study
from ruptfx.many_runs.study.goals import Search
from ruptfx.many_runs.study.refine import bisections, boundaries, summary

IMPACT = Path(__file__).parents[2] / "demos" / "impact.toml"
SIGMA = 'key = "faults.main.initial_stress.normal"'
SEARCH = (
    f'sampling = "cma_es"\nsamples = 9\n[[axes]]\n{SIGMA}\nvalues = [1e6, 2e6]\n'
    '[[axes]]\nkey = "faults.main.friction.L_p"\nrange = [1e-6, 1e-4]\nspacing = "log"\n'
    '[[search.goals]]\nquantity = "max_slip"\nat_least = 1.0\n'
)


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


def test_units_of_axes_are_those_of_their_keys(tmp_path):
    """Texts give the same points, tables and maps as the SI numbers."""
    text = "[[axes]]\n{sigma}\nvalues = {one}\n[[axes]]\nkey = 'boundaries.0.velocity'\nrange = {two}\npoints = 3\n"
    text += "[[marks]]\nlabel = 'a'\npoint = {three}\n"
    with_units = study(tmp_path, text.format(sigma=SIGMA, one="['1 MPa', 2e6, '30 bar']", two="['1 m/s', '500 cm/s']",
                                             three="['2 MPa', 2.0]"))  # fmt: skip
    numbers = study(tmp_path, text.format(sigma=SIGMA, one=[1e6, 2e6, 3e6], two=[1.0, 5.0], three=[2e6, 2.0]))
    assert with_units == numbers and [axis.unit for axis in with_units.axes] == ["Pa", "m/s"]
    assert [axis.numeric for axis in with_units.axes] == [True, True] and with_units.axes[0].values == [1e6, 2e6, 3e6]
    assert [p.hash for p in with_units.points()] == [p.hash for p in numbers.points()]
    together = study(tmp_path, f'[[axes]]\nname = "loading"\nkey = [{SIGMA[6:]}, "boundaries.0.velocity"]\n'
                     'labels = ["I", "II"]\nvalues = [["6 MPa", 2.0], [30e6, "400 cm/s"]]')  # fmt: skip
    assert together.axes[0].values == [[6e6, 2.0], [30e6, 4.0]]


@pytest.mark.parametrize("axis, said", [
    (f"{SIGMA}\nvalues = ['20 mm']", r"axes\.0\.values, faults\.main\.initial_stress\.normal: .* in Pa .* mm "),
    (f"{SIGMA}\nrange = [1e6, '20 mm/s']\npoints = 2", r"range.* increase"),
    (f"{SIGMA}\nrange = [1e-6, '20 mm/s']\npoints = 2", r"axes\.0\.range, faults\.main\.initial_stress\.normal: .* Pa"),
    ("key = 'output.checkpoint_minutes'\nvalues = ['60 s']", r"output\.checkpoint_minutes: s: .* in min"),
])  # fmt: skip
def test_units_of_axes_of_another_kind_are_refused(axis, said, tmp_path):
    with pytest.raises(CaseError, match=facts(said)):
        study(tmp_path, f"[[axes]]\n{axis}\n")


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
        (
            'sampling = "cma_es"\nsamples = 3\n[[axes]]\nkey = "duration"\nrange = [1e-6, 2e-6]',
            'sampling = "search" or "cma_es"',
        ),
        (f"{SEARCH}[search.start]\nL_pp = 2e-6", "search.start.L_pp: no axis with a range, did you mean 'L_p'"),
        (f"{SEARCH}[search.start]\nL_p = 1.0", "search.start.L_p = 1: outside of its range, 1e-06 to 0.0001"),
        (SEARCH.replace("at_least = 1.0", ""), "give one of target, at_least and at_most"),
        (SEARCH.replace("at_least", "target"), "target and scale belong together"),
        (f"{SEARCH}where = {{ normal = 3e6 }}", "where.normal = 3000000.0: known are 1000000.0, 2000000.0"),
        (f"{SEARCH}where = {{ L_p = 3e6 }}", "search.goals.0.where.L_p: no axis without a range, known: normal"),
        ("axes = []", "axes"),
        ("[[axes]]\nkey = 'faults.man.contact.C_n'\nvalues = [1e11]", "no 'faults.man', did you mean 'main'"),
        ("[[axes]]\nkey = 'mesh.length'\nvalues = [0.1, -0.1]", "point length = -0.1: mesh.length = -0.1: "),
        (f"[[axes]]\n{SIGMA}\nvalues = [1e6, 2e6, 1e6]", "1000000.0 is there twice"),
        (f'case = "nowhere.toml"\n[[axes]]\n{SIGMA}\nvalues = [1e6]', "not valid TOML"),  # case given twice
    ],
)
def test_bad_studies_are_refused_with_the_key(tmp_path, text, message):
    with pytest.raises(CaseError, match=facts_of(message)):
        study(tmp_path, text).points()


VELOCITY = '[[axes]]\nkey = "boundaries.0.velocity"\nvalues = [1.0, 2.0]\n'


@pytest.mark.parametrize(
    ("text", "key"),
    [
        (f'{VELOCITY}[[axes]]\nkey = "boundaries.0.velocity"\nname = "W"\nvalues = [1.0, 2.0]', "axes.1.key"),
        # impact.toml has one boundary: its last entry is its first.
        (f'{VELOCITY}[[axes]]\nkey = "boundaries.-1.velocity"\nname = "W"\nvalues = [1.0, 2.0]', "axes.1.key"),
        ('[[axes]]\nname = "both"\nkey = ["duration", "duration"]\nvalues = [[1e-6, 2e-6]]', "axes.0.key"),
        ('[[axes]]\nkey = "mesh"\nvalues = [{ element_size = 2e-3 }]\n'
         '[[axes]]\nkey = "mesh.element_size"\nvalues = [4e-3]', "axes.1.key"),
        (f"[set]\nboundaries.0.velocity = 7.0\n{VELOCITY}", "set.boundaries.0.velocity"),
        ('[set.faults.main.friction]\nkind = "coulomb"\nmu_d = 0.3\n'
         '[[axes]]\nkey = "faults.main.friction"\nvalues = [{ kind = "coulomb", mu_d = 0.4 }]',
         "set.faults.main.friction.kind"),
        (f"{VELOCITY}[refine]\nfine = {{ boundaries.0.velocity = 7.0 }}", "refine.fine.boundaries.0.velocity"),
    ],
)  # fmt: skip
def test_two_writers_of_one_value_are_refused(tmp_path, text, key):
    with pytest.raises(CaseError, match=facts_of(key)):
        study(tmp_path, text)


def test_an_override_of_what_an_axis_varies_is_refused(tmp_path):
    with pytest.raises(CaseError, match=r"set\.boundaries\.0\.velocity: axes\.0\.key"):
        study(tmp_path, VELOCITY, ["boundaries.0.velocity=7.0"])


def test_an_axis_completes_a_table_of_set(tmp_path):
    text = '[set.faults.main.friction]\nkind = "coulomb"\n[set.boundaries.0]\ny_range = [0.0, 38e-3]\n'
    text += '[[axes]]\nkey = "faults.main.friction.mu_d"\nvalues = [0.3, 0.4]\n'
    text += '[[axes]]\nname = "hit"\nkey = "boundaries.0.y_range.1"\nvalues = [0.01, 0.02]'
    cases = [point.case for point in study(tmp_path, text).points()]
    found = [(case.faults["main"].friction.mu_d, case.boundaries[0].y_range[1]) for case in cases]
    assert found == [(0.3, 0.01), (0.3, 0.02), (0.4, 0.01), (0.4, 0.02)]


@pytest.mark.parametrize(
    ("text", "key", "meant"),
    [
        (f'quantities = ["max_slip", "tip_sped"]\n{VELOCITY}', "quantities.1", "tip_speed"),
        (f'{VELOCITY}[refine]\nby = "speed_regim"', "refine.by", "speed_regime"),
        (SEARCH.replace("max_slip", "max_slop"), "search.goals.0.quantity", "max_slip"),
    ],
)
def test_a_misspelt_quantity_is_refused_before_a_run(tmp_path, text, key, meant):
    with pytest.raises(CaseError, match=facts(rf"{re.escape(key)} = .*did you mean '{meant}'")):
        study(tmp_path, text).points()


def test_quantities_of_the_summary_and_of_the_budget_are_known(tmp_path):
    # From the summary of a run with a fault, of one with fracture, and from what a study adds.
    names = ["mode", "tip_speed", "b_value", "rupture", "energy_fracture", "kinetic_share", "energy_boundary_work"]
    assert len(study(tmp_path, f"quantities = {names}\n{VELOCITY}").points()) == 2


@pytest.mark.parametrize("name", ["seconds", "status", "point", "max_slip"])
def test_an_axis_has_no_name_of_another_column(tmp_path, name):
    text = f'quantities = ["max_slip"]\n[[axes]]\nname = "{name}"\nkey = "boundaries.0.velocity"\nvalues = [1.0]'
    with pytest.raises(CaseError, match=facts(f"column '{name}'")):
        study(tmp_path, text)


def test_two_values_with_one_label_are_refused(tmp_path):
    with pytest.raises(CaseError, match=facts(r"axes\.0.*'a' is there twice")):
        study(tmp_path, f'{VELOCITY}labels = ["a", "a"]')


def test_missing_files(tmp_path):
    with pytest.raises(CaseError, match=r"none\.toml"):
        read_study(tmp_path / "none.toml")
    path = tmp_path / "study.toml"
    path.write_text(f'case = "nowhere.toml"\n[[axes]]\n{SIGMA}\nvalues = [1e6]')
    with pytest.raises(CaseError, match=facts(r"nowhere\.toml.*cannot be read")):
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


def test_boundaries_are_located_to_the_widest_of_them(tmp_path):
    # Of an axis from 1 to 5 MPa one boundary is between 1 and 2 MPa, a quarter of it, one between 2 and 5 MPa.
    asked = study(tmp_path, f"[[axes]]\n{SIGMA}\nvalues = [1e6, 2e6, 5e6]")
    known = [(point, {"values": {"mode": mode}}) for point, mode in zip(asked.points(), "aba", strict=True)]
    assert [step.width for step in boundaries(asked, known)] == pytest.approx([0.25, 0.75])
    assert "2 boundaries" in summary(asked, known, {}) and "75.00%" in summary(asked, known, {})
    fine = {point.hash: {"values": {"mode": mode}} for (point, _), mode in zip(known, "abb", strict=True)}
    assert "2 of 3" in summary(asked, known, fine)


def test_a_search_begins_with_its_start_under_all_values_of_the_other_axes(tmp_path):
    plan = study(tmp_path, f"{SEARCH}[search.start]\nL_p = 2e-6")
    assert [point.coordinates for point in plan.points()] == [{"normal": s, "L_p": 2e-6} for s in (1e6, 2e6)]
    axis = plan.axis("L_p")
    assert axis.part(1e-6) == 0 and axis.part(1e-5) == pytest.approx(0.5) and axis.part(1e-4) == pytest.approx(1)


def test_goals_take_units():
    goals = [
        {"quantity": "tip_speed", "target": "1.9 km/s", "scale": "50 m/s"},
        {"quantity": "max_slip", "at_least": "3 um"}, {"quantity": "energy_kinetic", "at_most": "2 kJ"},
        {"quantity": "energy_kinetic", "at_most": "2 kJ/m"},
        {"quantity": "interfaces.main.pulse_degree", "at_least": "50 %"},
        {"quantity": "mean_large_drop", "at_most": "3 kN"},  # of a lumped model
    ]  # fmt: skip
    given = [[getattr(goal, name) for name in ("target", "scale", "at_least", "at_most")]
             for goal in Search(goals=goals).goals]  # fmt: skip
    none = None
    assert given == [[1900.0, 50.0, none, none], [none, none, 3e-6, none], [none, none, none, 2e3],
                     [none, none, none, 2e3],
                     [none, none, 0.5, none], [none, none, none, 3e3]]  # fmt: skip
    for wrong in ({"quantity": "max_slip", "at_least": "3 Pa"}, {"quantity": "crack_degree", "at_least": "3 m"}):
        with pytest.raises(CaseError, match=facts(rf"goals\.0: at_least = '{wrong['at_least']}': ")):
            Search(goals=[wrong])


def test_degrees_of_goals_and_score():
    goals = [
        {"quantity": "a", "target": 3.0, "scale": 2.0}, {"quantity": "b", "at_least": 4.0},
        {"quantity": "c", "at_most": 2.0, "where": {"loading": "I"}},
    ]  # fmt: skip
    search = Search(goals=goals)
    degrees = [[goal.degree({goal.quantity: value}) for value in (1.0, 8.0)] for goal in search.goals]
    assert degrees == [[0.5, pytest.approx(4 / 29)], [0.25, 1.0], [1.0, 0.25]]
    assert search.goals[1].degree({"b": -1.0}) == 0 and search.goals[2].degree({"c": 0.0}) == 1
    assert all(goal.degree({goal.quantity: None}) == goal.degree({}) == 0 for goal in search.goals)
    values = {"a": 1.0, "b": 1.0, "c": 8.0}
    # The geometric mean of 1/2, 1/4 and, where it is asked for, 1/4.
    first, second = (search.degree({"loading": loading}, values) for loading in ("I", "II"))
    assert first == pytest.approx((1 / 32) ** (1 / 3)) and second == pytest.approx((1 / 8) ** (1 / 2))
    assert search.score([first, second]) == pytest.approx((first + second) / 2)
