"""Run directories by construction: slip-rate fields whose mode, speeds and widths are known, in the files of a run."""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import numpy as np
import tomli_w
import xarray

from ruptfx.input.fields import DERIVED, FIELDS, INTERFACE_FIELDS, MONITORS

Array = np.ndarray

# Homalite in plane stress, rounded; the driven edge moves at V_IMP.
C_P, C_S, C_R, V_IMP = 2200.0, 1255.0, 1155.0, 2.0
LENGTH, DURATION = 0.1, 60e-6

UNITS = {
    "slip": "m",
    "slip_rate": "m/s",
    "displacement_jump": "m",
    "shear_traction": "Pa",
    "normal_stress": "Pa",
    "opening": "m",
    "pore_pressure": "Pa",
    "theta": "s",
    "peak_slip_rate": "m/s",
    "rupture_time": "s",
}
WORDS = {field.name: field.long_name for field in (*FIELDS, *DERIVED, *INTERFACE_FIELDS.values(), *MONITORS)}
_GLL4 = np.array([0, 1 - np.sqrt(3 / 7), 1, 1 + np.sqrt(3 / 7)]) / 2


HOMALITE = {"kind": "isotropic_elastic", "young_modulus": 5.3e9, "poisson_ratio": 0.35, "density": 1246.0}


def points(cells: int = 100, length: float = LENGTH) -> Array:
    """Order-4 Gauss-Lobatto-Legendre points of equal cells: 4 per cell and the last end."""
    return np.append((np.arange(cells)[:, None] + _GLL4).ravel(), cells) * (length / cells)


def times(count: int = 301) -> Array:
    return np.linspace(0.0, DURATION, count)


def crack(time: Array, position: Array, speed: float = 2100.0, start: float = 5e-6, rate: float = 2.0) -> Array:
    """All points behind the tip slide at `rate`; the rate rises over 1 mm behind the tip."""
    tip = speed * (time[:, None] - start)
    return rate * np.clip((tip - position) / 1e-3, 0, 1)


def pulses(
    time: Array,
    position: Array,
    lags: tuple[float, ...] = (0.0,),
    speed: float | tuple[float, ...] = 2100.0,
    width: float = 6e-3,
    start: float = 5e-6,
    rate: float = 2.0,
) -> Array:
    """Pulses of parabolic slip rate, `width` wide where it vanishes, that leave the left end one `lag` after another.

    The k-th front (not the centre) is at ``speed_k (t - start - lag_k)``.
    """
    field = np.zeros((len(time), len(position)))
    for lag, v in zip(lags, np.broadcast_to(speed, len(lags)), strict=True):
        centre = v * (time[:, None] - start - lag) - width / 2
        field = np.maximum(field, rate * (1 - ((position - centre) / (width / 2)) ** 2))
    return field


def train(time: Array, position: Array, count: int = 6, spacing: float = 12e-3, width: float = 6e-3) -> Array:
    """Equal pulses, `spacing` apart, at 2100 m/s."""
    return pulses(time, position, tuple(np.arange(count) * spacing / 2100.0), width=width)


def mixed(time: Array, position: Array) -> Array:
    """Two pulses that become a crack when the tip has run half of the interface."""
    later = time > 5e-6 + 0.55 * LENGTH / 2100.0
    two = pulses(time, position, (0.0, 12e-3 / 2100.0))
    return np.where(later[:, None], crack(time, position), two)


def arrested(time: Array, position: Array, stop: float = 0.04) -> Array:
    """A pulse that dies at `stop`."""
    return pulses(time, position) * (position < stop)


def grid_noise(time: Array, position: Array, amplitude: float, behind: float = 0.0) -> Array:
    """A crack at 2 m/s that is `amplitude` faster and slower at every other point, from `behind` its tip on."""
    alternate = np.where(np.arange(len(position)) % 2, -1.0, 1.0)
    return crack(time, position) + amplitude / 2.0 * crack(time, position + behind) * alternate


def ripples(time: Array, position: Array, speed: float, wavelength: float = 3.5e-3) -> Array:
    """Behind a tip at 2100 m/s, zones half a wavelength wide that move at `speed`."""
    wave = np.sin(2 * np.pi / wavelength * (position - speed * time[:, None]))
    return crack(time, position) * np.maximum(wave, 0)


