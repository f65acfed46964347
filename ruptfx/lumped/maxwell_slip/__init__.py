"""Maxwell-slip ensemble: effect of roughness on stick-slip and steady sliding.

Independent blocks hang on springs from one driver and rub with Coulomb friction. A block's spring force rises with
the drive to mu_s N_b and falls by 2 (mu_s - mu_d) N_b at each slip. Blocks do not interact, so all slips are
known in closed form and the ensemble is followed exactly from slip to slip, for all realisations at once.

Forces are divided by the load of a block N_b, drive displacements by N_b / k, in everything below the case.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np
import xarray
from pydantic import Field, model_validator
from scipy.stats import beta

from ruptfx.input.quantities import at_least
from ruptfx.input.schema import Unit
from ruptfx.input.units import Fraction, NonNegative, Positive, Speed
from ruptfx.lumped import LumpedModel, Progress, Summary, silent, variable
from ruptfx.lumped.maxwell_slip.roughness import ContactLayer, Surface

Coefficient = NonNegative
Count = Annotated[int, Field(ge=1)]


class MaxwellSlip(LumpedModel):
    """Maxwell-slip ensemble: rough surfaces slide steadily, smooth ones stick and slip.

    Source: Baygeldi, Amireghbali, Gurel, Ozcan, Coker (2026), Mech. Adv. Mater. Struct.; the dynamic coefficient is
    not published, 0.225 puts the transition where theirs is.
    """

    example: ClassVar[str] = "alphas = [1e4, 1.0]\nblocks = 30\nrealisations = 2\nperiods = 6.0"

    mu_s: Coefficient = 0.3
    """Static coefficient of a block."""
    mu_d: Coefficient = 0.225
    """Dynamic coefficient of a block."""
    alphas: Annotated[list[Positive], Field(min_length=1)] = [1e5, 500.0, 50.0, 20.0, 10.0, 1.0]
    """Shape parameters of the Beta(alpha, alpha) distribution of initial extensions; small is rough."""
    blocks: Count = 300
    """Blocks of an ensemble."""
    realisations: Count = 100
    """Number of ensembles that are drawn and averaged."""
    periods: Positive = 20.0
    """Length of the run in slip periods, drive displacements of 2 (mu_s - mu_d) N_b / k."""
    normal_force: Annotated[Positive, Unit("N")] = 100.0
    """Load on all blocks together."""
    stiffness: Annotated[Positive, Unit("N/m")] = 1e4
    """Spring of one block."""
    drive_speed: Speed = 1e-5
    """Speed of the body that pulls all springs."""
    threshold: Fraction = 0.13
    """Stick-slip where the late peak-to-peak friction exceeds this fraction of 2 (mu_s - mu_d). The default places
    the transition of 300 blocks at the published alpha = 22; blocks in random phase give 1.2 / sqrt(blocks)."""
    seed: Annotated[int, Field(ge=0)] = 1
    """Seed of the random numbers."""
    layer: ContactLayer = ContactLayer()
    """Conversion of heights to spring extensions."""
    surfaces: list[Surface] = []
    """Surfaces to classify on the roughness map."""

    @model_validator(mode="after")
    def _usable(self) -> MaxwellSlip:
        if self.mu_d >= self.mu_s:
            raise ValueError(f"mu_d = {self.mu_d:g} must be less than mu_s = {self.mu_s:g}")
        if len(set(self.alphas)) != len(self.alphas):
            twice = sorted({alpha for alpha in self.alphas if self.alphas.count(alpha) > 1})
            raise ValueError(f"alphas: must differ from each other; give {', '.join(f'{a:g}' for a in twice)} once")
        # Every block has slipped after a drive displacement of 2 mu_s N_b / k; then the ensemble is periodic.
        needed = self.mu_s / (self.mu_s - self.mu_d) + 1
        if self.periods < needed:
            least = at_least(needed, 4)
            raise ValueError(f"periods = {self.periods:g}: must be at least {least}, when all blocks have slipped")
        return self

    @property
    def drop(self) -> float:
        """Fall of a block's force at a slip, over N_b; also the slip period in drive displacement."""
        return 2 * (self.mu_s - self.mu_d)

    def run(self, progress: Progress = silent) -> xarray.Dataset:
        random = np.random.default_rng(self.seed)
        shape = (self.realisations, self.blocks)
        ensembles = []
        for number, alpha in enumerate(self.alphas):
            progress(number / len(self.alphas), f"alpha = {alpha:g}")
            initial = self.mu_s * (2 * random.beta(alpha, alpha, shape) - 1)
            ensembles.append(slide(initial, self.mu_s, self.drop, self.periods))
        return self._dataset(ensembles)

    def _dataset(self, ensembles: list[Ensemble]) -> xarray.Dataset:
        per_block, length = self.normal_force / self.blocks, self.normal_force / self.blocks / self.stiffness
        alphas = np.array(self.alphas)
        corners = [e.corners(0) for e in ensembles]
        most_corners = max(len(s) for s, _ in corners)
        traces = np.full((2, len(alphas), most_corners), np.nan)
        slips, slipped = np.full((len(alphas), most_corners), np.nan), np.full((len(alphas), most_corners), -1)
        for row, ((displacement, friction), ensemble) in enumerate(zip(corners, ensembles, strict=True)):
            traces[:, row, : len(displacement)] = displacement, friction
            events = ensemble.count[0]
            slips[row, :events], slipped[row, :events] = ensemble.displacement[0, :events], ensemble.block[0, :events]
        static = np.array([e.static for e in ensembles])
        amplitude = np.array([e.late_amplitude for e in ensembles]) / self.drop
        mean = amplitude.mean(axis=1)
        fine = np.geomspace(min(0.5, alphas.min()), max(1e5, alphas.max()), 40)
        result = transition(alphas, mean, self.threshold)
        limit = [large_number_limit(alpha, self.mu_s, self.mu_d, blocks=1000) for alpha in fine]
        to_time = length / self.drive_speed
        dataset = xarray.Dataset(
            {
                "trace_time": variable(("alpha", "corner"), traces[0] * to_time, "s", "time"),
                "trace_friction": variable(
                    ("alpha", "corner"), traces[1], "1", "friction coefficient of the first realisation"
                ),
                "slip_time": variable(("alpha", "corner"), slips * to_time, "s", "time of a slip"),
                "slipped_block": variable(("alpha", "corner"), slipped, "1", "index of the block that slips"),
                "mu_static": variable(("alpha", "realisation"), static, "1", "macroscopic static coefficient"),
                "late_amplitude": variable(
                    ("alpha", "realisation"), amplitude, "1", "late peak-to-peak friction over 2 (mu_s - mu_d)"
                ),
                "stick_slip": variable("alpha", mean > self.threshold, "1", "stick-slip, by the mean amplitude"),
                "limit_mu_static": variable("alpha_fine", [x[0] for x in limit], "1", "static coefficient, N to inf"),
                "limit_amplitude": variable("alpha_fine", [x[1] for x in limit], "1", "late amplitude, N to inf"),
                "law_amplitude": variable(
                    "alpha_fine", late_amplitude_law(fine, self.mu_s, self.mu_d), "1", "(2/pi) exp(-2 pi^2 s^2)"
                ),
                "alpha_c": variable((), result, "1", "alpha at the transition"),
                "slip_period": variable((), self.drop * to_time, "s", "slip period"),
            },
            coords={
                "alpha": variable("alpha", alphas, "1", "shape parameter"),
                "alpha_fine": variable("alpha_fine", fine, "1", "shape parameter"),
            },
            attrs={
                "mu_s": self.mu_s,
                "mu_d": self.mu_d,
                "threshold": self.threshold,
                "blocks": self.blocks,
                "force_per_block": per_block,
            },
        )
        return dataset.merge(self._surfaces(self.layer.alpha_c or result), combine_attrs="drop_conflicts")

    def _surfaces(self, alpha_c: float) -> xarray.Dataset:
        """Return R_a, critical range, range of alpha and verdict of every surface."""
        layer, rows = self.layer, []
        for surface in self.surfaces:
            R_a = surface.roughness()
            critical = layer.critical(alpha_c, self.mu_s, surface.pressure)
            alphas = layer.alpha(R_a, self.mu_s, surface.pressure)
            verdict = layer.verdict(R_a, alpha_c, self.mu_s, surface.pressure)
            rows.append((surface.name, R_a, *critical, *alphas, verdict, surface.observed))
        columns: list[Any] = list(zip(*rows, strict=True)) if rows else [()] * 8
        names, sizes, low, high, alpha_low, alpha_high, verdicts, observed = columns
        bounds = layer.critical(alpha_c, self.mu_s)
        return xarray.Dataset(
            {
                "R_a": variable("surface", np.array(sizes, float), "m", "arithmetic mean roughness"),
                "R_a_crit_low": variable("surface", np.array(low, float), "m", "smallest critical roughness"),
                "R_a_crit_high": variable("surface", np.array(high, float), "m", "largest critical roughness"),
                "alpha_low": variable("surface", np.array(alpha_low, float), "1", "smallest shape parameter"),
                "alpha_high": variable("surface", np.array(alpha_high, float), "1", "largest shape parameter"),
                "verdict": variable("surface", np.array(verdicts, dtype=object), "", "predicted sliding"),
                "observed": variable("surface", np.array(observed, dtype=object), "", "observed sliding"),
                "verdict_alpha_c": variable((), alpha_c, "1", "alpha at the transition that verdicts use"),
                "R_a_crit_min": variable((), bounds[0], "m", "smallest critical roughness"),
                "R_a_crit_max": variable((), bounds[1], "m", "largest critical roughness"),
                "R_a_scale_min": variable(
                    (), layer.scale(self.mu_s, layer.contact_fraction_max), "m", "R_a sqrt(2 alpha + 1), smallest"
                ),
                "R_a_scale_max": variable(
                    (), layer.scale(self.mu_s, layer.contact_fraction_min), "m", "R_a sqrt(2 alpha + 1), largest"
                ),
            },
            coords={"surface": ("surface", np.array(names, dtype=object))},
        )

    @staticmethod
    def summarise(dataset: xarray.Dataset) -> Summary:
        summary = LumpedModel.summarise(dataset)
        for name in ("mu_static", "late_amplitude"):
            mean = dataset[name].mean("realisation").values
            summary |= {f"{name}_alpha_{a:g}": float(v) for a, v in zip(dataset.alpha.values, mean, strict=True)}
        for name, verdict, R_a in zip(*(dataset[k].values for k in ("surface", "verdict", "R_a")), strict=True):
            summary |= {f"verdict {name}": str(verdict), f"R_a {name}": float(R_a)}
        return summary


