"""Figures beside those of one run: catalogues, gradients, searches, comparisons, films and laws show their numbers."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray
from helpers import synthetic
from helpers.drawn import shows, size, sizes_of

from ruptfx.app.check_law import figure as laws
from ruptfx.app.commands.compare import overlay, overlay_surfaces
from ruptfx.laws.cohesion.linear import Linear
from ruptfx.laws.friction.rate_and_state_ageing import RateAndStateAgeing
from ruptfx.laws.materials.isotropic_elastic import IsotropicElastic
from ruptfx.many_runs.adjoint import figure as gradients
from ruptfx.many_runs.study import search, search_figure
from ruptfx.many_runs.study.definition import Axis
from ruptfx.results import movies
from ruptfx.results.analysis.emission import BValue, Catalogue, FractalDimension, Omori, b_against_completeness
from ruptfx.results.catalogue_statistics import catalogue_statistics
from ruptfx.results.record import Record

RANDOM = np.random.default_rng(2)
EVENTS = Catalogue(np.sort(RANDOM.uniform(1e-4, 9e-4, 80)), RANDOM.uniform(0, 0.1, 80), RANDOM.uniform(0, 0.05, 80),
                   10 ** RANDOM.uniform(-9, -6, 80))  # fmt: skip


def test_statistics_of_a_catalogue() -> None:
    b, radius = BValue(1.2, 0.1, -8.5, 0.1, 70), np.geomspace(1e-3, 2e-2, 5)
    D, p = FractalDimension(1.6, 0.1, radius, 0.3 * radius**1.5), Omori(0.9, 0.1, 1e-6, 2.0)
    places, sizes, pairs, rates = catalogue_statistics(EVENTS, b, D, p, 1e-3).axes
    (circles,) = places.collections
    np.testing.assert_allclose(circles.get_offsets() * sizes_of(places), np.column_stack([EVENTS.x, EVENTS.y]))
    order = np.argsort(EVENTS.magnitude)
    assert np.all(np.diff(circles.get_sizes()[order]) > 0)  # larger magnitudes have larger circles
    count, line, completeness, others = sizes.lines
    np.testing.assert_allclose(count.get_data(), [EVENTS.magnitude[order], np.arange(80, 0, -1)])
    ends = np.array([-8.55, EVENTS.magnitude.max()])
    np.testing.assert_allclose(line.get_data(), [ends, 70 * 10 ** (-1.2 * (ends + 8.55))])
    assert completeness.get_xdata()[0] == -8.5
    against = [each.b for each in b_against_completeness(EVENTS.magnitude)]
    assert others.get_label() == f"{min(against):.2f} to {max(against):.2f} for other M_c"
    middle = np.exp(np.mean(np.log(radius))), np.exp(np.mean(np.log(D.correlation)))
    shows(pairs, (radius, D.correlation), (radius, middle[1] * (radius / middle[0]) ** 1.6))
    before = 1e-3 - EVENTS.time
    limits = np.geomspace(before.min(), before.max(), 16)
    counts = np.histogram(before, limits)[0]
    per_second = (np.sqrt(limits[1:] * limits[:-1])[counts > 0], (counts / np.diff(limits))[counts > 0])
    shows(rates, per_second, (limits, 2.0 * (limits + 1e-6) ** -0.9))
    *_, whole = catalogue_statistics(EVENTS, b, D).axes
    (steps,) = whole.patches
    counts, limits = np.histogram(EVENTS.time, 40)
    values, edges, _ = steps.get_data()
    unit = sizes_of(whole)[0]
    np.testing.assert_allclose(edges * unit, limits)
    np.testing.assert_allclose(values / unit, counts / np.diff(limits))
    assert whole.get_ylabel() == f"Number of events per {whole.get_xlabel()[6:-1]}"


def test_gradients_are_per_length() -> None:
    """Derivatives at points over their shares of the length [m], in their order, and at knots as they are."""
    x, weight = np.linspace(0, 0.03, 7), RANDOM.uniform(1, 2, 7) * 1e-3
    found = xarray.Dataset(
        {"stress": ("point_main", RANDOM.normal(size=7), {"units": "J/Pa", "unknown": 1}),
         "friction": ("knot", [3.0, -1.0, 2.0], {"units": "J", "unknown": 1}),
         "position_main": ("point_main", x), "weight_main": ("point_main", weight, {"units": "m"}),
         "objective": ((), 2.5, {"units": "J"})}, {"knot": [0.0, 0.01, 0.02]},
    )  # fmt: skip
    figure = gradients.draw(found)
    for ax, curve in zip(figure.axes, ((x, found.stress / weight), ([0, 0.01, 0.02], [3, -1, 2])), strict=True):
        curve_of = ax.lines[-1]
        np.testing.assert_allclose(curve_of.get_xdata() * sizes_of(ax)[0], curve[0])
        np.testing.assert_allclose(curve_of.get_ydata(), curve[1])
    assert figure.axes[0].get_ylabel() == "per length\n(J/(Pa m))" and "2.5 J" in figure.get_suptitle()
    numbers = found[["objective"]].assign(one=((), 4.0, {"unknown": 1}), two=((), -2.0, {"unknown": 1}))
    (ax,) = gradients.draw(numbers).axes
    assert [bar.get_height() for bar in ax.patches] == [4.0, -2.0]


def test_searches_show_the_best_set_so_far() -> None:
    """Scores of sets in their order; values of constants over their ranges, the best last and dark."""
    scores, degrees = [0.2, 0.6, 0.4, 0.9, 0.1], RANDOM.uniform(0, 1, (5, 2))
    axes = [Axis(key="a", range=[1.0, 3.0]), Axis(key="b", range=[1e-6, 1e-2], spacing="log")]
    sets: Any = [
        SimpleNamespace(score=score, degrees=dict(zip(("p", "q"), row.tolist(), strict=True)),
                        sample={"a": 1.0 + number / 2, "b": 10.0 ** (-6 + number)})
        for number, (score, row) in enumerate(zip(scores, degrees, strict=True))
    ]  # fmt: skip
    study: Any = SimpleNamespace(sampled=axes)
    above, below, _ = search_figure.draw(study, sets).axes
    best = [0, 1, 1, 3, 3]
    expected = [scores, np.array(scores)[best], degrees[best, 0], degrees[best, 1]]
    for line, values in zip(above.lines, expected, strict=True):
        np.testing.assert_allclose(line.get_ydata(), values)
    ranked = np.argsort(scores)
    for line, number in zip(below.lines, ranked, strict=False):
        np.testing.assert_allclose(line.get_ydata(), [number / 4, number / 4])
        assert line.get_color() == search_figure.MAP(scores[number] / 0.9)
    assert [text.get_text() for text in below.texts] == ["1", "3", "1e-06", "0.01"]
    # Neighbours are a quarter of both ranges apart; of those that are 0.1 apart, the root mean square, the best counts.
    assert [one.score for one in search.best_of(study, sets, 3)] == [0.9, 0.6, 0.4]
    for apart, kept in ((0.13, [0.9, 0.5]), (0.15, [0.9, 0.8, 0.5])):  # along one of two axes, 0.092 and 0.106
        near = [SimpleNamespace(score=score, sample={"a": 1.0 + 2 * part, "b": 1e-4})
                for score, part in ((0.9, 0.4), (0.8, 0.4 + apart), (0.5, 0.9))]  # fmt: skip
        assert [one.score for one in search.best_of(study, near)] == kept  # type: ignore[arg-type]


def test_two_runs_over_each_other(tmp_path: Path) -> None:
    """The second twice as fast and half as long sliding: rupture times, slip at the end and slip rates half-way."""
    time, position = synthetic.times(121), synthetic.points(20)
    fields = [synthetic.crack(time, position, 2100.0), synthetic.crack(time, position, 1050.0, rate=3.0)]
    paths = [synthetic.write_run(tmp_path / name, field, time, position, snapshots=2)
             for name, field in zip(("one", "two"), fields, strict=True)]  # fmt: skip
    with Record(paths[0]) as one, Record(paths[1]) as two:
        both = one.interface, two.interface
        arrival, slip, rate = overlay(one, two).axes
        shows(arrival, *((data.position, data.rupture_time) for data in both))
        shows(slip, *((data.position, data.slip[-1]) for data in both))
        reached = both[1].position.values[np.isfinite(both[1].rupture_time.values)]
        at = int(np.argmin(np.abs(position - 0.5 * (reached.min() + reached.max()))))
        shows(rate, *((data.time, data.slip_rate[:, at]) for data in both))
        assert rate.get_title(loc="right") == f"at {1e3 * 0.5 * (reached.min() + reached.max()):.4g} mm"


def test_two_surfaces_over_each_other(tmp_path: Path) -> None:
    """Fronts at 2.5 and 2 km/s from a point 10 km down dip, in the middle of the surface; slip rate 1 m/s."""
    for name, speed in (("one", 2500.0), ("two", 2000.0)):
        synthetic.write_surface_run(tmp_path / name, speed)
    with Record(tmp_path / "one") as one, Record(tmp_path / "two") as two:
        times, slip, rate = overlay_surfaces(one, two).axes
        for lines, speed in zip(times.collections, (2.5, 2.0), strict=True):
            for level, path in zip(lines.levels, lines.get_paths(), strict=True):
                if level > 0:
                    radius = np.hypot(path.vertices[:, 0], path.vertices[:, 1] - 10.0)
                    np.testing.assert_allclose(radius, speed * level, atol=0.3)
        for line, speed in zip(slip.lines, (2500.0, 2000.0), strict=True):
            x, values = line.get_data()
            np.testing.assert_allclose(values, np.maximum(10.0 - np.abs(1e3 * x) / speed, 0), atol=0.1)
        for line, data in zip(rate.lines, (one.interface, two.interface), strict=True):
            middle = int(np.argmin(np.hypot(data.position, data.dip - 10e3).values))
            np.testing.assert_allclose(line.get_data(), [data.time, data.slip_rate_1[:, middle]])
        assert (times.get_xlim(), times.get_ylim()) == ((-20.0, 20.0), (20.0, 0.0))
        assert (times.get_ylabel(), slip.get_xlabel()) == ("Down dip (km)", "x (km)")
        assert (slip.get_title(), rate.get_title()) == ("10 km down dip", "at 0, 10 km")


@pytest.mark.parametrize("logarithmic", [False, True])
def test_films_of_slip_rates_along_a_line(logarithmic: bool, tmp_path: Path) -> None:
    """Rates of every pixel until the time of the picture, in the unit of the label; later ones are empty."""
    time, position = synthetic.times(121), synthetic.points(20)
    field = synthetic.crack(time, position) * (1e-6 ** (position / position[-1]) if logarithmic else 1.0)
    with Record(synthetic.write_run(tmp_path / "run", field, time, position, snapshots=2)) as record:
        film = movies.film(record, "slip_rate")
        assert film.extent == pytest.approx((0, 100, 0, 60))
        assert (film.x_label[-4:], film.y_label[-4:]) == ("(mm)", "(µs)")
        unit, row = size(film.label), 80
        image = film.image(row)
        rows, columns = image.shape
        for down, across in ((rows // 2, columns // 4), (rows // 2, columns // 8), (rows // 4, columns // 20)):
            near = (
                np.argmin(np.abs(time - down / (rows - 1) * time[-1])),
                np.argmin(np.abs(position - across / (columns - 1) * position[-1])),
            )
            assert image[down, across] * unit == pytest.approx(field[near], rel=1e-9)
        assert np.isnan(image[round(rows * 82 / 121) :]).all() and np.isfinite(image).any()


def test_curves_of_a_friction_law() -> None:
    """Initial strength 0.3 sigma at 0.1 m/s, steady one sigma (f_0 + (a - b) ln(V / V_0)), a ln 10 at a step of ten."""
    a, b, f_0, V_0 = 0.01, 0.015, 0.6, 1e-6
    law = RateAndStateAgeing(a=a, b=b, D_c=1e-6, f_0=f_0, V_0=V_0)
    strength, carried, state = laws.draw(law).axes
    for sigma, initial, steady in zip((1.0, 3.0, 10.0), strength.lines[::2], strength.lines[1::2], strict=True):
        rates, values = initial.get_data()
        assert np.interp(-1.0, np.log10(rates), values) == pytest.approx(0.3 * sigma, rel=1e-4)
        rates, values = steady.get_data()
        fast = rates > 1e-6
        expected = sigma * (f_0 + (a - b) * np.log(rates / V_0))
        np.testing.assert_allclose(values[fast], expected[fast], rtol=1e-6)
        assert steady.get_label() == rf"$\sigma$ = {sigma:g} MPa"
    before = f_0 + (a - b) * np.log(0.1 / V_0)
    for line, of_state, factor in zip(carried.lines, state.lines, (10.0, 0.1), strict=True):
        assert line.get_label() == f"0.1 to {0.1 * factor:g} m/s"
        ends = [before + a * np.log(factor), before + (a - b) * np.log(factor)]
        assert line.get_ydata()[[0, -1]] == pytest.approx(ends, rel=2e-3)
        assert of_state.get_ydata()[[0, -1]] == pytest.approx([1.0, 1 / factor], rel=0.02)


def test_curves_of_a_cohesive_law() -> None:
    """Linear softening to 2 G / strength; works of straight paths are G_Ic cos a and G_IIc sin a."""
    law = Linear(f_t=2e6, c=5e6, G_Ic=10.0, G_IIc=100.0)
    opening, slip, works = laws.draw_cohesive(law).axes
    for ax, strength, energy in ((opening, 2e6, 10.0), (slip, 5e6, 100.0)):
        x = np.linspace(0, 1.2, 601) * 2 * energy / strength
        (line,) = ax.lines
        units = sizes_of(ax)
        np.testing.assert_allclose(line.get_xdata() * units[0], x, rtol=1e-9)
        exact = strength * np.maximum(1 - x * strength / (2 * energy), 0)
        np.testing.assert_allclose(line.get_ydata() * units[1], exact, atol=1e-9 * strength)
    angle, taken = np.radians(works.lines[0].get_xdata()), works.lines[0].get_ydata()
    np.testing.assert_allclose(taken, np.cos(angle) + np.sin(angle), rtol=1e-3)
    assert works.lines[0].get_label() == "at most 1.41" and works.lines[1].get_ydata()[0] == 1


@pytest.mark.fem
def test_cycles_of_a_material() -> None:
    """Elastic: 2 G times shear, lambda + 2 G times uniaxial strain; of E = 5 GPa and 0.25 both moduli are 2 GPa."""
    material = IsotropicElastic(young_modulus=5e9, poisson_ratio=0.25, density=1e3)
    for ax, modulus in zip(laws.draw_material(material).axes, (4e9, 6e9), strict=True):
        for line in ax.lines:
            strain = 1e-3 * line.get_xdata()
            assert [strain.min(), strain.max()] == pytest.approx([-1e-3, 1e-3], rel=1e-4)
            np.testing.assert_allclose(line.get_ydata() * sizes_of(ax)[1], modulus * strain, atol=1e-6 * 6e6)
