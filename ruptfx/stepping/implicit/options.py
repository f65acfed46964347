"""PETSc options in a case: solver settings, nothing that writes files."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

# Viewers may print (`true`, `::ascii_info_detail`), not write files outside of the run directory.
_Word = Annotated[str, Field(pattern=r"^[A-Za-z0-9_,.+\-]*(::[a-z_]*)?$")]
_Key = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]

PetscOptions = dict[_Key, bool | int | float | _Word]
"""Without dash and prefix, for example ``{ snes_monitor = true, ksp_type = "fgmres" }``; they replace defaults."""