@dataclass
class Ensemble:
    """All slips of all realisations, in the order they happen.

    Attributes
    ----------
    initial : ndarray, shape (realisations,)
        Friction coefficient at the start, the mean extension.
    displacement : ndarray, shape (realisations, slips)
        Drive displacement at each slip, in N_b / k; infinite beyond the last slip of a realisation.
    block : ndarray, shape (realisations, slips)
        Index of the slipping block.
    drop : float
        Fall of a block's force at a slip, over N_b.
    end : float
        Drive displacement at the end.
    blocks : int
    """

    initial: np.ndarray
    displacement: np.ndarray
    block: np.ndarray
    drop: float
    end: float
    blocks: int

    @property
    def count(self) -> np.ndarray:
        """Number of slips of each realisation."""
        return np.isfinite(self.displacement).sum(axis=1)

    @property
    def before(self) -> np.ndarray:
        """Friction coefficient just before each slip: mu(s) = mu(0) + s - (slips so far) drop / blocks."""
        earlier = np.arange(self.displacement.shape[1]) * (self.drop / self.blocks)
        return self.initial[:, None] + self.displacement - earlier

    @property
    def static(self) -> np.ndarray:
        """Largest friction coefficient of each realisation."""
        before = self.before
        return np.max(before, axis=1, where=np.isfinite(before), initial=-np.inf)

    @property
    def late_amplitude(self) -> np.ndarray:
        """Exact peak-to-peak friction over the last slip period, in which every block slips once."""
        before = self.before
        late = np.isfinite(before) & (self.displacement > self.end - self.drop)
        high = np.max(before, axis=1, where=late, initial=-np.inf)
        return high - np.min(before, axis=1, where=late, initial=np.inf) + self.drop / self.blocks

    def corners(self, realisation: int) -> tuple[np.ndarray, np.ndarray]:
        """Return drive displacement [m] and friction coefficient [1] at the corners of the exact saw-tooth history.

        Both have shape (2 slips + 2,).
        """
        slips = self.displacement[realisation, : self.count[realisation]]
        before = self.before[realisation, : len(slips)]
        last = self.initial[realisation] + self.end - len(slips) * self.drop / self.blocks
        displacement = np.concatenate([[0.0], np.repeat(slips, 2), [self.end]])
        falls = np.column_stack([before, before - self.drop / self.blocks]).ravel()
        return displacement, np.concatenate([self.initial[[realisation]], falls, [last]])


