"""The kernels as plain Python give the same answers as compiled, on small inputs."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np

PROGRAM = """
import numpy as np
from seismo3d.geometry.rotations import exp_rotation
from seismo3d.registration.align import align_pairs
from seismo3d.registration.settings import LoopSettings
from seismo3d.registration.register import register

rng = np.random.default_rng(3)
p, n = rng.normal(size=(12, 3)), rng.normal(size=(12, 3))
q = p @ exp_rotation([0.3, 0.2, 0.1]).T + 0.1 * rng.normal(size=p.shape)
out = [align_pairs(q, p, normals=n, model=model).T_target_source for model in ("rigid", "affine")]
u, v = rng.uniform(-1, 1, size=(2, 300))
hill = np.column_stack([u, v, 0.3 * np.sin(3 * u) * np.cos(2 * v)])
quick = LoopSettings(max_iterations=4)
out.append(register(hill + [0.03, 0.02, 0.01], hill, stages=("local",), settings=quick).T_target_source)
print(" ".join(repr(float(x)) for x in np.concatenate(out).ravel()))
"""


def run(**extra: str) -> np.ndarray:
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True, env={**os.environ, **extra}
    )
    return np.array(done.stdout.split(), dtype=float)


def test_plain_python_agrees_with_compiled():
    np.testing.assert_allclose(run(NUMBA_DISABLE_JIT="1"), run(), atol=1e-5)  # the loop keeps float32 elements
