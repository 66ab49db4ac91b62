"""The folder of a run: refused before any work where it must not be written, and complete or absent afterwards."""

from __future__ import annotations

import json
import platform
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d.errors import FileAccessError

RECORD = "run.json"
_PACKAGES = ("numpy", "scipy", "numba", "xarray", "segyio", "scikit-image", "matplotlib", "pyvista", "vtk")


def check_run_folder(folder: Path, *, inputs: Iterable[Path], overwrite: bool) -> None:
    """Refuse a folder that a run must not write.

    Parameters
    ----------
    folder : Path
        Where the results are to go.
    inputs : iterable of Path
        Files that the run reads: they must not lie in the folder.
    overwrite : bool
        Whether an earlier run there may be replaced.

    Raises
    ------
    FileAccessError
        If the folder is there and may not be replaced. Only a folder that is empty or holds a run is ever replaced.
    """
    if not folder.exists() and not folder.is_symlink():
        return
    if not folder.is_dir() or folder.is_symlink():
        raise FileAccessError(f"{folder} is a file or a link; expected a new folder. Choose another name.")
    if not overwrite:
        raise FileAccessError(f"{folder} exists already. Choose another folder, or replace it with --overwrite.")
    place = folder.resolve()
    if any(place in Path(path).resolve().parents for path in inputs) or place in (Path.cwd(), *Path.cwd().parents):
        raise FileAccessError(f"{folder} holds the input or is the current folder: it is not replaced. Choose another.")
    if any(folder.iterdir()) and not (folder / RECORD).is_file():
        raise FileAccessError(f"{folder} holds no {RECORD}: it is no earlier run and is not replaced. Choose another.")


@contextmanager
def kept_aside(out: Path) -> Iterator[Path]:
    """Give a folder beside ``out`` that stays until all is done, unless nothing is in it, and then takes its place."""
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
    finally:
        if aside.is_dir() and not any(aside.iterdir()):
            aside.rmdir()


def find_versions() -> dict[str, str]:
    """Versions of Python, the system and the packages that a result depends on."""
    from importlib.metadata import version

    from seismo3d import __version__

    found = {"seismo3d": __version__, "python": platform.python_version(), "system": platform.platform()}
    return found | {package: version(package) for package in _PACKAGES}


def describe_run(*paths: Path, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return what every record begins with: the inputs' fingerprints, the time, the options given, the versions.

    Parameters
    ----------
    *paths : Path
        The inputs; the record has ``input`` where there is one, and the list ``inputs`` where there are several.
    options : mapping
        The options; those that are None were not given, and are left out.
    """
    from datetime import UTC, datetime

    from seismo3d.io.fingerprint import fingerprint

    found = [fingerprint(path) for path in paths]
    return {
        **({"input": found[0]} if len(found) == 1 else {"inputs": found}),
        "finished": datetime.now(UTC).isoformat(timespec="seconds"),
        "options": {name: value for name, value in options.items() if value is not None},
        "versions": find_versions(),
    }


def write_record(path: Path, record: Mapping[str, Any]) -> None:
    """Write a run's record as JSON; NaN and infinities as null."""
    path.write_text(json.dumps(plain(record), indent=2, ensure_ascii=False, allow_nan=False) + "\n", encoding="utf-8")


def print_json(record: Mapping[str, Any]) -> None:
    """Print results as JSON; NaN and infinities as null."""
    import typer

    typer.echo(json.dumps(plain(record), indent=2, ensure_ascii=False, allow_nan=False))


def plain(value: Any) -> Any:
    """Turn numpy values, tuples, paths and objects into what JSON can hold."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set):
        return [plain(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    return value if isinstance(value, str | int | bool) or value is None else str(value)