def write_run(
    path: Path,
    slip_rate: Array,
    time: Array,
    position: Array,
    *,
    plane: str = "stress",
    complete: bool = True,
    snapshots: int = 6,
    summary: dict | None = None,
    V_imp: float = V_IMP,
    slides: bool = False,
    wet: bool = False,
) -> Path:
    """Write a run directory with this slip rate; everything else follows from it or is simple and known. An interface
    that slides has surfaces, states of contact and forces, too; one that is wet has a well at 0.03 m."""
    path.mkdir(parents=True)
    case = {
        "title": "Synthetic", "plane": plane, "order": 4, "duration": DURATION, "mesh": {"kind": "none"},
        "materials": {"default": {**HOMALITE, "fringe_constant": 22.6e3}}, "output": {"plate_thickness": 9.5e-3},
        "instruments": [{"kind": "receiver", "name": "point"}, {"kind": "load_cell", "name": "cell"}],
    }  # fmt: skip
    (path / "case.toml").write_text(tomli_w.dumps(case), encoding="utf-8")
    (path / "run.log").write_text("synthetic\n", encoding="utf-8")
    _write_interface(path / "interface.h5", slip_rate, time, position, plane, complete, V_imp, slides, wet)
    if slides:
        _write_forces(path / "forces.csv", time)
    _write_bulk(path / "bulk.h5", np.linspace(time[0], time[-1], snapshots), plane)
    _write_energy(path / "energy.csv", time)
    _write_instruments(path / "instruments.h5", time)
    if complete:
        (path / "summary.json").write_text(json.dumps(summary or {"mode": "crack"}), encoding="utf-8")
    return path


def _write_interface(
    path: Path, slip_rate: Array, time: Array, position: Array, plane: str, complete: bool, V_imp: float, slides: bool,
    wet: bool,
) -> None:  # fmt: skip
    slid = np.abs(slip_rate) > 1e-3
    slip = np.vstack([np.zeros_like(position), np.cumsum(slip_rate[1:] * np.diff(time)[:, None], axis=0)])
    histories = {
        "slip": slip,
        "slip_rate": slip_rate,
        "displacement_jump": 1.05 * slip,
        "shear_traction": -1e6 * np.tanh(slip_rate),
        "normal_stress": np.full_like(slip_rate, 6e6),
        "opening": np.zeros_like(slip_rate),
        "theta": np.exp(-slip / 1e-5),
    }
    if wet:
        since = (time - time[0])[:, None]
        histories["pore_pressure"] = 1e11 * since * np.exp(-np.abs(position - 0.03) / (100 * since + 1e-4))
    if slides:
        # What slides has slid over a wave of 10 um; the last tenth faces nothing, the tenth before it is open.
        height = 1e-5 * np.cos(2 * np.pi * position / 0.02) * np.ones_like(slip)
        uncovered = position > 0.9 * position[-1]
        states = np.select([uncovered, position > 0.8 * position[-1], slid], [3, 0, 2], 1)
        histories |= {
            "deformed_x": position + slip, "deformed_y": height, "contact": states.astype(np.int8),
            "paired_x": np.where(uncovered, np.nan, position + slip), "paired_y": np.where(uncovered, np.nan, height),
            "paired_position": np.where(uncovered, np.nan, position + slip),
        }  # fmt: skip
    along = {
        "peak_slip_rate": np.abs(slip_rate).max(axis=0),
        "rupture_time": np.where(slid.any(axis=0), time[slid.argmax(axis=0)], np.nan),
    }
    data = xarray.Dataset(
        {name: (("time", "position"), values) for name, values in histories.items()}
        | {name: ("position", values) for name, values in along.items()},
        coords={
            "time": ("time", time, {"units": "s"}),
            "position": ("position", position, {"units": "m"}),
            "x": ("position", position, {"units": "m"}),
            "y": ("position", np.zeros_like(position), {"units": "m"}),
        },
        attrs={
            "fault": "main",
            "c_p": C_P,
            "c_s": C_S,
            "c_R": C_R,
            "plane": plane,
            "case_hash": "0" * 12,
            "ruptfx_version": "0",
            "dolfinx_version": "0",
            "complete": int(complete),
            "loaded_end": 0.0,
            "V_imp": V_imp,
            "rupture_threshold": 1e-3,
        },
    )
    for name in (*histories, *along):
        data[name].attrs = {"units": UNITS.get(name, "m"), "long_name": WORDS.get(name, name.replace("_", " "))}
    data.to_netcdf(path, engine="h5netcdf")


