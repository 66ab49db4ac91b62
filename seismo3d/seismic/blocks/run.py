"""The folder of a run in blocks: what it is made from, and what of it is done."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np

from seismo3d._typing import AnyArray
from seismo3d.errors import FileAccessError, FormatError, ParameterError
from seismo3d.io._files import refuse_os_errors, written_aside
from seismo3d.io.archive import list_archive, read_archive, write_archive
from seismo3d.seismic.blocks.plan import BlockPlan
from seismo3d.seismic.blocks.store import BrickStore, DamagedBlock

_PLAN = "plan.json"
_VERSION = 26
# names of what a lazy array is made of that was read from a file, and of which some was chosen
_OF_FILE = re.compile(r"(original-)?(segy|zarr|npy)-|(getitem|transpose|rechunk)-")
# lines of such an array that are looked at
_SOME_LINES = 8
# the format first: what else is written down may have another meaning in another one
_NAMES = {"version": "format", "kind": "kind", "input": "input", "settings": "setting", "memory": "memory"}


class BlockRun:
    """A run's folder, opened.

    Below ``work``, ``plan.json`` says what the run is made from, ``bricks`` has what stages hand on to each other,
    ``parts/STAGE/NUMBER.npz`` what a block came to besides, written when the block is done, and ``facts/NAME.npz`` what
    was found of the whole cube. Every file is written aside and renamed.

    Parameters
    ----------
    folder : Path
        Where the results go.
    plan : BlockPlan
        The blocks.
    settings : FaultSettings or LayerTimeSettings
        Settings of the stages.
    kind : str
        What is made: "faults" or "layers".
    """

    def __init__(self, folder: Path, plan: BlockPlan, settings: Any, kind: str = "faults") -> None:
        self.folder, self.work, self.kind = folder, folder / "work", kind
        self.plan, self.settings = plan, settings
        self.store = BrickStore(self.work / "bricks", plan.brick)
        self._facts: dict[str, dict[str, Any]] = {}

    @classmethod
    def open(cls, folder: Path) -> BlockRun:
        """Open a run that was begun, as a worker does."""
        found = json.loads((folder / "work" / _PLAN).read_text(encoding="utf-8"))
        kind = found["kind"]
        return cls(folder, BlockPlan.from_dict(found["plan"]), unpack_settings(found["settings"], kind), kind)

    @staticmethod
    def planned_at(folder: Path) -> int:
        """Return when a folder's run was begun, in nanoseconds: no other run there has the same."""
        return (folder / "work" / _PLAN).stat().st_mtime_ns

    @classmethod
    def begin(
        cls, folder: Path, plan: BlockPlan, settings: Any, *, source: Mapping[str, Any], kind: str = "faults"
    ) -> BlockRun:
        """Begin a run, or go on with the one that the folder holds.

        Raises
        ------
        ParameterError
            If the folder holds a run of another input or with other settings.
        FileAccessError
            If it cannot be written, or holds something else.
        """
        wanted = {
            "version": _VERSION, "kind": kind, "input": dict(source), "memory": plan.memory,
            "settings": pack_settings(settings), "plan": plan.to_dict(),
        }  # fmt: skip
        wanted = json.loads(json.dumps(wanted))
        path = folder / "work" / _PLAN
        with refuse_os_errors(folder, "write"):
            if path.is_file():
                found = {"kind": "faults"} | json.loads(path.read_text(encoding="utf-8"))
                _refuse_change(folder, found, wanted)
                wanted = found
            elif folder.exists() and any(entry.name != "work" for entry in folder.iterdir()):
                raise FileAccessError(f"{folder} is there and holds no run in blocks. Choose another folder.")
            else:
                path.parent.mkdir(parents=True, exist_ok=True)
                with written_aside(path) as aside:
                    aside.write_text(json.dumps(wanted, indent=1), encoding="utf-8")
        return cls(folder, BlockPlan.from_dict(wanted["plan"]), settings, kind)

    def _sweep(self) -> None:
        """Remove what a killed run left half-written; only under the lock, as a run that works writes so too."""
        for pattern in (".*.part", "work/.*.part", "work/parts/*/.*.part", "work/facts/.*.part"):
            for left in self.folder.glob(pattern):
                if left.is_dir():
                    shutil.rmtree(left, ignore_errors=True)
                else:
                    left.unlink(missing_ok=True)

    def lock(self) -> IO[str]:
        """Keep other runs out of the folder until what is returned is closed, or this process ends.

        What a killed run left half-written is removed.

        Raises
        ------
        FileAccessError
            If another run is at work in the folder.
        """
        import fcntl

        stream = (self.work / "lock").open("w", encoding="utf-8")
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            stream.close()
            raise FileAccessError(f"{self.folder} is being worked on by another run. Wait for it.") from error
        self._sweep()
        return stream

    # ----- what blocks came to

    def done(self, stage: str) -> set[int]:
        """Return the numbers of a stage's blocks that are done."""
        folder = self.work / "parts" / stage
        return {int(path.stem) for path in folder.glob("[0-9]*.npz")} if folder.is_dir() else set()

    def write_part(self, stage: str, number: int, arrays: Mapping[str, AnyArray], meta: Any = None) -> None:
        """Write down what a block came to: from now on it is done."""
        folder = self.work / "parts" / stage
        with refuse_os_errors(folder, "write"):
            folder.mkdir(parents=True, exist_ok=True)
        write_archive(folder / f"{number:06d}.npz", arrays, meta={"meta": meta})

    def read_part(self, stage: str, number: int, *, prefix: str = "") -> tuple[dict[str, AnyArray], Any]:
        """Read what a block came to, or only the arrays whose names begin in a way.

        Raises
        ------
        DamagedBlock
            If the record is damaged or missing.
        """
        try:
            arrays, meta = read_archive(self.work / "parts" / stage / f"{number:06d}.npz", prefix=prefix)
        except (FormatError, FileAccessError) as error:
            raise DamagedBlock(stage, (number,)) from error
        return arrays, meta["meta"]

    def list_part(self, stage: str, number: int, suffix: str) -> list[str]:
        """Return the names of a part's arrays that end in a suffix, without it."""
        try:
            names = list_archive(self.work / "parts" / stage / f"{number:06d}.npz")
        except (FormatError, FileAccessError) as error:
            raise DamagedBlock(stage, (number,)) from error
        return [name.removesuffix(f".{suffix}") for name in names if name.endswith(f".{suffix}")]

    def forget_part(self, stage: str, number: int) -> None:
        """Take a block for not done."""
        (self.work / "parts" / stage / f"{number:06d}.npz").unlink(missing_ok=True)

    def gather(self, stage: str, name: str, tiling: str) -> AnyArray:
        """Put together a map of the traces, from each block's: the last two axes are inlines and crosslines."""
        whole: AnyArray | None = None
        blocks = self.plan.tiling(tiling)
        for number, box in enumerate(blocks):
            part = self.read_part(stage, number)[0][name]
            if whole is None:
                whole = np.zeros((*part.shape[:-2], *self.plan.shape[:2]), part.dtype)
            whole[..., box.i0 : box.i1, box.j0 : box.j1] = part
        if whole is None:
            raise DamagedBlock(stage, (0,))
        return whole

    def add_up(self, stage: str, name: str, tiling: str) -> AnyArray:
        """Return the sum of what the blocks came to."""
        total: AnyArray = self.read_part(stage, 0)[0][name]
        for number in range(1, len(self.plan.tiling(tiling))):
            total = total + self.read_part(stage, number)[0][name]
        return total

    # ----- what was found of the whole cube

    def knows(self, name: str) -> bool:
        """Tell whether a fact is found and readable."""
        path = self.work / "facts" / f"{name}.npz"
        if name in self._facts:
            return True
        if not path.is_file():
            return False
        try:
            self._read_fact(name)
        except FormatError:
            path.unlink()
            return False
        return True

    def write_fact(self, name: str, **values: Any) -> None:
        """Write down a fact: arrays and plain values."""
        folder = self.work / "facts"
        with refuse_os_errors(folder, "write"):
            folder.mkdir(parents=True, exist_ok=True)
        arrays = {key: value for key, value in values.items() if isinstance(value, np.ndarray)}
        plain = {key: value for key, value in values.items() if key not in arrays}
        write_archive(folder / f"{name}.npz", arrays, meta=plain)
        self._facts[name] = values

    def forget_fact(self, name: str) -> None:
        """Take a fact for not found."""
        self._facts.pop(name, None)
        (self.work / "facts" / f"{name}.npz").unlink(missing_ok=True)

    def fact(self, name: str) -> dict[str, Any]:
        """Return a fact that was found."""
        if name not in self._facts:
            self._facts[name] = self._read_fact(name)
        return self._facts[name]

    def _read_fact(self, name: str) -> dict[str, Any]:
        arrays, plain = read_archive(self.work / "facts" / f"{name}.npz")
        return {**arrays, **plain}


