"""Elevation maps: GeoTIFF and ESRI ASCII by rasterio, NPZ without it; read with their georeference, and written."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray
from seismo3d._validate import as_kind, as_real_array, as_whole_number, is_among, told
from seismo3d.errors import (
    FileAccessError,
    FormatError,
    GeometryError,
    MissingDependencyError,
    ParameterError,
    Seismo3dWarning,
)
from seismo3d.geometry.map_grid import MapGrid, as_six, elevation_values
from seismo3d.geometry.reference_systems import unit_of
from seismo3d.io._files import as_path, as_readable_file, check_output, refuse_os_errors, written_aside
from seismo3d.io.numpy_files import check_declared, list_npz, read_npy, read_npz

RASTERS = (".tif", ".tiff", ".asc", ".agr", ".img", ".vrt", ".bil", ".hgt")
"""Endings that rasterio reads."""
WRITTEN_SUFFIXES = (".tif", ".tiff", ".asc", ".npz")
_NAMES = ("elevation", "z", "dem", "height")
VOIDS = (-9999.0, -32768.0, -32767.0, -99999.0)
"""Values that usually stand for nothing."""
BOTTOMLESS = -1e30
"""All that lies below stands for nothing, such as the least number of 32 bits."""
FAR_BELOW = 1000.0
"""Metres that undeclared voids lie below all other elevations, at least."""
_BOUNDS = ("xmin", "xmax", "ymin", "ymax")


def read_elevation(path: str | Path, *, band: int = 1) -> Any:
    """Read an elevation map with its georeference.

    Parameters
    ----------
    path : str or Path
        GeoTIFF or ESRI ASCII grid (with the extra ``terrain``, which brings rasterio); ``.npz`` with an array
        ``elevation`` and either ``transform`` (six numbers, see :mod:`seismo3d.geometry.map_grid`) or the outer edges
        ``xmin, xmax, ymin, ymax``, perhaps ``crs``, ``crs_unit`` ("metre" or "degree") and ``nodata`` (without ``crs``
        and ``crs_unit``, edges that fit the globe and cells below 0.02 are taken as degrees, EPSG:4326); ``.npy``,
        without georeference.
    band : int
        Band of a raster file, from 1.

    Returns
    -------
    DataArray
        Elevation (row, column) as float32, dims ("y", "x"), NaN where the file has nodata or masks its cells; where a
        band states a scale and an offset, they are applied. ``attrs``: ``transform`` and ``crs`` (a string, empty where
        the file names none) and ``crs_unit``, "metre" or "degree" as rasterio knows the system, where the file says
        where it lies, ``nodata`` (the file's own value, or
        None; None too where it was scaled). A usual value for nothing that no nodata value declares is taken for one
        where it lies far below all other elevations, and a warning says so. Coordinates ``x`` and ``y`` of the cells'
        centres, except on grids that are turned against them.

    Raises
    ------
    FileAccessError
        If the file cannot be read.
    FormatError
        If it is not what its ending says, has no such band, lies in no known reference system, or is in feet.
    MissingDependencyError
        If rasterio is needed and not installed: for rasters, and for an ``.npz`` without ``crs_unit`` whose system is
        other than EPSG:4326, EPSG:3857 and the zones of UTM on WGS 84.
    GeometryError
        If every cell is nodata.

    Warns
    -----
    Seismo3dWarning
        If cells hold a usual value for nothing that is not declared as such.
    """
    path = as_readable_file(path)
    band = as_whole_number(band, "band", low=1)
    suffix = path.suffix.lower()
    if suffix in RASTERS:
        return _read_raster(path, band)
    if suffix in (".npz", ".npy"):
        return _read_numpy(path)
    raise FormatError(f"{path.name} ends in {suffix!r}; expected {', '.join(RASTERS[:3])}, .npz or .npy.")


def write_elevation(path: str | Path, elevation: Any) -> Path:
    """Write a map, with its georeference, as GeoTIFF (float32, deflated), ESRI ASCII or NPZ, as the name says.

    Parameters
    ----------
    path : str or Path
        Ends in ``.tif``, ``.asc`` or ``.npz``.
    elevation : DataArray or array_like of shape (rows, columns)
        NaN is written as nodata: NaN in a GeoTIFF, whatever ``nodata`` it was read with, -9999 in ESRI ASCII. Of whole
        numbers, ``nodata`` among the attributes is written as such.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    FileAccessError
        If it cannot be written.
    ParameterError
        If the name ends in something else.
    GeometryError
        If an ESRI ASCII grid is asked for whose cells are turned, not square, or have rows from south to north.
    """
    path = check_output(path, endings=WRITTEN_SUFFIXES)
    grid = MapGrid.from_elevation(elevation)
    values = as_real_array(getattr(elevation, "values", elevation), "elevation", ndim=2)
    nodata = getattr(elevation, "attrs", {}).get("nodata") if values.dtype.kind in "iu" else None
    suffix = path.suffix.lower()
    with written_aside(path) as aside, refuse_os_errors(path, "write"):
        if suffix == ".npz":
            _write_numpy(aside, values, grid, nodata)
        elif suffix == ".asc":
            _write_ascii(aside, values, grid, nodata)
        else:
            _write_raster(aside, values, grid, nodata)
    return path


def make_elevation(
    values: AnyArray,
    transform: Any = None,
    *,
    crs: str = "",
    crs_unit: str = "",
    nodata: float | None = None,
    name: str = "elevation",
) -> Any:
    """Return a map as the DataArray that :func:`read_elevation` gives; without ``transform``, one without a place.

    Parameters
    ----------
    values : array_like of shape (rows, columns)
        NaN, and ``nodata``, where there is nothing; kept as float32.
    transform : sequence of six floats, optional
        See :mod:`seismo3d.geometry.map_grid`.
    crs : str
        Reference system.
    crs_unit : {"", "metre", "degree"}
        What ``x`` and ``y`` are in. Empty: what ``crs`` is in, metres where that is empty too.
    nodata : float, optional
        The value that stands for nothing.
    name : str
        Name of the DataArray.
    """
    import xarray

    z = as_real_array(values, name, ndim=2)
    as_kind(crs, str, "crs", remedy="Give an authority's code, such as 'EPSG:32611', or well-known text.")
    if not is_among(crs_unit, ("", "metre", "degree")):
        raise ParameterError(f"crs_unit is {told(crs_unit)}; expected 'metre', 'degree' or ''.")
    if nodata is not None and not isinstance(nodata, (int, float, np.integer, np.floating)):
        raise ParameterError(f"nodata is {told(nodata)}; expected a number. Leave it out where NaN stands for nothing.")
    bad = ~np.isfinite(z) if z.dtype.kind == "f" else np.zeros(z.shape, bool)
    if nodata is not None and np.isfinite(float(nodata)):
        bad |= z == nodata
    z = np.where(bad, np.float32(np.nan), z.astype(np.float32))
    attrs: dict[str, Any] = {"nodata": nodata}
    coords: dict[str, Any] = {}
    if transform is not None:
        six = as_six(transform)
        attrs |= {"transform": six, "crs": crs, "crs_unit": crs_unit or unit_of(crs, name)}
        a, b, c, d, e, f = six
        if b == 0.0 and d == 0.0:
            coords = {"y": f + e * (np.arange(z.shape[0]) + 0.5), "x": c + a * (np.arange(z.shape[1]) + 0.5)}
    return xarray.DataArray(z, dims=("y", "x"), coords=coords, attrs=attrs, name=name)


def holds_elevation(path: str | Path) -> bool:
    """Whether a file is an elevation map by its ending, or, of ``.npz``, by an array named for it."""
    path = as_path(path)
    if path.suffix.lower() in RASTERS:
        return True
    if path.suffix.lower() != ".npz" or not path.is_file():
        return False
    try:
        held = list_npz(path)
    except (FormatError, FileAccessError):
        return False
    return any(name in held for name in _NAMES[:1] + _NAMES[2:])


def has_rasterio() -> bool:
    """Whether rasterio is installed, by which rasters are read and written and reference systems are told apart."""
    return find_spec("rasterio") is not None


def raster_suffix() -> str:
    """Return the ending of maps that are written beside other results: ``.tif``, ``.npz`` without rasterio."""
    return ".tif" if has_rasterio() else ".npz"


def import_rasterio(purpose: str) -> Any:
    """Return rasterio, or say how to get it."""
    try:
        import rasterio
    except ImportError as error:
        raise MissingDependencyError(
            f"{purpose} needs rasterio, which is not installed. pip install 'seismo3d[terrain]', or use .npz."
        ) from error
    return rasterio


def _read_raster(path: Path, band: int) -> Any:
    import warnings

    rasterio = import_rasterio(f"{path.name}")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", rasterio.errors.NotGeoreferencedWarning)
            with rasterio.open(path) as file:
                if band > file.count:
                    raise FormatError(
                        f"{path.name} has {file.count} bands; band {band} was asked for. Count them from 1."
                    )
                if np.dtype(file.dtypes[band - 1]).kind not in "iuf":
                    raise FormatError(f"{path.name} holds values of type {file.dtypes[band - 1]}; expected elevations.")
                declared = file.width * file.height * np.dtype(file.dtypes[band - 1]).itemsize
                check_declared(declared, path.stat().st_size, f"{path.name}, of {file.height} x {file.width} cells,")
                crs = _name_of(file.crs)
                unit = _unit_of_file(path, crs)
                _refuse_feet(file, band, path.name)
                values, nodata = _scaled(file, band)
                placed = file.crs is not None or not file.transform.is_identity
                transform = tuple(file.transform)[:6] if placed else None
                made = make_elevation(values, transform, crs=crs, crs_unit=unit, nodata=nodata)
    except rasterio.errors.RasterioError as error:
        said = str(error.__cause__ or error).rstrip(".")
        raise FormatError(f"{path.name} cannot be read as a raster: {said}. It may be cut short.") from error
    return _with_data(made, path)


def _unit_of_file(path: Path, crs: str, stated: str = "") -> str:
    """Return what a file's reference system is in, or refuse a file that lies in none, or in feet."""
    try:
        return unit_of(crs, path.name, stated=stated)
    except ParameterError as error:
        raise FormatError(str(error)) from error


