"""A block that slides over a rigid base with a profile: flat as split nodes, Westergaard's wave, budget, ranks."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w
from helpers.compare import largest_difference
from helpers.sliding_cases import STIFF
from helpers.small_cases import march, merged

pytest.importorskip("dolfinx")

from helpers.messages import facts

from ruptfx import RuptfxError
from ruptfx.app.checks.preflight import preflight
from ruptfx.case import parse_case, read_case
from ruptfx.platform.launch import find_mpiexec
from ruptfx.results.record import Record
from ruptfx.run.model import Model
from ruptfx.run.simulation import simulate

pytestmark = pytest.mark.fem

WAVELENGTH = 0.6e-3
STIFFNESS = STIFF["young_modulus"] / (1 - STIFF["poisson_ratio"] ** 2)
RIGID = {"kind": "forward_lagrange", "tolerance": 1e-12}
SPRINGS = {"kind": "compliant", "C_n": 1e14, "C_s": 1e14}


def wave(amplitude: float) -> dict[str, Any]:
    return {"kind": "sinusoid", "amplitude": amplitude, "wavelength": WAVELENGTH}


def block(changes: dict[str, Any] | None = None) -> dict[str, Any]:
    """Pressed by 20 MPa and driven over its base at 10 m/s."""
    return merged({
        "plane": "strain", "order": 2, "duration": 8e-6,
        "mesh": {
            "kind": "block_on_rigid", "length": 1.2e-3, "height": 0.5e-3, "element_size": 0.1e-3,
            "base": {"left": -0.3e-3, "length": 2.4e-3},
        },
        "materials": {"default": STIFF},
        "faults": {"main": {
            "sliding": {}, "contact": RIGID, "friction": {"kind": "coulomb", "mu_d": 0.3},
            "initial_stress": {"normal": 0.0},
        }},
        "boundaries": [
            {"kind": "traction", "edge": "upper.top", "traction": [0.0, -20e6], "ramp": 1e-6},
            {"kind": "driven", "edge": "upper.top", "component": "x", "velocity": 10.0},
        ],
        "damping": {"mass": 1e5}, "output": {"figures": False},
    }, changes or {})  # fmt: skip


def test_a_flat_base_is_that_of_split_nodes() -> None:
    """However often it is found again what points face."""
    step = {"stepper": {"kind": "leapfrog", "time_step": 1e-8}}
    pairs = {**step, "mesh.base": None, "faults.main.sliding": None, "faults.main.contact": {"kind": "split_node"}}
    expected = march(parse_case(block(pairs)))[2]
    model, _, found = march(parse_case(block(step)))
    assert model.faults[0].interface.geometry.revision > 30
    for name in ("slip", "normal_stress", "shear_traction"):
        values = expected.faults["main"][name]
        np.testing.assert_allclose(found.faults["main"][name], values, atol=1e-10 * np.abs(values).max())
    np.testing.assert_allclose(found.velocity, expected.velocity, atol=1e-10 * np.abs(expected.velocity).max())


@pytest.mark.parametrize("contact", [RIGID, SPRINGS])
def test_sliding_over_a_wave_closes_the_budget(contact: dict[str, Any]) -> None:
    """The base does no work; forces have the ratio of friction and, flank by flank, the slope of the wave."""
    changes = {"faults.main.contact": contact, "mesh.base.profile": wave(10e-6)}
    model, motion, state = march(parse_case(block(changes)))
    energy, fields = motion.energies(state), state.faults["main"]
    work = energy.pop("boundary_work")
    assert abs(work - sum(energy.values())) < 1e-11 * work
    assert energy["frictional_dissipation"] > 0.5 * work
    assert abs(energy["impact_loss"]) + abs(energy["pairing_update_loss"]) < 0.01 * energy["frictional_dissipation"]
    face, closed = model.faults[0].interface, fields["normal_stress"] > 0
    assert 0.1 < closed.mean() < 0.6 and face.geometry.revision > 30
    # Points that are closed lie on the wave, deeper by what springs are pressed.
    _, here, there = face.places(state.displacement)
    pressed = fields["normal_stress"] / contact.get("C_n", np.inf)
    assert np.abs((here - there)[:, 1] + pressed)[closed].max() < 0.3e-6
    slope = -2 * np.pi / WAVELENGTH * 10e-6 * np.sin(2 * np.pi * here[closed, 0] / WAVELENGTH)
    np.testing.assert_allclose(face.frame[closed, 1, 1] / face.frame[closed, 1, 0], slope, atol=0.01)


@pytest.mark.parametrize("share", [0.26, 1.3])
def test_westergaard_on_a_rigid_wave(share: float) -> None:
    """Half a wavelength between walls of symmetry, from equilibrium to equilibrium; p* = pi E* A / wavelength."""
    stepper = {"kind": "quasi_static", "first_step": 0.2, "largest_step": 0.2}
    amplitude, length = 1e-6, 0.5 * WAVELENGTH
    full = np.pi * STIFFNESS * amplitude / WAVELENGTH
    table = block({
        "order": 4, "duration": 1.0, "damping": {}, "stepper": stepper,
        "mesh": {
            "kind": "block_on_rigid", "length": length, "height": WAVELENGTH, "element_size": length / 12,
            "growth": 1.4, "base": {"length": length, "profile": wave(amplitude)},
        },
        "faults.main.contact": {"kind": "augmented_lagrangian"}, "faults.main.friction.mu_d": 0.0,
        "boundaries": [
            *({"kind": "driven", "edge": f"upper.{side}", "component": "x", "velocity": 0.0}
              for side in ("left", "right")),
            {"kind": "traction", "edge": "upper.top", "traction": [0.0, -share * full], "ramp": 1.0},
        ],
    })  # fmt: skip
    model, _, state = march(parse_case(table))
    face, pressure = model.faults[0].interface, state.faults["main"]["normal_stress"]
    psi = np.pi * face.position / WAVELENGTH
    wanted = full * (share + np.cos(2 * psi))
    if share < 1:
        wanted = 2 * full * np.cos(psi) * np.sqrt(np.maximum(share - np.sin(psi) ** 2, 0.0))
    assert face.weight @ np.abs(pressure - wanted) < 0.01 * face.weight @ wanted
    np.testing.assert_allclose(pressure.max(), wanted.max(), rtol=0.01)


def test_what_check_says_of_a_wave() -> None:
    table = block({"mesh.base.profile": wave(10e-6)})
    found = {row.quantity.removeprefix("faults.main: "): row for row in preflight(parse_case(table))}
    assert float(found["E*"].value) == pytest.approx(STIFFNESS, rel=1e-6)
    expected = np.pi * STIFFNESS * 10e-6 / WAVELENGTH
    assert any(row.value == pytest.approx(expected, rel=1e-6) for row in found.values() if row.unit == "Pa")


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"faults.main.sliding": None}, r"mesh.base: .* add the table \[faults.main.sliding\]"),
        ({"mesh.base": None}, r"the minus side is not meshed \(rigid\), .* or give mesh.base"),
        ({"mesh.base.left": 2e-3}, r"mesh.base.left = 0.002: the block, from 0 to 0.0012 m, is beside its base"),
        ({"mesh.base.profile": {"kind": "table", "positions": [0.0, 1e-3], "values": [0.0, 1e-6]}},
         r"mesh.base.profile: the table from 0 to 0.001 m does not cover"),
    ],
)  # fmt: skip
def test_bases_that_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(RuptfxError, match=facts(message)):
        Model(parse_case(block(changes)))


SOLID = {
    "plane": "solid", "mesh.width": 0.4e-3, "mesh.length": 0.6e-3, "mesh.height": 0.3e-3,
    "mesh.base.width": 0.8e-3, "mesh.base.front": -0.2e-3,
}  # fmt: skip


def solid(changes: dict[str, Any]) -> dict[str, Any]:
    """A block of 0.6 x 0.4 x 0.3 mm on a wave, pressed by 20 MPa and driven at 10 m/s along x, 5 m/s along y."""
    top = "upper.top"
    edges = [
        {"kind": "traction", "edge": top, "traction": [0.0, 0.0, -20e6], "ramp": 1e-6},
        {"kind": "driven", "edge": top, "component": "x", "velocity": 10.0},
        {"kind": "driven", "edge": top, "component": "y", "velocity": 5.0},
    ]
    return block({**SOLID, "boundaries": edges, "mesh.base.profile": wave(2e-6), **changes})


@pytest.mark.parametrize(
    "kind, contact",
    [
        pytest.param("quasi_static", SPRINGS, id="quasi_static"),
        pytest.param("generalized_alpha", SPRINGS, id="generalized_alpha"),
        pytest.param(
            "quasi_static", {"kind": "augmented_lagrangian"}, id="quasi_static, rigid", marks=pytest.mark.slow
        ),
    ],
)
def test_implicit_steps_of_a_solid(kind: str, contact: dict[str, Any]) -> None:
    """The base carries the load of 20 MPa on 0.24 mm2; where it slides, friction is 0.3 of it along the slip rate."""
    model, _, state = march(parse_case(solid({
        "faults.main.contact": contact, "order": 1, "duration": 3e-6, "damping": None,
        "stepper": {"kind": kind} | ({"time_step": 1e-7} if kind == "generalized_alpha" else {}),
    })))  # fmt: skip
    face, fault = model.faults[0].interface, state.faults["main"]
    shear, rate, slip = (np.stack([fault[f"{name}_{k}"] for k in (1, 2)], axis=1)
                         for name in ("shear_traction", "slip_rate", "slip"))  # fmt: skip
    pressure, speed = fault["normal_stress"], np.linalg.norm(rate, axis=1)
    slides = (pressure > 0) & (speed > 1.0)
    assert slides.any() and slip[:, 0].max() > 5e-6 and face.geometry.revision > 2
    np.testing.assert_allclose(
        shear[slides], 0.3 * (pressure[slides] / speed[slides])[:, None] * rate[slides], atol=1e-6 * pressure.max()
    )
    if kind == "quasi_static":
        assert face.weight @ pressure == pytest.approx(20e6 * 0.24e-6, rel=0.01)
        overlap = -face.jump(state.displacement)[:, 0] - pressure / contact.get("C_n", np.inf)
        np.testing.assert_allclose(overlap[pressure > 0], 0.0, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("make", [block, solid])
def test_ranks_and_a_restart(make: Callable[..., dict[str, Any]], tmp_path: Path) -> None:
    """2 ranks: the same fields to rounding; a run that goes on from a checkpoint: the same bits."""
    path = tmp_path / "case.toml"
    path.write_text(tomli_w.dumps(make({
        "mesh.base.profile": wave(10e-6), "duration": 3e-6, "output.checkpoint_steps": 60,
    })))  # fmt: skip
    alone, two, resumed = (tmp_path / name for name in ("alone", "two", "resumed"))
    simulate(read_case(path), alone, progress=False)
    run = [find_mpiexec(), "-n", "2", sys.executable, "-m", "ruptfx", "run", str(path), "--out", str(two), "--quiet"]
    done = subprocess.run(run, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    with Record(alone) as record:
        assert float(record.interface["slip" if make is block else "slip_1"].max()) > 5e-6
    differences = largest_difference(alone, two)
    if make is solid:  # its underside is at z = 0, which has nothing but round-off
        differences.pop("interface.h5:z")
        with Record(alone) as one, Record(two) as other:
            assert max(float(np.abs(record.interface["z"]).max()) for record in (one, other)) < 1e-15
    assert max(differences.values()) < 1e-9
    shutil.copytree(alone, resumed)
    (resumed / "summary.json").unlink()
    simulate(read_case(path), resumed, progress=False, resume=True)
    assert max(largest_difference(alone, resumed).values()) == 0