def describe_source(cube: Any) -> dict[str, Any]:
    """Describe what is traced in, so that a change is noticed: lines and samples.

    Of a part of a file that is read as it is needed, the file's fingerprint and some lines stand for all samples; what
    was computed, lazily or not, is told by every sample.
    """
    from seismo3d.io.fingerprint import fingerprint

    found: dict[str, Any] = {"shape": list(cube.shape), "dtype": str(cube.dtype)}
    if hasattr(cube, "dims"):
        digest = hashlib.sha256()
        for name in cube.dims:
            digest.update(np.ascontiguousarray(cube[name].values).tobytes())
        found |= {"dims": list(cube.dims), "coordinates": digest.hexdigest()}
    path = getattr(cube, "attrs", {}).get("path")
    data = cube.data if hasattr(cube, "dims") else cube
    if path and Path(path).exists() and _is_of_file(data):
        lines = np.unique(np.linspace(0, data.shape[0] - 1, _SOME_LINES).astype(int))
        some = _hash_samples(np.stack([data[int(line)].compute(scheduler="synchronous") for line in lines]))
        return found | {"file": fingerprint(path)["sha256"], "lines": some}
    return found | {"samples": _hash_samples(data)}


def _is_of_file(data: Any) -> bool:
    """Tell whether samples are read from a file as they are needed, and nothing was done to them but choosing some."""
    if not hasattr(data, "dask"):
        return False
    return all(_OF_FILE.match(name) for name in data.dask.layers)


