from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from seismo3d.errors import FileAccessError, FormatError, ParameterError
from seismo3d.io.fault_sticks import FaultStick, read_sticks, write_charisma_sticks, write_opendtect_sticks
from seismo3d.io.horizons import (
    HorizonGrid,
    read_horizon,
    write_charisma_horizon,
    write_irap_classic,
    write_xyz_horizon,
)


def text(tmp_path: Path, content: str, name: str = "picks.dat") -> Path:
    path = tmp_path / name
    path.write_text(content)
    return path


def some_sticks() -> list[FaultStick]:
    points = np.array([[1000.25, 2000.5, 812.125], [1010.0, 2003.0, 900.0], [1030.0, 2010.0, 990.5]])
    lines = np.array([[101.0, 55.0], [102.0, 55.0], [104.0, 55.0]])
    return [
        FaultStick("fault_001", 1, points, lines),
        FaultStick("fault_001", 2, points + 50.0, lines + 4.0),
        FaultStick("fault_002", 1, points[:2] + 500.0, lines[:2] + 9.0),
    ]


@pytest.mark.parametrize("write", [write_opendtect_sticks, write_charisma_sticks])
def test_sticks_come_back(tmp_path: Path, write) -> None:  # type: ignore[no-untyped-def]
    write(tmp_path / "sticks.txt", some_sticks())
    found = read_sticks(tmp_path / "sticks.txt")
    assert [(s.fault, s.number) for s in found] == [("fault_001", 1), ("fault_001", 2), ("fault_002", 1)]
    for stick, expected in zip(found, some_sticks(), strict=True):
        np.testing.assert_allclose(stick.points, expected.points, atol=0.006)
        if write is write_charisma_sticks:
            np.testing.assert_array_equal(stick.lines, expected.lines)
        else:
            assert np.isnan(stick.lines).all()


@pytest.mark.parametrize(
    ("content", "counts"),
    [
        ("1 1 5 0\n1 2 9 0\n1 1 5 1\n8 1 5 0\n8 2 9 0\n", {"bare": 3, "bare_2": 2}),
        ("1 1 5 0 0\n1 2 9 0 1\n8 1 5 0 0\n8 2 9 0 1\n8 3 12 0 2\n9 1 5 0 0\n", {"bare": 2, "bare_2": 3, "bare_3": 1}),
        ("1 1 5 0 0\n1 1 5 1 0\n1 2 9 0 1\n1 2 9 1 1\n", {"bare": 4}),
        ("1 1 5 3\n1 2 9 3\n1 1 5 2\n1 2 9 2\n", {"bare": 4}),
    ],
    ids=["sticks counted anew", "nodes counted anew", "node by node", "downwards"],
)
def test_without_names_another_fault_begins_where_counting_does(
    tmp_path: Path, content: str, counts: dict[str, int]
) -> None:
    found: dict[str, int] = {}
    for stick in read_sticks(text(tmp_path, content, "bare.dat")):
        found[stick.fault] = found.get(stick.fault, 0) + len(stick.points)
    assert found == counts


@pytest.mark.parametrize("form", ["{fault} {x} 0 {z} {stick} {node}", "{fault} {x} 0 {z} {stick}",
                                  "INLINE- 1 2 {x} 0 {z} {fault} {stick}"])  # fmt: skip
def test_sticks_met_again_are_other_sticks(tmp_path: Path, form: str) -> None:
    """Two exports joined, of which each counts its sticks from 1."""
    sticks = (("F1", 0, 1), ("F2", 5, 1), ("F1", 50, 1), ("F1", 60, 2), ("F2", 70, 1))
    lines = [
        form.format(fault=fault, x=x, z=100 * node, stick=stick, node=node)
        for fault, x, stick in sticks
        for node in (1, 2, 3)
    ]
    found = read_sticks(text(tmp_path, "\n".join(lines) + "\n"))
    assert [(s.fault, s.number) for s in found] == [("F1", 1), ("F2", 1), ("F1", 3), ("F1", 2), ("F2", 2)]
    for stick, (_, x, _) in zip(found, sticks, strict=True):
        assert stick.points.tolist() == [[x, 0, 100], [x, 0, 200], [x, 0, 300]]


