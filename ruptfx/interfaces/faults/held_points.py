"""Interface points whose normal and tangential motion is coupled by the mass, in explicit steps of rigid contact.

The velocity jump of a point after a step is [v] = [v]_free - kick w B (T - T_0) in the local frame, with the mobility

    B = R (1/M+ + 1/M-) R',   R the rows normal and tangents, 1/M the inverse masses of both nodes along the axes.

Inverse masses are equal along all axes, and B is diagonal, unless an edge holds the node along some of them (1/M is
zero there) or dashpots resist them differently. Where such a direction is neither normal nor tangent to the
interface, B is full: normal stress changes the slip rate, and shear traction the opening rate. The conditions of
contact are then solved for the full B:

    opening + dt [v]_n >= 0,   sigma >= 0,   one of them zero;
    [v]_t = V,   T_t parallel to V,   |T_t| = strength(V, sigma).

For a shear traction T_t the normal row gives sigma, the trial of the contact method under
[v]_n - kick w B_nt (T_t - T_t0), and the tangential rows give the velocity jump v_t under both. The friction law
projects the shear trial T_t + Z v_t, which gives the next T_t. When it no longer changes, Z V = trial - T_t = Z v_t:
the slip rate of the law is the velocity jump, for any Z > 0, and energy is balanced as at other points. 1 / (kick w Z)
is the largest eigenvalue of B_tt - B_tn B_nt / B_nn, the tangential mobility of a closed point. The iteration begins
with the T that stops the jump, T_0 + B^-1 c / (kick w) with c = [v]_free + opening / dt along the normal, which is the
result at points that stick.

If both sides are held, no relative motion along that direction is possible and B is singular. The pseudoinverse then
leaves the traction along it as it is: supports carry it. In the plane such a point can open and not slip.

Some laws jump, so that no traction meets all conditions: with two tangents its direction turns abruptly where sliding
stops, and strength that remains without normal stress is lost on opening. There the step continues with the last
projection, and the velocity jump differs from the slip rate in that step. A point whose tractions grow without bound
is jammed: an error.
"""

from __future__ import annotations

import ctypes
from typing import ClassVar

import numpy as np

from ruptfx.bodies.state import FaultState
from ruptfx.interfaces.faults.interface import Interface
from ruptfx.interfaces.faults.point_code import LANES, PointCode, filled
from ruptfx.platform.codegen import native
from ruptfx.platform.codegen.native import address

OBLIQUE = 1e-9  # entries of a row of B beside its diagonal over the largest of B, up to which motions are independent
SINGULAR = 1e-6  # eigenvalue over the largest one below which a motion is impossible


def mobility_blocks(interface: Interface, inverse_mass: np.ndarray) -> np.ndarray:
    """Return B of every point [1/kg], shape (n, local, local).

    Parameters
    ----------
    inverse_mass : ndarray, shape (nodes * components,)
        Inverse lumped mass of every degree of freedom [1/kg]; zero where the motion is prescribed.
    """
    inverse = inverse_mass.reshape(-1, interface.frame.shape[2])
    both = inverse[interface.plus] + (0 if interface.one_sided else inverse[interface.minus])
    blocks: np.ndarray = np.einsum("ikc,ic,ilc->ikl", interface.rows, both, interface.rows)
    return blocks


def beside_diagonal(blocks: np.ndarray) -> np.ndarray:
    """Return the sums of the entries of every row beside the diagonal, zero where they are rounding, shape (n, local).

    Added to the diagonal they bound the block, so that sweeps over all components at once converge.
    """
    blocks = np.abs(blocks)
    sums: np.ndarray = np.where(np.eye(blocks.shape[1], dtype=bool), 0.0, blocks).sum(axis=2)
    return np.where(sums > OBLIQUE * blocks.max(axis=(1, 2), initial=0.0)[:, None], sums, 0.0)


def coupled_points(interface: Interface, inverse_mass: np.ndarray) -> np.ndarray:
    """Return the indices of the points with a full B, shape (such points,)."""
    return np.flatnonzero(beside_diagonal(mobility_blocks(interface, inverse_mass)).any(axis=1))


