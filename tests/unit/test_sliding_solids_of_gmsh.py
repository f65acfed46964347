"""Solids of Gmsh that slide: blocks with meshes of their own, and groups that are no two surfaces which can touch."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from helpers.messages import facts
from helpers.sliding_cases import solids

from ruptfx import RuptfxError
from ruptfx.case import Case, parse_case
from ruptfx.run.model import Model

pytestmark = pytest.mark.fem

BLOCK = """
Point({n}1) = {{{x}, {y}, {z}}}; Point({n}2) = {{{x} + {a}, {y}, {z}}};
Point({n}3) = {{{x} + {a}, {y} + {a}, {z}}}; Point({n}4) = {{{x}, {y} + {a}, {z}}};
For i In {{1:4}}
  Line({n}0 + i) = {{{n}0 + i, {n}0 + i % 4 + 1}};
EndFor
Curve Loop({n}) = {{{n}1:{n}4}}; Plane Surface({n}) = {{{n}}};
Transfinite Curve {{{n}1:{n}4}} = {count}; Transfinite Surface {{{n}}}; {recombine}
"""
GROUPS = """
lower[] = Extrude {0, 0, 1e-3} { Surface{1}; Layers{2}; Recombine; };
upper[] = Extrude {0, 0, 1e-3} { Surface{2}; Layers{2}; Recombine; };
Physical Volume("lower") = {lower[1]};
Physical Volume("upper") = {upper[1]};
Physical Surface("main") = {lower[0], 2};
Physical Surface("lower.bottom") = {1};
Physical Surface("upper.top") = {upper[0]};
"""


def model(
    path: Path, x: float = 1e-3, z: float = 0.0, groups: tuple[str, str] = ("main", "main"), recombine: bool = True
) -> Model:
    """Return the model of a block of 2 mm, in 5 x 5 facets, at x and z on one of 4 mm in 4 x 4 facets."""
    text = GROUPS.replace(*groups)
    for n, left, y, low, a, count in ((2, x, 1e-3, z, 2e-3, 6), (1, 0.0, 0.0, -1e-3, 4e-3, 5)):
        text = BLOCK.format(n=n, x=left, y=y, z=low, a=a, count=count, recombine=f"Recombine Surface {{{n}}};") + text
    (path / "blocks.geo").write_text(
        text if recombine else re.sub(r"(Recombine.*?|Transfinite.*?|Layers{2});", "", text)
    )
    sides = {"plus": "upper", "minus": "lower", "matching": False}
    table = solids({"order": 2 if recombine else 1})
    table["faults"] = {name: table["faults"]["main"] for name in ("main", "again") if name in text}
    interfaces = dict.fromkeys(table["faults"], sides)
    case = parse_case(table | {"mesh": {"kind": "gmsh_file", "file": "blocks.geo", "interfaces": interfaces}}, path)
    assert isinstance(case, Case)
    return Model(case)


def test_surfaces_of_their_own_meshes_are_paired(tmp_path: Path) -> None:
    """Both surfaces are plane and touch: no gap, all points covered, and the area is that of the upper block."""
    face = model(tmp_path).faults[0].interface
    assert len(face.points) == 11**2
    np.testing.assert_allclose(face.weight.sum(), 4e-6, rtol=1e-12)
    np.testing.assert_allclose(face.resting_jump, 0.0, atol=1e-12)
    np.testing.assert_allclose(face.frame[:, 0], np.tile([0.0, 0.0, 1.0], (121, 1)), atol=1e-12)


def test_a_gap_of_the_file_is_kept(tmp_path: Path) -> None:
    np.testing.assert_allclose(model(tmp_path, z=30e-6).faults[0].interface.resting_jump, 30e-6, rtol=1e-9)


@pytest.mark.parametrize("options, message", [
    ({"z": -20e-6}, r"'main': the bodies overlap by 2e-05 m at \(.*\) m .* 2e-06 m .* move"),
    ({"recombine": False}, r"faults\.main\.sliding: .* tetrahedron .* Recombine"),
    ({"groups": ("{lower[0], 2}", "{2}")}, r"interface 'main' has 25 facets on its plus and 0 on its minus"),
    ({"groups": ('Surface("main") = {lower[0], 2}', 'Volume("main") = {upper[1]}')}, r"'main' .* lower\.bottom"),
    ({"groups": ('Surface("main") = {lower[0], 2}', 'Curve("main") = {21}')}, r"'main' .* lower\.bottom"),
    ({"groups": ("{lower[0], 2}", "{lower[0], 2, upper[0]}")}, r"'upper\.top' and 'main\.plus'"),
    ({"x": 9e-3}, r"faults\.main: .* \(0\.01, 0\.002, .*\) m, .* \(0\.002, 0\.002, .*\) m; move"),
    ({"groups": ("{lower[0], 2};", '{lower[0], 2}; Physical Surface("again") = {lower[0], 2};')},
     r"mesh: the facet at \(.*, 0\) m belongs to .*'main\.(plus|minus)'.*'again\..*; name every facet once"),
    ({"groups": ("{lower[0], 2}", "{1, 2}")}, r"facet at \(.*, -0\.001\) m .* 'lower\.bottom' and 'main\.minus'"),
])  # fmt: skip
def test_groups_that_are_no_two_surfaces_are_refused(options: dict[str, object], message: str, tmp_path: Path) -> None:
    """Overlap, tetrahedra, one surface, a volume, a curve, an edge, beside each other, used twice, averted."""
    with pytest.raises(RuptfxError, match=facts(message)):
        model(tmp_path, **options)  # type: ignore[arg-type]
