"""`ruptfx mesh`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ruptfx import RuptfxError
from ruptfx.commands._shared import CaseFile, Overrides, reported, screen

HEADING = "Compute"


def mesh(
    case: CaseFile,
    set_: Overrides = None,
    out: Annotated[Path | None, typer.Option(help="Picture; default NAME_mesh.png.")] = None,
) -> None:
    """Draw bodies, edges and interfaces of a case: names, elements, origin, normal, tangent and patches.

    In 3D: bodies in perspective, and a map of the initial shear traction of every surface.

    Example: ruptfx mesh demos/gmsh.toml --out mesh.png
    """
    with reported():
        from ruptfx.case import Case, read_case

        parsed = read_case(case, set_ or [])
        if not isinstance(parsed, Case):
            raise RuptfxError(f"{case}: {parsed.kind()} is a lumped model and has no mesh")
        from ruptfx.drawing.mesh_drawing import draw

        path = out or Path(f"{case.stem}_mesh.png")
        path.parent.mkdir(parents=True, exist_ok=True)
        draw(parsed).savefig(path, dpi=150)
        screen.print(f"Picture: {path}", soft_wrap=True)
