"""A population of creeping asperities that are replaced with slip: rate-and-state friction as a collective effect."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
import xarray
from pydantic import Field

from ruptfx import Table
from ruptfx.input.schema import Unit
from ruptfx.input.units import Duration, Length, Positive, Speed, Strength
from ruptfx.laws.friction.rate_and_state_ageing import RateAndStateAgeing
from ruptfx.laws.friction.rate_and_state_base import RateAndState
from ruptfx.laws.friction.rate_and_state_slip import RateAndStateSlip
from ruptfx.lumped import LumpedModel, Progress, silent, variable
from ruptfx.lumped.asperity_population.law_fit import Trace
from ruptfx.lumped.asperity_population.population import Asperity, Population

SLACK = 1e-9  # of distance and hold: whether a sum of steps has reached them must not depend on its rounding
LAWS: dict[str, type[RateAndState]] = {"ageing": RateAndStateAgeing, "slip": RateAndStateSlip}


class AsperityPopulation(LumpedModel):
    """Asperities that creep under one load and last for some slip: velocity steps, a hold, and fitted laws.

    No single asperity weakens with velocity: its shear strength grows with it. The population does: asperities that
    last longer have crept further, so that more of them touch. The idea is from Hulikal, Bhattacharya and Lapusta
    (2015), Collective behavior of viscoelastic asperities as a model for static and kinetic friction; how an asperity
    creeps (see `ruptfx/lumped/asperity_population/population.py`) is our own choice.
    """

    example: ClassVar[str] = (
        "asperities = 1000\nnormal_force = 2.5\nspeeds = [1e-6, 1e-5]\ndistance = 5.0\nhold = 10.0\nstep = 0.1"
    )

    asperities: Annotated[int, Field(ge=100, le=10_000_000)] = 6000
    """Number of asperities; fewer are in contact."""
    normal_force: Annotated[Positive, Unit("N")] = 15.0
    """W; the friction coefficient does not depend on it."""
    stiffness: Annotated[Positive, Unit("N/m")] = 5e4
    """Stiffness of an asperity."""
    activation_force: Annotated[Positive, Unit("N")] = 0.5e-3
    """f_0: creep is r sinh(force / f_0)."""
    creep_rate: Annotated[Positive, Unit("m/s")] = 1e-18
    """Creep rate r."""
    height_scale: Length = 1e-6
    """Standard deviation of the heights, which are exponentially distributed."""
    tip_radius: Length = 10e-6
    """R: a contact has the area pi R times the height that is above the other surface."""
    shear_strength: Strength = 120e6
    """Shear strength of a contact per real area, at the first of `speeds`."""
    shear_strengthening: Annotated[float, Field(gt=0, lt=1)] = 0.02
    """Relative increase of the shear strength of a contact per e-fold of the slip rate."""
    mean_length: Length = 0.4e-6
    """Mean slip after which an asperity is replaced by a new one."""
    length_shape: Annotated[float, Field(ge=0.1, le=1000)] = 1.0
    """Shape of the gamma distribution of these lengths: 1 is exponential, large is one length."""
    speeds: Annotated[list[Speed], Field(min_length=2, max_length=100)] = [1e-6, 1e-5, 1e-6, 1e-4, 1e-6]
    """Slip rates, one after the other."""
    distance: Annotated[float, Field(ge=1, le=1000)] = 15.0
    """Slip at each of them, and before the first, over `mean_length`."""
    hold: Duration = 1e5
    """Duration of the hold after the last slip rate."""
    step: Annotated[float, Field(ge=1e-4, le=0.2)] = 0.02
    """Slip of a time step over `mean_length`, and the largest growth of a contact's time in a step of the hold."""
    seed: Annotated[int, Field(ge=0)] = 1
    """Seed of the random draws."""

    @property
    def asperity(self) -> Asperity:
        """Constants of every asperity."""
        return Asperity(
            self.stiffness,
            self.activation_force,
            self.creep_rate,
            self.height_scale,
            self.mean_length,
            self.length_shape,
        )

    def coefficient(self, area_height: float, slip_rate: object) -> np.ndarray:
        """Return the friction coefficient, with the direct effect of `RateAndState` on the real contact area."""
        alpha = self.shear_strengthening
        rate = np.arcsinh(np.asarray(slip_rate) / (2 * self.speeds[0]) * np.exp(1 / alpha))
        pressure = self.normal_force / (np.pi * self.tip_radius * area_height)
        result: np.ndarray = alpha * self.shear_strength * rate / pressure
        return result

    def steady(self, slip_rate: float) -> float:
        """Return the friction coefficient of an infinite population in steady sliding, by quadrature."""
        area_height = self.normal_force * self.height_scale / self.asperity.mean_force(slip_rate)
        return float(self.coefficient(area_height, slip_rate))

    def run(self, progress: Progress = silent) -> xarray.Dataset:
        population = Population(self.asperity, self.asperities, self.normal_force, self.seed)
        total = len(self.speeds) + 2
        rows: list[tuple[float, ...]] = []
        for number, speed in enumerate([self.speeds[0], *self.speeds]):
            progress(number / total, f"slip rate {speed:g} m/s")
            segment = self._slide(population, speed, self.speeds[max(number - 2, 0)])
            rows += segment if number else []  # the first segment only removes the effect of the initial state
        progress((total - 1) / total, f"hold of {self.hold:g} s")
        after_hold = self._stand(population)
        trace = Trace(*np.array(rows).T[:3])
        return self._dataset(np.array(rows).T, trace, np.array(after_hold).T)

    def _slide(self, population: Population, speed: float, before: float) -> list[tuple[float, ...]]:
        """Return rows of duration, slip rate, friction, mean age and contacts, with short steps after a faster rate."""
        longest, slipped = self.step * self.mean_length / speed, 0.0
        rows: list[tuple[float, ...]] = []
        dt = min(longest, self.step * self.mean_length / before)
        while slipped < self.distance * self.mean_length * (1 + SLACK):
            population.advance(speed, dt)
            slipped += speed * dt
            friction = float(self.coefficient(population.area_height(), speed))
            rows.append((dt, speed, friction, population.mean_age(), float((population.pressed() > 0).sum())))
            dt = min(longest, dt * (1 + self.step))
        return rows

    def _stand(self, population: Population) -> list[tuple[float, float]]:
        """Return rows of time at rest, and of the static friction at the first slip rate."""
        dt, time, rows = self.step * self.mean_length / self.speeds[-1], 0.0, []
        while time < self.hold * (1 - SLACK):
            dt = min(dt, self.hold - time)
            population.advance(0.0, dt)
            time += dt
            rows.append((time, float(self.coefficient(population.area_height(), self.speeds[0]))))
            dt = max(dt, self.step * time)
        return rows

    def _dataset(self, rows: np.ndarray, trace: Trace, after_hold: np.ndarray) -> xarray.Dataset:
        duration, speed, friction, age, contacts = rows
        guess = self.shear_strengthening * friction[0]
        fields: Table = {
            "slip": variable("sample", np.cumsum(duration * speed), "m", "slip"),
            "slip_rate": variable("sample", speed, "m/s", "slip rate"),
            "friction": variable("sample", friction, "1", "friction coefficient"),
            "mean_age": variable("sample", age, "s", "mean age of the contacts"),
            "contacts": variable("sample", contacts, "1", "number of contacts"),
            "static_friction": variable("hold", after_hold[1], "1", "friction coefficient after a hold"),
            "steady_friction": variable(
                "speed", [self.steady(v) for v in sorted(set(self.speeds))], "1", "steady friction, infinite population"
            ),
        }
        for name, cls in LAWS.items():
            start = cls(a=guess, b=guess, D_c=self.mean_length, f_0=float(friction[0]), V_0=self.speeds[0])
            law, misfit = trace.fit(start)
            predicted, theta = trace.predicted(law)
            one = np.ones(())
            waited = law.advance({"theta": theta[-1] * one}, 0 * one, one, after_hold[0])
            after = law.strength(self.speeds[0] * one, one, waited) * np.ones(len(after_hold[0]))
            fields |= {
                f"{name}_law": variable("sample", predicted, "1", f"friction of the {name} law"),
                f"{name}_theta": variable("sample", theta, "s", f"theta of the {name} law"),
                f"{name}_hold": variable("hold", after, "1", f"friction of the {name} law after a hold"),
                f"{name}_misfit": variable((), misfit, "1", f"RMS misfit of the {name} law"),
                f"{name}_a": variable((), float(law.a), "1", f"a of the {name} law"),
                f"{name}_b": variable((), float(law.b), "1", f"b of the {name} law"),
                f"{name}_D_c": variable((), float(law.D_c), "m", f"D_c of the {name} law"),
            }
        late = after_hold[0] > after_hold[0][-1] / 1e3
        slope = np.polyfit(np.log(after_hold[0][late]), after_hold[1][late], 1)[0]
        fields["healing"] = variable((), slope, "1", "static friction per e-fold of hold, last three decades")
        coords = {
            "time": variable("sample", np.cumsum(duration), "s", "time"),
            "hold": variable("hold", after_hold[0], "s", "duration of the hold"),
            "speed": variable("speed", sorted(set(self.speeds)), "m/s", "slip rate"),
        }
        return xarray.Dataset(fields, coords, {"length_shape": self.length_shape, "seed": self.seed})
