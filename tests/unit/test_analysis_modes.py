"""Sliding modes on slip-rate fields whose mode, speed, widths and counts are known by construction."""

import numpy as np
import pytest
from helpers import synthetic

from ruptfx import RuptfxError
from ruptfx.results.analysis import modes

TIME, POSITION = synthetic.times(), synthetic.points()
SPACING = np.diff(POSITION).max()  # 0.33 mm
DRIVEN = {"V_imp": synthetic.V_IMP, "c_R": synthetic.C_R, "c_s": synthetic.C_S, "c_p": synthetic.C_P}

FIELDS = {
    "crack": synthetic.crack,
    "pulse": synthetic.pulses,
    "train": synthetic.train,
    "mixed": synthetic.mixed,
    "arrested": synthetic.arrested,
    "none": lambda time, position: np.zeros((len(time), len(position))),
}


def classify(field, **options):
    return modes.classify(field, TIME, POSITION, **{**DRIVEN, **options})


@pytest.mark.parametrize("name", FIELDS)
@pytest.mark.parametrize("seed", [None, 0, 1])
def test_mode(name, seed):
    """With noise: 10 % of the rate where it slides, and a quarter of the threshold (0.01 m/s) everywhere."""
    field = np.maximum(FIELDS[name](TIME, POSITION), 0)
    if seed is not None:
        rng = np.random.default_rng(seed)
        field = field * rng.normal(1, 0.1, field.shape) + rng.normal(0, 0.005, field.shape)
    found = classify(field)
    assert found.mode == name
    assert found.mode_at_half_threshold == name
    assert found.confidence > 0.9
    if name != "none":
        # All fields run at 2100 m/s. The fit's standard error is below 1 m/s without noise, 3 m/s with it.
        assert found.tip_speed.value == pytest.approx(2100, abs=5)
        assert found.regime == "supershear"


def test_without_an_impact_points_count_from_the_threshold_of_the_case_on():
    """A crack in nanometres per second: the threshold is 2 % of the median of the largest rates above `quiet`."""
    field = 1e-9 * np.maximum(synthetic.crack(TIME, POSITION), 0)
    speeds = {name: value for name, value in DRIVEN.items() if name != "V_imp"}
    assert modes.classify(field, TIME, POSITION, **speeds).mode == "none"
    found = modes.classify(field, TIME, POSITION, quiet=1e-12, **speeds)
    assert found.mode == "crack" and found.threshold == pytest.approx(0.02 * np.median(field.max(axis=0)), rel=0.02)


@pytest.mark.parametrize("turn", [1, -1])
@pytest.mark.parametrize("rounding", [-1e-12, 0.0, 1e-12])
def test_of_two_sides_that_slide_as_far_the_one_with_more_slip_counts(turn: int, rounding: float) -> None:
    """A crack on one side, a pulse on the other, all of both slide; the crack slips more, whichever way x is."""
    half = len(POSITION) // 2
    right, middle = np.arange(half, 2 * half + 1), POSITION[half]
    field = np.zeros((len(TIME), 2 * half + 1))
    away = POSITION[right] - middle
    field[:, right] = np.maximum(synthetic.crack(TIME, away), 0)
    field[:, half::-1] = np.maximum(synthetic.pulses(TIME, away), 0)
    # A point of the pulse whose largest rate is the threshold, but for rounding.
    column = half - 40
    field[:, column] *= 0.02 * synthetic.V_IMP * (1 + rounding) / field[:, column].max()
    position = POSITION[: 2 * half + 1] - middle
    result = modes.classify(field[:, ::turn], TIME, turn * position[::turn], loaded_end=0.0, **DRIVEN)
    assert result.mode == "crack"


@pytest.mark.parametrize("name", ["crack", "pulse", "train"])
def test_positions_on_a_map_change_nothing(name):
    """Positions that begin at 500 km have an error of 6e-11 m; a fifth of the way of the tip ends at a point."""
    field = np.maximum(FIELDS[name](TIME, POSITION), 0)
    here, there = classify(field), modes.classify(field, TIME, POSITION + 5e5, loaded_end=POSITION[0] + 5e5, **DRIVEN)
    assert (there.mode, there.tip_speed.points) == (name, here.tip_speed.points)
    assert there.tip_speed.value == pytest.approx(here.tip_speed.value, rel=1e-6)


