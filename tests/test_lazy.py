"""Public names come when they are used, all of them, and importing the package stays light."""

from __future__ import annotations

import importlib
import subprocess
import sys

import pytest

PACKAGES = ("seismo3d", "seismo3d.plot", "seismo3d.robot", "seismo3d.terrain", "seismo3d.viewer")


@pytest.mark.parametrize("package", PACKAGES)
def test_every_public_name_is_there(package):
    module = importlib.import_module(package)
    assert dir(module) == sorted(module.__all__)
    for name in module.__all__:
        assert getattr(module, name) is getattr(module, name)


@pytest.mark.parametrize("package", PACKAGES)
def test_other_names_are_refused_with_the_package_s_name(package):
    with pytest.raises(AttributeError, match=f"{package}.*nowhere"):
        _ = importlib.import_module(package).nowhere


def test_importing_takes_no_heavy_module():
    code = "import sys, seismo3d, seismo3d.robot, seismo3d.terrain, seismo3d.plot; print(*sys.modules)"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = set(ran.stdout.split())
    assert not loaded & {"numba", "scipy", "cv2", "skimage", "pyvista", "matplotlib", "dask", "zarr", "xarray"}
