"""Quasi-dynamic cycles on a fault in a half-space, by boundary integrals: antiplane shear, and dip in plane strain.

    tau_0 + K (s - V_p t) - eta V = a sigma asinh(V / (2 V_0) exp((f_0 + b ln(V_0 theta / D_c)) / a))
    sigma = sigma_0 + N (s - V_p t),   ds/dt = V,   dtheta/dt = 1 - V theta / D_c

Independent of the finite elements, as a reference for them. Slip is uniform in every cell; below the last one
the fault slides at V_p. K and N are the stresses at the centres of cells by the dislocations at their ends and by the
images of these above the surface. Runge-Kutta steps (SciPy) follow s - V_p t and ln theta.
Source: Segall (2010), Earthquake and Volcano Deformation, for the screw dislocations; Muskhelishvili (1953), Some Basic
Problems of the Mathematical Theory of Elasticity, for the potentials of edge dislocations; Rice (1993) for eta.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import RK45

from benchmarks._cycles import Cycles

LONGEST = 0.5 * 365.25 * 24 * 3600  # s, of a step


@dataclass(frozen=True)
class HalfSpaceFault:
    """The problem in SI units, uniform but for `a`.

    Attributes
    ----------
    cells : ndarray, shape (n + 1,)
        Distances of the ends of the cells down dip.
    a : ndarray, shape (n,)
    b, D_c, f_0, V_0, normal_stress, shear_modulus, wave_speed, plate_rate, initial_traction : float
        `initial_traction` is the friction at the slip rate V_p, without radiation.
    """

    cells: np.ndarray
    a: np.ndarray
    b: float
    D_c: float
    f_0: float
    V_0: float
    normal_stress: float
    shear_modulus: float
    wave_speed: float
    plate_rate: float
    initial_traction: float

    def stiffness(self) -> np.ndarray:
        """Return K, shape (n, n) [Pa/m]."""
        above, below = self.cells[:-1], self.cells[1:]
        z = (0.5 * (above + below))[:, None]
        ends = 1 / (z - below) - 1 / (z - above) + 1 / (z + above) - 1 / (z + below)
        return np.asarray(self.shear_modulus / (2 * np.pi) * ends)

    def normal_stiffness(self) -> np.ndarray:
        """Return N, shape (n, n) [Pa/m]; zero in antiplane shear."""
        return np.zeros((len(self.a), len(self.a)))

    def initial_age(self) -> np.ndarray:
        """Return ln theta with which the fault carries the initial traction at V_p, shape (n,)."""
        drive = self.initial_traction / (self.a * self.normal_stress)
        psi = self.a * np.log(2 * self.V_0 / self.plate_rate * np.sinh(drive))
        return np.asarray(np.log(self.D_c / self.V_0) + (psi - self.f_0) / self.b)

    def log_rate(
        self, traction: np.ndarray, age: np.ndarray, guess: np.ndarray, pressure: np.ndarray | float | None = None
    ) -> np.ndarray:
        """Return ln V that balances friction and radiation, by Newton's method; NaN far from a solution."""
        eta = self.shear_modulus / (2 * self.wave_speed)
        strength = self.a * (self.normal_stress if pressure is None else pressure)
        psi = self.f_0 + self.b * (np.log(self.V_0 / self.D_c) + age)
        x = guess
        for _ in range(50):
            V, ratio = np.exp(x), np.exp(x + psi / self.a) / (2 * self.V_0)
            missing = traction - eta * V - strength * np.arcsinh(ratio)
            change = missing / (eta * V + strength * ratio / np.hypot(1, ratio))
            x = x + np.clip(change, -3, 3)
            if np.all(np.abs(change) < 1e-10):
                break
        return np.asarray(x)

    def march(self, events: int, accuracy: float = 1e-5) -> Cycles:
        """Run until `events` events have ended; `accuracy` is the error of ln theta per step."""
        n, K, N = len(self.a), self.stiffness(), self.normal_stiffness()
        eta = self.shear_modulus / (2 * self.wave_speed)
        found = Cycles(0.5 * (self.cells[:-1] + self.cells[1:]))
        guess, presses = np.full(n, np.log(self.plate_rate)), bool(N.any())

        def rate(y: np.ndarray) -> np.ndarray:
            traction = self.initial_traction + eta * self.plate_rate + K @ y[:n]
            pressure = self.normal_stress + N @ y[:n] if presses else None
            return np.exp(self.log_rate(traction, y[n:], guess, pressure))

        def slope(_: float, y: np.ndarray) -> np.ndarray:
            V = rate(y)
            return np.concatenate([V - self.plate_rate, np.exp(-y[n:]) - V / self.D_c])

        start = np.concatenate([np.zeros(n), self.initial_age()])
        tolerance = accuracy * np.repeat([0.1, 1.0], n)  # m, 1
        with np.errstate(all="ignore"):  # trial steps that are too long
            steps = RK45(slope, 0.0, start, np.inf, rtol=accuracy, atol=tolerance, max_step=LONGEST, first_step=1e5)
            while found.over < events:
                steps.step()
                V = rate(steps.y)
                guess[:] = np.log(V)
                found.look(steps.t, V, steps.y[:n] + self.plate_rate * steps.t)
        return found


