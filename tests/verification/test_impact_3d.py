"""Plates of `demos/impact_3d.toml`: between plane strain and plane stress, and the script that compares all three."""

from __future__ import annotations

import copy
import runpy
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.small_cases import march

pytest.importorskip("dolfinx")

from ruptfx.case import parse_case, read_toml

pytestmark = pytest.mark.fem

DEMOS = Path(__file__).parents[2] / "demos"


def plates(plane: str, half: float = 4.75e-3, held: bool = False) -> dict[str, Any]:
    """The case on few elements, for 30 us; `held`: the faces do not move along z either."""
    table = copy.deepcopy(read_toml(DEMOS / "impact_3d.toml"))
    table |= {"order": 3, "duration": 30e-6, "stepper": {"kind": "leapfrog", "time_step": 4.5e-8}}
    section = table["mesh"]["section"] | {"element_size": 5e-3, "growth": 1.2, "length": 80e-3}
    driven, *faces = table["boundaries"]
    if plane != "solid":
        return {**table, "plane": plane, "mesh": section, "boundaries": [driven]}
    fronts = [{**each, "edge": each["edge"].replace("back", "front")} for each in faces]
    mesh = {"kind": "extruded", "thickness": half, "layers": 1, "section": section}
    return {**table, "mesh": mesh, "boundaries": [driven, *faces, *(fronts if held else [])]}


def slip_along(table: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """Positions and slip after a run [m], whose energy closes."""
    model, _, state = march(parse_case(table))
    energies = model.energies(state)
    work = energies.pop("boundary_work")
    assert work > 0 and abs(work - sum(energies.values())) < 1e-12 * work
    fields, face = state.faults["main"], model.faults[0].interface
    return face.position, fields["slip" if face.across is None else "slip_1"]


def differences(solid: tuple[np.ndarray, np.ndarray], flat: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Slip of a solid minus that of the plane at the same position, over the largest of the plane."""
    position, slip = flat
    column = np.searchsorted(position, solid[0] - 1e-9)
    return (solid[1] - slip[column]) / slip.max()


def test_plates_between_rigid_walls_are_in_plane_strain() -> None:
    """Without motion along z on both faces the solid is the plane: to rounding, 1e-15 found."""
    flat = slip_along(plates("strain"))
    assert flat[1].max() > 1e-5
    assert np.abs(differences(slip_along(plates("solid", held=True)), flat)).max() < 1e-9


def test_thin_plates_approach_plane_stress() -> None:
    """With free faces, by the thickness: 0.37 % (RMS) at 9.5 mm, 0.014 % at 1.2 mm; plane strain is 3.3 % away."""
    flat, strain = slip_along(plates("stress")), slip_along(plates("strain"))
    thick, thin = (slip_along(plates("solid", half)) for half in (4.75e-3, 0.6e-3))
    of_thick, of_thin, of_strain = (
        float(np.sqrt(np.mean(differences(*pair) ** 2))) for pair in ((thick, flat), (thin, flat), (thin, strain))
    )
    assert of_thin < 3e-4 and of_thick > 15 * of_thin
    assert of_strain > 0.02


@pytest.mark.slow
def test_the_demo_compares_tips_and_slip_rates(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The script on elements of 5 mm: a plate has the tip of plane stress, 2150 m/s, not that of plane strain, 2500."""
    monkeypatch.setattr(sys, "argv", ["impact_3d.py", "5 mm"])
    monkeypatch.setattr(sys.modules["__main__"], "__file__", str(DEMOS / "impact_3d.py"), raising=False)
    monkeypatch.chdir(tmp_path)
    names = runpy.run_path(str(DEMOS / "impact_3d.py"))
    x, inside = names["x"], names["inside"]
    arrivals = [each[4][inside] for each in names["found"].values()]
    stress, strain, middle, face = (1 / np.polyfit(x[inside], each, 1)[0] for each in arrivals)
    assert stress == pytest.approx(2153, rel=0.02) and strain == pytest.approx(2499, rel=0.02)
    assert middle == pytest.approx(stress, rel=0.01) and face == pytest.approx(stress, rel=0.02)
    assert (names["out"] / "impact_3d.png").stat().st_size > 20_000
