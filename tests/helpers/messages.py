"""What a test asks of a message: its keys, values, bounds and quoted words, not its sentence.

A message is reworded more often than what it is about; of its words only those in one test may matter.
"""

from __future__ import annotations

import re

_WORD = re.compile(r"(?:\.\*)?[(\[]?[A-Za-z]+(?:[-'][A-Za-z]+)*[)\]]?(?:\\?[.,;:?!])*")
_NUMBER = re.compile(r".*[0-9](?:\\?[.,;:)])*")
_UNIT = re.compile(r"[A-Za-z%]{1,3}(?:/[A-Za-z]+[0-9]?)?(?:\\?[.,;:?!])*")
_END = re.compile(r"(?:\\?[,;:?!]|\\\.)+$")
_BETWEEN = re.compile(r"(?<=[A-Za-z,;:])(?<!\\[A-Za-z])\.\*|\.\*(?=[A-Za-z])")  # words
_OPENING, _CLOSING = re.compile(r"(?<!\\)\("), re.compile(r"(?<!\\)\)")
_GAP = "(?s:.*)"


def facts(pattern: str) -> str:
    """Return a regular expression for the keys, values and quoted words of another one, in the same order.

    Plain words are left out, but for units behind numbers and for keys before ``=`` or at the start before a colon. A
    pattern of nothing but plain words, or one with alternatives or spaces in groups, is returned as it is.
    """
    tokens = _BETWEEN.sub(" .* ", pattern).split(" ")
    if "|" in pattern or any(len(_OPENING.findall(token)) != len(_CLOSING.findall(token)) for token in tokens):
        return pattern
    kept = [_is_fact(tokens, i) for i in range(len(tokens))]
    if not any(kept):
        return pattern
    found, gap = "", False
    for token, is_kept, is_last in zip(tokens, kept, [not keep for keep in kept[1:]] + [False], strict=True):
        if is_kept:
            found += (_GAP if gap else " ") * bool(found) + (_END.sub("", token) if is_last else token)
        gap = not is_kept
    return found


def facts_of(text: str) -> str:
    """Return a regular expression for the keys, values and quoted words of a message."""
    return facts(" ".join(re.escape(word) for word in text.split(" ")))


def says(text: str, output: str) -> bool:
    """Return whether an output has the keys, values and quoted words of a message, in the same order."""
    return re.search(facts_of(text), output) is not None


def _is_fact(tokens: list[str], i: int) -> bool:
    token = tokens[i]
    if token in (".*", ""):
        return False
    if not _WORD.fullmatch(token):
        return True
    if i + 1 < len(tokens) and tokens[i + 1] == "=":
        return True
    if i == 0 and token.endswith(":"):
        return True
    return i > 0 and _NUMBER.fullmatch(tokens[i - 1]) is not None and _UNIT.fullmatch(token) is not None
