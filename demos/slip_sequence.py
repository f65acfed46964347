# %% [markdown]
# # Slip sequences of a block pushed at its edge
#
# A block of 140 x 75 x 6 mm is pressed on a base by 3.3 kN and pushed at one edge, 2 to 13 mm above the base, through
# the spring of the loading machine. Long before it slides as a whole, parts of it slip that begin at the pushed edge,
# each on the whole longer than those before. They leave a contact that is strong beside the edge and weak beyond it,
# and later slides keep this profile (Rubinstein et al. 2011, fig. 3 to 6 and 12).
#
# Block, load, heights and spring are those of the source; friction, 0.35, 0.40 or 0.45 at random, is our choice. The
# real contact area is proportional to the normal stress here. Numbers are checked by `ruptfx bench slip_sequence`.
#
# Run with `python demos/slip_sequence.py`: about three minutes.

# %%
from pathlib import Path

import numpy as np

from ruptfx import simulate
from ruptfx.app.bench.slip_sequence import MACHINE, ROWS, UNTIL_SLIDE, EdgeAsperity, Sequence, line_of, pushed
from ruptfx.app.script import begin, save, save_numbers
from ruptfx.results.analysis.slip_events import speed_against_ratio
from ruptfx.results.figure_style import GUIDE, letter, new_figure, remark, styled

out = Path("runs/slip_sequence")
begin(out)


def sequence(name, case):
    """Events and contact profiles of a run."""
    return Sequence.of(simulate(case, out / name, overwrite=True).interface.load())


# %% [markdown]
# The lowest push goes on to the third slide; the others stop at the first one.

# %%
heights = {
    name: sequence(f"{name}_mm", pushed(rows, overrides=() if name == "2.1" else UNTIL_SLIDE))
    for name, rows in ROWS.items()
}
base = heights["2.1"]
for name, each in heights.items():
    shape = EdgeAsperity.of(each.position, each.at_force())
    end = f"ends {1e3 * shape.extent:.1f} mm" if np.isfinite(shape.extent) else "does not end within 70 mm"
    print(f"pushed at {name} mm: asperity {end} from the edge, area up to {shape.peak:.2f} of the initial one,")
    print(f"  and down to {shape.least:.2f} beyond the peak")
    for event in each.precursors:
        force, length = event.force / each.load, event.reach / each.length
        print(f"  {event.start:5.2f} s, F_S/F_N = {force:.3f}: from {1e3 * event.origin:.0f} mm, {length:.2f} L, "
              f"{event.drop / event.force:.1%} of the force less")  # fmt: skip
# The coefficient of static friction of the whole block is the force at which it first slides over F_N: strength is
# 0.40 in the mean, but it slides where parts of it have let go.
numbers = {}
for name, each in heights.items():
    start, last = each.precursors[0].start, each.slides[0].start
    half = [event.reach for event in each.precursors if event.start <= 0.5 * (start + last)]
    slide = speed_against_ratio(each.slides[0], each.position, 12e-3, 6e-3)[1]
    numbers |= {
        f"pushed at {name} mm: slowest 12 mm of the front of the first slide": (slide.min(), "m/s"),
        f"pushed at {name} mm: static coefficient": each.slides[0].force / each.load,
        f"pushed at {name} mm: first length l_0": (each.precursors[0].reach, "m"),
        f"pushed at {name} mm: longest event over L, first half of the time": max(half) / each.length,
        f"pushed at {name} mm: least area beyond the asperity": EdgeAsperity.of(each.position, each.at_force()).least,
    }
numbers["whole slides, pushed at 2.1 mm"] = len(base.slides)
save_numbers(out, numbers)
slope, spread = line_of(heights)
print(f"l/L = {slope:.2f} F_S/F_N at all heights, within {spread:.0%}, of growing events up to l = 0.5 L")
for number, event in enumerate(base.slides, 1):
    kept = np.corrcoef(*base.around(event))[0, 1]
    print(f"slide {number}: correlation of the profile before and after it {kept:.3f}")

# %% [markdown]
# ## What decides where events begin
#
# A machine ten times as stiff holds the edge back: what slips there must wait for it. Events then begin some 30 mm
# inside of the block, where the block itself is the spring. The drops of the force are larger than the printed 1 to
# 2 %; they follow the drop of friction, of which the source prints nothing (`ruptfx bench slip_sequence --fine`).

# %%
stiff = sequence("stiff", pushed((0, 1), 10 * MACHINE, UNTIL_SLIDE))
for name, each in (("printed stiffness", base), ("ten times as stiff", stiff)):
    origins = ", ".join(f"{1e3 * event.origin:.0f}" for event in each.precursors)
    print(f"{name}: precursors begin at {origins} mm")

