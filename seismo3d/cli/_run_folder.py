"""The folder of a run: refused before any work where it must not be written, and complete or absent afterwards."""

from __future__ import annotations

import json
import platform
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from seismo3d.errors import FileAccessError

RECORD = "run.json"
_MARKS = {
    "faults": "faultset.npz",
    "tracks": "tracks.csv",
    "network": "network.graphml",
    "score": "score.json",
    "timelapse": "shift_std.sgy",
    "map": "trajectory.txt",
    "lineaments": "lineaments.geojson",
    "compare": "change.png",
}
"""A file that every run of a command has; tells the command where a record does not name it."""
_PACKAGES = ("numpy", "scipy", "numba", "xarray", "segyio", "scikit-image", "matplotlib", "pyvista", "vtk")


def check_run_folder(folder: Path, *, command: str, inputs: Iterable[Path], overwrite: bool) -> None:
    """Refuse a folder that a run must not write.

    Parameters
    ----------
    folder : Path
        Where the results are to go.
    command : str
        The command that makes the run: it replaces only runs of its own.
    inputs : iterable of Path
        Every file and folder that the run reads: none of them may be the folder or lie in it.
    overwrite : bool
        Whether an earlier run there may be replaced.

    Raises
    ------
    FileAccessError
        If the folder is there and may not be replaced. Only a folder that is empty or holds a run of the same command
        is ever replaced, and none in which there is something that no run wrote.
    """
    if not folder.exists() and not folder.is_symlink():
        return
    if not folder.is_dir() or folder.is_symlink():
        raise FileAccessError(f"{folder} is a file or a link; expected a new folder. Choose another name.")
    place = folder.resolve()
    for path in inputs:
        if _lies_in(Path(path), place):
            raise FileAccessError(
                f"{folder} is or holds the input {path}: it is not replaced. Choose another folder for the results."
            )
    if place in (Path.cwd(), *Path.cwd().parents):
        raise FileAccessError(f"{folder} is the current folder or holds it: it is not replaced. Choose another.")
    if not overwrite:
        raise FileAccessError(f"{folder} exists already. Choose another folder, or replace it with --overwrite.")
    if any(folder.iterdir()):
        _check_own_run(folder, command)


def _lies_in(path: Path, place: Path) -> bool:
    """Tell whether a path, or the file that it links to, is a folder or lies in it."""
    found = path.resolve(), path.parent.resolve() / path.name, Path.cwd() / path
    return any(place in (entry, *entry.parents) for entry in found)


def _check_own_run(folder: Path, command: str) -> None:
    if not (folder / RECORD).is_file():
        raise FileAccessError(f"{folder} holds no {RECORD}: it is no earlier run and is not replaced. Choose another.")
    made_by = _command_of(folder)
    if made_by is None:
        raise FileAccessError(f"{folder} holds a {RECORD} of no known command: it is not replaced. Choose another.")
    if made_by != command:
        raise FileAccessError(
            f"{folder} holds a run of seismo3d {made_by}; seismo3d {command} replaces only runs of its own. Choose "
            "another folder, or remove this one first."
        )
    strangers = _find_strangers(folder)
    if strangers:
        more = f" and {len(strangers) - 1} more" if len(strangers) > 1 else ""
        raise FileAccessError(
            f"{folder} holds {strangers[0]}{more}, which no run there wrote, and --overwrite would remove. Move that "
            "away, or choose another folder."
        )


def _find_strangers(folder: Path) -> list[str]:
    """Return what lies in the folder of a run that neither it wrote, nor is a run that was made of it."""
    written = (read_record(folder) or {}).get("files")
    if not isinstance(written, list):
        return []
    others = (path for path in folder.iterdir() if path.name not in written)
    return sorted(path.name for path in others if not (path.is_dir() and _command_of(path) is not None))


