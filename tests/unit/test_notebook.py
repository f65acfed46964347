"""What a notebook shows and offers: cases, records, figures, completion, demos as notebooks."""

import base64
import io
import re
from pathlib import Path

import numpy as np
import pytest
from helpers import synthetic
from helpers.messages import facts_of
from helpers.small_cases import case, plates
from PIL import Image

from ruptfx import RuptfxError
from ruptfx.app.commands.demos import write_notebook
from ruptfx.case import Case, parse_case, read_case
from ruptfx.input.schema import CaseError
from ruptfx.laws.friction.coulomb import Coulomb
from ruptfx.lumped import simulate
from ruptfx.results import plots
from ruptfx.results.record import Record

DEMOS = Path(__file__).parents[2] / "demos"
SLIDER = """
kind = "spring_slider"
normal_force = 16.0
stiffness = 1e6
friction = { kind = "rate_and_state_ageing", a = 0.013, b = 0.026, D_c = 0.42e-6, f_0 = 0.36, V_0 = 1e-6 }
experiment = { kind = "velocity_steps" }
"""


def text_of(html: str) -> str:
    return re.sub(r"\s+", " ", re.sub("<[^>]*>", " ", html))


def test_a_case_shows_its_keys_with_units_and_what_is_only_default() -> None:
    html = case({"title": "a < b"})._repr_html_()
    text = text_of(html)
    for shown in ("a &lt; b", "duration 5e-06 s", "normal 6e+06 Pa", "faults.main", "materials.default"):
        assert shown in text
    given, default = (next(row for row in re.findall("<tr>.*?</tr>", html) if f">{key}<" in row)
                      for key in ("duration", "rupture_threshold"))  # fmt: skip
    assert "opacity" in default and "opacity" not in given
    assert 'title="Simulated time."' in given


def test_long_lists_are_cut() -> None:
    tall = {"kind": "table", "positions": np.linspace(0, 12e-3, 50), "values": np.full(50, 6e6)}
    assert "... 50 in all]" in case({"faults.main.initial_stress.normal": tall})._repr_html_()


def test_arrays_and_numbers_of_numpy_are_taken() -> None:
    x = np.array([0, 3e-3, 6e-3, 9e-3, 12e-3])
    with_arrays = plates({
        "faults.main.initial_stress.normal": {"kind": "table", "positions": x, "values": 6e6 + 0 * x},
        "duration": np.float32(0.5), "order": np.int64(3), "mesh.length": np.array(12e-3),
    })  # fmt: skip
    plain = plates({
        "faults.main.initial_stress.normal": {
            "kind": "table", "positions": [0.0, 3e-3, 6e-3, 9e-3, 12e-3], "values": [6e6] * 5,
        },
        "duration": 0.5, "order": 3, "mesh.length": 12e-3,
    })  # fmt: skip
    assert parse_case(with_arrays).hash == parse_case(plain).hash
    with pytest.raises(CaseError, match="order"):
        parse_case(plates({"order": np.float64(3.0)}))  # numbers stay numbers, not more


def test_changed_is_a_new_checked_case() -> None:
    before = case()
    hash_before = before.hash
    after = before.changed("duration", "7 us")
    assert (before.duration, after.duration) == (5e-6, 7e-6) and before.hash == hash_before
    assert after == case({"duration": 7e-6})
    slippery = before.changed("faults.main.friction", Coulomb(mu_d=0.25))
    assert slippery.hash == case({"faults.main.friction": {"kind": "coulomb", "mu_d": 0.25}}).hash
    edge = {"kind": "free", "edge": "upper.top"}
    assert before.changed("boundaries", [edge]).changed("boundaries.0.edge", "lower.bottom").boundaries[0].edge == (
        "lower.bottom"
    )
    for key, value, said in (("duration", -1.0, "duration = -1.0"), ("durations", 1.0, "did you mean 'duration'"),
                             ("mesh.length.x", 1.0, "does not lead to a value")):  # fmt: skip
        with pytest.raises(CaseError, match=facts_of(said)):
            before.changed(key, value)


def test_changed_keeps_plug_ins(tmp_path: Path) -> None:
    (tmp_path / "law.py").write_text(
        'from ruptfx.laws.friction import FrictionLaw\n\n\nclass Sticky(FrictionLaw):\n    """Sticky."""\n'
        "    mu: float\n\n    def strength(self, slip_rate, normal_stress, state):\n"
        "        return self.mu * normal_stress\n"
    )
    table = plates({"plugins": ["law.py"], "faults.main.friction": {"kind": "sticky", "mu": 0.5}})
    mine = parse_case(table, tmp_path)
    (tmp_path / "law.py").unlink()  # it goes on with what it has read
    assert mine.changed("faults.main.friction.mu", 0.6).faults["main"].friction.mu == 0.6


def test_lumped_models_change_too(tmp_path: Path) -> None:
    (tmp_path / "slider.toml").write_text(SLIDER)
    slider = read_case(tmp_path / "slider.toml")
    assert slider.changed("stiffness", 2e6).stiffness == 2e6
    assert "stiffness 1e+06" in text_of(slider._repr_html_())


