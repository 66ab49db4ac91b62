"""The typer application: every public module beside this one is a command of its name."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from seismo3d._typing import Progress  # numpy is not needed to show help

_FIRST = ("info", "faults", "tracks", "network", "score", "convert", "view")
"""The order in which help lists the commands; others follow by name."""


def _make_app() -> typer.Typer:
    made = typer.Typer(
        name="seismo3d",
        help="Faults, tracks and throws from seismic cubes.",
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    found = [m.name for m in pkgutil.iter_modules([str(Path(__file__).parent)])]
    names = [name for name in found if name != "app" and not name.startswith("_")]
    for name in sorted(names, key=lambda n: (_FIRST.index(n) if n in _FIRST else len(_FIRST), n)):
        module = importlib.import_module(f"seismo3d.cli.{name}")
        made.command(name.replace("_", "-"), epilog=_show_examples(getattr(module, "EXAMPLES", ())))(module.run)
    return made


def _show_examples(examples: tuple[str, ...]) -> str | None:
    """Lay examples out below a command's help; the sign in front keeps them from being wrapped."""
    if not examples:
        return None
    return "\b\nExamples:\n" + "\n".join(f"  {line}" for line in examples)


def _print_version(value: bool) -> None:
    if value:
        from seismo3d import __version__

        typer.echo(f"seismo3d {__version__}")
        raise typer.Exit


app = _make_app()


@app.callback()
def _options(
    version: bool = typer.Option(
        False, "--version", callback=_print_version, is_eager=True, help="Print the version and leave."
    ),
    debug: bool = typer.Option(False, "--debug", help="Show the whole traceback of an error."),
) -> None:
    """Faults, tracks and throws from seismic cubes."""


@contextmanager
def shown_progress() -> Iterator[Progress]:
    """Show stages with their share done and the time left on stderr, and give the callback that feeds them."""
    from rich.console import Console
    from rich.progress import BarColumn, TaskProgressColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as Bars

    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    console = Console(stderr=True)
    with Bars(*columns, console=console, disable=not console.is_terminal) as bars:
        tasks: dict[str, object] = {}

        def feed(stage: str, share: float) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(stage, total=1.0)
            bars.update(tasks[stage], completed=share)  # type: ignore[arg-type]

        yield feed
