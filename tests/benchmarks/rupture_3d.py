"""Circular shear cracks in a full space: one that grows at constant speed, and one at rest, nu = 1/4.

- Growing at speed v under a stress drop d: slip = C d / mu sqrt((v t)^2 - r^2) along the drop, none across it. C is
  1.0142 at 0.5 c_s and 0.9117 at 0.9 c_s, an integral over the wavenumber, which a convolution in time agrees with to
  3e-7. As in two dimensions (`self_similar`) the strength drops within the time in which the front passes one node
  spacing, so that the error is of first order in the spacing: checked are its decrease, and C extrapolated from two
  meshes. On the coarse meshes alone C is 2 and 3 % too small and would miss the bar of 2 %; with `--fine` C on the
  finer mesh is checked, too. Source: Kostrov (1964).
- At rest, radius a: slip = 24 / (7 pi) d / mu sqrt(a^2 - r^2), moment 16/7 d a^3, in one quasi-static step, on elements
  that grow away from the crack. The rim runs in stairs between the nodes, and the radius of the crack on the mesh
  depends on how they lie: the mean slip is 1.0 % too large with elements of 0.3125 a, 0.04 % with those of 0.25 a, and
  0.9 % too small with those of 0.156 a. The result is known to 1 %; that it is closer on the mesh used here is chance.
  Source: Eshelby (1957).

Both are an eighth of the problem: the crack is a plane of antisymmetry, and so is the plane x = 0 normal to the drop.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from benchmarks.waves_3d import corner, fixed
from ruptfx import Table, fem
from ruptfx.bench import Check, Outcome
from ruptfx.bench._rupture import elastic
from ruptfx.case import Case
from ruptfx.meshes import MeshSource, RawMesh
from ruptfx.meshes._lattice import row_levels
from ruptfx.model import Model
from ruptfx.units import Length

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ruptfx.fem import MPI

Array = np.ndarray

C_S, C_P, RHO = 1000.0, np.sqrt(3) * 1000.0, 2000.0
MU = RHO * C_S**2
DROP, SIGMA = 1e6, 10e6
REACH = 0.6  # m, radius of the growing crack at the end
FACTOR = {0.5: 1.01419822, 0.9: 0.91168368}
"""C by speed over c_s."""
AT_REST, MOMENT = 24 / (7 * np.pi), 16 / 7
ORIGIN = {"x": 0.0, "y": 0.0, "z": 0.0}


class Corner(MeshSource):
    """An eighth of a cube around a crack of radius 1 m in the plane y = 0, with elements that grow away from it."""

    size: Length
    """Of elements next to the crack."""
    edge: Length
    """Of the cube."""

    def build(self) -> RawMesh:
        fine = np.arange(round(1.25 / self.size) + 1) * self.size
        along = np.concatenate([fine, fine[-1] + row_levels(self.edge - fine[-1], 1.3 * self.size, 1.3)[1:]])
        planes = along, row_levels(self.edge, self.size, 1.3), along
        points = np.stack([each.ravel() for each in np.meshgrid(*planes, indexing="ij")], axis=1)
        number = np.arange(len(points)).reshape([len(each) for each in planes])

        def corners(block: Array) -> Array:
            """Return the vertices of the elements of a grid, the first index running fastest."""
            cells = [block]
            for axis in reversed(range(block.ndim)):
                low, high = [slice(None)] * block.ndim, [slice(None)] * block.ndim
                low[axis], high[axis] = slice(None, -1), slice(1, None)
                cells = [each[tuple(part)] for part in (low, high) for each in cells]
            order = np.arange(len(cells)).reshape([2] * block.ndim).transpose(*reversed(range(block.ndim))).ravel()
            return np.stack([cells[at].ravel() for at in order], axis=1)

        cells, bottom = corners(number), corners(number[:, 0])
        sides = {"left": number[0], "right": number[-1], "top": number[:, -1], "back": number[:, :, 0],
                 "front": number[:, :, -1]}  # fmt: skip
        return RawMesh(
            cell="hexahedron", points=points, cells=cells, bodies=["upper"], cell_body=np.zeros(len(cells), int),
            edges={f"upper.{name}": corners(side) for name, side in sides.items()},
            interfaces={"main": (bottom, bottom)}, one_sided={"main": "antisymmetric"},
        )  # fmt: skip


def crack(table: Table, friction: Table) -> Table:
    """Return the table with a law and a stress that is the drop above its residual strength, 5 MPa."""
    table["faults"]["main"] |= {
        "initial_stress": {"normal": SIGMA, "shear": 0.5 * SIGMA + DROP}, "friction": friction,
    }  # fmt: skip
    table["boundaries"] = [*fixed("left", "yz"), *fixed("back", "z")]
    return table


def slip_of(table: Table) -> tuple[Array, Array, Array, float, float]:
    """Run a case.

    Returns
    -------
    radius, weight : ndarray, shape (n,)
        [m] and [m2]
    slip : ndarray, shape (n, 2)
        [m]
    time : float
        Of the slip [s].
    closure : float
    """
    case = Case.model_validate(table)
    model = Model(case, fem.MPI.COMM_SELF)
    motion, state = case.stepper.bind(model), model.initial_state()
    while state.time < case.duration:
        motion.step(state)
    fault = model.faults[0]
    face, slip = fault.interface, fault.components(state.faults["main"], "slip")
    energy = model.energies(state)
    work = energy.pop("boundary_work")
    closure = abs(1 - sum(energy.values()) / work)
    return np.hypot(face.points[:, 0], face.points[:, 2]), face.weight, slip, state.fault_time, closure


def growing(fraction: float, spacing: float) -> tuple[float, float, float, Array, Array, Array]:
    """Return C, slip across over slip along, energy closure; radius [m], slip and exact slip [m].

    C is the mean over the inner 80 % of the crack, in which the largest slip across is taken, too.
    """
    speed = fraction * C_S
    duration = REACH / speed
    edge = max(0.5 * C_P * duration, 1.2 * REACH)
    table = corner(4 * spacing, edge, edge, "antisymmetric", duration, elastic(C_P, C_S, RHO))
    arrival = {"kind": "cone", "slope": 1 / speed, "center": ORIGIN}
    crack(table, {
        "kind": "time_weakening", "mu_s": 50.0, "mu_d": 0.5, "arrival": arrival, "t_w": spacing / speed,
    })  # fmt: skip
    table["damping"] = {"kelvin_voigt": {"fraction": 0.1}}
    table["boundaries"] += [{"kind": "absorbing", "edge": f"upper.{name}"} for name in ("right", "top", "front")]
    radius, _, slip, time, closure = slip_of(table)
    shape = DROP / MU * np.sqrt(np.maximum((speed * time) ** 2 - radius**2, 0))
    inner = radius < 0.8 * speed * time
    found = float(np.mean(slip[inner, 0] / shape[inner]))
    across = float(np.abs(slip[inner, 1]).max() / slip[:, 0].max())
    return found, across, closure, radius, slip[:, 0], FACTOR[fraction] * shape


def resting(size: float, edge: float) -> tuple[float, float, float, Array, Array, Array]:
    """Return mean slip over the exact one, moment / (d a^3), energy closure; radius [m], slip and exact slip [m]."""
    table = corner(size, edge, edge, "antisymmetric", 1.0, elastic(C_P, C_S, RHO))
    inside = {"kind": "boxcar", "inside": 0.5, "outside": 50.0, "center": ORIGIN, "half_width": 1.0}
    crack(table, {"kind": "coulomb", "mu_d": inside})
    table |= {"order": 2, "mesh": Corner(size=size, edge=edge)}
    # One step: the slip of 0.5 mm is within its tolerance.
    table["stepper"] = {"kind": "quasi_static", "first_step": 1.0, "largest_step": 1.0, "slip_tolerance": 1e-2}
    for name in ("right", "top", "front"):
        table["boundaries"] += fixed(name, "xyz")
    radius, weight, slip, _, closure = slip_of(table)
    exact = AT_REST * DROP / MU * np.sqrt(np.maximum(1 - radius**2, 0))
    inner = radius < 0.8
    # Four quarters; the weight of a point of a half model is half of its area.
    moment = 8 * MU * float(weight @ slip[:, 0]) / DROP
    return float(np.mean(slip[inner, 0] / exact[inner])), moment, closure, radius, slip[:, 0], exact


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    """Check the slip of both cracks."""
    del comm
    checks, drawn = [], {}
    spacings = {0.5: (0.02, 0.01), 0.9: (0.01, 0.005)} if fine else {0.5: (0.04, 0.02), 0.9: (0.02, 0.01)}
    for fraction, pair in spacings.items():
        name, exact = f"crack at {fraction:g} c_s", FACTOR[fraction]
        coarse, finer = (growing(fraction, spacing) for spacing in pair)
        drawn[name] = finer[3:]
        rows = [
            Check(f"{name}: slip, extrapolated", exact, 2 * finer[0] - coarse[0], 2e-2, "1", "Kostrov (1964)",
                  relative=True),
            Check(f"{name}: error over that of twice the spacing", 0.65, (finer[0] - exact) / (coarse[0] - exact), 0,
                  "1", "first order", "at most"),
            Check(f"{name}: slip across over slip along", 0.0, finer[1], 2e-2, "1", "Kostrov (1964)"),
            Check("energy closure", 0.0, finer[2], 1e-9, "1", "exact"),
        ]  # fmt: skip
        if fine:
            rows.append(Check(f"{name}: slip", exact, finer[0], 2e-2, "1", "Kostrov (1964)", relative=True))
        checks += rows
    mean, moment, closure, *_ = at_rest = resting(0.25, 6.0 if fine else 5.0)
    drawn["crack at rest"] = at_rest[3:]
    checks.append(
        Check("crack at rest: mean slip (1 % between meshes)", 1.0, mean, 1e-2, "of the exact one", "Eshelby (1957)")
    )
    checks.append(Check("crack at rest: moment", MOMENT, moment, 1e-2, "d a^3", "Eshelby (1957)", relative=True))
    checks.append(Check("energy closure", 0.0, closure, 1e-9, "1", "exact"))
    return Outcome(checks, lambda: _draw(drawn))


def _draw(drawn: dict[str, tuple[Array, Array, Array]]) -> Figure:
    from ruptfx.figure_style import new_figure

    figure, (axes,) = new_figure(1, 3, 3.2, 11)
    for ax, (name, (radius, slip, exact)) in zip(axes, drawn.items(), strict=True):
        order = np.argsort(radius)
        ax.plot(radius, 1e3 * slip, ".", ms=2)
        ax.plot(radius[order], 1e3 * exact[order], "k:", lw=1)
        ax.set(xlabel="distance from the middle (m)", title=name, xlim=(0, 1.25 if "rest" in name else 1.2 * REACH))
    axes[0].set_ylabel("slip (mm)")
    return figure
