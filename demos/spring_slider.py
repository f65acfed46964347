# %% [markdown]
# # One block, one spring: rate-and-state friction
#
# The friction laws of the field solver, on the smallest system that can show them: a block on a spring that is pulled
# at a given speed. F = W [mu_0 + a ln(V / V_0) + b ln(theta V_0 / D_c)], with theta the age of the contacts
# (Baumberger, Berthoud, Caroli et al. 2001; Ruina 1983). Constants are those of PMMA near room temperature, in order
# of magnitude.
#
# Run with `python demos/spring_slider.py`; its first experiment is `ruptfx run demos/spring_slider.toml`. Every
# experiment is one table `[experiment]` of the case.

# %%
from pathlib import Path

import numpy as np

from ruptfx.app.script import begin, save_numbers
from ruptfx.case import parse_case
from ruptfx.lumped import simulate

out = Path("runs/spring_slider")
begin(out, ranks=False)
pmma = {"kind": "rate_and_state_ageing", "a": 0.013, "b": 0.026, "D_c": 0.42e-6, "f_0": 0.36, "V_0": 1e-6}
base = {"kind": "spring_slider", "normal_force": 16.0, "stiffness": 1e6, "friction": pmma}


def run(name, folder=None, **changes):
    case = parse_case({**base, "experiment": {"kind": name}, **changes})
    return simulate(case, out / (folder or name), overwrite=True)


# %% [markdown]
# ## Velocity steps
#
# At a jump of the speed by a factor of ten the friction first rises by nearly a ln 10, then falls to a new steady
# value lower by (b - a) ln 10, over a slip of D_c.

# %%
steps = run("velocity_steps")
print("steady change per e-fold:", steps.step_steady.values.round(5), "(a - b = -0.013)")

# %% [markdown]
# ## Slide, hold, slide
#
# Contacts strengthen with time: the static friction grows by b with each e-fold of the time at rest.

# %%
holds = run("slide_hold_slide")
print(f"static friction per e-fold of hold: {float(holds.healing_slope):.5f} (b = 0.026)")

# %% [markdown]
# ## Memory
#
# If the speed swings slowly, friction follows its steady value; if faster than contacts are renewed, it runs round a
# loop.

# %%
loops = run("modulated_speed")
for period, area in zip(loops.period.values, loops.loop_area.values, strict=True):
    print(f"period {period:>4g} s: loop area {area:.4f}")

# %% [markdown]
# ## When steady sliding is unstable
#
# Below K_c = W (b - a) / D_c the slider oscillates. 40 x 40 sliders are integrated together and compared with the
# linear analysis. Where ageing saturates for young contacts, K_c falls with the speed.

# %%
saturating = {**pmma, "kind": "rate_and_state_saturating", "f_0": 0.2, "theta_c": 1e-3}
diagram = run("stability", friction=saturating)
error = float(np.abs(diagram.k_c_simulated - diagram.k_c_linear).max() / diagram.cell)
print(f"boundary: simulation within {error:.2f} cells of the linear analysis")
numbers = {"boundary of stability: cells beside the linear analysis": error}

# %% [markdown]
# With a mass to end the slips, the oscillation can be followed beyond K_c. With the ageing law its amplitude jumps at
# K_c; with the saturating law it grows continuously from zero, as Baumberger and others (2001) measured, here with the
# square root of 1 - K / K_c.

# %%
ratios = [0.8, 0.9, 0.95, 0.98, 1.02]
for law in (pmma, {**pmma, "kind": "rate_and_state_saturating", "theta_c": 0.1}):
    experiment = {"kind": "bifurcation", "ratios": ratios}
    cycles = run("bifurcation", f"bifurcation_{law['kind']}", mass=1.63, friction=law, experiment=experiment)
    for ratio, amplitude in zip(cycles.ratio.values, cycles.amplitude.values, strict=True):
        over = amplitude / np.sqrt(1 - ratio) if ratio < 1 else np.nan
        numbers |= {f"{law['kind']}, K/K_c {ratio:g}: amplitude over root": over} if ratio < 1 else {}
        print(f"{law['kind']}, K / K_c = {ratio:<5g} peak-to-peak friction {amplitude:.4f}, over root {over:.4f}")

# %% [markdown]
# ## Stick-slip
#
# On a spring softer than K_c the slider sticks and slips: the time from slip to slip falls with the drive speed as a
# power, and a larger load has larger drops.

# %%
experiment = {"kind": "stick_slip", "normal_forces": [8.0, 16.0, 32.0]}
slips = run("stick_slip", mass=1.63, stiffness=1e5, experiment=experiment).isel(stiffness=0)
for load, exponent, drops in zip(
    slips.normal_force.values, slips.period_exponent.values, slips.force_drop.values, strict=True
):
    print(f"W = {load:g} N: period ~ V^{exponent:.3f}, mean drop {drops.mean():.2f} N")
    numbers |= {f"{load:g} N: exponent of the period": exponent, f"{load:g} N: drop": (drops.mean(), "N")}

