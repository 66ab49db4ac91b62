"""The fracture network: faults as vertices of a graph, the lines in which they meet as its edges."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d._stages import as_progress
from seismo3d._typing import Float32Array, Float64Array, Progress
from seismo3d._validate import as_whole_number, freeze
from seismo3d.errors import ShapeError
from seismo3d.geometry.survey import SurveyGeometry
from seismo3d.seismic.cube_checks import placing_cube
from seismo3d.seismic.fault_table import tabulate_faults
from seismo3d.seismic.faultset import FaultSet
from seismo3d.seismic.index_frame import IndexFrame
from seismo3d.seismic.intersections import Intersection, find_intersections
from seismo3d.seismic.orientations import OrientationSet, Poles, find_poles, find_sets, mean_pole, to_strike_dip


@dataclass(frozen=True, slots=True)
class Zone:
    """Faults that are connected, directly or through others.

    Attributes
    ----------
    surfaces : tuple of int
        Their labels.
    area : float
        Area of all of them.
    n_intersections, intersection_length : int, float
        Lines in which they meet, and their length.
    low, high : tuple of float
        Corners of the box that holds them, in index coordinates.
    intensity : float
        Area in the box over its volume (P32).
    """

    surfaces: tuple[int, ...]
    area: float
    n_intersections: int
    intersection_length: float
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    intensity: float


@dataclass(frozen=True, slots=True, eq=False)
class FractureNetwork:
    """How the faults of a cube hang together.

    Attributes
    ----------
    graph : networkx.Graph
        A vertex a fault, its label as key, with ``area``, ``strike_deg``, ``dip_deg``, ``throw_mean_samples``,
        ``confidence``, ``zone`` and the place ``x``, ``y``, ``z`` of its middle; an edge a pair that meets, with
        ``length``, ``angle_deg``, ``kind`` and ``abutting``.
    intersections : tuple of Intersection
        The lines.
    zones : tuple of Zone
        Connected faults, largest area first; a fault that meets no other is a zone of its own.
    density : ndarray of shape (a, b, c), float32
        Fault area in a coarse cell over the cell's volume (P32), in one over the unit; the last cell along an axis may
        be cut short by the cube's end, and so is its volume.
    cell : tuple of int
        Size of a cell in traces and samples.
    poles : Poles
        Poles at the vertices of all surfaces.
    sets : tuple of OrientationSet
        Faults by orientation, largest share of the area first.
    unit : {"m", "ft", "bin"}
        Of the map where the cube is in depth on one, else a bin: a trace sideways and a sample down.
    intensity : float
        Whole area over whole volume.
    """

    graph: Any
    intersections: tuple[Intersection, ...]
    zones: tuple[Zone, ...]
    density: Float32Array
    cell: tuple[int, int, int]
    poles: Poles
    sets: tuple[OrientationSet, ...]
    unit: str
    intensity: float

    def write_graphml(self, path: str | Path) -> None:
        """Write the graph as GraphML, which Gephi, yEd, Cytoscape and networkx read.

        Parameters
        ----------
        path : str or Path
            The file.

        Raises
        ------
        FileAccessError
            If the folder cannot be written to.
        """
        import networkx as nx

        from seismo3d.io._files import written_aside

        with written_aside(path) as aside:
            nx.write_graphml(self.graph, aside)


def fracture_network(
    faults: FaultSet,
    *,
    cube: Any = None,
    cell: int | tuple[int, int, int] = 16,
    reach: int = 4,
    set_angle_deg: float = 30.0,
    progress: Progress | None = None,
) -> FractureNetwork:
    """Build the network of a cube's faults: who meets whom, how densely they lie, how they are oriented.

    Parameters
    ----------
    faults : FaultSet
        Faults of a cube.
    cube : DataArray, optional
        The cube, for its coordinates. [default: those of ``faults.labels``]
    cell : int or tuple of int
        Size of the cells in which density is counted, in traces and samples.
    reach : int
        Farthest gap, in traces or samples, over which two faults meet.
    set_angle_deg : float
        Mean angle between two groups of faults below which they are one set.
    progress : callable, optional
        Called with the stage's name and the share of it that is done.

    Returns
    -------
    FractureNetwork

    Raises
    ------
    ShapeError
        If the faults are of a section, whose lines do not tell how surfaces meet, or of another cube.
    GeometryError
        If the cube lies elsewhere than the faults.
    ParameterError
        If `faults` is no set of faults, a cell has no whole positive size, or `reach` is no whole number from 0.

    Notes
    -----
    Density is P32 of [1]_: it does not depend on the direction in which a well or a section samples the fractures.

    References
    ----------
    .. [1] W. S. Dershowitz, H. H. Herda, Proc. 33rd U.S. Symposium on Rock Mechanics, 757-766, 1992.
    """
    home = placing_cube(cube, faults)
    report = as_progress(progress)
    size = _as_cell(cell)
    frame = IndexFrame.of(home)
    report("intersections", 0.0)
    farthest = min(as_whole_number(reach, "reach", low=0), max(np.shape(faults.labels)))
    lines = find_intersections(faults.surfaces, frame=frame, reach=farthest)
    poles = find_poles(faults, frame)
    graph = _graph(faults, home, poles, lines, frame.unit)
    zones = _zones(faults, graph, frame)
    for number, zone in enumerate(zones, start=1):
        for label in zone.surfaces:
            graph.nodes[label]["zone"] = number
    report("density", 0.0)
    density = _density(faults, frame, size)
    report("orientations", 0.0)
    sets = find_sets(poles, angle_deg=set_angle_deg)
    volume = float(np.prod(np.shape(faults.labels))) * frame.voxel
    report("orientations", 1.0)
    area = sum(zone.area for zone in zones)
    return FractureNetwork(graph, lines, zones, freeze(density), size, poles, sets, frame.unit, area / volume)


def _as_cell(cell: int | tuple[int, int, int]) -> tuple[int, int, int]:
    sizes = (cell,) * 3 if np.ndim(cell) == 0 else tuple(cell)  # type: ignore[arg-type]
    if len(sizes) != 3:
        raise ShapeError(f"cell is {cell!r}; expected one size, or three: inline, crossline, sample.")
    a, b, c = (as_whole_number(size, "cell", low=1) for size in sizes)
    return a, b, c


def _graph(faults: FaultSet, home: Any, poles: Poles, lines: tuple[Intersection, ...], unit: str) -> Any:
    import networkx as nx

    geometry = SurveyGeometry.from_cube(home)
    graph = nx.Graph(unit=unit)
    kept = ("confidence", "throw_mean_samples", "kind")
    for row, surface in zip(tabulate_faults(faults, home), faults.surfaces, strict=True):
        x, y, z = geometry.index_to_map(surface.vertices.astype(np.float64).mean(axis=0)[None])[0]
        # GraphML has no word for an unknown number: what is not known is left out
        facts = {name: row[name] for name in kept if not (isinstance(row[name], float) and np.isnan(row[name]))}
        own = poles.labels == row["fault"]
        strike, dip = to_strike_dip(mean_pole(poles.directions[own], poles.weights[own]))
        facts |= {"area": float(poles.weights[own].sum()), "strike_deg": strike, "dip_deg": dip}
        graph.add_node(row["fault"], **facts, x=float(x), y=float(y), z=float(z))
    for line in lines:
        facts = {"length": line.length, "angle_deg": line.angle_deg, "kind": line.kind, "abutting": line.abutting}
        graph.add_edge(line.first, line.second, **facts)
    return graph


def _zones(faults: FaultSet, graph: Any, frame: IndexFrame) -> tuple[Zone, ...]:
    import networkx as nx

    zones = []
    for component in nx.connected_components(graph):
        labels = tuple(sorted(component))
        area = sum(graph.nodes[label]["area"] for label in labels)
        lengths = [length for _, _, length in graph.subgraph(labels).edges(data="length")]
        points = np.concatenate([faults.surfaces[label - 1].vertices for label in labels]).astype(np.float64)
        low, high = points.min(axis=0), points.max(axis=0)
        # a flat box is one voxel thick
        volume = float(np.prod(np.maximum(high - low, 1.0))) * frame.voxel
        corners = [(float(p[0]), float(p[1]), float(p[2])) for p in (low, high)]
        zones.append(Zone(labels, area, len(lengths), float(sum(lengths)), corners[0], corners[1], area / volume))
    return tuple(sorted(zones, key=lambda zone: -zone.area))


def _density(faults: FaultSet, frame: IndexFrame, cell: tuple[int, int, int]) -> Float32Array:
    """Area in each cell over its volume; triangles are cut in sixteen, so that few reach over a cell's edge."""
    shape = np.array(np.shape(faults.labels))
    size = np.array([min(side, int(n)) for side, n in zip(cell, shape)])
    counts = -(-shape // size)
    area = np.zeros(counts)
    for surface in faults.surfaces:
        corners = surface.vertices.astype(np.float64)[surface.cells]
        parts = frame.areas(surface.vertices, surface.cells) / 16.0
        for weights in _SIXTEENTHS:
            at = np.einsum("c,ncd->nd", weights, corners)
            # voxel k reaches from k - 1/2 to k + 1/2
            box = np.clip(((at + 0.5) // size).astype(np.int64), 0, counts - 1)
            np.add.at(area, tuple(box.T), parts)
    edges = [np.minimum(np.arange(1, n + 1) * s, m) - np.arange(n) * s for n, s, m in zip(counts, size, shape)]
    volume = np.einsum("i,j,k->ijk", *edges) * frame.voxel
    return np.asarray(area / volume, dtype=np.float32)


def _sixteenths() -> Float64Array:
    """Barycentric centres of the sixteen triangles that cut each side of a triangle in four."""
    up = [(i + 1 / 3, j + 1 / 3) for i in range(4) for j in range(4 - i)]
    down = [(i + 2 / 3, j + 2 / 3) for i in range(3) for j in range(3 - i)]
    first = np.array(up + down) / 4.0
    return np.column_stack([first, 1.0 - first.sum(axis=1)])


_SIXTEENTHS = _sixteenths()
