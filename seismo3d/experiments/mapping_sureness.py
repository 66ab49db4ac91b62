"""Whether poses are off by as much as they are said to be: ``python -m seismo3d.experiments.mapping_sureness``.

Rendered rooms and terrains are mapped as they are, and with what depth cameras have wrong that does not average out: a
wave over the range, as of time-of-flight cameras; coarse steps of disparity; a smooth distortion over the image; a
scale or focal length other than stated. Printed for each: frames located, root mean squares of the position's and
rotation's error and of their standard deviations as reported, and the median and the 95th percentile of error over
standard deviation, first with a lens that is stated to be exact, then with the usual doubt about it.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d._typing import Float32Array, Float64Array
from seismo3d.experiments._command import run_command
from seismo3d.geometry.rotations import adjoint, invert_transform
from seismo3d.io.records import write_json
from seismo3d.robot.camera import Camera, LensErrors, RgbdFrame
from seismo3d.robot.ekf import log_motion
from seismo3d.robot.mapper import Mapper
from seismo3d.synthetic.depth_noise import DepthNoise
from seismo3d.synthetic.rgbd import rgbd_sequence

EXACT = LensErrors(0.0, 0.0, 0.0)
_WAVE, _PERIOD = 0.01, 0.8
"""Amplitude and length of the wave over the range, metres."""
_BEND = 0.006
"""Standard deviation of the distortion over the image at a metre, metres; it grows with the square of the range."""


def _waved(depth: Float32Array) -> Float32Array:
    return (depth + _WAVE * np.sin(2.0 * np.pi * depth / _PERIOD)).astype(np.float32)


def _bent(depth: Float32Array) -> Float32Array:
    from scipy.ndimage import gaussian_filter

    rough = np.random.default_rng(5).standard_normal(depth.shape)
    smooth = gaussian_filter(rough, depth.shape[0] / 8.0, mode="nearest")
    smooth = (smooth - smooth.mean()) / smooth.std()
    return (depth + _BEND * smooth * depth**2).astype(np.float32)


DEPTHS: dict[str, Callable[[Float32Array], Float32Array]] = {"waves": _waved, "bent": _bent}
LENSES: dict[str, tuple[float, float]] = {"scale 2 % off": (1.02, 1.0), "focal length 4 % off": (1.0, 1.04)}
"""Factors of the depth's scale and of the focal length."""
CASES = ("as it is", "waves", "steps", "bent", *LENSES)


def run_case(
    kind: str, case: str, *, frames: int = 200, size: tuple[int, int] = (320, 240), seed: int = 0
) -> dict[str, Any]:
    """Map a scene with one of the ``CASES``; return a row of the table.

    Parameters
    ----------
    kind : {"room", "terrain"}
    case : str
    frames : int
    size : (int, int)
        Width and height of the images.
    seed : int
    """
    noise = DepthNoise(step=0.5) if case == "steps" else None
    sequence = rgbd_sequence(kind, frames=frames, size=size, period=9.0, seed=seed, noise=noise)
    scale, focal = LENSES.get(case, (1.0, 1.0))
    lens = sequence.camera
    lens = replace(lens, depth_scale=scale, fx=focal * lens.fx, fy=focal * lens.fy)
    spoil = DEPTHS.get(case, np.asarray)
    stated = {"exact": EXACT, "usual": LensErrors()}
    mappers = {
        name: Mapper(Camera(lens, readout=0.0, depth_delay=0.0, errors=errors)) for name, errors in stated.items()
    }
    first = invert_transform(sequence.poses[0])
    found: dict[str, list[Float64Array]] = {name: [] for name in stated}
    for n, frame in enumerate(sequence):
        given = RgbdFrame.of(frame.colour, spoil(frame.depth), frame.stamp)
        for name, mapper in mappers.items():
            tracked = mapper.add(given)
            if tracked.is_located and n > 0:
                truth = first @ sequence.poses[n]
                found[name].append(measure_sureness(truth, tracked.T_world_camera, tracked.covariance))
    row: dict[str, Any] = {"frames": frames, "located": 1 + len(found["exact"])}
    for name, pairs in found.items():
        off, spread = np.array(pairs).transpose(1, 0, 2)
        row["error"] = np.sqrt((off**2).mean(axis=0)).tolist()
        row[f"sigma_{name}"] = np.sqrt((spread**2).mean(axis=0)).tolist()
        row[f"ratio_{name}"] = np.percentile(off / spread, [50, 95], axis=0).T.tolist()
    return row


def measure_sureness(truth: Float64Array, found: Float64Array, covariance: Float64Array) -> Float64Array:
    """Return how far a pose is off, and by its covariance should be: rows of (rotation in rad, position in m)."""
    to_camera = adjoint(invert_transform(truth))
    off = to_camera @ log_motion(found @ invert_transform(truth))
    spread = (to_camera @ covariance @ to_camera.T).diagonal()
    parts = (slice(3), slice(3, 6))
    return np.array([[np.linalg.norm(off[p]) for p in parts], [np.sqrt(spread[p].sum()) for p in parts]])


def _line(name: str, row: dict[str, Any]) -> str:
    turn, shift = row["error"]
    text = f"{name:32}{row['located']:5}/{row['frames']:<5}{100 * shift:7.2f} cm{1e3 * turn:7.1f} mrad"
    for lens in ("exact", "usual"):
        turn, shift = row[f"sigma_{lens}"]
        (turn_half, turn_most), (half, most) = row[f"ratio_{lens}"]
        text += f" |{100 * shift:7.2f} cm{half:6.2f}{most:6.2f}{1e3 * turn:7.1f} mrad{turn_half:6.2f}{turn_most:6.2f}"
    return text


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m seismo3d.experiments.mapping_sureness", description=__doc__)
    parser.add_argument("--kinds", nargs="*", choices=["room", "terrain"], default=["room", "terrain"])
    parser.add_argument("--cases", nargs="*", choices=CASES, default=CASES)
    parser.add_argument("--frames", type=int, default=200)
    parser.add_argument("--size", type=int, nargs=2, default=(320, 240), metavar=("WIDTH", "HEIGHT"))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path, default=None, help="write the table here, too")
    given = parser.parse_args(arguments)
    lenses = "".join(f" |{name:>22}{'':23}" for name in ("lens taken as exact", "with the usual doubt"))
    print(f"{'':32}{'located':11}{'error':>21}" + lenses)
    table = {}
    for kind in given.kinds:
        for case in given.cases:
            name = f"{kind}, {case}"
            table[name] = run_case(kind, case, frames=given.frames, size=tuple(given.size), seed=given.seed)
            print(_line(name, table[name]), flush=True)
    if given.json is not None:
        write_json(given.json, table)


if __name__ == "__main__":
    run_command(main)
