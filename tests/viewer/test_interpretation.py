from __future__ import annotations

import numpy as np
import pytest

from seismo3d.errors import GeometryError, ParameterError
from seismo3d.seismic.tracks import Track
from seismo3d.viewer.history import History
from seismo3d.viewer.interpretation import add_fault, begin, delete, merge_faults, split_fault, take_cells


@pytest.fixture
def state(faults):
    depth = np.full((30, 40), 1010.0, np.float32)
    track = Track(depth, np.ones_like(depth), np.array([[100.0, 500.0, 1010.0]]), "ms")
    return begin(faults, [track])


def numbers(state):
    return [fault.number for fault in state.faults], [horizon.number for horizon in state.horizons]


def test_results_keep_their_labels_as_numbers(state):
    assert numbers(state) == ([1, 2], [3])
    assert [fault.sources for fault in state.faults] == [{1}, {2}]


def test_delete_takes_faults_and_horizons_and_leaves_the_old_state(state):
    after = delete(state, [1, 3])
    assert numbers(after) == ([2], [])
    assert numbers(state) == ([1, 2], [3])


@pytest.mark.parametrize("gone", [[], [9], [1, 9]])
def test_delete_refuses_what_is_not_here(state, gone):
    with pytest.raises(ParameterError, match="is to be deleted"):
        delete(state, gone)


def test_numbers_are_never_used_again(state):
    after = add_fault(delete(state, [1]), state.faults[0].surface)
    assert numbers(after)[0] == [2, 4]
    assert after.faults[1].is_new


def test_merge_keeps_every_vertex_triangle_and_the_area(state):
    first, second = (fault.surface for fault in state.faults)
    merged = merge_faults(state, [2, 1]).faults[0]
    assert (merged.number, merged.sources, merged.is_new) == (4, {1, 2}, False)
    assert len(merged.surface.vertices) == len(first.vertices) + len(second.vertices)
    corners = merged.surface.vertices[merged.surface.cells]
    np.testing.assert_array_equal(corners[: len(first.cells)], first.vertices[first.cells])
    np.testing.assert_array_equal(corners[len(first.cells) :], second.vertices[second.cells])
    assert merged.surface.area == pytest.approx(first.area + second.area)
    assert min(first.confidence, second.confidence) < merged.surface.confidence < 0.8


def test_merge_refuses_one_fault(state):
    with pytest.raises(ParameterError, match="1 faults are to be merged"):
        merge_faults(state, [1, 1])


def test_split_divides_the_triangles_by_the_plane(state):
    surface = state.faults[0].surface
    after = split_fault(state, 1, point=(15.0, 0.0, 0.0), normal=(1.0, 0.0, 0.0))
    parts = [fault for fault in after.faults if fault.sources == {1}]
    assert [fault.number for fault in after.faults] == [4, 5, 2]
    above, below = (part.surface.vertices[part.surface.cells].mean(axis=1)[:, 0] for part in parts)
    assert above.min() >= 15.0 > below.max()
    assert len(above) + len(below) == len(surface.cells)
    assert sum(part.surface.area for part in parts) == pytest.approx(surface.area, rel=1e-6)
    together = np.concatenate([part.surface.vertices[part.surface.cells] for part in parts])
    whole = surface.vertices[surface.cells]
    order, wanted = (np.lexsort(c.reshape(len(c), -1).T) for c in (together, whole))
    np.testing.assert_array_equal(together[order], whole[wanted])


def test_split_then_merge_gives_the_surface_back(state):
    after = split_fault(state, 1, point=(15.0, 0.0, 0.0), normal=(1.0, 0.0, 0.3))
    joined = merge_faults(after, [4, 5]).faults[0]
    assert joined.sources == {1}
    assert joined.surface.area == pytest.approx(state.faults[0].surface.area, rel=1e-6)


def test_split_refuses_a_plane_that_misses(state):
    with pytest.raises(GeometryError, match="does not cross fault 1"):
        split_fault(state, 1, point=(500.0, 0.0, 0.0), normal=(1.0, 0.0, 0.0))


def test_taken_cells_bring_the_attributes_of_their_vertices(state):
    surface = state.faults[0].surface
    chosen = np.zeros(len(surface.cells), bool)
    chosen[[3, 40]] = True
    part = take_cells(surface, chosen)
    for name in ("vertices", "throw", "likelihood", "dip_deg"):
        np.testing.assert_array_equal(getattr(part, name)[part.cells], getattr(surface, name)[surface.cells[chosen]])
    assert not part.vertices.flags.writeable


def test_undo_and_redo_walk_the_states(state):
    history = History(state)
    assert (history.undo(), history.redo(), history.is_saved) == ("", "", True)
    one = delete(state, [1])
    two = delete(one, [2])
    history.do(one, "delete 1")
    history.do(two, "delete 2")
    assert not history.is_saved
    assert (history.undo_words, history.redo_words) == ("delete 2", "")
    assert history.undo() == "delete 2"
    assert history.state is one
    assert history.undo() == "delete 1"
    assert history.state is state
    assert history.is_saved
    assert history.redo() == "delete 1"
    history.mark_saved()
    other = delete(one, [3])
    history.do(other, "delete 3")
    assert history.redo() == ""
    assert (history.undo(), history.state, history.is_saved) == ("delete 3", one, True)
