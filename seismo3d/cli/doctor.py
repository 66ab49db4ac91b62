"""``seismo3d doctor``: what this machine and installation have, and what is missing."""

from __future__ import annotations

from typing import Any

import typer

from seismo3d.cli._options import Json

EXAMPLES = ("seismo3d doctor", "seismo3d doctor --json > doctor.json")


def run(json: Json = False) -> None:
    """Check versions, threads, memory, 3D rendering, the cache of compiled code, and the extras."""
    from seismo3d.cli._machine import examine
    from seismo3d.cli._run_folder import print_json

    found = examine()
    if json:
        print_json(found)
        return
    for name, words in _lines(found):
        typer.echo(f"{name:<12}{words}".rstrip())


def _lines(found: dict[str, Any]) -> list[tuple[str, str]]:
    lines = [("" if number else "versions", f"{k} {v}") for number, (k, v) in enumerate(found["versions"].items())]
    threads, memory = found["threads"], found["memory_gib"]
    limits = ", ".join(f"{name}={value}" for name, value in threads["limits"].items())
    lines.append(("threads", f"{threads['used']} of {threads['cores']} cores{f' ({limits})' if limits else ''}"))
    lines.append(("memory", "not known here" if memory is None else f"{memory:.1f} GiB"))
    scene = found["rendering"]
    screen = "a screen" if scene["screen"] else "no screen"
    lines.append(("3D scenes", f"{scene['problem'] or 'yes, ' + (scene['window'] or 'by its own choice')}; {screen}"))
    cache = found["cache"]
    state = f"{cache['files']} files, {cache['size_mib']:.1f} MiB" if cache["writable"] else "cannot be written"
    lines.append(("compiled", f"{state} in {cache['folder']}"))
    if not cache["writable"]:
        lines.append(("", "every run compiles anew: set NUMBA_CACHE_DIR to a folder that can be written"))
    for number, (extra, missing) in enumerate(found["extras"].items()):
        words = "there" if not missing else f"lacks {', '.join(missing)}: pip install 'seismo3d[{extra}]'"
        lines.append(("" if number else "extras", f"{extra}: {words}"))
    return lines