# %%
COLOURS = dict(zip(heights, ("black", "#b5382a", "#3a8a3a", "#2a6099"), strict=True))


@styled
def map_of_area():
    """Contact area over place and time, and the force below it."""
    figure, ((top,), (bottom,)) = new_figure(2, 1, 4.6, sharex=True, height_ratios=(2, 1))
    rows = np.unique(np.searchsorted(base.time, np.arange(0, base.time[-1], 0.05)))
    mesh = top.pcolormesh(base.time[rows], 1e3 * base.position, base.area[rows].T, cmap="RdBu_r", vmin=0.4, vmax=1.6,
                          shading="nearest", rasterized=True)  # fmt: skip
    figure.colorbar(mesh, ax=top, label="Contact area / initial", extend="both")
    for event in base.events:
        top.plot(2 * [event.start], [1e3 * event.begin, 1e3 * event.reach], color="black", lw=0.8)
    top.set(ylabel="Position (mm)", ylim=(0, 140))
    bottom.plot(base.time[rows], base.force[rows], color="black", lw=0.8)
    bottom.set(xlabel="Time (s)", ylabel="$F_S/F_N$", ylim=(0, None))
    letter([top, bottom])
    remark(figure, "Lines: extent of each slip event. Pushed 2.1 mm above the base, at the lower edge of the map.")
    return figure


@styled
def lengths():
    """Lengths against force, height and time; profiles of the contact area."""
    figure, axes = new_figure(2, 3, 5.2)
    (force, height, time), (events, compared, memory) = axes
    for name, each in heights.items():
        pairs = [(event.force / each.load, event.reach / each.length) for event in [*each.precursors, *each.slides[:1]]]
        force.plot(*np.array(pairs).T, "o", ms=3.5, color=COLOURS[name], label=f"{name} mm")
        start, last = each.precursors[0].start, each.slides[0].start
        when = [((event.start - start) / (last - start), event.reach / each.length) for event in each.precursors]
        time.plot(*np.array([*when, (1.0, 1.0)]).T, "o-", ms=3, lw=0.6, color=COLOURS[name])
        compared.plot(1e3 * each.position, each.at_force(), lw=0.9, color=COLOURS[name])
    line = np.array([0.0, 0.5 / slope])
    force.plot(line, slope * line, ls=":", color=GUIDE, label=f"{slope:.1f} $F_S/F_N$")
    force.set(xlabel="$F_S/F_N$", ylabel="Length of the event / L", xlim=(0, None), ylim=(0, 1.05))
    force.legend(loc="upper left", fontsize=6)
    h = np.array([float(name) for name in heights])
    first = np.array([1e3 * each.precursors[0].reach for each in heights.values()])
    grows = [1e3 * each.extension for each in heights.values()]
    extent = [1e3 * EdgeAsperity.of(each.position, each.at_force()).extent for each in heights.values()]
    for values, marker, label in ((first, "s", "$l_0$"), (grows, "D", r"$\Delta l$, mean"), (extent, "o", "$D$")):
        height.plot(h, values, marker, ms=4, label=label)
    height.set(xlabel="Height of the push (mm)", ylabel="Length (mm)", xlim=(0, None), ylim=(0, None))
    height.legend(fontsize=6)
    time.set(xlabel="Time from first event to slide", ylabel="Length of the event / L", ylim=(0, 1.05))
    for number, event in enumerate(base.precursors):
        grey = f"{0.75 - 0.75 * number / len(base.precursors):.2f}"
        events.plot(1e3 * base.position, base.around(event)[1], lw=0.9, color=grey, label=f"event {number + 1}")
    for number, event in list(enumerate(base.slides, 1))[1:3]:
        for profile, style in zip(base.around(event), ("-", "--"), strict=True):
            memory.plot(1e3 * base.position, profile, style, lw=0.9, color=f"C{number}",
                        label=f"{'before' if style == '-' else 'after'} slide {number}")  # fmt: skip
    for ax in (events, compared, memory):
        ax.axhline(1, color=GUIDE, lw=0.6, ls=":")
        ax.set(xlabel="Position (mm)", ylabel="Contact area / initial", ylim=(0, 4))
    events.legend(fontsize=6)
    memory.legend(fontsize=6)
    letter(axes.ravel())
    remark(figure, "(d) after the events of the lowest push; (e) all heights at 75 % of the force of the first slide; "
                   "(f) lowest push, before and after whole slides.")  # fmt: skip
    return figure


save(map_of_area(), out / "area.png")
save(lengths(), out / "lengths.png")
