"""Positions and points in cases: what accepts them, what they become, and what old ones meant."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.messages import facts, says

from ruptfx.app.check_law.examples import table
from ruptfx.input.profiles import Profile, evaluate
from ruptfx.input.profiles.places import Place, located, patches, positions, shifted
from ruptfx.input.schema import CaseError, Part, alternatives, package_of
from ruptfx.laws.nucleation.forced_rupture import ForcedRupture
from ruptfx.stepping.stopping import StopWhen

CENTERED = [
    cls
    for folder in ("nucleation", "profiles")
    for cls in alternatives(package_of(folder)).values()
    if "center" in cls.model_fields
]


@pytest.mark.parametrize("cls", CENTERED, ids=lambda cls: cls.__name__)
def test_every_center_may_be_a_point(cls: type[Part]) -> None:
    """A new file with a `center` is covered: points, the list of what changed its meaning, and `check`."""
    part = cls.model_validate(table(cls) | {"center": {"x": 3.0, "y": 4.0}})
    assert list(positions(part, "key")) == []
    placed = located(part, lambda key, place: place.x + place.y if key == "key.center" else 0.0, "key")
    assert placed.center == 7.0 and list(positions(placed, "key")) == [("key.center", [7.0])]  # type: ignore[attr-defined]
    (patch,) = patches(placed, "key")
    assert sum(patch.ends) / len(patch.ends) == pytest.approx(7.0) and patch.ends == sorted(patch.ends)


def test_what_a_part_holds_is_looked_through() -> None:
    mu_d = {"kind": "taper", "inside": 0.1, "outside": 0.2, "half_width": 2.0, "width": 1.0}
    mu_d["center"] = {"x": 1.0, "y": 0.0}
    rupture = ForcedRupture.model_validate({"center": 5.0, "radius": 1.0, "speed": 1.0, "mu_d": mu_d})
    placed = located(rupture, lambda key, place: place.x, "entry")
    found = {patch.key: (patch.kind, patch.ends) for patch in patches(placed, "entry")}
    assert found == {"entry": ("forced_rupture", [4.0, 6.0]), "entry.mu_d": ("taper", [-1.0, 3.0])}
    assert rupture.mu_d.center == Place(x=1.0, y=0.0)  # the case stays as it was written


def test_old_positions_are_shifted_in_words() -> None:
    given = [*positions(StopWhen(tip_beyond=39.5e3, tip_before=20e3), "stop_when"), ("t.positions", [0.0, 1.0, 2.0])]
    assert shifted(given, -20e3) == (
        "stop_when.tip_beyond = 39500 becomes 19500; stop_when.tip_before = 20000 becomes 0; "
        "add -20000 to every one of t.positions"
    )


@pytest.mark.parametrize(
    "center, said",
    [
        ({"x": 1.0}, "center.y: this key is required and missing"),
        ({"x": 1.0, "y": 0.0, "w": 0.0}, "center: unknown key 'w', known: x, y, z"),
        ("middle", "center = 'middle': input should be a valid number"),
    ],
)
def test_what_is_no_center(center: Any, said: str) -> None:
    with pytest.raises(CaseError) as caught:
        ForcedRupture(center=center, radius=1.0, speed=1.0, mu_d=0.1)
    assert says(said, str(caught.value))


# Of each kind with a center, by distance from it [m].
RADIAL = {
    "boxcar": ({"inside": 2.0, "outside": 1.0, "half_width": 2.0}, {0.0: 2.0, 1.9: 2.0, 2.1: 1.0}),
    "cone": ({"slope": 0.5, "tip": 0.1}, {0.0: 0.1, 5.0: 2.6}),
    "gaussian": ({"background": 1.0, "amplitude": 2.0, "width": 2.0}, {0.0: 3.0, 2.0: 1.0 + 2.0 * np.exp(-0.5)}),
    "parabola": ({"radius": 2.0, "tip": 0.1}, {0.0: 0.1, 2.0: 1.1}),
    "sphere": ({"radius": 5.0, "tip": 0.1}, {0.0: 0.1, 3.0: 1.1, 4.0: 2.1}),
    "taper": ({"inside": 2.0, "outside": 1.0, "half_width": 2.0, "width": 1.0}, {1.0: 2.0, 2.5: 1.5, 3.0: 1.0}),
}


@pytest.mark.parametrize("kind", [cls.kind() for cls in CENTERED if issubclass(cls, Profile)])
def test_a_profile_around_a_point_of_a_surface_depends_on_the_distance(kind: str) -> None:
    given, expected = RADIAL[kind]
    center = {"x": 3.0, "y": 0.0, "z": 4.0}
    part = alternatives("ruptfx.input.profiles")[kind].model_validate({**given, "center": center})
    placed = located(part, lambda key, place: np.array([3.0, 4.0]), "key")
    for angle in (0.0, 1.0, 4.0):
        places = np.array([[3 + r * np.cos(angle), 4 + r * np.sin(angle)] for r in expected])
        np.testing.assert_allclose(evaluate(placed, places), list(expected.values()), rtol=1e-12)


def test_a_profile_of_one_direction_has_no_point_as_its_center() -> None:
    cone = alternatives("ruptfx.input.profiles")["cone"].model_validate({"slope": 0.5, "center": 1.0})
    placed = cone.substituted({"center": np.array([3.0, 4.0])})
    with pytest.raises(CaseError, match=facts(r"cone.center: this kind varies along one direction; give one position")):
        evaluate(placed, np.array([1.0, 2.0]))