# %% [markdown]
# ## The pinned interface
#
# Below the static force the interface is elastic. The law creeps near it: half of the static force leaves nothing that
# could be measured (the source saw an irreversible displacement above half of it). Small oscillations resonate.

# %%
elastic = {"interface_length": 0.4e-6, "stiffness": 3e4, "mass": 1.63}
loading = run("loading_unloading", **elastic)
for fraction, slip in zip(loading.fraction.values, loading.irreversible.values, strict=True):
    print(f"loaded to {fraction:g} of the static force: irreversible slip {1e6 * slip:.2g} um")
    numbers[f"irreversible slip at {fraction:g}"] = (slip, "m")
resonance = run("frequency_response", **elastic, experiment={"kind": "frequency_response", "loss_tangent": 1 / 19})
print(f"resonance {float(resonance.resonance):.0f} Hz, quality {float(resonance.quality):.1f} (measured: 761, 19)")
numbers |= {"resonance": (float(resonance.resonance), "Hz"), "quality": float(resonance.quality)}

# %% [markdown]
# ## Temperature
#
# With a shift factor a_T of the contact time, friction at all temperatures lies on one curve over the time divided by
# a_T: it rises by b ln(1/a_T) between two of them. The source prints no constants; C_1 and C_2 are our choice.

# %%
thermal = {"kind": "rate_and_state_thermal", "T_0": 293.0, "temperature_initial": 293.0, "C_1": 8.0, "C_2": 100.0}
heat = run("temperatures", stiffness=1e7, friction={**pmma, **thermal},
           experiment={"kind": "temperatures", "temperatures": [293.0, 323.0, 353.0]})  # fmt: skip
rise = (heat.static_friction - heat.static_friction[0]).mean("hold")
for temperature, by_run, shift in zip(heat.temperature.values[1:], rise.values[1:], heat.shift_factor.values[1:],
                                      strict=True):  # fmt: skip
    by_law = -pmma["b"] * np.log(shift)
    print(f"{temperature:g} K: static friction higher by {by_run:.4f}, b ln(1/a_T) = {by_law:.4f}")
    numbers |= {f"{temperature:g} K: rise of static friction": by_run, f"{temperature:g} K: b ln(1/a_T)": by_law}

# %% [markdown]
# ## A trembling normal load
#
# If the load swings at 120 Hz the mean friction falls, and sliding is stable on softer springs. The interface is
# elastic here (lambda = 0.4 um).

# %%
load = run("modulated_load", interface_length=0.4e-6)
for eps, change, K_c in zip(load.eps.values, load.mean_change.values, load.K_c_loaded.values, strict=True):
    print(f"eps = {eps:<5g} mean friction {100 * change:7.2f} %   K_c {K_c / 1e3:6.1f} kN/m")
    numbers |= {f"eps {eps:g}: change of the mean": (100 * change, "%"), f"eps {eps:g}: K_c": (K_c / 1e3, "kN/m")}

# %% [markdown]
# ## a, b and D_c from a measurement
#
# A friction trace with the columns time, drive_speed and friction is fitted; here a noisy one from the model itself.

# %%
steps = {"kind": "velocity_steps", "distance": 5e-6, "samples": 200}
fine = simulate(parse_case({**base, "experiment": steps}), out / "trace", overwrite=True)
# The first sample of a segment repeats the time of the last of the one before.
keep = np.append(np.diff(fine.time.values) > 0, True)
noisy = fine.friction.values + 1e-3 * np.random.default_rng(0).standard_normal(fine.sizes["sample"])
table = np.column_stack([fine.time, fine.drive_speed, noisy])[keep]
np.savetxt(out / "trace.csv", table, delimiter=",", header="time,drive_speed,friction", comments="")
guess = {**pmma, "a": 0.01, "b": 0.02, "D_c": 0.7e-6}
fit = run("fit", friction=guess, experiment={"kind": "fit", "trace": str(out / "trace.csv")})
for name in ("a", "b", "D_c"):
    low, high = float(fit[f"{name}_low"]), float(fit[f"{name}_high"])
    print(f"{name:<4} {float(fit[name]):.4g}   95 %: {low:.4g} to {high:.4g}")

# %% [markdown]
# ## Numbers
#
# Results that the page from a paper to a command shows.

# %%
numbers |= {f"loop area at {period:g} s": area for period, area in
            zip(loops.period.values, loops.loop_area.values, strict=True)}  # fmt: skip
numbers["static friction per e-fold of hold"] = float(holds.healing_slope)
save_numbers(out, numbers)
print(f"figures in {out}")
