"""Inputs of SEM2DPACK as cases.

A file per concern: `blocks` reads namelists, `materials`, `mesh`, `boundaries`, `fault`, `sources`, `receivers` and
`steps` convert theirs, `distributions` makes profiles, `layout` names bodies and edges. Everything without counterpart
is listed at once, by block and key; differences stand at the head of the case.

Source: the users' guide of SEM2DPACK and the descriptions of its input blocks (github.com/jpampuero/sem2dpack).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import tomli_w

from ruptfx import RuptfxError, Table
from ruptfx.app.convert.sem2dpack import boundaries, fault, materials, mesh, receivers, sources, steps
from ruptfx.app.convert.sem2dpack.blocks import LEFT_OUT, NO_COUNTERPART, Block, ConversionError, Input, read
from ruptfx.app.convert.sem2dpack.layout import Layout, arrange
from ruptfx.case import parse_case

__all__ = ["Conversion", "ConversionError", "convert", "convert_file"]
INFINITE = 1e30


@dataclass(frozen=True)
class Conversion:
    """A converted input.

    Attributes
    ----------
    text : str
        The case file, with the notes as comments at its head.
    notes : list of str
        Differences between the input and the case.
    mesh : str or None
        Text of the Gmsh file that the case names; None where ruptfx makes the mesh.
    """

    text: str
    notes: list[str]
    mesh: str | None


def convert(
    text: str,
    source: str = "Par.inp",
    folder: Path | None = None,
    mesh_file: str = "Par.msh",
    without: Iterable[str] = (),
) -> Conversion:
    """Convert an input.

    Parameters
    ----------
    text : str
        Content of the input file.
    source : str
        Name of the input, for the head of the case.
    folder : Path or None
        Folder of the files that the input names.
    mesh_file : str
        Name of the Gmsh file, where the case needs one.
    without : iterable of str
        Features to leave out although they change the result, by the names that a refusal lists, such as ``GENERAL.W``.

    Raises
    ------
    ConversionError
        With every reason.
    """
    value = Input(read(text), folder, {name.lower() for name in without})
    case = _Case(value, mesh_file)
    table = case.table()
    if value.problems:
        lines = ["no counterpart, or incomplete:", *(f"  {each}" for each in value.problems)]
        if names := _removable(text, value, mesh_file):
            options = " ".join(f"--without {name}" for name in names)
            lines.append(f"can be left out of the case, which changes the result: {options}")
        raise ConversionError("\n".join(lines))
    head = [f"# From {source} of SEM2DPACK, by: ruptfx convert", *(f"# - {note}" for note in value.notes)]
    return Conversion("\n".join(head) + "\n" + tomli_w.dumps(table), value.notes, case.mesh_text)


def _removable(text: str, value: Input, mesh_file: str) -> list[str]:
    """Return the refused features without which fewer problems remain; none if the case without them is invalid."""
    refused = dict.fromkeys(each.partition(":")[0] for each in value.problems if not each.startswith("&"))

    def attempt(names: Iterable[str]) -> tuple[Input, Table]:
        again = Input(read(text), value.folder, value.without.union(name.lower() for name in names))
        return again, _Case(again, mesh_file).table()

    names = [name for name in refused if set(attempt([name])[0].problems) < set(value.problems)]
    remaining, table = attempt(names)
    if not remaining.problems:
        try:
            parse_case(table)
        except RuptfxError:
            return []
    return names


def convert_file(path: Path, mesh_file: str, without: Iterable[str] = ()) -> Conversion:
    """Convert a file, as `convert`.

    Raises
    ------
    ConversionError
    """
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise ConversionError(f"{path}: cannot be read ({error.strerror}); give the path of a Par.inp") from None
    try:
        return convert(text, path.name, path.parent, mesh_file, without)
    except ConversionError as error:
        raise ConversionError(f"{path}: {error}") from None


class _Case:
    """The stages of a conversion; one that fails reports why, and those that do not need it go on."""

    def __init__(self, given: Input, mesh_file: str) -> None:
        self.given, self.mesh_file = given, mesh_file
        self.mesh_text: str | None = None
        self.case: Table = {}
        self.bodies: mesh.Mesh | None = None
        self.media: dict[int, materials.Medium] = {}
        self.fault: boundaries.Fault | None = None
        self.layout: Layout | None = None

    def table(self) -> Table:
        """Return the case; incomplete where there are problems."""
        self._blocks()
        for stage in (self._general, self._mesh, self._materials, self._fault, self._arrange):
            self.given.collect(stage)
        for stage in (self._time, self._damping, self._interface, self._boundaries, self._receivers):
            if self.layout is not None:
                self.given.collect(stage)
        order = ("title", "plane", "order", "operator", "duration", "positions", "stepper")
        return {key: self.case[key] for key in order if key in self.case} | self.case

    def _blocks(self) -> None:
        modules = (boundaries, fault, materials, mesh, receivers, sources, steps)
        known = {"GENERAL"}.union(*(module.READS for module in modules))
        for block in self.given.blocks:
            if block.name.startswith(LEFT_OUT):
                self.given.note(f"left out: &{block.name}")
            elif block.name not in known and not block.name.startswith(("DIST_", "MAT_")):
                self.given.refuse(block.name, NO_COUNTERPART)

    def _general(self) -> None:
        general = self.given.one("GENERAL")
        components = int(general.number("ndof", 2))
        self.case |= {
            "title": str(general.get("title", "")).strip(), "plane": "antiplane" if components == 1 else "strain",
            "order": int(general.number("ngll", 9)) - 1,
        }  # fmt: skip

    def _mesh(self) -> None:
        self.bodies = mesh.read(self.given)

    def _materials(self) -> None:
        self.media = materials.read(self.given)

    def _fault(self) -> None:
        self.fault = boundaries.fault(self.given)

    def _arrange(self) -> None:
        if self.bodies is None or not self.media or "order" not in self.case:
            return
        tags = self.fault.tags if self.fault else ()
        layout = arrange(self.given, self.bodies, self.media, tags, self.case["order"])
        if not layout.viscosity_is_a_layer(self.media):
            layout = arrange(self.given, self.bodies, self.media, tags, self.case["order"], viscous_apart=True)
        self.case |= {"mesh": layout.mesh_table(self.mesh_file), "materials": layout.materials(self.media)}
        self.layout = layout

    def _time(self) -> None:
        time = self.given.one("TIME")
        self.case["duration"] = steps.duration(time)
        if table := steps.stepper(self.given, time):
            self.case["stepper"] = table

    def _damping(self) -> None:
        assert self.layout is not None
        blocks = [medium.viscosity for medium in self.media.values() if medium.viscosity is not None]
        where = self.layout.viscous_part(self.media)
        if where is None:
            return
        first = blocks[0]
        if any(block.values != first.values for block in blocks):
            self.given.refuse("MAT_KV.eta", "several viscosities")
        viscosity: Table = dict(where)
        eta = first.number("eta", 0.0)
        if first.word("etah"):
            eta, thickness = self._bell(first)
            viscosity = {"thickness": thickness}
        if eta == 0:
            return
        if first.get("etaxdt", True):
            viscosity["fraction"] = eta
            self.given.note("Kelvin-Voigt: eta over the stable step instead of over the step")
        else:
            viscosity["eta"] = eta
        self.case["damping"] = {"kelvin_voigt": viscosity}

    def _bell(self, block: Block) -> tuple[float, float]:
        """Return the viscosity at the fault and its width, of a bell across the fault."""
        shape = next(iter(self.given.following(block, ("DIST_",), ("MATERIAL",))), None)
        if shape is None or shape.name != "DIST_GAUSSIAN" or self.layout is None:
            self.given.refuse("MAT_KV.etaH", "viscosity that is no bell across the fault")
            return 0.0, 1.0
        width = shape.pair("length", (1.0, 1.0))[1]
        self.given.note(f"Kelvin-Voigt: eta, a bell of {width:g} m across the fault, is constant within that distance")
        return shape.number("ampli", 1.0), width

    def _interface(self) -> None:
        if self.fault is None or self.layout is None:
            return
        antiplane = self.case["plane"] == "antiplane"
        line = self.layout.line()
        if line.along_x:
            self.case["positions"] = "x"
        self.case["faults"] = {"main": fault.read(self.given, self.fault, line, antiplane)}
        block = self.fault.blocks[0] if self.fault.blocks else None
        if block is not None and block.number("otd", 0.0) > 0:
            self.case["output"] = {"interface_interval": block.number("otd")}

    def _boundaries(self) -> None:
        assert self.layout is not None
        plane, duration = self.case["plane"], self.case.get("duration", 1.0)
        result, open_edges = boundaries.read(self.given, self.layout, plane)
        self.mesh_text = self.layout.gmsh()
        width = self.given.one("GENERAL").number("w", INFINITE)
        if width < INFINITE:
            result.append({"kind": "body_spring", "width": width})
            if any(medium.table["kind"] != "isotropic_elastic" for medium in self.media.values()):
                self.given.note("the restoring force of the width W acts in all bodies, also in inelastic ones")
        self.case["boundaries"] = sources.read(self.given, self.layout, plane, duration, result, open_edges)

    def _receivers(self) -> None:
        assert self.layout is not None
        time = self.given.one("TIME")
        time_step = steps.step(time, self.layout, self.media, self.case["plane"] == "antiplane")
        shortest = time_step if "dt" in time.values else steps.LARGEST / time.number("courant", 0.5) * time_step
        if result := receivers.read(self.given, self.layout, time_step, shortest):
            self.case["instruments"] = result
