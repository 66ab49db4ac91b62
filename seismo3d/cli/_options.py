"""Arguments and options that several commands share: what says how a cube is to be read."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, TypeAlias

import typer

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
