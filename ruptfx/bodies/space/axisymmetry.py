"""Bodies of revolution about the x axis: y is the radius, and all bodies and loads are axisymmetric.

Volumes and areas of the section count 2 pi r times, so that forces are newtons and energies joules, not per metre. The
strain has a third principal value, u_r / r around the axis; materials use the three-dimensional strain

    [[du_x/dx, (du_x/dr + du_r/dx) / 2, 0], [., du_r/dr, 0], [0, 0, u_r / r]].

Waves much shorter than the radius are those of plane strain.
"""

from __future__ import annotations

import numpy as np

from ruptfx.input.schema import CaseError
from ruptfx.laws.materials import Plane
from ruptfx.platform import fem


def around(density: fem.Expr, mesh: fem.dolfinx.mesh.Mesh, plane: Plane) -> fem.Expr:
    """Return a density of the section times 2 pi r in axisymmetric bodies; unchanged in other planes."""
    return density if plane != "axisymmetric" else 2 * np.pi * fem.ufl.SpatialCoordinate(mesh)[1] * density


def strain(displacement: fem.Expr, mesh: fem.dolfinx.mesh.Mesh) -> fem.Expr:
    """Return the three-dimensional strain, shape (3, 3); on the axis u_r / r is du_r/dr, its limit."""
    ufl = fem.ufl
    r = ufl.SpatialCoordinate(mesh)[1]
    beside, e = ufl.gt(r, 0), ufl.sym(ufl.grad(displacement))
    hoop = ufl.conditional(beside, displacement[1] / ufl.conditional(beside, r, 1), e[1, 1])
    return ufl.as_tensor([[e[0, 0], e[0, 1], 0], [e[1, 0], e[1, 1], 0], [0, 0, hoop]])


def on_axis(coordinates: np.ndarray) -> np.ndarray:
    """Return which points lie on the axis, shape (points,).

    Parameters
    ----------
    coordinates : ndarray, shape (points, dim)
        [m].
    """
    return np.asarray(np.abs(coordinates[:, 1]) <= 1e-12 * np.abs(coordinates).max(initial=0.0))


def put_on_axis(mesh: fem.dolfinx.mesh.Mesh) -> CaseError | None:
    """Set the radius of vertices near the axis to zero; return an error if some are on the other side of it."""
    x = mesh.geometry.x
    x[on_axis(x), 1] = 0.0
    if np.any(x[:, 1] < 0):
        lowest = x[np.argmin(x[:, 1])]
        return CaseError(
            f"plane = 'axisymmetric': y is the radius, and the mesh reaches ({lowest[0]:.6g}, {lowest[1]:.6g}) m; put "
            "the axis of the bodies on y = 0 and mesh one side of it"
        )
    return None


def mass_on_axis(space: fem.dolfinx.fem.FunctionSpace, cell_density: np.ndarray) -> np.ndarray:
    """Return the lumped mass that nodes on the axis gain and their neighbours lose [kg], for the cells of this rank.

    The quadrature of the element gives a node at r = 0 no mass, with which an explicit step is impossible. Along
    every line of nodes from the axis through a cell mass is added in proportion to c_i, the weights of the divided
    difference of all nodes, which leaves integrals of polynomials of one degree less than the element's as they are.
    Still the motion next to the axis is of second order in the size of the cells there, and frequencies, as their
    volume goes with the square of it, of fourth. 1 / (order + 2) of what would leave a mass of zero elsewhere is taken:
    with order 1 that is the lumped mass of exact integration, and with none is the axis stiffer than the other nodes of
    its cells.

    Parameters
    ----------
    space : FunctionSpace
        Space of the displacement.
    cell_density : ndarray, shape (cells,)
        [kg/m3].

    Returns
    -------
    ndarray, shape (nodes * components,)
        Not summed over ranks. Triangles need nothing: zero.
    """
    mesh, index_map, components = space.mesh, space.dofmap.index_map, space.dofmap.index_map_bs
    gained = np.zeros((index_map.size_local + index_map.num_ghosts, components))
    if mesh.basix_cell().name != "quadrilateral":
        return gained.ravel()
    owned = mesh.topology.index_map(mesh.topology.dim).size_local
    order = space.element.basix_element.degree
    reference = np.asarray(space.element.basix_element.points)
    lines = fem.tensor_order(space).reshape(order + 1, order + 1)
    nodes = np.sort(np.unique(reference[:, 0].round(10)))
    difference = nodes[:, None] - nodes + np.eye(order + 1)
    alternating = 1 / np.prod(difference, axis=1)
    alternating /= alternating[0]
    dofs = space.dofmap.list[:owned]
    axis = on_axis(space.tabulate_dof_coordinates())[dofs]
    mass = _cell_masses(space, cell_density)[:owned]
    for grid in (lines, lines[::-1], lines.T, lines.T[::-1]):  # the first of the lines along each side in turn
        cells = np.flatnonzero(axis[:, grid[0]].all(axis=1))
        away = mass[cells][:, grid]  # cells, from the axis, along it
        part = (away[:, 1::2] / np.abs(alternating[1::2, None])).min(axis=1) / (order + 2)
        added = alternating[:, None] * part[:, None, :]
        for component in range(components):
            np.add.at(gained[:, component], dofs[cells][:, grid], added)
    return gained.ravel()


def _cell_masses(space: fem.dolfinx.fem.FunctionSpace, cell_density: np.ndarray) -> np.ndarray:
    """Return the mass that every cell contributes to each of its nodes, shape (cells, nodes)."""
    mesh, order = space.mesh, space.element.basix_element.degree
    broken = fem.dolfinx.fem.functionspace(mesh, fem.basix.ufl.element(
        "Lagrange", mesh.basix_cell().name, order, lagrange_variant=fem.basix.LagrangeVariant.gll_warped,
        discontinuous=True,
    ))  # fmt: skip
    density = fem.dolfinx.fem.Function(fem.dolfinx.fem.functionspace(mesh, ("DG", 0)))
    cells = density.function_space.dofmap.list[:, 0]
    density.x.array[cells] = cell_density[: len(cells)]
    dx = fem.ufl.Measure("dx", domain=mesh, metadata=fem.gll_metadata(mesh, order))
    masses = fem.assemble_summed(broken, around(density * fem.ufl.TestFunction(broken), mesh, "axisymmetric") * dx)
    return masses[broken.dofmap.list]
