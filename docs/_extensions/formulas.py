"""Formulas of laws as LaTeX, from the text that `ruptfx describe` prints.

The text has names (`mu_s`, `dtheta/dt`), products by blanks, calls without one before their bracket (`exp(-V / V_w)`),
and statements between `;` or `,`. Other words stay text.
"""

from __future__ import annotations

import re

GREEK = {"theta", "sigma", "mu", "psi", "omega", "eta"}
OPERATORS = {"exp": r"\exp", "ln": r"\ln", "min": r"\min", "max": r"\max", "sinh": r"\sinh", "log10": r"\log_{10}",
             "asinh": r"\operatorname{asinh}"}  # fmt: skip
WORDS = {"while", "else", "as", "with", "and"}
TOKEN = re.compile(r"(?P<name>[A-Za-z]\w*'?)|(?P<number>\d+(?:\.\d+)?)|(?P<sign>[-+=<>,;/^()\[\]])|(?P<blank>\s+)")
CLOSING = {"(": ")", "[": "]"}


def latex(formula: str) -> list[str]:
    """Return the statements of a formula as LaTeX.

    Raises
    ------
    ValueError
        A character that no formula has, or brackets that do not match.
    """
    tokens, place = [], 0
    while place < len(formula):
        match = TOKEN.match(formula, place)
        if match is None:
            raise ValueError(f"formula {formula!r}: unknown character at {formula[place:]!r}")
        tokens.append((str(match.lastgroup), match.group()))
        place = match.end()
    parser = _Parser(tokens)
    statements = [parser.sum()]
    while parser.next in (";", ","):
        parser.take()
        statements.append(parser.sum())
    if parser.next:
        raise ValueError(f"formula {formula!r}: unmatched {parser.next!r}")
    return statements


def name_in_latex(name: str) -> str:
    """Return a name as a symbol with its subscripts, or as words."""
    prime = "'" * name.endswith("'")
    base, *below = name.removesuffix("'").split("_")
    if _is_differential(name):
        return r"\mathrm{d}" + name_in_latex(name[1:])
    if base not in GREEK and len(base) > 1:
        return rf"\text{{{' '.join([base, *below])}}}"
    symbol = rf"\{base}" if base in GREEK else base
    if not below:
        return symbol + prime
    parts = ["*" if part == "star" else part if len(part) == 1 else rf"\text{{{part}}}" for part in below]
    return f"{symbol}{prime}_{{{','.join(parts)}}}"


def _is_differential(name: str) -> bool:
    base = name.partition("_")[0]
    return base[0] == "d" and (base[1:] in GREEK or len(base) == 2)


class _Parser:
    """Recursive descent: sums of products of factors with exponents."""

    def __init__(self, tokens: list[tuple[str, str]]) -> None:
        self._tokens, self._at = tokens, 0
        self._inside: dict[str, str] = {}  # of brackets

    @property
    def next(self) -> str:
        """The next token but blanks; empty at the end."""
        rest = [text for kind, text in self._tokens[self._at :] if kind != "blank"]
        return rest[0] if rest else ""

    def take(self) -> tuple[str, str]:
        """Return the next token but blanks, and go on."""
        while self._tokens[self._at][0] == "blank":
            self._at += 1
        self._at += 1
        return self._tokens[self._at - 1]

    def sum(self) -> str:
        """Return products with the signs between them."""
        parts = []
        while self.next and self.next not in ",;)]":
            if self.next in WORDS:
                parts.append(rf"\;\text{{{self.take()[1]}}}\;")
            else:
                parts.append(self.take()[1] if self.next in ("+", "-", "=", "<", ">") else self.product())
        return " ".join(parts)

    def product(self) -> str:
        """Return factors beside each other; a fraction has those before its stroke over the one behind it."""
        finished, factors = [], [self.factor()]
        while self.next and self.next not in "+-=<>,;)]" and self.next not in WORDS:
            if self.next == "/":
                self.take()
                finished.append(rf"\frac{{{self._bare(factors)}}}{{{self._bare([self.factor()])}}}")
                factors = []
            else:
                factors.append(self.factor())
        return r" \, ".join([*finished, *factors])

    def _bare(self, factors: list[str]) -> str:
        """Return factors, a single one without the brackets that a stroke makes superfluous."""
        only = self._inside.get(factors[0]) if len(factors) == 1 else None
        return only or r" \, ".join(factors)

    def factor(self) -> str:
        """Return a number, a name, a call or a bracket, with its exponent."""
        kind, text = self.take()
        if text in CLOSING:
            result = self._bracket(text)
        elif kind == "name" and _is_differential(text) and self.next == "/":
            self.take()
            return rf"\frac{{{name_in_latex(text)}}}{{{name_in_latex(self.take()[1])}}}"
        elif kind == "name" and self._tokens[self._at : self._at + 1] == [("sign", "(")]:
            bracket = self._bracket(self.take()[1])
            result = (rf"\sqrt{{{self._bare([bracket])}}}" if text == "sqrt"
                      else OPERATORS.get(text, name_in_latex(text)) + bracket)  # fmt: skip
        elif kind == "name":
            result = OPERATORS.get(text) or name_in_latex(text)
        elif kind == "number":
            result = text
        else:
            raise ValueError(f"a formula has {text!r} in place of a factor")
        if self.next == "^":
            self.take()
            result = rf"{{{result}}}^{{{self._bare([self.factor()])}}}"
        return result

    def _bracket(self, opening: str) -> str:
        parts = [self.sum()]
        while self.next == ",":
            self.take()
            parts.append(self.sum())
        if self.next != CLOSING[opening]:
            raise ValueError(f"a formula has {self.next!r} in place of {CLOSING[opening]!r}")
        result = rf"\left{opening}{', '.join(parts)}\right{self.take()[1]}"
        self._inside[result] = ", ".join(parts)
        return result