@pytest.mark.parametrize("form", ["F1 {x} 0 {z} {x} {node}", "F1 {x} 0 {z} {x}", "INLINE- {x} 0 {z} F1 {x}"])
def test_sticks_may_be_listed_node_by_node(tmp_path: Path, form: str) -> None:
    lines = [form.format(x=x, z=100 * node, node=node) for node in (1, 2, 3) for x in (1, 2, 3)]
    found = read_sticks(text(tmp_path, "\n".join(lines) + "\n"))
    assert [(s.number, s.points[:, 2].tolist()) for s in found] == [(n, [100, 200, 300]) for n in (1, 2, 3)]


def test_an_index_that_never_changes_is_none(tmp_path: Path) -> None:
    lines = [f"F1 {x} 0 {z} {x} 1" for x in (1, 2) for z in (100, 200, 300)]
    found = read_sticks(text(tmp_path, "\n".join(lines) + "\n"))
    assert [(s.number, s.points[:, 2].tolist()) for s in found] == [(n, [100, 200, 300]) for n in (1, 2)]


def test_a_fault_may_be_called_by_a_number(tmp_path: Path) -> None:
    path = tmp_path / "numbered.txt"
    path.write_text("12\t500\t600\t100\t1\t1\n12\t500\t601\t120\t1\t2\n")
    (stick,) = read_sticks(path)
    assert (stick.fault, stick.number) == ("12", 1)
    np.testing.assert_array_equal(stick.points, [[500, 600, 100], [500, 601, 120]])


def test_opendtect_dialects(tmp_path: Path) -> None:
    # names with blanks in quotes, before a tab, or plain; without a node index; nodes out of order; comments
    path = text(
        tmp_path,
        '# fault sticks\n! header\n\n"Main fault"\t10 20 800 1 2\n"Main fault"\t11 21 700 1 1\n'
        "West one\t1 2 3 4\nF1 5 6 7 0\nBig West 3 5 6 7 2 1\n",
    )
    found = {(s.fault, s.number): s.points.tolist() for s in read_sticks(path)}
    assert found[("Main fault", 1)] == [[11, 21, 700], [10, 20, 800]]
    assert found[("West one", 4)] == [[1, 2, 3]]
    assert found[("F1", 0)] == [[5, 6, 7]]
    bare = text(tmp_path, "1 2 3 1 1\n1 2 9 1 2\n4 5 6 2 1\n", "fault_A.txt")
    assert [(s.fault, s.number, len(s.points)) for s in read_sticks(bare)] == [("fault_A", 1, 2), ("fault_A", 2, 1)]


@pytest.mark.parametrize(
    "form", ["INLINE- 100 200 {x} 20.0 {z} F1 1", "INLINE- {x} 20.0 {z} F1 1", "F1 {x} 20 {z} 1", "F1 {x} 20 {z} 1 {n}"]
)
def test_sticks_picked_from_the_foot_up_are_turned_over(tmp_path: Path, form: str) -> None:
    def read(*depths: int) -> list[list[float]]:
        lines = [form.format(x=10 + n, z=z, n=n) for n, z in enumerate(depths, start=1)]
        (stick,) = read_sticks(text(tmp_path, "\n".join(lines) + "\n"))
        assert stick.lines.shape == (len(depths), 2)
        return stick.points[:, [0, 2]].tolist()

    assert read(1000, 950, 900) == [[13, 900], [12, 950], [11, 1000]]
    assert read(900, 1000) == [[11, 900], [12, 1000]]
    # a bend upwards on the way is part of the pick
    assert read(1000, 1010, 900) == [[13, 900], [12, 1010], [11, 1000]]


