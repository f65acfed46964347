"""Features by the steppers, contact methods, planes and materials that they work with, from the rules of a case.

A cell is judged as `support.check` judges a case: by the rules, on the classes of its parts. Parts that neither the row
nor the column names are free: a feature works with a stepper if some contact method makes them work together.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from typing import cast, get_args

from ruptfx.case import Case, Damping, FaultCase, support
from ruptfx.input.schema import Alternative, Part, alternatives, package_of
from ruptfx.interfaces.sliding import Sliding
from ruptfx.laws.cohesion.linear import Linear
from ruptfx.laws.contact.compliant import Compliant
from ruptfx.laws.friction.rate_and_state_ageing import RateAndStateAgeing
from ruptfx.laws.materials import Plane
from ruptfx.stepping.steppers.leapfrog import Leapfrog

FAULT = "faults.main."
MANY = 6  # largest number of kinds listed in one row
BASE: dict[str, type[Part]] = {
    "stepper": Leapfrog, f"{support.PLANE}strain": Case,
    "materials.default": alternatives("ruptfx.laws.materials")["isotropic_elastic"],
}  # fmt: skip
INTERFACE: dict[str, type[Part]] = {f"{FAULT}contact": Compliant, f"{FAULT}friction": RateAndStateAgeing}


@dataclass(frozen=True)
class Feature:
    """A row: parts that a case gives.

    Attributes
    ----------
    name : str
        As a case names it.
    parts : dict of type
        By key, besides those of `BASE`; the first ones are what the row is about.
    own : tuple of str
        Keys that the row is about: they do not change.
    """

    name: str
    parts: dict[str, type[Part]]
    own: tuple[str, ...]


@dataclass(frozen=True)
class Cell:
    """Result for a feature and a column together.

    Attributes
    ----------
    works : bool
    needs : str
        Kinds of other parts of which one is needed; empty where those of a plain case do.
    reason : str
        Why it does not work.
    """

    works: bool
    needs: str = ""
    reason: str = ""


@dataclass(frozen=True)
class SupportTable:
    """Features and what they work with.

    Attributes
    ----------
    topic : str
        `stepper`, `contact`, `plane` or `material`.
    columns : tuple of str
    rows : list of (str, list of Cell)
        Names of the features with the same cells, and these.
    """

    topic: str
    columns: tuple[str, ...]
    rows: list[tuple[str, list[Cell]]]

    def numbered(self) -> tuple[list[tuple[str, ...]], list[str]]:
        """Return rows of text, in which cells refer to notes by number, and the notes."""
        notes: list[str] = []
        shown = []
        for name, cells in self.rows:
            texts = []
            for cell in cells:
                note = cell.reason or cell.needs
                if note and note not in notes:
                    notes.append(note)
                word = "yes" if cell.works else "no"
                texts.append(f"{word} ({notes.index(note) + 1})" if note else word)
            shown.append((name, *texts))
        return shown, notes


@cache
def tables() -> tuple[SupportTable, ...]:
    """Return the tables of steppers, contact methods, planes and materials."""
    return tuple(_table(topic, result) for topic, result in columns().items())


def columns() -> dict[str, dict[str, dict[str, type[Part]]]]:
    """Return the parts of the columns of each table, by topic and name."""
    fault = f"{FAULT}contact"
    return {
        "stepper": {kind: {"stepper": cls} for kind, cls in alternatives("ruptfx.stepping.steppers").items()},
        "contact": {kind: {**INTERFACE, fault: cls} for kind, cls in alternatives("ruptfx.laws.contact").items()},
        "plane": {plane: {support.PLANE + plane: Case} for plane in get_args(Plane)},
        "material": {kind: {"materials.default": cls} for kind, cls in alternatives("ruptfx.laws.materials").items()},
    }


def features() -> Iterator[Feature]:
    """Return all features whose declarations a rule reads."""
    for field, folder in (("contact", "contact"), ("friction", "friction")):
        for kind, cls in alternatives(package_of(folder)).items():
            key = FAULT + field
            yield Feature(f"{field} {kind}", {**INTERFACE, key: cls}, (key,))
    yield from (
        _of_fault("sliding interfaces", "sliding", Sliding), _of_fault("cohesive interfaces", "cohesion", Linear),
        _of_fault("gap", "gap", FaultCase), _of_fault("prescribed slip", "prescribed_slip", FaultCase),
        _of_fault("pore pressure", "pore_pressure", FaultCase), _of_fault("temperature", "temperature", FaultCase),
    )  # fmt: skip
    for kind, weakening in alternatives("ruptfx.laws.nucleation").items():
        if "weakening" in weakening.offers:
            yield _of_fault(f"nucleation {kind}", "nucleation.0", weakening)
    for kind, boundary in alternatives("ruptfx.bodies.boundaries").items():
        if boundary.needs:
            yield _alone(f"boundary {kind}", "boundaries.0", boundary)
    yield _alone("mass damping", "damping.mass", Damping)
    yield _of_fault("Kelvin-Voigt damping", "damping.kelvin_voigt", Damping, whole=True)
    yield _alone("stages", "stages", Case)
    yield _of_fault("gradients", "objective", Case, whole=True)
    for kind, attachment in alternatives("ruptfx.interfaces.attachments").items():
        yield _alone(f"attachment {kind}", "attachments.0", attachment)
    for kind, way in alternatives("ruptfx.interfaces.cracks").items():
        yield _alone(f"fracture {kind}", "fracture", way)
        yield Feature(f"fracture {kind} beside an interface", {**INTERFACE, "fracture": way}, ("fracture",))
    yield _alone("large rotations", "large_rotations", Case)
    yield _alone("single precision", "precision", Case)
    for kind, collisions in alternatives("ruptfx.interfaces.collisions").items():
        for facets, fracture in alternatives("ruptfx.interfaces.cracks").items():
            parts: dict[str, type[Part]] = {"collisions": collisions, "fracture": fracture, "large_rotations": Case}
            yield Feature(f"collisions {kind} of {facets} facets", parts, ("collisions", "fracture", "large_rotations"))


def _alone(name: str, key: str, cls: type[Part]) -> Feature:
    return Feature(name, {key: cls}, (key,))


def _of_fault(name: str, key: str, cls: type[Part], whole: bool = False) -> Feature:
    key = key if whole else FAULT + key
    return Feature(name, {**INTERFACE, key: cls}, (key,))


def _table(topic: str, table: dict[str, dict[str, type[Part]]]) -> SupportTable:
    """Return the table of all features; kinds of one folder with the same cells share a row."""
    rows: list[tuple[list[str], list[Cell]]] = []
    for feature in features():
        if topic == "contact" and (f"{FAULT}contact" in feature.own or f"{FAULT}contact" not in feature.parts):
            continue
        cells = [judge(feature, column) for column in table.values()]
        folder = _folder(feature.name)
        same = next((names for names, known in rows if known == cells and _folder(names[0]) == folder), [])
        same.append(feature.name)
        if len(same) == 1:
            rows.append((same, cells))
    count = Counter(_folder(names[0]) for names, _ in rows)
    named = [(_label(names, count[_folder(names[0])]), cells) for names, cells in rows]
    return SupportTable(topic, tuple(table), named)


def _folder(name: str) -> str:
    return name.partition(" ")[0]


def _label(names: list[str], rows: int) -> str:
    """Return the name of a row: its kinds or, if they are many, all kinds of their folder or the rest of it."""
    folder = _folder(names[0])
    if len(names) > MANY:
        return f"{folder}, " + ("every kind" if rows == 1 else "every other kind")
    return ", ".join([names[0], *(name.removeprefix(f"{folder} ") for name in names[1:])])


def judge(feature: Feature, column: dict[str, type[Part]]) -> Cell:
    """Return what a feature and the parts of a column give together."""
    base = {key: cls for key, cls in BASE.items() if not _replaced(key, column)}
    choices = {**base, **feature.parts, **column, **{key: feature.parts[key] for key in feature.own}}
    refusals = tuple(support.refusals_of(choices))
    if not refusals:
        return Cell(True)
    # The last key of a column is the one that it is about; the others are those of a plain interface.
    fixed = {*feature.own, next(reversed(column))} if len(column) == 1 else {*feature.own, f"{FAULT}contact"}
    free = [
        changes for changes in support.remedies(choices, refusals)
        if not any(key in fixed or change.cls is None for change in changes for key in change.keys)
    ]  # fmt: skip
    if free:
        return Cell(True, needs=_in_words(free))
    # What another kind of a free part would remedy is not the reason.
    stuck = [refusal for refusal in refusals if all(key in fixed for keys in refusal.swap for key in keys)]
    reasons = dict.fromkeys(refusal.reason for refusal in stuck or refusals)
    return Cell(False, reason="; ".join(_without_kind(reason, choices) for reason in reasons))


def _replaced(key: str, column: dict[str, type[Part]]) -> bool:
    """Return whether a column gives another plane."""
    return key.startswith(support.PLANE) and any(other.startswith(support.PLANE) for other in column)


def _in_words(items: Sequence[tuple[support.Change, ...]]) -> str:
    """Return sets of changes of which one is needed as text, kinds of one part side by side."""
    kinds: dict[str, list[str]] = {}
    for *others, last in items:
        first = "".join(f"{_part(change)} {change.kind} and " for change in others)
        kinds.setdefault(first + _part(last), []).append(last.kind or "")
    return "with " + ", or ".join(f"{part} {' or '.join(names)}" for part, names in kinds.items())


def _part(change: support.Change) -> str:
    """Return the name of the part that changes: `contact` for `faults.main.contact`."""
    first = change.keys[0].split(".")
    return first[0] if len(first) < 3 else first[2]


def _without_kind(reason: str, choices: support.Choices) -> str:
    """Return a reason without the kind of stepper that the column names."""
    return reason.replace(f"stepper.kind = '{cast(type[Alternative], choices['stepper']).kind()}'", "this stepper")
