from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seismo3d.errors import FormatError
from seismo3d.robot import Camera, Mapper, MapperSettings, RgbdFrame
from seismo3d.synthetic.rgbd import rgbd_sequence


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Arrays of a small kept map."""
    sequence = rgbd_sequence("room", frames=4, size=(96, 72))
    settings = MapperSettings(voxel_size=0.08, keep_every=2, n_threads=1)
    mapper = Mapper(Camera(sequence.camera, readout=0.0, depth_delay=0.0), settings=settings)
    for frame in sequence:
        mapper.add(RgbdFrame.of(frame.colour, frame.depth, frame.stamp))
    path = mapper.save(tmp_path_factory.mktemp("kept") / "map.npz")
    with np.load(path) as held:
        return {name: held[name] for name in held.files}


def write(path: Path, arrays: dict[str, Any]) -> Path:
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    path.write_bytes(stream.getvalue())
    return path


def test_a_map_that_is_put_together_again_is_read(kept: dict[str, Any], tmp_path: Path) -> None:
    mapper = Mapper.load(write(tmp_path / "map.npz", kept))
    assert len(mapper.trajectory) == 4
    assert len(mapper.state.kept) >= 2
    assert len(mapper.state.views) == len(mapper.state.memory.keyframes) >= 1


@pytest.mark.parametrize("change", ["without", "cut", "doubled", "flat"])
def test_arrays_that_do_not_fit_are_refused(kept: dict[str, Any], tmp_path: Path, change: str) -> None:
    """Whichever array of the file it is: it may be intact as a file, and yet belong to another map."""
    changes = {
        "without": None,
        "cut": lambda a: a[:-1],
        "doubled": lambda a: np.concatenate([a, a]),
        "flat": lambda a: a.ravel()[:, None, None],
    }
    alter = changes[change]
    for name, array in kept.items():
        arrays = dict(kept)
        if alter is None:
            del arrays[name]
        elif array.size:
            arrays[name] = alter(array)
        else:
            continue
        if name == "header" and change == "flat":
            continue  # the same bytes
        with pytest.raises(FormatError, match=r"map that Mapper\.save wrote"):
            Mapper.load(write(tmp_path / "map.npz", arrays))


def test_numbers_out_of_range_are_refused(kept: dict[str, Any], tmp_path: Path) -> None:
    changed = {
        "map0_poses": np.full_like(kept["map0_poses"], np.nan),
        "map0_view_cameras": kept["map0_view_cameras"] + 7,
        "map0_kept_numbers": kept["map0_kept_numbers"] + 100,
        "map0_key_grey": np.zeros_like(kept["map0_key_grey"]),
        "map0_keys": np.zeros_like(kept["map0_keys"]),
    }
    for name, array in changed.items():
        with pytest.raises(FormatError, match=r"map that Mapper\.save wrote"):
            Mapper.load(write(tmp_path / "map.npz", kept | {name: array}))


def test_another_version_is_refused(kept: dict[str, Any], tmp_path: Path) -> None:
    header = kept["header"].tobytes().replace(b'"version": 6', b'"version": 1')
    with pytest.raises(FormatError, match="is of version 1; expected 6"):
        Mapper.load(write(tmp_path / "map.npz", kept | {"header": np.frombuffer(header, dtype=np.uint8)}))
