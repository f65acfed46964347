# %% [markdown]
# # Roughness: stick-slip or steady sliding?
#
# Take a slider apart into blocks that do not touch each other. Each hangs on a spring from the same slow driver and
# rubs with Coulomb friction: it holds until its spring pulls with mu_s N_b, then jumps ahead so far that the force
# falls by 2 (mu_s - mu_d) N_b. One such block can only stick and slip. Many of them slip together if their springs
# start alike (a smooth interface), and one after the other if they do not (a rough one): then the jumps average out
# and the slider moves steadily, although nothing about the friction of a block has changed.
#
# The initial extensions follow a Beta(alpha, alpha) distribution: large alpha is smooth, small alpha rough.
# Model: Baygeldi, Amireghbali, Gurel, Ozcan, Coker (2026), Mech. Adv. Mater. Struct.
#
# Run with `python demos/maxwell_slip.py`; the same as `ruptfx run demos/maxwell_slip.toml`.

# %%
from pathlib import Path

import numpy as np

from ruptfx import read_case
from ruptfx.app.script import begin
from ruptfx.lumped import simulate
from ruptfx.lumped.maxwell_slip import MaxwellSlip

out = Path("runs/maxwell_slip")
begin(out, ranks=False)
model = read_case(Path(__file__).with_name("maxwell_slip.toml"))
data = simulate(model, out / "sweep", overwrite=True)

# %% [markdown]
# `figures/friction_histories.png` shows the six histories over the raster of slipping blocks: vertical lines where
# all slip together, an even spread where they do not. The amplitude that is left after the start decides what to
# call it; it must exceed `threshold` times that of a single block.

# %%
for alpha, amplitude, unstable in zip(
    data.alpha.values, data.late_amplitude.mean("realisation").values, data.stick_slip.values, strict=True
):
    print(f"alpha = {alpha:>8g}   late amplitude {amplitude:.3f}   {'stick-slip' if unstable else 'steady sliding'}")
print(f"transition at alpha = {float(data.alpha_c):.3g}")

# %% [markdown]
# Infinitely many blocks would follow the blue line of `figures/late_amplitude.png`; its first harmonic is
# (2/pi) exp(-2 pi^2 s^2), with s the scatter of the phases in periods. A few hundred blocks in random phase still
# shake by about 1.2 / sqrt(N) of a single block, which is why the threshold cannot be zero.
#
# ## Real surfaces
#
# The height scatter of a surface and alpha are related by the shear of the contact layer under the pressure of the
# real contacts, R_a = 2 mu_s p / (f G sqrt(pi (2 alpha + 1))) h. The real-contact fraction f is not well known, and
# so is not the critical roughness, that of the alpha at the transition found above; a surface inside the uncertain band
# is called `undecided`.

# %%
print(f"critical R_a between {float(data.R_a_crit_min) * 1e6:.3f} and {float(data.R_a_crit_max) * 1e6:.3f} um")
for row in (data.isel(surface=i) for i in range(data.sizes["surface"])):
    seen = f"{row.verdict.item():<11} seen: {row.observed.item()}"
    print(f"{row.surface.item():<22} R_a {float(row.R_a) * 1e6:7.3f} um   {seen}")

# %% [markdown]
# ## Your own surface
#
# Give a height profile as text: heights, or positions and heights. R_a is taken about the mean line, after a Gaussian
# filter if you give its cutoff. One alpha shows no transition: the verdict takes the one that the sweep found.

# %%
random = np.random.default_rng(0)
position = np.linspace(0, 4e-3, 4000)
waviness = 3e-6 * np.sin(2 * np.pi * position / 2e-3)
np.savetxt(
    out / "profile.csv",
    np.column_stack([position, waviness + 0.25e-6 * random.standard_normal(4000)]) * 1e6,
    delimiter=",",
    header="x [um],z [um]",
    comments="",
)
mine = MaxwellSlip(
    alphas=[20.0],
    realisations=20,
    layer={"alpha_c": float(data.alpha_c)},
    surfaces=[
        {"name": "raw", "profile": str(out / "profile.csv"), "profile_unit": 1e-6},
        {"name": "filtered", "profile": str(out / "profile.csv"), "profile_unit": 1e-6, "cutoff": 0.25e-3},
    ],
).run()
for row in (mine.isel(surface=i) for i in range(2)):
    print(
        f"{row.surface.item():<9} R_a {float(row.R_a) * 1e6:.3f} um, alpha {float(row.alpha_low):.3g} to "
        f"{float(row.alpha_high):.3g}: {row.verdict.item()}"
    )
print(f"figures in {out / 'sweep' / 'figures'}")
