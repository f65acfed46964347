"""Half models: what has a mirror image at the plane y = 0 of a one-sided interface."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ruptfx.input.schema import CaseError
from ruptfx.laws.materials.stiffness import tangent_stiffness

if TYPE_CHECKING:
    from ruptfx.bodies.space.discretisation import Discretisation

COUPLED = 1e-9  # of the largest stiffness: rounding of rotated axes


def reversed_components(model: Discretisation) -> str:
    """Return the components of vectors that the mirror image reverses, of ``xyz``; none without an image."""
    kinds = set(model.bodies.one_sided.values())
    components = {1: "z", 2: "xy", 3: "xyz"}[model.components]
    across = {"antisymmetric": False, "symmetric": True}
    return "".join(each for each in components if any(across.get(kind) == (each == "y") for kind in kinds))


def refuse_other_images(model: Discretisation) -> None:
    """Refuse materials whose response in the mirror image is not the image of their response.

    Antisymmetric motion reverses strain, besides its reflection; only linear materials reverse their stress with it.

    Raises
    ------
    CaseError
    """
    remedy = "make the whole, without half or with two plates"
    for name, material in zip(model.bodies.names, model.materials, strict=True):
        key = f"materials.{name}.kind = '{material.kind()}'"
        if "antisymmetric" in model.bodies.one_sided.values() and material.has_memory() and not material.linear:
            raise CaseError(
                f"{key}: yield and damage in the mirror image of a half model are other ones, as the image has the "
                f"opposite stress beyond the initial one; {remedy}"
            )
        if reversed_components(model):
            stiffness = tangent_stiffness(material, model.plane)
            odd = np.sum(np.indices(stiffness.shape) == 1, axis=0) % 2 == 1
            if np.abs(stiffness[odd]).max() > COUPLED * np.abs(stiffness).max():
                raise CaseError(
                    f"{key}: its stiffness is not the same in the mirror image of a half model, y to -y; turn its axes "
                    f"along x and y, or {remedy}"
                )
