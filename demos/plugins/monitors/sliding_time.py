"""Duration of sliding."""

import numpy as np

from ruptfx.plugin import Monitor

sliding_time = Monitor(
    "sliding_time", "s", "how long it slid faster than rupture_threshold",
    update=lambda old, at: old + np.where(at.speed > at.threshold, at.since, 0.0),
)  # fmt: skip
