"""Instruments against closed forms: polariscope, gauges, velocimeter, load cell, image correlation, contact light.

A plate under a uniform pressure p shows h p / f fringes everywhere, h thick, of a material of fringe constant f; a
disc of diameter D under a force F shows 8 F / (pi D f) in its middle (Frocht), and across the load (1 - s^2) / (1 +
s^2)^2 of that, at s times the radius. The load is even on two flats which the middle sees under 2 alpha: forces along
chords at an angle phi give cos(phi) cos(2 phi) of it (Timoshenko and Goodier, art. 41), together 1 - 5 alpha^2 / 6.
Principal directions on that line are along x and y, so that it is an isoclinic at 0 degrees.

A plane wave whose velocity v rises linearly on a driven edge runs at c into the plates: extension -v(t - y / c) / c
along its way, the mean of it along a gauge, passed on by an amplifier with one pole; traction rho c v on the edge.

Image correlation is tried with strains that are known, noise of two grey levels in 255 and subsets of 21 pixels: its
mean error is the bias. A slip of one pixel looks like shear strain next to the interface; further away than half a
subset and half a window there is nothing of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np

from ruptfx import Table
from ruptfx.app.bench import Check, Outcome
from ruptfx.case import Case
from ruptfx.platform.fem import MPI
from ruptfx.results.analysis import image_correlation as dic
from ruptfx.results.analysis.contact_light import contact_light
from ruptfx.results.analysis.polariscope import Camera, fringe_orders, max_shear
from ruptfx.results.record import Record
from ruptfx.run.simulation import simulate

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure

HOMALITE = {
    "kind": "isotropic_elastic", "young_modulus": 5.3e9, "poisson_ratio": 0.35, "density": 1246.0,
    "fringe_constant": 22.6e3,
}  # fmt: skip
THICK, FRINGE, HARDNESS = 9.5e-3, 22.6e3, 600e6
LENGTH, HEIGHT, PRESSURE = 20e-3, 10e-3, 5e6  # of each plate [m], on it [Pa]
DIAMETER, FLAT, LOAD = 40e-3, 10.0, 60e3  # m, degrees, N/m: force per thickness
SPEED, RISE, END = 2.0, 4e-6, 9e-6  # of the edge [m/s], s
GAUGE, BANDWIDTH, DEEP = 4e-3, 150e3, 6e-3  # m, Hz; below the edge [m]
SUBSET, NOISE, STRAIN = 21, 2.0, 2e-3
EXACT = "closed form"

Traces = dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    del comm
    with TemporaryDirectory() as folder:
        checks = _pressed(Path(folder) / "pressed")
        checks += _bent(Path(folder) / "bent")
        disc, line = _disc(Path(folder) / "disc", 0.25e-3 if fine else 0.5e-3)
        wave, traces = _wave(Path(folder) / "wave", 0.5e-3 if fine else 1e-3)
    correlated, hidden = _correlation()
    return Outcome(checks + disc + wave + correlated, lambda: _draw(line, traces, hidden))


def plates(changes: Table) -> Case:
    """Return two plates of Homalite, glued, on rollers."""
    return Case.model_validate({
        "plane": "stress", "order": 3,
        "mesh": {"kind": "two_plates", "length": LENGTH, "height": HEIGHT, "element_size": 2e-3},
        "materials": {"default": HOMALITE},
        "faults": {"main": {
            "contact": {"kind": "compliant", "C_n": 1e14, "C_s": 1e14}, "friction": {"kind": "coulomb", "mu_d": 1e3},
            "initial_stress": {"normal": 1e3},
        }},
        **changes,
    })  # fmt: skip


def kept(case: Case, folder: Path) -> Record:
    """Run a case on this rank and return its record."""
    return simulate(case, folder, MPI.COMM_SELF, progress=False)


def _pressed(folder: Path) -> list[Check]:
    """Check plates pressed from above, at rest: every number is that of the uniform pressure."""
    case = plates({
        "duration": 1.0, "stepper": {"kind": "quasi_static", "first_step": 0.25, "largest_step": 0.25},
        "boundaries": [
            {"kind": "traction", "edge": "upper.top", "traction": [0.0, -PRESSURE], "ramp": 1.0},
            {"kind": "driven", "edge": "lower.bottom", "component": "y", "velocity": 0.0},
            {"kind": "driven", "edge": "lower.bottom", "component": "x", "velocity": 0.0,
             "x_range": [0.49 * LENGTH, 0.51 * LENGTH]},
        ],
        "instruments": [
            {"kind": "load_cell", "name": "base", "interval": 0.25, "edge": "lower.bottom"},
            {"kind": "strain_gauge", "name": "rosette", "interval": 0.25, "point": [0.3 * LENGTH, 0.3 * HEIGHT],
             "length": 2e-3, "angles": [0.0, 0.9, 2.0]},
        ],
        "output": {"figures": False, "bulk_interval": 0.25, "interface_interval": 0.25, "plate_thickness": THICK},
    })  # fmt: skip
    order = THICK * (PRESSURE + 1e3) / FRINGE
    with kept(case, folder) as record:
        orders, shear = fringe_orders(record, 1e-3).isel(time=-1), max_shear(record, 1e-3).isel(time=-1)
        light = {}
        for field in ("dark", "light"):
            # Fringe counting needs less than half a fringe between snapshots.
            film = Camera(4.0, 1e-3, 1e-3, field).film(record, fringe_constant=8 * FRINGE)
            light[field] = film.isel(time=-1)
        moment = float(film.time[-1]) + 0.5e-3
        pressed = float(record.instruments["base"].force_y[-1])
        rosette = record.instruments["rosette"].isel(time=-1).load()
        area = contact_light(record, HARDNESS).isel(time=-1).load()
    known = {"xx": -0.35, "yy": 1.0, "xy": 0.0}
    strain = max(abs(float(rosette[f"strain_{name}"]) * -5.3e9 / PRESSURE - part) for name, part in known.items())
    dark = np.sin(np.pi * THICK * (PRESSURE * moment + 1e3) / (8 * FRINGE)) ** 2
    return [
        Check("pressed plates: fringe order, largest error", 0.0, float(abs(orders / order - 1).max()), 1e-4, "1",
              EXACT),
        Check("pressed plates: largest shear stress, largest error", 0.0,
              float(abs(2 * shear / (PRESSURE + 1e3) - 1).max()), 1e-4, "1", EXACT),
        Check("pressed plates: dark field, largest error of the light", 0.0, float(abs(light["dark"] - dark).max()),
              1e-3, "1", EXACT),
        Check("pressed plates: dark and light field together", 1.0, float((light["dark"] + light["light"]).max()), 1e-9,
              "1", EXACT),
        Check("pressed plates: load cell over pressure times length", 1.0, pressed / ((PRESSURE + 1e3) * LENGTH), 1e-6,
              "1", EXACT),
        Check("pressed plates: rosette, largest error over the strain", 0.0, strain, 1e-4, "1", EXACT),
        Check("pressed plates: contact light, largest error", 0.0,
              float(abs(area / ((PRESSURE + 1e3) / HARDNESS) - 1).max()), 1e-4, "1", EXACT),
    ]  # fmt: skip


def _bent(folder: Path) -> list[Check]:
    """Check a beam under end moments, applied as tractions on every row of elements: sigma_xx = M y / I.

    The distribution over the ends has no influence beyond one height from them (Saint-Venant).
    """
    length, height, size = 40e-3, 5e-3, 1e-3
    rows = (np.arange(-5, 5) + 0.5) * size
    pull = PRESSURE * rows / height
    inertia = 2 * height**3 / 3  # per thickness
    slope = float(np.sum(pull * rows * size)) / inertia
    held = {"kind": "driven", "velocity": 0.0, "x_range": [0.5 * length - 0.1 * size, 0.5 * length + 0.1 * size]}
    case = plates({
        "duration": 1.0, "order": 2, "stepper": {"kind": "quasi_static", "first_step": 0.5, "largest_step": 0.5},
        "mesh": {"kind": "two_plates", "length": length, "height": height, "element_size": size},
        "boundaries": [
            *({"kind": "traction", "edge": f"{'upper' if y > 0 else 'lower'}.{side}", "traction": [sign * part, 0.0],
               "y_range": [y - 0.4 * size, y + 0.4 * size], "ramp": 1.0}
              for y, part in zip(rows, pull, strict=True) for side, sign in (("left", -1.0), ("right", 1.0))),
            # By symmetry these supports carry no force along x.
            {**held, "edge": "lower.bottom", "component": "x"}, {**held, "edge": "upper.top", "component": "x"},
            {**held, "edge": "lower.bottom", "component": "y"},
        ],
        "output": {"figures": False, "bulk_interval": 0.5, "interface_interval": 0.5, "plate_thickness": THICK},
    })  # fmt: skip
    with kept(case, folder) as record:
        orders = fringe_orders(record, 0.25e-3).isel(time=-1)
        light = Camera(4.0, 1e-3, 0.25e-3).film(record, fringe_constant=8 * FRINGE).isel(time=-1)
    middle = {"x": slice(0.4 * length, 0.6 * length)}
    order = THICK * abs(slope * orders.y + 1e3) / FRINGE  # with the pressure on the interface
    flat = order.max() / 8 * (float(light.time) + 0.5e-3)
    dark = np.sin(np.pi * flat * order / order.max()) ** 2
    along = orders.sel(middle).mean("x")
    return [
        Check("bent beam: fringe order over its height, largest error over the largest", 0.0,
              float(abs(along - order).max() / order.max()), 5e-3, "1", "M y / I"),
        Check("bent beam: dark field, largest error of the light", 0.0,
              float(abs(light.sel(middle).mean("x") - dark).max()), 5e-3, "1", "M y / I"),
    ]  # fmt: skip


@dataclass(frozen=True)
class Line:
    """Fringe orders across the load relative to the largest, at fractions of the radius, and on the whole disc."""

    place: np.ndarray
    found: np.ndarray
    exact: np.ndarray
    picture: xarray.DataArray


def _disc(folder: Path, size: float) -> tuple[list[Check], Line]:
    """Check a disc pressed on its flats, at rest."""
    half = np.radians(0.5 * FLAT)
    width = DIAMETER * np.sin(half)
    held = {"kind": "driven", "velocity": 0.0, "x_range": [-0.55 * size, 0.55 * size]}
    case = Case.model_validate({
        "plane": "stress", "order": 1, "duration": 1.0,
        "stepper": {"kind": "quasi_static", "first_step": 0.5, "largest_step": 0.5},
        "mesh": {"kind": "specimen", "element_size": size,
                 "shape": {"kind": "disc", "diameter": DIAMETER, "flat": FLAT}},
        "materials": {"specimen": HOMALITE},
        "boundaries": [
            {"kind": "traction", "edge": "specimen.top", "traction": [0.0, -LOAD / width], "ramp": 1.0},
            {"kind": "traction", "edge": "specimen.bottom", "traction": [0.0, LOAD / width], "ramp": 1.0},
            # The disc is supported at a few nodes, where the reaction is zero by symmetry.
            {**held, "edge": "specimen.bottom", "component": "x"}, {**held, "edge": "specimen.top", "component": "x"},
            {**held, "edge": "specimen.bottom", "component": "y"},
        ],
        "output": {"figures": False, "bulk_interval": 0.5, "interface_interval": 0.5, "plate_thickness": THICK},
    })  # fmt: skip
    with kept(case, folder) as record:
        orders = fringe_orders(record, 0.5e-3).isel(time=-1)
        plane = Camera(2.0, 1e-3, 0.5e-3, "plane").film(record, fringe_constant=40 * FRINGE).isel(time=-1)
    middle = 8 * LOAD * THICK / (np.pi * DIAMETER * FRINGE)
    part = orders.x.values / (0.5 * DIAMETER)
    exact = (1 - part**2) / (1 + part**2) ** 2
    found = orders.interp(y=0.0).values / middle
    there = np.abs(part) < 0.8
    arc = 1 - 2.5 * half**2 / 3
    bright = float(plane.interp(y=0.0).values[there].max() / plane.max())
    return [
        Check("disc: fringe order in the middle over 8 F / (pi D f)", arc, float(np.interp(0.0, part, found)), 0.01,
              "1", "Frocht"),
        Check("disc: fringe order across the load, largest error over the middle", 0.0,
              float(np.abs(found - arc * exact)[there].max()), 0.02, "1", "Frocht"),
        Check("disc: light of the isoclinic across the load over the brightest", 0.0, bright, 0.02, "1", "symmetry"),
    ], Line(part, found, arc * exact, orders)  # fmt: skip


def _wave(folder: Path, size: float) -> tuple[list[Check], Traces]:
    """Check a plane wave from the top, between rollers, in plane strain, before it returns from the bottom."""
    at = [0.4 * LENGTH, HEIGHT - DEEP]
    gauge = {"kind": "strain_gauge", "interval": 1e-7, "point": at, "angles": ["90 deg"]}
    case = plates({
        "plane": "strain", "duration": END,
        "mesh": {"kind": "two_plates", "length": LENGTH, "height": HEIGHT, "element_size": size},
        "boundaries": [
            {"kind": "driven", "edge": "upper.top", "component": "y", "velocity": -SPEED, "ramp": RISE},
            *({"kind": "driven", "edge": f"{body}.{side}", "component": "x", "velocity": 0.0}
              for body in ("upper", "lower") for side in ("left", "right")),
        ],
        "instruments": [
            {**gauge, "name": "point"}, {**gauge, "name": "long", "length": GAUGE},
            {**gauge, "name": "slow", "length": GAUGE, "bandwidth": BANDWIDTH},
            {**gauge, "name": "rosette", "angles": ["0 deg", "60 deg", "120 deg"]},
            {"kind": "velocimeter", "name": "velocity", "interval": 1e-7, "point": at, "direction": [0.0, -1.0]},
            {"kind": "load_cell", "name": "cell", "interval": 1e-7, "edge": "upper.top"},
        ],
        "output": {"figures": False, "interface_interval": 3e-6, "bulk_interval": END},
    })  # fmt: skip
    young, nu, density = 5.3e9, 0.35, 1246.0
    c = np.sqrt(young * (1 - nu) / ((1 + nu) * (1 - 2 * nu) * density))
    with kept(case, folder) as record:
        found = {name: data.load() for name, data in record.instruments.items()}
    fine = np.linspace(0, END, 9001)

    def ramp(time: np.ndarray) -> np.ndarray:
        return np.clip(time / RISE, 0.0, 1.0)

    passing, force = ramp(fine - DEEP / c), found["cell"].force_y - found["cell"].force_y[0]
    offsets = np.linspace(-0.5, 0.5, 201) * GAUGE / c
    mean = np.mean([ramp(fine - DEEP / c + each) for each in offsets], axis=0)
    # Measured signal over its largest value, and exact signal, by name.
    seen = {
        "gauge at a point": (found["point"].extension_1 * -c / SPEED, passing),
        "gauge 4 mm long": (found["long"].extension_1 * -c / SPEED, mean),
        "the same behind 150 kHz": (found["slow"].extension_1 * -c / SPEED, _one_pole(fine, mean, BANDWIDTH)),
        "velocimeter": (found["velocity"].velocity / SPEED, passing),
        "rosette, xy": (found["rosette"].strain_xy * c / SPEED, 0 * fine),
        "rosette, xx": (found["rosette"].strain_xx * c / SPEED, 0 * fine),
        "load cell over rho c v L": (force / (-density * c * SPEED * LENGTH), ramp(fine)),
    }  # fmt: skip
    traces = {
        name: (data.time.values, data.values, np.interp(data.time.values, fine, exact))
        for name, (data, exact) in seen.items()
    }
    return [
        Check(f"wave: {name}, largest error over the largest", 0.0, float(np.abs(there - exact).max()), 0.02, "1",
              EXACT) for name, (_, there, exact) in traces.items()
    ], traces  # fmt: skip


def _one_pole(time: np.ndarray, signal: np.ndarray, bandwidth: float) -> np.ndarray:
    """Return the output of an amplifier, by convolution with an exponential."""
    kernel = np.exp(-2 * np.pi * bandwidth * time)
    return np.asarray(np.convolve(signal, kernel / kernel.sum())[: len(time)])


def _correlation() -> tuple[list[Check], tuple[np.ndarray, np.ndarray]]:
    """Check pictures that are stretched, that do not move, and whose halves slip by a pixel."""
    shape, middle = (240, 320), np.s_[45:-45, 45:-45]
    y, x = np.indices(shape).astype(float)
    image, still = dic.speckle(shape, 4.0), np.zeros(shape)
    before = dic.photographed(image, still, still, NOISE, 1)

    def found(along_x: np.ndarray, along_y: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        moved = dic.displacements(before, dic.photographed(image, along_x, along_y, NOISE, 2), SUBSET)
        return moved[0], dic.strains(*moved, SUBSET)

    shifts = np.array([0.1, 0.25, 0.5])
    bias = max(abs(float(np.mean(found(still + shift, still)[0][middle])) - shift) for shift in shifts)
    stretched = found(STRAIN * x, -0.35 * STRAIN * y)[1]
    noise = float(np.std(stretched["xx"][middle]))
    row = np.arange(shape[0]) - 0.5 * shape[0] + 0.5
    slipped = found(np.where(y > 0.5 * shape[0], 1.0, 0.0), still)[1]["xy"][:, 45:-45].mean(axis=1)
    away = np.abs(row)
    beyond = float(np.abs(slipped[(away > SUBSET) & (away < 60)]).max())
    return [
        Check("image correlation: bias of a displacement", 0.0, bias, 0.02, "pixel", "known pictures"),
        Check("image correlation: a strain of 0.2 %, mean", STRAIN, float(np.mean(stretched["xx"][middle])), 1e-4, "1",
              "known pictures"),
        Check("image correlation: noise of a strain", 0.0, noise, 1e-3, "1", "known pictures", "at most"),
        Check("image correlation: slip of a pixel as shear strain at the interface", 0.25 / SUBSET,
              float(np.nanmax(np.abs(slipped))), 0.0, "1", "known pictures", "at least"),
        Check("image correlation: the same half a subset and half a window away", 0.0, beyond, 1e-3, "1",
              "known pictures", "at most"),
    ], (row, slipped)  # fmt: skip


def _draw(line: Line, traces: Traces, hidden: tuple[np.ndarray, np.ndarray]) -> Figure:
    from ruptfx.results.figure_style import letter, new_figure

    figure, axes = new_figure(2, 2, 5.8)
    disc, across, waves, slip = axes.ravel()
    x, y = 1e3 * line.picture.x, 1e3 * line.picture.y
    disc.pcolormesh(x, y, np.sin(np.pi * line.picture) ** 2, cmap="gray", vmin=0, vmax=1, rasterized=True)
    orders = disc.contour(x, y, line.picture, [0.5, 1, 1.5, 2], colors="#d9480f", linewidths=0.6)
    disc.clabel(orders, fmt="%g", fontsize=6)
    disc.set(xlabel="x (mm)", ylabel="y (mm)", aspect="equal")
    across.plot(line.place, line.exact, "k", lw=2, alpha=0.3, label="closed form")
    across.plot(line.place, line.found, color="#d9480f", lw=0.8, label="polariscope")
    across.set(xlabel="Distance from the middle / radius", ylabel=r"Fringe order / ($8F/\pi Df$)")
    across.legend(fontsize=7, loc="lower center")
    for number, (name, (time, seen, exact)) in enumerate(list(traces.items())[:3]):
        waves.plot(1e6 * time, exact, "k", lw=2, alpha=0.3, label="closed form" if number == 0 else None)
        waves.plot(1e6 * time, seen, f"C{number}", lw=0.8, label=name)
    waves.set(xlabel="Time (µs)", ylabel="Compression / largest")
    waves.set_ylim(-0.05, 1.75)
    waves.legend(fontsize=7, loc="upper left")
    slip.plot(hidden[0], 100 * hidden[1], color="#1769aa")
    for side in (-1, 1):
        slip.axvline(side * SUBSET, color="0.6", lw=0.6)
    slip.set(xlabel="Distance from the interface (pixel)", ylabel="Shear strain seen (%)")
    letter(axes.ravel())
    return figure
