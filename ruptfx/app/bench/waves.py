"""Wave speeds, Rayleigh and generalized Rayleigh roots: closed forms against published constants.

Homalite-100 in plane stress: Coker, Lykotrafitis, Needleman, Rosakis (2005). Two bodies of 5.3 and 3.392 GPa:
Di Bartolomeo, Massi, Meziane, Baillet, Culla (2010), speeds from their constants. PMMA: Svetlizky, Bayart, Fineberg
(2019), near-tip functions of mode II.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ruptfx.app.bench import Check, Outcome
from ruptfx.laws import fracture
from ruptfx.laws.materials.isotropic_elastic import IsotropicElastic

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ruptfx.platform.fem import MPI

HOMALITE = IsotropicElastic(young_modulus=5.3e9, poisson_ratio=0.35, density=1246.0)
TOP = IsotropicElastic(young_modulus=5.3e9, poisson_ratio=0.25, density=1246.0)
BOTTOM = IsotropicElastic(young_modulus=3.392e9, poisson_ratio=0.25, density=1246.0)
PMMA = IsotropicElastic(young_modulus=5.65e9, poisson_ratio=0.33, density=1180.0)
FRACTIONS = (0.1, 0.3, 0.5, 0.7, 0.9)


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    del fine, comm
    checks = []
    for name, material, plane, expected in (
        ("Homalite, plane stress", HOMALITE, "stress", (2201.7, 1255.2, 1155.9)),
        ("top, plane strain", TOP, "strain", (2259.3, 1304.4, 1199.3)),
        ("bottom, plane strain", BOTTOM, "strain", (1807.4, 1043.5, 959.4)),
        ("PMMA, plane strain", PMMA, "strain", (2663.5, 1341.7, 1250.5)),
    ):
        speeds = material.wave_speeds(plane)  # type: ignore[arg-type]
        for label, value, result in zip(("c_p", "c_s", "c_R"), expected, speeds, strict=True):
            checks.append(Check(f"{name}: {label}", value, result, 0.1, "m/s", "published constants"))
    moduli = [TOP.shear_modulus, BOTTOM.shear_modulus]
    for plane, value in (("strain", 1036.2), ("stress", 1031.3)):
        pair = [material.wave_speeds(plane) for material in (TOP, BOTTOM)]  # type: ignore[arg-type]
        root = fracture.generalized_rayleigh_speed(pair, moduli)
        quantity = f"generalized Rayleigh, plane {plane}"
        checks.append(Check(quantity, value, root or np.nan, 0.1, "m/s", "Weertman (1963)"))
    same = fracture.generalized_rayleigh_speed([pair[0]] * 2, [moduli[0]] * 2)
    checks.append(Check("generalized Rayleigh, equal bodies", pair[0].c_R, same or np.nan, 0.1, "m/s", "c_R"))
    c_p, c_s, c_R = PMMA.wave_speeds("strain")
    for fraction, A, g in zip(
        FRACTIONS, (1.0031, 1.0299, 1.0957, 1.2522, 1.9507), (0.9321, 0.8053, 0.6815, 0.5429, 0.3201), strict=True
    ):
        v, source = fraction * c_R, "Freund (1990)"
        checks.append(Check(f"A_II at {fraction} c_R", A, fracture.A_II(v, c_p, c_s), 1e-4, "1", source))
        checks.append(Check(f"g_II at {fraction} c_R", g, fracture.g_II(v, c_p, c_s, c_R), 1e-4, "1", source))
    return Outcome(checks, _draw)


def _draw() -> Figure:
    from ruptfx.results.figure_style import new_figure

    c_p, c_s, c_R = PMMA.wave_speeds("strain")
    v = np.linspace(0.001, 0.99, 200) * c_R
    figure, ((left, right),) = new_figure(1, 2, 3.2, 8)
    left.plot(v / c_R, [fracture.A_II(x, c_p, c_s) for x in v], label="$A_{II}$")
    left.plot(v / c_R, [fracture.g_II(x, c_p, c_s, c_R) for x in v], label="$g_{II}$")
    left.set(xlabel="speed / $c_R$", ylim=(0, 5))
    left.legend(frameon=False)
    right.plot([fracture.half_length_at(x, c_p, c_s) for x in v], v / c_R)
    right.set(xlabel="half-length / critical half-length", ylabel="speed / $c_R$", xlim=(0, 8))
    return figure
