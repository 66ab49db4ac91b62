"""Pages of HTML that hold everything they show, filled from templates."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any


def fill_template(name: str, **values: Any) -> str:
    """Fill one of the templates of this package; a name that it lacks is an error, and text is escaped."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("seismo3d.plot"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(name).render(**values)


def embed_picture(path: Path, caption: str, *, note: str = "", kind: str = "wide") -> dict[str, str]:
    """Return what a template needs of a picture: its bytes in base 64, caption, note and width."""
    return {"data": base64.b64encode(path.read_bytes()).decode(), "caption": caption, "note": note, "kind": kind}


def in_digits(value: float) -> str:
    """Return a number to three digits and never as a power of ten: all before the point are written.

    Examples
    --------
    >>> in_digits(1234.5), in_digits(-60.37), in_digits(0.01234)
    ('1,234', '-60.4', '0.0123')
    """
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:.3g}"


def in_words(value: Any) -> str:
    """Return a value as text: JSON where it is none."""
    return value if isinstance(value, str) else json.dumps(value, default=str, ensure_ascii=False)