@dataclass(frozen=True)
class DippingFault(HalfSpaceFault):
    """The same in plane strain, on a fault that dips.

    Attributes
    ----------
    dip : float
        [rad]
    poisson_ratio : float
    sense : float
        1 for a thrust, -1 for a normal fault.
    """

    dip: float = np.pi / 2
    poisson_ratio: float = 0.25
    sense: float = 1.0

    def stiffness(self) -> np.ndarray:
        return self._stresses()[0]

    def normal_stiffness(self) -> np.ndarray:
        return self.sense * self._stresses()[1]

    def _stresses(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the shear stress that drives a thrust, and the pressure, by slip of a thrust [Pa/m]."""
        down = np.exp(-1j * self.dip)  # the body is below the real axis, and the fault dips to the right
        centres, ends = 0.5 * (self.cells[:-1] + self.cells[1:]) * down, self.cells * down
        # Around the upper end of a cell whose hanging wall slips up dip, the displacement grows by a metre down dip.
        stress = edge_dislocation(centres[:, None], ends, down, self.shear_modulus, self.poisson_ratio)
        both = stress[..., :-1] - stress[..., 1:]
        tangent, normal = (
            np.array([np.cos(self.dip), -np.sin(self.dip)]),
            np.array([np.sin(self.dip), np.cos(self.dip)]),
        )
        tensor = np.array([[both[0], both[2]], [both[2], both[1]]])
        traction = np.einsum("ij...,j->i...", tensor, normal)
        return np.einsum("i...,i->...", traction, -tangent), -np.einsum("i...,i->...", traction, normal)


def edge_dislocation(z: np.ndarray, at: np.ndarray, vector: complex, G: float, nu: float) -> np.ndarray:
    """Return the stresses xx, yy and xy [Pa] at z of edge dislocations in the half-plane below a free surface.

    The displacement, seen along a circle around a dislocation that is followed anticlockwise, grows by `vector` [m].
    """
    kappa = 3 - 4 * nu
    gamma = G * vector / (1j * np.pi * (kappa + 1))
    conjugate = np.conj(gamma)
    away, image = z - at, z - np.conj(at)

    phi, slope = gamma / away, -gamma / away**2
    psi = conjugate / away + gamma * np.conj(at) / away**2
    # Potentials with conjugate coefficients: singular at the image, analytic in the body.
    bar, bar_slope, bar_curve = conjugate / image, -conjugate / image**2, 2 * conjugate / image**3
    bar_psi, bar_psi_slope = (
        gamma / image + conjugate * at / image**2,
        -gamma / image**2 - 2 * conjugate * at / image**3,
    )
    added = -(bar + z * bar_slope + bar_psi)
    added_slope = -(2 * bar_slope + z * bar_curve + bar_psi_slope)
    psi = psi - bar - added - z * added_slope
    phi, slope = phi + added, slope + added_slope

    mean, deviator = 4 * phi.real, 2 * (np.conj(z) * slope + psi)  # xx + yy and yy - xx + 2 i xy
    return np.stack([0.5 * (mean - deviator.real), 0.5 * (mean + deviator.real), 0.5 * deviator.imag])
