"""Fault sticks in the ASCII forms that OpendTect and Petrel read and write.

- OpendTect (Survey > Import > Faults > ASCII, "Import Multiple Faults"): columns fault name, x, y, z, stick index,
  node index. Without map coordinates the second and third column are inline and crossline, which its import dialog
  takes too.
- Petrel ("Charisma fault sticks (ASCII)"): ``INLINE- inline crossline x y z fault_name stick_number``, also read by
  many others.

Both have no header line. z grows downwards, in ms, m or ft; nodes run from the top of a stick to its foot.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d.errors import FormatError
from seismo3d.io._files import written_aside
from seismo3d.io._pick_lines import has_value, leading_numbers, numbers_of, read_lines, refuse_line

_LINE_WORDS = ("INLINE-", "CROSSLINE-", "XLINE-", "TRACE-")
_CHARISMA = "'INLINE- [inline crossline] x y z fault_name stick_number' with finite numbers"
_OPENDTECT = "'[fault_name] x y z stick_index [node_index]' with finite numbers"
_BEGINS_AS_NUMBER = re.compile(r"[+-]?[.,]?\d.*|[\W_]+|[+-]?(nan|inf|infinity)", re.IGNORECASE)
"""What begins no name of several words after Charisma's place."""
_ALMOST_NUMBER = re.compile(r"[+-]?([\d.,]+|\d{4}.*|nan|inf|infinity)", re.IGNORECASE)
"""What ends no name before OpendTect's place; 2b does."""


@dataclass(frozen=True, slots=True, eq=False)
class FaultStick:
    """One picked line down a fault.

    Attributes
    ----------
    fault : str
        The fault's name, without blanks.
    number : int
        The stick's number within its fault, from 1.
    points : ndarray of shape (n, 3), float64
        x, y, z of the nodes from top to foot.
    lines : ndarray of shape (n, 2), float64
        Inline and crossline numbers of the nodes; not whole between lines, NaN where a file does not tell.
    """

    fault: str
    number: int
    points: Float64Array
    lines: Float64Array


def write_opendtect_sticks(path: str | Path, sticks: Iterable[FaultStick]) -> None:
    """Write sticks for OpendTect: fault name, x, y, z, stick index, node index.

    Parameters
    ----------
    path : str or Path
        The file.
    sticks : iterable of FaultStick
        The sticks.

    Raises
    ------
    FileAccessError
        If the folder cannot be written to.
    """
    with written_aside(path) as aside, aside.open("wb") as file:
        for stick in sticks:
            for node, (x, y, z) in enumerate(stick.points, start=1):
                file.write(f"{stick.fault}\t{x:.2f}\t{y:.2f}\t{z:.3f}\t{stick.number}\t{node}\n".encode())


def write_charisma_sticks(path: str | Path, sticks: Iterable[FaultStick]) -> None:
    """Write sticks for Petrel in Charisma's form.

    Line numbers are rounded to whole lines, as the format wants them; x and y stay exact.

    Parameters
    ----------
    path : str or Path
        The file.
    sticks : iterable of FaultStick
        The sticks.

    Raises
    ------
    FileAccessError
        If the folder cannot be written to.
    """
    with written_aside(path) as aside, aside.open("wb") as file:
        for stick in sticks:
            lines = np.rint(stick.lines).astype(np.int64)
            for (inline, crossline), (x, y, z) in zip(lines, stick.points, strict=True):
                place = f"{inline:>8d} {crossline:>8d} {x:>15.2f} {y:>15.2f} {z:>12.3f}"
                file.write(f"INLINE- {place} {stick.fault} {stick.number:>6d}\n".encode())


