"""Bulk waves: arrival of plane P and S waves, order of the spatial scheme on an exact vibration."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.small_cases import COMPLIANT, HOMALITE, SPLIT, advance, case, guided

pytest.importorskip("dolfinx")

from ruptfx.platform import fem
from ruptfx.run.model import Model

pytestmark = pytest.mark.fem


@pytest.mark.parametrize("plane", ["stress", "strain"])
@pytest.mark.parametrize("wave", ["P", "S"])
def test_arrival_at_eight_nodes_per_wavelength(wave: str, plane: str) -> None:
    """A wave packet crosses 20 of its wavelengths, each 8 node spacings (2 elements of order 4) long."""
    h, height = 1e-3, 30e-3
    strip = case({
        "plane": plane, "order": 4, "boundaries": guided("x" if wave == "P" else "y"), "faults.main.contact": SPLIT,
        "mesh": {"kind": "two_plates", "length": h, "height": height, "element_size": h},
        "faults.main.initial_stress.normal": 1e12,
    })  # fmt: skip
    model = Model(strip)
    motion, state = strip.stepper.bind(model), model.initial_state()
    E, nu, rho = HOMALITE["young_modulus"], HOMALITE["poisson_ratio"], HOMALITE["density"]
    # c_s = sqrt(G / rho); c_p = sqrt(E / (rho (1 - nu^2))) in plane stress.
    modulus = E / (1 - nu**2) if plane == "stress" else E * (1 - nu) / ((1 + nu) * (1 - 2 * nu))
    speed = np.sqrt((modulus if wave == "P" else E / 2 / (1 + nu)) / rho)
    length, begin = 2 * h, 20e-3

    def packet(y: np.ndarray) -> np.ndarray:
        return 1e-9 * np.cos(2 * np.pi * (y - begin) / length) * np.exp(-(((y - begin) / (1.5 * length)) ** 2))

    y, along = model.coordinates[:, 1], 1 if wave == "P" else 0
    state.displacement[along::2] = packet(y)
    # Downwards: u(y, t) = f(y + c t); the velocity is half a step behind.
    half = 0.5 * speed * motion.dt
    state.velocity[along::2] = (packet(y) - packet(y - 2 * half)) / motion.dt
    advance(motion, state, 20 * length / speed)
    travelled = speed * state.time
    # The shift that fits best.
    shifts = travelled * np.linspace(0.98, 1.02, 801)
    fits = [state.displacement[along::2] @ packet(y + shift) for shift in shifts]
    arrived = shifts[int(np.argmax(fits))]
    assert abs(arrived / travelled - 1) < 5e-3
    assert max(fits) > 0.7 * np.sum(packet(y) ** 2)


def distance(model: Model, displacement: np.ndarray, k: float, amplitude: float) -> float:
    """L2 norm of the difference from the mode, between the nodes too."""
    ufl = fem.ufl
    found = fem.dolfinx.fem.Function(model.space)
    found.x.array[:] = displacement
    x, y = ufl.SpatialCoordinate(model.mesh)
    mode = float(amplitude) * ufl.as_vector([ufl.cos(k * x) * ufl.sin(k * y), -ufl.sin(k * x) * ufl.cos(k * y)])
    dx = ufl.Measure("dx", domain=model.mesh, metadata={"quadrature_degree": 2 * model.case.order + 4})
    square = fem.form(ufl.inner(found - mode, found - mode) * dx)
    return float(np.sqrt(fem.dolfinx.fem.assemble_scalar(square)))


@pytest.mark.parametrize("contact", [COMPLIANT, SPLIT], ids=["compliant", "split_node"])
@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_order_of_the_spatial_scheme(order: int, contact: dict[str, Any]) -> None:
    """A Lame mode: exact in plane vibration of a free rectangle, without traction on the interface.

    With k = pi / L: u = (cos kx sin ky, -sin kx cos ky), omega = sqrt(2) c_s k. It is free of divergence and of shear
    strain, and its normal stress 2 G k sin kx sin ky vanishes on all lines x = n L and y = n L.
    """
    size = 8e-3
    k = np.pi / size
    errors = []
    for cells in (8, 16):
        free = case({
            "order": order, "faults.main.contact": contact,
            "mesh": {"kind": "two_plates", "length": size, "height": size, "element_size": size / cells},
        })  # fmt: skip
        model = Model(free)
        motion, state = free.stepper.bind(model), model.initial_state()
        x, y = model.coordinates.T
        mode = 1e-9 * np.stack([np.cos(k * x) * np.sin(k * y), -np.sin(k * x) * np.cos(k * y)], axis=1).ravel()
        omega = np.sqrt(2) * model.wave_speeds().c_s * k
        # The leapfrog scheme turns omega into omega' with sin(omega' dt / 2) = omega dt / 2: no error in time is left.
        discrete = 2 / motion.dt * np.arcsin(0.5 * omega * motion.dt)
        state.displacement[:] = mode
        advance(motion, state, 0.1 * 2 * np.pi / omega)  # short: errors of the frequency, O(h^2p), stay small
        errors.append(distance(model, state.displacement, k, 1e-9 * np.cos(discrete * state.time)))
    rate = np.log2(errors[0] / errors[1])
    assert abs(rate - (order + 1)) < 0.3
