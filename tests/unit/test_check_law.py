"""`ruptfx check-law`: laws that keep their contract, and what it says of those that do not."""

from __future__ import annotations

from pathlib import Path

import pytest
from helpers.a_law import LAW
from helpers.messages import says
from typer.testing import CliRunner

from ruptfx import RuptfxError
from ruptfx.app.check_law import check_law, cohesive
from ruptfx.app.check_law.checks import CHECKS
from ruptfx.app.cli import app

SAID = LAW.replace("    mu_s:", '    formula, source = "mu_s sigma / (1 + slip / L)", "none"\n    mu_s:')


def verdicts(folder: Path, text: str, *changes: str) -> dict[str, tuple[str, str]]:
    (folder / "my_law.py").write_text(text)
    (report,) = check_law(str(folder / "my_law.py"), changes)
    return {row.check: (row.verdict, row.note) for row in report.rows}


def test_a_sound_law(tmp_path: Path) -> None:
    found = verdicts(tmp_path, SAID)
    assert {check for check, (verdict, _) in found.items() if verdict == "does not apply"} == {
        "shared state", "steady strength",
    }  # fmt: skip
    assert {verdict for verdict, _ in found.values()} == {"passed", "does not apply"}
    assert found.keys() == {"required attributes", *CHECKS}


BROKEN = {
    "strength >= 0": ("return self.mu_s *", "return (self.mu_s - 0.5 * slip_rate) *", "strength is negative at"),
    "traced derivatives": ("return self.mu_s *", "return (1 + isinstance(slip_rate, np.ndarray)) *", "traced strength"),
    "steps of any length": ("slip_rate * dt}", "slip_rate * dt * (1 + dt)}", "advance is not exact: own_slip"),
    "declared state": ('return {"own_slip": state["own_slip"] +', 'state["own_slip"] += 1; return {"own_slip": 0 +',
                       "advance changes the array own_slip"),
    "dissipation": ("return self.mu_s *", "return -5 * self.mu_s *", "its strength is negative (-"),
    "case file": ("    def initial", "    kept: float = 1.0\n\n    def model_post_init(self, _):\n"
                  "        object.__setattr__(self, 'kept', self.kept + 1)\n\n    def initial", "reads differently"),
    "required attributes": ('"m"}', '""}', "the unit of state variable own_slip"),
    "steady strength": ("    def advance", "    def steady_strength(self, slip_rate, normal_stress):\n"
                        "        return self.mu_s * normal_stress\n\n    def advance", "strength after long sliding"),
}  # fmt: skip


@pytest.mark.parametrize("check", BROKEN)
def test_what_is_broken_is_named(check: str, tmp_path: Path) -> None:
    old, new, message = BROKEN[check]
    assert SAID.count(old) == 1
    verdict, note = verdicts(tmp_path, SAID.replace(old, new))[check]
    assert verdict in ("failed", "missing")
    assert says(message, note)


def test_errors_of_a_law_have_their_place(tmp_path: Path) -> None:
    text = SAID.replace("return self.mu_s * normal_stress", "return max(0.0, self.mu_s * normal_stress)")
    found = verdicts(tmp_path, text)
    assert found["strength >= 0"][1].startswith("my_law.py, line 22, strength: ValueError: The truth value")
    assert "line 22, strength: a law must not branch on a value" in found["traced derivatives"][1]


def test_command(tmp_path: Path) -> None:
    path = tmp_path / "my_law.py"
    for text, code, said in ((SAID, 0, "passed"), (LAW, 1, "formula, source")):
        path.write_text(text)
        arguments = ["check-law", str(path), "--set", "mu_s=0.6", "--out", str(tmp_path / "pictures")]
        result = CliRunner(env={"COLUMNS": "200"}).invoke(app, arguments)
        assert result.exit_code == code and said in result.output and "mu_s = 0.6" in result.output
        assert (tmp_path / "pictures" / "my_law.png").stat().st_size > 10_000
    for law, message in (("columb", "did you mean 'coulomb'?"), ("none.py", "cannot be read")):
        with pytest.raises(RuptfxError) as caught:
            check_law(law)
        assert says(message, str(caught.value))
    with pytest.raises(RuptfxError, match=r"coulomb\.mu_d = -1"):
        check_law("coulomb", ["mu_d=-1"])


