from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from seismo3d.errors import FileAccessError, FormatError, Seismo3dWarning
from seismo3d.robot.camera import LensErrors
from seismo3d.robot.sequence import associate, read_sequence

CAMERA = {"fx": 60.0, "fy": 61.0, "cx": 31.5, "cy": 23.5, "distortion": [0.1], "width": 64, "height": 48}


def write_pair(colour: Path, depth: Path, value: int) -> None:
    for path in (colour, depth):
        path.parent.mkdir(parents=True, exist_ok=True)
    image = np.full((48, 64, 3), (10, 20, value), dtype=np.uint8)  # OpenCV writes blue first
    cv2.imwrite(str(colour), image)
    cv2.imwrite(str(depth), np.full((48, 64), 1000 + value, dtype=np.uint16))


def write_camera(folder: Path, **more: object) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "camera.json").write_text(json.dumps({**CAMERA, **more}))


def test_tum_pairs_by_time_and_reads_red_first(tmp_path: Path) -> None:
    write_camera(tmp_path)
    rgb, depth = [0.00, 0.033, 0.066, 0.2], [0.008, 0.041, 0.10]
    for number, stamp in enumerate(rgb):
        write_pair(tmp_path / f"rgb/{stamp:.3f}.png", tmp_path / "spare.png", 100 + number)
    for number, stamp in enumerate(depth):
        write_pair(tmp_path / "spare.png", tmp_path / f"depth/{stamp:.3f}.png", number)
    (tmp_path / "rgb.txt").write_text("# time file\n" + "".join(f"{t:.3f} rgb/{t:.3f}.png\n" for t in rgb))
    (tmp_path / "depth.txt").write_text("".join(f"{t:.3f} depth/{t:.3f}.png\n" for t in depth))
    sequence = read_sequence(tmp_path)
    assert [(frame.time, frame.depth_time) for frame in sequence] == [(0.0, 0.008), (0.033, 0.041)]
    assert sequence[1].rgb[0, 0].tolist() == [101, 20, 10]
    assert sequence[1].depth[0, 0] == 1001
    assert sequence.camera.lens.fy == 61.0
    assert sequence.camera.lens.depth_scale == 5000.0
    assert len(read_sequence(tmp_path, max_difference=0.05)) == 3


def test_associations_win_over_lists(tmp_path: Path) -> None:
    write_camera(tmp_path, depth_scale=1000, readout=0.01)
    write_pair(tmp_path / "a.png", tmp_path / "b.png", 7)
    (tmp_path / "associations.txt").write_text("5.25 a.png 5.26 b.png\n")
    (tmp_path / "rgb.txt").write_text("no list at all\n")
    (tmp_path / "depth.txt").write_text("")
    sequence = read_sequence(tmp_path)
    assert (sequence[0].time, sequence[0].depth_time) == (5.25, 5.26)
    assert sequence.camera.lens.depth_scale == 1000
    assert sequence.camera.readout == 0.01


def test_a_camera_may_say_how_far_its_numbers_may_be_off(tmp_path: Path) -> None:
    write_pair(tmp_path / "a.png", tmp_path / "b.png", 7)
    (tmp_path / "associations.txt").write_text("5.25 a.png 5.26 b.png\n")
    write_camera(tmp_path, errors={"scale": 0.002, "focal": 0})
    assert read_sequence(tmp_path).camera.errors == LensErrors(0.002, 0.0, LensErrors().centre)
    for errors in (0.01, {"focus": 0.1}, {"scale": -1.0}, [0.1]):
        write_camera(tmp_path, errors=errors)
        with pytest.raises(FormatError, match=r"camera\.json does not describe a camera"):
            read_sequence(tmp_path)


def write_associations(folder: Path, times: list[tuple[object, object]]) -> None:
    write_camera(folder)
    lines = ""
    for number, (colour, depth) in enumerate(times):
        write_pair(folder / f"rgb/{number}.png", folder / f"depth/{number}.png", number)
        lines += f"{colour} rgb/{number}.png {depth} depth/{number}.png\n"
    (folder / "associations.txt").write_text(lines)


def test_listed_pairs_far_apart_are_left_out(tmp_path: Path) -> None:
    write_associations(tmp_path, [(0.0, 0.01), (0.1, 0.4), (0.2, 0.2)])
    with pytest.warns(Seismo3dWarning, match=r"1 pairs of 3 more than 0\.02 s apart"):
        assert read_sequence(tmp_path).times.tolist() == [0.0, 0.2]
    assert len(read_sequence(tmp_path, max_difference=0.31)) == 3
    write_associations(tmp_path, [(0.0, 0.5), (0.1, 0.6)])
    with pytest.raises(FormatError, match=r"2 colour and 2 depth images, none within 0\.02 s"):
        read_sequence(tmp_path)


