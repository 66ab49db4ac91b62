"""Fuzz every reader with damaged files: ``python -m tests.benchmarks.fuzz --files 100000``.

Files are read in worker processes with little memory and a time limit; a worker that dies, a read that takes too long
or too much, and any exception that is not the package's own are defects. The end is a table of how reading ended, and
the exit code is 1 where there was a defect. A defect is repeated by ``--format NAME --first SEED --files 1 --debug``.
"""

from __future__ import annotations

import argparse
import multiprocessing
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from fuzzing import FORMATS, Format, damage_file, draw_damages, read_damaged, template

LIMIT_S = 20
LIMIT_BYTES = 1536 * 2**20
_BATCH = 250


def damaged_copy(form: Format, source: Path, folder: Path, seed: int) -> Path:
    """Write the damaged file of a seed."""
    target = folder / form.ending
    shutil.rmtree(target, ignore_errors=True)
    damage_file(source, target, draw_damages(np.random.default_rng(seed)))
    return target


def run_batch(form: Format, source: Path, folder: Path, seeds: range, at: Path, out: object) -> None:
    """Read a batch of damaged files in this process, and send how each ended."""
    with Path("/proc/self/statm").open() as file:
        used = int(file.read().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + LIMIT_BYTES, used + LIMIT_BYTES))
    signal.signal(signal.SIGALRM, _give_up)
    ends: list[tuple[int, str]] = []
    for seed in seeds:
        at.write_text(str(seed))
        path = damaged_copy(form, source, folder, seed)
        signal.alarm(LIMIT_S)
        try:
            ends.append((seed, read_damaged(form, path)))
        except BaseException as error:  # noqa: BLE001 - whatever comes is what is looked for
            place = traceback.extract_tb(error.__traceback__)[-1]
            words = f"DEFECT {type(error).__name__}: {template(str(error), path)}"
            ends.append((seed, f"{words} [{Path(place.filename).name}:{place.lineno}]"))
        finally:
            signal.alarm(0)
    out.put(ends)  # type: ignore[attr-defined]


class _TooSlowError(Exception):
    """A read took longer than it may."""


def _give_up(*_: object) -> None:
    raise _TooSlowError(f"took more than {LIMIT_S} s")


def fuzz(form: Format, first: int, count: int, folder: Path) -> Counter[tuple[str, int]]:
    """Read the damaged files of many seeds; return how they ended, with the first seed of each end."""
    source = folder / "valid" / form.ending
    source.parent.mkdir(parents=True, exist_ok=True)
    context = multiprocessing.get_context("fork")
    # in a process of its own: threads that writing starts would be missing in every later fork
    maker = context.Process(target=form.make, args=(source,))
    maker.start()
    maker.join()
    ends: dict[str, list[int]] = {}
    seed = first
    while seed < first + count:
        seeds = range(seed, min(seed + _BATCH, first + count))
        queue = context.SimpleQueue()
        at = folder / "at"
        worker = context.Process(target=run_batch, args=(form, source, folder / "work", seeds, at, queue))
        (folder / "work").mkdir(exist_ok=True)
        worker.start()
        worker.join(LIMIT_S * 4 + 0.1 * len(seeds))
        if worker.exitcode == 0:
            for number, end in queue.get():
                ends.setdefault(end, []).append(number)
            seed = seeds.stop
            continue
        worker.kill()
        worker.join()
        # one that is killed while it writes down its place leaves nothing there
        last = int(at.read_text() or seed)
        hung = worker.exitcode == -signal.SIGKILL
        words = "DEFECT hang that no signal ends" if hung else f"DEFECT died {worker.exitcode}"
        ends.setdefault(words, []).append(last)
        # what the dead one had read before is not known: those are counted as they were, unknown
        ends.setdefault("read before a death", []).extend(range(seed, last))
        seed = last + 1
    return Counter({(end, min(seeds)): len(seeds) for end, seeds in ends.items() if seeds})


def main() -> int:
    """Fuzz all formats, or one."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--files", type=int, default=28_000, help="damaged files, over all formats")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--format", default="", help="only formats whose names hold this")
    parser.add_argument("--debug", action="store_true", help="let the first error through, in this process")
    asked = parser.parse_args()
    chosen = [form for form in FORMATS if asked.format.lower() in form.name.lower()]
    each = max(1, asked.files // len(chosen))
    total, defects, start = 0, 0, time.perf_counter()
    with tempfile.TemporaryDirectory() as name:
        for number, form in enumerate(chosen):
            folder = Path(name) / str(number)
            folder.mkdir()
            if asked.debug:
                (folder / "work").mkdir()
                form.make(folder / form.ending)
                print(read_damaged(form, damaged_copy(form, folder / form.ending, folder / "work", asked.first)))
                continue
            ends = fuzz(form, asked.first, each, folder)
            total += sum(ends.values())
            bad = sum(count for (end, _), count in ends.items() if end.startswith("DEFECT"))
            defects += bad
            print(f"{form.name}: {sum(ends.values())} files, {bad} defects")
            for (end, seed), count in ends.most_common():
                print(f"  {count:7d}  {end}  (first seed {seed})")
            sys.stdout.flush()
    print(f"{total} files in {time.perf_counter() - start:.0f} s, {defects} defects")
    return 1 if defects else 0


if __name__ == "__main__":
    raise SystemExit(main())
