"""Rigid contact: the same physics in steps of every kind, with a method for each kind."""

from __future__ import annotations

from importlib import import_module

from ruptfx.laws.contact import ContactMethod, Way

BY_STEPS = {
    ("explicit", False): ("split_node", "SplitNode"),
    ("explicit", True): ("forward_lagrange", "ForwardLagrange"),
    ("implicit", False): ("augmented_lagrangian", "AugmentedLagrangian"),
    ("implicit", True): ("augmented_lagrangian", "AugmentedLagrangian"),
}
"""Module and class of a rigid method, by the kind of steps and whether points depend on each other."""


class RigidContact(ContactMethod):
    """Rigid method, which steps of another kind replace by their own rigid method with its defaults."""

    def in_steps(self, way: Way, coupled: bool) -> ContactMethod:
        if getattr(self, way) and not (coupled and way == "explicit" and self.sweeps_to() is None):
            return self
        module, name = BY_STEPS[way, coupled]
        steps: ContactMethod = getattr(import_module(f"ruptfx.laws.contact.{module}"), name)()
        return steps