@pytest.mark.parametrize("between", [" ", "\t", ";", " ; "])
@pytest.mark.parametrize(
    ("fields", "fault"),
    [
        (("INLINE-", "100", "200", "604000", "6080000,25", "1200,5", "fault_a", "1"), "fault_a"),
        (("INLINE-", "100", "200", "604000,0", "6080000,25", "1200,5", "Fault 1,5 east", "1"), "Fault 1,5 east"),
        (("XLINE-", "604000", "6080000,25", "1200,5", "fault_a", "1"), "fault_a"),
        (("fault_a", "604000,0", "6080000,25", "1200,5", "1", "1"), "fault_a"),
        (("Fault 1,5", "604000,0", "6080000,25", "1200,5", "1", "1"), "Fault 1,5"),
        (("fault_a", "604000", "6080000,25", "1200,5", "1"), "fault_a"),
        (("12", "604000,0", "6080000,25", "1200,5", "1", "1"), "12"),
        (("604000,0", "6080000,25", "1200,5", "1", "1"), "picks"),
        (("604000", "6080000,25", "1200,5", "1"), "picks"),
    ],
)
def test_sticks_with_decimal_commas(tmp_path: Path, fields: tuple[str, ...], fault: str, between: str) -> None:
    (stick,) = read_sticks(text(tmp_path, between.join(fields) + "\n"))
    assert (stick.fault, stick.number, stick.points.tolist()) == (fault, 1, [[604000.0, 6080000.25, 1200.5]])


def test_charisma_dialects(tmp_path: Path) -> None:
    path = text(
        tmp_path,
        "INLINE-  120  340  1000.0 2000.0 812.0 Fault 12 east  3\r\n"
        "INLINE-  1000.5 2001.0 900.0 F2  1\n"
        "Xline-  121  341  1001.0 2002.0 822.0 7  4\n",
    )
    named, bare, number = read_sticks(path)
    assert (named.fault, named.number, named.lines.tolist()) == ("Fault 12 east", 3, [[120.0, 340.0]])
    assert (bare.fault, bare.number, bare.points.tolist()) == ("F2", 1, [[1000.5, 2001.0, 900.0]])
    assert np.isnan(bare.lines).all()
    assert (number.fault, number.number, number.points.tolist()) == ("7", 4, [[1001.0, 2002.0, 822.0]])


def test_names_of_several_words_may_end_with_a_digit_and_a_letter(tmp_path: Path) -> None:
    (stick,) = read_sticks(text(tmp_path, "Fault 2b 604000 6080000 1200 1\nFault 2b 604000 6080000 1210 1\n"))
    assert stick.fault == "Fault 2b"
    np.testing.assert_array_equal(stick.points[:, 2], [1200.0, 1210.0])


@pytest.mark.parametrize(
    ("content", "line"),
    [
        ("F1\t1 2 3 1 1\nF1\t1 2 x 1 2\n", 2),
        ("F1\t1 2 3 1 1\n\nF1\t1 2\n", 3),
        ("F1\t1 2 3 1.5 1\n", 1),
        ("F1\tnan 2 3 1 1\n", 1),
        ("F1 1 2 3 nan 1\n", 1),
        ("1 2 3 1 1\n1 2 3 1 1 6 7 8\n", 2),
        ("INLINE- 1 2 3 4 5 F 1\nINLINE- 1 2 3 F 1\nINLINE- 1 2 inf F 1\n", 3),
        # a place gone wrong is no part of a name
        ("INLINE- 1 2 3 4 5 F 1\nINLINE- 1 2 3 4 five F 1\n", 2),
        ("INLINE- 100 200 604000 6080000 fault_a 1\n", 1),
        ("INLINE- 100 200 604000 **** 1200 fault_a 1\n", 1),
        ("INLINE- 100 200 604000 6.080.000,5 1200 fault_a 1\n", 1),
        ("INLINE- 100 200 604000.5 6080000 1,200 fault_a 1\n", 1),
        ("INLINE-;100;200;604000;;1200;fault_a;1\n", 1),
        ("fault_a 604.000,5 6080000 1200 1 1\n", 1),
        ("604.000,5 6080000 1200 1 1\n", 1),
        ("fault_a 604000x 6080000 1200 1 1\n", 1),
        ("fault_a 604000.5 6080000 1,200 1 1\n", 1),
        ("fault_a;;6080000;1200;1;1\n", 1),
        ("INLINE- 1 2 3 4 5 F 1\nF1 1 2 3 1 1\n", 2),
        ("INLINE- 1 2 3 4 5 F one\n", 1),
    ],
)
def test_malformed_sticks_are_refused_by_line(tmp_path: Path, content: str, line: int) -> None:
    path = text(tmp_path, content)
    with pytest.raises(FormatError, match=rf"picks.dat, line {line}: .*; expected '.*finite numbers"):
        read_sticks(path)


