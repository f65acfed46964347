"""Statistics of emission against planted catalogues whose answers are known."""

from itertools import pairwise

import numpy as np
import pytest
from helpers.messages import facts

from ruptfx import RuptfxError
from ruptfx.results.analysis.emission import (
    Catalogue,
    b_against_completeness,
    b_value,
    clusters,
    energy_of,
    first_peak,
    fractal_dimension,
    magnitude,
    omori,
    read_catalogue,
    rose,
    tensile_share,
)
from ruptfx.results.catalogue_statistics import catalogue_statistics


def test_magnitude_of_energies():
    # (2/3)(-6 - 4.8) = -7.2; (2/3)(-4 - 4.8) = -5.8667; 10^(1.5 (-10) + 4.8) = 6.31e-11 J.
    assert magnitude(np.array([1e-6, 1e-4])) == pytest.approx([-7.2, -5.866667])
    assert energy_of(-10.0) == pytest.approx(6.30957e-11)
    assert magnitude(np.array([0.0, -1.0])).tolist() == [-np.inf, -np.inf]


@pytest.mark.parametrize(("b", "scatter"), [(0.93, 0.05), (1.14, 0.06), (1.6, 0.09)])
def test_b_value_of_planted_catalogues(b, scatter):
    # 1000 catalogues of 401 magnitudes above -10, exponential with mean log10(e) / b; the mean of the estimates has the
    # standard error scatter / 32 = 0.003. An estimator without its correction for rounding is off by -0.018 at b = 1.6.
    random = np.random.default_rng(1)
    found = [b_value(-10.05 + random.exponential(np.log10(np.e) / b, 401), -10.0) for _ in range(1000)]
    values, errors = np.array([[each.b, each.error] for each in found]).T
    assert values.mean() == pytest.approx(b, abs=0.01)
    assert values.std() == pytest.approx(scatter, rel=0.2)
    assert errors.mean() == pytest.approx(values.std(), rel=0.2)
    assert all(each.count == 401 for each in found)


def test_completeness_is_where_most_events_are():
    random = np.random.default_rng(2)
    complete = -8 + random.exponential(np.log10(np.e), 4000)
    seen = complete[(complete > -7.75) | (random.random(4000) < 0.3)]  # two of three small ones are missed
    estimate = b_value(seen)
    assert estimate.completeness == pytest.approx(-7.7, abs=0.11)
    assert estimate.b == pytest.approx(1.0, abs=3 * estimate.error)
    assert b_value(seen, -8.0).b < 0.8  # what the missing ones would do
    against = b_against_completeness(seen)
    assert against[0].completeness < estimate.completeness < against[-1].completeness
    assert all(a.count > b.count for a, b in pairwise(against))


def test_the_figure_tells_b_for_other_magnitudes_of_completeness():
    random = np.random.default_rng(2)
    energy = energy_of(-8 + random.exponential(np.log10(np.e), 400))
    catalogue = Catalogue(np.arange(400.0), random.random(400), random.random(400), energy)
    estimates = [each.b for each in b_against_completeness(catalogue.magnitude)]
    ax = catalogue_statistics(catalogue, b_value(catalogue.magnitude), None).axes[1]
    labels = [text.get_text() for text in ax.get_legend().get_texts()]
    assert f"{min(estimates):.2f} to {max(estimates):.2f} for other M_c" in labels
    assert min(estimates) + 0.05 < max(estimates) and not ax.child_axes


def test_no_b_value_of_too_few_or_equal_events():
    for magnitudes in (np.full(50, -7.0), -7 + np.arange(5) / 10, np.array([])):
        with pytest.raises(RuptfxError, match="b-value"):
            b_value(magnitudes)


def sierpinski(n, side, random):
    """Points of the gasket by the chaos game; dimension log 3 / log 2 = 1.585."""
    corners = side * np.array([[0.0, 0.0], [1.0, 0.0], [0.5, np.sqrt(3) / 2]])
    point, points = corners[0], []
    for corner in random.integers(0, 3, n + 50):
        point = (point + corners[corner]) / 2
        points.append(point)
    return np.array(points[50:]).T


@pytest.mark.parametrize(
    ("shape", "D", "within"), [("uniform", 1.92, 0.03), ("line", 0.97, 0.01), ("gasket", 1.57, 0.03)]
)
def test_fractal_dimension_of_known_sets(shape, D, within):
    # Less than 2, 1 and 1.585 as C(r) misses the neighbours beyond the edges; 1.6 to 18 mm in 54 x 108 mm.
    random, found = np.random.default_rng(3), []
    for _ in range(12):
        if shape == "uniform":
            x, y = 0.054 * random.random(400), 0.108 * random.random(400)
        elif shape == "line":
            x, y = 0.054 * random.random(400), np.zeros(400)
            x *= 2.0
        else:
            x, y = sierpinski(400, 0.1, random)
        found.append(fractal_dimension(x, y, 1.6e-3, 18e-3))
    values = np.array([each.D for each in found])
    assert values.mean() == pytest.approx(D, abs=within)
    assert np.mean([each.error for each in found]) == pytest.approx(values.std(ddof=1), rel=0.8)


def test_fractal_dimension_counts_pairs():
    # Twelve points 1 m apart on a line: 11 of 66 pairs are closer than 1.5 m, 21 closer than 2.5 m.
    points = np.arange(12.0)
    found = fractal_dimension(points, np.zeros(12), 1.5, 2.5)
    assert found.correlation[[0, -1]] == pytest.approx([11 / 66, 21 / 66])
    with pytest.raises(RuptfxError, match=facts(r"12 events are closer than 0\.1 m")):
        fractal_dimension(points, np.zeros(12), 0.1, 0.5)


