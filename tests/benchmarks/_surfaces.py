"""Ruptures on surfaces: half models of vertical faults, one run, and comparisons between meshes."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np

from ruptfx import Table
from ruptfx.app.bench import Check
from ruptfx.case import parse_case
from ruptfx.platform import parallel
from ruptfx.results.analysis.surface import SurfaceInterpolation
from ruptfx.run.model import Model

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ruptfx.case import Case
    from ruptfx.platform.fem import MPI

Array = np.ndarray
Places = dict[tuple[float, float], float]

FIELDS = ("rupture_time", "peak_slip_rate", "slip_1", "slip_2", "normal_stress", "opening")


@dataclass(frozen=True)
class Surface:
    """Result of one run, the same on all ranks.

    Attributes
    ----------
    strike, dip : ndarray, shape (n,)
        Positions of the points [m].
    area : ndarray, shape (n,)
        Tributary area [m2].
    fields : dict of ndarray, shape (n,)
        `FIELDS` at the end, `slip_time`, the time at which the slip reaches a value [s], `largest_opening` of all
        times [m], and `plus` and `minus`, how far both sides have moved at the end [m].
    closure : float
        Unaccounted energy over the work of the initial stress.
    steps, nodes : int
    seconds : float
        Processor time of the steps, of one rank.
    """

    strike: Array
    dip: Array
    area: Array
    fields: dict[str, Array]
    closure: float
    steps: int
    nodes: int
    seconds: float

    def at(self, strike: float, dip: float, name: str) -> float:
        """Return a field at the point next to a position."""
        nearest = int(np.argmin(np.hypot(self.strike - strike, self.dip - dip)))
        return float(self.fields[name][nearest])

    def apart(self, finer: Surface, name: str, where: Array | None = None) -> tuple[Array, Array]:
        """Return the difference of a field to that of another mesh, and the areas, of the points that have both."""
        places = np.column_stack([self.strike, self.dip])
        other = _interpolated(finer, places, name)
        difference = self.fields[name] - other
        known = np.isfinite(difference) & (True if where is None else where)
        return difference[known], self.area[known]

    def rms(self, finer: Surface, name: str, where: Array | None = None) -> float:
        """Return the difference of a field to that of another mesh, RMS over the area of the points that have both."""
        difference, area = self.apart(finer, name, where)
        return float(np.sqrt(np.average(difference**2, weights=area))) if len(area) else np.nan


def _interpolated(surface: Surface, places: Array, name: str) -> Array:
    import xarray

    data = xarray.Dataset({"position": ("point", surface.strike), "dip": ("point", surface.dip)})
    return np.asarray(SurfaceInterpolation(data, places[:, 0], places[:, 1])(surface.fields[name]))


def half_model(table: Table) -> Table:
    """Return the case of a vertical fault in a box with only the half `plus`; boundaries of `minus` are left out."""
    kept = [each for each in table["boundaries"] if each["edge"].startswith("plus.")]
    rest = [{"kind": "driven", "edge": "plus.plane", "component": each, "velocity": 0.0} for each in "xz"]
    return {**table, "mesh": {**table["mesh"], "half": True}, "boundaries": kept + rest}


def rupture(table: Table, comm: MPI.Comm, slip: float, fault: str = "main") -> Surface:
    """Run a case in memory.

    Parameters
    ----------
    table : dict
    comm : MPI communicator
    slip : float
        Slip whose time is recorded [m].
    fault : str
        Interface of the result.
    """
    return ruptures(table, comm, slip, [fault])[0]


def ruptures(table: Table, comm: MPI.Comm, slip: float, faults: list[str]) -> list[Surface]:
    """Run a case in memory; return the surfaces of several faults. See `rupture`."""
    parsed = cast("Case", parse_case(table))
    model = Model(parsed, comm)
    motion, state = parsed.stepper.bind(model), model.initial_state()
    chosen = {fault.name: fault for fault in model.faults if fault.name in faults}
    zeros = {name: np.zeros(len(fault.interface.plus)) for name, fault in chosen.items()}
    before, opening = dict(zeros), dict(zeros)
    times = {name: np.full(len(zero), np.nan) for name, zero in zeros.items()}
    steps, begin = 0, time.process_time()
    while state.time < parsed.duration:
        motion.step(state)
        steps += 1
        for name in chosen:
            now = state.faults[name]
            slid = np.hypot(now["slip_1"], now["slip_2"])
            passed = np.isnan(times[name]) & (slid >= slip)
            part = (slip - before[name][passed]) / (slid[passed] - before[name][passed])
            times[name][passed] = state.fault_time - motion.dt * (1 - part)
            before[name], opening[name] = slid, np.maximum(opening[name], now["opening"])
    seconds = time.process_time() - begin
    energies = model.energies(state)
    work = energies.pop("boundary_work")
    closure = abs(work - sum(energies.values())) / work
    moved = np.linalg.norm(state.displacement.reshape(-1, 3), axis=1)
    found = []
    for name in faults:
        face, now = chosen[name].interface, state.faults[name]
        assert face.across is not None, "only surfaces"
        columns = {
            "strike": face.position, "dip": face.across, "area": face.area, "slip_time": times[name],
            "largest_opening": opening[name], "plus": moved[face.plus], "minus": moved[face.minus],
            **{each: np.where(np.isfinite(now[each]), now[each], np.nan) for each in FIELDS},
        }  # fmt: skip
        whole = comm.bcast(parallel.gather_fields(comm, face.number, face.owned, columns), root=0)
        strike, dip, area = (whole.pop(each) for each in ("strike", "dip", "area"))
        found.append(Surface(strike, dip, area, whole, closure, steps, model.total_nodes, seconds))
    return found


def spacing(element_size: float) -> str:
    """Return the name of a mesh of elements of order 4 [m]."""
    return f"nodes {element_size / 4:.0f} m apart"


def budget(surface: Surface, name: str) -> Check:
    """Return the check of the energy closure."""
    return Check(f"energy closure, {name}", 0.0, surface.closure, 1e-12, "1", "exact")


def symmetry(surface: Surface, name: str, places: Places) -> Check:
    """Return the check that slip reaches x and -x at the same time."""
    times = [np.array([surface.at(sign * x, down, "slip_time") for x, down in places]) for sign in (-1, 1)]
    apart = float(np.abs(times[1] - times[0]).max())
    return Check(f"time of slip, largest difference of x and -x, {name}", 0.0, apart, 1e-9, "s", "exact")


def against_published(surface: Surface, name: str, published: Places, bar: float, source: str) -> list[Check]:
    """Return the checks of the times of slip on a mesh against those of another code.

    Parameters
    ----------
    surface : Surface
    name : str
        Name of the mesh.
    published : dict
        Times by position along strike and down dip [m] [s].
    bar : float
        Tolerance on this mesh [s].
    source : str
        Where the times come from.
    """
    return [
        Check(f"time of slip, x = {x / 1e3:g} km, {down / 1e3:g} km down dip, {name}", expected,
              surface.at(x, down, "slip_time"), bar, "s", source)
        for (x, down), expected in published.items()
    ]  # fmt: skip


def draw(runs: dict[str, Surface], title: str, inside: tuple[float, float] = (np.inf, np.inf)) -> Figure:
    """Draw contours of the times of slip on all meshes, where |x| and the distance down dip are within `inside`."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 3.8 * len(runs)), layout="constrained")
    for ax, (name, found) in zip(np.ravel(figure.subplots(len(runs), 1)), runs.items(), strict=True):
        contours(ax, found, "slip_time", 0.5, 12.0, (np.abs(found.strike) <= inside[0]) & (found.dip <= inside[1]))
        ax.set(title=f"{title}, {name}")
    return figure


def contours(ax: Axes, surface: Surface, name: str, interval: float, last: float, where: Array | bool = True) -> None:
    """Draw contours of a time on a surface [s], with labels."""
    known = np.isfinite(surface.fields[name]) & where
    if known.sum() > 3:
        x, y = surface.strike[known] / 1e3, surface.dip[known] / 1e3
        levels = np.arange(interval, last, interval)
        lines = ax.tricontour(x, y, surface.fields[name][known], levels=levels, colors="#1769aa", linewidths=0.8)
        ax.clabel(lines, fmt="%g", fontsize=7)
    ax.set(aspect="equal", xlabel="x (km)", ylabel="down dip (km)")
    ax.invert_yaxis()
