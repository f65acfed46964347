"""Two rough bodies slide on each other: work of the normal stress, which should vanish, over that of friction.

Opposed waves of 10 um and 0.6 mm on bodies of 5.3 and 3.392 GPa (plane strain) whose elements differ by a factor of
1.37, friction 0.3, pressed with 5 MPa and damped for 15 us, then driven at 10 m/s without damping. Normal and friction
work are counted from there. What is left is the plastic impact of nodal masses that meet, of first order in the size
of elements, and the effect of updates of the mortar pairing; frames of the wrong surface, or coupling by collocation,
give percents. The budget of all energies closes to round-off, with contact springs as well. Their energy changes
at every update, as the gap of the current surfaces replaces that of the frozen frames; this change is the column
`pairing_update_loss` in the budget, and vanishes to first order in `update_slip` and in the size of elements.
"""

from __future__ import annotations

from benchmarks._rubbing_blocks import Blocks, rub
from ruptfx.app.bench import Check, Outcome
from ruptfx.app.bench._parts import ratio
from ruptfx.platform import fem

SIZES = (0.1e-3, 0.05e-3)
SPRINGS = {"kind": "compliant", "C_n": 1e14, "C_s": 1e14}
FOLLOWS = (0.0125, 0.05)  # the second is the default
SOURCE = "no work without gap"


def run(fine: bool, comm: fem.MPI.Comm) -> Outcome:
    way = 2e-3 if fine else 0.3e-3
    found = [rub(Blocks(size, 2, way), comm) for size in SIZES]
    checks = [
        Check(f"normal / friction work, elements of {size * 1e3:g} mm", 0.0, each.impact, 0.006, "1", SOURCE)
        for size, each in zip(SIZES, found, strict=True)
    ]
    worst = max(each.missing for each in found)
    checks.append(Check("energy not accounted for", 0.0, worst, 1e-10, "1", "discrete budget"))
    often, seldom = (rub(Blocks(SIZES[0], 2, way, contact=SPRINGS, follow=follow), comm) for follow in FOLLOWS)
    worst = max(often.missing, seldom.missing)
    checks.append(Check("with springs: energy not accounted for", 0.0, worst, 1e-10, "1", "discrete budget"))
    checks.append(Check(f"taken at updates / work, update_slip {FOLLOWS[0]:g}", 0.0, often.updates, 0.002, "1", SOURCE))
    more = ratio(seldom.updates, often.updates)
    checks.append(Check(f"that of update_slip {FOLLOWS[1]:g} over it", 4.0, more, 0.0, "1", "first order", "at least"))
    if fine:  # over 2 mm; a part of that is too short for a mean
        label = f"taken at updates / work, update_slip {FOLLOWS[1]:g}"
        checks.append(Check(label, 0.0, seldom.updates, 0.002, "1", SOURCE))
        more = ratio(found[0].impact, found[1].impact)
        checks.append(Check("ratio of the two", 2.0, more, 0.0, "1", "first order in the size", "at least"))
        for order, size in ((1, 0.05e-3), (4, 0.1e-3)):
            share = rub(Blocks(size, order, way), comm).impact
            checks.append(Check(f"normal / friction work, order {order}", 0.0, share, 0.006, "1", SOURCE))
    return Outcome(checks)
