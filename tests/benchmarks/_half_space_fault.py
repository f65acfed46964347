"""Quasi-dynamic cycles on a vertical fault in an antiplane half-space, by boundary integrals.

    tau_0 + K (s - V_p t) - eta V = a sigma asinh(V / (2 V_0) exp((f_0 + b ln(V_0 theta / D_c)) / a))
    ds/dt = V,   dtheta/dt = 1 - V theta / D_c

Independent of the finite elements, as a reference for them. Slip is uniform in every cell; below the last one
the fault slides at V_p. K is the stress at the centres of cells by the screw dislocations at their ends and by the
images of these above the surface. Runge-Kutta steps (SciPy) follow s - V_p t and ln theta.
Source: Segall (2010), Earthquake and Volcano Deformation, for the dislocations; Rice (1993) for eta.
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
        Depths of the ends of the cells.
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

    def initial_age(self) -> np.ndarray:
        """Return ln theta with which the fault carries the initial traction at V_p, shape (n,)."""
        drive = self.initial_traction / (self.a * self.normal_stress)
        psi = self.a * np.log(2 * self.V_0 / self.plate_rate * np.sinh(drive))
        return np.asarray(np.log(self.D_c / self.V_0) + (psi - self.f_0) / self.b)

    def log_rate(self, traction: np.ndarray, age: np.ndarray, guess: np.ndarray) -> np.ndarray:
        """Return ln V that balances friction and radiation, by Newton's method; NaN far from a solution."""
        eta, strength = self.shear_modulus / (2 * self.wave_speed), self.a * self.normal_stress
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
        n, K = len(self.a), self.stiffness()
        eta = self.shear_modulus / (2 * self.wave_speed)
        found = Cycles(0.5 * (self.cells[:-1] + self.cells[1:]))
        guess = np.full(n, np.log(self.plate_rate))

        def rate(y: np.ndarray) -> np.ndarray:
            traction = self.initial_traction + eta * self.plate_rate + K @ y[:n]
            return np.exp(self.log_rate(traction, y[n:], guess))

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
