"""The result of fault tracing: surfaces with their attributes, and the volumes they came from.

Frame and sign conventions, here once for the whole seismic side:

- Coordinates are fractional indices, ``(inline, crossline, sample)`` in a cube and ``(trace, sample)`` in a section;
  the sample axis points down.
- A surface's normals point into its hanging wall, so that their sample component is not positive (up) on a dipping
  surface; where a surface is vertical the sign is that of its neighbours.
- Throw is vertical: positive where the hanging wall went down (normal fault), negative where it went up (reverse).
- Slip is the motion of the hanging wall against the footwall: down the dip (dip slip, its horizontal part heave, its
  vertical part throw) and along strike (strike slip, positive where the hanging wall went along strike by the
  right-hand rule on the index grid). Surfaces split it in bins and samples. Lines square to the strike in these are not
  so on a map whose bins are not square: tables and exports carry the whole motion to the map and split it there.
- A strike share of 0 tells no motion along strike: slip is then straight down the dip, on a map down the map's.
- Strike obeys the right-hand rule: looking along it, the surface dips to the right. It is measured from north where the
  cube knows its map coordinates, else from the direction of growing inline numbers towards growing crosslines.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d._typing import BoolArray, Float32Array, Float64Array, Int32Array
from seismo3d._validate import freeze
from seismo3d.errors import FileAccessError, FormatError, GeometryError
from seismo3d.geometry.axis import METRES
from seismo3d.io._files import as_path, refuse_os_errors

_FILE = "faultset.npz"
_VERSION = 5
_VOLUMES = ("likelihood", "labels", "throw")
# area, in index units, of a surface that has half the weight of a large one
_HALF_WEIGHT = 100.0


@dataclass(frozen=True, slots=True, eq=False)
class FaultSurface:
    """One fault: a triangulated surface in a cube, a polyline in a section.

    Attributes
    ----------
    vertices : ndarray of shape (n, d), float32
        Points in fractional index coordinates; d is 3 in a cube, 2 in a section.
    cells : ndarray of shape (m, d), int32
        Triangles (cube) or segments (section) as rows of vertex numbers.
    normals : ndarray of shape (n, d), float32
        Unit normals in index coordinates, pointing into the hanging wall.
    likelihood : ndarray of shape (n,), float32
        Fault likelihood at each vertex, 0 to 1.
    throw : ndarray of shape (n,), float32
        How far the hanging wall at each vertex came down when the fault moved, in samples; negative where it went up;
        NaN where it is not known.
    separation : ndarray of shape (n,), float32
        How far it lies today below the place of the footwall that it came from, in samples. This differs from the throw
        where faults that moved later have strained or parted the two.
    throw_fit : ndarray of shape (n,), float32
        How well the two match: 1 where they are equal, 0 where they do not match and throw is carried on from places
        around, also because the other side lies outside the surface or the cube. Throw is where they match best:
        unrelated layers come to some 0.4 to 0.7.
    strike_deg, dip_deg : ndarray of shape (n,), float32
        Orientation at each vertex in degrees; strike 0 to 360 by the right-hand rule, dip 0 to 90: true in a cube in
        depth on a map, else (and in a section) in bins and samples. In a section strike is NaN.
    sample_interval : float
        Size of a sample in ``sample_unit``, 1 where the input was a bare array.
    sample_unit : str
        "ms", "m", "ft" or "samples"; any other word of the cube as it is.
    confidence : float
        Mean likelihood over the surface, weighed down for small surfaces; 0 to 1.
    area : float
        Area (cube) or length (section) in index units.
    strike_share : float
        Strike slip in traces for each sample of throw, by the right-hand rule on the index grid; one for the surface.
        0 where slip straight down the dip explains what is seen as well, and in a section.
    slip_certainty : float
        How sharply the direction of slip is told, 0 to 1; 0 in layers that are level along strike.
    family : int
        The same for parts of one fault that others have taken apart; -1 for a surface that stands for itself.
    generation : int
        How many faults moved one after the other since this one did, as far as that is known: those of generation 0
        moved last.
    lift : float
        Share of the slip that the hanging wall took, where it is told that both walls moved; else 1. The footwall took
        the rest, the other way.
    """

    vertices: Float32Array
    cells: Int32Array
    normals: Float32Array
    likelihood: Float32Array
    throw: Float32Array
    separation: Float32Array
    throw_fit: Float32Array
    strike_deg: Float32Array
    dip_deg: Float32Array
    sample_interval: float = 1.0
    sample_unit: str = "samples"
    confidence: float = 0.0
    area: float = 0.0
    strike_share: float = 0.0
    slip_certainty: float = 0.0
    family: int = -1
    generation: int = 0
    lift: float = 1.0

    def __repr__(self) -> str:
        return f"<FaultSurface: {len(self.vertices)} vertices, area {self.area:.0f}, confidence {self.confidence:.2f}>"

    @property
    def is_matched(self) -> BoolArray:
        """Tell at which vertices the two sides match; at others throw is carried on from these, or not known."""
        return np.asarray(np.isfinite(self.throw) & (self.throw_fit > 0))

    @property
    def throw_ms(self) -> Float32Array:
        """Throw in ms at each vertex, where the cube is in time."""
        return self._throw_in("ms")

    @property
    def throw_m(self) -> Float32Array:
        """Throw in m at each vertex, where the cube is in depth, in feet too."""
        in_feet = self.sample_unit == "ft"
        return self._throw_in("ft") * np.float32(METRES["ft"]) if in_feet else self._throw_in("m")

    @property
    def strike_slip(self) -> Float32Array:
        """Motion of the hanging wall along strike at each vertex, in traces."""
        return self.throw * np.float32(self.strike_share)

    @property
    def heave(self) -> Float32Array:
        """Horizontal part of the slip down the dip at each vertex, in traces; negative where it closes up."""
        rise, flat = self._rise_and_run()
        return (self.throw * rise / flat).astype(np.float32)

    @property
    def dip_slip(self) -> Float32Array:
        """Slip down the dip at each vertex, in index units; negative where it is up."""
        rise, flat = self._rise_and_run()
        return (self.throw * np.hypot(1.0, rise / flat)).astype(np.float32)

    @property
    def rake_deg(self) -> Float32Array:
        """Direction of slip in the plane of the fault at each vertex, in degrees from strike, downwards positive.

        90 where the hanging wall went straight down the dip, -90 where straight up; less than 90 off strike where it
        went along strike too. Index units; see :func:`~seismo3d.seismic.fault_table.measure_rake` for that on a map.
        """
        return np.degrees(np.arctan2(self.dip_slip, self.strike_slip)).astype(np.float32)

    @property
    def slip(self) -> Float32Array:
        """Motion of the hanging wall at each vertex, in index units; shape (n, d).

        The last component is the throw, the others are heave and, in a cube, strike slip.
        """
        flat = self.normals[:, :-1].astype(np.float64)
        rise, run = self._rise_and_run()
        outwards = flat / run[:, None]
        motion = outwards * (rise / run)[:, None]
        if flat.shape[1] == 2:
            motion += self.strike_share * np.column_stack([outwards[:, 1], -outwards[:, 0]])
        down = np.column_stack([motion, np.ones(len(flat))])
        return (down * self.throw[:, None]).astype(np.float32)

    def _rise_and_run(self) -> tuple[Float64Array, Float64Array]:
        """Return the vertical and horizontal part of the normals; their ratio is the heave of a unit throw."""
        flat = self.normals[:, :-1].astype(np.float64)
        # a surface flatter than about two degrees has no dip to slide down
        return -self.normals[:, -1].astype(np.float64), np.sqrt(np.maximum((flat**2).sum(axis=1), 1e-3))

    def _throw_in(self, unit: str) -> Float32Array:
        if self.sample_unit != unit:
            raise GeometryError(
                f"throw_{unit} is asked of a surface whose samples are in {self.sample_unit}. Use throw, in samples"
                + (f", or throw_{'ms' if unit == 'm' else 'm'}." if self.sample_unit in ("ms", *METRES) else ".")
            )
        return self.throw * np.float32(self.sample_interval)


def surface_confidence(likelihood: Float32Array, area: float) -> float:
    """Return a surface's confidence: the mean likelihood at its vertices, weighed down where its area is small."""
    return float(likelihood.mean() * area / (area + _HALF_WEIGHT)) if len(likelihood) else 0.0


