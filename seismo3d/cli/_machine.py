"""What a machine and an installation have: versions, threads, memory, rendering, compiled code, extras."""

from __future__ import annotations

import os
import re
import tempfile
from pathlib import Path
from typing import Any

_LIMITS = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def examine() -> dict[str, Any]:
    """Examine this machine and installation.

    Returns
    -------
    dict
        ``versions``, ``threads``, ``memory_gib``, ``rendering``, ``cache`` and ``extras`` (each with what it lacks).
    """
    from seismo3d.cli._run_folder import find_versions

    return {
        "versions": find_versions(),
        "threads": find_threads(),
        "memory_gib": find_memory(),
        "rendering": find_rendering(),
        "cache": find_cache(),
        "extras": find_extras(),
    }


def find_threads() -> dict[str, Any]:
    """Cores that this process may use, threads that kernels use, and the variables that limit them."""
    import numba

    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    limits = {name: os.environ[name] for name in _LIMITS if name in os.environ}
    return {"cores": cores, "used": numba.get_num_threads(), "limits": limits}


def find_memory() -> float | None:
    """Memory of the machine in GiB; None where the system does not tell."""
    try:
        return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30)
    except (AttributeError, ValueError, OSError):
        return None


def find_rendering() -> dict[str, Any]:
    """Whether there is a screen, the kind of window that draws without one, and what keeps it from drawing."""
    from seismo3d.plot.rendering import find_windowless, has_screen

    window, problem = find_windowless()
    return {"screen": has_screen(), "window": window, "problem": problem}


def find_cache() -> dict[str, Any]:
    """Where compiled code is kept, how much there is, and whether more can be written."""
    import numba

    import seismo3d

    own = Path(seismo3d.__file__).parent
    folder = Path(getattr(numba.config, "CACHE_DIR", "") or own)
    files = [path for path in folder.rglob("*.nb?") if path.is_file()] if folder.is_dir() else []
    size = sum(path.stat().st_size for path in files) / 2**20
    return {"folder": folder, "files": len(files), "size_mib": size, "writable": _can_write(folder)}


def find_extras() -> dict[str, list[str]]:
    """Every extra of the package, with those of its packages that are not installed."""
    from importlib.metadata import PackageNotFoundError, distribution, requires

    try:
        wanted = requires("seismo3d") or []
    except PackageNotFoundError:
        return {}
    extras: dict[str, list[str]] = {}
    for line in wanted:
        extra = re.search(r"extra == ['\"]([^'\"]+)['\"]", line)
        name = re.match(r"[A-Za-z0-9._-]+", line)
        if extra is None or name is None:
            continue
        missing = extras.setdefault(extra.group(1), [])
        try:
            distribution(name.group())
        except PackageNotFoundError:
            missing.append(name.group())
    return extras


def _can_write(folder: Path) -> bool:
    place = folder
    while not place.exists():
        place = place.parent
    try:
        with tempfile.TemporaryFile(dir=place):
            return True
    except OSError:
        return False
