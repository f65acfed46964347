"""Order in time of every friction law, at split nodes and in compliant contact, and a rupture at the usual step.

Two plates slide on each other under a load that grows smoothly; slip rate, state and all other fields of the interface
are compared, at the end, with those of a step sixteen times as short. Second order: halving the step divides the
difference by four. Compliant interfaces have no mass, so that without a direct effect their slip rate jumps where
sliding begins; the end is when all of them slide. Exponential velocity weakening is left out there: without mass,
state or a direct effect nothing limits its slip rate. With a length it has a solution there, of first order in the
step, as its state depends on the slip rate that jumps: left out, too.

Two ruptures at the step that the case chooses by itself are compared with short steps: an in-plane one with the ageing
law, nodes 100 m apart, and an antiplane one with the slip law, whose peak slip rate passes D_c within half a step. Most
of the misfit of the latter is grid noise, which leapfrog makes run too fast: with friction integrated exactly at every
point, in 32 parts of a step, it was 15 % at 3 km and 23 % at 4.5 km.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ruptfx import Table
from ruptfx.app.bench import Check, Outcome
from ruptfx.app.bench._rupture import Rupture, elastic, rupture
from ruptfx.case import Case
from ruptfx.input.fields import MONITORS
from ruptfx.platform import fem
from ruptfx.run.model import Model

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ruptfx.platform.fem import MPI

DURATION = 8e-6
STEPS = 160, 320, 2560
HOMALITE = {"kind": "isotropic_elastic", "young_modulus": 5.3e9, "poisson_ratio": 0.35, "density": 1246.0}
CONTACTS: dict[str, Table] = {
    "split_node": {"kind": "split_node"}, "compliant": {"kind": "compliant", "C_n": 300e9, "C_s": 100e9},
}  # fmt: skip
NORMAL, CREEPING_SHEAR = 6e6, 1.8e6  # Pa; laws that creep carry any shear stress at some slip rate

_COULOMB = {"kind": "coulomb", "mu_d": 0.3}
_CREEPING = {"a": 0.01, "b": 0.015, "D_c": 20e-6, "f_0": 0.3, "V_0": 1e-3, "V_initial": 1e-3}
_WEAKENING = {"mu_s": 0.35, "mu_d": 0.25}
_POWER_LAW = {
    "kind": "rate_and_state_power_law", "mu_s": 0.6, "mu_d": 0.4, "V_0": 100.0, "V_1": 29.0, "p": 1.2, "m": 5.0,
    "L_0": 10e-6, "theta_0_initial": 2e-4,
}  # fmt: skip
LAWS: dict[str, Table] = {
    "coulomb": _COULOMB,
    "linear_slip_weakening": {"kind": "linear_slip_weakening", **_WEAKENING, "D_c": 200e-6},
    "exponential_slip_weakening": {"kind": "exponential_slip_weakening", **_WEAKENING, "D_c": 20e-6},
    "velocity_weakening": {"kind": "velocity_weakening", **_WEAKENING, "V_w": 1.0},
    "velocity_weakening_over_slip": {
        "kind": "velocity_weakening_over_slip", **_WEAKENING, "V_w": 1.0, "L": 40e-6, "V_star": 0.1,
    },
    "rate_and_state_ageing": {"kind": "rate_and_state_ageing", **_CREEPING},
    "rate_and_state_slip": {"kind": "rate_and_state_slip", **_CREEPING},
    "rate_and_state_saturating": {"kind": "rate_and_state_saturating", **_CREEPING, "theta_c": 1e-5},
    "rate_and_state_flash_heating": {"kind": "rate_and_state_flash_heating", **_CREEPING, "f_w": 0.15, "V_w": 1.0},
    "rate_and_state_power_law": {**_POWER_LAW, "V_0": 5.0},
    "time_weakening": {"kind": "time_weakening", **_WEAKENING, "arrival": 0.0, "t_w": 2 * DURATION},
    "forced_weakening": {
        "kind": "forced_weakening", "mu_d": 0.25, "arrival": 0.0, "t_w": 2 * DURATION, "law": _COULOMB,
    },
    "pressurised": {"kind": "pressurised", "pressure": 1e6, "rise": 2 * DURATION, "law": _COULOMB},
    "cohesion": {"kind": "cohesion", "c": 0.3e6, "D_cohesion": 100e-6, "law": _COULOMB},
    "memory_constant_time": {"kind": "memory_constant_time", "t_c": 2e-6, "law": _COULOMB},
    "prakash_clifton": {"kind": "prakash_clifton", "L_p": 40e-6, "theta_p_ratio": 0.1, "law": _POWER_LAW},
    "prakash_clifton_two": {"kind": "prakash_clifton_two", "L_1": 40e-6, "L_2": 10e-6, "law": _COULOMB},
    "prakash_clifton, ageing": {
        "kind": "prakash_clifton", "L_p": 40e-6, "law": {"kind": "rate_and_state_ageing", **_CREEPING},
    },
}  # fmt: skip
# The slip rate jumps where sliding begins; the second has a solution, of first order as its state depends on that rate.
NOT_SMOOTH = {("velocity_weakening", "compliant"), ("velocity_weakening_over_slip", "compliant")}
RESOLVED = 3464.0 / (5 * 1e3 / 24)  # Hz; of the slip law rupture: five nodes, 1/24 km apart, per shear wavelength
FIELDS_OF_STEPS = ("mean_slip_rate", "opening", *(monitor.name for monitor in MONITORS))  # not of one time, or zero


def plates(law: Table, contact: Table, steps: int) -> Table:
    """Return two plates under growing shear traction and pressure; the interface is at the limit of sticking."""
    table: Table = {
        "plane": "stress", "order": 2, "duration": DURATION,
        "mesh": {"kind": "two_plates", "length": 12e-3, "height": 4e-3, "element_size": 2e-3},
        "materials": {"default": HOMALITE},
        "faults": {"main": {"contact": contact, "friction": law, "initial_stress": {"normal": NORMAL}}},
        "boundaries": [
            {"kind": "traction", "edge": edge, "traction": [sign * 4e6, -sign * 1e6], "ramp": 2 * DURATION}
            for edge, sign in (("upper.top", 1), ("lower.bottom", -1))
        ],
        "stepper": {"kind": "leapfrog", "time_step": DURATION / steps},
    }  # fmt: skip
    friction = Case.model_validate(table).faults["main"].friction
    sigma, zero = np.array([NORMAL]), np.zeros(1)
    assert friction is not None
    at_rest = np.asarray(friction.strength(zero, sigma, friction.initial_state(sigma, zero, zero)))
    table["faults"]["main"]["initial_stress"]["shear"] = float(at_rest[0]) or CREEPING_SHEAR
    return table


def fields(law: Table, contact: Table, steps: int, stepper: Table | None = None) -> dict[str, np.ndarray]:
    """Return the fields of the interface at the end."""
    table = plates(law, contact, steps)
    case = Case.model_validate({**table, "stepper": {**table["stepper"], **(stepper or {})}})
    model = Model(case, fem.MPI.COMM_SELF)
    motion, state = case.stepper.bind(model), model.initial_state()
    while state.fault_time < DURATION * (1 - 1e-9):
        motion.step(state)
    return {name: value.copy() for name, value in state.faults["main"].items() if name not in FIELDS_OF_STEPS}


def orders(
    law: Table, contact: Table, steps: tuple[int, int, int] = STEPS,
    stepper: Table | None = None,
) -> dict[str, float]:  # fmt: skip
    """Return the observed order of every field; the error of the shortest step makes 2.02 of second order."""
    coarse, middle, fine = (fields(law, contact, number, stepper) for number in steps)

    def error(run: dict[str, np.ndarray], name: str) -> float:
        return float(np.linalg.norm(run[name] - fine[name]))

    # A field that does not depend on the step, like the clock of a law, has no error and hence no order.
    moving = [name for name in fine if error(coarse, name) > 1e-11 * np.linalg.norm(fine[name])]
    return {name: float(np.log2(error(coarse, name) / error(middle, name))) for name in moving}


def ageing_rupture(factor: float, step: float | None = None) -> Rupture:
    """Run a rupture with the ageing law, started by overstress, in steps of `step` / `factor` [s]."""
    table = {
        "plane": "strain", "order": 4, "duration": 1.2,
        "mesh": {"kind": "half_plate", "length": 8e3, "height": 3.2e3, "element_size": 400.0},
        "materials": {"default": elastic(6000.0, 3464.0, 2670.0)},
        "damping": {"kelvin_voigt": {"eta": 7e-4}},  # 0.1 of the stable step; the same in all runs
        "faults": {"main": {
            "contact": {"kind": "split_node"},
            "friction": {
                "kind": "rate_and_state_ageing", "a": 0.008, "b": 0.012, "D_c": 0.02, "f_0": 0.6, "V_0": 1e-6,
                "V_initial": 1e-12,
            },
            "initial_stress": {"normal": 120e6, "shear": 75e6},
            "nucleation": {
                "kind": "overstress",
                "extra": {"kind": "boxcar", "center": 0.0, "half_width": 1.5e3, "inside": 50e6, "outside": 0.0},
            },
        }},
        "boundaries": [
            {"kind": "driven", "edge": "upper.left", "component": "y", "velocity": 0.0},
            {"kind": "absorbing", "edge": "upper.right"}, {"kind": "absorbing", "edge": "upper.top"},
        ],
        "stepper": {"kind": "leapfrog", **({} if step is None else {"time_step": step / factor})},
    }  # fmt: skip
    return rupture(table, energies=2)


def slip_law_rupture(
    duration: float, length: float, height: float, step: float | None = None, contact: Table | None = None
) -> Rupture:
    """Run an antiplane rupture with the slip law, elements of 1/6 km.

    Parameters of Kaneko, Lapusta and Ampuero (2008).

    A patch of 1.5 km, stressed above the rest, starts it at once; D_c / V at the front is about one step.
    """
    patch = {"kind": "boxcar", "center": 0.0, "half_width": 1.5e3, "inside": 81.6e6, "outside": 70e6}
    table = {
        "plane": "antiplane", "order": 4, "duration": duration,
        "mesh": {"kind": "half_plate", "length": length, "height": height, "element_size": 1e3 / 6},
        "materials": {"default": elastic(6000.0, 3464.0, 2673.0)},
        "faults": {"main": {
            "contact": contact or CONTACTS["split_node"],
            "friction": {
                "kind": "rate_and_state_slip", "a": 0.0125, "b": 0.0172, "D_c": 0.037, "f_0": 0.6, "V_0": 1e-6,
                "theta_initial": 92.713,
            },
            "initial_stress": {"normal": 120e6, "shear": patch},
        }},
        "boundaries": [{"kind": "absorbing", "edge": "upper.top"}, {"kind": "absorbing", "edge": "upper.right"}],
        "stepper": {"kind": "leapfrog", **({} if step is None else {"time_step": step})},
    }  # fmt: skip
    return rupture(table, energies=2)


def misfit(found: Rupture, expected: Rupture, position: float) -> float:
    """Return the misfit of the slip rate at a position [m], over its size."""
    rates = [np.abs(r.slip_rate[:, r.at(position)]) for r in (found, expected)]
    resampled = np.interp(expected.time, found.time, rates[0])
    return float(np.linalg.norm(resampled - rates[1]) / np.linalg.norm(rates[1]))


def resolved_misfit(found: Rupture, expected: Rupture, position: float) -> float:
    """Return the misfit of the slip rate at a position [m] below the frequency `RESOLVED`, over its size there.

    A Butterworth filter of fourth order runs forwards and backwards, so that it does not shift times.
    """
    from scipy.signal import butter, sosfiltfilt

    time = expected.time[1:]  # the first two records have one time
    low_pass = butter(4, RESOLVED, fs=1 / (time[1] - time[0]), output="sos")
    rates = [np.interp(time, r.time, np.abs(r.slip_rate[:, r.at(position)])) for r in (found, expected)]
    smooth = [sosfiltfilt(low_pass, rate) for rate in rates]
    return float(np.linalg.norm(smooth[0] - smooth[1]) / np.linalg.norm(smooth[1]))


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    """Check the orders of all laws; arrival, slip rate and peak of two ruptures."""
    del fine, comm
    checks = []
    for kind, contact in CONTACTS.items():
        for name, law in LAWS.items():
            if (name, kind) in NOT_SMOOTH:
                continue
            found = orders(law, contact)
            least = min(found, key=lambda field: found[field])
            checks.append(Check(f"{name}, {kind}", 1.9, found[least], 0, "1", f"least order: {least}", "at least"))
    usual = ageing_rupture(1.0)
    short = ageing_rupture(16.0, step_of(usual))
    at = usual.at(3e3)
    arrivals = [r.rupture_time(1.0)[at] for r in (usual, short)]
    rates = [np.abs(r.slip_rate[:, at]) for r in (usual, short)]
    own = f"own step of {step_of(short):.3g} s"
    checks += [
        Check("ageing rupture: arrival at 3 km", arrivals[1], arrivals[0], 4e-3, "s", own),
        Check("ageing rupture: misfit of the slip rate at 3 km", 0.0, misfit(usual, short, 3e3), 0.1, "1", own),
        Check("ageing rupture: peak at 3 km", rates[1].max(), rates[0].max(), 0.05, "m/s", own, relative=True),
        usual.budget(),
    ]
    box = 2.0, 10e3, 7.5e3  # s, m: reflections of the ends come too late
    slips = slip_law_rupture(*box)
    finest = slip_law_rupture(*box, step_of(slips) / 16)
    own = f"own step of {step_of(finest):.3g} s"
    two_pass = "two-pass scheme, same step"
    for x, late, noise, smooth in ((3e3, 1.8e-3, 0.17, 0.014), (4.5e3, 1.3e-3, 0.26, 0.044)):
        times = [r.rupture_time(0.1)[r.at(x)] for r in (finest, slips)]
        at_x = f"slip law rupture: {{}} at {x / 1e3:g} km"
        checks += [
            Check(at_x.format("arrival"), times[0], times[1], late, "s", own),
            Check(at_x.format("misfit of the slip rate"), 0.0, misfit(slips, finest, x), noise, "1", own),
            Check(at_x.format(f"misfit below {RESOLVED:.3g} Hz"), 0.0, resolved_misfit(slips, finest, x), smooth, "1",
                  two_pass),
        ]  # fmt: skip
    checks.append(Check("slip law rupture: energy closure", 0.0, slips.closure, 1e-3, "1", "exact"))
    return Outcome(checks, lambda: _draw([usual, short], [slips, finest]))


def step_of(run: Rupture) -> float:
    """Return the time step of a run [s]; its first two records have one time."""
    return float(run.time[2] - run.time[1])


def _draw(ageing: list[Rupture], slips: list[Rupture]) -> Figure:
    from ruptfx.results.figure_style import new_figure

    figure, (axes,) = new_figure(1, 2, 3.0, 7)
    drawn = ((ageing, 3e3, (0.4, 1.2), "Ageing law"), (slips, 4.5e3, (0.9, 1.5), "Slip law, D_c / V about a step"))
    for ax, (runs, position, limits, title) in zip(axes, drawn, strict=True):
        for result, style in zip(runs, ("C0-", "k:"), strict=True):
            rate = np.abs(result.slip_rate[:, result.at(position)])
            ax.plot(result.time, rate, style, label=f"step {1e3 * step_of(result):.3g} ms")
        ax.set(xlabel="Time (s)", ylabel=f"Slip rate at {position / 1e3:g} km (m/s)", xlim=limits, title=title)
        ax.legend(frameon=False)
    return figure
