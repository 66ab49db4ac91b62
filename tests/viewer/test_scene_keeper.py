from __future__ import annotations

import numpy as np
import pytest

from seismo3d.viewer.scene_keeper import SceneKeeper
from seismo3d.viewer.session import Session


@pytest.fixture
def session(cube, faults):
    return Session(cube, faults)


def actors(keeper):
    return {key: actor for key, actor in keeper._scene._actors.items() if key[0] != "box"}


def test_the_scene_holds_slices_and_faults(session):
    keeper = SceneKeeper(session)
    assert keeper.update()
    assert sorted(actors(keeper)) == [("fault", 1), ("fault", 2), ("slice", 0), ("slice", 1), ("slice", 2)]
    assert not keeper.update()
    assert keeper.window.GetRenderers().GetFirstRenderer().GetActors().GetNumberOfItems() == 6


def test_only_what_changed_is_exchanged(session):
    keeper = SceneKeeper(session)
    keeper.update()
    before = actors(keeper)
    session.move(1, 3)
    session.select([2])
    assert keeper.update()
    changed = {key for key, actor in actors(keeper).items() if actor is not before[key]}
    assert changed == {("slice", 1), ("fault", 2)}
    session.delete_selected()
    assert keeper.update()
    assert ("fault", 2) not in actors(keeper)
    session.undo()
    assert keeper.update()
    assert ("fault", 2) in actors(keeper)


def test_slices_lie_where_they_are_and_show_their_samples(session):
    keeper = SceneKeeper(session)
    session.move(0, 7)
    keeper.update()
    low, high = np.array(actors(keeper)["slice", 0].GetBounds()).reshape(3, 2).T
    frame = keeper._scene._frame
    np.testing.assert_allclose(low, frame.place(np.array([[7.0, 0.0, 49.0]]))[0], atol=1e-6)
    np.testing.assert_allclose(high, frame.place(np.array([[7.0, 39.0, 0.0]]))[0], atol=1e-6)
    colours = keeper._slice_colours(2)
    assert colours.shape == (30, 40, 3)
    assert tuple(colours[3, 3]) == (233, 237, 242)


def test_selected_faults_are_yellow(session):
    keeper = SceneKeeper(session)
    session.select([1])
    assert {tuple(c) for c in keeper._paint(session.state.faults[0])} == {(255, 242, 0)}
    assert len({tuple(c) for c in keeper._paint(session.state.faults[1])}) > 3
    session.select([])
    session.choose("attribute", "fault")
    assert {tuple(c) for c in keeper._paint(session.state.faults[1])} == {(0, 114, 178)}


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_pictures_lie_the_right_way_round(session, axis):
    keeper = SceneKeeper(session)
    scene, frame = keeper._scene, keeper._scene._frame
    picture = np.zeros((4, 5, 3), np.uint8)
    picture[0, 0], picture[0, -1], picture[-1, 0], picture[-1, -1] = (255, 0, 0), (0, 255, 0), (0, 0, 255), (9, 9, 9)
    scene.set_slice(axis, 6, picture)
    actor = scene._actors["slice", axis]
    image, quad = actor.GetTexture().GetInput(), actor.mapper.dataset
    columns, rows, _ = image.GetDimensions()
    colours = np.array(image.GetPointData().GetScalars()).reshape(rows, columns, 3)
    across, down = (1, 0) if axis == 2 else (1 - axis, 2)
    for row, column in ((0, 0), (0, -1), (-1, 0), (-1, -1)):
        index = np.zeros((1, 3))
        index[0, axis] = 6
        index[0, across] = 0 if column == 0 else session.reader.shape[across] - 1
        index[0, down] = 0 if row == 0 else session.reader.shape[down] - 1
        point = np.linalg.norm(quad.points - frame.place(index), axis=1).argmin()
        u, v = quad.active_texture_coordinates[point]
        assert tuple(colours[int(v * (rows - 1)), int(u * (columns - 1))]) == tuple(picture[row, column])