def test_what_is_no_picks_is_refused(tmp_path: Path) -> None:
    for read in (read_sticks, read_horizon):
        with pytest.raises(FileAccessError, match="does not exist"):
            read(tmp_path / "none.txt")
        with pytest.raises(FormatError, match="holds no picks"):
            read(text(tmp_path, "# nothing\n\n"))
        (tmp_path / "binary").write_bytes(b"\x00\x01" * 50)
        with pytest.raises(FormatError, match="is not text"):
            read(tmp_path / "binary")


def some_horizon(turn_deg: float = 30.0) -> HorizonGrid:
    i, j = np.meshgrid(np.arange(6), np.arange(8), indexing="ij")
    turn = np.radians(turn_deg)
    x = 5000.0 + 25.0 * i * np.sin(turn) + 12.5 * j * np.cos(turn)
    y = 8000.0 + 25.0 * i * np.cos(turn) - 12.5 * j * np.sin(turn)
    z = 900.0 + i + 0.25 * j
    z[2, 3] = np.nan
    return HorizonGrid(x, y, z, 100.0 + 2.0 * np.arange(6), 500.0 + np.arange(8))


@pytest.mark.parametrize("write", [write_xyz_horizon, write_charisma_horizon, write_irap_classic])
@pytest.mark.parametrize("turn_deg", [0.0, 30.0, 215.0])
def test_horizons_come_back(tmp_path: Path, write, turn_deg: float) -> None:  # type: ignore[no-untyped-def]
    grid = some_horizon(turn_deg)
    write(tmp_path / "top.txt", grid)
    found = read_horizon(tmp_path / "top.txt")
    assert found.name == "top"
    known = np.isfinite(grid.z)
    expected = np.column_stack([grid.x[known], grid.y[known], grid.z[known]])
    order, wanted = np.lexsort(np.rint(found.points.T)), np.lexsort(np.rint(expected.T))
    np.testing.assert_allclose(found.points[order], expected[wanted], atol=0.011)
    if write is write_charisma_horizon:
        i, j = np.nonzero(known)
        np.testing.assert_array_equal(found.lines, np.column_stack([grid.inlines[i], grid.crosslines[j]]))
    else:
        assert np.isnan(found.lines).all()


