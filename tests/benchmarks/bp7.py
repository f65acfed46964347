"""A small earthquake on a round patch in a whole space: SCEC SEAS benchmark problem BP7-QD-A, quasi-dynamic.

Rate and state friction with the ageing law on a fault of 800 m by 800 m; velocity weakening within 200 m of its middle.
Around the fault the plates creep at 1e-9 m/s. A bell of shear traction, 50 m off the middle along strike and dip, sets
off the first event; here it acts from the start, in the problem it grows within the first second. The section of the
whole space repeats along strike (`mesh.along_strike`).

The description could not be read here. The values are those of two public codes for it (Thrase's BP7 input, with D_c =
0.53 mm, and the reference page of EQquasi for the bell); that the shear traction at the start is the one that friction
carries, as in BP5, is from memory. No published result could be read: meshes are compared with each other, and the
stress drop of the event with that of a crack with the same moment and radius (Eshelby 1957).

Coarse: points 50 m apart, the first event. G D_c / (b sigma) is 68 m. With `--fine` 25 m and 16.7 m.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ruptfx.app.bench import Check, Outcome
from ruptfx.case import Case
from ruptfx.platform import fem
from ruptfx.run.model import Model

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ruptfx.platform.fem import MPI

DENSITY, C_S, NU, SIGMA = 2670.0, 3464.0, 0.25, 25e6
G = DENSITY * C_S**2
A, A_MAX, B, D_C, F_0, V_0, V_P = 0.004, 0.016, 0.01, 0.53e-3, 0.6, 1e-6, 1e-9
HALF, RADIUS, FAR, PERIOD = 400.0, 200.0, 3e3, 1600.0  # m
BELL, WITHIN, OFF = 1.75e6, 150.0, -50.0  # Pa; m: its radius, and its place along both directions
ENDS = 1e-3  # m/s: the event ends when the largest slip rate passes this; it begins above, with the bell


def bell(z: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return the added shear traction at positions along strike and dip [Pa]."""
    square = (z - OFF) ** 2 + (x - OFF) ** 2
    inside = square < WITHIN**2
    return BELL * inside * np.exp(np.where(inside, square / np.where(inside, square - WITHIN**2, 1.0), 0.0))


def problem(spacing: float) -> Case:
    """Return the case with nodes `spacing` [m] apart."""
    z, x = np.arange(-PERIOD / 2, PERIOD / 2 + 1, 10.0), np.arange(0, 2 * PERIOD + 1, 10.0) - PERIOD
    grid = {"kind": "surface_table", "strike": z.tolist(), "dip": (x + PERIOD).tolist()}
    weak = np.hypot(z[None], x[:, None]) <= RADIUS
    moved = [{"kind": "driven", "edge": edge, "component": axis, "velocity": sign * V_P / 2 if axis == "z" else 0.0}
             for edge, sign in (("upper.top", 1.0), ("lower.bottom", -1.0)) for axis in "xyz"]  # fmt: skip
    step = 1.0
    ends = [PERIOD - HALF - step, PERIOD - HALF, PERIOD + HALF, PERIOD + HALF + step]
    creeps = {"kind": "table", "positions": ends, "values": [1.0, 0.0, 0.0, 1.0], "extend": True}
    return Case.model_validate({
        "plane": "solid", "order": 2, "duration": 100.0, "boundaries": moved,
        "mesh": {"kind": "two_plates", "length": 2 * PERIOD, "left": -PERIOD, "height": FAR, "growth": 1.3,
                 "element_size": 2 * spacing,
                 "along_strike": {"length": 2 * HALF, "period": PERIOD, "points": round(PERIOD / spacing),
                                  "creep": V_P}},
        "materials": {"default": {"kind": "isotropic_elastic", "young_modulus": 2 * G * (1 + NU),
                                  "poisson_ratio": NU, "density": DENSITY}},
        "faults": {"main": {
            "contact": {"kind": "compliant", "C_n": 1e13, "C_s": 1e13},
            "initial_stress": {"normal": SIGMA},
            "nucleation": [{"kind": "overstress", "extra": grid | {"values": bell(z[None], x[:, None]).tolist()}}],
            "prescribed_slip": [{"kind": "constant_rate", "rate": V_P,
                                 "where": {"kind": "along_dip", "profile": creeps}}],
            "friction": {
                "kind": "rate_and_state_ageing", "b": B, "D_c": D_C, "f_0": F_0, "V_0": V_0, "V_initial": V_P,
                "theta_initial": D_C / V_P, "a": grid | {"values": np.where(weak, A, A_MAX).tolist()},
            },
        }},
        "stepper": {"kind": "quasi_dynamic"}, "output": {"figures": False},
    })  # fmt: skip


