"""Burridge-Knopoff chain: blocks with inertia, friction that falls with the slip rate, events of all sizes."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
import xarray
from pydantic import Field

from ruptfx.input.schema import Unit
from ruptfx.input.units import NonNegative, Positive, Speed
from ruptfx.lumped import LumpedModel, Progress, silent, variable
from ruptfx.lumped.burridge_knopoff.chain import Chain, Event, load, slip_event

Count = Annotated[int, Field(ge=1, le=100_000)]


class BurridgeKnopoff(LumpedModel):
    """Chain of blocks dragged through leaf springs: small and large events from smooth loading without disorder.

    Loading is quasi-static: the drive does not move during an event.
    Source: Burridge and Knopoff (1967), Bull. Seismol. Soc. Am. 57, 341; Carlson and Langer (1989), Phys. Rev. A 40,
    6470.
    """

    example: ClassVar[str] = "blocks = 20\nevents = 60\ndiscarded = 10"

    blocks: Annotated[int, Field(ge=1, le=2000)] = 100
    """Blocks of the chain, whose ends are free."""
    mass: Annotated[Positive, Unit("kg")] = 1.0
    """Mass of a block."""
    leaf_stiffness: Annotated[Positive, Unit("N/m")] = 1e4
    """Stiffness of the spring between a block and the drive."""
    coupling_stiffness: Annotated[NonNegative, Unit("N/m")] = 36e4
    """Stiffness of the spring between two blocks."""
    strength: Annotated[Positive, Unit("N")] = 100.0
    """Friction at which a block begins to slip."""
    drop: Annotated[float, Field(ge=1e-4, lt=1)] = 0.01
    """Relative drop of friction at the onset of slip."""
    weakening: NonNegative = 2.5
    """alpha: friction is (1 - drop) / (1 + 2 alpha v / (1 - drop)) of the strength, v over strength /
    sqrt(mass leaf_stiffness)."""
    drive_speed: Speed = 1e-6
    """Speed of the drive; it affects only the time between events."""
    events: Count = 5000
    """Number of recorded events."""
    discarded: Annotated[int, Field(ge=0, le=100_000)] = 1000
    """Number of events before them, which remove the effect of the initial state."""
    step: Annotated[float, Field(gt=0, le=0.5)] = 0.2
    """Time step over the largest stable one."""
    seed: Annotated[int, Field(ge=0)] = 1
    """Seed of the random initial displacements."""

    @property
    def chain(self) -> Chain:
        """The same chain in dimensionless units."""
        return Chain(self.coupling_stiffness / self.leaf_stiffness, self.drop, self.weakening)

    def run(self, progress: Progress = silent) -> xarray.Dataset:
        chain = self.chain
        dt = self.step * chain.stable_step()
        u = np.random.default_rng(self.seed).uniform(-1e-2, 1e-2, self.blocks)
        items: list[Event] = []
        driven, force, first = [], [], []
        total = 0.0
        for number in range(self.discarded + self.events):
            if number % 20 == 0:
                progress(number / (self.discarded + self.events), f"event {number}")
            distance = load(chain, u)
            total = distance + total if number > self.discarded else 0.0  # counted from the first that is kept
            forces, trigger = -u.mean(), int(np.argmax(chain.spring_force(u)))
            event = slip_event(chain, u, dt)
            if number >= self.discarded:
                items.append(event)
                driven.append(total)
                force.append([forces, -u.mean()])
                first.append(trigger)
        return self._dataset(items, np.array(driven), np.array(force), np.array(first))

    def _dataset(self, events: list[Event], driven: np.ndarray, force: np.ndarray, first: np.ndarray) -> xarray.Dataset:
        length, time = self.strength / self.leaf_stiffness, np.sqrt(self.mass / self.leaf_stiffness)
        slip = np.array([event.slip for event in events])
        released = np.array([event.released for event in events])
        lost = np.abs(released - [event.dissipated for event in events]) / released
        moment = slip.sum(axis=1)
        edges = np.arange(np.floor(2 * np.log(moment.min())), np.ceil(2 * np.log(moment.max())) + 1) / 2
        edges = np.append(edges, edges[-1] + 0.5) if len(edges) < 2 else edges
        count, _ = np.histogram(np.log(moment), edges)
        every = "event"
        return xarray.Dataset(
            {
                "time": variable(every, driven * length / self.drive_speed, "s", "time, without that of the events"),
                "slip": variable((every, "block"), slip * length, "m", "slip of a block in an event"),
                "moment": variable(every, moment * length, "m", "slip of all blocks in an event"),
                "blocks": variable(every, (slip > 0).sum(axis=1), "1", "number of blocks that slip"),
                "first": variable(every, first, "1", "index of the block that begins"),
                "duration": variable(every, [e.duration * time for e in events], "s", "duration of an event"),
                "released": variable(every, released * self.strength * length, "J", "energy that the springs lose"),
                "force": variable(
                    (every, "when"), force * self.strength, "N", "mean force of the leaf springs, before and after"
                ),
                "count": variable("magnitude", count, "1", "number of events per half a unit of magnitude"),
                "energy_error": variable((), lost.max(), "1", "largest part of the energy that is not accounted for"),
                "slip_in_large": variable(
                    (),
                    moment[(slip > 0).all(axis=1)].sum() / moment.sum(),
                    "1",
                    "fraction of the slip in events of all blocks",
                ),
            },
            coords={
                "magnitude": variable("magnitude", (edges[1:] + edges[:-1]) / 2, "1", "ln(moment / (strength / k))"),
            },
            attrs={"chain_blocks": self.blocks, "weakening": self.weakening, "seed": self.seed},
        )