COHESIVE = '''
import numpy as np

from ruptfx.laws.cohesion import CohesiveLaw


class Parabola(CohesiveLaw):
    """Softening along a parabola."""

    formula, source = "remaining = (1 - D)^2", "none"
    area = 1 / 3

    def remaining_fraction(self, damage):
        return (1.0 - damage) ** 2
'''


@pytest.mark.parametrize("old, new, check, message", [
    ("", "", None, ""),
    ("area = 1 / 3", "area = 0.5", "remaining strength", "area is not the integral of remaining_fraction"),
    ("(1.0 - damage) ** 2", "(1.0 - damage) ** 2 + 0.1", "remaining strength",
     "remaining_fraction is not 1 at damage 0"),
    ("(1.0 - damage) ** 2", "1.0 - damage * (1 + 0.5 * isinstance(damage, np.ndarray))", "traced derivatives",
     "traced remaining_fraction differs"),
    ("    area", "    def damage(self, opening, slip):\n        return opening / self.opening_at_failure\n\n    area",
     "fracture energy", "damage at the slip of failure"),
    ('"none"', '""', "required attributes", "source"),
    ("    area", "    def damage(self, opening, slip):\n"
     "        ratio = opening / self.opening_at_failure + slip / self.slip_at_failure\n"
     "        return np.minimum(ratio, 2 - ratio)\n\n    area", "damage", "damage is not between 0 and 1"),
])  # fmt: skip
def test_a_cohesive_law(old: str, new: str, check: str | None, message: str, tmp_path: Path) -> None:
    """A sound one passes all; what is broken is named."""
    path = tmp_path / "parabola.py"
    path.write_text(COHESIVE.replace(old, new))
    (report,) = check_law(str(path))
    found = {row.check: (row.verdict, row.note) for row in report.rows}
    assert found.keys() == {"required attributes", *cohesive.CHECKS}
    if check is None:
        assert report.sound and report.name == "cohesive law", report.rows
    else:
        assert found[check][0] in ("failed", "missing") and message in found[check][1]


def test_command_for_a_cohesive_law(tmp_path: Path) -> None:
    (tmp_path / "parabola.py").write_text(COHESIVE)
    arguments = ["check-law", str(tmp_path / "parabola.py"), "--set", "G_Ic=5", "--out", str(tmp_path)]
    result = CliRunner(env={"COLUMNS": "200"}).invoke(app, arguments)
    assert result.exit_code == 0 and "G_Ic = 5" in result.output
    assert (tmp_path / "parabola.png").stat().st_size > 10_000


def test_a_material_takes_the_numbers_of_its_example(tmp_path: Path) -> None:
    """Random moduli of layered rock contradict each other; those of the example fit, also times one factor."""
    pytest.importorskip("ufl")
    text = (Path(__file__).parents[2] / "demos/plugins/materials/transversely_isotropic.py").read_text()
    found = verdicts(tmp_path, text)
    assert found["positive energy"][0] == "passed" and "failed" not in {verdict for verdict, _ in found.values()}
    start, end = text.index("    example"), text.index("    A: Modulus")
    verdict, note = verdicts(tmp_path, text[:start] + text[end:])["positive energy"]
    assert verdict == "failed" and "example" in note and "-" in note
    # Plane stress: a = 4 N (A - N) / A = 0.96 MPa, f = 2 N F / A = 4 MPa, c = C - F^2 / A = -24 MPa; the smaller
    # eigenvalue of [[a, f], [f, c]] is -11.52 - sqrt(12.48^2 + 4^2) = -24.63 MPa.
    changes = ["A=1e6", "C=1e6", "F=5e6", "L=1e6", "N=4e5"]
    assert "-2.463e+07 Pa" in verdicts(tmp_path, text, *changes)["positive energy"][1]