def test_completion_offers_keys_and_own_methods_only() -> None:
    offered = dir(case())
    assert not {"copied", "hash_in", "loaded", "substituted", "choices"} & set(offered) and "changed" in offered
    assert {"duration", "mesh", "changed", "hash", "to_toml", "initial_tensor"} <= set(offered)
    assert not [name for name in offered if name.startswith(("model_f", "model_v", "__")) or name == "dict"]
    assert "strength" in dir(case().faults["main"].friction)


def test_a_record_shows_summary_and_small_pictures(tmp_path: Path) -> None:
    time, position = synthetic.times(31), synthetic.points(20)
    run = synthetic.write_run(tmp_path / "a<b", synthetic.crack(time, position), time, position)
    (run / "figures").mkdir()
    Image.new("RGB", (1400, 700), "red").save(run / "figures" / "space_time.png")
    (run / "figures" / "space_time.pdf").write_bytes(b"no picture for a page")
    with Record(run) as record:
        html = record._repr_html_()
    assert "a&lt;b (complete)" in html and "mode crack" in text_of(html)
    pictures = re.findall(r'src="data:image/png;base64,([^"]+)"', html)
    assert len(pictures) == 1
    with Image.open(io.BytesIO(base64.b64decode(pictures[0]))) as small:
        assert small.size == (560, 280)


def test_figures_are_pictures_without_pyplot(tmp_path: Path) -> None:
    time, position = synthetic.times(31), synthetic.points(20)
    with Record(synthetic.write_run(tmp_path / "run", synthetic.crack(time, position), time, position)) as record:
        for axes in (plots.space_time(record), plots.front(record)):
            figure = axes.figure
            for shown in (axes, figure):
                with Image.open(io.BytesIO(shown._repr_png_())) as picture:
                    assert picture.size == tuple(int(inches * figure.dpi) for inches in figure.get_size_inches())


def test_overwrite_replaces_a_run_and_nothing_else(tmp_path: Path) -> None:
    (tmp_path / "slider.toml").write_text(SLIDER)
    slider = read_case(tmp_path / "slider.toml")
    other = slider.changed("stiffness", 2e6)
    simulate(slider, tmp_path / "run")
    (tmp_path / "run" / "notes.txt").write_text("mine")
    (tmp_path / "run" / "figures" / "mine.pdf").write_text("mine")
    with pytest.raises(RuptfxError, match="run:"):
        simulate(other, tmp_path / "run")
    simulate(other, tmp_path / "run", overwrite=True)
    assert read_case(tmp_path / "run" / "case.toml").hash == other.hash
    assert [(tmp_path / "run" / name).read_text() for name in ("notes.txt", "figures/mine.pdf")] == ["mine", "mine"]
    assert not (tmp_path / "run" / ".new").exists()
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "case.toml").write_text("title = 'no run'")
    with pytest.raises(RuptfxError, match=r"mine: (?!.*--overwrite)"):
        simulate(other, tmp_path / "mine", overwrite=True)
    assert (tmp_path / "mine" / "case.toml").read_text() == "title = 'no run'"


@pytest.mark.fem
def test_overwrite_of_a_field_run_happens_when_the_case_is_known_to_run(tmp_path: Path) -> None:
    pytest.importorskip("dolfinx")
    from ruptfx import simulate

    first = Case(**plates({"duration": 1e-6}))
    simulate(first, tmp_path / "run", progress=False)
    with pytest.raises(RuptfxError, match=r"stepper\.time_step = 1 s:"):
        simulate(first.changed("stepper.time_step", 1.0), tmp_path / "run", progress=False, overwrite=True)
    with pytest.raises(RuptfxError, match=r"^resume\b.*overwrite"):
        simulate(first, tmp_path / "run", progress=False, overwrite=True, resume=True)
    second = first.changed("duration", 2e-6)
    record = simulate(second, tmp_path / "run", progress=False, overwrite=True)
    assert record.summary["case_hash"] == second.hash and record.interface.time[-1] == pytest.approx(2e-6, rel=0.1)


@pytest.mark.slow
def test_demos_are_notebooks_that_run(tmp_path: Path) -> None:
    pytest.importorskip("jupytext")
    nbclient, nbformat = pytest.importorskip("nbclient"), pytest.importorskip("nbformat")
    for name in ("spring_slider.py", "spring_slider.toml"):
        (tmp_path / name).write_bytes((DEMOS / name).read_bytes())
    path = write_notebook(tmp_path / "spring_slider.py")
    notebook = nbformat.read(path, as_version=4)
    assert [cell.cell_type for cell in notebook.cells[:3]] == ["code", "markdown", "code"]
    script = (DEMOS / "spring_slider.py").read_text()
    assert sum(cell.cell_type == "markdown" for cell in notebook.cells) == script.count("# %% [markdown]")
    notebook.cells = notebook.cells[:5]  # the first experiment, and the rest is the same kind of thing
    done = nbclient.NotebookClient(notebook, resources={"metadata": {"path": str(tmp_path)}}, timeout=60).execute()
    printed = "".join(output.get("text", "") for cell in done.cells for output in cell.get("outputs", []))
    assert "steady change per e-fold" in printed
