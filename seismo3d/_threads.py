"""Work on one item after another, shared among threads."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import TypeVar

import numba

Item = TypeVar("Item")
Result = TypeVar("Result")


def map_items(function: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """Return a function's results for some items, in their order, worked out on as many threads as kernels may use.

    The function must not run a kernel that shares its own work among threads: of those one runs at a time.
    """
    todo, n_threads = list(items), numba.get_num_threads()
    if n_threads == 1 or len(todo) < 2:
        return [function(item) for item in todo]
    return list(_pool(n_threads).map(function, todo))


@cache
def _pool(n_threads: int) -> ThreadPoolExecutor:
    """Return so many threads; they are kept."""
    return ThreadPoolExecutor(n_threads, thread_name_prefix="seismo3d")
