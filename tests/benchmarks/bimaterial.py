"""Different materials: a pulse in the slip direction of the slower body, and its dependence on the mesh.

Two bodies whose shear speeds differ by 20 %, Coulomb friction, uniform stress just below sliding, friction dropped in
a small patch (Andrews and Ben-Zion 1997; Cochard and Rice 2000). Between such bodies plain Coulomb friction has no
solution (Ranjith and Rice 2001): refining the mesh changes the pulse. A memory of the normal stress over a slip L_p
that the mesh resolves removes that. The patch ends at corners of elements on every mesh: one that ends inside an
element is a node wider on one mesh than on another, and the pulse shows it. The memory is as long as these meshes
resolve: with half of it the slip still agrees, the peak grows by 12 % from 40 to 20 um and by 9 % from 20 to 10 um.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from benchmarks._cases import table_of
from ruptfx import Table
from ruptfx.app.bench import Check, Outcome
from ruptfx.app.bench._rupture import Rupture, rupture
from ruptfx.laws import fracture

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ruptfx.platform.fem import MPI

TABLE = table_of("bimaterial")
SIGMA = TABLE["faults"]["main"]["initial_stress"]["normal"]
PATCH = TABLE["faults"]["main"]["nucleation"]["half_width"]  # m
MEMORY = TABLE["faults"]["main"]["friction"]
COULOMB = MEMORY["law"]
FRICTION = COULOMB["mu_d"]
SLOWER = -1  # slip = u(plus) - u(minus): with positive shear the lower, slower body slides to the left


def case(spacing: float, law: Table, duration: float = 5.5e-6) -> Table:
    """Return the case with nodes `spacing` [m] apart."""
    table = table_of("bimaterial")
    table["mesh"]["element_size"] = 4 * spacing
    table["faults"]["main"]["friction"] = law
    return {**table, "duration": duration}


def generalized_rayleigh(result: Rupture) -> float:
    """Return the generalized Rayleigh speed of the two bodies [m/s]."""
    materials = result.model.materials
    speeds = [m.wave_speeds("strain") for m in materials]
    moduli = [m.density * s.c_s**2 for m, s in zip(materials, speeds, strict=True)]
    return fracture.generalized_rayleigh_speed(speeds, moduli) or np.nan


def pulse(result: Rupture, side: int) -> tuple[float, float, float]:
    """Return the speed of the peak between 2 and 4 mm, and the peak rates at 1 and 3 mm from the centre [m/s]."""
    x = side * result.position
    rate = np.abs(result.slip_rate)
    part = (x > 2e-3) & (x < 4e-3) & (rate.max(axis=0) > 0.05)
    when = result.time[rate.argmax(axis=0)]
    speed = float(np.polyfit(when[part], x[part], 1)[0]) if part.sum() > 5 else np.nan
    peaks = [float(rate[:, int(np.argmin(np.abs(x - d)))].max()) for d in (1e-3, 3e-3)]
    return speed, peaks[0], peaks[1]


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    del comm
    spacings = (2e-5, 1e-5) if fine else (4e-5, 2e-5)
    runs = {name: [rupture(case(h, law)) for h in spacings] for name, law in (("memory", MEMORY), ("Coulomb", COULOMB))}
    finest = runs["memory"][1]
    speed, _, peak = pulse(finest, SLOWER)
    _, near, far = pulse(finest, -SLOWER)
    other = [pulse(r, SLOWER)[2] for r in runs["memory"]]
    plain = [pulse(r, SLOWER)[2] for r in runs["Coulomb"]]
    there = SLOWER * 2e-3
    slips = [float(np.interp(there, r.position, np.abs(r.fields["slip"]))) for r in runs["memory"]]
    behind = np.abs(finest.slip_rate[-1, finest.at(there)])
    checks = [
        Check("pulse to the slower side's slip direction", generalized_rayleigh(finest), speed, 0.03, "m/s",
              "generalized Rayleigh speed", relative=True),
        Check("slip rate behind it over its peak", 0.0, behind / peak, 0.05, "1", "self-healing"),
        Check("other direction: peak at 3 mm over that at 1 mm", 1.0, far / near, 0, "1", "decays", "at most"),
        Check("memory: change of the peak with half the spacing", 0.0, abs(other[1] / other[0] - 1), 0.1, "1",
              "Cochard and Rice (2000)"),
        Check("memory: change of the slip at 2 mm", 0.0, abs(slips[1] / slips[0] - 1), 0.02, "1", "mesh-independent"),
        Check("plain Coulomb: change of the peak", 0.1, abs(plain[1] / plain[0] - 1), 0, "1", "ill-posed", "at least"),
        *(result.budget() for pair in runs.values() for result in pair),
    ]  # fmt: skip
    return Outcome(checks, lambda: _draw(runs, spacings))


def _draw(runs: dict[str, list[Rupture]], spacings: tuple[float, ...]) -> Figure:
    from ruptfx.results.figure_style import new_figure

    figure, (axes,) = new_figure(1, 3, 3.2, 11)
    finest = runs["memory"][1]
    x = finest.position * 1e3
    some = np.abs(finest.slip_rate[::10, ::2])
    mesh = axes[0].pcolormesh(x[::2], finest.time[::10] * 1e6, some, cmap="magma", vmax=2)
    figure.colorbar(mesh, label="slip rate (m/s)", extend="max")
    axes[0].set(xlabel="x (mm)", ylabel="time (µs)", xlim=(-6, 6))
    for ax, (name, pair) in zip(axes[1:], runs.items(), strict=True):
        for result, spacing in zip(pair, spacings, strict=True):
            at = result.at(SLOWER * 3e-3)
            label = f"nodes {spacing * 1e6:.0f} um apart"
            ax.plot(result.time * 1e6, np.abs(result.slip_rate[:, at]), lw=1, label=label)
        ax.set(xlabel="time (µs)", ylabel="slip rate at -3 mm (m/s)", title=name, xlim=(0, 5.5))
        ax.legend(frameon=False, loc="upper left", fontsize=8)
    return figure