def read_sticks(path: str | Path) -> list[FaultStick]:
    """Read fault sticks: OpendTect's ASCII, or Charisma's, which Petrel and others write.

    The form is told by the lines: Charisma's begin with ``INLINE-`` (or ``CROSSLINE-``, ``XLINE-``, ``TRACE-``).
    OpendTect's may lack the fault name and the node index. The file's name then stands for the fault's; where sticks or
    nodes are counted anew, another fault begins, whose name ends in ``_2`` and so on. Of a named fault another stick
    begins with a node that its stick has already; without node indices, where a stick of several nodes in a row is met
    again after others. It gets the next number that its fault has free. Lines that are blank or begin
    with ``#`` or ``!`` are passed over. Blanks, tabs or semicolons part the fields; numbers may have decimal commas.
    Names may hold blanks. A name that may as well hold a place gone wrong is refused: put it in quotes or before a tab
    in OpendTect's form, and write it without blanks in Charisma's. Nodes without a value are left out, and sticks
    without a node: z of 1e30, 9999900, -999.25, -9999, -99999 or NaN, as in
    :func:`seismo3d.io.horizons.read_horizon`.

    Parameters
    ----------
    path : str or Path
        The file.

    Returns
    -------
    list of FaultStick
        In the order of the file; nodes by their index where there is one, else as in the file, and the other way round
        where the last one lies above the first.

    Raises
    ------
    FileAccessError
        If the file cannot be read.
    FormatError
        If it is not text or holds no pick with a value, or a line has another form: the message names the line.
    """
    lines = read_lines(path)
    charisma = lines[0][1].upper().startswith(_LINE_WORDS)
    parse = _parse_charisma if charisma else _parse_opendtect
    nodes: dict[tuple[str, int, int], list[tuple[float, ...]]] = {}
    nameless, repeats = _Nameless(Path(path).stem), _Repeats()
    for number, line in lines:
        found = parse(_with_tabs(line))
        if found is None:
            refuse_line(path, number, line, _CHARISMA if charisma else _OPENDTECT)
        fault, stick, order, place = found
        fault = fault or nameless.name_of(stick, order)
        node = nodes.setdefault((fault, stick, repeats.turn_of(fault, stick, order)), [])
        node.append((order if order is not None else len(node), *place))
    sticks = [
        _as_stick(fault, number, rows) for (fault, number), rows in zip(_numbers(nodes), nodes.values(), strict=True)
    ]
    sticks = [stick for stick in sticks if len(stick.points)]
    if not sticks:
        raise FormatError(f"{path} holds no node with a value. Check the export.")
    return sticks


class _Nameless:
    """Names faults without one: another begins where a stick, or a node of one, is met again."""

    def __init__(self, stem: str) -> None:
        self._stem = stem
        self._n_faults = 1
        self._stick: int | None = None
        self._met: set[tuple[int, float | None]] = set()

    def name_of(self, stick: int, order: float | None) -> str:
        """Return the name of the fault that the next node belongs to."""
        node = stick, order
        if node in self._met and (order is not None or stick != self._stick):
            self._n_faults += 1
            self._met.clear()
        self._stick = stick
        self._met.add(node)
        return self._stem if self._n_faults == 1 else f"{self._stem}_{self._n_faults}"


class _Repeats:
    """Tells sticks of one fault and number apart: files of several exports hold them one after the other."""

    def __init__(self) -> None:
        self._turns: dict[tuple[str, int], int] = {}
        self._met: dict[tuple[str, int], set[float | None]] = {}
        self._in_a_row: set[tuple[str, int]] = set()
        self._last: tuple[str, int] | None = None
        self._order: float | None = None

    def turn_of(self, fault: str, stick: int, order: float | None) -> int:
        """Return how many sticks of this fault and number end before the next node."""
        key = fault, stick
        met = self._met.setdefault(key, set())
        follows = key == self._last
        # an index that does not change from node to node is none
        order = None if follows and order == self._order else order
        # sticks without indices may be listed node by node, one of each in turn
        if (order in met) if order is not None else (key in self._in_a_row and not follows):
            self._turns[key] = self._turns.get(key, 0) + 1
            met.clear()
            self._in_a_row.discard(key)
        elif follows:
            self._in_a_row.add(key)
        if order is not None:
            met.add(order)
            self._order = order
        self._last = key
        return self._turns.get(key, 0)


