"""Every way to fill a specimen with minerals: fractions, seeds, the text of a case."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest
from helpers.messages import facts
from pydantic import TypeAdapter, ValidationError

from ruptfx.bodies.phases import AnyPhases, Phases
from ruptfx.bodies.phases.voronoi_grains import VoronoiGrains
from ruptfx.input.schema import CaseError, alternatives

KINDS = alternatives("ruptfx.bodies.phases")
every_kind = pytest.mark.parametrize("kind", KINDS)
SIZE = 0.1e-3


def example(kind: str) -> Phases:
    return TypeAdapter(AnyPhases).validate_python(tomllib.loads(f"phases = {KINDS[kind].example}")["phases"])


def centres() -> np.ndarray:
    """Of 200 x 300 cells."""
    x, y = np.meshgrid(np.arange(200) * SIZE, np.arange(300) * SIZE)
    return np.column_stack([x.ravel(), y.ravel()])


@every_kind
def test_fractions_come_out(kind: str) -> None:
    """Within four standard deviations of as many independent draws as the kind says that its phases are worth."""
    phases = example(kind)
    assert phases.kind() == kind
    found = np.bincount(phases.phase_of(centres(), SIZE), minlength=2) / len(centres())
    share = np.array(list(phases.fractions.values()))
    draws = phases.draws(SIZE * np.array([200, 300]), SIZE)
    assert found == pytest.approx(share, abs=4 * np.sqrt(share.prod() / draws))


@every_kind
def test_a_seed_gives_the_same_phases_again(kind: str) -> None:
    phases = example(kind)
    first = phases.phase_of(centres(), SIZE)
    np.testing.assert_array_equal(first, phases.phase_of(centres(), SIZE))
    assert np.any(first != phases.model_copy(update={"seed": 2}).phase_of(centres(), SIZE))


@every_kind
def test_fractions_that_are_no_whole_are_refused(kind: str) -> None:
    table = example(kind).model_dump() | {"fractions": {"quartz": 0.4, "mica": 0.3}}
    with pytest.raises(ValidationError, match=facts(r"add up to 0\.7")):
        KINDS[kind].model_validate({key: value for key, value in table.items() if key != "kind"})


@every_kind
def test_fractions_scatter_as_declared(kind: str) -> None:
    """Over 100 seeds the variance of a fraction is that of so many draws, p (1 - p) / n, within a factor of two."""
    phases = example(kind)
    found = [np.mean(phases.model_copy(update={"seed": seed}).phase_of(centres(), SIZE) == 0) for seed in range(100)]
    share, draws = next(iter(phases.fractions.values())), phases.draws(SIZE * np.array([200, 300]), SIZE)
    assert 0.5 < np.var(found) * draws / (share * (1 - share)) < 2


def test_grains_have_the_size_that_is_asked_for() -> None:
    # 20 x 30 mm, grains of 1 mm: 600; neighbouring cells in one grain differ nowhere, so that the length of boundaries
    # between grains, all of different phases here, is that of a Poisson-Voronoi tessellation: 2 / sqrt(area) per area,
    # times 4 / pi as lines of a square lattice measure it.
    phases = VoronoiGrains(fractions={f"p{i}": 0.001 for i in range(1000)}, grain_size=1e-3)
    found = phases.phase_of(centres(), SIZE).reshape(300, 200)
    changes = np.sum(found[1:] != found[:-1]) + np.sum(found[:, 1:] != found[:, :-1])
    assert changes * SIZE / (20e-3 * 30e-3) == pytest.approx(4 / np.pi * 2 / 1e-3, rel=0.05)


def test_grains_smaller_than_two_cells_are_refused() -> None:
    with pytest.raises(CaseError, match=facts(r"mesh\.phases\.grain_size = 0\.0001 m .* cells of ")):
        VoronoiGrains(fractions={"quartz": 1.0}, grain_size=1e-4).phase_of(centres(), SIZE)
