"""Compatibility of the parts of a case: parts declare capabilities, this module refuses other combinations.

Parts declare what they need of a stepper and what they offer (`Part.needs`, `Alternative.offers`); the rows of `RULES`
say which features of a case need which capability, and which exclude each other. Other rules compare declarations of
two or three parts, such as `ContactMethod.implicit`. The remedies of a message are changes of the same case that break
no rule: they are found by trying them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations
from typing import cast

from ruptfx.input.schema import Alternative, CaseError, Part, alternatives
from ruptfx.interfaces.attachments import Attachment
from ruptfx.interfaces.cracks import Fracture
from ruptfx.interfaces.field_table import MOTION
from ruptfx.interfaces.sliding import Sliding
from ruptfx.laws.contact import ContactMethod
from ruptfx.laws.materials import IN_PLANE, Material
from ruptfx.stepping.steppers import Stepper

FOLDERS = {
    "stepper": "ruptfx.stepping.steppers", "contact": "ruptfx.laws.contact", "fracture": "ruptfx.interfaces.cracks",
    "materials": "ruptfx.laws.materials",
}  # fmt: skip
"""Where other kinds of a part are, by the last word of its key, or by the first where that is a name."""
PLANE = "plane."  # begins the key of the plane of a case
MOST_CHANGES = 3  # largest number of changes in one remedy

Choices = Mapping[str, type[Part]]
"""Classes of the parts that a case gives, by key; for a key without a table, the class of the part that it is in. The
plane is part of its key, as `plane.strain`."""
Keys = tuple[str, ...]


@dataclass(frozen=True)
class Refusal:
    """A rule that a case breaks.

    Attributes
    ----------
    keys : tuple of str
        Parts that break it.
    reason : str
    swap : tuple of tuple of str
        Parts that may be of another kind; those of one tuple change together.
    drop : tuple of tuple of str
        Parts that may be removed; those of one tuple together.
    hint : str
        Remedy where neither helps.
    """

    keys: Keys
    reason: str
    swap: tuple[Keys, ...] = ()
    drop: tuple[Keys, ...] = ()
    hint: str = ""


@dataclass(frozen=True)
class Change:
    """Another kind of some parts of a case, or their removal.

    Attributes
    ----------
    keys : tuple of str
    cls : type of Alternative, optional
        None removes them.
    """

    keys: Keys
    cls: type[Alternative] | None = None

    @property
    def kind(self) -> str | None:
        """The kind as a case writes it; None removes the parts."""
        return None if self.cls is None else self.cls.kind()

    def of(self, choices: Choices) -> Choices:
        """Return the choices with this change."""
        if self.cls is None:
            return {key: cls for key, cls in choices.items() if key not in self.keys}
        return {**choices, **dict.fromkeys(self.keys, self.cls)}


class UnsupportedError(CaseError):
    """Parts of a case that do not work together.

    Attributes
    ----------
    remedies : tuple of tuple of Change
        Changes of the case, each with all that it needs, after which it is accepted.
    """

    def __init__(self, message: str, remedies: tuple[tuple[Change, ...], ...]) -> None:
        super().__init__(message)
        self.remedies = remedies


def check(choices: Choices, shown: Callable[[str], str]) -> None:
    """Refuse parts of a case that do not work together.

    Parameters
    ----------
    choices : Choices
        All parts of the case that some rule needs.
    shown : callable
        Returns a key with its kind or its number as text, as in the case.

    Raises
    ------
    UnsupportedError
        Names keys, values, the reason and what works in this case.
    """
    refusals = tuple(refusals_of(choices))
    if refusals:
        result = remedies(choices, refusals)
        reasons = (f"{', '.join(shown(key) for key in refusal.keys)}: {refusal.reason}" for refusal in refusals)
        hints = "; ".join(refusal.hint for refusal in refusals if refusal.hint)
        remedy = _in_words(result) or hints or "no other kind of one of them helps"
        raise UnsupportedError(f"{'; '.join(dict.fromkeys(reasons))}; {remedy}", result)


def refusals_of(choices: Choices) -> Iterator[Refusal]:
    """Yield every rule that the choices break."""
    for rule in RULES:
        yield from rule(choices)


def remedies(choices: Choices, refusals: Iterable[Refusal]) -> tuple[tuple[Change, ...], ...]:
    """Return the smallest sets of changes with which no rule is broken: kinds, removals, or both if neither helps."""
    swaps: list[Change] = []
    drops: list[Change] = []
    for refusal in refusals:
        for keys in refusal.swap:
            others = alternatives(_folder(keys[0])).values()
            swaps += (Change(keys, cls) for cls in others if cls is not choices[keys[0]])
        drops += (Change(keys) for keys in refusal.drop)
    items = [*_smallest(choices, swaps), *_smallest(choices, drops)]
    return tuple(items or _smallest(choices, [*swaps, *drops]))


def _folder(key: str) -> str:
    """Return where other kinds of a part are."""
    first, _, key_below = key.partition(".")
    return FOLDERS[first if first in FOLDERS else key_below.rpartition(".")[2]]


def _smallest(choices: Choices, changes: list[Change]) -> list[tuple[Change, ...]]:
    """Return the smallest sets of some changes with which no rule is broken, at most `MOST_CHANGES` in each."""
    changes = list(dict.fromkeys(changes))
    for size in range(1, MOST_CHANGES + 1):
        sets = [each for each in combinations(changes, size) if _apart(each)]
        smallest = [each for each in sets if not any(refusals_of(_changed(choices, each)))]
        if smallest:
            return smallest
    return []


def _apart(changes: tuple[Change, ...]) -> bool:
    """Return whether no key changes twice."""
    keys = [key for change in changes for key in change.keys]
    return len(keys) == len(set(keys))


def _changed(choices: Choices, changes: Iterable[Change]) -> Choices:
    for change in changes:
        choices = change.of(choices)
    return choices


# -- features --------------------------------------------------------------------------------------


def keys_of(choices: Choices, feature: str) -> Keys:
    """Return the keys of a case that have a feature: that bear its name, or whose parts need the capability."""
    return tuple(key for key, cls in choices.items() if feature in _features(key, cls))


def _features(key: str, cls: type[Part]) -> frozenset[str]:
    """Return the features of a key and its part."""
    first, *others = key.split(".")
    if first == "faults":
        return cls.needs | {others[-1]}
    if first == "materials" and len(others) == 2:
        return frozenset({"profiles"})
    return cls.needs | ({first} if not others or first in ("materials", "attachments") else set())


@dataclass(frozen=True)
class Row:
    """A row of the table: a feature of a case, and what it needs or what it cannot be beside.

    Attributes
    ----------
    feature : str
    reason : str
        ``{stepper}`` stands for the kind of the stepper, ``{other}`` for the key of the other feature.
    beside : str, optional
        Feature that no case has together with this one; without it, the feature is a capability of the stepper.
    unless : str, optional
        Feature with which another row refuses the case.
    of_one_fault : bool
        Whether both features exclude each other on the same interface only.
    in_implicit : bool
        Whether both exclude each other in implicit steps only.
    needs : str, optional
        Capability of the stepper; default is the name of the feature.
    shown : str, optional
        Feature, or ``stepper``, whose keys the message names; default is the feature.
    swap, drop : tuple of str
        Features, or ``stepper``, of which another kind may help, or the removal.
    hint : str
        Remedy where neither helps.
    """

    feature: str
    reason: str
    beside: str = ""
    unless: str = ""
    of_one_fault: bool = False
    in_implicit: bool = False
    needs: str = ""
    shown: str = ""
    swap: Keys = ()
    drop: Keys = ()
    hint: str = ""

    def __call__(self, choices: Choices) -> Iterator[Refusal]:
        """Yield what a case breaks."""
        stepper, keys = _stepper(choices), keys_of(choices, self.feature)
        if self.unless in choices:
            return
        if self.of_one_fault:
            for key in keys:
                fault = key.rpartition(".")[0] + "."
                if fault + self.beside in choices:
                    yield self._refusal({name: cls for name, cls in choices.items() if name.startswith(fault)}, stepper)
        elif self.beside:
            if keys and keys_of(choices, self.beside) and (not self.in_implicit or "implicit" in stepper.time_schemes):
                yield self._refusal(choices, stepper)
        elif keys and (self.needs or self.feature) not in stepper.offers:
            yield self._refusal(choices, stepper)

    def _refusal(self, choices: Choices, stepper: type[Stepper]) -> Refusal:
        other = next(iter(keys_of(choices, self.beside)), "")
        reason = self.reason.format(stepper=f"stepper.kind = '{stepper.kind()}'", other=other)
        swap, drop = (tuple(keys_of(choices, each) for each in features) for features in (self.swap, self.drop))
        return Refusal(keys_of(choices, self.shown or self.feature), reason, swap, drop, self.hint)


# -- rules -----------------------------------------------------------------------------------------


def _faults(choices: Choices, field: str) -> dict[str, type[Part]]:
    """Return the classes of a field of all faults that give it, by name of the fault."""
    split = ((key.split("."), cls) for key, cls in choices.items() if key.startswith("faults."))
    return {parts[1]: cls for parts, cls in split if parts[2] == field}


def _stepper(choices: Choices) -> type[Stepper]:
    return cast(type[Stepper], choices["stepper"])


def _fracture(choices: Choices) -> type[Fracture] | None:
    return cast("type[Fracture] | None", choices.get("fracture"))


def _contact(
    choices: Choices, wrong: Callable[[str, type[ContactMethod]], bool], reason: str, *swap: Keys
) -> Iterator[Refusal]:
    """Yield refusals of contact methods, those of one kind together; `swap` are further parts that may change."""
    by_kind: dict[type[ContactMethod], list[str]] = {}
    for name, part in _faults(choices, "contact").items():
        method = cast(type[ContactMethod], part)
        if wrong(name, method):
            by_kind.setdefault(method, []).append(name)
    for names in by_kind.values():
        keys = tuple(f"faults.{name}.contact" for name in names)
        loose = tuple(f"faults.{name}.sliding" for name in names if f"faults.{name}.sliding" in choices)
        yield Refusal(keys, reason, swap=(keys, ("stepper",), *swap), drop=(loose,) if loose else ())


def _replaced(method: type[ContactMethod]) -> bool:
    """Return whether steps of another kind take another method for the same contact."""
    return "methods for other steps" in method.offers


def _alone(method: type[ContactMethod]) -> bool:
    """Return whether an explicit method cannot be used where neighbouring points depend on each other."""
    return method.explicit and not (method.traction_ends_slip or "sweeps" in method.offers or _replaced(method))


def _cannot(way: str, name: str, method: type[ContactMethod]) -> bool:
    return not (getattr(method, way) or _replaced(method))


def _contact_in_steps(choices: Choices) -> Iterator[Refusal]:
    stepper = _stepper(choices)
    for way in stepper.time_schemes:
        yield from _contact(choices, partial(_cannot, way), f"not for {way} steps")
    if "multipliers" not in stepper.offers:
        yield from _contact(
            choices,
            lambda _, method: "multipliers" in method.offers or (_replaced(method) and not method.implicit),
            f"stepper.kind = '{stepper.kind()}' has no outer iterations",
        )
    if "rigid contact" not in stepper.offers:
        yield from _contact(
            choices, lambda _, method: "stiffness" not in method.offers,
            f"stepper.kind = '{stepper.kind()}' takes contact with a stiffness only",
        )  # fmt: skip


def _sliding_contact(choices: Choices) -> Iterator[Refusal]:
    sliding = _faults(choices, "sliding")
    if "explicit" in _stepper(choices).time_schemes:
        reason = "on an interface that slides neighbouring points depend on each other"
        yield from _contact(choices, lambda name, method: name in sliding and _alone(method), reason)


def _attachments(choices: Choices) -> Iterator[Refusal]:
    stepper = _stepper(choices)
    keys = keys_of(choices, "attachments") if "attachments" in stepper.offers else ()
    for key in keys:
        attachment, reason = cast(type[Attachment], choices[key]), ""
        if "implicit" in stepper.time_schemes and not attachment.implicit:
            reason = "acts in explicit steps only, {} has others"
        elif attachment.inertia and "inertia" not in stepper.offers:
            reason = "has no effect without inertia, as in {}"
        elif attachment.inertia and "newmark" not in stepper.offers:
            reason = "acts by inertia and so by Newmark's rules, which the schemes of {} do not follow"
        if reason:
            yield Refusal((key,), reason.format(f"stepper.kind = '{stepper.kind()}'"), (("stepper",),), ((key,),))
    if keys and (sliding := keys_of(choices, "sliding")) and "implicit" in stepper.time_schemes:
        reason = "implicit steps of sliding contact are solved at the interfaces alone"
        yield Refusal(keys, reason, (("stepper",),), (keys, sliding))


def _implicit_facets(choices: Choices) -> Iterator[Refusal]:
    stepper, way = _stepper(choices), _fracture(choices)
    if way is None or "fracture" not in stepper.offers or "implicit" not in stepper.time_schemes:
        return
    if not way.implicit:
        reason = f"fracture.kind = '{way.kind()}' inserts facets in explicit steps only"
        yield Refusal(("stepper",), reason, (("stepper",), ("fracture",)))
    if "collisions" in choices:
        yield Refusal(("stepper",), "collisions act in explicit steps only", (("stepper",),), (("collisions",),))


def _rigid_facets(choices: Choices) -> Iterator[Refusal]:
    way, large = _fracture(choices), "large_rotations"
    if way is None or not way.rigid:
        return
    if "explicit" in _stepper(choices).time_schemes:
        reason = f"beside facets of fracture.kind = '{way.kind()}' neighbouring points depend on each other"
        yield from _contact(choices, lambda _, method: _alone(method), reason, ("fracture",))
    if large in choices and "collisions" not in choices:
        reason = f"pieces of fracture.kind = '{way.kind()}' that turn far apart meet by collision contact, [collisions]"
        yield Refusal((large,), reason, (("fracture",),), ((large,),))


def _planes(choices: Choices) -> Iterator[Refusal]:
    key = next((key for key in choices if key.startswith(PLANE)), None)
    if key is None:
        return
    plane, way = key.removeprefix(PLANE), _fracture(choices)
    if way is not None and plane not in way.planes:
        hint = f"use plane = {_listed([repr(plane) for plane in way.planes], 'or')}"
        yield Refusal((key,), f"bodies break in {_in_words_of(way.planes)} only", hint=hint)
    if "large_rotations" in choices and plane not in IN_PLANE:
        yield Refusal(("large_rotations", key), f"in {_in_words_of(IN_PLANE)} only", drop=(("large_rotations",),))
    sliding = tuple(f"faults.{name}.sliding" for name, cls in _faults(choices, "sliding").items()
                    if plane not in cast(type[Sliding], cls).planes)  # fmt: skip
    if sliding:
        known = _in_words_of(Sliding.planes)
        yield Refusal(sliding, f"sliding far is for {known} only", drop=(sliding,))


def _in_words_of(planes: Sequence[str]) -> str:
    return _listed([f"plane {plane}" for plane in planes], "and")


def _materials(choices: Choices) -> Iterator[Refusal]:
    way = _fracture(choices)
    if way is None or not way.isotropic:
        return
    for key in keys_of(choices, "materials"):
        if not cast(type[Material], choices[key]).isotropic:
            yield Refusal((key,), f"fracture.kind = '{way.kind()}' breaks isotropic bodies", ((key,),))


def _memory_in_planes(choices: Choices) -> Iterator[Refusal]:
    plane = next((key.removeprefix(PLANE) for key in choices if key.startswith(PLANE)), None)
    planes = {key: cast(type[Material], choices[key]).planes() for key in keys_of(choices, "memory")}
    wrong = tuple(key for key, known in planes.items() if plane is not None and plane not in known)
    if wrong:
        known = _listed([repr(each) for each in planes[wrong[0]]], "and")
        yield Refusal(wrong, f"works with plane = {known} only, not '{plane}'", (wrong,))


NOT_FOR, NO_ADJOINT, BY_STEPPER = "not for {stepper}", "has no adjoint, which objective needs", ("stepper",)
RULES: tuple[Callable[[Choices], Iterator[Refusal]], ...] = (
    _contact_in_steps,
    Row("sliding", NOT_FOR, swap=BY_STEPPER, drop=("sliding",)),
    _sliding_contact,
    Row("gap", "surfaces that slide have the distance that they have in the mesh", beside="sliding",
        of_one_fault=True, drop=("gap",)),
    Row("cohesion", NOT_FOR, swap=BY_STEPPER, drop=("cohesion",)),
    Row("cohesion", "an interface with {other} has no cohesion", beside="gap", of_one_fault=True,
        drop=("cohesion", "gap")),
    *(Row(feature, "bodies that break have interfaces without pore pressure and temperature", beside="fracture",
          drop=(feature, "fracture")) for feature in ("pore_pressure", "temperature")),
    *(Row(feature, "surfaces that slide have no pore pressure and no temperature, which would move with either side",
          beside="sliding", of_one_fault=True, drop=(feature, "sliding"))
      for feature in ("pore_pressure", "temperature")),
    Row("gap", "the interfaces of {stepper} stay closed", swap=BY_STEPPER, drop=("gap",)),
    *(Row("prescribed_slip", reason, beside=other, of_one_fault=True, drop=("prescribed_slip", other))
      for other, reason in {
        "sliding": "surfaces that slide far have no points that stay opposite",
        "gap": "both sides stay together where slip is prescribed",
        "cohesion": "an interface with {other} breaks by itself",
    }.items()),
    Row("prescribed_slip", "bodies that break move the sides of an interface themselves", beside="fracture",
        drop=("prescribed_slip",)),
    Row("ties", "{stepper} cannot tie nodes", swap=BY_STEPPER, drop=("ties",)),
    Row("ties", "bodies that break cannot be tied", beside="fracture", drop=("ties",)),
    Row("inertia", "without effect, for {stepper} has no waves", swap=BY_STEPPER, drop=("inertia",)),
    Row("attachments", "its forces change with the motion of the bodies, and those of {stepper} have a constant "
        "stiffness (springs that do not fail are the boundary 'spring')", swap=BY_STEPPER, drop=("attachments",)),
    _attachments,
    Row("along strike", NOT_FOR, swap=BY_STEPPER, drop=("along strike",)),
    *(Row("along strike", "the bodies of a section that repeats along strike are known at its interfaces only",
          beside=feature, drop=(feature, "along strike")) for feature in ("stages", "attachments", "sliding")),
    Row("stages", "its steps take no stages", shown="stepper", swap=BY_STEPPER, drop=("stages",)),
    Row("fracture", "bodies do not break in its steps", shown="stepper", swap=BY_STEPPER),
    _implicit_facets,
    Row("large_rotations", "{stepper} is for small rotations", swap=BY_STEPPER, drop=("large_rotations",)),
    Row("precision", "'single' is for explicit steps, not for {stepper}", swap=BY_STEPPER, drop=("precision",)),
    *(Row("precision", reason, beside=feature, drop=("precision",)) for feature, reason in {
        "fracture": "'single' is not for bodies that break: they must be bitwise identical on any number of ranks",
        "large_rotations": "'single' is for small rotations: the strain of bodies that turn has too few digits",
        "sliding": "'single' is not for surfaces that slide far, whose step computes with all velocities in double",
        "objective": "'single' is not for gradients, whose small terms it would round away",
    }.items()),
    Row("sliding", "with [fracture] interfaces join the facets that they begin with", beside="fracture",
        drop=("sliding",)),
    _rigid_facets, _planes, _materials,
    Row("profiles", "materials are uniform in bodies that break", beside="fracture", hint="give a number"),
    Row("memory", "{stepper} takes no materials with memory", swap=("stepper", "memory")),
    Row("memory", "implicit steps of sliding contact need bodies whose stiffness is constant", beside="sliding",
        in_implicit=True, swap=("stepper", "memory"), drop=("sliding",)),
    Row("memory", "bodies that break have no memory", beside="fracture", swap=("memory",)),
    Row("memory", "a material with memory is for small rotations", beside="large_rotations", unless="fracture",
        swap=("memory",), drop=("large_rotations",)),
    _memory_in_planes,
    Row("objective", "its steps have no adjoint, which objective needs and a study with sampling = 'cma_es' does not",
        needs="adjoint", shown="stepper", swap=BY_STEPPER, drop=("objective",)),
    *(Row(feature, NO_ADJOINT, beside="objective", drop=(feature, "objective")) for feature in (
        "sliding", "cohesion", "prescribed_slip", "stages", "large_rotations", "fracture", "collisions", "ties",
        "attachments", "temperature")),
    Row(MOTION, "a pore pressure that depends on slip or heat " + NO_ADJOINT, beside="objective",
        drop=(MOTION, "objective")),
    Row("memory", NO_ADJOINT, beside="objective", swap=("memory",), drop=("objective",)),
)  # fmt: skip
"""The table of features and capabilities, with rules for what two or three parts say of each other."""


# -- words -----------------------------------------------------------------------------------------


def _in_words(result: tuple[tuple[Change, ...], ...]) -> str:
    """Return remedies as the end of a message, kinds of one key side by side; empty without any."""
    kinds: dict[tuple[tuple[Change, ...], Keys], list[str]] = {}
    removals = []
    for changes in result:
        *others, last = changes
        if all(change.kind is None for change in changes):
            removals.append(f"remove {_listed([key for change in changes for key in change.keys], 'and')}")
        else:
            kinds.setdefault((tuple(others), last.keys), []).append(last.kind or "")
    texts = []
    for (first, keys), names in kinds.items():
        texts.append(" with ".join([*(_change(change.keys, change.kind) for change in first), _change(keys, *names)]))
    words = ["use " + ", or ".join(texts)] if texts else []
    return ", or ".join([*words, *removals])


def _change(keys: Keys, *kinds: str | None) -> str:
    """Return the text for other kinds of some parts; no kind means to leave them out."""
    if not any(kinds):
        return f"no {_listed(keys, 'and')}"
    return f"{_listed([f'{key}.kind' for key in keys], 'and')} = {_listed([repr(kind) for kind in kinds], 'or')}"


def _listed(words: Sequence[str], last: str) -> str:
    """Return words with commas, the last one behind `and` or `or`."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} {last} {words[-1]}"
