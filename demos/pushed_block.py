# %% [markdown]
# # Fronts and precursors of a loaded block
#
# Nothing starts these fronts but slow loading. A block of 200 x 50 mm on a rigid base is sheared by its top under an
# even normal stress and under one that falls or rises along it; then it is pushed at its trailing edge, where
# precursors come long before it slides as a whole. Static friction is 0.6, 0.5 or 0.55 at random (30, 40, 30 % of cells
# of 5 mm).
#
# Left, the speed of the fronts against the ratio of shear to normal stress that they run into (Ben-David, Cohen and
# Fineberg 2010). Right, how far precursors reach against the force, beside the chain of blocks of the same stiffness
# (Rubinstein et al. 2011). Numbers are checked by `ruptfx bench front_types`.
#
# Run with `python demos/pushed_block.py`: some two minutes.

# %%
from pathlib import Path

import numpy as np

from ruptfx import read_case, simulate
from ruptfx.app.script import begin, save
from ruptfx.lumped.spring_block import SpringBlock
from ruptfx.results.analysis.slip_events import slip_events, speed_against_ratio
from ruptfx.results.figure_style import GUIDE, letter, new_figure, remark, styled

HERE = Path(__file__).parent
E, NU, RHO, LENGTH, HEIGHT = 2.6e9, 0.37, 1200.0, 0.2, 0.05  # of the block: Pa, 1, kg/m3, m, m
STATIC, PRESSURE, CELLS = 0.545, 5e6, 40  # mean static friction; Pa; cells of 5 mm
SPREAD, WINDOW = 12e-3, 18e-3  # m: half-length at which slip runs away, and process zone at rest, under 4 MPa
NORMAL = 'faults.main.initial_stress.normal={{ kind = "table", positions = [0.0, {}], values = {} }}'
LOADS = {
    "even": [], "falls": [NORMAL.format(LENGTH, [7e6, 3e6])], "rises": [NORMAL.format(LENGTH, [3e6, 7e6])],
}  # fmt: skip
COLOURS = {"even": "black", "falls": "#b5382a", "rises": "#2a6099", "pushed": "#3a8a3a"}
out = Path("runs/pushed_block")
begin(out)


def loaded(name, demo, *changes):
    """Record of the interface of a run, and its slip events."""
    case = read_case(HERE / f"{demo}.toml", overrides=[*changes, "output.figures=false"])
    data = simulate(case, out / name, overwrite=True).interface.load()
    return data, slip_events(data, case.output.rupture_threshold)


# %%
runs = {
    (load, seed): loaded(f"{load}_{seed}", "sheared_block", f"faults.main.friction.mu_s.seed={seed}", *changes)
    for load, changes in LOADS.items()
    for seed in (1, 2, 3)
}
runs["pushed", 1] = pushed = loaded("pushed", "pushed_block")
for (load, seed), (_, events) in runs.items():
    first = events[0]
    print(f"{load}, seed {seed}: {len(events)} events, the first from {1e3 * first.origin:.0f} mm")

# %% [markdown]
# The chain has a block for each cell, and one contact with a threshold as scattered as those of the cells. Its springs
# are E H / L of the slider and 3 G / H of the base: a bar whose shear stress falls to zero over its height.

# %%
chain = SpringBlock(
    blocks=CELLS, contacts=1, mass=RHO * LENGTH * HEIGHT, stiffness=E * HEIGHT / LENGTH,
    interface_ratio=3 * LENGTH**2 / (2 * (1 + NU) * HEIGHT**2 * CELLS), strength=STATIC * PRESSURE * LENGTH,
    scatter=0.076, delay=1e-3, damping=np.sqrt(E / (2 * (1 + NU) * RHO)) / HEIGHT,
    drive_stiffness=10 * E * HEIGHT / LENGTH, drive_speed=4e-4, large_events=1, duration=3.0,
)  # fmt: skip
springs = [chain.changed("seed", seed).run() for seed in (1, 2, 3)]
events = pushed[1]
for event in events:
    print(f"pushed with {event.force / 1e3:5.1f} kN/m: {event.begin * 1e3:.0f} to {event.reach * 1e3:.0f} mm, "
          f"{event.drop / 1e3:.1f} kN/m less after it")  # fmt: skip

# %%


@styled
def picture():
    """Front speed against the local ratio of the stresses; reach of precursors against the force."""
    figure, (axes,) = new_figure(1, 2, 3.2)
    left, right = axes
    for (load, seed), (data, found) in runs.items():
        pairs = [speed_against_ratio(each, data.position.values, WINDOW, 2 * SPREAD) for each in found]
        ratio, speed = np.hstack(pairs)
        label = ("pushed" if load == "pushed" else f"sheared, normal stress {load}") if seed == 1 else None
        left.plot(ratio, speed, ".", ms=4, color=COLOURS[load], label=label)
    attrs = pushed[0].attrs
    for name, label, side in (("c_R", "$c_R$", "top"), ("c_s", "$c_s$", "bottom"), ("c_p", "$c_l$", "center")):
        left.axhline(attrs[name], color=GUIDE, ls="--", lw=0.7)
        left.annotate(label, (1.01, attrs[name]), xycoords=("axes fraction", "data"), color=GUIDE, va=side)
    left.set(xlabel="Shear over normal stress before the front", ylabel="Speed of the front (m/s)", ylim=(0, 2700))
    left.legend(loc="upper left")
    for number, data in enumerate(springs):
        until = int(data.event_large.values.argmax()) + 1
        force, reach = data.event_force.values[:until], data.event_reach.values[:until] * 200 / data.sizes["block"]
        right.plot(force / 1e3, reach, "x", color="0.6", ms=3.5, label=None if number else "chain, 3 draws")
    right.plot([each.force / 1e3 for each in events], [each.reach * 1e3 for each in events], "o", ms=4,
               color=COLOURS["pushed"], label="block")  # fmt: skip
    right.set(xlabel="Force per metre of depth (kN/m)", ylabel="Reach of the event (mm)", xlim=(0, None), ylim=(0, 210))
    right.legend(loc="upper left")
    letter(axes)
    remark(figure, f"Speeds over {WINDOW * 1e3:.0f} mm, from {2 * SPREAD * 1e3:.0f} mm beyond where an event starts.")
    return figure


save(picture(), out / "pushed_block.png")
