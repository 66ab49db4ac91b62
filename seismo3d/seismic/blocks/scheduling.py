"""Who works on blocks: this process, or the workers of a dask cluster."""

from __future__ import annotations

import ctypes
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from functools import cache, lru_cache
from pathlib import Path
from queue import Empty, Queue
from typing import Any, Protocol

from seismo3d._validate import told
from seismo3d.errors import FileAccessError, MissingDependencyError, ParameterError
from seismo3d.seismic.blocks.run import BlockRun
from seismo3d.seismic.blocks.store import DamagedBlock

Piece = Callable[[int], Any]
"""Gives what a block needs of the input, lazily, by the block's number."""

_ANSWER_S = "15s"
_PATIENCE_S = 60.0
_one_at_a_time = threading.Lock()
# of mallopt(3), and the largest size of arrays, in bytes, for which the C library itself comes to keep memory
_TRIM_THRESHOLD, _MMAP_THRESHOLD, _LARGEST_KEPT = -1, -3, 32 << 20


class Scheduler(Protocol):
    """Something that works on blocks."""

    def work(
        self, run: BlockRun, stage: str, numbers: Sequence[int], piece: Piece | None
    ) -> Iterator[tuple[int, DamagedBlock | None]]:
        """Work on a stage's blocks; give each one's number when it is done, or what it found damaged."""
        ...


class InThisProcess:
    """Works on one block after the other, each on all of numba's threads."""

    def work(
        self, run: BlockRun, stage: str, numbers: Sequence[int], piece: Piece | None
    ) -> Iterator[tuple[int, DamagedBlock | None]]:
        """Work on a stage's blocks, in turn."""
        from seismo3d.seismic.blocks.stages import stages_of

        work = stages_of(run)[stage].work
        for number in numbers:
            try:
                work(run, number, *([] if piece is None else [piece(number)]))
            except DamagedBlock as damage:
                yield number, damage
            else:
                yield number, None


def _as_address(address: Any) -> str:
    """Return the address of a scheduler, or refuse what is none before a client is made, which would not end well."""
    from distributed.comm import get_address_host_port, parse_address

    refusal = ParameterError(f"scheduler is {told(address)}; expected an address such as tcp://node1:8786.")
    if not isinstance(address, str):
        raise refusal
    try:
        scheme = parse_address(address)[0]
        if scheme not in ("inproc", "ucx"):  # the others are a host and a port
            get_address_host_port(address)
    except ValueError as error:
        raise refusal from error
    return address


class OnCluster(AbstractContextManager["OnCluster"]):
    """Works on the workers of a dask cluster, which must see the run's folder under the same name.

    Parameters
    ----------
    address : str
        The cluster's, such as ``tcp://host:8786``.

    Raises
    ------
    MissingDependencyError
        If the extra ``cluster`` is not installed.
    ParameterError
        If it is no address.
    FileAccessError
        If nothing answers there.
    """

    def __init__(self, address: str) -> None:
        try:
            from distributed import Client
        except ImportError as error:
            raise MissingDependencyError(
                "a cluster is asked for and dask's distributed is not installed. "
                "Install it: pip install 'seismo3d[cluster]'."
            ) from error
        self.address = _as_address(address)
        try:
            self._client = Client(address, timeout=_ANSWER_S, set_as_default=False)
        except (OSError, TimeoutError, ValueError) as error:
            raise FileAccessError(
                f"no dask scheduler answers at {address}. Start one (dask scheduler) and workers, or leave it out."
            ) from error

    def __exit__(self, *_: object) -> None:
        self._client.close()

    @property
    def n_workers(self) -> int:
        """How many workers there are."""
        return len(self._client.scheduler_info()["workers"])

    def work(
        self, run: BlockRun, stage: str, numbers: Sequence[int], piece: Piece | None
    ) -> Iterator[tuple[int, DamagedBlock | None]]:
        """Work on a stage's blocks, on as many workers as there are; blocks of workers that die go to others."""
        from distributed import KilledWorker

        folder = str(run.folder.resolve())
        waiting = list(reversed(numbers))
        ended: Queue[Any] = Queue()
        place: dict[Any, int] = {}

        def submit() -> None:
            number = waiting.pop()
            job = _Job(folder, stage, number, None if piece is None else piece(number))
            future = self._client.submit(job, pure=False, retries=2)
            place[future.key] = number
            future.add_done_callback(ended.put)

        for _ in range(min(len(waiting), 2 * max(1, self.n_workers))):
            submit()
        while place:
            future = self._next(ended)
            number = place.pop(future.key)
            if waiting:
                submit()
            try:
                future.result()
            except DamagedBlock as damage:
                yield number, damage
            except KilledWorker as error:
                raise FileAccessError(
                    f"workers died again and again over block {number} of {stage}, most likely for want of memory. "
                    "Start workers with more of it and give the same command again: finished blocks are kept."
                ) from error
            else:
                yield number, None

    def _next(self, ended: Queue[Any]) -> Any:
        """Return the next job that ends; not for ever where no worker is left."""
        alone_since: float | None = None
        while True:
            try:
                return ended.get(timeout=1.0)
            except Empty:
                alone_since = None if self.n_workers else alone_since or time.monotonic()
            if alone_since is not None and time.monotonic() - alone_since > _PATIENCE_S:
                raise FileAccessError(
                    f"the cluster at {self.address} has no workers left. Start some and give the same command again: "
                    "finished blocks are kept."
                )


class _Job:
    """One block of one stage, as it is sent to a worker; what it needs of the input is not looked into on the way."""

    def __init__(self, folder: str, stage: str, number: int, piece: Any) -> None:
        self._folder, self._stage, self._number, self._piece = folder, stage, number, piece

    def __call__(self) -> None:
        from seismo3d.seismic.blocks.stages import stages_of

        with _one_at_a_time:
            _keep_freed_memory()
            _use_own_threads()
            run = _open_once(self._folder, BlockRun.planned_at(Path(self._folder)))
            stages_of(run)[self._stage].work(run, self._number, *([] if self._piece is None else [self._piece]))


@lru_cache(maxsize=1)
def _open_once(folder: str, written: int) -> BlockRun:  # noqa: ARG001 - another plan is another run
    """Open a run that was planned at a time; what a worker read of it serves its next block too."""
    return BlockRun.open(Path(folder))


@cache
def _keep_freed_memory() -> None:
    """Have a worker use freed memory again, as a process does by itself (Linux).

    The worker's nanny asks for freed memory to be given back early; with that, the C library takes every large array
    anew from the system, page by page, which costs a fourth of the time.
    """
    set_option = getattr(ctypes.CDLL(None), "mallopt", None) if sys.platform == "linux" else None
    if set_option is not None:
        set_option(_MMAP_THRESHOLD, _LARGEST_KEPT)
        set_option(_TRIM_THRESHOLD, 2 * _LARGEST_KEPT)


def _use_own_threads() -> None:
    """Compute on as many threads as this worker was given."""
    import numba
    import zarr
    from distributed import get_worker

    given = int(get_worker().state.nthreads)
    # of the library's own threads, which it starts when it first reads or writes
    zarr.config.set({"threading.max_workers": given})
    numba.set_num_threads(max(1, min(given, int(getattr(numba.config, "NUMBA_NUM_THREADS", given)))))
