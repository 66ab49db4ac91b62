from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import seismo3d as s3
from seismo3d.errors import FileAccessError, GeometryError, ParameterError, ShapeError
from seismo3d.seismic.fault_table import tabulate_faults
from seismo3d.seismic.tracks import Track
from seismo3d.viewer.session import Session


@pytest.fixture
def session(cube, faults, tmp_path):
    return Session(cube, faults, folder=tmp_path / "kept")


def test_panels_have_the_cubes_shape_and_labels(session):
    panels = [session.panel(axis) for axis in range(3)]
    assert [panel.shape for panel in panels] == [(50, 40), (50, 30), (30, 40)]
    assert [panel.label for panel in panels] == ["Inline 130", "Crossline 520", "Time (ms) 1100"]
    assert [panel.lines for panel in panels] == [(20.5, 25.5), (15.5, 25.5), (20.5, 15.5)]
    assert all(panel.faults and panel.is_full for panel in panels)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_places_on_panels_are_places_in_the_cube(session, axis):
    column, row = session.crossing(axis)
    np.testing.assert_allclose(session.place(axis, column, row), [15, 20, 25])
    assert (session.place(axis, -5.0, 1e6) >= 0).all()
    assert (session.place(axis, -5.0, 1e6) <= [29, 39, 49]).all()


def test_a_look_click_selects_a_fault_or_moves_the_slices(session):
    # at sample 25 the first fault lies at crossline 20.25
    assert session.click(2, 20.75, 5.0, pixels=(10.0, 10.0)) == "fault 1 selected"
    assert session.panel(2).selected
    assert session.click(2, 20.75, 5.0, pixels=(10.0, 10.0)) == "fault 1 no longer selected"
    assert session.click(2, 31.5, 7.5, pixels=(10.0, 10.0)) == "slices moved"
    assert session.index == [7, 31, 25]
    session.move(1, 10_000)
    assert session.index[1] == 39


def test_cuts_follow_slices_and_edits(session):
    before = session.cuts(2)[0].segments
    assert session.cuts(2)[0].segments is before
    session.move(2, 30)
    assert not np.allclose(session.cuts(2)[0].segments[:, :, 0].mean(), before[:, :, 0].mean())
    session.select([1])
    session.delete_selected()
    assert [cut.number for cut in session.cuts(2)] == [2]


def test_delete_undo_redo(session):
    session.select([1, 99])
    assert session.selected == {1}
    assert session.delete_selected() == "delete 1"
    assert (session.selected, [row["name"] for row in session.rows()]) == (frozenset(), ["fault 2"])
    assert session.undo() == "undone: delete 1"
    assert [row["number"] for row in session.rows()] == [1, 2]
    assert session.redo() == "done again: delete 1"
    assert (session.undo(), session.undo()) == ("undone: delete 1", "nothing to undo")


def test_means_of_the_list_are_those_of_the_table(cube, faults):
    surface = faults.surfaces[0]
    # most vertices lie where the throw is small, most of the area where it is large
    vertices = surface.vertices.copy()
    vertices[:, 2] = (
        vertices[:, 2].min() + np.ptp(vertices[:, 2]) * np.linspace(0, 1, 20)[np.arange(len(vertices)) % 20] ** 3
    )
    throw = 2.0 + vertices[:, 2] / 10.0
    crowded = replace(faults, surfaces=(replace(surface, vertices=vertices, throw=throw.astype(np.float32)),))
    row = tabulate_faults(crowded, cube)[0]
    listed = Session(cube, crowded).rows()[0]
    assert (listed["throw"], listed["unit"]) == (pytest.approx(row["throw_mean_ms"], abs=0.05), "ms")
    assert listed["dip"] == pytest.approx(row["dip_deg"], abs=0.05)
    assert abs(4.0 * throw.mean() - row["throw_mean_ms"]) > 1.0


def test_merge_selects_the_new_fault(session):
    session.select([1, 2])
    session.merge_selected()
    assert session.selected == {3}
    with pytest.raises(ParameterError, match="1 faults are to be merged"):
        session.merge_selected()


def test_two_clicks_split_the_selected_fault(session):
    session.choose("mode", "split")
    session.select([1])
    assert session.click(2, 5.5, 10.5) == "1 point picked"
    assert session.panel(2).picked == [(5.5, 10.5)]
    assert session.click(2, 35.5, 10.5) == "split fault 1"
    assert [row["number"] for row in session.rows()] == [3, 4, 2]
    middles = [fault.surface.vertices[:, 0].mean() for fault in session.state.faults[:2]]
    assert min(middles) < 10 < max(middles)


def test_a_split_that_cannot_be_says_why(session):
    session.choose("mode", "split")
    session.click(2, 5.5, 10.5)
    with pytest.raises(ParameterError, match="0 faults are selected"):
        session.click(2, 35.5, 10.5)
    session.select([1])
    session.click(2, 5.5, 10.5)
    with pytest.raises(GeometryError, match="on one spot"):
        session.click(2, 5.5, 10.5)
    session.click(2, 1.0, 10.5)
    with pytest.raises(GeometryError, match="does not cross fault 1"):
        session.click(2, 1.0, 20.5)
    assert session.picked == []