def test_sparse_spikes_change_nothing():
    """One sample in a thousand of a train is replaced by a large one."""
    rng = np.random.default_rng(3)
    field = np.maximum(synthetic.train(TIME, POSITION), 0)
    field[rng.random(field.shape) < 1e-3] = 50.0
    found = classify(field)
    assert found.mode == "train" and found.tip_speed.value == pytest.approx(2100, rel=5e-3)


@pytest.mark.parametrize(
    ("zones", "mode"),
    [
        ([(0.05, 1.0)], "crack"), ([(0.0, 0.5), (0.53, 1.0)], "crack"),  # f = 0.95 and 0.97
        ([(0.15, 1.0)], "mixed"),  # f = 0.85 < 0.9
        ([(0.0, 0.33), (0.35, 0.65), (0.67, 1.0)], "mixed"),  # r = 3 > 2
        ([(0.65, 1.0)], "pulse"), ([(0.4, 0.5), (0.65, 0.75), (0.9, 1.0)], "pulse"),  # f = 0.35 and 0.3, r up to 3
        ([(0.5, 1.0)], "mixed"),  # f = 0.5 > 0.4
        ([(0.1, 0.3), (0.4, 0.6), (0.8, 1.0)], "mixed"),  # f = 0.6, r = 3 < 4
        ([(0.1, 0.25), (0.35, 0.5), (0.6, 0.75), (0.85, 1.0)], "train"),  # r = 4
    ],
)  # fmt: skip
def test_limits_between_the_modes(zones, mode):
    """Zones at fixed parts of the tip's way: f and r are the same at all times, on either side of each limit."""
    part = POSITION / np.maximum(2100.0 * (TIME[:, None] - 5e-6), 1e-9)
    found = classify(2.0 * np.any([(part > start) & (part < stop) for start, stop in zones], axis=0))
    assert found.mode == mode and found.zones == len(zones)
    # At most a spacing is missed at each end of a zone, of a way of 59 mm and more.
    assert found.sliding_fraction == pytest.approx(sum(b - a for a, b in zones), abs=len(zones) * SPACING / 0.059)


def test_degrees_are_one_where_the_mode_is_there():
    for name in ("crack", "pulse", "train"):
        assert classify(np.maximum(FIELDS[name](TIME, POSITION), 0)).degrees[name] == pytest.approx(1, abs=2e-3)
    # Two pulses of 5.94 mm until the tip is at 55 mm, then a crack. The first half of the way is from 20 to 59 mm; to
    # 29.7 mm f = 11.9 mm / tip is above 0.4. The mean of min(1, (1 - f) / 0.6), 0 after 55 mm, is 0.862.
    expected = np.sqrt(0.862)
    assert classify(synthetic.mixed(TIME, POSITION)).degrees["pulses_into_crack"] == pytest.approx(expected, abs=0.005)
    assert classify(np.zeros((len(TIME), len(POSITION)))).degrees == dict.fromkeys(modes.DEGREES, 0.0)


def test_degrees_of_zones_that_are_no_mode():
    """f = 0.6 and r = 3 all the time: 0.6/0.9 x 2/3 of a crack, 0.4/0.6 of a pulse, 2/3 of a train."""
    part = POSITION / np.maximum(2100.0 * (TIME[:, None] - 5e-6), 1e-9)
    zones = [(0.1, 0.3), (0.4, 0.6), (0.8, 1.0)]
    degrees = classify(2.0 * np.any([(part > start) & (part < stop) for start, stop in zones], axis=0)).degrees
    expected = {"crack": 4 / 9, "pulse": 2 / 3, "train": 2 / 3, "pulses_into_crack": np.sqrt(2 / 3 * 4 / 9)}
    assert degrees == pytest.approx(expected, abs=0.02)


