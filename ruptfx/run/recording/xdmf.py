"""XDMF descriptors, for ParaView, of HDF5 files with snapshots; each is renamed when it is whole."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import NamedTuple


class Mesh(NamedTuple):
    """Mesh of a descriptor.

    Attributes
    ----------
    name : str
        Name of its grid.
    shape : str
        Topology of XDMF.
    cells, points : (str, (int, int))
        Array in the HDF5 file, and its shape.
    fixed : tuple of str
        Arrays of integers with a value per cell, which do not change in time.
    """

    name: str
    shape: str
    cells: tuple[str, tuple[int, int]]
    points: tuple[str, tuple[int, int]]
    fixed: tuple[str, ...] = ()


class Field(NamedTuple):
    """Scalar field of all snapshots.

    Attributes
    ----------
    name, array : str
        Name in the descriptor and of the array in the HDF5 file.
    shape : tuple of int
        Shape of the array: times, nodes or cells, and components.
    component : int, optional
        Index on the last axis, where the array has components.
    center : {"Node", "Cell"}
    bytes : int
        Size of a number.
    """

    name: str
    array: str
    shape: tuple[int, ...]
    component: int | None = None
    center: str = "Node"
    bytes: int = 8


def write(path: Path, mesh: Mesh, times: Iterable[float], fields: Sequence[Field]) -> None:
    """Write the descriptor of an HDF5 file of the same name."""

    def item(array: str, shape: Sequence[int], kind: str, size: int = 4) -> str:
        number = f'NumberType="{kind}" Precision="{size}"'
        return f'<DataItem Dimensions="{_spaced(shape)}" {number} Format="HDF">{path.stem}.h5:/{array}</DataItem>'

    def attribute(name: str, center: str, content: str) -> str:
        return f'<Attribute Name="{name}" AttributeType="Scalar" Center="{center}">{content}</Attribute>\n'

    def picked(field: Field, row: int) -> str:
        rank, (_, count, *last) = len(field.shape), field.shape
        start, one = [row, 0, *([field.component or 0] if last else [])], [1] * len(last)
        slab = _spaced([*start, *[1] * rank, 1, count, *one])
        full_item = item(field.array, field.shape, "Float", field.bytes)
        return (
            f'<DataItem ItemType="HyperSlab" Dimensions="{count}" Type="HyperSlab">'
            f'<DataItem Dimensions="3 {rank}" Format="XML">{slab}</DataItem>{full_item}</DataItem>'
        )

    (cells, (count, corners)), (points, (nodes, dim)) = mesh.cells, mesh.points
    static = (
        f'<Topology TopologyType="{mesh.shape}" NodesPerElement="{corners}" NumberOfElements="{count}">'
        f"{item(cells, (count, corners), 'Int')}</Topology>\n"
        f'<Geometry GeometryType="{"XY" if dim == 2 else "XYZ"}">{item(points, (nodes, dim), "Float", 8)}</Geometry>\n'
    )
    for name in mesh.fixed:
        static += attribute(name.removesuffix("_of_cell"), "Cell", item(name, (count,), "Int"))
    grids = "".join(
        f'<Grid Name="{mesh.name}" GridType="Uniform"><Time Value="{float(time)!r}"/>\n{static}'
        + "".join(attribute(each.name, each.center, picked(each, row)) for each in fields) + "</Grid>\n"
        for row, time in enumerate(times)
    )  # fmt: skip
    collection = f'<Grid Name="{path.stem}" GridType="Collection" CollectionType="Temporal">\n{grids}</Grid>'
    text = f'<?xml version="1.0"?>\n<Xdmf Version="3.0"><Domain>{collection}</Domain></Xdmf>\n'
    replace_whole(path, lambda temporary: temporary.write_text(text))


def _spaced(numbers: Iterable[int]) -> str:
    return " ".join(map(str, numbers))


def replace_whole(path: Path, write: Callable[[Path], object]) -> None:
    """Write a file by another name, and rename it."""
    temporary = path.with_name(f".{path.name}")
    write(temporary)
    temporary.replace(path)
