"""Contract of the figures: every file of `plots/`, found by its name, is right for every run that it suits."""

import inspect
import re

import numpy as np
import pytest
from helpers import synthetic
from helpers.labels import label_faults
from matplotlib import pyplot
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from ruptfx import RuptfxError
from ruptfx.input.schema import own_kinds
from ruptfx.results import plots
from ruptfx.results.plots import _sheet
from ruptfx.results.record import Record, RecordError

TIME, POSITION = synthetic.times(121), synthetic.points(40)
QUANTITY = r"[fpnµmckMGT]?(?:m|s|yr|g|N|Pa|J|W|K|Hz|rad)[²³]?"
# Numbers without a unit say what they count.
WORDS = "per fringe|coefficient|fraction|ratio|number|magnitude|strain"
UNIT = re.compile(rf"\(({QUANTITY}([/ ]{QUANTITY})*|%[^)]*|°C?)\)|{WORDS}", re.I)


def write(path, kind):
    """A run directory of a kind that figures have to cope with."""
    if kind in SURFACES:
        return synthetic.write_surface_run(
            path,
            structured=kind != "scattered surface",
            branch=kind == "two surfaces",
            slides=kind == "sliding surface",
        )
    crack = synthetic.crack(TIME, POSITION)
    if kind == "slow and fast":  # two ruptures of 60 us, loaded for 10 s each
        rest = np.full((20, len(POSITION)), 1e-9)
        steps = [(rest, 0.5), (crack, TIME[1]), (rest, 0.5), (crack, TIME[1]), (rest, 0.5)]
        time = np.cumsum(np.concatenate([np.full(len(field), step) for field, step in steps]))
        return synthetic.write_run(path, np.concatenate([field for field, _ in steps]), time, POSITION)
    if kind in SAVED:
        count = SAVED[kind]
        early = {"complete": False, "snapshots": count, "slides": True}
        return synthetic.write_run(path, crack[:count], TIME[:count], POSITION, **early)
    fields = {"train": np.maximum(synthetic.train(TIME, POSITION), 0), "at rest": 0 * crack}
    plane = "antiplane" if kind == "antiplane" else "stress"
    field = fields.get(kind, crack)
    written = synthetic.write_run(
        path, field, TIME, POSITION, plane=plane, slides=kind == "slides far", wet=kind == "wet"
    )
    if kind in BROKEN:
        synthetic.write_cracks(path, failed=BROKEN[kind])
    return written


SAVED = {"killed at once": 1, "killed early": 2}
SURFACES = ["surface", "scattered surface", "two surfaces", "sliding surface"]
BROKEN = {"broken": 2, "not broken": 0, "crushed": 120}
OWN = (
    {"wet": ("fluid_front",)}
    | dict.fromkeys(BROKEN, ("cracks", "emission"))
    | dict.fromkeys(SURFACES[1:3], ("moment_rate", "rupture_map", "slip_rate_maps"))
    | {"sliding surface": ("contact_maps", "forces")}
)
"""Runs that only some figures see as others than those before."""
SAME_BODIES, OF_BODIES = ("slow and fast", "at rest", "slides far"), ("energy_budget", "instruments", "fringes")
"""Runs whose bodies, energies and instruments are those of the first one, and figures of these."""
KINDS = ["train", "slow and fast", *SAVED, "at rest", "antiplane", "wet", "slides far", *BROKEN, *SURFACES]


@pytest.fixture(scope="module")
def records(tmp_path_factory):
    path = tmp_path_factory.mktemp("runs")
    found = {kind: Record(write(path / kind, kind)) for kind in KINDS}
    yield found
    for record in found.values():
        record.close()


def test_every_file_is_a_figure():
    assert set(plots.FIGURES) == set(own_kinds("ruptfx.results.plots"))
    assert all(getattr(plots, name) is draw and draw.__doc__ for name, draw in plots.FIGURES.items())


