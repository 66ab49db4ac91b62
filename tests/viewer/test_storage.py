from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import seismo3d as s3
from seismo3d.errors import FileAccessError, FormatError, ParameterError, ShapeError
from seismo3d.io.archive import write_archive
from seismo3d.seismic.tracks import Track
from seismo3d.viewer import storage
from seismo3d.viewer.interpretation import (
    Horizon,
    Interpretation,
    add_fault,
    add_horizon,
    begin,
    delete,
    merge_faults,
    split_fault,
)
from seismo3d.viewer.relabelling import as_faults
from seismo3d.viewer.session import Session
from seismo3d.viewer.storage import choose_folder, open_session, read_tracks, save_session


def test_unedited_faults_keep_their_volumes(cube, faults):
    again = as_faults(cube, begin(faults), opened=faults)
    # the second surface is the larger one, and comes first now
    swapped = np.array([0, 2, 1])[np.asarray(faults.labels)]
    np.testing.assert_array_equal(again.labels, swapped)
    np.testing.assert_array_equal(again.throw, faults.throw)
    np.testing.assert_array_equal(again.likelihood, faults.likelihood)
    assert again.settings == faults.settings
    assert [s.area for s in again.surfaces] == sorted((s.area for s in faults.surfaces), reverse=True)


def test_a_deleted_fault_leaves_no_voxel(cube, faults):
    after = as_faults(cube, delete(begin(faults), [1]), opened=faults)
    labels = np.asarray(after.labels)
    np.testing.assert_array_equal(labels == 1, np.asarray(faults.labels) == 2)
    assert labels.max() == 1
    assert np.isnan(np.asarray(after.throw)[labels == 0]).all()


def test_merged_faults_share_a_label(cube, faults):
    after = as_faults(cube, merge_faults(begin(faults), [1, 2]), opened=faults)
    np.testing.assert_array_equal(np.asarray(after.labels) > 0, np.asarray(faults.labels) > 0)
    assert len(after.surfaces) == np.asarray(after.labels).max() == 1


def test_voxels_of_a_split_fault_go_to_the_nearer_part(cube, faults):
    state = split_fault(begin(faults), 1, point=(15.0, 0.0, 0.0), normal=(1.0, 0.0, 0.0))
    after = as_faults(cube, state, opened=faults)
    old, new = np.asarray(faults.labels), np.asarray(after.labels)
    by_part = {fault.number: 1 + after.surfaces.index(fault.surface) for fault in state.faults}
    at = np.argwhere(old == 1)
    # two voxels, the distance of the vertices, off the plane there is no doubt
    assert (new[tuple(at[at[:, 0] >= 17].T)] == by_part[3]).all()
    assert (new[tuple(at[at[:, 0] <= 13].T)] == by_part[4]).all()
    np.testing.assert_array_equal(new == by_part[2], old == 2)


def test_a_new_fault_is_drawn_without_gaps(cube, faults):
    state = add_fault(Interpretation(), faults.surfaces[0])
    after = as_faults(cube, state, opened=None)
    labels = np.asarray(after.labels)
    _, j, k = np.nonzero(labels)
    plane = 20.0 + 0.5 * (k - 24.5)
    assert np.abs(j - plane).max() <= 0.76
    # one voxel or two in every row of the plane's inner part
    counts = labels[4:25, :, 8:40].sum(axis=1)
    assert counts.min() >= 1
    assert counts.max() <= 2
    np.testing.assert_array_equal(np.asarray(after.likelihood)[labels == 0], 0.0)
    assert labels.shape == cube.shape


def test_a_new_fault_does_not_take_voxels_of_a_likelier_one(cube, faults):
    state = add_fault(delete(begin(faults), [2]), faults.surfaces[1])
    after = as_faults(cube, state, opened=faults)
    kept = 1 + [s.area for s in after.surfaces].index(faults.surfaces[0].area)
    assert (np.asarray(after.labels)[np.asarray(faults.labels) == 1] == kept).all()


