"""Memory of objects from step to step: a resumed run has the attributes of one that was never stopped."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import FunctionType, MethodType
from typing import Any

import numpy as np
import pytest
from helpers.compare import largest_difference
from helpers.crack_cases import block, meeting_blocks
from helpers.sliding_cases import rough
from helpers.small_cases import INSTRUMENTS, case, impact, slip_weakening
from scipy import sparse

pytest.importorskip("dolfinx")

from ruptfx.case import Case, parse_case
from ruptfx.run import simulation
from ruptfx.run.recording.recorder import Recorder

pytestmark = pytest.mark.fem

HELD = [{"kind": "driven", "edge": "lower.bottom", "component": axis, "velocity": 0.0} for axis in "xy"]
PULLS = {"kind": "driven", "edge": "upper.left", "component": "x", "velocity": 1.0, "ramp": 1e-6}
SLOW = {
    "order": 2, "duration": 1e-3, "boundaries": [*HELD, PULLS], "output.interface_steps": 2,
    "faults.main.friction": {"kind": "coulomb", "mu_d": 0.3},
    "faults.main.initial_stress": {"normal": 1e6, "shear": 2e4},
    "stepper": {"kind": "quasi_static", "first_step": 1e-5, "largest_step": 1e-5},
}  # fmt: skip
CYCLES = {
    "duration": 3.0, "boundaries": [*HELD, {**PULLS, "velocity": 1e-6}], "stepper": {"kind": "quasi_dynamic"},
    "faults.main.contact": {"kind": "compliant", "C_n": 1e14, "C_s": 1e14},
    "faults.main.friction": {
        "kind": "rate_and_state_ageing", "a": 0.01, "b": 0.014, "D_c": 2e-7, "f_0": 0.6, "V_0": 1e-6,
    },
    "faults.main.initial_stress": {"normal": 6e6, "shear": 3.3e6},
}  # fmt: skip

OF_THE_PROCESS = (
    r"\.(log|_log|comm)\b", r"^checkpoints\._last$",  # the log itself; wall-clock time of the last checkpoint
    # Open files; what it resumes.
    r"^recorder\._(writer|forces|instruments|energies|resume)\b", r"^recorder\.parts\.\d+\._(files|file)\b",
)  # fmt: skip
"""Attributes that are not compared: they belong to a process, not to the run."""

REMADE = (
    r"^recorder\._bulk\.nodal\._(volume|stress_forms|by_kernel)",  # made when stress is first recorded
    r"geometry\.revision$",  # a number for each geometry made in this process
    r"geometry\._arrays",
    r"^motion\.mechanisms\.\d+\.steps\.",  # arrays that compiled steps are bound to when called
    r"^motion\._sums\.",  # energies that a step summed on its way, valid for the step whose number they have
    r"followers\.\d+\._room$",  # a bound below the slip that is left, found again when it is used up
    r"^model\.collisions\._then\b",  # positions when pairs were last sought: sought again at once after a restart
    r"^model\.cracks\._(found|cell_number)$",  # the result of a search; numbers that are made at the first failure
    r"^model\.cracks\.unconverged$",  # counts the steps at which this process writes to the log
    r"interface_steps\._load_paths",  # by the object that solves, as a dictionary names it
)
"""Attributes that may differ: a process makes them when it needs them, and results do not depend on when that was."""

AFTER = 3  # steps after which model and motion have made again what they derive from the state


def leaves(name: str, value: Any, seen: dict[int, Any]) -> Iterator[tuple[str, Any]]:
    """Numbers, words and arrays that are reached from an object of ruptfx, by the way to them."""
    if any(re.search(pattern, name) for pattern in OF_THE_PROCESS):
        return
    if value is None or isinstance(value, bool | int | float | complex | str | np.generic):
        yield name, value
        return
    if isinstance(value, np.ndarray) and value.dtype != object:
        yield name, value.copy()
        return
    if id(value) in seen:
        return
    seen[id(value)] = value  # kept, so that no other object gets its number
    inner: list[tuple[str, Any]] = []
    if sparse.issparse(value):
        matrix = value.tocoo()
        inner = [(part, getattr(matrix, part)) for part in ("row", "col", "data")]
    elif isinstance(value, Mapping):
        inner = [(str(key), item) for key, item in value.items()]
    elif isinstance(value, list | tuple):
        inner = [(str(number), item) for number, item in enumerate(value)]
    elif isinstance(value, MethodType):
        inner = [("self", value.__self__)]
    elif isinstance(value, FunctionType) and (value.__module__ or "").startswith("ruptfx"):
        cells = zip(value.__code__.co_freevars, value.__closure__ or (), strict=True)
        inner = [(key, cell.cell_contents) for key, cell in cells]
    elif type(value).__module__.startswith("ruptfx") and not isinstance(value, type):
        slots = [key for kind in type(value).__mro__ for key in getattr(kind, "__slots__", ())]
        inner = [*vars(value).items()] if hasattr(value, "__dict__") else []
        inner += [(key, getattr(value, key)) for key in slots if hasattr(value, key)]
    for key, item in inner:
        yield from leaves(f"{name}.{key}", item, seen)


def photograph(objects: dict[str, Any]) -> dict[str, Any]:
    seen: dict[int, Any] = {}
    return {key: leaf for name, item in objects.items() for key, leaf in leaves(name, item, seen)}


class Camera:
    """Takes the attributes of all objects of a run at the beginning of some of its steps."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.objects: dict[str, Any] = {}
        self.wanted: set[int] = set()
        self.last: int | None = None
        self.pictures: dict[int, dict[str, Any]] = {}
        for kind in ("Recorder", "StopRules", "Checkpoints"):
            monkeypatch.setattr(simulation, kind, self._watched(kind.lower(), getattr(simulation, kind)))
        step = simulation._step

        def watched(motion: Any, state: Any) -> Any:
            if state.step in self.wanted:
                found = {"state": state, "model": self.objects["recorder"].model, "motion": motion, **self.objects}
                self.pictures[state.step] = photograph(found)
            if state.step == self.last:
                raise Stopped
            return step(motion, state)

        monkeypatch.setattr(simulation, "_step", watched)

    def _watched(self, name: str, kind: type) -> Any:
        def make(*given: Any) -> Any:
            self.objects[name] = kind(*given)
            return self.objects[name]

        return make


