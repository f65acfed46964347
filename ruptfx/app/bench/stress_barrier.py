"""A front runs into a stress barrier: its speed and arrest position against the equation of motion.

The crack of `demos/stress_barrier.toml` has one tip, for which the equation is exact until waves come back from the
ends: K = sqrt(2 / pi) int drop(x) / sqrt(l - x) dx at rest, G = g(v) K^2 / E' (Freund 1990, section 7.4). Linear slip
weakening, whose process zone is 1.5 mm at rest, so that the place of the tip is known to that.

With two tips (`--fine`) it is checked before the barrier. In the barrier shear waves that the other tip sent out when
it began catch up with the front and carry it beyond the length at which a crack at rest has too little energy: that row
is a bound, as there is no closed form for what they carry.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ruptfx.app.bench import Check
from ruptfx.app.bench._rupture import Rupture, rupture
from ruptfx.case import Case, read_case
from ruptfx.input.profiles import evaluate
from ruptfx.laws import fracture
from ruptfx.laws.materials.isotropic_elastic import IsotropicElastic
from ruptfx.laws.nucleation.forced_rupture import ForcedRupture
from ruptfx.results.analysis.front import fit_speed
from ruptfx.results.analysis.front_motion import FrontMotion, Shape, front_motion
from ruptfx.results.analysis.near_tip import Medium

if TYPE_CHECKING:
    from ruptfx.platform.fem import MPI

Array = np.ndarray

BARRIER = 30e-3  # m, from where it is
MU_D, SIGMA, STRENGTH, D_C = 0.2, 5e6, 0.62 * 5e6, 1.6129e-6  # of the demo; Pa, Pa above the residual stress, m
REACH = 2e-3  # m, on either side of a place, of lines through arrivals
OWN = 4e-3  # m beyond the forced part, three process zones: start of the comparison of speeds
SLIDES = 1e-3  # m/s
FREUND = "Freund (1990)"


def one_tip(*overrides: str) -> Case:
    """Return the case of the demo."""
    case = read_case(Path(str(files("ruptfx").joinpath("demos/stress_barrier.toml"))), overrides=overrides)
    assert isinstance(case, Case)
    return case


def two_tips(*overrides: str) -> Case:
    """Return the same barrier on both sides of a patch of 60 mm; only the right half is modelled."""
    middle = "{kind='driven', edge='upper.left', component='y', velocity=0.0}"
    return one_tip(
        "mesh.left=0.0", "mesh.length=0.13", "mesh.height=0.13", f"boundaries.0={middle}", "duration=120e-6",
        "faults.main.nucleation.0.radius=6.5e-3", *overrides,
    )  # fmt: skip


def medium(case: Case) -> Medium:
    """Return elastic constants and wave speeds of the material."""
    material = case.materials["default"]
    assert isinstance(material, IsotropicElastic)
    return Medium.of(material, case.plane)


def forced(case: Case) -> float:
    """Return the position up to which the front is forced [m]."""
    start = case.faults["main"].nucleation[0]
    assert isinstance(start, ForcedRupture)
    return start.radius


def predicted(case: Case, shape: Shape) -> FrontMotion:
    """Return the equation of motion of a case, from the end of forcing on."""
    stress = case.faults["main"].initial_stress
    return front_motion(
        np.linspace(forced(case), 80e-3, 2000), stress_drop=lambda x: evaluate(stress.shear, x) - MU_D * SIGMA,
        fracture_energy=lambda x: np.full_like(x, 0.5 * STRENGTH * D_C), medium=medium(case), shape=shape,
    )  # fmt: skip


@dataclass(frozen=True)
class Front:
    """Front of a run.

    Attributes
    ----------
    place, speed : ndarray, shape (n,)
        Position [m] and speed [m/s] of the front beyond the forced part.
    time : ndarray, shape (n,)
        Arrival at these positions, counted from the end of forcing [s].
    stopped : float
        Arrest position [m].
    """

    place: Array
    speed: Array
    time: Array
    stopped: float

    @classmethod
    def of(cls, case: Case, position: Array, arrival: Array) -> Front:
        """Return the front from the times of first slip, NaN where there is none."""
        radius = forced(case)
        own = (position > radius) & np.isfinite(arrival)
        position, arrival = position[own], arrival[own]
        place = np.arange(radius + 1.25 * REACH, position[-1] - 0.5 * REACH, 1e-3)
        speed = [fit_speed(position, arrival, x - REACH, x + REACH).value for x in place]
        return cls(place, np.array(speed), np.interp(place, position, arrival) - arrival[0], float(position[-1]))

    def caught_up(self, case: Case) -> float:
        """Return where shear waves from the start of the other tip of a bilateral crack reach it [m]."""
        late = self.time > (self.place + forced(case)) / medium(case).c_s
        return float(self.place[np.argmax(late)]) if late.any() else np.inf


def _front(case: Case) -> tuple[Front, Rupture]:
    result = rupture(case.model_dump(exclude_none=True), stride=2)
    return Front.of(case, result.position, result.rupture_time(SLIDES)), result


def _worst(front: Front, theory: FrontMotion, until: float) -> float:
    """Return the largest speed difference [m/s], without the surroundings of the stress jump."""
    there = (front.place > theory.length[0] + OWN) & (front.place < until) & (abs(front.place - BARRIER) > 1.5 * REACH)
    return float(np.abs(front.speed - np.interp(front.place, theory.length, theory.speed))[there].max())


def run(fine: bool, comm: MPI.Comm) -> list[Check]:
    del comm
    case = one_tip("mesh.element_size=0.5e-3") if fine else one_tip()
    theory, c_R = predicted(case, "one tip"), medium(case).c_R
    front, result = _front(case)
    zone = fracture.static_process_zone(0.5 * medium(case).modulus, D_C, STRENGTH)
    checks = [
        Check("one tip: stops at", theory.arrest, front.stopped, zone, "m", FREUND),
        Check("one tip: largest |v - theory|", 0.0, _worst(front, theory, theory.arrest - zone) / c_R, 0.05, "c_R",
              FREUND),
        result.budget(),
    ]  # fmt: skip
    if fine:
        case = two_tips()
        theory, (front, _) = predicted(case, "bilateral"), _front(case)
        checks += [
            Check("two tips: largest |v - theory| before the barrier", 0.0, _worst(front, theory, BARRIER) / c_R, 0.05,
                  "c_R", FREUND),
            Check("two tips: stops at, over what energy at rest is enough for", 1.0, front.stopped / theory.arrest, 0,
                  "1", "waves of the other tip", "at least"),
        ]  # fmt: skip
    return checks
