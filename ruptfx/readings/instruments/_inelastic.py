"""Inelastic stresses of materials with memory at the points of elements, as one vector of which instruments read."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ruptfx.bodies.space.inside import Inside
    from ruptfx.bodies.state import State
    from ruptfx.interfaces.mechanisms.system import System


class InelasticStress:
    """Vector of the inelastic stresses of this rank: body by body, cell by cell, point by point, part by part.

    Attributes
    ----------
    size : int
    """

    def __init__(self, model: System) -> None:
        self._model = model
        self._parts = {
            name: (len(sweep.cells), sweep.points, len(sweep.law.components)) for name, sweep in model.memory.items()
        }
        ends = np.cumsum([0, *(int(np.prod(shape)) for shape in self._parts.values())]).tolist()
        self._first, self.size = dict(zip(self._parts, ends, strict=False)), ends[-1]
        self._rows: dict[str, np.ndarray] = {}
        self._values = np.zeros(0)

    def at(self, place: Inside, label: str) -> tuple[np.ndarray, np.ndarray]:
        """Return places in the vector and weights of a component of the stress at a point, of this rank."""
        name = self._model.bodies.names[place.body]
        places, weights = [np.zeros(0, dtype=np.int64)], [np.zeros(0)]
        for cell, functions in place.functions.items():
            sweep = self._model.memory[name]
            row, shares = sweep.shares(cell, functions)
            _, points, parts = self._parts[name]
            start = self._first[name] + row * points * parts + sweep.law.components.index(label)
            places.append(start + parts * np.arange(points))
            weights.append(shares)
        return np.concatenate(places), np.concatenate(weights)

    def choose(self, places: np.ndarray) -> None:
        """Compute only the cells of these places from now on."""
        self._values = np.zeros(self.size)
        for name, (cells, points, parts) in self._parts.items():
            own_places = places[(places >= self._first[name]) & (places < self._first[name] + cells * points * parts)]
            self._rows[name] = np.unique((own_places - self._first[name]) // (points * parts))

    def read(self, state: State) -> np.ndarray:
        """Return the vector at the time of the faults; zero outside of the chosen cells."""
        _, displacement = state.at_faults()
        for name, rows in self._rows.items():
            if len(rows):
                first, shape = self._first[name], self._parts[name]
                body = self._values[first : first + int(np.prod(shape))].reshape(shape)
                body[rows] = self._model.memory[name].inelastic_stress(displacement, state.memory[name], rows)
        return self._values