def test_xyz_dialects(tmp_path: Path) -> None:
    found = read_horizon(text(tmp_path, "# x y z\n1.5, 2.5, 800\n3,4,1e30\n5,6,810\n"))
    assert found.points.tolist() == [[1.5, 2.5, 800.0], [5.0, 6.0, 810.0]]
    nulls = "1 2 NaN\n1.5 2.5 800\n3 4 -999.25\n3 4 -9999\n3 4 -99999\n3 4 9999900\n5 6 810\n"
    assert read_horizon(text(tmp_path, nulls)).points[:, 2].tolist() == [800, 810]
    irap = read_horizon(text(tmp_path, "1 2 800\n3 4 805\n999.0 999.0 999.0\n5 6 810\n999.0 999.0 999.0\n"))
    assert irap.points.tolist() == [[1, 2, 800], [3, 4, 805], [5, 6, 810]]
    irap_commas = text(tmp_path, "1,5 2 800\n999,0 999,0 999,0\n")
    assert read_horizon(irap_commas).points.tolist() == [[1.5, 2, 800]]
    wide = text(tmp_path, "10 20 100 200 800\n11 21 110 210 801\n")
    assert read_horizon(wide, columns=(3, 4, 5)).points.tolist() == [[100, 200, 800], [110, 210, 801]]
    with pytest.raises(FormatError, match=r"line 1: .*columns"):
        read_horizon(wide)
    with pytest.raises(FormatError, match=r"line 1: .*at least 6"):
        read_horizon(wide, columns=(3, 4, 6))
    with pytest.raises(ParameterError, match="three different numbers"):
        read_horizon(wide, columns=(3, 3, 5))
    assert read_horizon(wide, columns=(3, 4.0, 5)).points.tolist() == [[100, 200, 800], [110, 210, 801]]  # type: ignore[arg-type]
    for columns in ((3, 4.5, 5), (3, "4", 5), 3, np.array(3)):
        with pytest.raises(ParameterError, match=r"columns.* is .*; expected"):
            read_horizon(wide, columns=columns)  # type: ignore[arg-type]
    write_charisma_horizon(tmp_path / "c.txt", some_horizon())
    with pytest.raises(ParameterError, match="Charisma form"):
        read_horizon(tmp_path / "c.txt", columns=(1, 2, 3))


@pytest.mark.parametrize(
    "row",
    [
        "604000 6080000 733,2739",
        "604000,0\t6080000\t733,2739",
        "604000;6080000;733,2739;",
        "604000,0; 6080000,0; 733,2739",
        "604000.0;6080000;733.2739",
        "604000,6080000,733.2739",
        "604000.0, 6080000, 733.2739",
        "INLINE : 1 XLINE : 2 604000 6080000 733,2739",
        "INLINE :;1;XLINE :;2;604000;6080000;733,2739",
    ],
)
def test_a_comma_is_a_decimal_sign_where_others_part_the_numbers(tmp_path: Path, row: str) -> None:
    assert read_horizon(text(tmp_path, f"{row}\n")).points.tolist() == [[604000.0, 6080000.0, 733.2739]]


def test_decimal_commas_in_columns_beside_nan_and_in_grids(tmp_path: Path) -> None:
    wide = text(tmp_path, "7 604000 6080000 733,2739\n8 604000,5 6080000 NaN\n")
    assert read_horizon(wide, columns=(2, 3, 4)).points.tolist() == [[604000, 6080000, 733.2739]]
    head = "-996 2 25,0 25,0\n0,0 25,0 0,0 25,0\n2 0 0 0\n0 0 0 0 0 0 0\n"
    grid = head + "733,5\n734 735,25 NaN\n"
    for content in (grid, grid.replace(" ", ";")):
        assert read_horizon(text(tmp_path, content)).points[:, 2].tolist() == [733.5, 734.0, 735.25]


@pytest.mark.parametrize(
    "row",
    ["604000.5 6080000 733,27", "604000, 6080000, 733,27", "604000.5;6080000;733,27", "1,5,2;3;4", "604,000.5 2,5 3"],
)
def test_a_comma_that_may_be_either_is_refused(tmp_path: Path, row: str) -> None:
    path = text(tmp_path, f"1 2 3\n{row}\n")
    for columns in (None, (1, 2, 3)):
        with pytest.raises(FormatError, match=r"picks.dat, line 2: .*; expected either commas alone .* or decimal"):
            read_horizon(path, columns=columns)


@pytest.mark.parametrize("row", ["1,2 3", "604,000 6,080,000 733", "604000;;733,27", "1,5;2;abc", ";"])
def test_commas_that_leave_no_three_numbers_are_refused(tmp_path: Path, row: str) -> None:
    with pytest.raises(FormatError, match=r"picks.dat, line 2: "):
        read_horizon(text(tmp_path, f"1 2 3\n{row}\n"))


