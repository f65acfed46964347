"""Orthotropic linear elasticity."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Self

import numpy as np
from pydantic import model_validator

from ruptfx.input.units import Angle, ContractionRatio, Modulus
from ruptfx.laws.materials import Material, Plane

if TYPE_CHECKING:
    from ruptfx.platform.fem import Expr


class OrthotropicElastic(Material):
    """Orthotropic linear elasticity: rolled, layered, woven or fibre-reinforced bodies, with three planes of symmetry.

    Axes 1 and 2 lie in the plane, turned by `angle` from x and y; axis 3 is z. Five constants describe a body that is
    isotropic across axis 1, such as one with fibres along it; the others are for bodies that are not.
    """

    E_1: Modulus
    """Young's modulus along the first axis."""
    E_2: Modulus
    """Young's modulus along the second axis."""
    nu_12: ContractionRatio
    """Contraction along 2 over the stretch, under stress along 1; nu_21 is nu_12 E_2 / E_1."""
    nu_23: ContractionRatio
    """Contraction along the third axis under tension along the second."""
    G_12: Modulus
    """Shear modulus between the first and the second axis."""
    E_3: Modulus | None = None
    """Young's modulus along the third axis; default is E_2."""
    nu_13: ContractionRatio | None = None
    """Contraction along 3 under stress along 1; default is nu_12."""
    G_13: Modulus | None = None
    """Shear modulus between the first and the third axis; default is G_12."""
    G_23: Modulus | None = None
    """Shear modulus between the second and the third axis; default is E_2 / (2 (1 + nu_23))."""
    angle: Angle = 0.0
    """Angle from the x axis to axis 1 [rad], anticlockwise."""

    @model_validator(mode="after")
    def _is_stable(self) -> Self:
        lowest = np.linalg.eigvalsh(self._compliance()).min()
        if lowest <= 0:
            raise ValueError(
                f"E_1 = {self.E_1:g} Pa, E_2 = {self.E_2:g} Pa, nu_12 = {self.nu_12:g}, nu_23 = {self.nu_23:g}: some "
                "strain would release energy; |nu_ij| must stay below sqrt(E_i / E_j), and all three well below it "
                "together"
            )
        return self

    def _compliance(self) -> np.ndarray:
        """Return strains e_11, e_22, e_33 and 2 e_23, 2 e_13, 2 e_12 over stresses [1/Pa]; shape (6, 6)."""
        E_3 = self.E_2 if self.E_3 is None else self.E_3
        nu_13 = self.nu_12 if self.nu_13 is None else self.nu_13
        G_13, G_23 = self._antiplane()
        compliance = np.diag(1 / np.array([self.E_1, self.E_2, E_3, G_23, G_13, self.G_12]))
        compliance[0, 1] = compliance[1, 0] = -self.nu_12 / self.E_1
        compliance[0, 2] = compliance[2, 0] = -nu_13 / self.E_1
        compliance[1, 2] = compliance[2, 1] = -self.nu_23 / self.E_2
        return compliance

    def _antiplane(self) -> tuple[float, float]:
        """Return G_13 and G_23 [Pa]."""
        G_23 = self.E_2 / (2 * (1 + self.nu_23)) if self.G_23 is None else self.G_23
        return self.G_12 if self.G_13 is None else self.G_13, G_23

    def _stiffness(self, plane: Plane) -> np.ndarray:
        """Return stresses over strains along the axes of the material [Pa], in the order of `_compliance`.

        In the plane 11, 22, 12: plane stress reduces the compliance to these, plane strain the stiffness.
        """
        inside = np.ix_([0, 1, 5], [0, 1, 5])
        if plane == "antiplane":
            return np.diag(self._antiplane())
        if plane == "stress":
            return np.linalg.inv(self._compliance()[inside])
        stiffness = np.linalg.inv(self._compliance())
        return stiffness if plane == "solid" else stiffness[inside]

    def _of_springs(self, compliance: Callable[[float], float]) -> np.ndarray:
        """Return the compliances of springs for 11, 22 and 12, shear counted twice [1/Pa]; shape (3,).

        With stiffnesses in proportion to E(n), the modulus along the normal n of a facet, the strain is the mean of
        n (sigma n) / E(n) over all directions, made symmetric. As 1 / E(n) = s_11 c^4 + (2 s_12 + s_66) c^2 s^2 +
        s_22 s^4, means of products of cosines and sines give those of n n / E(n): (5 s_11 + 2 s_12 + s_66 + s_22) / 16
        along the first axis. In isotropic bodies it is 1 / (2 E).
        """
        s = self._compliance()
        mixed = 2 * s[0, 1] + s[5, 5]
        means = (5 * s[0, 0] + mixed + s[1, 1]) / 16, (s[0, 0] + mixed + 5 * s[1, 1]) / 16
        first, second = (compliance(1 / (2 * mean)) for mean in means)
        return np.array([first, second, first + second])

    def spring_share(self, plane: Plane, compliance: Callable[[float], float]) -> float:
        root = np.sqrt(self._of_springs(compliance))
        return float(np.linalg.eigvalsh(root[:, None] * self._stiffness(plane) * root).max())

    def stiffened(self, plane: Plane, compliance: Callable[[float], float]) -> OrthotropicElastic:
        """1 / E_1, 1 / E_2 and 1 / G_12 are less by those of the springs; strains across the stress remain."""
        less = self._of_springs(compliance)
        values = np.array([self.E_1, self.E_2, self.G_12])
        stiffer = 1 / (1 / values - less)
        along_1, along_2 = (stiffer / values)[:2].tolist()
        G_13, G_23 = self._antiplane()
        return self.model_copy(update={
            **dict(zip(("E_1", "E_2", "G_12"), stiffer.tolist(), strict=True)),
            "E_3": self.E_2 if self.E_3 is None else self.E_3, "G_13": G_13, "G_23": G_23,
            "nu_12": self.nu_12 * along_1, "nu_23": self.nu_23 * along_2,
            "nu_13": (self.nu_12 if self.nu_13 is None else self.nu_13) * along_1,
        })  # fmt: skip

    def energy_density(self, strain: Expr, plane: Plane) -> Expr:
        """Return e' C e / 2 [J/m3] with the strain along the axes of the material, shear counted twice."""
        import ufl

        c, s = np.cos(self.angle), np.sin(self.angle)
        turn = [[c, s], [-s, c]] if plane != "solid" else [[c, s, 0], [-s, c, 0], [0, 0, 1]]
        turn = ufl.as_matrix(np.array(turn).tolist())
        if plane == "antiplane":
            e = turn * strain
        else:
            turned = turn * strain * turn.T
            places = [(0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)] if plane == "solid" else [(0, 0), (1, 1), (0, 1)]
            e = ufl.as_vector([turned[i, j] if i == j else 2 * turned[i, j] for i, j in places])
        return 0.5 * ufl.inner(e, ufl.as_matrix(self._stiffness(plane).tolist()) * e)