def _refuse_feet(file: Any, band: int, name: str) -> None:
    """Refuse elevations that a band tells in another unit of length: all that is measured here is in metres."""
    unit = (file.units[band - 1] or "").strip()
    if any(word in unit.lower() for word in ("ft", "foot", "feet")):
        raise FormatError(f"{name} has elevations in {unit!r}; expected metres. Convert them first.")


def _scaled(file: Any, band: int) -> tuple[AnyArray, float | None]:
    """Return a band's elevations, NaN where they are masked or nodata, and the value that still stands for nothing."""
    values, nodata = file.read(band), file.nodatavals[band - 1]
    is_masked = file.read_masks(band) == 0
    scale, offset = file.scales[band - 1], file.offsets[band - 1]
    if (scale, offset) != (1.0, 0.0):
        values, nodata = values * scale + offset, None
    return np.where(is_masked, np.float32(np.nan), values.astype(np.float32)) if is_masked.any() else values, nodata


def _name_of(crs: Any) -> str:
    """Return the code of a reference system where it has one, else its well-known text."""
    if crs is None:
        return ""
    code = crs.to_epsg()
    return f"EPSG:{code}" if code is not None else str(crs.to_wkt())


def _read_numpy(path: Path) -> Any:
    arrays = {"elevation": read_npy(path)} if path.suffix.lower() == ".npy" else read_npz(path)
    name = next((key for key in _NAMES if key in arrays), None)
    if name is None and len(arrays) == 1:
        name = next(iter(arrays))
    if name is None or arrays[name].ndim != 2 or arrays[name].dtype.kind not in "iuf":
        held = ", ".join(f"{key} {value.shape}" for key, value in arrays.items()) or "nothing"
        raise FormatError(f"{path.name} holds {held}; expected a map of numbers (rows, columns) named elevation.")
    values = arrays[name]
    transform = None
    if "transform" in arrays:
        transform = as_six(arrays["transform"].ravel())
    elif all(key in arrays for key in _BOUNDS):
        left, right, low, high = (float(arrays[key]) for key in _BOUNDS)
        # the first row is the northern one, whichever of ymin and ymax was called so
        bottom, top = min(low, high), max(low, high)
        rows, columns = values.shape
        transform = ((right - left) / columns, 0.0, left, 0.0, (bottom - top) / rows, top)
    nodata = float(arrays["nodata"]) if "nodata" in arrays and np.isfinite(arrays["nodata"]) else None
    crs, stated = (str(arrays[key]) if key in arrays else "" for key in ("crs", "crs_unit"))
    if not (crs or stated) and transform is not None and _looks_like_degrees(transform, values.shape):
        crs = "EPSG:4326"
    unit = _unit_of_file(path, crs, stated)
    return _with_data(make_elevation(values, transform, crs=crs, crs_unit=unit, nodata=nodata), path)


