"""The contract of a material with memory as checks, for `ruptfx check-law` and the contract tests.

A check takes an example material and a seed. It raises `Broken` with values and their position, or returns why it does
not apply to this material, or None.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable

import numpy as np
import tomli_w
from pydantic import TypeAdapter

from ruptfx.app.check_law.checks import Broken, require
from ruptfx.input.schema import CaseError
from ruptfx.laws.materials import AnyMaterial, Material, Tensor
from ruptfx.laws.materials.stiffness import require_positive_energy, tangent_stiffness
from ruptfx.laws.materials.tensor import COMPONENTS
from ruptfx.laws.materials.traced import traced

N = 60  # points
STEPS = 40
Values = dict[str, np.ndarray]
Packed = dict[str, "Tensor | np.ndarray"]


def missing(cls: type[Material]) -> list[str]:
    """Return the names of missing attributes of a class."""
    return ["a docstring"] * (not cls.summary()) + ["stored"] * (
        cls.has_memory() and "stored energy" not in cls.offers
    )  # fmt: skip


def started(material: Material) -> Packed:
    """Return the initial state of N points, as `stress` takes it."""
    return {
        name: Tensor(*np.full((6, N), field.start)) if field.tensor else np.full(N, field.start)
        for name, field in material.state_fields().items()
    }


def path(seed: int, steps: int = STEPS) -> tuple[np.ndarray, np.ndarray]:
    """Return strains of random smooth paths, shape (steps, 6, N), and the time steps of the points, shape (N,)."""
    random = np.random.default_rng(seed)
    phase = np.linspace(0, 4, steps)[:, None, None]
    turns, size = random.uniform(0.3, 2, (6, N)), random.normal(size=(6, N)) * 10 ** random.uniform(-4, 0, N)
    return size * (np.sin(turns * phase + (start := random.uniform(0, 6, (6, N)))) - np.sin(start)), 10 ** (
        random.uniform(-8, -1, N)
    )  # fmt: skip


def elastic(material: Material, strain: np.ndarray) -> np.ndarray:
    """Return the stress of the elastic energy of strains of shape (6, ...) in 3D [Pa]."""
    stiffness = tangent_stiffness(material, "solid")
    matrix = np.array([
        [stiffness[tuple("xyz".index(axis) for axis in a + b)] * (1 if b[0] == b[1] else 2) for b in COMPONENTS]
        for a in COMPONENTS
    ])  # fmt: skip
    return np.einsum("ij,j...->i...", matrix, strain)


def scale(material: Material, strain: np.ndarray) -> np.ndarray:
    """Return the size of the elastic stress of points, from strains of shape (..., 6, N), for tolerances [Pa]."""
    stress = np.abs(elastic(material, np.moveaxis(strain, -2, 0)))
    return np.asarray(stress.max(axis=tuple(range(stress.ndim - 1))) + 1e-300)


def toml(material: Material, seed: int) -> None:
    """Check that a material is unchanged after it is written to a case and read again."""
    written = tomli_w.dumps({"material": material.model_dump(mode="json", exclude_none=True)})
    again = TypeAdapter(AnyMaterial).validate_python(tomllib.loads(written)["material"])
    require(again == material, "a case with this material reads differently than it was written")


def positive(material: Material, seed: int) -> None:
    """Check that every strain stores energy, in all planes of the material."""
    try:
        for plane in material.planes():
            require_positive_energy(material, plane)
    except CaseError as error:
        raise Broken(
            f"{error}, or declare an `example` with numbers that fit together, and refuse others in `check_values`"
        ) from None


def starts_elastic(material: Material, seed: int) -> str | None:
    """Check that the stress of a sudden strain is that of the elastic energy, which is stored."""
    if not material.has_memory():
        return "its stress follows from its energy"
    strain = path(seed)[0][-1]
    result, _ = material.stress(Tensor(*strain), started(material), 0.0)
    expected = elastic(material, strain)
    apart = np.abs(np.array([x + 0 * strain[0] for x in result.components]) - expected).max(axis=0)
    require(apart <= 1e-9 * scale(material, strain[None]), "stress with dt = 0 is not elastic", apart=apart)
    energy = material.stored(Tensor(*strain), started(material)) - material.stored(Tensor(), started(material))
    work = 0.5 * Tensor(*strain).dot(Tensor(*expected))
    require(np.abs(energy - work) <= 1e-9 * work, "the elastic energy is not stored", stored=energy, work=work)
    return None


def repeats(material: Material, seed: int) -> str | None:
    """Check that another call with dt = 0 returns the same stress and state."""
    if not material.has_memory():
        return "it has no state"
    strains, dt = path(seed)
    state = started(material)
    for strain in strains:
        stress, state = material.stress(Tensor(*strain), state, dt)
    again, same = material.stress(Tensor(*strains[-1]), state, 0.0)
    unit = scale(material, strains)
    for name, one, other in zip(COMPONENTS, stress.components, again.components, strict=True):
        require(np.abs(one - other) <= 1e-9 * unit, f"stress {name} with dt = 0 is not the present one", dt=dt)
    for name, old in _numbers(state).items():
        change = np.abs(_numbers(same)[name] - old)
        require(change <= 1e-9 * (np.abs(old) + np.abs(strains).max()), f"{name} changes with dt = 0", change=change)
    return None


def _numbers(state: Packed) -> Values:
    numbers: Values = {}
    for name, value in state.items():
        parts = zip(COMPONENTS, value.components, strict=True) if isinstance(value, Tensor) else [("", value)]
        numbers |= {f"{name}_{part}": np.asarray(number) + np.zeros(N) for part, number in parts}
    return numbers


def tracing(material: Material, seed: int) -> str | None:
    """Compare the traced formula with the method, and its derivative with finite differences."""
    if not material.has_memory():
        return "its stress follows from its energy"
    law, (strains, dt), state = traced(material, "solid"), path(seed), started(material)
    numbers = {name: np.full(N, value) for name, value in law.state.items()}
    unit = scale(material, strains)
    for strain in strains:
        named = dict(zip(COMPONENTS, strain, strict=True))
        before = numbers
        stress, state = material.stress(Tensor(*strain), state, dt)
        items, numbers = law.evaluate(named, numbers, dt)
        for name, expected in zip(COMPONENTS, stress.components, strict=True):
            require(np.abs(items[name] - expected) <= 1e-10 * unit, f"traced stress {name} differs", found=items[name])
    tangent, smallest = law.tangent(named, before, dt), 1e-6 * np.abs(strains).max(axis=(0, 1))
    for column, name in enumerate(COMPONENTS):
        high, low = (law.evaluate({**named, name: named[name] + s * smallest}, before, dt)[0] for s in (1, -1))
        for row, other in enumerate(COMPONENTS):
            slope = (high[other] - low[other]) / (2 * smallest)
            near = np.abs(slope - tangent[row, column]) <= 1e-4 * np.abs(elastic(material, np.eye(6))).max()
            require(near.mean() > 0.9, f"derivative of {other} by {name} differs")
    return None


def stable(material: Material, seed: int) -> str | None:
    """Check that no tangent exceeds the elastic stiffness, from which the stable time step follows.

    Largest eigenvalue of inv(C) T, for T need not be symmetric where flow is not associated.
    """
    if not material.has_memory():
        return "it is elastic"
    law, (strains, dt) = traced(material, "solid"), path(seed)
    state = {name: np.full(N, value) for name, value in law.state.items()}
    elastic_stiffness = elastic(material, np.eye(6))
    for strain in strains:
        named = dict(zip(COMPONENTS, strain, strict=True))
        relative = np.linalg.solve(elastic_stiffness, np.moveaxis(law.tangent(named, state, dt), -1, 0)).astype(float)
        largest = np.linalg.eigvals(relative).real.max(axis=1)
        require(largest <= 1 + 1e-6, "stiffer than its elastic energy", times=largest, dt=dt)
        _, state = law.evaluate(named, state, dt)
    return None


def dissipates(material: Material, seed: int) -> str | None:
    """Check that the work of the stress never is less than what is stored."""
    if not material.has_memory():
        return "it is elastic"
    strains, dt = path(seed, 40 * STEPS)
    state, old, before = started(material), np.zeros((6, N)), np.zeros((6, N))
    work, largest, first = np.zeros(N), np.zeros(N), material.stored(Tensor(), started(material))
    lost = [np.zeros(N)]
    for strain in strains:
        stress, state = material.stress(Tensor(*strain), state, dt / 40)
        now = np.array([x + np.zeros(N) for x in stress.components])
        work = work + Tensor(*(0.5 * (now + old))).dot(Tensor(*(strain - before)))
        largest = np.maximum(largest, np.abs(work))
        lost.append(work - (material.stored(Tensor(*strain), state) - first))
        old, before = now, strain
    worst = np.diff(lost, axis=0).min(axis=0)
    require(worst >= -1e-4 * largest, "energy appears", gained=-worst, largest_work=largest)
    return None


def indifferent(material: Material, seed: int) -> str | None:
    """Check that an isotropic material has no preferred direction."""
    if not (material.has_memory() and material.isotropic):
        return "it is not isotropic with memory"
    if any(np.any(np.asarray(value)) for value in material.model_dump().values() if isinstance(value, list)):
        return "it is given a tensor"
    strains, dt = path(seed)
    turn, turning = np.eye(3), 2 if material.planes() == ("strain",) else 3  # axes: those of the plane, or all
    turn[:turning, :turning] = np.linalg.qr(np.random.default_rng(seed).normal(size=(turning, turning)))[0]
    states = [started(material), started(material)]
    for strain in strains:
        matrix = _matrix(strain)
        turned = np.einsum("ij,jkn,lk->iln", turn, matrix, turn)
        results = []
        for place, values in enumerate((strain, _components(turned))):
            stress, states[place] = material.stress(Tensor(*values), states[place], dt)
            results.append(_matrix(np.array([x + np.zeros(N) for x in stress.components])))
    apart = np.abs(np.einsum("ij,jkn,lk->iln", turn, results[0], turn) - results[1]).max(axis=(0, 1))
    require(apart <= 1e-8 * scale(material, strains), "the stress depends on the direction", apart=apart)
    return None


def _matrix(parts: np.ndarray) -> np.ndarray:
    xx, yy, zz, xy, yz, xz = parts
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _components(matrix: np.ndarray) -> np.ndarray:
    return np.array([matrix["xyz".index(name[0]), "xyz".index(name[1])] for name in COMPONENTS])


CHECKS: dict[str, Callable[[Material, int], str | None]] = {
    "case file": toml, "positive energy": positive, "elastic under sudden strain": starts_elastic,
    "present stress": repeats, "traced formula": tracing, "stable time step": stable, "dissipation": dissipates,
    "no preferred direction": indifferent,
}  # fmt: skip