def coupling_columns(interface: Interface, inverse_mass: np.ndarray, kick: float) -> dict[str, np.ndarray]:
    """Return B, its inverse over kick w [Pa s/m], and the impedances of closed points, as columns of `PointCode`."""
    blocks = mobility_blocks(interface, inverse_mass)
    push = kick * interface.weight
    sizes, vectors = np.linalg.eigh(blocks)
    largest = np.maximum(sizes[:, -1:], 1e-100)
    moves = sizes > SINGULAR * largest
    inverse = np.where(moves, 1 / np.where(moves, sizes, 1.0), 0.0)
    sticking = np.einsum("ikp,ip,ilp->ikl", vectors, inverse, vectors) / push[:, None, None]
    first = blocks.shape[1] - interface.tangents
    tangential, normal = blocks[:, first:, first:], np.zeros((len(push), 1))
    closed = tangential
    if interface.has_normal:
        normal = blocks[:, :1, 0]
        between = blocks[:, first:, 0]
        loose = np.where(normal > SINGULAR * largest, 1 / np.maximum(normal, SINGULAR * largest), 0.0)
        closed = tangential - between[:, :, None] * between[:, None, :] * loose[:, :, None]
    mobility, open_mobility = (np.linalg.eigvalsh(each)[:, -1:] for each in (closed, tangential))
    mobility = np.where(mobility > SINGULAR * largest, mobility, np.maximum(open_mobility, SINGULAR * largest))
    return {
        "mobility_block": blocks.reshape(len(push), -1), "sticking_block": sticking.reshape(len(push), -1),
        "normal_impedance": 1 / (push * np.maximum(normal, SINGULAR * largest)[:, 0]),
        "shear_impedance": np.repeat(1 / (push[:, None] * mobility), interface.tangents, axis=1),
    }  # fmt: skip


class HeldPoints:
    """The step of some points of a fault: `keep` comes before the step of all points, and the call after it.

    The step of all sees no motion at these points and exerts no force there; what it does to their fields is replaced.

    Parameters
    ----------
    code : PointCode
        All points, with the columns of `coupling_columns`; it is reduced to those of `index`.
    library : CDLL
        `fault_step.c` and `held_points.c`.
    index : ndarray of int
    nodes : (ndarray, ndarray)
        First degrees of freedom of both nodes of all points.
    real : dtype
        Type of the velocities and forces of nodes.

    Attributes
    ----------
    result : ndarray, shape (8,)
        As that of `points.c`; the index of a point that failed is one of all points.
    """

    sources: ClassVar[tuple[str, ...]] = ("interfaces/faults/fault_step.c", "interfaces/faults/held_points.c")

    def __init__(
        self, code: PointCode, library: ctypes.CDLL, index: np.ndarray, nodes: tuple[np.ndarray, np.ndarray],
        real: np.dtype,
    ) -> None:  # fmt: skip
        self._real = real
        self._code, self._library, self.index = code, library, np.ascontiguousarray(index, np.int64)
        rows = code.fixed.transpose(0, 2, 1).reshape(-1, code.fixed.shape[1])[index]
        code.fixed = native.aligned((-(-len(index) // LANES), rows.shape[1], LANES))
        code.fixed[:] = filled(rows).reshape(-1, LANES, rows.shape[1]).transpose(0, 2, 1)
        self._nodes = [np.ascontiguousarray(filled(side[index]), np.int64) for side in nodes]
        self.result = np.zeros(8)
        self._kept = np.zeros((len(code.names), len(index)))
        self._table: ctypes.Array[ctypes.c_void_p] = (ctypes.c_void_p * 0)()
        self._some = ctypes.c_long(len(index)), address(self.index)

    def put(self, name: str, values: np.ndarray) -> None:
        """Set a column from the values of all points."""
        self._code.put(name, values[self.index])

    def bind(self, state: FaultState) -> None:
        """Collect the pointers to the arrays of a state."""
        self._table = self._code.table(state)

    def keep(self) -> None:
        """Keep the fields before the step of all points."""
        self._library.keep(*self._some, ctypes.byref(self._table), address(self._kept))

    def __call__(self, times: np.ndarray, displacement: np.ndarray, velocity: np.ndarray, force: np.ndarray) -> None:
        """Advance the fields from those that were kept, velocity and force, and set `result`."""
        self._library.update_held(
            *self._some, *map(address, (self._kept, times, *self._nodes, displacement)),
            address(velocity, self._real), address(force, self._real), address(self._code.fixed),
            address(self._code.numbers), ctypes.byref(self._table), address(self.result),
        )  # fmt: skip
        if self.result[1] >= 0:
            self.result[1] = self.index[int(self.result[1])]