def _looks_like_degrees(transform: Any, shape: tuple[int, ...]) -> bool:
    """Whether a map without a named system can only be in degrees: it fits the globe, and its cells are tiny."""
    a, _, c, _, e, f = transform
    inside = -180.0 <= c <= 180.0 and -180.0 <= c + a * shape[1] <= 180.0 and abs(f) <= 90.0
    return bool(inside and abs(f + e * shape[0]) <= 90.0 and max(abs(a), abs(e)) < 0.02)


def _with_data(made: Any, path: Path) -> Any:
    _empty_voids(made, path)
    try:
        elevation_values(made, path.name, least=1)
    except GeometryError as error:
        raise GeometryError(f"{path.name} holds no elevation: every cell is nodata. Give a map with data.") from error
    return made


def _empty_voids(made: Any, path: Path) -> None:
    """Put NaN where a map holds a usual value for nothing that is not declared as such, and warn."""
    import warnings

    z = made.values
    lowest = np.float32(np.nanmin(z, initial=np.inf))
    if lowest not in VOIDS and lowest > BOTTOMLESS:
        return
    void = z == lowest
    if np.nanmin(z, where=~void, initial=np.inf) < float(lowest) + FAR_BELOW:
        return
    made.values = np.where(void, np.float32(np.nan), z)
    warnings.warn(
        f"{path.name} holds {lowest:g} in {np.count_nonzero(void)} cells, far below all others, and does not declare "
        "it as nodata; they are taken as empty. Declare it, as with "
        f"gdal_edit.py -a_nodata {float(lowest):.9g} {path.name}.",
        Seismo3dWarning,
        stacklevel=4,
    )