def differences(one: dict[str, Any], other: dict[str, Any]) -> list[str]:
    def same(a: Any, b: Any) -> bool:
        if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
            return np.shape(a) == np.shape(b) and np.array_equal(a, b, equal_nan=np.asarray(a).dtype.kind == "f")
        return bool(a == b or (a != a and b != b))

    missing = object()
    return [key for key in {**one, **other} if not same(one.get(key, missing), other.get(key, missing))]


class Stopped(Exception):  # noqa: N818
    """By the test."""


CASES: dict[str, Callable[[], tuple[Case, int]]] = {
    "leapfrog": lambda: (parse_case(impact(6e6, 2.0, changes={
        "duration": 6e-6, "instruments": INSTRUMENTS, "stop_when": {"sliding_dead_for": 1e-6},
    })), 25),
    "sliding": lambda: (parse_case(rough({
        "duration": 3e-6, "output.interface_interval": 0.25e-6, "output.forces_interval": 0.3e-6,
        "damping": {"mass": 1e5, "kelvin_voigt": {"fraction": 0.1}},
    })), 60),
    "intrinsic": lambda: (parse_case(block({"damping": {"mass": 1e3, "kelvin_voigt": {"fraction": 0.1}}})), 200),
    "extrinsic": lambda: (parse_case(block({"fracture.kind": "extrinsic"})), 110),
    "collisions": lambda: (parse_case(meeting_blocks()), 200),
    "generalized_alpha": lambda: (parse_case(impact(6e6, 2.0, changes={
        "order": 2, "duration": 10e-6, "mesh.length": 16e-3, "mesh.height": 6e-3,
        "stepper": {"kind": "generalized_alpha", "courant": 1.0},
    })), 4),
    "quasi_static": lambda: (case(SLOW), 4),
    "quasi_dynamic": lambda: (case({**SLOW, **CYCLES}), 4),
    "stages": lambda: (case({
        "order": 2, "duration": 3e-6, "output.interface_interval": 0.5e-6, "stepper.time_step": 5e-8, "stages": [
            {"duration": 1e-6, "boundaries": [PULLS]}, {"duration": 2e-6, "boundaries": [{**PULLS, "velocity": 2.0}]},
        ],
    }), 30),
}  # fmt: skip
"""Cases, and a step at which they are stopped."""