def test_a_tip_that_stopped_early_lowers_all_degrees():
    # It stops at 5 us + 40 mm / (2100 m/s) = 24 us: a third of the 55 us since sliding began, of four fifths.
    degree = classify(np.maximum(synthetic.arrested(TIME, POSITION, stop=0.04), 0)).degrees["pulse"]
    assert degree == pytest.approx(0.04 / 2100 / (0.8 * 55e-6), rel=0.03)


def test_tip_speed_leaves_out_the_start_and_the_end():
    # Fitted from 20 to 98 % of the way of 100 mm.
    speed = classify(synthetic.crack(TIME, POSITION)).tip_speed
    assert speed.start == pytest.approx(0.02, abs=SPACING) and speed.stop == pytest.approx(0.098, abs=SPACING)


def test_crack_slides_everywhere_behind_the_tip():
    found = classify(synthetic.crack(TIME, POSITION))
    # The crack slides from the loaded end to where its 1 mm ramp passes the threshold: f = 1, r = 1.
    assert found.sliding_fraction == pytest.approx(1, abs=2e-3) and found.zones == 1
    assert found.reach == pytest.approx(0.1) and found.pattern == "crack"
    assert np.isnan(found.pulse_width) and np.isnan(found.healing_time)


@pytest.mark.parametrize("width", [4e-3, 8e-3])
def test_pulse_width_and_healing_time(width):
    found = classify(np.maximum(synthetic.pulses(TIME, POSITION, width=width), 0))
    # 1 - (2 s / w)^2 = 0.04 / 2 gives the width at threshold: w sqrt(0.98) = 0.98995 w.
    expected = 0.98995 * width
    assert found.pulse_width == pytest.approx(expected, abs=SPACING / 2)
    # It passes a point in width / speed.
    assert found.healing_time == pytest.approx(expected / 2100, abs=np.diff(TIME)[0] / 2)
    # At the middle of the second half of the way (from 59 to 98 % of 100 mm) f = 0.98995 w / 78.5 mm.
    assert found.sliding_fraction == pytest.approx(expected / 0.0785, rel=0.05)
    assert found.zones == 1 and len(found.trailing_speeds) == 0


def test_train_count_spacing_and_scatter():
    found = classify(synthetic.train(TIME, POSITION, count=6, spacing=12e-3))
    # The sixth pulse leaves the end at 5 + 5 x 12 / 2.1 = 33.6 us, when the tip is at 60 mm: six in the
    # second half.
    assert found.zones == 6
    assert found.pulse_spacing == pytest.approx(12e-3, rel=0.01)
    assert found.pulse_spacing_scatter < 0.05
    np.testing.assert_allclose(found.trailing_speeds, [2100] * 5, rtol=2e-3)


def test_scatter_of_irregular_spacing():
    # Gaps of 8, 16, 8 and 16 mm: mean 12 mm, standard deviation 4 mm, ratio 1/3.
    lags = tuple(np.cumsum([0, 8e-3, 16e-3, 8e-3, 16e-3]) / 2100)
    found = classify(synthetic.pulses(TIME, POSITION, lags, width=4e-3))
    assert found.mode == "train"
    assert found.pulse_spacing_scatter == pytest.approx(1 / 3, abs=0.04)


def test_trailing_pulse_faster_than_the_longitudinal_wave():
    # The second pulse starts 14 us late and runs at 2800 m/s: it is still 14 us - 0.1 (1/2100 - 1/2800) = 2
    # us behind at 100 mm.
    field = synthetic.pulses(TIME, POSITION, (0.0, 14e-6), speed=(2100.0, 2800.0), width=3e-3)
    found = classify(field)
    assert found.tip_speed.value == pytest.approx(2100, rel=2e-3)
    np.testing.assert_allclose(found.trailing_speeds, [2800], rtol=5e-3)


def test_arrested_run_keeps_its_pattern():
    found = classify(synthetic.arrested(TIME, POSITION, stop=0.04))
    assert found.pattern == "pulse"
    assert found.reach == pytest.approx(0.04, abs=SPACING)