@pytest.mark.parametrize("p", [0.8, 1.2])
def test_omori_exponent_of_planted_rates(p):
    # Times with the density (t + c)^-p on [0, 1 ms], by inversion of its integral; c = 10 us.
    random, c, end, found = np.random.default_rng(4), 1e-5, 1e-3, []
    for _ in range(40):
        u = random.random(400)
        times = (c ** (1 - p) + u * ((end + c) ** (1 - p) - c ** (1 - p))) ** (1 / (1 - p)) - c
        found.append(omori(times, end))
    values, errors = np.array([[each.p, each.error] for each in found]).T
    assert values.mean() == pytest.approx(p, abs=0.02)  # the mean of 40 has a standard error of 0.015
    assert values.std() <= 0.1
    assert np.median(errors) == pytest.approx(values.std(), rel=0.5)
    one = found[0]  # the rate counts the events
    t = np.linspace(0, end, 100001)
    assert np.trapezoid(one.rate(t), t) == pytest.approx(400, rel=1e-3)


def test_omori_refuses_what_does_not_rise():
    with pytest.raises(RuptfxError, match=facts(r"200 events .*\(t \+ c\)\^-p")):
        omori(np.sqrt(np.linspace(1e-6, 1.0, 200)))  # rarer and rarer towards the failure
    with pytest.raises(RuptfxError, match=facts("2 events")):
        omori(np.array([1.0, 2.0]))


def test_clusters_link_what_is_near_in_place_and_time():
    # 0-1-2 a chain, 3 near but late, 4 far away; linked within 1 mm and 1 us.
    catalogue = Catalogue(
        time=np.array([0.0, 0.5e-6, 1.2e-6, 9e-6, 9.5e-6]),
        x=np.array([0.0, 0.8e-3, 1.6e-3, 0.1e-3, 20e-3]),
        y=np.zeros(5),
        energy=np.array([1.0, 3.0, 2.0, 5.0, -1.0]),
    )
    found = clusters(catalogue, 1e-3, 1e3)
    assert found.label.tolist() == [0, 0, 0, 1, 2]
    assert found.count.tolist() == [3, 1, 1]
    assert found.events.energy.tolist() == [6.0, 5.0, 0.0]
    assert found.events.x.tolist() == [0.8e-3, 0.1e-3, 20e-3]  # of the largest
    assert found.events.time.tolist() == [0.0, 9e-6, 9.5e-6]
    assert len(catalogue.seismic()) == 4


def test_tensile_share_of_potencies():
    # Opening o and slip s on a facet inclined by a: (o n + s t) n, symmetric part.
    a, length = np.deg2rad(37.0), 2e-3
    n, t = np.array([-np.sin(a), np.cos(a)]), np.array([np.cos(a), np.sin(a)])
    for opening, slip in ((1.0, 0.0), (0.0, 1.0), (1.0, 2.0)):
        jump = opening * n + slip * t
        P = length * (np.outer(jump, n) + np.outer(n, jump)) / 2
        assert tensile_share(P[0, 0], P[1, 1], P[0, 1]) == pytest.approx(opening**2 / (opening**2 + slip**2))
    assert tensile_share(0.0, 0.0, 0.0) == 0.0


def test_first_peak_is_one_that_falls():
    rise = np.linspace(0, 100, 101)
    assert first_peak(rise) is None
    stress = np.concatenate([rise, 100 - np.linspace(1, 10, 10), np.linspace(90, 150, 61)])
    assert first_peak(stress) == pytest.approx(100, abs=2)
    ripple = np.concatenate([rise, 100 - np.linspace(0.2, 2, 10), np.linspace(98, 150, 53)])
    assert first_peak(ripple) is None  # fell by 2 %, not 3


def test_rose_weighs_by_length():
    limits, lengths = rose(np.array([5.0, 185.0, 95.0]), np.array([1.0, 2.0, 4.0]))
    assert limits[[0, 1, -1]].tolist() == [0.0, 10.0, 180.0]
    assert lengths[[0, 9]].tolist() == [3.0, 4.0] and lengths.sum() == 7.0


def test_catalogues_from_csv(tmp_path):
    path = tmp_path / "measured.csv"
    path.write_text("# sensor array\ntime, x, y, magnitude, channel\n2.0, 1, 2, -7.2, a\n1.0, 3, 4, -10, b\n")
    catalogue = read_catalogue(path)
    assert catalogue.time.tolist() == [1.0, 2.0] and catalogue.x.tolist() == [3.0, 1.0]
    assert catalogue.energy == pytest.approx([6.30957e-11, 1e-6])
    path.write_text("time,x,y\n1,2,3\n")
    with pytest.raises(RuptfxError, match=facts(r"measured\.csv: .*\bmagnitude\b.*\btime, x, y\b")):
        read_catalogue(path)
    path.write_text("time,x,y,energy\n1,2,3,4\n1,2,three,4\n")
    with pytest.raises(RuptfxError, match=facts(r"line 3 of .*'three' is not a finite number")):
        read_catalogue(path)
    with pytest.raises(RuptfxError, match=facts("none.csv: cannot be read")):
        read_catalogue(tmp_path / "none.csv")
