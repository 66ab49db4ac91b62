from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from seismo3d.terrain.extending import extend_line
from seismo3d.terrain.tracing import TracedLine

SHAPE = (300, 200)
SETTINGS = {"window": 24.0, "reach": 6.0}


def piece(first, last, column=100.0):
    rows = np.arange(float(first), float(last))
    return TracedLine(np.column_stack([rows, np.full(len(rows), column)]), np.full(len(rows), 5.0), "step", 1)


def crest_down(column, rows):
    crest = np.zeros(SHAPE, np.float32)
    crest[rows, column] = 10.0
    return ndimage.gaussian_filter(crest, 2.0)


def mean_on(crest):
    """A judge: the crest's mean along the line, times ten."""
    return lambda line: 10.0 * float(ndimage.map_coordinates(crest, line.places.T, order=1).mean()) / crest.max()


def test_a_line_goes_on_as_far_as_its_crest():
    crest = crest_down(102, slice(60, 250))
    made = extend_line(piece(100, 180, 102.0), crest, crest, **SETTINGS, judge=mean_on(crest))
    rows = made.places[:, 0]
    assert rows.min() == pytest.approx(60.0, abs=40.0)
    assert rows.max() == pytest.approx(250.0, abs=40.0)
    assert np.abs(made.places[:, 1] - 102.0).max() < 3.0
    assert len(made.places) == len(made.score)


def test_it_stays_where_nothing_goes_on():
    crest = crest_down(100, slice(100, 180))
    start = piece(100, 180)
    assert extend_line(start, crest, crest, **SETTINGS, judge=mean_on(crest)).length <= start.length + 48.0


def test_it_ends_at_the_map():
    crest = crest_down(100, slice(0, 300))
    made = extend_line(piece(100, 180), crest, crest, **SETTINGS, judge=mean_on(crest))
    assert made.places.min() >= -1.0
    assert made.places[:, 0].max() <= 299.0 + 1.0
