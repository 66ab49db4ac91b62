from __future__ import annotations

import numpy as np
import pytest
import zarr

from seismo3d.seismic.blocks.plan import Box
from seismo3d.seismic.blocks.store import BrickStore, DamagedBlock

SHAPE = (21, 18, 5)


@pytest.fixture(params=[False, True], ids=["plain", "packed"])
def store(request, tmp_path):
    made = BrickStore(tmp_path, 8)
    made.make("values", SHAPE, np.int16, packed=request.param)
    return made


@pytest.fixture
def values(rng):
    return rng.integers(-1000, 1000, SHAPE).astype(np.int16)


def write(store, values):
    store.write("values", Box(0, 16, 0, 18), values[:16])
    store.write("values", Box(16, 21, 0, 8), values[16:, :8])
    store.write("values", Box(16, 21, 8, 18), values[16:, 8:])


@pytest.mark.parametrize("box", [Box(0, 21, 0, 18), Box(3, 4, 5, 6), Box(7, 17, 6, 18), Box(20, 21, 17, 18)])
def test_what_is_written_is_read(store, values, box):
    write(store, values)
    found = store.read("values", box)
    assert found.dtype == np.int16
    np.testing.assert_array_equal(found, values[box.i0 : box.i1, box.j0 : box.j1])


def test_bricks_are_those_of_zarr_either_way(store, values):
    write(store, values)
    array = zarr.open_array(str(store.folder / "values"), mode="r+")
    np.testing.assert_array_equal(array[:], values)
    array[:] = values[::-1]
    np.testing.assert_array_equal(store.read("values", Box(0, 21, 0, 18)), values[::-1])


@pytest.mark.parametrize("damage", ["bit", "cut", "longer", "empty", "missing"])
def test_a_damaged_brick_is_named(store, values, damage):
    write(store, values)
    path = store.folder / "values" / "c" / "1" / "2" / "0"
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1 if damage == "bit" else 0
    changed = {"bit": content, "cut": content[:-1], "longer": content + b"0", "empty": b""}
    if damage == "missing":
        path.unlink()
    else:
        path.write_bytes(changed[damage])
    with pytest.raises(DamagedBlock) as found:
        store.read("values", Box(0, 21, 0, 18))
    assert (found.value.name, found.value.place) == ("values", (8, 16))
    np.testing.assert_array_equal(store.read("values", Box(0, 8, 0, 18)), values[:8])