def _write_bulk(path: Path, time: Array, plane: str, columns: int = 101, rows: int = 21) -> None:
    """Two bodies, 100 x 20 mm each, and a plane wave of shear that runs along them at C_S."""
    x, y = np.meshgrid(np.linspace(0, LENGTH, columns), np.linspace(0, 0.02, rows))
    body = np.column_stack([x.ravel(), y.ravel()])
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    quads = np.column_stack([corner, corner + 1, corner + columns + 1, corner + columns])
    both = np.vstack([body, body * [1, -1]])
    wave = np.where(both[:, 0] < C_S * time[:, None], np.sin(200 * (C_S * time[:, None] - both[:, 0])), 0.0)
    zero = np.zeros_like(wave)
    stress = [2e6 * wave, 0 * wave] if plane == "antiplane" else [zero, zero - 6e6, 2e6 * wave]
    velocity = [wave] if plane == "antiplane" else [zero, wave]
    with h5py.File(path, "w") as file:
        file.attrs["bodies"] = ["lower", "upper"]
        file["points"], file["time"] = both, time
        # Mirrored quadrilaterals are turned, so that all run counter-clockwise.
        file["cells"] = np.vstack([quads, quads[:, ::-1] + len(body)]).astype(np.int32)
        file["body"] = np.repeat([1, 0], len(body)).astype(np.int32)
        file["velocity"] = np.stack(velocity, axis=-1)
        file["displacement"] = 1e-5 * np.stack(velocity, axis=-1)
        file["stress"] = np.stack(stress, axis=-1)
        if plane != "antiplane":
            file["fringe"] = np.hypot(6e6, 4e6 * wave)
            file["plastic_strain"] = 1e-3 * np.maximum(C_S * time[:, None] - both[:, 0], 0) / LENGTH
            file["plastic_strain"].attrs["long_name"] = "magnitude of the plastic strain"
            file.attrs["states"] = ["plastic_strain"]
        units = {"points": "m", "time": "s", "velocity": "m/s", "displacement": "m", "stress": "Pa", "fringe": "Pa",
                 "plastic_strain": "1"}  # fmt: skip
        for name in units.keys() & file.keys():
            file[name].attrs["units"] = units[name]


def _write_instruments(path: Path, time: Array) -> None:
    """A receiver in a wave of C_S, and the force that it takes."""
    wave = np.sin(200 * C_S * time)
    for name, channels in {
        "point": {"velocity_y": ("m/s", wave), "strain_xy": ("1", -0.5 * wave / C_S)},
        "cell": {"force_x": ("N/m", 1e4 * wave)},
    }.items():  # fmt: skip
        data = xarray.Dataset(
            {channel: ("time", values, {"units": unit}) for channel, (unit, values) in channels.items()},
            {"time": ("time", time, {"units": "s"})},
        )
        data.to_netcdf(path, engine="h5netcdf", group=name, mode="a" if path.exists() else "w")


def _write_forces(path: Path, time: Array, components: dict[str, float] | None = None, unit: str = "N/m") -> None:
    """1 MN/m of normal force; shear force up to 0.4 of it in a ramp with a knee at 0.3, a drop to 0.2 and a ramp.

    `components` has parts of the shear force by the names of their columns.
    """
    components = components or {"shear_force": 1.0}
    at = np.array([0, 0.3, 0.5, 0.55, 1.0]) * (time[-1] or 1.0)
    shear = np.interp(time, at, [0, 0.3e6, 0.4e6, 0.2e6, 0.35e6])
    parts = np.outer(np.ones_like(time), [0.45, 0.3, 0.15, 0.1])
    table = np.column_stack([time, np.full_like(time, 1e6), np.outer(shear, list(components.values())), parts])
    rows = "\n".join(",".join(map(repr, map(float, row))) for row in table)
    header = ",".join(["time,normal_force", *components, "sticking,sliding,open,uncovered"])
    path.write_text(f"# s, {unit}, parts\n{header}\n{rows}\n")


