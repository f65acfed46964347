# %% [markdown]
# # Before it slides: precursors of an edge-loaded slider
#
# Push a long block at its edge. It does not slide as a whole at some force; well before, the end that is pushed comes
# loose, again and again, each time over a longer stretch. The model is a chain of blocks on springs, each held to the
# base by a hundred small springs, the contacts. A contact breaks at a force of its own, and comes back unstretched
# after a few milliseconds. Everything else (fronts, their speeds, the precursors) follows.
#
# Model and values: Rubinstein, Barel, Reches, Braun, Urbakh, Fineberg (2011), PAGEOPH 168.
#
# Run with `python demos/spring_block.py`; its first half is `ruptfx run demos/spring_block.toml`.

# %%
from pathlib import Path

import numpy as np

from ruptfx import read_case
from ruptfx.app.script import begin, save, save_numbers
from ruptfx.lumped import simulate
from ruptfx.results.figure_style import GUIDE, new_figure, remark, styled

out = Path("runs/spring_block")
begin(out, ranks=False)
case = Path(__file__).with_name("spring_block.toml")
soft = simulate(read_case(case), out / "soft", overwrite=True)
stiff = simulate(read_case(case, ["interface_ratio=50"]), out / "stiff", overwrite=True)

# %% [markdown]
# `figures/onset_of_sliding.png` has the force on the pushed edge, the compression inside the slider, the detached
# contacts and the forces of the contacts, against time. Force drops are small until all blocks detach; then the
# slider moves, in many fronts one after the other, and the force falls by hundreds of newtons.

# %%
for name, data in (("soft", soft), ("stiff", stiff)):
    print(f"{name} interface (K_s / K = {data.attrs['interface_ratio']:g})")
    print(f"  first contact breaks at {float(data.first_break_force):.0f} N")
    print(f"  precursors {int(data.precursors)}, the largest takes {float(data.largest_precursor_drop):.0f} N off")
    print(f"  large events take {float(data.mean_large_drop):.0f} N off")
    print(f"  slow fronts before sliding: {int(data.slow_fronts)}")
    print(f"  fast fronts: {float(data.fast_front_speed):.2f} of the chain's wave speed")
    print(f"  stress kept by the slider through the first large event: {100 * float(data.retained_stress):.0f} %")

numbers = {}
for name, data in (("soft", soft), ("stiff", stiff)):
    whole, counted = np.flatnonzero(data.event_large.values), data.event_blocks.values > 2
    reach = data.event_reach.values.astype(int)[counted]
    until = int(np.argmax(reach == data.sizes["block"])) + 1
    before = [int(each.sum()) for each in np.split(counted, whole + 1)[: len(whole)]]
    numbers |= {
        f"{name} interface: last blocks of events of 3 blocks or more, until one is the last of all": ", ".join(
            map(str, reach[:until])
        ),
        f"{name} interface: events of 3 blocks or more before each slide": ", ".join(str(n - 1) for n in before),
        f"{name} interface: speed of the first slide over that of its fronts": float(data.chaining),
    }

# %% [markdown]
# The soft interface has slow fronts: blocks that detach one by one, a hundred times slower than the fronts within an
# event, because each waits for the load to come up on it alone. Where such a block is about to let go when a fast
# front starts from the edge, it starts a front of its own; `figures/fronts.png` shows several of them at once, and
# together they cover the chain faster than each runs. A stiff interface has neither, and lets go of its stress when it
# slides, so that every later event is prepared by precursors again.
#
# ## What you may change
#
# Contacts that strengthen with the time they last (`ageing`), and a push above the interface (`loading_height`),
# whose moment takes contacts from the trailing edge and adds them to the leading one. One large event is enough here.

# %%
for changes in ([], ["ageing=0.05", "ageing_time=0.1"], ["loading_height=0.01"]):
    name = "_".join(changes).replace("=", "_") or "plain"
    data = simulate(read_case(case, [*changes, "large_events=1"]), out / name, overwrite=True)
    print(f"{name:<26} slides at {float(data.event_force[data.event_large.astype(bool)][0]):.0f} N")

# %% [markdown]
# ## What decides the speed of the fronts
#
# The source says that fronts accelerate until they approach the wave speed of the chain, and that its results do not
# depend on the damping. Here they do. A block on its contacts has the frequency sqrt(K_s / m); the printed damping is
# 3.5 times as high, so that a block creeps to its new place, and the median front has 0.06 of the wave speed. It grows
# as damping over frequency falls, by a lower damping, by stiffer contacts, or by a lower mass: the printed mass of
# 11.5 kg is 150 times that of the block of 140 x 75 x 6 mm. Scatter and delay change little.

# %%
PRINTED = 3.45e4  # 1/s
SCANNED = {
    "soft": [{"damping": PRINTED / factor} for factor in (1, 3, 10, 30, 100)],
    "stiff": [{"interface_ratio": 50.0, "damping": PRINTED / factor} for factor in (1, 100)],
    "mass of the block": [{"mass": 0.0756}],
    "scatter 0.01, 0.2": [{"scatter": 0.01}, {"scatter": 0.2}],
    "delay 50 ms": [{"delay": 0.05}],
}
model = read_case(case).changed("large_events", 1).changed("duration", 3.0)
speeds = {}
for name, runs in SCANNED.items():
    for changes in runs:
        chain = model.model_copy(update=changes)
        frequency = np.sqrt(chain.interface_ratio * chain.stiffness * chain.blocks / chain.mass)
        data = chain.run()
        row = chain.damping / frequency, float(data.front_speed), float(data.fast_front_speed)
        speeds.setdefault(name, []).append(row)
        print(f"{name:<18} damping / frequency {row[0]:6.3f}: fronts at {row[1]:.3f} of the wave speed, median")


@styled
def picture():
    """Median and 95th percentile of the front speed against the damping."""
    figure, ((ax,),) = new_figure(1, 1, 3.0)
    for number, (name, rows) in enumerate(speeds.items()):
        damping, median, fast = np.array(rows).T
        ax.plot(damping, median, "osD^v"[number], color=f"C{number}", label=name)
        ax.vlines(damping, median, fast, color=f"C{number}", lw=0.8)
    ax.axvline(2, color=GUIDE, ls="--", lw=0.7)
    ax.annotate("critical", (2, 0.97), xytext=(-3, 0), textcoords="offset points", color=GUIDE, va="top", ha="right")
    ax.set(xscale="log", ylim=(0, 1), xlabel=r"Damping over frequency, $\eta\,/\sqrt{K_s/m}$",
           ylabel="Front speed / wave speed of the chain")  # fmt: skip
    ax.legend()
    remark(figure, "Symbols: median of all fronts until the first large event; lines: to the 95th percentile.")
    return figure


save(picture(), out / "front_speed.png")
save_numbers(out, numbers)
print(f"figures in {out}")