@pytest.mark.parametrize("name", CASES)
def test_a_resumed_run_remembers_all(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """State, recorder, samples, means and stop rules at once; model and motion when they have done a few steps."""
    given, stop = CASES[name]()
    given = given.changed("output", given.output.model_copy(update={"checkpoint_steps": stop}))
    camera = Camera(monkeypatch)
    camera.wanted, camera.last = {stop, stop + AFTER}, stop + AFTER
    pictures = []
    for resume in (False, True):
        with pytest.raises(Stopped):
            simulation.simulate(given, tmp_path / "run", progress=False, resume=resume)
        pictures.append(dict(camera.pictures))
        camera.pictures.clear()
    whole, resumed = pictures
    assert whole.keys() == resumed.keys() == camera.wanted
    assert len(whole[stop]) > 100
    changed = differences(whole[stop], resumed[stop])
    forgotten = [key for key in changed if not key.startswith(("model.", "motion."))]
    forgotten += [
        key for key in differences(whole[stop + AFTER], resumed[stop + AFTER]) if key.startswith(("model.", "motion."))
    ]
    assert [key for key in forgotten if not any(re.search(pattern, key) for pattern in REMADE)] == []


def test_the_comparison_sees_what_is_forgotten(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An attribute that counts steps and is in no checkpoint; one that is in it."""
    observe = Recorder.observe

    def counts(recorder: Any, state: Any) -> None:
        recorder.counted = getattr(recorder, "counted", 0) + 1
        observe(recorder, state)

    monkeypatch.setattr(Recorder, "observe", counts)
    with pytest.raises(AssertionError, match=r"recorder\.counted"):
        test_a_resumed_run_remembers_all("leapfrog", tmp_path, monkeypatch)


def test_sliding_that_had_died_before_a_stop(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A short push slips and dies; stopped while the rule waits, the run ends at the step at which it would have."""
    given = parse_case(impact(6e6, 2.0, changes={
        "duration": 200e-6, "mesh.length": 12e-3, "mesh.height": 4e-3, "output.checkpoint_steps": 50,
        "output.interface_interval": 1e-6, "boundaries": [], "stop_when": {"sliding_dead_for": 15e-6},
        "faults.main.initial_stress.shear": {
            "kind": "boxcar", "inside": 0.2e6, "outside": 0.0, "center": 6e-3, "half_width": 1e-3,
        },
    }))  # fmt: skip
    whole = simulation.simulate(given, tmp_path / "whole", progress=False).summary
    assert whole is not None and whole["ended_by"] == "sliding died"
    # Of the last 15 us, in which nothing slides, half are left: a rule that began anew would end 7 us later.
    camera = Camera(monkeypatch)
    camera.last = whole["steps"] - round(7e-6 / whole["time_step"])
    with pytest.raises(Stopped):
        simulation.simulate(given, tmp_path / "stopped", progress=False)
    camera.last = None
    resumed = simulation.simulate(given, tmp_path / "stopped", progress=False, resume=True).summary
    assert resumed is not None and (resumed["steps"], resumed["ended_by"]) == (whole["steps"], whole["ended_by"])
    assert max(largest_difference(tmp_path / "whole", tmp_path / "stopped").values()) == 0


def test_a_run_that_a_rule_has_ended_does_not_go_on(tmp_path: Path) -> None:
    """Killed between its last checkpoint, which is of the step at which a tip left the window, and its summary."""
    given = parse_case(impact(6e6, 2.0, changes={
        "duration": 30e-6, "order": 2, "mesh.length": 12e-3, "mesh.height": 4e-3, "output.checkpoint_steps": 1,
        "stop_when": {"tip_beyond": 6e-3}, "boundaries": [
            {"kind": "driven", "edge": "upper.left", "component": "x", "velocity": 5.0},
        ],
    }))  # fmt: skip
    ends = []
    for resume in (False, True):
        summary = simulation.simulate(given, tmp_path / "run", progress=False, resume=resume).summary
        assert summary is not None
        ends.append((summary["steps"], summary["ended_by"]))
        (tmp_path / "run" / "summary.json").unlink()
    assert ends[0] == ends[1] and ends[0][1] == "tip left the window"


def test_the_impact_loss_of_a_resumed_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Plates of two materials stay closed before and after a stop; rounding of their opening rate is no loss."""
    soft = {"kind": "isotropic_elastic", "young_modulus": 2.9e9, "poisson_ratio": 0.39, "density": 1180.0}
    given = parse_case(slip_weakening({
        "duration": 8e-6, "output.checkpoint_steps": 20, "materials.lower": soft,
    }))  # fmt: skip
    simulation.simulate(given, tmp_path / "whole", progress=False)
    camera = Camera(monkeypatch)
    camera.last = 20
    with pytest.raises(Stopped):
        simulation.simulate(given, tmp_path / "stopped", progress=False)
    camera.last = None
    simulation.simulate(given, tmp_path / "stopped", progress=False, resume=True)
    energies = [(tmp_path / name / "energy.csv").read_bytes() for name in ("whole", "stopped")]
    assert energies[0] == energies[1]