def _write_numpy(path: Path, values: AnyArray, grid: MapGrid, nodata: float | None) -> None:
    place: dict[str, Any] = {} if nodata is None else {"nodata": np.array(nodata)}
    if grid.has_place:
        place |= {"transform": np.array(grid.transform), "crs": np.array(grid.crs), "crs_unit": np.array(grid.unit)}
    with path.open("wb") as file:
        np.savez_compressed(file, elevation=values, **place)


def _write_raster(path: Path, values: AnyArray, grid: MapGrid, nodata: float | None) -> None:
    import warnings

    rasterio = import_rasterio("writing a GeoTIFF")
    if values.dtype.kind == "b":
        values = values.astype(np.uint8)
    elif values.dtype.kind == "f":
        values, nodata = values.astype(np.float32), float("nan")
    place: dict[str, Any] = {} if nodata is None else {"nodata": nodata}
    if grid.has_place:
        place["transform"] = rasterio.Affine(*grid.transform)
        if grid.crs:
            place["crs"] = rasterio.crs.CRS.from_string(grid.crs)
    rows, columns = values.shape
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rasterio.errors.NotGeoreferencedWarning)
        with rasterio.open(
            path, "w", driver="GTiff", height=rows, width=columns, count=1, dtype=values.dtype.name,
            compress="deflate", **place,
        ) as file:  # fmt: skip
            file.write(values, 1)


def _write_ascii(path: Path, values: AnyArray, grid: MapGrid, nodata: float | None) -> None:
    a, b, c, d, e, f = grid.transform if grid.has_place else (1.0, 0.0, 0.0, 0.0, -1.0, float(values.shape[0]))
    if b != 0.0 or d != 0.0 or not np.isclose(a, -e) or a <= 0.0:
        raise GeometryError("an ESRI ASCII grid has square cells and rows from north to south; write a .tif instead.")
    rows, columns = values.shape
    head = f"ncols {columns}\nnrows {rows}\nxllcorner {c!r}\nyllcorner {f + e * rows!r}\ncellsize {a!r}\n"
    filled = np.where(np.isfinite(values) & (values != nodata), values, -9999.0)
    with path.open("w", encoding="ascii") as file:
        file.write(head + "NODATA_value -9999\n")
        np.savetxt(file, filled, fmt="%.9g")