@pytest.mark.parametrize("unit", [0.0, 1e3, 1e9])
@pytest.mark.parametrize("in_lists", [False, True])
def test_stamps_in_other_units_are_refused(tmp_path: Path, unit: float, in_lists: bool) -> None:
    times = [unit * k / 30 for k in range(4)]
    write_associations(tmp_path, [(time, time) for time in times])
    if in_lists:
        (tmp_path / "associations.txt").unlink()
        for name in ("rgb", "depth"):
            (tmp_path / f"{name}.txt").write_text("".join(f"{t} {name}/{k}.png\n" for k, t in enumerate(times)))
    with pytest.raises(FormatError, match=r"apart in the median; expected seconds, 0\.001 to 5 apart"):
        read_sequence(tmp_path)


def test_rows_listed_twice_are_taken_once(tmp_path: Path) -> None:
    write_associations(tmp_path, [(0.0, 0.0), (0.1, 0.1)])
    listed = (tmp_path / "associations.txt").read_text()
    (tmp_path / "associations.txt").write_text(listed + listed)
    with pytest.warns(Seismo3dWarning, match="has 2 rows of 4 twice"):
        assert read_sequence(tmp_path).times.tolist() == [0.0, 0.1]


def test_seven_scenes_needs_no_intrinsics(tmp_path: Path) -> None:
    for number in (3, 1, 2):
        write_pair(tmp_path / f"frame-{number:06d}.color.png", tmp_path / f"frame-{number:06d}.depth.png", number)
    depth = np.full((48, 64), 65535, dtype=np.uint16)
    cv2.imwrite(str(tmp_path / "frame-000002.depth.png"), depth)
    sequence = read_sequence(tmp_path)
    assert sequence.times == pytest.approx(np.array([1, 2, 3]) / 30)
    assert sequence.camera.lens.fx == 585.0
    assert not sequence[1].depth.any()  # 65535 marks what was not measured


def test_open3d_layout_and_column_major_matrix(tmp_path: Path) -> None:
    for number in range(11):
        write_pair(tmp_path / f"color/{number}.jpg", tmp_path / f"depth/{number}.png", number)
    matrix = [525.0, 0, 0, 0, 524.0, 0, 319.5, 239.5, 1]
    (tmp_path / "camera_primesense.json").write_text(
        json.dumps({"width": 64, "height": 48, "intrinsic_matrix": matrix})
    )
    sequence = read_sequence(tmp_path)
    assert (sequence.camera.lens.fy, sequence.camera.lens.cx) == (524.0, 319.5)
    assert [int(frame.depth[0, 0]) for frame in sequence] == list(range(1000, 1011))  # 10 comes after 9


def test_unstamped_images_are_paired_by_the_number_in_their_names(tmp_path: Path) -> None:
    write_camera(tmp_path)
    for number in range(8, 13):
        write_pair(tmp_path / f"color/cam1_{number}.jpg", tmp_path / f"depth/d{number:04d}.png", number)
    (tmp_path / "color/cam1_11.jpg").unlink()
    (tmp_path / "depth/d0009.png").unlink()
    sequence = read_sequence(tmp_path)
    assert [int(frame.depth[0, 0]) for frame in sequence] == [1008, 1010, 1012]
    assert sequence.times == pytest.approx(np.array([0, 2, 4]) / 30)  # what is missing keeps its time


def test_unstamped_images_without_numbers_are_paired_by_their_names(tmp_path: Path) -> None:
    write_camera(tmp_path)
    for number, name in enumerate("cab"):
        write_pair(tmp_path / f"color/{name}.jpg", tmp_path / f"depth/{name}.png", number)
    assert [int(frame.depth[0, 0]) for frame in read_sequence(tmp_path)] == [1001, 1002, 1000]


@pytest.mark.parametrize(
    ("colour", "depth", "words"),
    [
        (["a", "b"], ["a", "c"], "2 colour and 2 depth images without stamps, 1 of them of one name"),
        (["1", "2"], ["3", "4"], "0 of them of one name"),
        (["x1", "y1"], ["1", "2"], "end in the same number"),
    ],
)
def test_unstamped_images_that_do_not_belong_together(
    tmp_path: Path, colour: list[str], depth: list[str], words: str
) -> None:
    write_camera(tmp_path)
    for one, other in zip(colour, depth):
        write_pair(tmp_path / f"color/{one}.jpg", tmp_path / f"depth/{other}.png", 1)
    with pytest.raises(FormatError, match=words):
        read_sequence(tmp_path)


