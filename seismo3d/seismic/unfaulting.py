"""Unfaulting: a cube with the slip of its faults taken out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from seismo3d._settings import Amount, Count, Positive, Share, Smoothing, Steps, StepsOrNone, as_settings
from seismo3d._stages import as_progress
from seismo3d._typing import AnyArray, BoolArray, Float32Array, Float64Array, Int64Array, Progress
from seismo3d._validate import freeze
from seismo3d.seismic.both_walls import tell_apart
from seismo3d.seismic.cube_checks import check_cube, placing_cube
from seismo3d.seismic.displacements import (
    carry_amplitudes,
    follow_on,
    places_before,
    read_displacement,
    solve_jumps,
)
from seismo3d.seismic.fault_links import SurfaceGrid, find_crossings, grid_points
from seismo3d.seismic.faultset import FaultSet, FaultSurface

# traces and samples from the cube's end within which a fault that ends there is taken to leave the cube
_RIM = 2.0
# half the width, in traces and samples, of the widest hole of a surface, or gap between parts, that slip goes through
_HOLE = 8.0
# traces and samples from a fault within which it is not sure with which of its walls a place of another goes, and the
# slip, in traces and samples, from which on that matters
_BESIDE, _TORN = 2.5, 0.5


@dataclass(frozen=True, slots=True)
class UnfaultSettings:
    """How the slip is spread over a cube.

    Attributes
    ----------
    beyond : int in [1, 100]
        Traces and samples over which the slip of a fault dies out beyond a tip. Where its surface leaves the cube, slip
        goes on: what is moved in from there was thrown as well.
    smoothing : float in [0, 1000]
        Width, in traces and samples, of the smoothing of slip over a surface.
    least_fit : float in [0, 1]
        Mean fit of the two sides below which a fault is left as it is: a throw that is a guess tears the layers.
    steepest : float in (0, inf)
        Most samples a trace by which throw grows away from the tip of a fault, where it is `beyond` times as much.
    following : float in [0, 1000]
        Width of the smoothing of the motion by which a fault moves along.
    rounds : int in [0, 100]
        How often the faults are moved along with the blocks that they lie in, before the last solution.
    iterations : int in [1, 1000000]
        Most steps a round towards the full jump across the faults.
    tolerance : float in [0, inf)
        Root mean square of what is missing of the jump, in samples, at which a round ends.
    """

    beyond: Steps = 8
    smoothing: Smoothing = 2.0
    least_fit: Share = 0.3
    steepest: Positive = 1.5
    following: Smoothing = 4.0
    rounds: StepsOrNone = 3
    iterations: Count = 12
    tolerance: Amount = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class UnfaultedPlaces:
    """Where each place of the unfaulted cube lies in the cube today.

    Attributes
    ----------
    displacement : ndarray of shape (3, inline, crossline, sample), float32
        In traces and samples: place ``x`` of the unfaulted cube is at ``x + displacement`` today. It is smooth but for
        its jumps across faults, which are their slip.
    surfaces : tuple of ndarray of shape (n, 3), float64
        Where the vertices of each surface lie in the unfaulted cube.
    missing : float
        Root mean square, over all edges of the grid that a fault crosses, of what is missing of the jump.
    """

    displacement: Float32Array
    surfaces: tuple[Float64Array, ...]
    missing: float


def unfault(
    cube: Any, faults: FaultSet, *, settings: UnfaultSettings | None = None, progress: Progress | None = None
) -> Any:
    """Take the slip out of a cube: move the two sides of every fault back to where they touched.

    Parameters
    ----------
    cube : DataArray or array_like
        A cube (inline, crossline, sample).
    faults : FaultSet
        Faults of this cube, with throws. Those whose sides hardly match are left as they are.
    settings : UnfaultSettings, optional
    progress : callable, optional
        Called with the stage's name and the share of it that is done.

    Returns
    -------
    DataArray or ndarray of the cube's shape, float32
        Amplitudes by cubic interpolation; 0 where the cube holds no data for a place. Traces that are missing (NaN) in
        the cube stay missing.

    Raises
    ------
    ShapeError
        If the cube has not three axes, or the faults are of a cube of another shape.
    ParameterError
        If `faults` is no FaultSet, or `settings` are no UnfaultSettings.
    GeometryError
        If the faults are of a cube elsewhere.

    See Also
    --------
    find_slip_field : the displacements.
    """
    check_cube(cube, faults)
    field = find_slip_field(faults, settings=settings, progress=progress)
    out = carry_amplitudes(np.asarray(getattr(cube, "values", cube)), field.displacement)
    return cube.copy(data=out).rename("unfaulted") if hasattr(cube, "dims") else out


def find_slip_field(
    faults: FaultSet, *, settings: UnfaultSettings | None = None, progress: Progress | None = None
) -> UnfaultedPlaces:
    r"""Find a displacement that jumps by the slip across every fault of a cube and is smooth elsewhere.

    The faults that moved last are taken back first, and the others lie then as they did when these moved: parts of one
    fault that were taken apart make one surface again. For each generation of faults it minimises :math:`\sum_e
    |d_{b(e)} - d_{a(e)} - J_e|^2` over the edges of the grid, where :math:`J` is the slip on edges that a fault crosses
    from the footwall into the hanging wall, and zero on all others. This is Poisson's equation, solved by cosine
    transforms. What is then missing of the jump is added to it and the whole is solved again (Bregman iteration
    [1]_), until the jumps are the slip. Half of it goes to each side. Faults of one generation are solved for at once;
    each then moves along with the blocks that it lies in, as in [2]_, so that one which cuts another of an age that is
    not known brings the parts of that one together before their own slip is taken out.

    Parameters
    ----------
    faults : FaultSet
        Faults of a cube; those whose throw is not known, or whose sides hardly match, are left as they are.
    settings : UnfaultSettings, optional
    progress : callable, optional
        Called with the stage's name and the share of it that is done.

    Returns
    -------
    UnfaultedPlaces

    Raises
    ------
    ShapeError
        If the faults are of a section.
    ParameterError
        If `faults` is no FaultSet.

    References
    ----------
    .. [1] S. Osher et al., Multiscale Modeling & Simulation 4(2), 460-489, 2005. :doi:`10.1137/040605412`
    .. [2] X. Wu, S. Luo, D. Hale, Geophysics 81(2), IM25-IM33, 2016. :doi:`10.1190/geo2015-0381.1`
    """
    settings = as_settings(settings, UnfaultSettings)
    report = as_progress(progress)
    shape = np.shape(placing_cube(None, faults))
    displacement = np.zeros((3, *shape), np.float32)
    carried = [_Carried.today(surface) for surface in faults.surfaces]
    generations = _generations(faults.surfaces, settings)
    squares, n_edges = 0.0, 0
    for number, parted in enumerate(generations):
        report("unfault", number / len(generations))
        laid_out = ((parts, _lay_out(faults.surfaces, carried, parts, displacement, settings)) for parts in parted)
        sheets = [(parts, sheet) for parts, sheet in laid_out if sheet is not None]
        step, places, missing, crossed = _take_back([sheet for _, sheet in sheets], shape, settings)
        squares, n_edges = squares + missing**2 * crossed, n_edges + crossed
        displacement = follow_on(displacement, step) if number else step
        carried = _carry_back(carried, step, sheets, places)
    report("unfault", 1.0)
    missing = float(np.sqrt(squares / max(n_edges, 1)))
    return UnfaultedPlaces(freeze(displacement), tuple(freeze(vertices.at) for vertices in carried), missing)


def is_taken_out(surface: FaultSurface, settings: UnfaultSettings) -> bool:
    """Tell whether the throw of a surface is known well enough to be taken out: a guess tears the layers."""
    return bool(np.isfinite(surface.throw).any()) and float(np.mean(surface.throw_fit)) >= settings.least_fit


def _generations(surfaces: tuple[FaultSurface, ...], settings: UnfaultSettings) -> list[list[list[int]]]:
    """Return the numbers of the surfaces that are taken out: the last to move first, parts of one fault together."""
    found: dict[int, dict[tuple[int, int], list[int]]] = {}
    for n, surface in enumerate(surfaces):
        if is_taken_out(surface, settings):
            fault = (surface.family, -1) if surface.family >= 0 else (-1, n)
            found.setdefault(surface.generation, {}).setdefault(fault, []).append(n)
    return [list(found[generation].values()) for generation in sorted(found)]


@dataclass(frozen=True, slots=True, eq=False)
class _Carried:
    """Vertices (n, 3) of a surface where they lay before some faults moved, and whether that is sure of each.

    Right beside a fault that was taken back it is not: between its walls there is no place to come from.
    """

    at: Float64Array
    sure: BoolArray

    @classmethod
    def today(cls, surface: FaultSurface) -> _Carried:
        """Return them as they lie today."""
        return cls(surface.vertices.astype(np.float64), np.ones(len(surface.vertices), bool))


@dataclass(frozen=True, slots=True, eq=False)
class _SlipSheet:
    """A fault on its grid: nodes (n, 3), slip at them (n, 3), unit normals into the hanging wall, triangles.

    The nodes are the places of the grid of this shape that have these numbers.
    """

    nodes: Float64Array
    slip: Float64Array
    normals: Float64Array
    cells: Int64Array
    shape: tuple[int, int]
    numbers: Int64Array

    def smooth(self, values: Float64Array, width: float) -> Float64Array:
        """Gaussian mean over the surface of values (n, ...) at the nodes; NaN is passed over."""
        flat = values.reshape(len(values), -1)
        grid = np.full((int(np.prod(self.shape)), flat.shape[1]), np.nan)
        grid[self.numbers] = flat
        columns = grid.T.reshape(-1, *self.shape)
        means = np.stack([_smooth(column, np.isfinite(column), width) for column in columns])
        return np.asarray(means.reshape(len(columns), -1).T[self.numbers].reshape(values.shape))


def _lay_out(
    surfaces: Sequence[FaultSurface], carried: Sequence[_Carried], parts: Sequence[int], displacement: Float32Array,
    settings: UnfaultSettings,
) -> _SlipSheet | None:  # fmt: skip
    """Nodes, slip and triangles of a fault carried on beyond its edge; None where nothing of it is left to lay out.

    Its parts lie where they are carried to, and the displacement takes places there to where they are today.
    """
    sure = [carried[n].sure for n in parts]
    throw, normals = (
        np.concatenate([getattr(surfaces[n], name)[kept] for n, kept in zip(parts, sure, strict=True)])
        for name in ("throw", "normals")
    )
    if not np.isfinite(throw).any():
        return None
    beyond = settings.beyond + int(np.ceil(0.5 * np.nanmax(np.abs(throw))))
    at = np.concatenate([carried[n].at[kept] for n, kept in zip(parts, sure, strict=True)])
    grid = grid_points(at, normals.astype(np.float64), throw.astype(np.float64), beyond=beyond)
    nodes, cells = grid.triangulate()
    going_on = _goes_on(grid, nodes, displacement)
    slip, normals = _slip_of(grid, going_on, surfaces[parts[0]], settings)
    usable: BoolArray = np.asarray(np.isfinite(nodes).all(axis=1) & np.isfinite(slip).all(axis=1))
    cells = cells[usable[cells].all(axis=1)]
    if not len(cells):
        return None
    used, numbered = np.unique(cells, return_inverse=True)
    triangles = numbered.reshape(-1, 3).astype(np.int64)
    return _SlipSheet(nodes[used], slip[used], normals[used], triangles, grid.w.shape, used)


def _goes_on(grid: SurfaceGrid, nodes: Float64Array, displacement: Float32Array) -> BoolArray:
    """Tell which places of a grid its fault goes through.

    They are those of its surface and its parts, of what lies between them, and those where it leaves the cube; the
    nodes are where the displacement takes them from to today.
    """
    from skimage.morphology import isotropic_closing

    today = nodes + read_displacement(displacement, np.nan_to_num(nodes))
    with np.errstate(invalid="ignore"):
        in_cube = ((today >= 0.0) & (today <= np.array(displacement.shape[1:]) - 1.0)).all(axis=1)
    in_cube = in_cube.reshape(grid.inside.shape)
    whole: BoolArray = np.asarray(isotropic_closing(grid.inside, _HOLE))
    if not in_cube.any():
        return whole
    at_end = ndimage.distance_transform_edt(~in_cube, return_distances=False, return_indices=True)
    near: BoolArray = np.asarray(ndimage.distance_transform_edt(~whole)) <= _RIM
    return np.asarray(whole | (~in_cube & near[tuple(at_end)]))


def _slip_of(
    grid: SurfaceGrid, going_on: BoolArray, fault: FaultSurface, settings: UnfaultSettings
) -> tuple[Float64Array, Float64Array]:
    """Slip, and the unit normal, at every node of a grid."""
    known = np.isfinite(grid.w)
    w = _smooth(np.where(known, grid.w, 0.0), known, settings.smoothing)
    ds, dz = (np.gradient(w, axis=axis) for axis in (0, 1))
    # a fault that leaves the cube on all sides has no tip
    to_tip = np.full(w.shape, np.inf) if going_on.all() else ndimage.distance_transform_edt(going_on)
    beyond_tip = ndimage.distance_transform_edt(~going_on)
    taper = np.clip(1.0 - beyond_tip / settings.beyond, 0.0, 1.0) if settings.beyond else going_on.astype(np.float64)
    most = settings.steepest * (to_tip + settings.beyond)
    # strike is against `along`, where the surface keeps to itself
    share = -fault.strike_share
    # what touched before must touch again
    apart = tell_apart(_smooth(np.clip(grid.throw, -most, most), known, settings.smoothing), fault.lift, share) * taper
    along = np.array([-grid.across[1], grid.across[0]])
    flat = grid.across - ds[..., None] * along
    slide = flat * (dz / (1.0 + ds**2))[..., None] + share * (along + ds[..., None] * grid.across)
    slip = np.concatenate([slide, np.ones((*w.shape, 1))], axis=-1) * apart[..., None]
    normal = np.concatenate([flat, -dz[..., None]], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    return slip.reshape(-1, 3), normal.reshape(-1, 3)


def _smooth(values: Float64Array, known: AnyArray, sigma: float) -> Float64Array:
    """Gaussian mean of what is known; NaN elsewhere."""
    share = ndimage.gaussian_filter(known.astype(np.float64), sigma)
    mean = ndimage.gaussian_filter(np.where(known, values, 0.0), sigma) / np.maximum(share, 1e-9)
    return np.where(known, mean, np.nan)


def _take_back(
    sheets: Sequence[_SlipSheet], shape: tuple[int, ...], settings: UnfaultSettings
) -> tuple[Float32Array, list[Float64Array], float, int]:
    """Displacement that takes faults back, all at once.

    Returns it, where their nodes come to lie, what is missing of the jumps (root mean square), and how many there are.
    """
    displacement, missing, n_edges = np.zeros((3, *shape), np.float32), 0.0, 0
    places = [sheet.nodes - 0.5 * sheet.slip for sheet in sheets]
    for number in range(settings.rounds + 1 if sheets else 0):
        if number:
            pairs = zip(sheets, places, strict=True)
            places = [_follow(sheet, place, displacement, settings.following) for sheet, place in pairs]
        edges, jumps = _join([_jumps(sheet, place, shape) for sheet, place in zip(sheets, places, strict=True)])
        # until the faults lie where they belong, most of the jump is enough
        n_steps = settings.iterations if number == settings.rounds else max(1, settings.iterations // 4)
        displacement, missing = solve_jumps(edges, jumps, shape, n_steps=n_steps, tolerance=settings.tolerance)
        n_edges = len(edges)
    return displacement, places, missing, n_edges


def _jumps(sheet: _SlipSheet, places: Float64Array, shape: tuple[int, ...]) -> tuple[Int64Array, Float64Array]:
    """Edges of the grid that a sheet at these places crosses, each once, and the jump along each."""
    one, other = (places[sheet.cells[:, k]] - places[sheet.cells[:, 0]] for k in (1, 2))
    normals = np.cross(one, other)
    # triangles must turn about the normal into the hanging wall, and not over where a round has crumpled them
    turned = (normals * sheet.normals[sheet.cells].mean(axis=1)).sum(axis=1) < 0
    cells = np.where(turned[:, None], sheet.cells[:, ::-1], sheet.cells)
    return find_crossings(places, sheet.slip, cells, shape)


def _join(parts: list[tuple[Int64Array, Float64Array]]) -> tuple[Int64Array, Float64Array]:
    """Edges of all faults; where several cross one, their jumps add up."""
    edges, numbers = np.unique(np.concatenate([part[0] for part in parts]), return_inverse=True)
    jumps = np.zeros((len(edges), 3))
    np.add.at(jumps, numbers, np.concatenate([part[1] for part in parts]))
    return edges, jumps


def _carry_back(
    carried: Sequence[_Carried], step: Float32Array, sheets: Sequence[tuple[list[int], _SlipSheet]],
    places: Sequence[Float64Array],
) -> list[_Carried]:  # fmt: skip
    """Where vertices lie once some faults are taken back: theirs go with their nodes, others with their wall."""
    after = list(carried)
    if not sheets:
        return after
    moved = {n for parts, _ in sheets for n in parts}
    torn = cKDTree(np.concatenate([sheet.nodes[np.abs(sheet.slip).max(axis=1) > _TORN] for _, sheet in sheets]))
    for n, vertices in enumerate(carried):
        if n not in moved:
            clear = np.isinf(torn.query(vertices.at, distance_upper_bound=_BESIDE)[0])
            after[n] = _Carried(places_before(step, vertices.at), vertices.sure & clear)
    for (parts, sheet), place in zip(sheets, places, strict=True):
        tree = cKDTree(sheet.nodes)
        for n in parts:
            at = carried[n].at
            after[n] = replace(carried[n], at=at + (place - sheet.nodes)[tree.query(at)[1]])
    return after


def _follow(sheet: _SlipSheet, places: Float64Array, displacement: Float32Array, width: float) -> Float64Array:
    """Where the nodes of a sheet lie once the rest of the field has moved them: between its two sides."""
    shape = np.array(displacement.shape[1:]) - 1
    sides = []
    for sign in (-1.0, 1.0):
        at = np.clip(np.rint(places + sign * 1.5 * sheet.normals), 0, shape).astype(np.int64)
        sides.append(displacement[:, at[:, 0], at[:, 1], at[:, 2]].T.astype(np.float64))
    # the footwall side lies at node - slip today, the hanging wall's at the node
    return np.asarray(sheet.nodes - 0.5 * sheet.slip - sheet.smooth(0.5 * (sides[0] + sides[1]), width))