@pytest.mark.parametrize("most", [2, pytest.param(None, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", plots.FIGURES)
def test_figure(name, most, records):
    """Runs that it suits, the first ones and all; if none does, give `synthetic.write_run` the data that it needs."""
    fitting = [kind for kind, record in records.items() if plots.suits(name, record)]
    assert fitting
    for kind in fitting[:most]:
        if (kind in OWN and name not in OWN[kind]) or (name in OF_BODIES and kind in SAME_BODIES):
            continue  # the files that this figure reads are those of another run
        print(f"drawn of the run {kind!r}")  # shown where it fails
        check_figure(plots.FIGURES[name](records[kind]).figure)


def check_figure(figure):
    assert label_faults(figure) == []
    assert pyplot.get_fignums() == []  # belongs to no window, and is gone when nobody holds it
    shown = [ax for ax in figure.axes if ax.get_visible()]
    labels = [axis.get_label_text() for ax in shown for axis in (ax.xaxis, ax.yaxis)]
    # Inner panels share their labels, a colour bar has one.
    assert sum(map(bool, labels)) >= 2
    for label in filter(None, labels):
        assert UNIT.search(label), label
    for ax in shown:
        artists = (*ax.lines, *ax.collections, *ax.images, *ax.patches)
        drawn = [artist for artist in artists if np.size(values_of(artist))]
        assert drawn or any(text.get_text().strip() for text in ax.texts)  # a panel without data says why
        if ax.yaxis.label.get_rotation() == 90 and ax.get_ylabel() and ax.name != "polar":
            label = ax.yaxis.label.get_window_extent()
            assert label.height < 1.1 * ax.bbox.height, ax.get_ylabel()
    letters = [ax.get_title(loc="left") for ax in shown if ax.get_title(loc="left")]
    assert letters == [f"({chr(97 + i)})" for i in range(len(letters))]


def values_of(artist):
    """What an artist shows."""
    if isinstance(artist, Patch):
        return artist.get_path().vertices
    values = artist.get_xdata() if hasattr(artist, "get_xdata") else artist.get_array()
    return values if values is not None else artist.get_offsets()


SHARED = ("ax", "times", "at", "x", "field", "units")
EXAMPLES = {"times": (10e-6, 40e-6), "at": 30e-6, "x": (0.02, 0.08), "units": {"nothing": "m"}}


def arguments(name):
    return inspect.signature(plots.FIGURES[name]).parameters


def fitting(name, records):
    """Runs of a figure, that with the most records first."""
    found = [record for record in records.values() if plots.suits(name, record)]
    return sorted(found, key=lambda record: -record.interface.sizes["time"])


@pytest.mark.parametrize("name", plots.FIGURES)
def test_arguments_are_described_and_others_refused(name, records):
    """The docstring has every argument, and the message for another one names them all."""
    known, record = arguments(name), fitting(name, records)[0]
    for each in known:
        assert re.search(rf"^{each} : .+\n    \S", plots.FIGURES[name].__doc__, re.M), each
    assert _sheet.SHARED["field"][1] not in plots.FIGURES[name].__doc__  # each figure has its own
    for other in {*SHARED, "colour"} - set(known):
        with pytest.raises(RuptfxError, match=rf"plots\.{name}: it takes ax") as raised:
            plots.FIGURES[name](record, **{other: EXAMPLES.get(other)})
        assert all(each in str(raised.value) for each in list(known)[1:])


@pytest.mark.parametrize("name", plots.FIGURES)
def test_axes_of_the_user(name, records):
    """One panel is drawn into given axes and returned, without letters and footers; several are refused with a way out,
    which draws one of them."""
    draw, record = plots.FIGURES[name], fitting(name, records)[0]
    whole = draw(record)
    panels = [whole] if isinstance(whole, Axes) else list(whole.flat)
    assert all(isinstance(ax, Axes) and ax.get_visible() for ax in panels)
    figure = Figure()
    ax = figure.add_subplot()
    if len(panels) == 1:
        found = draw(record, ax)
    else:
        options = {}
        if "at" in arguments(name):
            options["at"] = 30e-6
        if "PANELS" in vars(plots._FILES[name]) or name in FIELD:
            with pytest.raises(RuptfxError, match=rf"plots\.{name}: \d+ .*\bax\b"):
                draw(record, ax)
            options["field"] = FIELD.get(name) or next(iter(plots._FILES[name].PANELS))
        found = draw(record, ax, **options)
    assert found is ax and ax.figure is figure and ax.has_data()
    assert not ax.get_title(loc="left") and not figure.get_supxlabel()
    assert plots.remarks(whole).split() == panels[0].figure.get_supxlabel().split()


FIELD = {"snapshots": "slip_rate", "slip_profiles": "slip", "instruments": "point.velocity_y"}


def test_figures_of_the_whole_run_suit_no_part(records):
    whole = [name for name in plots.FIGURES if "times" not in arguments(name)]
    assert whole == ["emission"]
    assert not any(plots.suits(name, record.between(1e-6)) for name in whole for record in records.values())


@pytest.mark.parametrize("name", [name for name in plots.FIGURES if "times" in arguments(name)])
def test_a_window_of_times_is_that_of_a_part_of_the_record(name, records):
    for record in fitting(name, records):
        saved = record.interface.time.values
        if len(saved) < 10:
            continue
        # Facets are saved at 1 and 2 us.
        window = 1.5e-6 if name == "cracks" else float(saved[len(saved) // 4]), float(saved[-1])
        with record.between(*window) as part:
            try:
                if not plots.suits(name, part):
                    continue
            except RecordError:  # no snapshot then
                continue
            here, there = (np.atleast_1d(axes).flat for axes in (plots.FIGURES[name](record, times=window),
                                                                 plots.FIGURES[name](part)))  # fmt: skip
            for one, other in zip(here, there, strict=True):
                assert (one.get_xlim(), one.get_ylim(), one.get_xlabel()) == (
                    other.get_xlim(), other.get_ylim(), other.get_xlabel())  # fmt: skip
        break
    else:
        pytest.fail("no run suits in part")
    with pytest.raises(RuptfxError, match=rf"plots\.{name}: times .*\bat; "):
        plots.FIGURES[name](record, times=[1e-6, 2e-6, 3e-6])


@pytest.mark.parametrize("name", [name for name in plots.FIGURES if "x" in arguments(name)])
def test_a_window_of_positions(name, records):
    """The axis of x ends where the window does, to an element; a window without points is refused or empty."""
    record = fitting(name, records)[0]
    data = record.interface.position.values
    low, high = (float(data.min() + share * np.ptp(data)) for share in (0.25, 0.75))
    cut = list(np.atleast_1d(plots.FIGURES[name](record, x=(low, high), units={"x": "m"})).flat)
    ends = [ax.get_xlim() for ax in cut if re.match(r"(x|Along strike)\b.*\(m\)", ax.get_xlabel())]
    ends += [ax.get_xlim() for ax in cut if ax.get_xlabel().startswith("Position")]
    assert ends and all(end == pytest.approx((low, high), abs=0.02 * np.ptp(data)) for end in ends)
    with pytest.raises(RuptfxError, match=rf"plots\.{name}: x .*\(0\.1,\)"):
        plots.FIGURES[name](record, x=(0.1,))
    with pytest.raises(RuptfxError, match=rf"plots\.{name}: x = \(0\.1, 0\): .*larger"):
        plots.FIGURES[name](record, x=(0.1, 0.0))


@pytest.mark.parametrize("name", plots.FIGURES)
def test_units_of_another_kind_are_refused(name, records):
    """The message for an unknown quantity names all of them with their units."""
    record = fitting(name, records)[0]
    with pytest.raises(RuptfxError, match="'nothing'") as raised:
        plots.FIGURES[name](record, units={"nothing": "m"})
    known = dict(re.findall(r"(\w+) \[([^\]]+)\]", str(raised.value)))
    assert known
    for quantity in known:
        with pytest.raises(RuptfxError, match=f"units of {quantity}: "):
            plots.FIGURES[name](record, units={quantity: "kg3"})


@pytest.mark.parametrize("name", [name for name in plots.FIGURES if "field" in arguments(name)])
def test_fields(name, records):
    """Every panel can be drawn alone; an unknown one is refused with what there is."""
    record = fitting(name, records)[0]
    with pytest.raises(RuptfxError, match=rf"plots\.{name}: field = 'nonsense': known: ") as raised:
        plots.FIGURES[name](record, field="nonsense")
    for field in str(raised.value).partition("known: ")[2].split(", "):
        axes = plots.FIGURES[name](record, field=field)
        assert np.atleast_1d(axes).flat[0].has_data(), field


def test_a_field_of_the_interface_is_drawn_with_its_values(records):
    """The slip of the record in millimetres, at the points of the window."""
    record = records["train"]
    axes = plots.space_time(record, field="slip", x=(0.02, 0.04), units={"slip": "mm"})
    inside = (record.interface.position.values >= 0.02 - 1e-12) & (record.interface.position.values <= 0.04 + 1e-12)
    (mesh,) = axes.collections
    np.testing.assert_allclose(mesh.get_array(), 1e3 * record.interface.slip.values[:, inside])
    assert axes.figure.axes[1].get_ylabel() == "Slip (mm)"
    (line, *_) = plots.snapshots(record, at=30e-6, field="normal_stress", units={"normal_stress": "kPa"}).lines
    np.testing.assert_allclose(line.get_ydata(), 6000.0)


def test_a_component_of_the_bodies_is_drawn_with_its_values(records):
    """At rest the wave of the synthetic run has not begun: the normal stress is -6 MPa, and colours are symmetric."""
    axes = plots.wavefield(records["train"], at=0.0, field="stress_yy", units={"field": "MPa"})
    (image,) = axes.images
    np.testing.assert_allclose(np.ma.compressed(image.get_array()), -6.0)
    assert image.get_clim() == pytest.approx((-6.0, 6.0))


@pytest.mark.parametrize("field", ["normal_stress", "slip_rate", "opening", "displacement_jump"])
def test_fields_of_an_interface_have_labels_shorter_than_their_panels(field, records):
    """Some descriptions of fields are sentences."""
    record = fitting("snapshots", records)[0]
    check_figure(plots.snapshots(record, field=field, at=[10e-6, 20e-6, 30e-6, 40e-6]).figure)


def test_maps_of_a_sliding_contact_state_its_real_area(records):
    """Points touch from -20 to 11.75 of 20 km, half an element beyond the last one: 0.79375 of 40 km x 20 km."""
    axes = plots.contact_maps(records["sliding surface"])
    assert "635 km²" in plots.remarks(axes) and "79.4 %" in plots.remarks(axes)
    states = axes[1].collections[0].get_array()
    assert np.bincount(np.ravel(states)).tolist() == [41 * 9, 0, 41 * 64, 41 * 8]


def test_states_of_points_in_any_order_are_at_their_places(records, monkeypatch):
    """Of 81 columns, the first and the last half as wide: 64 sliding, 9 open, 8 uncovered."""
    record = records["sliding surface"]
    shuffled = record.interface.isel(point=np.random.default_rng(1).permutation(record.interface.sizes["point"]))
    monkeypatch.setattr(type(record), "interface", property(lambda _: shuffled))
    axes = plots.contact_maps(record)
    states = np.asarray(axes[1].collections[0].get_array())
    assert states.shape == (300, 300) and np.all(states == states[0])
    share = np.bincount(states[0].astype(int), minlength=4) / 300
    np.testing.assert_allclose(share, [9 / 80, 0.0, 63.5 / 80, 7.5 / 80], atol=0.004)


@pytest.mark.parametrize("name", ["contact_maps", "rupture_map", "slip_rate_maps"])
def test_maps_of_bodies_that_slide_are_along_and_across_them(name, records):
    """Only maps of faults go down dip."""
    named = {ax.get_ylabel() for ax in np.ravel(plots.FIGURES[name](records["sliding surface"]))} - {""}
    assert named == {"Across (km)"}


@pytest.mark.parametrize(("window", "lines"), [(1e-12, 0), (1e9, 1)])
def test_the_force_of_every_record_is_explained_where_it_is_drawn(window, lines, records):
    """Grey is beside the mean only where both differ."""
    axes = plots.forces(records["sliding surface"], window=window)
    assert sum(line.get_color() == "#bbbbbb" for line in axes[0].lines) == lines
    assert ("Grey" in plots.remarks(axes)) == bool(lines)


def test_the_shear_force_of_a_surface_is_that_along_its_largest(records):
    """Components of 0.6 and 0.8 of 0.4 MN."""
    lines = plots.forces(records["sliding surface"])[0].lines
    shear = next(line for line in lines if line.get_label() == "shear force")
    assert np.max(shear.get_ydata()) == pytest.approx(0.4, rel=0.02)
