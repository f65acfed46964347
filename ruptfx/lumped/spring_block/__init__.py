"""Spring-block chain with contacts: precursors and slip of a slider pushed at its edge."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
import xarray
from pydantic import Field, model_validator

from ruptfx import RuptfxError
from ruptfx.input.quantities import at_least, at_most
from ruptfx.input.schema import Unit
from ruptfx.input.units import Duration, Fraction, Length, NonNegative, Positive, Rate, Speed
from ruptfx.lumped import LumpedModel, Progress, Summary, silent, variable
from ruptfx.lumped.spring_block.chain import Chain, History, Integrator
from ruptfx.lumped.spring_block.events import (
    Breaks,
    Event,
    before_sliding,
    catalogue,
    chaining,
    length_against_force,
    local_speeds,
    slow_fronts,
)

Count = Annotated[int, Field(ge=1)]


class SpringBlock(LumpedModel):
    """Edge-loaded spring-block chain with breakable contacts: precursors, slow fronts, then sliding.

    Source: Rubinstein, Barel, Reches, Braun, Urbakh, Fineberg (2011), PAGEOPH 168, section 2.2; defaults are its
    values. A block has `contacts` springs to the base, of mean stiffness K_s / contacts; each breaks at a random
    force and reattaches unstretched after `delay`.
    """

    example: ClassVar[str] = "blocks = 6\ncontacts = 10\nlarge_events = 1\nduration = 2.0"

    blocks: Annotated[int, Field(ge=2, le=1000)] = 70
    """Blocks of the chain."""
    contacts: Count = 100
    """Mean number of contacts of a block."""
    mass: Annotated[Positive, Unit("kg")] = 11.5
    """Mass of the slider."""
    stiffness: Annotated[Positive, Unit("N/m")] = 1.56e7
    """Stiffness of the whole slider, K; the springs between blocks have (blocks - 1) K."""
    interface_ratio: Positive = 1.0
    """Stiffness of a block's contacts over that of the slider, K_s / K: 1 is soft, 50 stiff."""
    strength: Annotated[Positive, Unit("N")] = 3000.0
    """Sum of the mean thresholds of all contacts, F_s."""
    scatter: Annotated[float, Field(ge=0, le=0.3)] = 0.05
    """Standard deviation of the thresholds over their mean."""
    delay: Duration = 0.005
    """Time from breaking to reattachment [s]."""
    damping: Rate = 3.45e4
    """Damping force of the base per momentum of a block."""
    drive_stiffness: Annotated[Positive, Unit("N/m")] = 4e6
    """Stiffness of the spring that pushes the first block."""
    drive_speed: Speed = 3e-4
    """Speed of the far end of that spring."""
    ageing: NonNegative = 0.0
    """Thresholds grow with the age t of a contact by the factor 1 + ageing ln(1 + t / ageing_time)."""
    ageing_time: Duration = 1.0
    """Time in which the strength of contacts grows."""
    loading_height: Annotated[NonNegative, Unit("m")] = 0.0
    """Height of the push above the interface: its moment shifts contacts towards the leading edge."""
    length: Length = 0.14
    """Length of the chain."""
    force_over_load: Positive = 0.5
    """Shear force over normal force for which the moment is computed."""
    large_events: Count = 5
    """Number of events with sliding of all blocks after which the run stops."""
    duration: Duration = 20.0
    """Largest duration of the run [s]."""
    large_drop: Fraction = 0.05
    """An event is large if all blocks detach and the force falls by this fraction of F_s."""
    sample_interval: Duration = 1e-3
    """Time between recorded samples."""
    step: Annotated[float, Field(gt=0, le=0.9)] = 0.5
    """Time step over the largest stable one."""
    seed: Annotated[int, Field(ge=0)] = 1
    """Seed of the random numbers."""

    @model_validator(mode="after")
    def _usable(self) -> SpringBlock:
        if abs(self.tilt) >= 0.95:
            raise ValueError(
                f"loading_height = {self.loading_height:g}: the trailing edge would lift off, "
                f"keep it below {at_most(0.95 * self.length / (6 * self.force_over_load), 4)} m"
            )
        if self.sample_interval < self.chain().stable_step():
            raise ValueError(
                f"sample_interval = {self.sample_interval:g} s: must be at least the largest stable step, "
                f"{at_least(self.chain().stable_step(), 4)} s, which follows from masses and stiffnesses"
            )
        return self

    @property
    def tilt(self) -> float:
        """Relative excess of the pressure at the leading edge, 6 (F / F_N) h / L.

        From the balance of moments of a linear pressure.
        """
        return 6 * self.force_over_load * self.loading_height / self.length

    def chain(self) -> Chain:
        """Return the constants of the chain."""
        number = np.rint(self.contacts * (1 + self.tilt * np.linspace(-1, 1, self.blocks))).astype(int)
        return Chain(
            mass=self.mass / self.blocks,
            damping=self.damping,
            spring=(self.blocks - 1) * self.stiffness,
            drive_stiffness=self.drive_stiffness,
            drive_speed=self.drive_speed,
            contacts=np.maximum(number, 1),
            contact_stiffness=self.interface_ratio * self.stiffness / self.contacts,
            contact_strength=self.strength / (self.blocks * self.contacts),
            scatter=self.scatter,
            delay=self.delay,
            ageing=self.ageing,
            ageing_time=self.ageing_time,
        )

    @property
    def chain_speed(self) -> float:
        """Longitudinal wave speed sqrt(K_b / m) [blocks/s]."""
        return float(np.sqrt((self.blocks - 1) * self.stiffness * self.blocks / self.mass))

    @property
    def decay(self) -> float:
        """Ratio q of the static displacements of neighbouring blocks, q + 1/q = 2 + K_s / K_b."""
        ratio = self.interface_ratio / (self.blocks - 1)
        return float(1 + ratio / 2 - np.sqrt(ratio + ratio**2 / 4))

    def run(self, progress: Progress = silent) -> xarray.Dataset:
        chain, history = self.chain(), History()
        stable = chain.stable_step()
        steps = int(np.ceil(self.sample_interval / (self.step * stable) * (1 - 1e-12)))
        integrator = Integrator(chain, self.sample_interval / steps, self.seed)
        events: list[Event] = []
        integrator.sample(history)
        while integrator.time < self.duration * (1 - 1e-12):
            integrator.advance(steps, history)
            integrator.sample(history)
            if not np.isfinite(integrator.x[0]):
                raise RuptfxError(f"the chain became unstable at t = {integrator.time:g} s; reduce step")
            if len(history.time) % 100 == 0:
                events = self._events(chain, history)
                large = [e for e in events if e.large]
                share = max(integrator.time / self.duration, len(large) / (self.large_events + 1))
                progress(min(share, 0.99), f"t = {integrator.time:.2f} s, {len(large)} large events")
                # An event has ended when nothing has detached for twice the delay.
                enough = len(large) >= self.large_events
                if enough and integrator.time > large[self.large_events - 1].end + 2 * self.delay:
                    break
        return self._dataset(chain, history, self._events(chain, history))

    def _breaks(self, chain: Chain, history: History) -> Breaks:
        return Breaks(
            np.array(history.break_time),
            np.array(history.break_block, dtype=int),
            np.array(history.break_count, dtype=int),
            self.delay,
            chain.contacts,
        )

    def _events(self, chain: Chain, history: History) -> list[Event]:
        drop = self.large_drop * self.strength
        return catalogue(self._breaks(chain, history), np.array(history.time), np.array(history.force), drop)

    def _dataset(self, chain: Chain, history: History, events: list[Event]) -> xarray.Dataset:
        position = np.array(history.position)
        spring = np.diff(position, axis=1, append=position[:, -1:]) * chain.spring
        precursors = before_sliding(events)
        first_large = events[: len(precursors) + 1]
        slope, correlation = length_against_force(precursors)
        fast = local_speeds(first_large)
        fast = fast if len(fast) else np.array([np.nan])
        breaks = self._breaks(chain, history)
        slow = slow_fronts(breaks, first_large[-1].start if first_large else np.inf)
        names = {
            "start": "s",
            "end": "s",
            "force": "N",
            "drop": "N",
            "first_block": "1",
            "reach": "1",
            "blocks": "1",
            "detachments": "1",
            "large": "1",
        }
        table = {
            f"event_{n}": variable("event", np.array([getattr(e, n) for e in events]), u, f"{n.replace('_', ' ')}")
            for n, u in names.items()
        }
        speeds = [np.median(s) if len(s := e.speeds()) else np.nan for e in events]
        fields = {
            "force": variable("time", history.force, "N", "loading force"),
            "position": variable(("time", "block"), position.astype("f4"), "m", "displacement"),
            "elastic_force": variable(
                ("time", "block"), spring.astype("f4"), "N", "force of the spring to the next block, tension positive"
            ),
            "attached": variable(("time", "block"), np.array(history.attached, "f4"), "1", "attached fraction"),
            "contact_force": variable(
                ("time", "block"), np.array(history.contact_force, "f4"), "N", "mean force of a block's contacts"
            ),
            "contacts": variable("block", chain.contacts, "1", "contacts of a block"),
            "break_time": variable("record", np.array(history.break_time), "s", "time of breaking"),
            "break_block": variable("record", np.array(history.break_block, "i4"), "1", "block whose contacts break"),
            "break_count": variable("record", np.array(history.break_count, "i4"), "1", "number of broken contacts"),
            **table,
            "event_speed": variable("event", np.array(speeds, float), "1/s", "median front speed, blocks per second"),
            "large_events": variable((), sum(e.large for e in events), "1", "large events"),
            "precursors": variable((), sum(e.drop > 0 for e in precursors), "1", "precursors with a force drop"),
            "largest_precursor_drop": variable(
                (), max((e.drop for e in precursors), default=0.0), "N", "largest force drop before sliding"
            ),
            "mean_large_drop": variable(
                (), float(np.mean([e.drop for e in events if e.large] or [np.nan])), "N", "mean drop of large events"
            ),
            "first_break_time": variable((), (history.break_time or [np.nan])[0], "s", "first broken contact"),
            "first_break_force": variable((), history.first_force, "N", "loading force at the first broken contact"),
            "length_slope": variable((), slope, "1/N", "precursor length over force, blocks per newton"),
            "length_correlation": variable((), correlation, "1", "correlation of length and force, all precursors"),
            "front_speed": variable((), np.median(fast) / self.chain_speed, "1", "median front speed / chain speed"),
            "fast_front_speed": variable(
                (), np.percentile(fast, 95) / self.chain_speed, "1", "95th percentile of front speeds / chain speed"
            ),
            "slow_fronts": variable((), len(slow), "1", "slow fronts before sliding"),
            "slow_front_speed": variable(
                (),
                float(np.median([f.speed for f in slow] or [np.nan])) / self.chain_speed,
                "1",
                "median speed of slow fronts / chain speed",
            ),
            "chaining": variable(
                (),
                chaining(first_large[-1]) if first_large else np.nan,
                "1",
                "speed of the first large event over its local front speed",
            ),
            **{
                f"slow_front_{n}": variable("slow_front", np.array([getattr(f, n) for f in slow], float), unit, text)
                for n, unit, text in (
                    ("start", "s", "start"),
                    ("end", "s", "end"),
                    ("first_block", "1", "first block"),
                    ("last_block", "1", "last block"),
                )
            },
            "retained_stress": variable((), _retained(spring, history, events), "1", "slider force kept by sliding"),
            "chain_speed": variable((), self.chain_speed, "1/s", "wave speed, blocks per second"),
            "decay": variable((), self.decay, "1", "static displacement of a block over its predecessor's"),
        }
        coords = {
            "time": variable("time", history.time, "s", "time"),
            "block": variable("block", np.arange(1, self.blocks + 1), "1", "block from the trailing edge"),
        }
        attrs = {"interface_ratio": self.interface_ratio, "delay": self.delay, "strength": self.strength}
        return xarray.Dataset(fields, coords, attrs)

    @staticmethod
    def summarise(dataset: xarray.Dataset) -> Summary:
        large = dataset.event_large.values.astype(bool)
        peaks = dataset.event_force.values[large]
        return {**LumpedModel.summarise(dataset), "large_event_forces": [float(force) for force in peaks]}


def _retained(spring: np.ndarray, history: History, events: list[Event]) -> float:
    """Return the force in the springs of the slider after the first large event over that before it."""
    first = next((e for e in events if e.large), None)
    if first is None:
        return float("nan")
    before, after = (int(np.searchsorted(history.time, t)) for t in (first.start, first.end))
    after = min(after + 1, len(history.time) - 1)
    return float(np.abs(spring[after]).sum() / np.abs(spring[max(before - 1, 0)]).sum())