def _write_energy(path: Path, time: Array) -> None:
    """Boundary work 100 J/m x (t/T)^2, shared 0.4, 0.22, 0.1, 0.18, 0.0998: 2e-4 of it is not accounted for."""
    work = 100.0 * (time / (time[-1] or 1.0)) ** 2
    parts = np.outer(work, [0.4, 0.22, 0.1, 0.18, 0.0998])
    closure = (work - parts.sum(axis=1)) / (work.max() or 1.0)
    table = np.column_stack([time, parts, work, closure])
    header = "time,kinetic,strain,interface_elastic,frictional_dissipation,damping,boundary_work,closure"
    rows = "\n".join(",".join(map(repr, map(float, row))) for row in table)
    path.write_text(f"# s, then J per metre of thickness; closure is a fraction\n{header}\n{rows}\n", encoding="utf-8")


SURFACE = 40e3, 20e3  # m


def write_surface_run(
    path: Path, speed: float = 2500.0, count: int = 41, structured: bool = True, branch: bool = False,
    slides: bool = False,
) -> Path:  # fmt: skip
    """Write the run of a circular rupture that leaves the middle of a surface at a speed; slip rate is 1 m/s behind it.

    Slip is the slip rate times the time since the front, and the shear modulus 32 GPa. A branch is a second surface,
    half as long, whose middle ruptures 1 s later and with twice the slip rate. A surface that slides has states: it
    sticks before the front and slides behind it, its last tenth faces nothing, and the tenth before that is open.
    """
    path.mkdir(parents=True)
    grid = {"kind": "receiver_grid", "name": "ground", "corner": [-2e4, -1e4, 0.0], "opposite": [2e4, 1e4, 0.0],
            "spacing": 2e3, "interval": 0.5}  # fmt: skip
    case = {"title": "Surface", "plane": "solid", "duration": 10.0, "instruments": [grid]}
    (path / "run.log").write_text("synthetic\n")
    time = np.linspace(0.0, 10.0, count)
    _write_grid(path / "instruments.h5", speed)
    if branch:
        case["faults"] = {"main": {}, "branch": {}}
        _write_surface(path / "interface_branch.h5", time, speed, structured, "branch", 0.5, 1.0, 2.0)
        rows = [f"{t},{1e18 * t},{3e18 * t**2}" for t in np.linspace(0.0, 10.0, 3 * count).tolist()]
        (path / "moment_rate.csv").write_text("\n".join(["# every step", "time,main,branch", *rows]) + "\n")
    _write_surface(path / f"interface{'_main' * branch}.h5", time, speed, structured, slides=slides)
    if slides:
        # The same force at an angle whose cosine is 0.6 to the first tangent.
        _write_forces(path / "forces.csv", time, {"shear_force_1": 0.6, "shear_force_2": 0.8}, "N")
    (path / "case.toml").write_text(tomli_w.dumps(case))
    _write_energy(path / "energy.csv", time)
    (path / "summary.json").write_text("{}")
    return path


MIDDLE = 3.1e3, 8.1e3  # m along strike and down dip, of a contact


def hexahedra(number: Array) -> Array:
    """Return the cells between points on a grid, shape (cells, 8), from the numbers of the points."""
    low, high = slice(None, -1), slice(1, None)
    square = [(low, low), (high, low), (high, high), (low, high)]
    return np.stack([number[(*corner, level)].ravel() for level in (low, high) for corner in square], axis=1)