@dataclass(frozen=True, slots=True, eq=False)
class FaultSet:
    """All faults of a cube or section.

    Attributes
    ----------
    surfaces : tuple of FaultSurface
        Largest first; surface ``i`` has the label ``i + 1``.
    likelihood : array of the input's shape, float32
        Thinned fault likelihood, 0 to 1; zero off the ridges. A DataArray where the input was one.
    labels : array of the input's shape, int32
        0, or 1 + index of the surface that passes through the voxel.
    throw : array of the input's shape, float32
        Throw in samples at labelled voxels, NaN elsewhere.
    settings : dict
        The settings that gave this result.
    """

    surfaces: tuple[FaultSurface, ...]
    likelihood: Any
    labels: Any
    throw: Any
    settings: dict[str, Any] = field(default_factory=dict)

    def __repr__(self) -> str:
        return f"<FaultSet: {len(self.surfaces)} surfaces, volumes of shape {np.shape(self.labels)}>"

    def save(self, directory: str | Path) -> Path:
        """Write everything to ``faultset.npz`` in a folder, to be read back with :meth:`load`.

        Lazy volumes, those of a cube larger than memory, go to ``likelihood.zarr`` and so on beside it, unless they
        are read from there.

        The file is written aside and renamed, so that an interrupted save leaves the old one as it was. It holds no
        pickle: arrays as in any ``.npz`` file, the rest as JSON.

        Parameters
        ----------
        directory : str or Path
            The folder; made where it is absent.

        Returns
        -------
        Path
            The file.

        Raises
        ------
        FileAccessError
            If the folder cannot be made or written to.
        ParameterError
            If the settings hold something other than numbers, text, arrays, dicts, lists and tuples.
        """
        from seismo3d.io.archive import write_archive
        from seismo3d.io.labelled import pack_labelled

        directory = as_path(directory, "directory")
        try:
            directory.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise FileAccessError(f"{directory} cannot be made: {error.strerror}. Choose another folder.") from error
        arrays, scalars = _pack_surfaces(self.surfaces)
        meta: dict[str, Any] = {"format": "seismo3d faults", "version": _VERSION, "surfaces": scalars, "volumes": {}}
        for name in _VOLUMES:
            values = getattr(self, name)
            if getattr(values, "chunks", None) is not None:
                meta["volumes"][name] = _keep_lazy(values, directory / f"{name}.zarr")
                continue
            volume, meta["volumes"][name] = pack_labelled(values, name)
            arrays |= volume
        write_archive(directory / _FILE, arrays, meta=meta | {"settings": self.settings})
        return directory / _FILE

    @classmethod
    def load(cls, directory: str | Path) -> FaultSet:
        """Read what :meth:`save` wrote; every array, setting and coordinate comes back as it was.

        Parameters
        ----------
        directory : str or Path
            The folder, such as that of a ``seismo3d faults`` run.

        Returns
        -------
        FaultSet
            The faults; volumes are DataArrays where they were.

        Raises
        ------
        FileAccessError
            If there is no such file in the folder.
        FormatError
            If the file is damaged, or from a newer version.
        """
        from seismo3d.io.archive import read_archive
        from seismo3d.io.labelled import unpack_labelled
        from seismo3d.io.numpy_files import refuse_damage

        path = as_path(directory, "directory") / _FILE
        with refuse_os_errors(path, "read"):
            if not path.is_file():
                raise FileAccessError(
                    f"{directory} holds no {_FILE}. Give the folder of a faults run, or of FaultSet.save."
                )
        arrays, meta = read_archive(path)
        if meta.get("format") != "seismo3d faults" or meta.get("version") != _VERSION:
            found = f"{meta.get('format')!r}, version {meta.get('version')!r}"
            raise FormatError(
                f"{path} holds {found}; expected 'seismo3d faults', version {_VERSION}. Trace the faults again."
            )
        with refuse_damage(path, "fault set"):
            surfaces = _unpack_surfaces(arrays, meta["surfaces"])
            volumes = {
                name: _open_lazy(path.parent, meta["volumes"][name])
                if "zarr" in meta["volumes"][name]
                else unpack_labelled(arrays, name, description=meta["volumes"][name])
                for name in _VOLUMES
            }
            return cls(surfaces=surfaces, settings=dict(meta["settings"]), **volumes)