class March(NamedTuple):
    """The first event: its end [s], time [s] and largest slip rate [m/s] of every step, fields at the end."""

    end: float
    times: list[float]
    rates: list[float]
    strike: np.ndarray
    dip: np.ndarray
    slip: np.ndarray
    traction_0: np.ndarray
    traction: np.ndarray

    def moment(self, spacing: float) -> float:
        """Moment of the slip [N m]."""
        return float(G * spacing**2 * self.slip.sum())


def march(case: Case) -> March:
    """Run to the end of the first event, or to the end of the case."""
    model = Model(case, fem.MPI.COMM_SELF)
    motion, state = case.stepper.bind(model), model.initial_state()
    state.lazy_bodies = True
    fault, fields = model.faults[0], state.faults["main"]
    face = fault.interface
    assert face.across is not None
    times: list[float] = []
    rates: list[float] = []
    while state.time < case.duration and (not rates or rates[-1] > ENDS):
        motion.step(state)
        times.append(state.time)
        rates.append(float(np.hypot(fields["slip_rate_1"], fields["slip_rate_2"])[~fault.is_held].max()))
    slip = np.where(fault.is_held, 0.0, fields["slip_1"])
    return March(
        state.time, times, rates, face.position, face.across - PERIOD, slip, fault.shear_traction_0[:, 0].copy(),
        fields["shear_traction_1"].copy(),
    )  # fmt: skip


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    del comm
    meshes = (25.0, 50.0 / 3) if fine else (50.0,)
    runs = [march(problem(spacing)) for spacing in meshes]
    best = runs[-1]
    away = np.hypot(best.strike, best.dip)
    at = int(np.argmin(np.hypot(best.strike - 100.0, best.dip - 100.0)))  # in the patch, beyond the bell
    carried = SIGMA * A * np.arcsinh(V_P / (2 * V_0) * np.exp((F_0 + B * np.log(V_0 / V_P)) / A))
    drop = float((best.traction_0 - best.traction)[away < RADIUS].mean())
    crack = 7 / 16 * best.moment(meshes[-1]) / RADIUS**3
    beyond = float(best.slip[np.abs(away - 300.0) < 25.0].max() / best.slip.max())
    source = "SEAS BP7-QD"
    checks = [
        Check("initial traction in the patch", carried, float(best.traction_0[at]), 1e-6, "Pa", source, relative=True),
        Check("first event: slip 300 m from the middle over the largest", 0.2, beyond, 0, "1", "arrest", "at most"),
        Check("first event: stress drop of the patch", crack, drop, 0.3, "Pa", "Eshelby (1957)", relative=True),
    ]
    if fine:
        quantities = {
            "moment": ("N m", [each.moment(spacing) for each, spacing in zip(runs, meshes, strict=True)]),
            "largest slip": ("m", [float(each.slip.max()) for each in runs]),
            "largest slip rate": ("m/s", [max(each.rates) for each in runs]),
            "end": ("s", [each.end for each in runs]),
        }
        checks += [
            Check(f"first event: {name}, both meshes", finer, coarser, 0.05, unit, "own run", relative=True)
            for name, (unit, (coarser, finer)) in quantities.items()
        ]
    return Outcome(checks, lambda: _draw(best))


def _draw(run: March) -> Figure:
    from ruptfx.results.figure_style import GUIDE, RATE_MAP, new_figure

    figure, (axes,) = new_figure(1, 2, 3.0, 8)
    axes[0].semilogy(run.times, run.rates, lw=0.8, color=GUIDE)
    axes[0].set(xlabel="Time (s)", ylabel="Largest slip rate (m/s)")
    inside = np.maximum(np.abs(run.strike), np.abs(run.dip)) <= HALF
    mesh = axes[1].tripcolor(
        run.strike[inside], run.dip[inside], 1e3 * run.slip[inside], cmap=RATE_MAP, shading="gouraud"
    )
    figure.colorbar(mesh, ax=axes[1], label="Slip (mm)")
    axes[1].set(xlabel="Strike (m)", ylabel="Dip (m)", title="Slip of the first event", aspect="equal")
    return figure
