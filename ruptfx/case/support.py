"""Compatibility of the parts of a case: parts declare capabilities, this module refuses other combinations.

Declarations are class attributes: `Stepper.time_schemes`, `ContactMethod.implicit`, `Boundary.waves` and so on. A rule
compares the declarations of two or three parts. The remedies of a message are changes of the same case that break no
rule: they are found by trying them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations
from typing import cast

from ruptfx.bodies.boundaries import Boundary
from ruptfx.input.schema import Alternative, CaseError, Part, alternatives
from ruptfx.interfaces.attachments import Attachment
from ruptfx.interfaces.cracks import Fracture
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
        found = remedies(choices, refusals)
        reasons = (f"{', '.join(shown(key) for key in refusal.keys)}: {refusal.reason}" for refusal in refusals)
        hints = "; ".join(refusal.hint for refusal in refusals if refusal.hint)
        remedy = _in_words(found) or hints or "no other kind of one of them helps"
        raise UnsupportedError(f"{'; '.join(dict.fromkeys(reasons))}; {remedy}", found)


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
    found = [*_smallest(choices, swaps), *_smallest(choices, drops)]
    return tuple(found or _smallest(choices, [*swaps, *drops]))


def _folder(key: str) -> str:
    """Return where other kinds of a part are."""
    first, _, rest = key.partition(".")
    return FOLDERS[first if first in FOLDERS else rest.rpartition(".")[2]]


def _smallest(choices: Choices, changes: list[Change]) -> list[tuple[Change, ...]]:
    """Return the smallest sets of some changes with which no rule is broken, at most `MOST_CHANGES` in each."""
    changes = list(dict.fromkeys(changes))
    for size in range(1, MOST_CHANGES + 1):
        sets = [each for each in combinations(changes, size) if _apart(each)]
        found = [each for each in sets if not any(refusals_of(_changed(choices, each)))]
        if found:
            return found
    return []


def _apart(changes: tuple[Change, ...]) -> bool:
    """Return whether no key changes twice."""
    keys = [key for change in changes for key in change.keys]
    return len(keys) == len(set(keys))


def _changed(choices: Choices, changes: Iterable[Change]) -> Choices:
    for change in changes:
        choices = change.of(choices)
    return choices


# -- rules -----------------------------------------------------------------------------------------


def _faults(choices: Choices, field: str) -> dict[str, type[Part]]:
    """Return the classes of a field of all faults that give it, by name of the fault."""
    split = ((key.split("."), cls) for key, cls in choices.items() if key.startswith("faults."))
    return {parts[1]: cls for parts, cls in split if parts[2] == field}


def _stepper(choices: Choices) -> type[Stepper]:
    return cast(type[Stepper], choices["stepper"])


def overrides(cls: type, base: type, name: str) -> bool:
    """Return whether a class has a method of its own in place of that of the contract."""
    return getattr(cls, name) is not getattr(base, name)


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
    return overrides(method, ContactMethod, "in_steps")


def _alone(method: type[ContactMethod]) -> bool:
    """Return whether an explicit method cannot be used where neighbouring points depend on each other."""
    sweeps = method.traction_ends_slip or overrides(method, ContactMethod, "sweeps_to")
    return method.explicit and not (sweeps or _replaced(method))


def _cannot(way: str, name: str, method: type[ContactMethod]) -> bool:
    return not (getattr(method, way) or _replaced(method))


def _contact_in_steps(choices: Choices) -> Iterator[Refusal]:
    stepper = _stepper(choices)
    for way in stepper.time_schemes:
        yield from _contact(choices, partial(_cannot, way), f"not for {way} steps")
    if not stepper.multipliers:
        yield from _contact(
            choices, lambda _, method: overrides(method, ContactMethod, "multiplier_tolerance") or (
                _replaced(method) and not method.implicit),
            f"stepper.kind = '{stepper.kind()}' has no outer iterations",
        )  # fmt: skip
    if stepper.elastic_contact_only:
        yield from _contact(
            choices, lambda _, method: not overrides(method, ContactMethod, "stiffness"),
            f"stepper.kind = '{stepper.kind()}' takes contact with a stiffness only",
        )  # fmt: skip


def _sliding(choices: Choices) -> Iterator[Refusal]:
    stepper, sliding = _stepper(choices), _faults(choices, "sliding")
    keys = tuple(f"faults.{name}.sliding" for name in sliding)
    if sliding and not stepper.sliding:
        yield Refusal(keys, f"not for stepper.kind = '{stepper.kind()}'", (("stepper",),), (keys,))
    if "explicit" in stepper.time_schemes:
        reason = "on an interface that slides neighbouring points depend on each other"
        yield from _contact(choices, lambda name, method: name in sliding and _alone(method), reason)
    for name in sliding:
        if (gap := f"faults.{name}.gap") in choices:
            yield Refusal((gap,), "surfaces that slide have the distance that they have in the mesh", drop=((gap,),))


def _cohesion(choices: Choices) -> Iterator[Refusal]:
    names, stepper = _faults(choices, "cohesion"), _stepper(choices)
    keys = tuple(f"faults.{name}.cohesion" for name in names)
    if keys and not stepper.cohesion:
        yield Refusal(keys, f"not for stepper.kind = '{stepper.kind()}'", (("stepper",),), (keys,))
    for name in names:
        key, gap = f"faults.{name}.cohesion", f"faults.{name}.gap"
        if gap in choices:
            yield Refusal((key,), f"an interface with {gap} has no cohesion", drop=((key,), (gap,)))


def _gap(choices: Choices) -> Iterator[Refusal]:
    stepper = _stepper(choices)
    keys = tuple(f"faults.{name}.gap" for name in _faults(choices, "gap"))
    if keys and not stepper.gap:
        reason = f"the interfaces of stepper.kind = '{stepper.kind()}' stay closed"
        yield Refusal(keys, reason, (("stepper",),), (keys,))


def _boundaries(choices: Choices) -> Iterator[Refusal]:
    stepper = _stepper(choices)
    ties = tuple(
        key for key, cls in choices.items() if issubclass(cls, Boundary) and overrides(cls, Boundary, "tied_edges")
    )
    if ties and not stepper.supports_ties:
        yield Refusal(ties, f"stepper.kind = '{stepper.kind()}' cannot tie nodes", (("stepper",),), (ties,))
    if ties and "fracture" in choices:
        yield Refusal(ties, "bodies that break cannot be tied", drop=(ties,))
    waves = tuple(key for key, cls in choices.items() if getattr(cls, "waves", False))
    if waves and not stepper.inertia:
        yield Refusal(
            waves, f"without effect, for stepper.kind = '{stepper.kind()}' has no waves", (("stepper",),), (waves,)
        )


def _bodies(choices: Choices) -> Iterator[Refusal]:
    stepper = _stepper(choices)
    if "stages" in choices and not stepper.staged:
        yield Refusal(("stepper",), "its steps take no stages", (("stepper",),), (("stages",),))
    way = choices.get("fracture")
    if way is not None and not stepper.fracture:
        yield Refusal(("stepper",), "bodies do not break in its steps", (("stepper",),))
    elif way is not None and "implicit" in stepper.time_schemes:
        kind = cast(type[Fracture], way).kind()
        if not cast(type[Fracture], way).implicit:
            reason = f"fracture.kind = '{kind}' inserts facets in explicit steps only"
            yield Refusal(("stepper",), reason, (("stepper",), ("fracture",)))
        if "collisions" in choices:
            yield Refusal(("stepper",), "collisions act in explicit steps only", (("stepper",),), (("collisions",),))
    large = "large_rotations"
    if large in choices and not stepper.large_rotations:
        reason = f"stepper.kind = '{stepper.kind()}' is for small rotations"
        yield Refusal((large,), reason, (("stepper",),), ((large,),))
    sliding = tuple(f"faults.{name}.sliding" for name in _faults(choices, "sliding"))
    if way is not None and sliding:
        yield Refusal(sliding, "with [fracture] interfaces join the facets that they begin with", drop=(sliding,))
    if way is not None and cast(type[Fracture], way).rigid:
        kind = cast(type[Fracture], way).kind()
        if "explicit" in stepper.time_schemes:
            reason = f"beside facets of fracture.kind = '{kind}' neighbouring points depend on each other"
            yield from _contact(choices, lambda _, method: _alone(method), reason, ("fracture",))
        if large in choices and "collisions" not in choices:
            reason = f"pieces of fracture.kind = '{kind}' that turn far apart meet by collision contact, [collisions]"
            yield Refusal((large,), reason, (("fracture",),), ((large,),))


def _attachments(choices: Choices) -> Iterator[Refusal]:
    stepper = _stepper(choices)
    keys = tuple(key for key in choices if key.startswith("attachments."))
    if keys and not stepper.attachments:
        reason = (
            "its forces change with the motion of the bodies, and those of stepper.kind = "
            f"'{stepper.kind()}' have a constant stiffness (springs that do not fail are the boundary 'spring')"
        )
        yield Refusal(keys, reason, (("stepper",),), (keys,))
        return
    for key in keys:
        attachment = cast(type[Attachment], choices[key])
        if "implicit" in stepper.time_schemes and not attachment.implicit:
            yield Refusal((key,), f"acts in explicit steps only, stepper.kind = '{stepper.kind()}' has others",
                          (("stepper",),), ((key,),))  # fmt: skip
        elif stepper.inertia and attachment.inertia and not stepper.newmark:
            yield Refusal((key,), f"has masses, which the schemes of stepper.kind = '{stepper.kind()}' do not advance",
                          (("stepper",),), ((key,),))  # fmt: skip
        elif not stepper.inertia and attachment.inertia:
            yield Refusal((key,), f"has no effect without inertia, as in stepper.kind = '{stepper.kind()}'",
                          (("stepper",),), ((key,),))  # fmt: skip
    sliding = tuple(f"faults.{name}.sliding" for name in _faults(choices, "sliding"))
    if keys and sliding and "implicit" in stepper.time_schemes:
        reason = "implicit steps of sliding contact are solved at the interfaces alone"
        yield Refusal(keys, reason, (("stepper",),), (keys, sliding))


def _planes(choices: Choices) -> Iterator[Refusal]:
    key = next((key for key in choices if key.startswith(PLANE)), None)
    if key is None:
        return
    plane, way = key.removeprefix(PLANE), choices.get("fracture")
    if way is not None and plane not in cast(type[Fracture], way).planes:
        planes = cast(type[Fracture], way).planes
        hint = f"use plane = {_listed([repr(plane) for plane in planes], 'or')}"
        yield Refusal((key,), f"bodies break in {_in_words_of(planes)} only", hint=hint)
    if "large_rotations" in choices and plane not in IN_PLANE:
        yield Refusal(("large_rotations", key), f"in {_in_words_of(IN_PLANE)} only", drop=(("large_rotations",),))
    sliding = tuple(f"faults.{name}.sliding" for name, cls in _faults(choices, "sliding").items()
                    if plane not in cast(type[Sliding], cls).planes)  # fmt: skip
    if sliding:
        yield Refusal(sliding, f"only motion in a plane slides far ({_in_words_of(IN_PLANE)})", drop=(sliding,))


def _in_words_of(planes: Sequence[str]) -> str:
    return _listed([f"plane {plane}" for plane in planes], "and")


def _materials(choices: Choices) -> Iterator[Refusal]:
    way = choices.get("fracture")
    if way is None or not cast(type[Fracture], way).isotropic:
        return
    kind = cast(type[Fracture], way).kind()
    for key, cls in _of_bodies(choices).items():
        if not cls.isotropic:
            yield Refusal((key,), f"fracture.kind = '{kind}' breaks isotropic bodies", ((key,),))


def _of_bodies(choices: Choices) -> dict[str, type[Material]]:
    """Return the classes of the materials by key."""
    return {
        key: cast(type[Material], cls) for key, cls in choices.items()
        if key.startswith("materials.") and key.count(".") == 1
    }  # fmt: skip


def _varying(choices: Choices) -> Iterator[Refusal]:
    keys = tuple(key for key in choices if key.startswith("materials.") and key.count(".") == 2)
    if keys and "fracture" in choices:
        yield Refusal(keys, "materials are uniform in bodies that break", hint="give a number")


def _memory(choices: Choices) -> Iterator[Refusal]:
    stepper = _stepper(choices)
    materials = _of_bodies(choices)
    keys = tuple(key for key, cls in materials.items() if cls.has_memory())
    if not keys:
        return
    if not stepper.memory:
        yield Refusal(keys, f"stepper.kind = '{stepper.kind()}' takes no materials with memory", (("stepper",), keys))
    sliding = tuple(f"faults.{name}.sliding" for name in _faults(choices, "sliding"))
    if sliding and "implicit" in stepper.time_schemes:
        reason = "implicit steps of sliding contact need bodies whose stiffness is constant"
        yield Refusal(keys, reason, (("stepper",), keys), (sliding,))
    if "fracture" in choices:
        yield Refusal(keys, "bodies that break have no memory", (keys,))
    elif "large_rotations" in choices:
        yield Refusal(keys, "a material with memory is for small rotations", (keys,), (("large_rotations",),))
    plane = next((key.removeprefix(PLANE) for key in choices if key.startswith(PLANE)), None)
    wrong = tuple(key for key in keys if plane is not None and plane not in materials[key].planes())
    if wrong:
        known = _listed([repr(each) for each in materials[wrong[0]].planes()], "and")
        yield Refusal(wrong, f"works with plane = {known} only, not '{plane}'", (wrong,))


def _objective(choices: Choices) -> Iterator[Refusal]:
    """Yield refusals of what the sweeps of `ruptfx.many_runs.adjoint` do not contain, in a case with an objective."""
    if "objective" not in choices:
        return
    stepper, whole = _stepper(choices), ("objective",)
    if not stepper.adjoint:
        reason = "its steps have no adjoint, which objective needs and a study with sampling = 'cma_es' does not"
        yield Refusal(("stepper",), reason, (("stepper",),), (whole,))
    reason = "has no adjoint, which objective needs"
    for field in ("sliding", "cohesion"):
        if keys := tuple(f"faults.{name}.{field}" for name in _faults(choices, field)):
            yield Refusal(keys, reason, drop=(keys, whole))
    for key in ("stages", "large_rotations", "fracture", "collisions"):
        if key in choices:
            yield Refusal((key,), reason, drop=((key,), whole))
    ties = tuple(
        key for key, cls in choices.items() if issubclass(cls, Boundary) and overrides(cls, Boundary, "tied_edges")
    )
    attached = tuple(key for key in choices if key.startswith("attachments."))
    for keys in filter(None, (ties, attached)):
        yield Refusal(keys, reason, drop=(keys, whole))
    bodies = {key: cast(type[Material], cls) for key, cls in choices.items() if key.startswith("materials.")}
    if keys := tuple(key for key, cls in bodies.items() if cls.has_memory()):
        yield Refusal(keys, reason, (keys,), (whole,))


RULES: tuple[Callable[[Choices], Iterator[Refusal]], ...] = (
    _contact_in_steps, _sliding, _cohesion, _gap, _boundaries, _attachments, _bodies, _planes, _materials, _varying,
    _memory, _objective,
)  # fmt: skip


# -- words -----------------------------------------------------------------------------------------


def _in_words(found: tuple[tuple[Change, ...], ...]) -> str:
    """Return remedies as the end of a message, kinds of one key side by side; empty without any."""
    kinds: dict[tuple[tuple[Change, ...], Keys], list[str]] = {}
    removals = []
    for changes in found:
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
