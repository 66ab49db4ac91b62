"""Arguments and options that several commands share, such as those that say how a cube is to be read."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import typer

Reading: TypeAlias = dict[str, Any]
"""How a cube is to be read: keyword arguments of ``open_cube``."""

Cube: TypeAlias = Annotated[Path, typer.Argument(help="SEG-Y file, Zarr folder, .npy or .npz.", show_default=False)]
InlineByte: TypeAlias = Annotated[
    int | None, typer.Option(help="SEG-Y trace header byte of the inline number. [default: 189, else found]")
]
CrosslineByte: TypeAlias = Annotated[
    int | None, typer.Option(help="SEG-Y trace header byte of the crossline number. [default: 193, else found]")
]
XByte: TypeAlias = Annotated[
    int | None, typer.Option(help="SEG-Y trace header byte of CDP X. [default: 181, else found]")
]
YByte: TypeAlias = Annotated[
    int | None, typer.Option(help="SEG-Y trace header byte of CDP Y. [default: 185, else found]")
]
Domain: TypeAlias = Annotated[
    str | None, typer.Option(help="time or depth, where the file does not tell. [default: judged from the file]")
]
Interval: TypeAlias = Annotated[
    float | None, typer.Option(help="Sample interval in ms, m or ft. [default: the file's]", metavar="STEP")
]
Start: TypeAlias = Annotated[
    float | None,
    typer.Option(help="First sample in ms, m or ft, of all traces. [default: the file's]", metavar="FIRST"),
]
Variable: TypeAlias = Annotated[
    str | None, typer.Option(help="The array to take from a Zarr folder or an NPZ file with several.", metavar="NAME")
]
Json: TypeAlias = Annotated[bool, typer.Option("--json", help="Print the results as JSON.")]
Overwrite: TypeAlias = Annotated[
    bool, typer.Option("--overwrite", help="Replace an earlier run in the folder, with runs made of it there.")
]
Memory: TypeAlias = Annotated[
    str | None,
    typer.Option(
        help="Memory to keep to, such as 8GB; a larger cube is worked on in blocks, a larger line refused. "
        "[default: one piece]"
    ),
]
Scheduler: TypeAlias = Annotated[
    str | None, typer.Option(help="Address of a dask cluster to work on the blocks, such as tcp://node1:8786.")
]
Columns: TypeAlias = Annotated[
    str | None, typer.Option(help="Which columns of an XYZ file are x, y and z, such as 1,2,5.")
]

_READING: dict[str, Any] = {
    "inline_byte": InlineByte,
    "crossline_byte": CrosslineByte,
    "x_byte": XByte,
    "y_byte": YByte,
    "domain": Domain,
    "interval": Interval,
    "start": Start,
    "variable": Variable,
}


def reads_cube(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command the options that say how a cube is read.

    Parameters
    ----------
    command : callable
        A command with a keyword parameter ``reading``, which gets them as keyword arguments of ``open_cube``.

    Returns
    -------
    callable
        The command with an option each in place of ``reading``.
    """
    signature = inspect.signature(command, eval_str=True)
    options = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=kind)
        for name, kind in _READING.items()
    ]
    own = [p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for n, p in signature.parameters.items() if n != "reading"]

    def run(**given: Any) -> None:
        reading = {name: given.pop(name) for name in _READING}
        command(**given, reading=reading)

    run.__signature__ = signature.replace(parameters=[*own, *options])  # type: ignore[attr-defined]
    run.__annotations__ = {p.name: p.annotation for p in (*own, *options)}
    run.__doc__, run.__module__, run.__name__ = command.__doc__, command.__module__, command.__name__
    return run


def as_columns(text: str | None) -> tuple[int, ...] | None:
    """Return the columns that an option names; None where it is not given."""
    from seismo3d.errors import ParameterError

    if text is None:
        return None
    try:
        return tuple(int(word) for word in text.split(","))
    except ValueError as error:
        raise ParameterError(f"--columns is {text!r}; expected three whole numbers, such as 1,2,5.") from error


def refuse_unused(kind: str, given: dict[str, Any]) -> None:
    """Refuse options that do not serve the kind of input, or another option."""
    from seismo3d.errors import ParameterError

    for name, value in given.items():
        if value is not None:
            raise ParameterError(f"{name} is {str(value)!r}; expected none with {kind}, which it does not serve.")
