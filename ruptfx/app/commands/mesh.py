"""`ruptfx mesh`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ruptfx import RuptfxError
from ruptfx.app.commands._shared import CaseFile, Overrides, Overwrite, begin, picture, reported, screen, writing

HEADING = "Compute"


def mesh(
    case: CaseFile,
    set_: Overrides = None,
    out: Annotated[Path | None, typer.Option(help="Picture; default NAME_mesh.png.")] = None,
    trust: Annotated[bool, typer.Option("--trust", help="Run plug-ins of a run directory.")] = False,
    overwrite: Overwrite = False,
) -> None:
    """Draw bodies, edges and interfaces of a case: names, elements, origin, normal, tangent and patches.

    The plug-ins of a case in a run directory are not executed without --trust.

    In 3D: bodies in perspective, and a map of the initial shear traction of every surface; with finite sliding both
    surfaces, and the initial gap.

    Example: ruptfx mesh demos/gmsh.toml --out mesh.png
    """
    begin(f"reading {case}")
    with reported():
        from ruptfx.case import Case, read_case

        path = picture(out or Path(f"{case.stem}_mesh.png"))
        _require_trust(case, trust)
        parsed = read_case(case, set_ or [])
        if not isinstance(parsed, Case):
            raise RuptfxError(f"{case}: {parsed.kind()} is a lumped model and has no mesh; give a case with bodies")
        from ruptfx.platform.progress import working

        with writing(path.parent, [case], overwrite) as files, working("meshing and drawing"):
            target = files.claim(path.name)
            from ruptfx.app.drawing.mesh_drawing import draw

            draw(parsed).savefig(target, dpi=150)
        screen.print(f"Picture: {path}", soft_wrap=True)


def _require_trust(case: Path, trust: bool) -> None:
    """Refuse to execute plug-ins of a run directory, which may be from somebody else, without being told to.

    Raises
    ------
    RuptfxError
    """
    from ruptfx.case import read_toml
    from ruptfx.platform import run_files

    if trust or not any((case.parent / name).exists() for name in (run_files.NAME, "summary.json")):
        return
    if names := read_toml(case).get("plugins"):
        raise RuptfxError(
            f"{case}: the case of a run directory with the plug-in {names[0] if isinstance(names, list) else names}, "
            "which can do what you can; read it, and if you trust it, add --trust"
        )
