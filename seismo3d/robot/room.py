"""Memory: for the arrays of a frame, used again once none of them is left, and for those that a map fills slowly."""

from __future__ import annotations

import math
import mmap
import weakref
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray


class Room:
    """Hands out arrays, and takes their memory back when nobody holds them or a part of them any more.

    Memory that is given back to the system and asked for anew with every frame costs as much as measuring the frame.
    What is kept is never more than what was in use at once.
    """

    def __init__(self) -> None:
        self._free: dict[int, list[memoryview]] = {}

    def empty(self, shape: tuple[int, ...], kind: Any) -> AnyArray:
        """Return an array of a shape and a kind of number whose values are anything."""
        kind = np.dtype(kind)
        size = math.prod(shape) * kind.itemsize
        if size == 0:
            return np.empty(shape, dtype=kind)
        free = self._free.setdefault(size, [])
        try:
            memory = free.pop()
        except IndexError:
            memory = np.empty(size, dtype=np.uint8).data
        # all views of the array refer to this one, as its own memory is no array's
        array = np.frombuffer(memory, dtype=kind)
        weakref.finalize(array, free.append, memory).atexit = False
        return array.reshape(shape)


def room_to_grow(shape: tuple[int, ...], kind: Any) -> AnyArray:
    """Return zeros of a shape and a kind of number, for what is filled from the beginning and rarely to its end.

    The system gives the memory page by page as it is written to. numpy asks it for large pages, which are ready less
    often: under a hypervisor, that may have to find each of them first, a map then takes longer to be given its memory
    than to be made.
    """
    kind = np.dtype(kind)
    return np.frombuffer(mmap.mmap(-1, math.prod(shape) * kind.itemsize), dtype=kind).reshape(shape)
