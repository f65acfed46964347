"""Figures of the lumped models: every curve and map has the numbers of the result, in the units on its axes."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
import xarray
from helpers.drawn import shows
from helpers.labels import crossed_labels
from matplotlib.axes import Axes

from ruptfx.case import parse_case
from ruptfx.input.schema import alternatives
from ruptfx.lumped import LumpedModel
from ruptfx.lumped.maxwell_slip import figures as maxwell
from ruptfx.lumped.spring_slider import _EXPERIMENTS
from ruptfx.lumped.spring_slider import figures as slider

MODELS = alternatives("ruptfx.lumped")


def image_of(ax: Axes, values: Any) -> None:
    (image,) = ax.images
    np.testing.assert_allclose(np.ma.filled(np.ma.asarray(image.get_array(), float), np.nan), values, rtol=1e-9)


@cache
def result(kind: str) -> xarray.Dataset:
    model = parse_case({"kind": kind, **tomllib.loads(MODELS[kind].example)})
    assert isinstance(model, LumpedModel)
    return model.run()


def made_up(**shapes: str) -> xarray.Dataset:
    """Random numbers along dimensions of five to nine entries; coordinates increase."""
    dims = sorted({dim for text in shapes.values() for dim in text.split()})
    lengths = {dim: 5 + number for number, dim in enumerate(dims)}
    random = np.random.default_rng(1)
    fields = {name: (tuple(text.split()), random.uniform(0.5, 1.5, [lengths[dim] for dim in text.split()]))
              for name, text in shapes.items()}  # fmt: skip
    return xarray.Dataset({name: (dims, np.sort(values) if dims == (name,) else values)
                           for name, (dims, values) in fields.items()})  # fmt: skip


# -- experiments of the spring slider, on made-up results --------------------------------------------------------------


def velocity_steps() -> None:
    data = made_up(drive_displacement="sample", friction="sample", slip_rate="sample", drive_speed="sample")
    top, bottom = slider.velocity_steps(data).axes
    x = data.drive_displacement
    shows(top, (x, data.friction))
    shows(bottom, (x, data.slip_rate), (x, data.drive_speed))


def slide_hold_slide() -> None:
    data = made_up(drive_displacement="hold sample", friction="hold sample", drive_speed="hold sample", hold="hold",
                   static_friction="hold", steady_friction="").assign_attrs(b=0.02)  # fmt: skip
    data["drive_speed"][:, 2:4] = 0.0
    left, right = slider.slide_hold_slide(data).axes
    shows(left, *((row.drive_displacement - row.drive_displacement[2], row.friction)
                  for row in (data.isel(hold=number) for number in range(data.sizes["hold"]))))  # fmt: skip
    last = data.isel(hold=-1)
    slope = last.static_friction + 0.02 * np.log(data.hold / last.hold)
    shows(right, (data.hold, data.static_friction), (data.hold, slope))
    assert right.lines[-1].get_ydata()[0] == float(data.steady_friction)


def modulated_speed() -> None:
    data = made_up(drive_speed="phase", friction="period phase", steady_friction="phase", period="period")
    data = xarray.concat([data] * 4, "phase", data_vars="minimal")  # arrows between points far apart
    order = np.argsort(data.drive_speed.values)
    (ax,) = slider.modulated_speed(data).axes
    loops = [(data.drive_speed, loop) for loop in data.friction.transpose("period", "phase")]
    shows(ax, *loops, (data.drive_speed[order], data.steady_friction[order]))
    ax.figure.draw_without_rendering()
    assert ax.get_legend().get_window_extent().x0 > ax.get_window_extent().x1  # beside the loops


def modulated_load() -> None:
    data = made_up(eps="eps", mean_change="eps", law="eps", first_harmonic="eps", second_harmonic="eps",
                   K_c_loaded="eps").assign_attrs(K_c=0.7)  # fmt: skip
    mean, harmonics, stiffness = slider.modulated_load(data).axes
    fine = np.linspace(0, float(data.eps[-1]), 100)
    shows(mean, (data.eps, data.mean_change), (fine, np.interp(fine, data.eps, data.law)))
    shows(harmonics, (data.eps, data.first_harmonic), (data.eps, data.second_harmonic))
    shows(stiffness, (data.eps, data.K_c_loaded / 0.7))


def stability() -> None:
    data = made_up(speed="speed", stiffness="stiffness", oscillates="stiffness speed", k_c_linear="speed",
                   k_c_simulated="speed")  # fmt: skip
    data["oscillates"] = data.oscillates > 1
    (ax,) = slider.stability(data).axes
    (grid,) = ax.collections
    np.testing.assert_array_equal(grid.get_array(), data.oscillates)
    shows(ax, (data.speed, 1e-4 * data.k_c_linear), (data.speed, 1e-4 * data.k_c_simulated))


def bifurcation() -> None:
    data = made_up(ratio="ratio", amplitude="ratio", drift="ratio", harmonic="ratio", wave_time="wave_time",
                   wave="ratio wave_time")  # fmt: skip
    data["drift"] = 0 * data.drift + np.array([0.0, 0.02, -0.02, 0.009, -0.009])
    left, right, second = slider.bifurcation(data).axes
    parts = [slice(None), [0, 3, 4], [1, 2]]  # all, settled, and still changing
    shows(left, *((data.ratio[rows], data.amplitude[rows]) for rows in parts))
    shows(second, (data.ratio, data.harmonic))
    step = 1.1 * float(data.amplitude.max())
    shows(right, *((data.wave_time, wave - wave.mean() - row * step) for row, wave in enumerate(data.wave)))


def stick_slip() -> None:
    """A line for each normal force and stiffness, of unequal numbers."""
    data = made_up(period="normal_force stiffness speed", force_drop="normal_force stiffness speed",
                   period_exponent="normal_force stiffness", speed="speed", normal_force="normal_force",
                   stiffness="stiffness").isel(normal_force=slice(2), stiffness=slice(3))  # fmt: skip
    left, right = slider.stick_slip(data).axes
    rows = [data.isel(normal_force=i, stiffness=j) for i in range(2) for j in range(3)]
    shows(left, *((row.speed, row.period) for row in rows))
    shows(right, *((row.speed, row.force_drop) for row in rows))
    numbers = [re.findall(r"[\d.]+", text.get_text()) for text in left.get_legend().get_texts()]
    for found, row in zip(numbers, rows, strict=True):
        expected = [float(row.normal_force), 1e-3 * float(row.stiffness), float(row.period_exponent)]
        assert [float(number) for number in found[:3]] == pytest.approx(expected, rel=1e-3)


def loading_unloading() -> None:
    """The whole curve until one and a half of the largest displacement of the loops."""
    data = made_up(whole_displacement="whole", whole_friction="whole", displacement="fraction sample",
                   friction="fraction sample", irreversible="fraction", fraction="fraction")  # fmt: skip
    data["whole_displacement"] = ("whole", np.linspace(0, 2 * float(data.displacement.max()), data.sizes["whole"]))
    left, right = slider.loading_unloading(data).axes
    kept = data.isel(whole=np.flatnonzero(data.whole_displacement <= 1.5 * data.displacement.max()))
    assert 2 < kept.sizes["whole"] < data.sizes["whole"]
    loops = [data.isel(fraction=number) for number in range(data.sizes["fraction"])]
    shows(left, (kept.whole_displacement, kept.whole_friction), *((loop.displacement, loop.friction) for loop in loops))
    shows(right, (data.fraction, data.irreversible))


def frequency_response() -> None:
    data = made_up(frequency="frequency", compliance="frequency", phase="frequency", resonance="", quality="")
    top, bottom = slider.frequency_response(data).axes
    shows(top, (data.frequency, data.compliance))
    shows(bottom, (data.frequency, np.degrees(data.phase)))
    assert top.lines[-1].get_xdata()[0] == float(data.resonance)
    assert top.get_title(loc="left") == f"{float(data.resonance):.4g} Hz, Q = {float(data.quality):.3g}"
    assert bottom.get_xlabel() == "Frequency (Hz)"


def temperatures() -> None:
    """A curve for each temperature over the contact time, their slopes, and all over the reduced time."""
    data = made_up(static_friction="temperature hold", reduced_time="temperature hold", ageing_slope="temperature",
                   temperature="temperature", hold="hold")  # fmt: skip
    left, middle, right = slider.temperatures(data).axes
    rows = [data.isel(temperature=number) for number in range(data.sizes["temperature"])]
    shows(left, *((data.hold, row.static_friction) for row in rows))
    shows(middle, (data.temperature, data.ageing_slope))
    shows(right, *((row.reduced_time, row.static_friction) for row in rows))
    labels = [text.get_text() for text in left.get_legend().get_texts()]
    assert labels == [f"{float(row.temperature):g} K" for row in rows]
    even = data.assign(ageing_slope=0 * data.ageing_slope + 0.025)
    assert slider.temperatures(even).axes[1].get_ylim()[1] > 0.026  # points apart from the frame


def fit() -> None:
    names = [name + end for name in ("a", "b", "D_c") for end in ("", "_low", "_high")]
    data = made_up(time="time", measured="time", fitted="time", **dict.fromkeys(names, "")).assign_attrs(confidence=0.9)
    top, bottom = slider.fit(data).axes
    shows(top, (data.time, data.measured), (data.time, data.fitted))
    shows(bottom, (data.time, data.fitted - data.measured))
    numbers = [float(text) for text in re.findall(r"-?[\d.]+(?:e[+-]\d+)?", top.get_title(loc="left"))]
    sizes = np.repeat([1.0, 1.0, 1e6], 3)
    assert numbers == pytest.approx([90, *(float(data[name]) * size for name, size in zip(names, sizes, strict=True))],
                                    rel=1e-3)  # fmt: skip


# -- other models, on the results of their examples --------------------------------------------------------------------


def asperity_population() -> None:
    data = result("asperity_population")
    steps, steady, ages, holds = MODELS["asperity_population"].figures(data)["population"].axes
    shows(steps, *((data.slip, data[name]) for name in ("friction", "ageing_law", "slip_law")))
    ends = np.append(np.flatnonzero(np.diff(data.slip_rate)), data.sizes["sample"] - 1)
    tenths = [slice(end - (end - begin) // 10, end + 1) for begin, end in zip([0, *(ends[:-1] + 1)], ends, strict=True)]
    late = [([data.slip_rate.values[end]], [data.friction.values[part].mean()])
            for end, part in zip(ends, tenths, strict=True)]  # fmt: skip
    points = [line for line in steady.lines if len(line.get_xdata()) == 1]
    for line, (x, y) in zip(points, late, strict=True):
        np.testing.assert_allclose([line.get_xdata()[0] * 1e-6, line.get_ydata()[0]], [x[0], y[0]])
    np.testing.assert_allclose(steady.lines[-1].get_data(), [data.speed * 1e6, data.steady_friction])
    shows(ages, *((data.slip, data[name]) for name in ("mean_age", "ageing_theta", "slip_theta")))
    shows(holds, *((data.hold, data[name]) for name in ("static_friction", "ageing_hold", "slip_hold")))


def burridge_knopoff() -> None:
    data = result("burridge_knopoff")
    figures = MODELS["burridge_knopoff"].figures(data)
    force, extents, _ = figures["events"].axes
    shows(force, (np.repeat(data.time, 2), data.force.values.ravel()))
    for segment, time, slip in zip(extents.collections[0].get_segments(), data.time, data.slip.values, strict=True):
        which = np.flatnonzero(slip > 0)
        np.testing.assert_allclose(segment, [[time, which[0]], [time, which[-1] + 1]])
    sizes, slips = figures["sizes"].axes
    seen = data["count"].values > 0
    (points, *_), (bars,) = sizes.lines, sizes.collections
    np.testing.assert_allclose(points.get_data(), [data.magnitude[seen], data["count"][seen]])
    for segment, count in zip(bars.get_segments(), data["count"].values[seen], strict=True):
        error = min(np.sqrt(count), 0.999 * count)
        np.testing.assert_allclose(segment[:, 1], [count - error, count + error])
    shows(slips, (data.blocks, data.moment))


def maxwell_slip() -> None:
    data = result("maxwell_slip")
    figures = MODELS["maxwell_slip"].figures(data)
    *axes, first, second = figures["friction_histories"].axes
    for ax, raster, row in zip(axes, (first, second), (data.isel(alpha=number) for number in range(2)), strict=True):
        shows(ax, (row.trace_time / data.slip_period, row.trace_friction))
        shows(raster, (row.slip_time / data.slip_period, row.slipped_block.where(row.slipped_block >= 0)))
        heights = [line.get_ydata()[0] for line in ax.lines[1:]]
        assert heights == [data.attrs["mu_s"], data.attrs["mu_d"]]
        assert ("stick-slip" in ax.get_title(loc="right")) == bool(row.stick_slip)
    (static,), (amplitude,) = figures["static_coefficient"].axes, figures["late_amplitude"].axes
    for ax, field, curves in ((static, "mu_static", ["limit_mu_static"]),
                              (amplitude, "late_amplitude", ["limit_amplitude", "law_amplitude"])):  # fmt: skip
        mean, spread = data[field].mean("realisation"), data[field].std("realisation")
        (bars,) = ax.collections
        for segment, x, middle, half in zip(bars.get_segments(), data.alpha, mean, spread, strict=True):
            np.testing.assert_allclose(segment, [[x, middle - half], [x, middle + half]])
        long = [line for line in ax.lines if len(line.get_xdata()) == data.sizes["alpha_fine"]]
        for line, name in zip(long, curves, strict=True):
            np.testing.assert_allclose(line.get_data(), [data.alpha_fine, data[name]])


def test_lines_of_the_transition_cross_no_labels() -> None:
    """With the curves of the model for the six shape parameters of the lecture."""
    fine, alpha = np.geomspace(0.5, 1e5, 60), np.array([1e5, 500.0, 50, 20, 10, 1])
    part = {"alpha_fine": fine, "alpha": alpha}
    curve = {name: 2 / np.pi * np.exp(-0.5 * np.pi**2 / (2 * values + 1)) for name, values in part.items()}
    fields = {
        "limit_amplitude": ("alpha_fine", curve["alpha_fine"]), "law_amplitude": ("alpha_fine", curve["alpha_fine"]),
        "limit_mu_static": ("alpha_fine", 0.225 + 0.1 * curve["alpha_fine"]), "alpha_c": 21.2,
        "late_amplitude": (("alpha", "realisation"), np.outer(curve["alpha"], [0.9, 1.1])),
        "mu_static": (("alpha", "realisation"), 0.225 + 0.1 * np.outer(curve["alpha"], [0.9, 1.1])),
    }  # fmt: skip
    attrs = {"mu_s": 0.3, "mu_d": 0.225, "threshold": 0.13, "blocks": 300}
    data = xarray.Dataset(fields, part, attrs)
    for draw in (maxwell.amplitude, maxwell.static):
        (ax,) = draw(data).axes
        assert len([text for text in ax.texts if "alpha_c" in text.get_text()]) == 1
        assert crossed_labels(ax) == []


def roughness_map() -> None:
    """Two surfaces in a band of R_a (2 alpha + 1)^(-1/2) times 1 to 2 um, critical from 0.3 to 0.4 um."""
    data = made_up(R_a="surface", alpha_low="surface", R_a_scale_min="").isel(surface=slice(2)) * 1e-6
    data = data.assign(R_a_scale_min=1e-6, R_a_scale_max=2e-6, R_a_crit_min=3e-7, R_a_crit_max=4e-7,
                       verdict_alpha_c=22.0, alpha_low=1e6 * data.alpha_low, alpha_high=3e6 * data.alpha_low,
                       verdict=("surface", ["steady", "stick-slip"]), surface=["A", "B"])  # fmt: skip
    (ax,) = maxwell.roughness_map(data).axes
    band, critical = ax.collections[0].get_paths()[0].vertices, ax.patches[0]
    alpha, height = band.T
    part = height * np.sqrt(2 * alpha + 1)
    assert [part.min(), part.max()] == pytest.approx([1.0, 2.0]) and np.all(np.isclose(part, 1) | np.isclose(part, 2))
    assert [critical.get_y(), critical.get_y() + critical.get_height()] == pytest.approx([0.3, 0.4])
    for line, point, row in zip(ax.lines[::2], ax.lines[1::2], range(2), strict=True):
        ends, R_a = [float(data[name][row]) for name in ("alpha_low", "alpha_high")], 1e6 * float(data.R_a[row])
        np.testing.assert_allclose(line.get_data(), [ends, [R_a, R_a]])
        np.testing.assert_allclose(point.get_data(), [[np.sqrt(ends[0] * ends[1])], [R_a]])
    assert [text.get_text() for text in ax.texts] == ["A: steady", "B: stick-slip"]


def spring_block() -> None:
    data = result("spring_block")
    figures = MODELS["spring_block"].figures(data)
    force, compression, detached, contact, *_ = figures["onset_of_sliding"].axes
    large = data.event_large.values.astype(bool)
    small = ~large & (data.event_drop.values > 0)
    shows(force, (data.time, data.force), *((data.event_start[some], data.event_force[some])
                                            for some in (large, small) if some.any()))  # fmt: skip
    image_of(compression, -data.elastic_force.values[:, :-1].T)
    image_of(detached, 100 * (1 - data.attached.values.T))
    image_of(contact, data.contact_force.values.T)
    assert compression.images[0].get_extent() == pytest.approx((0.0, data.time.values[-1], 0.5, 5.5))
    (moved,) = figures["displacements"].axes
    shows(moved, *((data.time, data.position.sel(block=block)) for block in (1, 3)))
    (lengths,) = figures["precursor_length"].axes
    places = data.event_force / data.attrs["strength"], data.event_reach / 6
    np.testing.assert_allclose(lengths.collections[0].get_offsets(), np.transpose(places))
    line = np.array([0, float(data.event_force.max())])
    np.testing.assert_allclose(lengths.lines[-1].get_data(),
                               [line / data.attrs["strength"], float(data.length_slope) * line / 6])  # fmt: skip
    front, speeds, _ = figures["fronts"].axes
    (wave,) = front.lines
    x, y = (1e-3 * wave.get_xdata(), wave.get_ydata())
    assert (y[1] - 0.5) / (x[1] - x[0]) == pytest.approx(float(data.chain_speed) * 5.5 / 6)
    window, start = np.linspace(-2e-3, 14e-3, 1200), data.event_start.values[-1]
    for block, row in enumerate(front.images[0].get_array()):
        mine = data.break_block.values == block
        late = data.break_time.values[mine][:, None], data.break_count.values[mine][:, None]
        seen = (late[0] <= start + window) & (late[0] > start + window - data.attrs["delay"])
        np.testing.assert_allclose(row, 100 * (late[1] * seen).sum(axis=0) / data.contacts.values[block], atol=1e-6)
    slow = (data.slow_front_last_block - data.slow_front_first_block) / (data.slow_front_end - data.slow_front_start)
    np.testing.assert_allclose(speeds.lines[0].get_xdata(), slow / data.chain_speed)


FIGURES: list[Callable[[], None]] = [
    velocity_steps,
    slide_hold_slide,
    modulated_speed,
    modulated_load,
    stability,
    bifurcation,
    stick_slip,
    loading_unloading,
    frequency_response,
    temperatures,
    fit,
    asperity_population,
    burridge_knopoff,
    maxwell_slip,
    roughness_map,
    spring_block,
]


def test_every_model_and_experiment_is_here() -> None:
    known = {*MODELS, *(each.name for each in _EXPERIMENTS), "roughness_map"} - {"spring_slider"}
    assert known == {each.__name__ for each in FIGURES}


@pytest.mark.parametrize("compare", FIGURES, ids=lambda each: each.__name__)
def test_values(compare: Callable[[], None]) -> None:
    compare()
