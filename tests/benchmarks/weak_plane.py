"""A specimen under pressure slides along a weak plane: its strength after Jaeger.

    sigma_1 = sigma_3 + 2 (c + mu sigma_3) / ((1 - mu cot beta) sin 2 beta)

with the cohesion c, the friction mu and the angle beta between the plane and the horizontal; sigma_1 is vertical. The
plane is a joint of an irregular mesh, whose other facets do not fail; the ends are free to move sideways. The cohesion
weakens over 50 mm of slip, so that it is whole at the strength. Without cohesion the plane is an old crack.
"""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from benchmarks._broken import broken, rigid
from ruptfx.app.bench import Check, Outcome
from ruptfx.case import Case

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ruptfx.platform.fem import MPI

BETA, MU = np.deg2rad(60), 0.6
WIDTH, HEIGHT = 40e-3, 80e-3
SETTLED = 0.15e-3  # s, in which the pressure is applied
SPEED = 0.15  # m/s, of the ends towards each other
WEAKENING = 50e-3  # m of slip; a thousandth of it is used


def strength(c: float, pressure: float) -> float:
    """Return sigma_1 [Pa]."""
    return float(pressure + 2 * (c + MU * pressure) / ((1 - MU / np.tan(BETA)) * np.sin(2 * BETA)))


def curve(
    c: float, pressure: float, size: float, alpha: float, kind: str = "intrinsic"
) -> tuple[np.ndarray, np.ndarray, Check]:
    """Return strain and axial stress [Pa], and the energy check."""
    strong = {"kind": "linear", "f_t": 1e9, "c": 1e9, "G_Ic": 1e6, "G_IIc": 1e6}
    bond = {"kind": "linear", "f_t": 20e6, "c": c, "G_Ic": 1e3, "G_IIc": 0.5 * c * WEAKENING} if c else None
    across, along = 0.5 * WIDTH, 0.5 * WIDTH * float(np.tan(BETA))
    case = Case.model_validate({
        "plane": "strain", "order": 1,
        "duration": SETTLED + 1.6 * HEIGHT * strength(c, pressure) / 50e9 / SPEED,
        "mesh": {
            "kind": "specimen", "shape": {"kind": "rectangle", "width": WIDTH, "height": HEIGHT}, "element_size": size,
            "joints": {"plane": [-across, -along, across, along]},
        },
        "materials": {"default": {
            "kind": "isotropic_elastic", "young_modulus": 50e9, "poisson_ratio": 0.25, "density": 2600.0,
        }},
        "fracture": {
            "kind": "intrinsic", "stiffness_ratio": alpha,
            "default": {"cohesion": strong, "friction": {"kind": "coulomb", "mu_d": MU}},
            "joints": {"plane": {"cohesion": bond, "friction": {"kind": "coulomb", "mu_d": MU}}},
        },
        "damping": {"mass": 2e3, "kelvin_voigt": {"fraction": 0.1}},
        "boundaries": [
            *({
                "kind": "driven", "edge": f"specimen.{edge}", "component": "y", "velocity": sign * 0.5 * SPEED,
                "ramp": SETTLED,
            } for edge, sign in (("top", -1), ("bottom", 1))),
            *({
                "kind": "traction", "edge": f"specimen.{edge}", "traction": [sign * pressure, 0.0],
                "ramp": 0.5 * SETTLED,
            } for edge, sign in (("left", 1), ("right", -1))),
        ],
    })  # fmt: skip
    found = broken(rigid(case) if kind == "extrinsic" else case)
    force = 0.5 * (found.edges["specimen.bottom.force_y"] - found.edges["specimen.top.force_y"])
    moved = found.edges["specimen.bottom.displacement_y"] - found.edges["specimen.top.displacement_y"]
    return moved / HEIGHT, force / WIDTH, found.budget()


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    del comm
    size, alpha = (2e-3, 50.0) if fine else (4e-3, 30.0)
    checks, curves = [], []
    tried = [(8e6, 0.0), (8e6, 5e6), (0.0, 5e6)]
    for kind, (c, pressure) in product(("intrinsic", "extrinsic"), tried):
        strain, stress, budget = curve(c, pressure, size, alpha, kind)
        late = stress[int(0.75 * len(stress)) :]  # several passages of the waves that sliding sends out
        known = strength(c, pressure)
        laws = f"c = {c / 1e6:g}, sigma_3 = {pressure / 1e6:g} MPa"
        checks += [
            Check(
                f"{kind}, {laws}: stress while it slides",
                known,
                float(late.mean()),
                0.01,
                "Pa",
                "Jaeger (1960)",
                relative=True,
            ),
            budget,
        ]
        curves.append((kind, laws, strain, stress, known))
    return Outcome(checks, lambda: _draw(curves))


def _draw(curves: list[tuple[str, str, np.ndarray, np.ndarray, float]]) -> Figure:
    from ruptfx.results.figure_style import new_figure

    figure, axes = new_figure(1, 2, 3.0, 7)
    for ax, chosen in zip(axes[0], ("intrinsic", "extrinsic"), strict=True):
        of_kind = [curve for curve in curves if curve[0] == chosen]
        for number, (_, laws, strain, stress, known) in enumerate(of_kind):
            ax.plot(100 * strain, stress / 1e6, f"C{number}", lw=1, label=laws)
            ax.axhline(known / 1e6, color=f"C{number}", ls=":", lw=0.8)
        ax.set(xlabel="Strain (%)", title=chosen)
    axes[0, 0].set_ylabel("Axial stress (MPa)")
    axes[0, 1].legend(frameon=False, fontsize=7)
    return figure