def test_front_still_running_at_the_end_is_not_arrested():
    # At 60 us a crack at 1000 m/s is at 55 mm of 100 mm, still going.
    found = classify(synthetic.crack(TIME, POSITION, speed=1000.0))
    assert found.mode == "crack" and found.reach == pytest.approx(0.055, abs=2 * SPACING)
    assert found.regime == "sub-Rayleigh"


def test_loaded_at_the_right_end():
    field = synthetic.train(TIME, POSITION)[:, ::-1]
    mirrored = classify(field, loaded_end=POSITION[-1])
    straight = classify(synthetic.train(TIME, POSITION))
    # Equal cells of symmetric points are their own mirror image.
    assert mirrored.tip_speed.value == pytest.approx(straight.tip_speed.value, rel=1e-4)
    assert (mirrored.mode, mirrored.zones) == (straight.mode, straight.zones)


def test_nucleation_inside_takes_the_longer_side():
    # A crack from 30 mm runs to both sides: 70 mm to the right, 30 mm to the left.
    field = synthetic.crack(TIME, np.abs(POSITION - 0.03))
    found = classify(field, loaded_end=0.03)
    assert found.mode == "crack" and found.interface_length == pytest.approx(0.07, abs=SPACING)


def test_without_a_driven_boundary_the_peak_sets_the_threshold():
    # Median peak rate of a crack at 2 m/s is 2 m/s: the threshold is 0.04 m/s.
    found = classify(synthetic.crack(TIME, POSITION), V_imp=None)
    assert found.threshold == pytest.approx(0.04) and found.mode == "crack"
    assert classify(np.full((len(TIME), len(POSITION)), 1e-9), V_imp=None).mode == "none"


def test_zone_ends_lie_between_points():
    # Between 0 and 3 the threshold 1 is passed half-way; between 4 and 1/2 at 1/3 of the logarithm from
    # below, that is 2/3 of the way out. The second zone touches the end of the interface.
    zones = modes.find_zones(np.array([[0.0, 3.0, 4.0, 0.5], [0.0, 0.0, 0.0, 2.0]]), np.arange(4.0), 1.0)
    np.testing.assert_allclose(zones.start, [0.5, 2.5])
    np.testing.assert_allclose(zones.stop, [2 + 2 / 3, 3.0])
    np.testing.assert_array_equal(zones.row, [0, 1])
    np.testing.assert_array_equal(zones.points, [2, 1])


@pytest.mark.parametrize(
    ("speed", "name"),
    # c_R 1155, c_s 1255, c_p 2200; 2 % above c_p is still within the error of a fit.
    [(1100, "sub-Rayleigh"), (1200, "sub-shear"), (2000, "supershear"), (2230, "supershear"), (2300, "not resolved")],
)
def test_regime(speed, name):
    assert modes.regime(speed, 1155.0, 1255.0, 2200.0) == name
    assert modes.regime(1100, 1255.0, 1255.0, 1255.0) == "sub-shear"


def test_median_of_three():
    np.testing.assert_array_equal(modes.median3(np.array([5.0, 1.0, 9.0, 2.0])), [5.0, 5.0, 2.0, 2.0])


@pytest.mark.parametrize("count", [1, 2])
def test_few_saved_times(count):
    """A run killed early: an answer, no exception."""
    saved = slice(100, 100 + count)
    found = modes.classify(synthetic.crack(TIME, POSITION)[saved], TIME[saved], POSITION, **DRIVEN)
    assert found.mode == "crack"
    # All points seem to start at once or half a saved time apart: no speed can be told.
    assert np.isnan(found.tip_speed.value)


def test_shapes_are_checked():
    with pytest.raises(RuptfxError, match=r"slip_rate\b.*\(3,\s4\)"):
        modes.classify(np.zeros((3, 4)), TIME, POSITION)
    with pytest.raises(RuptfxError, match=r"^modes:\stime\b"):
        modes.classify(np.zeros((len(TIME), len(POSITION))), TIME[::-1], POSITION)
