"""Draw the pictures of the site: `make pictures`, or `python docs/make_pictures.py [NAME ...] [--runs DIRECTORY]`.

Pictures of `FIGURES` are figures of demos, which are run where `--runs` has no finished run of that name; those of
`COMMANDS` are left by scripts, benchmarks and studies; others are drawn here. All of them take some hours. Pictures
are not quantised. `docs/pictures/numbers.json` keeps the numbers of the runs behind the
pictures: tests compare captions with them.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from PIL import Image, ImageSequence

from ruptfx import Record, read_case, simulate
from ruptfx.case import parse_case, read_toml
from ruptfx.results import plots
from ruptfx.results.analysis.along_interface import body_stress
from ruptfx.results.analysis.asperities import first_slip
from ruptfx.results.analysis.modes import classify
from ruptfx.results.figure_style import RATE_MAP, letter, new_figure, save, styled

PICTURES = Path(__file__).with_name("pictures")
DEMOS = Path(__file__).parents[1] / "demos"
V_IMP, TIP = 2.0, 2100.0  # m/s
RESOLUTION = 200  # pixels per inch
BLUE, ORANGE = "#1769aa", "#c8501e"


# -- sliding modes: made slip rates, classified as those of a run are -------------------------------------------------


def pulses(time: np.ndarray, position: np.ndarray, count: int) -> np.ndarray:
    """Parabolic pulses that follow each other."""
    spacing, width = 12e-3, 6e-3
    field = np.zeros((len(time), len(position)))
    for number in range(count):
        centre = TIP * (time[:, None] - 5e-6) - number * spacing - width / 2
        field = np.maximum(field, 2 * (1 - ((position - centre) / (width / 2)) ** 2))
    return field


def crack(time: np.ndarray, position: np.ndarray) -> np.ndarray:
    """All that lies behind the tip slides."""
    return 2 * np.clip((TIP * (time[:, None] - 5e-6) - position) / 1e-3, 0, 1)


@styled
def modes() -> Figure:
    """One made field for each mode, with the word that the classification finds."""
    time, position = np.linspace(0, 60e-6, 301), np.linspace(0, 0.1, 401)
    later = (time > 5e-6 + 0.055 / TIP)[:, None]
    one = pulses(time, position, 1)
    fields = {
        "crack": crack(time, position),
        "pulse": one,
        "train": pulses(time, position, 6),
        "mixed": np.where(later, crack(time, position), pulses(time, position, 2)),
        "arrested": one * (position < 0.04),
    }
    figure = Figure(figsize=(7.0, 1.9), layout="constrained")
    for axes, (name, field) in zip(figure.subplots(1, len(fields), sharey=True), fields.items(), strict=True):
        found = classify(field, time, position, loaded_end=0.0, V_imp=V_IMP, c_R=1155.0, c_s=1255.0, c_p=2200.0).mode
        assert found == name, f"{name} is classified as {found}"
        axes.pcolormesh(position * 1e3, time * 1e6, field, cmap=RATE_MAP, rasterized=True)
        axes.set(title=name, xlabel="Position (mm)")
    figure.axes[0].set_ylabel("Time (µs)")
    return figure


# -- signs ------------------------------------------------------------------------------------------------------------


def arrow(axes: Axes, start: tuple[float, float], end: tuple[float, float], colour: str) -> None:
    """Draw an arrow in data coordinates."""
    axes.annotate("", end, start, arrowprops={"arrowstyle": "-|>", "color": colour, "linewidth": 1.6})


@styled
def signs() -> Figure:
    """Bodies, normal, tangent, slip and the stresses that count as positive."""
    figure = Figure(figsize=(7.0, 3.3), layout="constrained")
    axes = figure.add_subplot()
    axes.add_patch(Rectangle((0, 0), 10, 2, facecolor="#dfe9f2", edgecolor="black"))
    axes.add_patch(Rectangle((0, -2), 10, 2, facecolor="#f3e6dd", edgecolor="black"))
    axes.plot([0, 10], [0, 0], color="black", linewidth=2.2)
    axes.text(0.3, 1.6, "upper: plus body")
    axes.text(0.3, -1.8, "lower: minus body")
    arrow(axes, (2, 0), (2, 1.2), BLUE)
    axes.text(2.1, 1.0, "normal n, from minus to plus", color=BLUE)
    arrow(axes, (2, 0), (3.4, 0), BLUE)
    axes.text(2.5, -0.45, "tangent t", color=BLUE)
    arrow(axes, (6.3, 0.35), (7.9, 0.35), ORANGE)
    arrow(axes, (7.9, -0.35), (6.3, -0.35), ORANGE)
    axes.text(5.3, 0.6, "positive slip: $u^+ - u^- > 0$ along t", color=ORANGE)
    axes.text(5.3, -0.95, "a positive shear traction resists it", color=ORANGE)
    for x in (4.5, 5.1):
        arrow(axes, (x, 2.8), (x, 2.05), "black")
        arrow(axes, (x, -2.8), (x, -2.05), "black")
    axes.text(5.4, 2.4, "positive normal stress of an interface: compression")
    axes.text(5.4, -2.6, "(stresses of bodies: positive in tension)")
    axes.plot([0], [0], "o", color="black", markersize=4)
    arrow(axes, (0, -2.35), (3.0, -2.35), "black")
    axes.text(0.0, -2.75, "position along the interface: x")
    axes.set(xlim=(-0.3, 11.2), ylim=(-3.0, 3.0), aspect="equal")
    axes.axis("off")
    return figure


# -- damping ----------------------------------------------------------------------------------------------------------


@styled
def damping() -> Figure:
    """Slip rate behind the front of `demos/slip_weakening.toml` with less and less damping."""
    figure = Figure(figsize=(7.0, 2.4), layout="constrained")
    panels = figure.subplots(1, 3, sharey=True)
    chosen = (("damping={}", "no damping"), ("damping.kelvin_voigt.fraction=0.1", "fraction = 0.1"),
              ("damping.kelvin_voigt.fraction=0.2", "fraction = 0.2"))  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        for number, (axes, (override, title)) in enumerate(zip(panels, chosen, strict=True)):
            given = ["output.figures=false", "duration=6.0", override]
            record = simulate(read_case(DEMOS / "slip_weakening.toml", overrides=given), out=Path(folder, str(number)))
            rates = record.interface.slip_rate.sel(time=5.5, method="nearest")
            axes.plot(rates.position / 1e3, rates, linewidth=0.7)
            axes.set(title=title, xlabel="Position (km)", xlim=(0, 20))
    panels[0].set_ylabel("Slip rate at 5.5 s (m/s)")
    return figure


def smooth_stress() -> Figure:
    """Stress before and after a patch fails: the demo of rough bodies without its waves, in equilibrium."""
    table = read_toml(DEMOS / "rough_rupture.toml")
    for body in ("upper", "lower"):
        table["mesh"][body] |= {"profile": 0.0, "element_size": 0.1e-3}
    table["stepper"] = {"kind": "quasi_static", "first_step": 0.5e-6, "largest_step": 1e-6}
    table["faults"]["main"]["contact"] = {"kind": "augmented_lagrangian"}
    table["faults"]["main"]["nucleation"][0]["half_width"] = 0.0625e-3
    for stage in table["stages"]:
        del stage["damping"]
    table["output"] = {"figures": False, "interface_interval": 1e-6}
    with tempfile.TemporaryDirectory() as folder:
        record = simulate(parse_case(table), out=Path(folder, "run"))
        return plots.snapshots(record, at=[17.5e-6, 20e-6]).figure


def smooth_waves() -> Figure:
    """Waves of the benchmark `smooth_rupture`: the demo of two materials with its patch, load, law and elements."""
    given = [
        "mesh.left=-2.25e-3", "mesh.length=4.5e-3", "mesh.height=1.5e-3", "mesh.element_size=0.05e-3",
        "faults.main.friction={kind = 'coulomb', mu_d = 1.0}", "faults.main.initial_stress.shear=4.65e6",
        "faults.main.nucleation=[{kind = 'friction_drop', center = 0.0, half_width = 0.0625e-3}]",
        "duration=0.8e-6", "output.bulk_interval=0.1e-6", "output.figures=false",
    ]  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        record = simulate(read_case(DEMOS / "bimaterial.toml", overrides=given), out=Path(folder, "run"))
        return plots.wavefield(record, at=[0.4e-6, 0.7e-6]).figure


def smooth_sliding() -> Figure:
    """Waves of a macro-slip, from the case in the page on rough interfaces."""
    page = (PICTURES.parent / "verification" / "rough_interfaces.md").read_text(encoding="utf-8")
    _, _, after = page.partition(":caption: smooth_sliding.toml\n")
    with tempfile.TemporaryDirectory() as folder:
        record = simulate(parse_case(tomllib.loads(after.partition("```")[0])), out=Path(folder, "run"))
        return plots.wavefield(record, at=[0.8e-3, 1.9e-3]).figure


def on_landing_page(draw: Callable[[Record, Axes], object], demo: str, height: float) -> Figure:
    """Draw one panel of a demo in the width of a column, so that its text is readable there [height in inches]."""
    with plots.style():
        figure = Figure(figsize=(3.5, height), layout="constrained")
        axes = figure.add_subplot()
    with tempfile.TemporaryDirectory() as folder:
        case = read_case(DEMOS / f"{demo}.toml", overrides=["output.figures=false"])
        draw(simulate(case, out=Path(folder, "run")), axes)
    return figure


def landing_fracture() -> Figure:
    """Fragments of a beam under the impact of a ball."""
    return on_landing_page(lambda record, axes: plots.wavefield(record, axes, at=120e-6), "ball", 2.4)


def landing_rough() -> Figure:
    """Waves of two rough bodies that slide."""
    return on_landing_page(lambda record, axes: plots.wavefield(record, axes, at=220e-6), "rough_sliding", 1.9)


@styled
def chamfered_block() -> Figure:
    """Stresses in the block of the demo along its base, and when points slip first: pressed unevenly, and evenly."""
    times = {"held": 1.2e-3, "before": 0.0, "after": 0.15e-3}  # s, the last two from the first slip on
    figure, axes = new_figure(4, 2, 6.4, sharex=True, sharey="row")
    labels = (r"$\sigma_{xx}$ (MPa)", r"$\sigma_{yy}$ (MPa)", r"$\tau$ / pressure", "First slip (ms)")
    with tempfile.TemporaryDirectory() as folder:
        for column, (name, given) in enumerate((("uneven", []), ("even", ["stages.0.boundaries.0.profile=1.0"]))):
            case = read_case(DEMOS / "chamfered_block.toml", overrides=["output.figures=false", *given])
            record = simulate(case, out=Path(folder, name))
            data = record.interface
            x = data["position"].values
            arrival = first_slip(data["time"].values, data["slip_rate"].values, times["held"], 1e-3)
            began = float(np.nanmin(arrival))
            for colour, (when, wanted) in zip(("0.6", BLUE, ORANGE), times.items(), strict=True):
                at = wanted if when == "held" else began + wanted - 5e-5 * (when == "before")
                at, stress = body_stress(record, at)
                pressure = -stress["yy"]
                ratio = np.where(pressure > 0, stress["xy"] / np.maximum(pressure, 1.0), np.nan)
                text = f"{1e3 * at:.2f} ms, {when}" if when == "held" else f"{1e3 * at:.2f} ms, {when} first slip"
                for ax, values in zip(axes[:3, column], (1e-6 * stress["xx"], -1e-6 * pressure, ratio), strict=True):
                    ax.plot(1e3 * x, values, color=colour, label=text)
            axes[3, column].plot(1e3 * x, 1e3 * arrival, ".", ms=3, color="black")
            axes[0, column].legend(
                loc="lower center", bbox_to_anchor=(0.5, 1.0), fontsize=6, title=f"pressed {name}ly", title_fontsize=7
            )
            axes[3, column].set_xlabel("x (mm)")
    axes[0, 0].set_ylim(-8, 2)
    axes[1, 0].set_ylim(-12, 0)
    axes[2, 0].set_ylim(-0.4, 0.8)
    for ax, label in zip(axes[:, 0], labels, strict=True):
        ax.set_ylabel(label)
    letter(axes.ravel())
    return figure


def impact() -> None:
    """Figures of the impact demo that the site shows, on a mesh twice as coarse."""
    with tempfile.TemporaryDirectory() as folder:
        case = read_case(DEMOS / "impact.toml", overrides=["mesh.element_size=2e-3"])
        record = simulate(case, out=Path(folder, "run"))
        for name, figure in plots.all_figures(record).items():
            if name in ("energy_budget", "space_time"):
                save(figure, PICTURES / f"impact_{name}.png", "png")
                compress(PICTURES / f"impact_{name}.png")


DRAWINGS = {
    "modes": modes, "signs": signs, "damping": damping,
    "smooth_stress": smooth_stress, "smooth_waves": smooth_waves,
    "smooth_sliding": smooth_sliding,
    "chamfered_block": chamfered_block,
    "landing_fracture": landing_fracture, "landing_rough": landing_rough,
}  # fmt: skip
FIGURES = {
    "antiplane": "space_time", "bimaterial": "space_time", "rate_state": "space_time", "kalthoff": "cracks",
    "branching": "cracks", "brazilian": "cracks", "ball": "wavefield", "granite": "emission",
    "debonding": "snapshots", "sliding_start": "forces", "slow_sliding": "forces", "measured_surface": "surfaces",
    "rough_sliding": "surfaces", "ball_on_plate": "contact_maps", "fault_zone": "space_time",
    "branched_fault": "wavefield", "off_fault_plasticity": "material_state",
    "composite_impact": "space_time", "viscoelastic_impact": "space_time",
}  # fmt: skip
"""Figure of the demo of the same name that a picture shows."""
LUMPED = {
    "spring_slider": "velocity_steps", "burridge_knopoff": "events", "asperity_population": "population",
}  # fmt: skip
"""The same of lumped models, which leave their figures in their run directories."""
ELSEWHERE = {
    "seismic_cycles": ("cycles", DEMOS / "pictures"), "injection": ("slip_profiles", DEMOS / "pictures"),
    "thermal_pressurisation": ("slip_profiles", DEMOS / "pictures"),
}  # fmt: skip
"""Pictures that are kept beside the demos."""


@dataclass(frozen=True)
class Command:
    """A command that draws pictures of the site, run in an empty directory.

    Attributes
    ----------
    command : str
        Words after `ruptfx`, or a script of `demos/` with its arguments.
    pictures : dict of str to str
        Names of the pictures, and of the files that the command leaves anywhere below its directory; without a type
        they are PNG.
    folder : Path
        Where the pictures are kept.
    before : tuple of str
        Commands whose results this one reads.
    """

    command: str
    pictures: Mapping[str, str]
    folder: Path = PICTURES
    before: tuple[str, ...] = ()

    def run(self, directory: Path) -> None:
        """Run it and keep its pictures."""
        for command in (*self.before, self.command):
            first, *words = command.split()
            program = [str(DEMOS / first)] if first.endswith(".py") else ["-m", "ruptfx", first]
            words = [str(DEMOS.parent / word) if word.startswith("demos/") else word for word in words]
            subprocess.run([sys.executable, *program, *words], cwd=directory, check=True)
        self.keep(directory)

    def keep(self, directory: Path) -> None:
        """Keep the pictures and the numbers that the command left in a directory."""
        if self.command.split()[0].endswith(".py"):
            keep_numbers(self.command, directory)
        for name, left in self.pictures.items():
            (found,) = directory.rglob(file_of(left))
            path = self.folder / file_of(name)
            if found.suffix == ".gif":
                write_movie(path, found)
            else:
                shutil.copy(found, path)
                compress(path)


def keep_numbers(command: str, directory: Path) -> None:
    """Keep what a script saved by `ruptfx.app.script.save_numbers` under the name of the script and its arguments."""
    saved = [json.loads(path.read_text(encoding="utf-8")) for path in directory.rglob("numbers.json")]
    if saved:
        write_numbers(command, {name: value for numbers in saved for name, value in numbers.items()})


def write_numbers(name: str, numbers: Mapping[str, object]) -> None:
    """Replace the saved numbers of a run."""
    known = json.loads(NUMBERS.read_text(encoding="utf-8")) if NUMBERS.is_file() else {}
    known[name] = dict(numbers)
    NUMBERS.write_text(json.dumps(known, indent=1, sort_keys=True) + "\n", encoding="utf-8")


def file_of(name: str) -> str:
    """Return the file name of a picture."""
    return name if "." in name else f"{name}.png"


def study(name: str, picture: str, file: str = "mode_map", folder: Path = DEMOS / "pictures") -> Command:
    """Return the command of a study whose map is a picture."""
    return Command(f"study demos/{name}.toml --out study", {picture: file}, folder)


LESSON = "--set mesh.element_size=4e-3 --set duration=20e-6"  # the run of the first lesson
COMMANDS = (
    *(Command(f"bench {name} --fine --out bench", {name: name})
      for name in ("tpv205", "time_order", "self_similar", "smooth_rupture", "bp1", "lamb", "westergaard", "spall")),
    Command("bench smooth_sliding --fine --out bench", {"sliding_test": "smooth_sliding"}),
    Command("bench fibre --out bench", {"fibre_bench": "fibre"}),
    *(Command(f"{name}.py", {name: name})
      for name in ("pushed_block", "fibre_pull_out", "inclined_plates", "front_types", "impact_3d")),
    Command("slip_sequence.py", {
        "slip_sequence_area": "slip_sequence/area", "slip_sequence": "slip_sequence/lengths",
    }),
    Command("thesis_block.py", {
        "thesis_block_uneven": "thesis_block/uneven", "thesis_block_even": "thesis_block/even",
    }),
    Command("sliding_to_rest.py", {"sliding_to_rest": "sliding_to_rest/sliding_to_rest"}),
    Command("spring_slider.py", {
        **{f"slider_{name}": f"{name}/figures/{name}" for name in (
            "slide_hold_slide", "stability", "stick_slip", "loading_unloading", "frequency_response", "modulated_load",
            "modulated_speed", "temperatures")},
        "slider_bifurcation": "bifurcation_rate_and_state_saturating/figures/bifurcation",
        "slider_bifurcation_ageing": "bifurcation_rate_and_state_ageing/figures/bifurcation",
    }),
    Command("lecture_cases.py", {"lecture_cases": "modes"}),
    Command("stress_barrier.py", {"stress_barrier": "stress_barrier/figures/front"}),
    Command("contact_fringes.py", {"contact_fringes": "pair"}),
    Command("pressed_block.py", {"pressed_block": "strains", "pressed_specimens": "specimens"}),
    Command("symmetric_impact.py", {"symmetric_impact": "symmetric_impact/fringes"}),
    Command("block_stresses.py", {"block_stresses": "profiles"}),
    Command("tilted_block.py", {"tilted_block": "maps"}),
    Command("fracture_energy.py", {"fracture_energy": "gamma"}),
    Command("rough_patterns.py", {"rough_patterns": "asymmetry"}),
    Command("sensitivity.py", {"sensitivity": "sensitivity"}),
    Command("infer_antiplane.py", {"infer_antiplane": "infer_antiplane"}),
    Command("infer_gauges.py", {"infer_gauges": "infer_gauges", "infer_tradeoffs": "tradeoffs"}),
    Command("reconstruct.py", {"reconstruct": "reconstruct_demo/reconstruct"}),
    Command("optical_methods.py", {"optical_methods": "optics"}),
    Command("rough_rupture.py", {"rough_rupture": "arrivals"}),
    Command("rough_rupture.py small", {"rough_rupture_small": "arrivals"}),
    Command("mesh demos/gmsh.toml --out gmsh_mesh.png", {"gmsh_mesh": "gmsh_mesh"}),
    Command(f"run demos/impact.toml --out run {LESSON}", {"first_rupture": "space_time"}),
    Command("compare first pressed", {"first_comparison": "comparison"}, PICTURES,
            (f"run demos/impact.toml --out first {LESSON}",
             f"run demos/impact.toml --out pressed {LESSON} --set faults.main.initial_stress.normal=30e6")),
    Command("run demos/impact.toml --out run", {"impact_fringes": "fringes", "impact_space_time": "space_time"},
            DEMOS / "pictures"),
    Command("movie run --what fringes --rate 6", {"impact_fringes.webp": "fringes.gif"}, PICTURES,
            ("run demos/impact.toml --out run --set mesh.element_size=2e-3 --set output.bulk_interval=2e-6 "
             "--set output.figures=false",)),
    Command("run demos/stick_slip.toml --out run", {"stick_slip": "cycles"}, DEMOS / "pictures"),
    Command("events run", {"seismic_cycles_3d": "catalogue"}, DEMOS / "pictures",
            ("run demos/seismic_cycles_3d.toml --out run",)),
    Command("run demos/strike_slip_3d.toml --out run", {"strike_slip_3d": "rupture_map"}),
    Command("run demos/strike_slip_3d.toml --out run --set mesh.element_size=2e3",
            {"strike_slip_ground": "ground_motion"}),
    Command("run demos/prescribed_slip.toml --out run",
            {"finite_fault_ground": "ground_motion", "finite_fault_slip": "rupture_map"}),
    Command("run demos/dipping_3d.toml --out run", {"dipping_3d": "rupture_map"}),
    Command("run demos/rough_3d.toml --out run", {"rough_3d": "rupture_map"}),
    Command("run demos/branch_3d.toml --out run", {"branch_3d": "rupture_map"}),
    Command("run demos/spring_block.toml --out run", {
        "spring_block": "onset_of_sliding", "spring_block_displacements": "displacements",
    }),
    Command("run demos/maxwell_slip.toml --out run", {
        "maxwell_slip": "friction_histories", "maxwell_slip_static": "static_coefficient",
    }),
    Command("spring_block.py", {"spring_block_fronts": "spring_block/front_speed"}),
    Command("impact_figures.py", {"modes": "modes", "tip_speed": "tip_speed", "slip_and_jump": "slip_and_jump",
                                  "fringes": "fringes"}, DEMOS / "pictures",
            tuple(f"study demos/{name}.toml --out studies/{name}" for name in ("mode_map", "mode_map_best"))),
    study("mode_map", "mode_map"),
    study("mode_map_best", "mode_map_best"),
    study("slip_weakening_map", "slip_weakening"),
    study("four_modes", "four_modes", "search"),
    study("four_modes_two", "four_modes_two", "search"),
    study("inclined_plates_map", "inclined_plates_map", folder=PICTURES),
    Command("granite_figures.py", {name: name for name in ("granite_maps", "granite_roses", "granite_boundaries",
                                                           "granite_windows")}, PICTURES,
            ("study demos/granite_confinement.toml --out studies/granite",)),
    study("granite_confinement", "granite_confinement", "curves", PICTURES),
)  # fmt: skip
"""Minutes for most, hours for studies."""
NUMBERS = PICTURES / "numbers.json"
LEFT_OUT = {"wall_time", "node_updates_per_second", "ranks", "host_cores", "versions", "title"}  # of a summary


def compress(path: Path) -> None:
    """Write a picture in all its colours, without the channel of transparency, and as small as PNG can be.

    The resolution stays in the file: the site shows a picture at the size of its figure (`_extensions/pictures.py`).
    """
    with Image.open(path) as picture:
        opaque, resolution = picture.convert("RGB"), picture.info.get("dpi", (RESOLUTION, RESOLUTION))
    opaque.save(path, optimize=True, dpi=resolution)


def write_movie(path: Path, movie: Path) -> None:
    """Write a movie as WebP, which is smaller than GIF: a page should not weigh megabytes."""
    with Image.open(movie) as frames:
        pause = frames.info["duration"]
        pictures = [frame.convert("RGB") for frame in ImageSequence.Iterator(frames)]
    pictures[0].save(path, save_all=True, append_images=pictures[1:], duration=pause, loop=0, quality=60, method=6)


def of_run(name: str, runs: Path) -> None:
    """Draw the picture of a demo from its run, and keep the numbers of the run."""
    if not (runs / name / "summary.json").is_file():
        simulate(read_case(DEMOS / f"{name}.toml", overrides=["output.figures=false"]), out=runs / name).close()
    figure, folder = ELSEWHERE.get(name, (FIGURES.get(name, ""), PICTURES))
    with Record(runs / name) as record:
        save(plots.FIGURES[figure](record).figure, folder / f"{name}.png", "png")
        compress(folder / f"{name}.png")
        write_numbers(name, {key: value for key, value in (record.summary or {}).items() if key not in LEFT_OUT})


def of_lumped_model(name: str, runs: Path) -> None:
    """Copy the picture of a lumped model from its run."""
    if not (runs / name).is_dir():
        command = ["run", str(DEMOS / f"{name}.toml"), "--out", str(runs / name), "--quiet"]
        subprocess.run([sys.executable, "-m", "ruptfx", *command], check=True)
    (found,) = (runs / name).rglob(f"{LUMPED[name]}.png")
    shutil.copy(found, PICTURES / f"{name}.png")
    compress(PICTURES / f"{name}.png")


def main() -> None:
    """Draw all pictures, or those that are named."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("names", nargs="*", help="pictures; default: all")
    parser.add_argument("--runs", type=Path, help="directory of runs by the names of their demos; kept, and used again")
    given = parser.parse_args()
    PICTURES.mkdir(exist_ok=True)
    commands = {name: command for command in COMMANDS for name in command.pictures}
    known = [*DRAWINGS, *FIGURES, *LUMPED, *ELSEWHERE, "impact", *commands]
    if unknown := set(given.names) - set(known):
        parser.error(f"no pictures {', '.join(sorted(unknown))}; there are {', '.join(sorted(known))}")
    done: list[Command] = []
    with tempfile.TemporaryDirectory() as folder:
        for name in given.names or known:
            print(name, flush=True)
            if name == "impact":
                impact()
            elif name in commands:
                if commands[name] not in done:
                    with tempfile.TemporaryDirectory() as apart:
                        commands[name].run(Path(apart))
                    done.append(commands[name])
            elif name in DRAWINGS:
                DRAWINGS[name]().savefig(PICTURES / f"{name}.png", dpi=RESOLUTION)
                compress(PICTURES / f"{name}.png")
            elif name in LUMPED:
                of_lumped_model(name, given.runs or Path(folder))
            else:
                of_run(name, given.runs or Path(folder))


if __name__ == "__main__":
    main()
