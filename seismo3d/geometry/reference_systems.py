"""Reference systems of maps, as rasterio knows them where it is installed: their units, and which are the same."""

from __future__ import annotations

from math import isclose, radians
from typing import Any

from seismo3d.errors import MissingDependencyError, ParameterError

WEB_MERCATOR = "EPSG:3857"
"""The system of web maps, whose metres are true at the equator alone: at 60 degrees two are one on the ground."""
UNITS = ("metre", "degree")
"""What x and y of a map can be in."""


def unit_of(crs: str, name: str = "crs", *, stated: str = "") -> str:
    """Return what a reference system measures in, "metre" or "degree".

    Parameters
    ----------
    crs : str
        Authority's code, well-known text, or empty.
    name : str
        Of what lies in it, for messages.
    stated : str
        What the map itself says that it is in: taken where it names no system, and where rasterio is not installed.

    Raises
    ------
    ParameterError
        If there is no such system, or it is in another unit, such as feet, along the map or in elevation.
    MissingDependencyError
        If rasterio is needed to tell, and not installed.
    """
    if stated and stated not in UNITS:
        raise ParameterError(f"{name} is in {stated!r}; expected 'metre' or 'degree'. Convert its coordinates first.")
    if not crs:
        return stated or "metre"
    try:
        system = _parse(crs)
    except ImportError as error:
        known = stated or _unit_without_rasterio(crs)
        if known:
            return known
        raise MissingDependencyError(
            f"{name} is in {short_name(crs)}, and rasterio, which knows whether that is in metres or degrees, is not "
            "installed. pip install 'seismo3d[terrain]', or state crs_unit, 'metre' or 'degree'."
        ) from error
    if system is None:
        raise ParameterError(
            f"{name} is in {short_name(crs)!r}, which is no known reference system. Give an authority's code, such as "
            "EPSG:32611, or well-known text."
        )
    unit, size = system.units_factor
    if not isclose(size, radians(1.0) if system.is_geographic else 1.0, rel_tol=1e-9):
        raise ParameterError(
            f"{name} is in {short_name(crs)}, whose unit is the {unit}; expected metres or degrees. "
            "Reproject it, as with gdalwarp -t_srs, and give elevations in metres too."
        )
    unit, size = _unit_upwards(system)
    if not isclose(size, 1.0, rel_tol=1e-9):
        raise ParameterError(
            f"{name} is in {short_name(crs)}, whose elevations are in the unit {unit!r}; expected metres. Convert "
            "them, and name a system in metres."
        )
    return "degree" if system.is_geographic else "metre"


def same_system(first: str, second: str) -> bool:
    """Whether two reference systems are the same: by their text, else by rasterio where it is installed."""
    if first.strip().upper() == second.strip().upper():
        return True
    try:
        one, other = _parse(first), _parse(second)
    except ImportError:
        return False
    return one is not None and bool(one == other)


def short_name(crs: str) -> str:
    """Return the name of a reference system for a message."""
    if len(crs) <= 40:
        return crs
    return crs.split('"')[1] if crs.count('"') >= 2 else f"{crs[:37]}..."


def _parse(crs: str) -> Any:
    """Return a reference system as rasterio knows it, None where there is none of that text."""
    import rasterio

    try:
        # within an environment GDAL's own complaints go to the log
        with rasterio.Env():
            return rasterio.crs.CRS.from_user_input(crs)
    except ValueError:
        return None


def _unit_upwards(system: Any) -> tuple[str, float]:
    """Return the unit of a compound system's elevations and its length in metres; metres where it has none."""
    parts = system.to_dict(projjson=True).get("components", [])
    unit: Any = parts[-1]["coordinate_system"]["axis"][0]["unit"] if parts else "metre"
    # PROJ abbreviates the metre alone
    return (unit, 1.0) if unit == "metre" else (str(unit["name"]), float(unit["conversion_factor"]))


def _unit_without_rasterio(crs: str) -> str:
    """Return the unit of the few systems that most maps are in; empty for all others."""
    code = crs.strip().upper().removeprefix("EPSG:")
    if code == "4326":
        return "degree"
    # zones of UTM on WGS 84, north and south
    is_utm = len(code) == 5 and code.isdigit() and code[:3] in ("326", "327") and 1 <= int(code[3:]) <= 60
    return "metre" if is_utm or crs.strip().upper() == WEB_MERCATOR else ""
