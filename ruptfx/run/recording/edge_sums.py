"""Motion and force of every edge with a boundary: `edges.csv`, the data of stress-strain curves."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ruptfx.bodies.boundaries import EdgeBoundary
from ruptfx.bodies.space.edges import Edge
from ruptfx.platform import parallel

if TYPE_CHECKING:
    from ruptfx.bodies.state import State
    from ruptfx.run.model import Model

REMARK = (
    "time in s; of every edge on which a boundary acts the mean displacement of its nodes in m and the force on it "
    "that the bodies resist, in {}"
)


class EdgeSums:
    """Columns of the table of edges of a model; created on all ranks.

    Attributes
    ----------
    columns : list of str
        ``upper.top.displacement_y`` and so on.
    """

    def __init__(self, model: Model) -> None:
        self._model = model
        named = [each.edge for _, each in model.case.all_boundaries() if isinstance(each, EdgeBoundary)]
        self._nodes, self.columns = [], []
        for name in dict.fromkeys(named):
            self._nodes.append(Edge(model, name, "boundaries").nodes)
            self.columns += [f"{name}.{what}_{axis}" for what in ("displacement", "force") for axis in "xy"]

    def row(self, state: State) -> list[float]:
        """Return the mean displacement of every edge [m] and its reaction [N per metre of thickness]; collective.

        The force does not contain the inertia of the nodes of the edge.
        """
        model = self._model
        _, displacement = state.at_faults()
        force, counted = model.internal_force(displacement), self._nodes
        for each in model.mechanisms:
            each.add_resistance(state, force)
            counted = [each.counted(nodes) for nodes in counted]
        counted = [nodes[nodes < model.owned_nodes] for nodes in counted]
        rows = np.stack([displacement.reshape(-1, 2), -force.reshape(-1, 2)], axis=1)
        sums = [np.append(rows[nodes].sum(axis=0).ravel(), len(nodes)) for nodes in counted]
        totals = parallel.total(model.comm, np.array(sums).reshape(-1, 5))
        totals[:, :2] /= totals[:, 4:]
        return [float(value) for total in totals for value in total[:4]]