def test_several_cameras_are_merged_in_the_bodys_time(tmp_path: Path) -> None:
    for name, stamps in (("left", (1.0, 1.2)), ("right", (0.1, 0.3))):
        write_camera(tmp_path / name)
        for stamp in stamps:
            write_pair(tmp_path / name / f"rgb/{stamp}.png", tmp_path / name / f"depth/{stamp}.png", 1)
    place = np.eye(4)
    place[0, 3] = 0.2
    rig = {"cameras": [{"folder": "left"}, {"folder": "right", "T_body_camera": place.tolist(), "clock_offset": 1.0}]}
    (tmp_path / "rig.json").write_text(json.dumps(rig))
    sequence = read_sequence(tmp_path)
    assert [frame.camera for frame in sequence] == [0, 1, 0, 1]
    assert sequence.cameras[1].T_body_camera[0, 3] == 0.2
    assert sequence.cameras[1].clock_offset == 1.0


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"clock_offset": "x"}, "clock_offset is 'x'; expected a number"),
        ({"clock_offset": None}, "clock_offset is None; expected a number"),
        ({"T_body_camera": [[1, 2], [3, 4]]}, "T_body_camera is no rigid"),
        ({"T_body_camera": np.diag([2.0, 2.0, 2.0, 1.0]).tolist()}, "T_body_camera is no rigid"),
        ({"T_body_camera": np.diag([1.0, -1.0, 1.0, 1.0]).tolist()}, "T_body_camera is no rigid"),
        ({"T_body_camera": (np.eye(4) + np.eye(4, k=-3)).tolist()}, "T_body_camera is no rigid"),
        ({"T_body_camera": "here"}, "T_body_camera is 'here'; expected an array of numbers"),
    ],
)
def test_a_rig_that_cannot_be_read_is_told_by_file_and_camera(
    tmp_path: Path, fields: dict[str, object], words: str
) -> None:
    write_camera(tmp_path / "left")
    write_pair(tmp_path / "left/rgb/1.0.png", tmp_path / "left/depth/1.0.png", 1)
    (tmp_path / "rig.json").write_text(json.dumps({"cameras": [{"folder": "left", **fields}]}))
    with pytest.raises(FormatError, match=rf"rig\.json does not describe camera 'left': .*{words}"):
        read_sequence(tmp_path)


def test_associate_is_greedy_by_distance_and_uses_each_once() -> None:
    pairs = associate(np.array([0.0, 0.011, 0.5]), np.array([0.010, 0.4]))
    assert pairs.tolist() == [[1, 0]]


@pytest.mark.parametrize(
    ("spoil", "error", "words"),
    [
        ("camera", FormatError, "has no camera.json"),
        ("stamps", FormatError, "none within"),
        ("image", FormatError, "is no image.*take it out"),
        ("listed", FileAccessError, "not there"),
        ("row", FormatError, "row 1"),
        ("nan", FormatError, "row 1: 'nan rgb/1.0.png'"),
        ("infinite", FormatError, "row 1: 'inf rgb/1.0.png'"),
        ("fields", FormatError, "has no fx"),
        ("empty", FormatError, "holds no sequence"),
    ],
)
def test_refusals_name_the_file_and_the_remedy(tmp_path: Path, spoil: str, error: type, words: str) -> None:
    write_camera(tmp_path)
    write_pair(tmp_path / "rgb/1.0.png", tmp_path / "depth/1.0.png", 1)
    (tmp_path / "rgb.txt").write_text("1.0 rgb/1.0.png\n")
    (tmp_path / "depth.txt").write_text("1.0 depth/1.0.png\n" if spoil != "stamps" else "3.0 depth/1.0.png\n")
    if spoil == "camera":
        (tmp_path / "camera.json").unlink()
    elif spoil == "image":
        (tmp_path / "rgb/1.0.png").write_bytes(b"half")
    elif spoil == "listed":
        (tmp_path / "rgb/1.0.png").unlink()
    elif spoil == "row":
        (tmp_path / "rgb.txt").write_text("soon rgb/1.0.png\n")
    elif spoil in ("nan", "infinite"):
        (tmp_path / "rgb.txt").write_text(f"{spoil[:3]} rgb/1.0.png\n")
    elif spoil == "fields":
        (tmp_path / "camera.json").write_text('{"fy": 1, "cx": 1, "cy": 1}')
    folder = tmp_path / "none" if spoil == "empty" else tmp_path
    folder.mkdir(exist_ok=True)
    with pytest.raises(error, match=words):
        read_sequence(folder)[0]


@pytest.mark.parametrize("left", [0, 100, -12])
def test_what_an_interrupted_recording_leaves_is_told_before_any_frame_is_read(tmp_path: Path, left: int) -> None:
    write_camera(tmp_path)
    lines = ""
    for time in ("1.0", "2.0"):
        write_pair(tmp_path / f"rgb/{time}.png", tmp_path / f"depth/{time}.png", 1)
        lines += f"{time} rgb/{time}.png {time} depth/{time}.png\n"
    (tmp_path / "associations.txt").write_text(lines)
    assert len(read_sequence(tmp_path)) == 2
    last = tmp_path / "depth/2.0.png"
    last.write_bytes(last.read_bytes()[:left])
    with pytest.raises(FormatError, match=r"depth.2\.0\.png is cut short\. Get it again, or take it out"):
        read_sequence(tmp_path)


def test_a_folder_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(FileAccessError, match="is not a folder"):
        read_sequence(tmp_path / "nowhere")