def _keep_lazy(values: Any, store: Path) -> dict[str, Any]:
    """Put a lazy volume into a store, unless it is read from there; return how to open it."""
    from seismo3d.io.zarr_store import write_zarr

    is_labelled = hasattr(values, "dims")
    if not (is_labelled and values.encoding.get("source") == str(store.resolve())):
        write_zarr(store, values)
    return {"zarr": store.name, "labelled": is_labelled}


def _open_lazy(folder: Path, description: dict[str, Any]) -> Any:
    from seismo3d.io.zarr_store import read_zarr

    store = folder / str(description["zarr"])
    found = read_zarr(store, lazy_above=-1)
    if not description["labelled"]:
        return found.data
    found.encoding["source"] = str(store.resolve())
    return found


_SCALARS = (
    "sample_interval", "sample_unit", "confidence", "area", "strike_share", "slip_certainty", "family", "generation",
    "lift",
)  # fmt: skip
_ARRAYS = tuple(entry.name for entry in fields(FaultSurface) if entry.name not in _SCALARS)
VERTEX_ARRAYS = tuple(name for name in _ARRAYS if name != "cells")
"""Names of what a surface has at every vertex."""


def _pack_surfaces(surfaces: tuple[FaultSurface, ...]) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Join the surfaces' arrays end to end, one array an attribute, with where each surface ends."""
    arrays: dict[str, Any] = {}
    for name in _ARRAYS if surfaces else ():
        parts = [np.asarray(getattr(surface, name)) for surface in surfaces]
        arrays[f"surfaces.{name}"] = np.concatenate(parts)
        arrays[f"ends.{name}"] = np.cumsum([len(part) for part in parts])
    return arrays, [{name: getattr(surface, name) for name in _SCALARS} for surface in surfaces]


def _unpack_surfaces(arrays: dict[str, Any], scalars: list[dict[str, Any]]) -> tuple[FaultSurface, ...]:
    parts = {}
    for name in _ARRAYS if scalars else ():
        if len(arrays[f"ends.{name}"]) != len(scalars):
            raise ValueError(f"it has {len(arrays[f'ends.{name}'])} surfaces, and describes {len(scalars)}")
        parts[name] = [part.copy() for part in np.split(arrays[f"surfaces.{name}"], arrays[f"ends.{name}"][:-1])]
    rows: list[dict[str, Any]] = [{name: freeze(parts[name][i]) for name in _ARRAYS} for i in range(len(scalars))]
    return tuple(FaultSurface(**row, **numbers) for row, numbers in zip(rows, scalars, strict=True))