def test_nan_stands_for_no_value_in_every_form(tmp_path: Path) -> None:
    charisma = "INLINE : 1 XLINE : 2 3 4 NaN\nINLINE : 1 XLINE : 3 30 40 800\n"
    found = read_horizon(text(tmp_path, charisma))
    assert (found.points.tolist(), found.lines.tolist()) == ([[30, 40, 800]], [[1, 3]])
    head = "-996 2 25 25\n0 25 0 25\n2 0 0 0\n0 0 0 0 0 0 0\n"
    assert read_horizon(text(tmp_path, head + "1 nan 3 NaN\n")).points.tolist() == [[0, 0, 1], [0, 25, 3]]
    assert read_horizon(text(tmp_path, "1 2 800\nnan nan nan\n")).points.tolist() == [[1, 2, 800]]
    for empty in ("INLINE : 1 XLINE : 2 3 4 nan\n", head + "nan nan nan nan\n", "1 2 nan\n"):
        with pytest.raises(FormatError, match="no point with a value"):
            read_horizon(text(tmp_path, empty))


@pytest.mark.parametrize("null", ["1e30", "1e+30", "-999.25", "-9999", "-99999", "9999900", "nan", "NaN"])
def test_nodes_of_sticks_without_a_value_are_left_out(tmp_path: Path, null: str) -> None:
    rows = ("F1 1 2 800 1 1", f"F1 3 4 {null} 1 2", "F1 5 6 900 1 3", f"F1 1 2 {null} 2 1", f"F2 1 2 {null} 1 1")
    first, single = read_sticks(text(tmp_path, "\n".join((*rows, "F1 7 8 910 2 2", ""))))
    assert (first.fault, first.number, first.points.tolist()) == ("F1", 1, [[1, 2, 800], [5, 6, 900]])
    # one node left is a stick, as one node picked is
    assert (single.fault, single.number, single.points.tolist()) == ("F1", 2, [[7, 8, 910]])
    charisma = f"INLINE- 1 2 10 20 {null} F 1\nINLINE- 1 3 10 30 700 F 1\n"
    (stick,) = read_sticks(text(tmp_path, charisma))
    assert (stick.points.tolist(), stick.lines.tolist()) == ([[10, 30, 700]], [[1, 3]])
    with pytest.raises(FormatError, match="no node with a value"):
        read_sticks(text(tmp_path, f"F1 1 2 {null} 1 1\n"))


@pytest.mark.parametrize(
    ("content", "line"),
    [
        ("1 2 3\n1 2\n", 2),
        ("1 2 3\n# note\n1 2 abc\n", 3),
        ("INLINE : 1 XLINE : 2 3 4 5\nINLINE : 1 XLINE : 2 3 4\n", 2),
        ("INLINE : 1 XLINE : x 3 4 5\n", 1),
        ("-996 2 25.0 25.0\n0 25 0 25\n2 0 0 bad\n", 3),
        ("-996 2 25 25\n0 25 0 25\n2 0 0 0\n0 0 0 0 0 0 0\n1 2 3 x\n", 5),
    ],
)
def test_malformed_horizons_are_refused_by_line(tmp_path: Path, content: str, line: int) -> None:
    with pytest.raises(FormatError, match=f"picks.dat, line {line}: "):
        read_horizon(text(tmp_path, content))


def test_irap_grid_of_the_wrong_size_is_refused(tmp_path: Path) -> None:
    head = "-996 2 25 25\n0 25 0 25\n2 0 0 0\n0 0 0 0 0 0 0\n"
    with pytest.raises(FormatError, match="has 3 values; its header tells 2 x 2"):
        read_horizon(text(tmp_path, head + "1 2 3\n"))
    with pytest.raises(FormatError, match="header, or that has 4 numbers"):
        read_horizon(text(tmp_path, "-996 2 25 25\n"))
    with pytest.raises(FormatError, match="no point with a value"):
        read_horizon(text(tmp_path, head + "9999900 9999900 9999900 9999900\n"))