def write_solids(path: Path, plus: Array, minus: Array) -> None:
    """Write snapshots of two solids beside the plane y = 0, each 40 x 10 x 20 km in cells of 5 km, into a surface run.

    Parameters
    ----------
    plus, minus : ndarray, shape (snapshots,)
        Velocities along z of all points of the body at y > 0, and of the other [m/s].
    """
    lines = np.arange(-4, 5) * 5e3, np.arange(3) * 5e3, np.arange(-4, 1) * 5e3
    box = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 3)
    number = np.arange(len(box)).reshape([len(line) for line in lines])
    cells = hexahedra(number)
    speed = np.repeat(np.stack([plus, minus], axis=1), len(box), axis=1)
    with h5py.File(path / "bulk.h5", "w") as file:
        file.attrs["bodies"] = ["plus", "minus"]
        file["points"], file["cells"] = np.vstack([box, box * [1, -1, 1]]), np.vstack([cells, cells + len(box)])
        file["body"] = np.repeat([0, 1], len(box)).astype(np.int32)
        file["body_of_cell"] = np.repeat([0, 1], len(cells)).astype(np.int32)
        file["time"] = np.linspace(0.0, 10.0, len(plus))
        file["velocity"] = speed[..., None] * np.array([0.0, 0.0, 1.0])
        for name, unit in {"points": "m", "time": "s", "velocity": "m/s"}.items():
            file[name].attrs["units"] = unit


def write_pressed_run(path: Path, radii: Array) -> Path:
    """Write a run with contact in a disc around `MIDDLE` that has a radius [m] at each record.

    Its inner half sticks, the pressure is that of Hertz up to 9 MPa, and slip has 3 and -4 mm; points that do not touch
    have slipped 5 m along both tangents.
    """
    write_surface_run(path, count=len(radii), slides=True)
    with h5py.File(path / "interface.h5", "a") as file:
        away = np.hypot(file["position"][()] - MIDDLE[0], file["dip"][()] - MIDDLE[1])
        inside = away < radii[:, None]
        part = np.where(inside, away / np.maximum(radii[:, None], 1.0), 1.0)
        file["contact"][...] = np.where(inside, np.where(part < 0.5, 1, 2), 0)
        file["normal_stress"][...] = 9e6 * np.sqrt(1 - part**2)
        file["slip_1"][...] = np.where(inside, 3e-3, 5.0)
        file["slip_2"][...] = np.where(inside, -4e-3, 5.0)
    return path


def _write_surface(
    path: Path, time: Array, speed: float, structured: bool, name: str = "main", length: float = 1.0,
    begin: float = 0.0, slip_rate: float = 1.0, slides: bool = False,
) -> None:  # fmt: skip
    """Write the fields of a surface that a circular front crosses; its length is a share of `SURFACE`."""
    x, y = np.linspace(-0.5, 0.5, 81) * length * SURFACE[0], np.linspace(0, 1, 41) * SURFACE[1]
    strike, dip = (values.ravel() for values in np.meshgrid(x, y, indexing="ij"))
    ends = (np.where(np.isin(each, each[[0, -1]]), 0.5, 1.0) for each in (x, y))
    share = (x[1] - x[0]) * 500.0 * np.outer(*ends).ravel()
    if not structured:
        keep = np.arange(len(strike)) % 7 > 0
        strike, dip, share = strike[keep], dip[keep], share[keep]
    arrival = begin + np.hypot(strike, dip - 0.5 * SURFACE[1]) / speed
    slip = slip_rate * np.maximum(time[:, None] - arrival, 0.0)
    rate = slip_rate * (slip > 0)
    fields = {
        "slip_1": slip, "slip_2": 0 * slip, "slip_rate_1": rate, "slip_rate_2": 0 * slip,
        "shear_traction_1": 70e6 - 7e6 * (slip > 0), "shear_traction_2": 0 * slip, "normal_stress": 120e6 + 0 * slip,
        "opening": 0 * slip,
    }  # fmt: skip
    if slides:
        ends = 0.3 * SURFACE[0] < strike, 0.4 * SURFACE[0] < strike
        fields["contact"] = np.select([ends[1], ends[0], slip > 0], [3, 0, 2], 1).astype(np.int8)
    of_points = {
        "position": strike,
        "dip": dip,
        "x": strike,
        "y": 0 * dip,
        "z": -dip,
        "area": share,
        "peak_slip_rate": rate.max(axis=0),
        "rupture_time": np.where(arrival < 10.0, arrival, np.nan),
    }
    data = xarray.Dataset(
        {name: (("time", "point"), values) for name, values in fields.items()}
        | {name: ("point", values) for name, values in of_points.items()}, {"time": ("time", time)},
        attrs={"fault": name, "plane": "solid", "position_measure": "x", "c_p": 6000.0, "c_s": 3464.0, "c_R": 3185.0,
               "c_p_of_bodies": [6000.0, 6000.0], "c_s_of_bodies": [3464.0, 3464.0], "bodies": ["plus", "minus"],
               "shear_modulus_of_bodies": [32e9, 32e9], "V_imp": 0.0, "rupture_threshold": 1e-3},
    )  # fmt: skip
    data.to_netcdf(path, engine="h5netcdf")


