"""``seismo3d register``: align two scans and print the transform."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from seismo3d.cli._options import Json, refuse_unused

if TYPE_CHECKING:
    from seismo3d.registration.result import Registration

EXAMPLES = (
    "seismo3d register target.ply source.ply -o moved.ply",
    "seismo3d register before.tif after.tif --model rigid --vertical tilt --json",
)


def run(
    target: Path = typer.Argument(
        help="Point file (PLY, PCD, XYZ, CSV, LAS, LAZ, NPY, NPZ), or elevation map (GeoTIFF, ESRI ASCII, NPZ).",
        show_default=False,
    ),
    source: Path = typer.Argument(help="What to carry onto the target, of the same kind.", show_default=False),
    out: Path | None = typer.Option(
        None,
        "--out",
        "--output",
        "-o",
        help="Write the moved source: .ply, .xyz or .npy; of a map: .tif, .asc or .npz.",
    ),
    model: str | None = typer.Option(
        None,
        help="translation, rigid, similarity, scaled or affine; maps: the first three. [default: rigid; translation]",
    ),
    vertical: str | None = typer.Option(
        None, help="Of maps, what may happen to elevations: offset, tilt or scaled. [default: offset]"
    ),
    start: Path | None = typer.Option(
        None, help="Of points, text file with a matrix to start from. [default: the identity]"
    ),
    stages: str | None = typer.Option(
        None, help="Of points, stages that may run, with commas. [default: local,global,polish]"
    ),
    voxel_size: float | None = typer.Option(
        None, help="Of points, edge of the finest voxels. [default: from the source]"
    ),
    json: Json = False,
) -> None:
    """Align two scans; print the transform that carries SOURCE onto TARGET, how sure it is, and what cannot be seen."""
    if _are_maps(target, source):
        refuse_unused("two maps", {"--start": start, "--stages": stages, "--voxel-size": voxel_size})
        _register_maps(target, source, out, model or "translation", vertical or "offset", json)
    else:
        refuse_unused("points", {"--vertical": vertical})
        _register_points(target, source, out, model or "rigid", start, stages, voxel_size, json)


def _are_maps(target: Path, source: Path) -> bool:
    from seismo3d.errors import ParameterError
    from seismo3d.io.elevation import holds_elevation

    are_maps = holds_elevation(target), holds_elevation(source)
    if any(are_maps) and not all(are_maps):
        map_, other = (target, source) if are_maps[0] else (source, target)
        raise ParameterError(
            f"{map_.name} is an elevation map and {other.name} is none; expected two maps, or two point files. Make a "
            "map of the points, or points of the map."
        )
    return all(are_maps)


def _register_points(
    target: Path, source: Path, out: Path | None, model: str, start: Path | None, stages: str | None,
    voxel_size: float | None, json: bool,
) -> None:  # fmt: skip
    from seismo3d.cli._run_folder import print_json
    from seismo3d.io._files import check_output
    from seismo3d.io.points import WRITTEN_SUFFIXES, write_points
    from seismo3d.registration.register import STAGES, register
    from seismo3d.scan import Scan

    if out is not None:
        check_output(
            out, endings=WRITTEN_SUFFIXES, inputs=[target, source] if start is None else [target, source, start]
        )
    fixed, moving = Scan.from_file(target), Scan.from_file(source)
    found = register(
        fixed,
        moving,
        model=model,
        start=None if start is None else _read_matrix(start),
        stages=STAGES if stages is None else tuple(name.strip() for name in stages.split(",") if name.strip()),
        voxel_size=voxel_size,
    )
    if out is not None:
        write_points(out, found.apply(moving.points))
    if json:
        print_json(_as_dict(found))
        return
    for row in found.T_target_source:
        typer.echo(" ".join(f"{value:.12g}" for value in row))
    for name, value in _lines(found):
        typer.echo(f"# {name:<14}{value}")


def _register_maps(target: Path, source: Path, out: Path | None, model: str, vertical: str, json: bool) -> None:
    from seismo3d.cli._run_folder import print_json
    from seismo3d.io._files import check_output
    from seismo3d.io.elevation import WRITTEN_SUFFIXES, import_rasterio, read_elevation, write_elevation
    from seismo3d.terrain.alignment import register

    if out is not None:
        check_output(out, endings=WRITTEN_SUFFIXES, inputs=[target, source])
        if out.suffix.lower() in (".tif", ".tiff"):
            import_rasterio(f"writing {out.name}")
    fixed, moving = read_elevation(target), read_elevation(source)
    found = register(fixed, moving, model=model, vertical=vertical)
    if out is not None:
        write_elevation(out, found.apply(moving, fixed))
    names = ("model", "vertical", "state", "stage", "overlap", "nmad_before", "nmad_after", "turn", "growth")
    facts = {name: getattr(found, name) for name in names}
    arrays = {"shift": found.shift, "tilt": found.tilt, "sigma": found.sigma}
    if json:
        print_json(
            {"T_target_source": found.T_target_source, **facts, **arrays, "vertical_scale": found.vertical_scale}
        )
        return
    for row in found.T_target_source:
        typer.echo(" ".join(f"{value:.12g}" for value in row))
    for name, value in facts.items():
        typer.echo(f"# {name:<14}{value if isinstance(value, str) else f'{value:.6g}'}")
    for name, values in arrays.items():
        typer.echo(f"# {name:<14}{' '.join(f'{v:.6g}' for v in values)}")


def _read_matrix(path: Path) -> Any:
    import numpy as np

    from seismo3d.errors import FileAccessError, FormatError

    try:
        return np.loadtxt(path)
    except OSError as error:
        raise FileAccessError(f"{path} cannot be read: {error}. Give --start a text file with a matrix.") from error
    except ValueError as error:
        raise FormatError(
            f"{path} is not a matrix of numbers: {error}. Give as many rows as columns, separated by spaces."
        ) from error


def _lines(found: Registration) -> list[tuple[str, str]]:
    import numpy as np

    spread = np.sqrt(np.diag(found.covariance))
    lines = [
        ("state", f"{found.state} ({found.stage} stage)"),
        ("overlap", f"{found.overlap:.3f}"),
        ("rmse", f"{found.rmse:.6g}"),
        ("angle", f"{np.degrees(found.angle):.4f} deg"),
        ("sigma", " ".join(f"{value:.3g}" for value in spread)),
    ]
    if found.at_bounds:
        lines.append(("at bounds", ", ".join(found.at_bounds)))
    if found.certificate is not None:
        words = "holds" if found.certificate.holds else "does not hold"
        lines.append(("certificate", f"{words}, relative gap {found.certificate.relative_gap:.2g}"))
    for direction in found.unobservable:
        turn, shift = (" ".join(f"{v:.3f}" for v in part) for part in (direction.rotation, direction.translation))
        lines.append(("unobservable", f"rotation ({turn}) translation ({shift})"))
    return lines


def _as_dict(found: Registration) -> dict[str, Any]:
    certificate = found.certificate
    return {
        "T_target_source": found.T_target_source,
        "state": found.state,
        "stage": found.stage,
        "model": found.model,
        "overlap": found.overlap,
        "rmse": found.rmse,
        "scale": found.scale,
        "at_bounds": found.at_bounds,
        "covariance": found.covariance,
        "information": found.information,
        "certificate": None
        if certificate is None
        else {"gap": certificate.gap, "relative_gap": certificate.relative_gap, "holds": certificate.holds},
        "unobservable": [
            {"rotation": d.rotation, "translation": d.translation, "scale": d.scale} for d in found.unobservable
        ],
    }