def slide(initial: np.ndarray, mu_s: float, drop: float, periods: float) -> Ensemble:
    """Drag ensembles over a number of slip periods.

    Parameters
    ----------
    initial : ndarray, shape (realisations, blocks)
        Spring forces over N_b, at most mu_s in magnitude.
    mu_s, drop : float
        Static coefficient and fall of a block's force at a slip, over N_b.
    periods : float
        Drive displacement over `drop`.
    """
    end = periods * drop
    first = mu_s - initial
    # Slip n of a block occurs at first + n drop; sorting all slips gives the complete dynamics.
    all_slips = (first[:, :, None] + drop * np.arange(int(periods) + 1)).reshape(len(initial), -1)
    all_slips[all_slips > end] = np.inf
    order = np.argsort(all_slips, axis=1, kind="stable")
    sorted_slips = np.take_along_axis(all_slips, order, axis=1)
    return Ensemble(initial.mean(axis=1), sorted_slips, order // (int(periods) + 1), drop, end, initial.shape[1])


def late_amplitude_law(alpha: np.ndarray | float, mu_s: float, mu_d: float) -> np.ndarray:
    """Return the late peak-to-peak friction over 2 (mu_s - mu_d) of infinitely many blocks.

    First harmonic of Gaussian phases.

    A block's force is a saw-tooth of peak-to-peak drop and first harmonic (drop / pi) sin; phases scattered by s
    periods multiply it by exp(-2 pi^2 s^2), with s = mu_s / (2 (mu_s - mu_d) sqrt(2 alpha + 1)).
    """
    s = mu_s / (2 * (mu_s - mu_d) * np.sqrt(2 * np.asarray(alpha) + 1))
    return 2 / np.pi * np.exp(-2 * np.pi**2 * s**2)


def large_number_limit(alpha: float, mu_s: float, mu_d: float, blocks: int = 4000) -> tuple[float, float]:
    """Return static coefficient and late amplitude over 2 (mu_s - mu_d), with extensions at Beta quantiles."""
    initial = mu_s * (2 * beta.ppf((np.arange(blocks) + 0.5) / blocks, alpha, alpha) - 1)
    drop = 2 * (mu_s - mu_d)
    ensemble = slide(initial[None, :], mu_s, drop, np.ceil(2 * mu_s / drop) + 2)
    return float(ensemble.static[0]), float(ensemble.late_amplitude[0] / drop)


def transition(alpha: np.ndarray, amplitude: np.ndarray, threshold: float) -> float:
    """Return the shape parameter at which the amplitude crosses the threshold, linear in ln alpha; NaN if none."""
    order = np.argsort(alpha)
    x, y = np.log(alpha[order]), amplitude[order] - threshold
    crossing = np.flatnonzero((y[:-1] <= 0) & (y[1:] > 0))
    if not len(crossing):
        return float("nan")
    i = crossing[-1]
    return float(np.exp(x[i] - y[i] * (x[i + 1] - x[i]) / (y[i + 1] - y[i])))