def _write_grid(path: Path, speed: float) -> None:
    """Write the samples of a grid around a source, whose waves decay with the distance."""
    time, x, y = np.linspace(0.0, 10.0, 21), np.linspace(-2e4, 2e4, 21), np.linspace(-1e4, 1e4, 11)
    points = np.stack([each.ravel() for each in np.meshgrid(x, y, [0.0], indexing="ij")])
    distance = np.hypot(points[0], points[1])
    pulse = np.exp(-((time[:, None] - distance / speed) ** 2)) / (1 + distance / 5e3)
    pulse *= 1 + points[0] / 4e4 + points[1] / 5e4  # no two points move alike
    parts = {"velocity_x": pulse, "velocity_y": -0.5 * pulse, "velocity_z": 0.1 * pulse}
    data = xarray.Dataset(
        {name: (("time", "point"), values, {"units": "m/s", "long_name": name}) for name, values in parts.items()}
        | {axis: ("point", column, {"units": "m"}) for axis, column in zip("xyz", points, strict=True)},
        {"time": ("time", time, {"units": "s"})},
    )  # fmt: skip
    data.to_netcdf(path, group="ground", engine="h5netcdf")


def write_cracks(path: Path, failed: int) -> None:
    """Add facets to a run, three or as many as have failed, the first in tension, and an edge that was pulled.

    Every second event radiates nothing; energies of the others fall by three decades, again and again.
    """
    facets = max(failed, 3)
    triple = 1e-3 * np.array([[[0, 0], [10, 0]], [[10, 0], [10, 10]], [[0, 0], [10, 10]]], dtype=float)
    shift = 1e-2 * np.array([[number // 3 % 8, number // 24] for number in range(facets)], dtype=float)
    ends = triple[np.arange(facets) % 3] + shift[:, None]
    time = np.array([1e-6, 2e-6])
    with h5py.File(path / "cracks.h5", "w") as file:
        file.attrs["bodies"], file["bodies"] = ["rock"], np.zeros((facets, 2), dtype=np.int32)
        file.attrs["c_s_of_bodies"], file.attrs["c_R_of_bodies"] = [1253.0], [1174.0]  # of Homalite
        file["points"], file["lines"] = ends.reshape(-1, 2), np.arange(2 * facets).reshape(-1, 2)
        file["length"] = np.hypot(*(ends[:, 1] - ends[:, 0]).T)
        status = np.where(np.arange(facets) < failed, 2, 0)
        file["time"], file["status"] = time, np.array([np.minimum(status, 1), status], dtype=np.int8)
    number = np.arange(failed)
    middle, modes = ends.mean(axis=1)[:failed], np.array(["tensile", "shear"] * failed, dtype=object)[:failed]
    along = (ends[:, 1] - ends[:, 0])[:failed]
    when = np.where(number < 2, 1e-6 * (1 + number), 2e-6 + 1e-8 * number)
    numbers = {
        "x": middle[:, 0], "y": middle[:, 1], "time": when, "time_of_failure": when,
        "energy": np.where(number % 2, 0.0, 1e-6 * 10.0 ** (-0.1 * (number % 30))),
        "inclination": np.degrees(np.arctan2(along[:, 1], along[:, 0])) % 180, "length": np.hypot(*along.T),
    }  # fmt: skip
    columns = {**{name: ("event", values) for name, values in numbers.items()}, "mode": ("event", modes)}
    xarray.Dataset(columns).to_netcdf(path / "events.h5", engine="h5netcdf")
    rows = ["time,rock.top.displacement_y,rock.top.force_y", "0.0,0.0,0.0", "1e-6,1e-6,5e4", "2e-6,2e-6,1e4"]
    (path / "edges.csv").write_text("\n".join(rows) + "\n")