def test_saved_sessions_come_back(tmp_path, cube, faults):
    path = s3.write_segy(tmp_path / "cube.sgy", cube)
    opened = s3.open_cube(path)
    depth = np.full((30, 40), np.nan, np.float32)
    depth[3:9] = 1012.5
    track = Track(
        depth, np.where(np.isfinite(depth), 0.8, np.nan).astype(np.float32), np.array([[108.0, 505.0, 1012.5]]), "ms"
    )
    volumes = [opened.copy(data=np.asarray(getattr(faults, name))) for name in ("likelihood", "labels", "throw")]
    here = s3.FaultSet(faults.surfaces, *volumes, settings=faults.settings)
    state = add_horizon(delete(begin(here), [2]), track)
    folder = save_session(tmp_path / "kept", opened, state, opened=here)
    back = open_session(folder)
    assert back.cube.shape == cube.shape
    assert [s.area for s in back.faults.surfaces] == [faults.surfaces[0].area]
    np.testing.assert_array_equal(back.faults.surfaces[0].throw, faults.surfaces[0].throw)
    np.testing.assert_array_equal(back.tracks[0].depth, depth)
    np.testing.assert_array_equal(back.tracks[0].seeds, track.seeds)
    assert back.tracks[0].sample_unit == "ms"
    assert {"surfaces.vtp", "faults.csv", "track_01.xyz", "tracks.npz"} <= {p.name for p in folder.iterdir()}
    assert s3.FaultSet.load(folder).labels.attrs["path"] == str(path)


def test_exports_of_deleted_horizons_go(tmp_path, cube, faults):
    flat = np.full(cube.shape[:2], 1100.0, np.float32)
    track = Track(flat, np.ones_like(flat), np.array([[100.0, 500.0, 1100.0]]), "ms")
    state = begin(faults)
    two = replace(state, horizons=(Horizon(11, track), Horizon(12, track)))
    save_session(tmp_path, cube, state, opened=faults)
    # whatever the names, they are not the session's own
    kept = {"track_notes.txt", "my_track_01.xyz", "track_07.xyz"}
    for name in kept:
        (tmp_path / name).write_text("mine")
    for horizons, left in ((two.horizons, 7), (two.horizons[:1], 4), ((), 0)):
        save_session(tmp_path, cube, replace(state, horizons=horizons), opened=faults)
        found = {file.name for file in tmp_path.iterdir() if "track" in file.name} - {"tracks.npz"}
        assert kept <= found
        assert len(found - kept) == left


def test_results_of_another_run_stay(tmp_path, cube, faults):
    (tmp_path / "track_01.xyz").write_text("of a run")
    with pytest.raises(FileAccessError, match="holds what the viewer did not save; expected a new folder"):
        Session(cube, faults, folder=tmp_path)
    with pytest.raises(FileAccessError, match="holds what the viewer did not save"):
        save_session(tmp_path, cube, begin(faults), opened=faults)
    assert [file.name for file in tmp_path.iterdir()] == ["track_01.xyz"]


def test_a_save_that_failed_can_be_tried_again(tmp_path, cube, faults, monkeypatch):
    session = Session(cube, faults, folder=tmp_path / "kept")

    def fail(*_, **__):
        raise FileAccessError("no space")

    with monkeypatch.context() as patched:
        patched.setattr(storage, "write_faults", fail)
        with pytest.raises(FileAccessError, match="no space"):
            session.save()
    session.save()
    assert len(s3.FaultSet.load(session.folder).surfaces) == 2


def test_a_cube_alone_opens_without_faults(tmp_path, cube):
    np.save(tmp_path / "a.npy", cube.values)
    opened = open_session(tmp_path / "a.npy")
    assert (opened.faults, opened.tracks, opened.cube.shape) == (None, [], cube.shape)


def test_folders_of_other_runs_are_refused_with_what_is_shown(tmp_path):
    (tmp_path / "trajectory.txt").write_text("# a map\n")
    with pytest.raises(FileAccessError, match=r"holds no faultset\.npz; expected a cube .* folder of a faults run"):
        open_session(tmp_path)


