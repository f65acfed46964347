"""Stiffness of interfaces in bodies that repeat along strike: one real matrix for every wavenumber of a Fourier series.

Slip along the section goes with cos kz, slip along strike with sin kz (`ruptfx.interfaces.section`); the other family
(sin, -cos) has the same matrix. Complex amplitudes of strike components times i are those of the real problem.

Bodies are stuck at the interfaces with a stiffness kappa, A(k) = K(k) + J' W kappa J, and S = J A^-1 J' W. Contact has
the compliance c. Then T = P g_F - K s with P = (S (1 - kappa c) + c)^-1 and K = P (1 - S kappa), as in `loaded_bodies`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.fft
from scipy.linalg import solve
from scipy.sparse import csr_matrix, diags

from ruptfx.platform import fem, parallel
from ruptfx.platform.memory import refuse_shortage
from ruptfx.stepping.implicit.compliance import Decomposed
from ruptfx.stepping.implicit.stored import StoredParts, checksum_of

if TYPE_CHECKING:
    from ruptfx.interfaces.section import Section

PER_ENTRY, PER_UNKNOWN = 1.5e-7, 4e-6  # s of processor time, as measured: of a solution of one unknown, of its factors
SILENT = 1e-13  # normal traction over shear traction per slip below which it is rounding


@dataclass(frozen=True)
class Loaded:
    """Response of the bodies to driven edges with interfaces that do not slip, the same all along strike.

    Attributes
    ----------
    traction : ndarray, shape (points, 3)
        [Pa]
    jump : ndarray, shape (points, 3)
        g_F: with interfaces that are stuck with kappa [m].
    energy : float
        Of bodies and contact, per length of strike [J/m].
    displacement : ndarray, shape (nodes * 3,)
        Of the section [m].
    """

    traction: np.ndarray
    jump: np.ndarray
    energy: float
    displacement: np.ndarray


@dataclass(frozen=True)
class Work:
    """Size of the matrices of all wavenumbers, known before one of them is computed.

    Attributes
    ----------
    wavenumbers : int
    points : int
        Of the section.
    unknowns : int
        Of the bodies, in the system of one wavenumber.
    """

    wavenumbers: int
    points: int
    unknowns: int

    @property
    def columns(self) -> int:
        """Solutions of the bodies for every wavenumber."""
        return 3 * self.points

    @property
    def bytes(self) -> int:
        """Memory of the matrices; two thirds of it where slip does not change the normal stress."""
        return self.wavenumbers * 6 * self.points**2 * 8

    @property
    def seconds(self) -> float:
        """Estimated processor time of one core [s]."""
        return self.wavenumbers * self.unknowns * (PER_UNKNOWN + PER_ENTRY * self.columns)


def work_of(section: Section, names: Sequence[str], points: int) -> Work:
    """Return the size of the matrices of interfaces, for a number of points along strike in a period."""
    size = sum(len(section.faces[name].plus) for name in names)
    return Work(points // 2 + 1, size, section.unknowns.shape[1])


class StrikeSeries:
    """Tractions of the interfaces of a section from slip that varies along strike, by wavenumber.

    Parameters
    ----------
    section : Section
    names : sequence of str
        The interfaces; their points are numbered one after the other.
    compliance : ndarray, shape (section points, 3)
        Of contact along normal, strike and tangent [m/Pa].
    period : float
        [m]
    points : int
        Equidistant points along strike in a period.
    comm : MPI communicator
        Ranks share the wavenumbers.
    folder : Path, optional
        Where matrices are stored by checksum; default is the cache of compiled code.

    Attributes
    ----------
    wavenumbers : ndarray
        [1/m]
    stored : int
        Matrices of all ranks that were read, and not computed.
    """

    def __init__(
        self, section: Section, names: Sequence[str], compliance: np.ndarray, period: float, points: int,
        comm: fem.MPI.Comm, folder: Path | None = None,
    ) -> None:  # fmt: skip
        self.section, self.comm, self.period, self.points = section, comm, period, points
        self._J, self.weight = section.jumps(names)
        self._c = compliance.ravel()
        self.size = len(self._c) // 3
        diagonal = section.powers[0].diagonal().reshape(-1, 3).max(axis=1)
        faces = [section.faces[name] for name in names]
        softer = [np.minimum(diagonal[face.plus], diagonal[face.minus]) / face.weight for face in faces]
        self._kappa = np.repeat(np.concatenate(softer), 3)
        self.wavenumbers = 2 * np.pi / period * np.arange(points // 2 + 1)
        self._mine = np.arange(comm.rank, len(self.wavenumbers), comm.size)
        self._need_memory()
        self._parts = StoredParts(self._checksum(), comm, folder)
        error = None
        try:
            self._matrices = np.stack([self._matrix(k) for k in self.wavenumbers[self._mine]]) if len(self._mine) else (
                np.zeros((0, 3 * self.size, 2 * self.size))
            )  # fmt: skip
        except Exception as caught:  # MUMPS of one rank may lack memory
            error = caught
        parallel.raise_on_all(comm, error)
        self.stored = self._parts.counts()[0]
        largest = parallel.largest(comm, np.abs(self._matrices[:, 1:]).max(initial=0.0))
        normal = parallel.largest(comm, np.abs(self._matrices[:, 0::3]).max(initial=0.0))
        self.has_opening = normal > SILENT * largest
        if not self.has_opening:  # rows of zeros between the others would take a third of a product
            rows = np.arange(3 * self.size).reshape(-1, 3)[:, 1:].ravel()
            self._matrices = np.ascontiguousarray(self._matrices[:, rows])

    def _need_memory(self) -> None:
        """Refuse matrices that do not fit into the memory, before one is computed; collective.

        Raises
        ------
        RuptfxError
        """
        need, here = Work(len(self.wavenumbers), self.size, 0).bytes, parallel.ranks_here(self.comm)
        refuse_shortage(
            self.comm, f"mesh.along_strike.points = {self.points}",
            f"matrices of its wavenumbers and of {self.size} points of the section", need * here / self.comm.size,
            "half of both is an eighth of it, or spread the ranks over several machines",
        )  # fmt: skip

    @property
    def report(self) -> str:
        """Line for the log: how many matrices were read, and how many computed; collective."""
        return self._parts.report("mesh.along_strike: matrices of wavenumbers")

    @property
    def bytes(self) -> int:
        """Memory of the matrices of all ranks [bytes]."""
        return len(self.wavenumbers) * self._count() * 8

    def _count(self) -> int:
        return (3 if self.has_opening else 2) * 2 * self.size**2

    def stiffness(self, k: float) -> csr_matrix:
        """Return A(k) over the unknowns [N/m2], per length of strike."""
        by_power = self.section.powers
        stuck = self._J.T @ diags(self.weight * self._kappa) @ self._J
        T = self.section.unknowns
        return (T.T @ (by_power[0] + k * by_power[1] + k**2 * by_power[2] + stuck) @ T).tocsr()

    def _checksum(self) -> str:
        """Return the checksum of all that the matrices depend on but the wavenumber."""
        sparse = (*self.section.powers, self.section.unknowns, self._J)
        arrays = [each for matrix in sparse for each in (matrix.indptr, matrix.indices, matrix.data)]
        return checksum_of("slip to traction", [*arrays, self.weight, self._kappa, self._c])

    def _matrix(self, k: float) -> np.ndarray:
        """Return K of a wavenumber, shape (3 points, 2 points)."""
        shape = 3 * self.size, 2 * self.size
        return self._parts.part(float(k).hex(), shape, partial(self._computed, k), fem.MPI.COMM_SELF)

    def _computed(self, k: float) -> np.ndarray:
        S, _, factors = self._compliance(k)
        factors.destroy()
        both = solve(self._system(S), np.eye(3 * self.size) - S * self._kappa)
        shear = np.arange(3 * self.size).reshape(-1, 3)[:, 1:].ravel()
        return np.ascontiguousarray(both[:, shear])

    def _system(self, S: np.ndarray) -> np.ndarray:
        return S * (1 - self._kappa * self._c) + np.diag(self._c)

    def _compliance(self, k: float) -> tuple[np.ndarray, np.ndarray, Decomposed]:
        """Return S, A^-1 J' W over the unknowns, and the factors of A."""
        factors = self._factors(k)
        pull = (self.section.unknowns.T @ self._J.T @ diags(self.weight)).toarray(order="F")
        answer = factors.solve_all(pull)
        return self._J @ (self.section.unknowns @ answer), answer, factors

    def _factors(self, k: float) -> Decomposed:
        A = self.stiffness(k)
        made: Any = fem.PETSc.Mat()  # its annotations refuse mpi4py's communicators
        integer = fem.PETSc.IntType
        rows = A.indptr.astype(integer), A.indices.astype(integer), A.data
        return Decomposed(made.createAIJ(A.shape, csr=rows, comm=fem.MPI.COMM_SELF))

    @cached_property
    def _uniform(self) -> tuple[np.ndarray, np.ndarray, Decomposed]:
        return self._compliance(0.0)

    @cached_property
    def own(self) -> np.ndarray:
        """S of each point on itself for uniform slip, shape (section points, 3) [m/Pa]."""
        return np.diagonal(self._uniform[0]).reshape(-1, 3)

    def held(self, jump: np.ndarray) -> np.ndarray:
        """Return P g_F, traction that loads bring to interfaces without slip [Pa], as g_F of shape (points, 3) [m]."""
        return np.asarray((self._by_jump @ jump.ravel()).reshape(-1, 3))

    @cached_property
    def _by_jump(self) -> np.ndarray:
        return np.linalg.inv(self._system(self._uniform[0]))

    def loaded(self, moved: np.ndarray) -> Loaded:
        """Return the response to driven edges in place: displacements of the section, zero elsewhere [m]."""
        section, (_, answer, factors) = self.section, self._uniform
        T, K = section.unknowns, section.powers[0]
        stuck = self._J.T @ (self.weight * self._kappa * (self._J @ moved))
        free = T @ factors.solve(-(T.T @ (K @ moved + stuck)))
        jump = self._J @ (moved + free)
        traction = self.held(jump).ravel()
        u = moved + free - T @ (answer @ (traction - self._kappa * self._c * traction))
        return Loaded(traction.reshape(-1, 3), jump.reshape(-1, 3), 0.5 * float(moved @ (K @ u)), u)

    def motion_by_slip(self, rows: np.ndarray, strike: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        """Return a function from slip, as that of `traction`, to sums of displacements of the section; one rank.

        Parameters
        ----------
        rows : ndarray, shape (places, 3, nodes * 3)
            Weights of the degrees of freedom, for the displacement along x, y and z of each place.
        strike : ndarray, shape (places,)
            Distance of each place from the first points along strike [m].
        """
        pull = (self.section.unknowns.T @ rows.reshape(-1, rows.shape[2]).T).astype(float)
        table = np.stack([self._weights(k, pull, K) for k, K in zip(self.wavenumbers, self._matrices, strict=True)])
        doubled = np.full(len(self.wavenumbers), 2.0)
        doubled[0] = 1.0
        if self.points % 2 == 0:
            doubled[-1] = 1.0
        wave = doubled[:, None] / self.points * np.exp(1j * self.wavenumbers[:, None] * strike)

        def motion(slip: np.ndarray) -> np.ndarray:
            amplitudes = scipy.fft.rfft(slip, axis=0)
            amplitudes[..., 0] *= 1j
            result = np.matmul(table, amplitudes.reshape(len(table), -1, 1)).reshape(len(table), -1, 3)
            result[..., 2] *= -1j
            return np.asarray(np.einsum("kp,kpc->pc", wave, result).real)

        return motion

    def _weights(self, k: float, pull: np.ndarray, matrix: np.ndarray) -> np.ndarray:
        """Return the weights of slip in sums of displacements, shape (sums, 2 points), of a wavenumber."""
        factors = self._factors(k)
        answer = self._J @ (self.section.unknowns @ factors.solve_all(pull))
        factors.destroy()
        shear = np.arange(3 * self.size).reshape(-1, 3)[:, 1:].ravel()
        kept = slice(None) if self.has_opening else shear
        by_traction = (self.weight * (1 - self._kappa * self._c))[kept]
        of_slip = answer[shear].T * (self.weight * self._kappa)[shear]
        return np.asarray(of_slip + (answer[kept].T * by_traction) @ matrix)

    def traction(self, slip: np.ndarray) -> np.ndarray:
        """Return K s, traction that slip takes away [Pa]; collective.

        Parameters
        ----------
        slip : ndarray, shape (strike points, section points, 2)
            Along strike and along the section [m].

        Returns
        -------
        ndarray, shape (strike points, section points, 3)
        """
        amplitudes = scipy.fft.rfft(slip, axis=0)
        amplitudes[..., 0] *= 1j
        mine = np.ascontiguousarray(amplitudes[self._mine].reshape(len(self._mine), -1))
        pairs = mine.view(float).reshape(*mine.shape, 2)
        product = np.matmul(self._matrices, pairs)
        local = 3 if self.has_opening else 2
        result = np.zeros((len(self.wavenumbers), self.size, 3), dtype=complex)
        result[self._mine, :, 3 - local :] = product.view(complex).reshape(len(self._mine), self.size, local)
        if self.comm.size > 1:
            result = parallel.total(self.comm, result.view(float)).view(complex)
        result[..., 1] *= -1j
        return np.asarray(scipy.fft.irfft(result, n=self.points, axis=0))