def _command_of(folder: Path) -> str | None:
    """Return the command that made a run: as its record says, else as its files tell; None where neither does."""
    record = read_record(folder)
    if record is None:
        return None
    if isinstance(record.get("command"), str):
        return str(record["command"])
    found = [command for command, name in _MARKS.items() if (folder / name).is_file()]
    if {"faults", "tracks", "network"} <= set(found):
        return "paper f3"
    return found[0] if found else None


def read_record(folder: Path) -> dict[str, Any] | None:
    """Return the record of a run, empty where it says nothing; None where there is none that can be read."""
    try:
        record = json.loads((folder / RECORD).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return record if isinstance(record, dict) else {}


@contextmanager
def kept_aside(out: Path) -> Iterator[Path]:
    """Give a folder beside ``out`` that stays until all is done, unless nothing is in it, and then takes its place."""
    import typer

    from seismo3d.io._files import refuse_os_errors, replace_path
    from seismo3d.seismic.blocks.tracing import forget_work

    aside = out.parent / f"{out.name}.unfinished"
    try:
        with refuse_os_errors(out, "write"):
            yield aside
            replace_path(aside, out, folder=True)
            forget_work(out)
    except FileAccessError as error:
        raise FileAccessError(f"{error} Finished blocks are kept: give the same command again to go on.") from error
    except (KeyboardInterrupt, SystemExit):
        if aside.is_dir() and any(aside.iterdir()):
            typer.echo(f"seismo3d: what is done is kept in {aside}: give the same command again to go on", err=True)
        raise
    finally:
        if aside.is_dir() and not any(aside.iterdir()):
            aside.rmdir()


def open_told(path: Path, **reading: Any) -> Any:
    """Open a cube as ``open_cube`` does, and tell on stderr what its file made odd: results depend on it."""
    import typer

    from seismo3d.io.cubes import open_cube

    cube = open_cube(path, **reading)
    for note in cube.attrs.get("notes", ()):
        typer.echo(f"seismo3d: {path.name}: {note}", err=True)
    return cube


def settle_live(cube: Any, clock: Callable[[str, float], None]) -> Any:
    """Find out once which traces of a cube are live: a lazy one would look for them wherever they are asked for."""
    if cube.chunks is None or "live" not in cube.coords:
        return cube
    clock("live traces", 0.0)
    return cube.assign_coords(live=cube["live"].compute())


def find_versions() -> dict[str, str]:
    """Versions of Python, the system and the packages that a result depends on."""
    from importlib.metadata import version

    from seismo3d import __version__

    found = {"seismo3d": __version__, "python": platform.python_version(), "system": platform.platform()}
    return found | {package: version(package) for package in _PACKAGES}


def describe_run(*paths: Path, command: str, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return what every record begins with: command, the inputs' fingerprints, time, the options given, versions.

    Parameters
    ----------
    *paths : Path
        The inputs; the record has ``input`` where there is one, and the list ``inputs`` where there are several.
    command : str
        The command that made the run.
    options : mapping
        The options; those that are None were not given, and are left out.
    """
    from datetime import UTC, datetime

    from seismo3d.io.fingerprint import fingerprint

    found = [fingerprint(path) for path in paths]
    return {
        "command": command,
        **({"input": found[0]} if len(found) == 1 else {"inputs": found}),
        "finished": datetime.now(UTC).isoformat(timespec="seconds"),
        "options": {name: value for name, value in options.items() if value is not None},
        "versions": find_versions(),
    }


def write_record(folder: Path, record: Mapping[str, Any]) -> None:
    """Write the record of a run, when all else of it is in its folder: it names what is there."""
    from seismo3d.io.records import write_json

    files = sorted({path.name for path in folder.iterdir()} | {RECORD})
    write_json(folder / RECORD, {**record, "files": files})


def print_json(record: Mapping[str, Any]) -> None:
    """Print results as JSON; NaN and infinities as null."""
    import typer

    from seismo3d.io.records import to_json

    typer.echo(to_json(record))
