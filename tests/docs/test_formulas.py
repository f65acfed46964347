"""Formulas of laws as LaTeX: every one of the reference, and by hand what the text means."""

from __future__ import annotations

import re

import pytest

from ruptfx.app.reference import describe

formulas = pytest.importorskip("formulas")  # of docs/_extensions

OF_LAWS = {
    f"{topic}.{entry.name}": entry.labels["formula"]
    for topic in describe.FOLDERS for entry in describe.entries(topic) if "formula" in entry.labels
}  # fmt: skip
BY_HAND: dict[str, list[str]] = {
    "s = mu_d sigma": [r"s = \mu_{d} \, \sigma"],
    "a V/(V + V_w) - b": [r"\frac{a \, V}{V + V_{w}} - b"],
    "a/b c/d": [r"\frac{a}{b} \, \frac{c}{d}"],
    "1/(2 V_0) exp(-V / V_w)": [r"\frac{1}{2 \, V_{0}} \, \exp\left(- \frac{V}{V_{w}}\right)"],
    "(x + 1)^(1/m)": [r"{\left(x + 1\right)}^{\frac{1}{m}}"],
    "dtheta_p/dt = c dmu/dt": [r"\frac{\mathrm{d}\theta_{p}}{\mathrm{d}t} = c \, \frac{\mathrm{d}\mu}{\mathrm{d}t}"],
    "a' = sqrt(D_c_2), f_LV = V_star; drag_slip": [
        r"a' = \sqrt{D_{c,2}}",
        r"f_{\text{LV}} = V_{*}",
        r"\text{drag slip}",
    ],
    "f(x, y) while x < 1": [r"f\left(x, y\right) \;\text{while}\; x < 1"],
}


@pytest.mark.parametrize("text", BY_HAND)
def test_statements_by_hand(text: str) -> None:
    assert formulas.latex(text) == BY_HAND[text]


def test_every_formula_has_all_of_its_names_and_numbers() -> None:
    """In order: subscripts and words begin with the letters of the text."""
    assert len(OF_LAWS) > 20
    for name, text in OF_LAWS.items():
        result = " ".join(formulas.latex(text))
        letters = re.sub(r"\\(frac|left|right|text|mathrm|operatorname|sqrt|qquad)\b|[^A-Za-z0-9]", "", result)
        wanted = re.sub(r"[^A-Za-z0-9]", "", re.sub(r"sqrt|(?<=_)star", "", text))
        assert sorted(letters) == sorted(wanted), name
        assert result.count("{") == result.count("}"), name


@pytest.mark.parametrize("text", ["a (b", "a) b", "a & b", "a * / b"])
def test_what_is_no_formula_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="formula"):
        formulas.latex(text)
