"""Memory and runs of a reconstruction, refused before they are made where they are too many."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ruptfx.input.quantities import at_least, with_prefix
from ruptfx.input.schema import CaseError
from ruptfx.many_runs.reconstruction.posterior import count_modes, stretched
from ruptfx.platform import memory, parallel

if TYPE_CHECKING:
    from ruptfx.many_runs.adjoint.readings import Readings
    from ruptfx.many_runs.reconstruction.experiment import Experiment
    from ruptfx.many_runs.reconstruction.twin import Twin
    from ruptfx.readings.misfits import Reconstruction as Settings

MOST_RUNS = 2000
"""Largest number of runs for the tractions of the modes of the prior along the interface."""
FACTORS = (1.25, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0)
"""Factors of lengths that are tried for the remedy."""
DOUBLE = 8


@dataclass(frozen=True)
class Needs:
    """Sizes of the arrays of a reconstruction.

    Attributes
    ----------
    columns, points, knots, steps : int
        Of the interface and of the slip rate, and steps of a run.
    traces, channels, data : int
        Sources of responses, of all channels, and their data.
    ranks : int
        Ranks that share the memory.
    """

    columns: int
    points: int
    knots: int
    steps: int
    traces: int
    channels: int
    data: int
    ranks: int

    @property
    def responses(self) -> int:
        """Memory of the responses of all channels to every point, in steps and at the knots [bytes]."""
        return DOUBLE * self.ranks * self.columns * (self.traces * self.steps + self.channels * self.knots)

    def of_modes(self, in_space: int, in_time: int) -> int:
        """Memory of tractions of the modes, of their responses and of the factor of the posterior [bytes]."""
        size, fields = in_space * in_time, self.columns + self.points
        tractions = self.ranks * fields * (1 + self.knots) * in_space
        return DOUBLE * (tractions + 2 * self.data * size + min(self.data, size) ** 2)

    def bytes(self, in_space: int, in_time: int) -> int:
        """Memory of all [bytes]."""
        return self.responses + self.of_modes(in_space, in_time)


def needs_of(experiment: Experiment, twin: Twin, readings: Readings) -> Needs:
    """Return the sizes of an experiment; collective."""
    count = len(experiment.channels)
    return Needs(
        twin.geometry.direction.size, len(twin.position), twin.knots.count, twin.knots.steps,
        sum(len(readings.sources(number)) for number in range(count)), count,
        sum(len(each.times) for each in experiment.channels), parallel.ranks_here(twin.model.comm),
    )  # fmt: skip


def refuse_large(
    needs: Needs, twin: Twin, settings: Settings, length: float | None = None, time: float | None = None
) -> None:
    """Refuse what does not fit into the memory, or has too many runs; collective.

    Parameters
    ----------
    needs : Needs
    twin : Twin
    settings : Reconstruction
    length, time : float, optional
        Correlation lengths [m], [s] that the likelihood gave; without a length only the memory of responses is known.

    Raises
    ------
    CaseError
        On all ranks.
    """
    parallel.on_root(twin.model.comm, lambda: _refuse(needs, twin, settings, length, time))


def _refuse(needs: Needs, twin: Twin, settings: Settings, length: float | None, time: float | None) -> None:
    of_channels = f"responses of {needs.channels} channels at {needs.points} points and {needs.steps} steps"
    remedy = "leave out channels, or late data with end, or use a larger mesh.element_size"
    if text := memory.shortage("objective", of_channels, needs.responses, remedy):
        raise CaseError(text)
    length, time = length or settings.length, time or settings.time
    if length is None:
        return
    locations, times, dip_length = twin.geometry.locations, twin.knots.times, settings.dip_length
    in_time = 1 if time is None else count_modes(times, time, order=settings.order)
    positions = stretched(locations, length, dip_length)

    def modes(factor: float, length: float = length) -> int:
        return twin.geometry.tangents * count_modes(positions, factor * length, order=settings.order)

    def fits(count: int) -> bool:
        return count <= MOST_RUNS and not memory.shortage("", "", needs.bytes(count, in_time), "")

    if fits(count := modes(1.0)):
        return
    factor = next((each for each in FACTORS if fits(modes(each))), None)
    remedy = "use a larger mesh.element_size"
    if factor is not None:
        both = "" if dip_length is None else f" and dip_length = {_text(factor * dip_length)}"
        remedy = f"set length = {_text(factor * length)}{both}, or a larger one"
    key = f"reconstruction.length = {_text(length)}{'' if settings.length else ' (of the likelihood)'}"
    use = f"{count} modes of the prior along the interface"
    if count > MOST_RUNS:
        raise CaseError(f"{key}: {use} take as many runs, and at most {MOST_RUNS} are made; {remedy}")
    if text := memory.shortage(key, use, needs.bytes(count, in_time), remedy, " and as many runs"):
        raise CaseError(text)


def _text(length: float) -> str:
    """Return a length that is not below the value."""
    return f'"{with_prefix(float(at_least(length, 3)), "m")}"'
