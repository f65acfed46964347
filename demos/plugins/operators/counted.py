"""An operator that counts its calls."""

import numpy as np

from ruptfx.plugin import UflForm


class Counted(UflForm):
    """The reference operator with a counter."""

    calls = 0

    def add_internal_force(self, displacement: np.ndarray, force: np.ndarray) -> None:
        self.calls += 1
        super().add_internal_force(displacement, force)
