"""Boundaries of SEM2DPACK: absorbing, periodic, Dirichlet and Neumann edges."""

from __future__ import annotations

from dataclasses import dataclass

from ruptfx import Table
from ruptfx.app.convert.sem2dpack.blocks import Block, ConversionError, Input
from ruptfx.app.convert.sem2dpack.layout import Layout

READS = {"BC_DEF", "BC_ABSORB", "BC_DIRNEU", "BC_PERIODIC"}
FAULTS = ("DYNFLT", "LISFLT")
REFUSED = {
    "KINFLT": "a fault with prescribed slip", "DIRABS": "edges that are driven and absorb", "SWFFLT": "an old kind",
}  # fmt: skip


@dataclass
class Fault:
    """A boundary that is a fault: its tags, its kind, and the blocks after it."""

    tags: tuple[int, ...]
    kind: str
    blocks: list[Block]


def fault(value: Input) -> Fault | None:
    """Return the fault of an input; None where there is none.

    Raises
    ------
    ConversionError
        There are several, or its tags are not 5, 6 or one edge.
    """
    items = [block for block in value.all("BC_DEF") if block.word("kind") in FAULTS]
    if not items:
        return None
    tags = tuple(sorted(items[0].integers("tags", "tag")))
    if len(items) > 1:
        raise ConversionError(f"&BC_DEF: {len(items)} faults, and one is converted; remove the others")
    if tags != (5, 6) and len(tags) != 1:
        raise ConversionError(
            f"&BC_DEF tags = {list(tags)}: a fault is at 5, 6 inside of the mesh, or at one edge; change the tags"
        )
    kind = items[0].word("kind")
    if kind == "LISFLT" and len(tags) == 1:
        raise ConversionError(
            f"&BC_DEF kind = 'LISFLT', tag = {tags[0]}: a linear-slip fault needs both sides; use tags = 5, 6 in a "
            "mesh with the fault inside"
        )
    return Fault(tags, kind, _own(value, items[0]))


def read(value: Input, layout: Layout, plane: str) -> tuple[list[Table], list[str]]:
    """Return the boundaries of the case, and the absorbing edges that let waves in."""
    boundaries: list[Table] = []
    open_edges: list[str] = []
    for block in value.all("BC_DEF"):
        kind, tags = block.word("kind"), block.integers("tags", "tag")
        own = next(iter(_own(value, block)), Block("", {}))
        if kind in FAULTS:
            continue
        if kind == "ABSORB":
            edges = layout.edges(tags)
            boundaries += [{"kind": "absorbing", "edge": edge} for edge in edges]
            if own.get("let_wave", True):
                open_edges += edges
            if own.get("stacey", False):
                value.note("absorbing edges are Lysmer's dashpots, also where stacey = T")
        elif kind == "DIRNEU":
            boundaries += _dirneu(value, own, layout.edges(tags), plane)
        elif kind in ("PERIOD", "PERIODIC"):
            boundaries += _periodic(layout, tags)
        else:
            value.refuse(f"BC_DEF.{kind}", REFUSED.get(kind, "a boundary without counterpart"))
    return boundaries, open_edges


def _own(value: Input, block: Block) -> list[Block]:
    """Return the blocks that belong to a boundary."""
    return value.following(block, ("BC_", "DIST_", "STF_"), ("BC_DEF",))


def _dirneu(value: Input, block: Block, edges: list[str], plane: str) -> list[Table]:
    """Return components of the motion that are zero; those that are free need no entry."""
    value.refuse_keys(block, "an edge with a time function; write it as driven, moved or traction", "hstf", "vstf")
    names = {"h": "z"} if plane == "antiplane" else {"h": "x", "v": "y"}
    fixed = [ours for theirs, ours in names.items() if block.word(theirs, "N") == "D"]
    return [
        {"kind": "driven", "edge": edge, "component": component, "velocity": 0.0}
        for edge in edges for component in fixed
    ]  # fmt: skip


def _periodic(layout: Layout, tags: list[int]) -> list[Table]:
    """Return the ties of opposite edges, one for each side of a fault between them."""
    opposite = {2: 4, 4: 2, 1: 3, 3: 1}
    if len(tags) != 2 or opposite.get(tags[0]) != tags[1]:
        raise ConversionError(f"&BC_DEF tags = {tags}: periodic edges must be 2 and 4, or 1 and 3")
    first, second = layout.across_bodies(max(tags)), layout.across_bodies(min(tags))
    if len(first) != len(second):
        raise ConversionError(
            f"&BC_DEF tags = {tags}: a fault crosses one of the edges only; continue it to the other edge, or use "
            "another kind for both"
        )
    return [{"kind": "periodic", "first": a, "second": b} for a, b in zip(first, second, strict=True)]