def _hash_samples(data: Any) -> str:
    """Hash all samples, a line at a time; of a lazy array a chunk, which is read once."""
    digest = hashlib.sha256()
    if not hasattr(data, "dask"):
        for line in range(data.shape[0]):
            digest.update(np.ascontiguousarray(data[line]).tobytes())
        return digest.hexdigest()
    ends = [np.cumsum((0, *sizes)) for sizes in data.chunks[:2]]
    for i0, i1 in zip(ends[0][:-1], ends[0][1:], strict=True):
        for j0, j1 in zip(ends[1][:-1], ends[1][1:], strict=True):
            digest.update(np.ascontiguousarray(data[i0:i1, j0:j1].compute(scheduler="synchronous")).tobytes())
    return digest.hexdigest()


def pack_settings(settings: Any) -> dict[str, Any]:
    """Return settings of stages as plain values."""
    from dataclasses import asdict

    found: dict[str, Any] = json.loads(json.dumps(asdict(settings)))
    return found


def unpack_settings(found: Mapping[str, Any], kind: str) -> Any:
    """Return the settings that :func:`pack_settings` described, of a kind of run."""
    from dataclasses import fields, is_dataclass

    from seismo3d.seismic.faults import FaultSettings
    from seismo3d.seismic.layer_graph import LayerTimeSettings

    def rebuild(default: Any, values: Mapping[str, Any]) -> Any:
        made = {}
        for entry in fields(default):
            value = values[entry.name]
            own = getattr(default, entry.name)
            made[entry.name] = (
                rebuild(own, value) if is_dataclass(own) else tuple(value) if isinstance(value, list) else value
            )
        return type(default)(**made)

    return rebuild(LayerTimeSettings() if kind == "layers" else FaultSettings(), found)


def _refuse_change(folder: Path, found: Mapping[str, Any], wanted: Mapping[str, Any]) -> None:
    for key, words in _NAMES.items():
        if found.get(key) == wanted[key]:
            continue
        names = _differing(found.get(key), wanted[key])
        raise ParameterError(
            f"the {words} of the run in {folder} has changed: {', '.join(names)}. Give what it was begun with, choose "
            "another folder, or remove this one to begin anew."
        )


def _differing(old: Any, new: Any, name: str = "") -> list[str]:
    if isinstance(old, dict) and isinstance(new, dict):
        keys: Iterable[str] = dict.fromkeys([*old, *new])
        parts = [_differing(old.get(key), new.get(key), f"{name}.{key}".lstrip(".")) for key in keys]
        return [word for part in parts for word in part]
    return [] if old == new else [f"{name} was {_short(old)}, now {_short(new)}".strip()]


def _short(value: Any) -> str:
    text = str(value)
    return text if len(text) <= 16 else text[:13] + "..."
