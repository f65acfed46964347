"""Contract of the figures: every file of `plots/`, found by its name, is right for every run that it suits."""

import re

import numpy as np
import pytest
import synthetic
from labels import label_faults
from matplotlib import pyplot
from matplotlib.patches import Patch

from ruptfx import plots
from ruptfx.record import Record
from ruptfx.schema import own_kinds

TIME, POSITION = synthetic.times(121), synthetic.points(40)
QUANTITY = r"[fpnµmckMGT]?(?:m|s|yr|g|N|Pa|J|W|K|Hz|rad)[²³]?"
# Numbers without a unit say what they count.
WORDS = "per fringe|coefficient|fraction|ratio|number|magnitude"
UNIT = re.compile(rf"\(({QUANTITY}([/ ]{QUANTITY})*|%[^)]*|°C?)\)|{WORDS}", re.I)


def write(path, kind):
    """A run directory of a kind that figures have to cope with."""
    if kind in SURFACES:
        return synthetic.write_surface_run(path, structured=SURFACES[kind])
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
    written = synthetic.write_run(path, field, TIME, POSITION, plane=plane, slides=kind == "slides far")
    if kind in BROKEN:
        synthetic.write_cracks(path, failed=BROKEN[kind])
    return written


SAVED = {"killed at once": 1, "killed early": 2}
SURFACES = {"surface": True, "scattered surface": False}
BROKEN = {"broken": 2, "not broken": 0, "crushed": 120}
KINDS = ["train", "slow and fast", *SAVED, "at rest", "antiplane", "slides far", *BROKEN, *SURFACES]


@pytest.fixture(scope="module")
def records(tmp_path_factory):
    path = tmp_path_factory.mktemp("runs")
    found = {kind: Record(write(path / kind, kind)) for kind in KINDS}
    yield found
    for record in found.values():
        record.close()


def test_every_file_is_a_figure():
    assert set(plots.FIGURES) == set(own_kinds("ruptfx.plots"))
    assert all(getattr(plots, name) is draw and draw.__doc__ for name, draw in plots.FIGURES.items())


@pytest.mark.parametrize("name", plots.FIGURES)
def test_figure(name, records):
    """Every run that it suits; if none does, give `synthetic.write_run` the data that it needs."""
    fitting = [kind for kind, record in records.items() if plots.suits(name, record)]
    assert fitting
    for kind in fitting:
        print(f"drawn of the run {kind!r}")  # shown where it fails
        check_figure(plots.FIGURES[name](records[kind]))


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


@pytest.mark.parametrize("name", plots.FIGURES)
def test_record_is_left_as_it_was(name, records):
    path = next(record.path for record in records.values() if plots.suits(name, record))
    with Record(path) as drawn, Record(path) as untouched:
        plots.FIGURES[name](drawn)
        for key in untouched.interface:
            np.testing.assert_array_equal(drawn.interface[key], untouched.interface[key], err_msg=key)
