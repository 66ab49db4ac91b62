"""Records as JSON: what a run was given and what it found."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np


def to_json(record: Mapping[str, Any]) -> str:
    """Return a record as JSON text; NaN and infinities, which JSON does not have, as null."""
    return json.dumps(_plain(record), indent=2, ensure_ascii=False, allow_nan=False)


def write_json(path: str | Path, record: Mapping[str, Any]) -> None:
    """Write a record as JSON, in UTF-8; NaN and infinities as null."""
    Path(path).write_text(to_json(record) + "\n", encoding="utf-8")


def _plain(value: Any) -> Any:
    """Turn numpy values, tuples, paths and objects into what JSON can hold."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set):
        return [_plain(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    return value if isinstance(value, str | int | bool) or value is None else str(value)