def _numbers(nodes: Iterable[tuple[str, int, int]]) -> list[tuple[str, int]]:
    """Return the fault and number of every stick; one that has another's number gets the next free one."""
    keys = list(nodes)
    highest: dict[str, int] = {}
    for fault, stick, _ in keys:
        highest[fault] = max(highest.get(fault, stick), stick)
    named = []
    for fault, stick, turn in keys:
        if turn:
            highest[fault] += 1
        named.append((fault, highest[fault] if turn else stick))
    return named


_Node = tuple[str, int, float | None, tuple[float, ...]]
"""Fault, stick, place in the stick, and (x, y, z, inline, crossline)."""


def _as_stick(fault: str, number: int, rows: list[tuple[float, ...]]) -> FaultStick:
    table = np.array(sorted(rows, key=lambda row: row[0]), dtype=np.float64)
    table = table[has_value(table[:, 3])]
    if len(table) and table[-1, 3] < table[0, 3]:
        table = table[::-1]
    return FaultStick(fault, number, table[:, 1:4].copy(), table[:, 4:6].copy())


def _with_tabs(line: str) -> str:
    """Return a line with tabs where semicolons part its fields; nothing of one with an empty field."""
    fields = [field.strip() for field in line.rstrip("; \t").split(";")]
    if len(fields) < 4:
        return line  # a name may hold a semicolon
    return "\t".join(fields) if all(fields) else ""


def _is_place(values: list[float]) -> bool:
    """Tell whether all is known of a place, of which z is last, or it is one without a value."""
    return math.isnan(values[-1]) or not any(math.isnan(value) for value in values)


def _parse_charisma(line: str) -> _Node | None:
    key, _, rest = line.partition("-")
    words = rest.split()
    if f"{key.upper()}-" not in _LINE_WORDS or len(words) < 5:
        return None
    n_numbers = leading_numbers(words[:-2])  # the name may look like a number, and the stick's number is one
    stick = numbers_of(words[-1:])
    n_places = 5 if n_numbers >= 5 else 3
    if n_places == 3 and len(words) > 5 and _BEGINS_AS_NUMBER.fullmatch(words[3]):
        return None  # one of five numbers gone wrong
    place = numbers_of(words[:n_places], nan=True) if n_numbers >= 3 else None
    if stick is None or place is None or not _is_place(place) or not stick[0].is_integer():
        return None
    lines = (place[0], place[1]) if n_places == 5 else (np.nan, np.nan)
    return " ".join(words[n_places:-1]), int(stick[0]), None, (*place[-3:], *lines)


def _parse_opendtect(line: str) -> _Node | None:
    name, rest = "", line
    if line.startswith('"') and line.count('"') >= 2:
        name, rest = line[1:].split('"', 1)
    elif "\t" in line and not leading_numbers([line.split("\t", 1)[0]]):
        name, rest = line.split("\t", 1)
    words = rest.split()
    if not name and words and not leading_numbers(words[:1]):
        # without tabs or quotes the name ends where only numbers follow, of which there are five at most
        first = len(words) - min(leading_numbers(words[::-1]), 5)
        if len(words) - first == 4 and _ALMOST_NUMBER.fullmatch(words[first - 1]):
            return None  # the first of five numbers gone wrong
        name, words = " ".join(words[:first]), words[first:]
    if not name and len(words) == 6:
        name, words = words[0], words[1:]  # a fault may well be called by a number
    values = numbers_of(words, nan=True)
    if values is None or len(values) not in (4, 5):
        return None
    if not _is_place(values[:3]) or not all(value.is_integer() for value in values[3:]):
        return None
    order = values[4] if len(values) == 5 else None
    return name.strip(), int(values[3]), order, (*values[:3], np.nan, np.nan)
