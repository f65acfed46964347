"""Files of a run that belong to its mechanisms, one class of them per file.

The recorder and the estimate of the cost of a run ask every class in the files of this folder for its part, and know
none of them by name. A class says with `of` whose data it records; a case has its files if the model has such a
mechanism.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from ruptfx import Table
from ruptfx.interfaces.mechanisms import Mechanism

if TYPE_CHECKING:
    from ruptfx.bodies.state import State
    from ruptfx.run.model import Model
    from ruptfx.run.recording.checkpoint import Keeper


@dataclass(frozen=True)
class Opening:
    """Data for opening files.

    Attributes
    ----------
    out : Path
        The run directory.
    kept : callable, (schedule) -> int or None
        Number of records of a schedule to keep in files that exist, None without a checkpoint.
    about : dict
        Attributes of all files: hash of the case, versions.
    """

    out: Path
    kept: Callable[[str], int | None]
    about: Table


class Records:
    """The contract of files of mechanisms; a method that is not overridden does nothing.

    Parameters
    ----------
    mechanisms : sequence of Mechanism
        Those of the class `of`.

    Attributes
    ----------
    of : type
        Class of the mechanisms whose data it records.
    schedule : str
        When it is recorded: ``interface``, ``forces`` or ``bulk``.
    figures : dict of str to int
        Figures of a run with these files, each with its cost in plain panels.
    memory, pictures : float
        Additional memory of the figure process, and additional bytes of all figure files [bytes].
    """

    of: ClassVar[type[Mechanism]] = Mechanism
    schedule: str = "interface"
    figures: Mapping[str, int] = {}
    memory: ClassVar[float] = 0.0
    pictures: ClassVar[float] = 0.0

    def __init__(self, model: Model, mechanisms: Sequence[Any]) -> None:
        self.model = model

    def names(self) -> list[str]:
        """Return the names of the files."""
        raise NotImplementedError

    def keepers(self) -> Mapping[str, Keeper]:
        """Return the objects with data for checkpoints, by their names there."""
        return {}

    def gather(self) -> None:
        """Gather the constant data of the files on rank 0; collective."""

    def open(self, opening: Opening) -> None:
        """Open the files; rank 0 only."""
        raise NotImplementedError

    def observe(self, state: State) -> None:
        """Read the state at the start and after every step."""

    def read(self, state: State) -> tuple[float, Any]:
        """Return the time of a record [s] and its data, complete on rank 0; collective."""
        raise NotImplementedError

    def append(self, time: float, data: Any) -> None:
        """Append a record to the files; called on rank 0 by the thread that writes."""
        raise NotImplementedError

    def largest_slip_rate(self, data: Any) -> float:
        """Return the largest slip rate in the data of a record [m/s], for the progress of a run; rank 0 only."""
        return 0.0

    def reopen(self) -> list[Path]:
        """Write all data in memory; return the files, which may then be copied; rank 0 only."""
        raise NotImplementedError

    def complete(self) -> None:
        """Mark the run as complete; rank 0 only."""

    def close(self) -> None:
        """Close the files that are open."""
        raise NotImplementedError

    def numbers(self, records: int, snapshots: int) -> float:
        """Return how many numbers of eight bytes the files of a whole run have.

        Parameters
        ----------
        records, snapshots : int
            Numbers of records of the interfaces and of the bodies.
        """
        return 0.0


@cache
def kinds() -> tuple[type[Records], ...]:
    """Return the classes in the files of this folder, in the order of their names."""
    modules = [import_module(f"{__name__}.{each.name}") for each in pkgutil.iter_modules(__path__)]
    classes = [each for module in modules for each in vars(module).values() if isinstance(each, type)]
    names = {each for each in classes if issubclass(each, Records) and each is not Records}
    return tuple(sorted(names, key=lambda each: each.__name__))


def records_of(model: Model) -> list[Records]:
    """Return the files of the mechanisms of a model."""
    items = [(kind, [each for each in model.mechanisms if isinstance(each, kind.of)]) for kind in kinds()]
    return [kind(model, mechanisms) for kind, mechanisms in items if mechanisms]