def test_a_stick_on_a_known_fault_selects_it(session):
    session.choose("mode", "stick")
    session.move(0, 12)
    for z in (12.0, 24.0, 36.0):
        session.click(0, 20.5 + 0.5 * (z - 24.5), z + 0.5)
    assert len(session.panel(0).picked) == 3
    assert session.trace_picked() == "the stick lies on fault 1, which is selected now"
    assert (session.selected, session.picked) == ({1}, [])


def test_picks_are_dropped_with_their_slice(session):
    session.choose("mode", "stick")
    session.click(0, 5.0, 5.0)
    session.move(1, 3)
    assert len(session.picked) == 1
    session.move(0, 3)
    assert session.picked == []
    session.click(0, 5.0, 5.0)
    session.click(1, 5.0, 5.0)
    assert len(session.picked) == 1
    with pytest.raises(ParameterError, match="1 points are picked"):
        session.trace_picked()


def test_a_seed_becomes_a_horizon(cube):
    session = Session(cube.copy(data=np.nan_to_num(cube.values)))
    session.choose("mode", "seed")
    session.click(0, 10.5, 27.5)
    heard = []
    words = session.trace_picked(progress=lambda stage, _share: heard.append(stage))
    assert words.startswith("horizon 1 traced on ")
    assert {"dip", "shifts", "solve", "tracks"} <= set(heard)
    assert session.rows()[0]["share"] > 30
    panel = session.panel(0)
    assert panel.horizons[0]["d"].startswith("M")
    assert session.undo() == "undone: trace horizon 1"
    assert session.panel(0).horizons == []


def test_what_another_session_saved_meanwhile_is_not_replaced(session, cube, faults, tmp_path):
    other = Session(cube, faults, folder=session.folder)
    other.select([1])
    other.delete_selected()
    other.save()
    session.select([2])
    session.delete_selected()
    with pytest.raises(FileAccessError, match="was saved by another session meanwhile"):
        session.save()
    assert not session.history.is_saved
    other.save()  # its own
    session.folder.rename(tmp_path / "others")
    assert session.save() == f"saved in {session.folder}"
    assert session.save() == f"saved in {session.folder}"
    kept = [len(s3.FaultSet.load(folder).surfaces) for folder in (session.folder, tmp_path / "others")]
    assert kept == [1, 1]
    # a session that opens what was saved goes on from it
    again = Session(cube, s3.FaultSet.load(session.folder), folder=session.folder)
    again.save()


def test_save_needs_a_folder_and_marks_the_state(session, cube, faults):
    session.select([2])
    session.delete_selected()
    assert not session.history.is_saved
    assert session.save() == f"saved in {session.folder}"
    assert session.history.is_saved
    assert len(s3.FaultSet.load(session.folder).surfaces) == 1
    session.undo()
    assert not session.history.is_saved
    with pytest.raises(ParameterError, match="the session has no folder"):
        Session(cube, faults).save()


def test_saving_says_where_the_files_number_faults_anew(session):
    # the second is the larger
    assert session.save() == f"saved in {session.folder}, where faults are numbered anew, largest first"
    rows = (session.folder / "faults.csv").read_text().splitlines()[1:]
    areas = [float(row.split(",")[3]) for row in rows]
    assert areas == pytest.approx([session.state.faults[k].surface.area for k in (1, 0)], rel=1e-6)
    session.select([2])
    session.delete_selected()
    assert session.save() == f"saved in {session.folder}"


def test_settings_are_refused_by_name(session):
    for name in ("mode", "attribute", "cmap", "reach"):
        with pytest.raises(ParameterError, match=f"{name} is 'purple'"):
            session.choose(name, "purple")
    with pytest.raises(ParameterError, match="taste is"):
        session.choose("taste", "sweet")
    session.choose("reach", "far")
    assert session.tracer.reach == "far"


def test_what_is_of_another_cube_is_refused(cube, faults):
    with pytest.raises(ShapeError, match="Give the cube"):
        Session(cube[:-1], faults)
    small = np.zeros((3, 3), np.float32)
    with pytest.raises(ShapeError, match="track has shape"):
        Session(cube, tracks=[Track(small, small, np.zeros((1, 3)))])


def test_bare_arrays_can_be_looked_at(cube):
    session = Session(cube.values)
    assert session.panel(1).label == "Crossline 20"
    assert session.fault_set().surfaces == ()


def test_the_scale_is_made_anew_after_an_edit_or_a_choice(session):
    first = session.scale
    assert session.scale is first
    session.choose("attribute", "dip")
    assert session.scale.attribute == "dip"
    session.choose("attribute", "throw")
    session.select([1])
    session.delete_selected()
    assert session.scale.high != first.high
