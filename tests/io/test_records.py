from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from seismo3d.io.records import to_json, write_json


def test_what_json_cannot_hold_is_written_as_what_it_can(tmp_path):
    record = {
        "known": np.array([1.5, np.nan, np.inf]),
        "count": np.int64(3),
        "file": Path("a/b.sgy"),
        7: ("inline", None, True),
        "name": "Größe",
    }
    plain = {"known": [1.5, None, None], "count": 3, "file": str(Path("a/b.sgy")), "7": ["inline", None, True]}
    assert json.loads(to_json(record), parse_constant=pytest.fail) == {**plain, "name": "Größe"}
    write_json(tmp_path / "run.json", record)
    assert (tmp_path / "run.json").read_text(encoding="utf-8") == to_json(record) + "\n"
    assert "Größe" in to_json(record)