def test_faults_whose_cube_is_gone_are_refused(tmp_path, faults):
    faults.save(tmp_path)
    with pytest.raises(FileAccessError, match=r"the cube of .* is not found\. Name it by --cube"):
        open_session(tmp_path)


def test_faults_of_another_cube_are_refused(tmp_path, cube, faults):
    faults.save(tmp_path)
    np.save(tmp_path / "other.npy", cube.values[:-1])
    with pytest.raises(ShapeError, match="Give the cube that they were traced in"):
        open_session(tmp_path, cube=tmp_path / "other.npy")


def test_damaged_tracks_are_refused(tmp_path):
    write_archive(tmp_path / "tracks.npz", {}, meta={"format": "seismo3d tracks", "version": 1, "units": ["ms"]})
    with pytest.raises(FormatError, match=r"tracks\.npz is no file of tracks, or is damaged or cut short: '0\.depth'"):
        read_tracks(tmp_path)
    write_archive(tmp_path / "tracks.npz", {}, meta={"format": "seismo3d tracks", "version": 1, "units": 3})
    with pytest.raises(FormatError, match="is no file of tracks, or is damaged"):
        read_tracks(tmp_path)
    write_archive(tmp_path / "tracks.npz", {}, meta={"format": "poems"})
    with pytest.raises(FormatError, match="'poems'"):
        read_tracks(tmp_path)


def test_a_cube_too_large_for_new_volumes_is_refused():
    huge = np.broadcast_to(np.float32(0), (4000, 4000, 2000))
    with pytest.raises(ParameterError, match="expected at most 2147483648 samples"):
        as_faults(huge, Interpretation(), opened=None)


def test_the_folder_to_save_to(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "run").mkdir()
    assert choose_folder("run", None).name == "run-edited"
    assert choose_folder("a.sgy", "x").name == "x"
    (tmp_path / "run-edited").mkdir()
    (tmp_path / "run-edited" / "tracks.npz").write_bytes(b"")
    assert choose_folder("run-edited", None).name == "run-edited"
    with pytest.raises(FileAccessError, match="holds an earlier session"):
        choose_folder("run", None)
    assert choose_folder("run", None, overwrite=True).name == "run-edited"
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "letter.txt").write_text("dear")
    with pytest.raises(FileAccessError, match="holds what the viewer did not save"):
        choose_folder("run", "mine", overwrite=True)
    (tmp_path / "run" / "faultset.npz").write_bytes(b"")
    with pytest.raises(FileAccessError, match="holds what the viewer did not save"):
        choose_folder("run", "run")
    with pytest.raises(FileAccessError, match="is a file"):
        choose_folder("run", "mine/letter.txt")


def test_folders_that_could_not_be_saved_to_are_refused_before_there_are_edits(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cube.sgy").write_bytes(b"")
    for name in ("cube.sgy", "cube.sgy/edited", "cube.sgy/new/edited"):
        with pytest.raises(FileAccessError, match=r"cube\.sgy is a file; expected a folder to save to"):
            choose_folder("run", name)
    assert choose_folder("run", "new/edited") == Path("new/edited")
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(FileAccessError, match=r"new/edited cannot be written: permission denied\. Choose another"):
        choose_folder("run", "new/edited")
    # who only looks has asked for none
    assert choose_folder("run", None) == Path("run-edited")


def test_the_cube_is_also_looked_for_beside_the_folder(tmp_path, cube, faults, monkeypatch):
    made, elsewhere = tmp_path / "made", tmp_path / "elsewhere"
    made.mkdir()
    elsewhere.mkdir()
    s3.write_segy(made / "cube.sgy", cube)
    labels = faults.labels.assign_attrs(path="cube.sgy")
    s3.FaultSet(faults.surfaces, faults.likelihood, labels, faults.throw).save(made / "run")
    monkeypatch.chdir(elsewhere)
    assert open_session("../made/run").cube.shape == cube.shape
