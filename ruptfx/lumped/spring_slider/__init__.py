"""Rate-and-state spring slider: one block, one spring, and the friction laws of the package."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, ClassVar, Union

import numpy as np
import xarray
from pydantic import Discriminator, Tag, model_validator

from ruptfx.input.schema import Unit
from ruptfx.input.units import NonNegative, Positive
from ruptfx.laws.friction import AnyFriction
from ruptfx.laws.friction.rate_and_state_ageing import RateAndStateAgeing
from ruptfx.laws.friction.rate_and_state_base import RateAndState
from ruptfx.lumped import LumpedModel, Progress, Summary, silent
from ruptfx.lumped.spring_slider.cycles import StickSlip
from ruptfx.lumped.spring_slider.fit import Fit
from ruptfx.lumped.spring_slider.pinned import FrequencyResponse, LoadingUnloading
from ruptfx.lumped.spring_slider.protocols import (
    Experiment,
    ModulatedSpeed,
    SlideHoldSlide,
    Temperatures,
    VelocitySteps,
)
from ruptfx.lumped.spring_slider.slider import Slider, critical_stiffness
from ruptfx.lumped.spring_slider.stability import Bifurcation, ModulatedLoad, StabilityDiagram

_EXPERIMENTS = (
    VelocitySteps, SlideHoldSlide, ModulatedSpeed, ModulatedLoad, StabilityDiagram, Bifurcation, StickSlip,
    LoadingUnloading, FrequencyResponse, Temperatures, Fit,
)  # fmt: skip


def _tag(value: object) -> str:
    # Tags in angle brackets are omitted from the keys in error messages.
    return f"<{value.get('kind')}>" if isinstance(value, Mapping) else f"<{getattr(value, 'name', None)}>"


if TYPE_CHECKING:
    AnyExperiment = Experiment
else:
    AnyExperiment = Annotated[
        Union[tuple(Annotated[cls, Tag(f"<{cls.name}>")] for cls in _EXPERIMENTS)],  # noqa: UP007
        Discriminator(
            _tag,
            custom_error_type="unknown_kind",
            custom_error_message=f"an experiment needs a 'kind', one of: {', '.join(c.name for c in _EXPERIMENTS)}",
        ),
    ]

PMMA = RateAndStateAgeing(a=0.013, b=0.026, D_c=0.42e-6, f_0=0.36, V_0=1e-6)


class SpringSlider(LumpedModel):
    """Rate-and-state slider on a spring: velocity steps, healing, stability, stick-slip, resonance, modulation, fits.

    Source: Baumberger, Berthoud, Caroli et al. (2001), C. R. Acad. Sci., eqs. 6-9; Ruina (1983). The default
    friction is of the size found for PMMA near room temperature.
    """

    example: ClassVar[str] = 'experiment = { kind = "velocity_steps", distance = 5e-6, samples = 100 }'

    friction: AnyFriction = PMMA
    """A rate and state law."""
    normal_force: Annotated[Positive, Unit("N")] = 16.0
    """Normal force W."""
    stiffness: Annotated[Positive, Unit("N/m")] = 1e6
    """K of the spring."""
    mass: Annotated[NonNegative, Unit("kg")] = 0.0
    """M; 0 is quasi-static."""
    interface_length: Annotated[NonNegative, Unit("m")] = 0.0
    """lambda: the interface is a spring of stiffness W / lambda; 0 is rigid."""
    experiment: AnyExperiment = VelocitySteps()
    """Experiment with the slider."""

    @model_validator(mode="after")
    def _usable(self) -> SpringSlider:
        if not isinstance(self.friction, RateAndState):
            raise ValueError(
                f"friction.kind = '{self.friction.kind()}': use rate_and_state_ageing, _slip, _saturating or _thermal"
            )
        if not self.friction.is_uniform():
            raise ValueError("friction: a single block has one value of each parameter; give numbers, no profile")
        return self

    def slider(self) -> Slider:
        """Return the slider."""
        assert isinstance(self.friction, RateAndState)
        return Slider(self.friction.isothermal(), self.normal_force, self.stiffness, self.mass, self.interface_length)

    @property
    def recovers(self) -> bool:
        return isinstance(self.experiment, Fit)

    def run(self, progress: Progress = silent) -> xarray.Dataset:
        slider = self.slider()
        assert isinstance(self.friction, RateAndState)
        dataset = self.experiment.run_with(self.friction, slider, progress)
        slider = self.experiment.resulting(slider, dataset)
        # Bifurcations and fits have some of these, of the same slider, as variables.
        dataset.attrs |= {name: value for name, value in self._constants(slider).items() if name not in dataset}
        return dataset

    def constants(self) -> dict[str, float | str]:
        return self._constants(self.slider())

    def _constants(self, slider: Slider) -> dict[str, float | str]:
        """Return the constants of a slider; critical ones are those at the speed of the experiment."""
        speed = getattr(self.experiment, "speed", float(slider.law.V_0))
        critical, omega = critical_stiffness(slider, speed)
        return {
            "K_c": critical,
            "K_over_K_c": self.stiffness / critical if critical else float("inf"),
            "onset_frequency": omega / (2 * np.pi),
            "a": float(slider.law.a),
            "b": float(slider.law.b),
            "normal_force": self.normal_force,
            "law": self.friction.kind(),
        }

    @staticmethod
    def summarise(dataset: xarray.Dataset) -> Summary:
        summary = LumpedModel.summarise(dataset)
        of_each = "step_direct step_steady static_friction loop_area mean_change amplitude period_exponent irreversible"
        for name in of_each.split():
            if name in dataset and dataset[name].ndim:
                summary[name] = dataset[name].values.ravel().tolist()
        if "k_c_linear" in dataset:
            error = np.abs(dataset.k_c_simulated - dataset.k_c_linear) / dataset.cell
            summary["largest_k_c_error_in_cells"] = float(error.max())
        return summary
