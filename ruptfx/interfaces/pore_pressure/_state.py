"""The state theta of friction laws, which pore pressures with dilatancy follow."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ruptfx.input.schema import CaseError

if TYPE_CHECKING:
    from ruptfx.interfaces.mechanisms.system import System


def require_state(model: System, key: str) -> None:
    """Refuse dilatancy where the friction law has no state theta.

    Raises
    ------
    CaseError
    """
    law = model.case.faults[key.split(".")[1]].law
    if "theta" not in law.all_state_fields():
        raise CaseError(
            f"{key}: dilatancy follows the state theta, and the friction law '{law.kind()}' has none; use "
            "kind = 'rate_and_state_ageing', or remove the dilatancy"
        )
