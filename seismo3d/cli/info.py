"""``seismo3d info``: what a file holds, and how that was found out."""

from __future__ import annotations

from typing import Any

import typer

from seismo3d.cli._options import Cube, Json, Reading, reads_cube

EXAMPLES = ("seismo3d info f3.sgy", "seismo3d info f3.sgy --inline-byte 9 --crossline-byte 21 --json")


@reads_cube
def run(cube: Cube, json: Json = False, *, reading: Reading) -> None:
    """Print a cube's geometry, formats, amplitude range, and dead, missing and duplicate traces."""
    from seismo3d.cli._run_folder import print_json
    from seismo3d.io.cubes import open_cube
    from seismo3d.io.summary import summarise

    opened = open_cube(cube, **reading)
    summary = summarise(opened)
    if json:
        print_json(summary)
        return
    width = 14
    for name, value in _lines(summary):
        typer.echo(f"{name:<{width}}{value}")


def _lines(s: dict[str, Any]) -> list[tuple[str, str]]:
    shape = " x ".join(str(n) for n in s["shape"])
    size = s["size_bytes"] / 2**20
    lines = [
        ("file", str(s["path"])),
        ("kind", f"{s['kind']}, {s['file_format']}, {shape}, {s['dtype']}, {size:.1f} MiB in memory"),
    ]
    for name, axis in s["axes"].items():
        unit = f" {s['unit']}" if name == s["domain"] else ""
        step = f", step {axis['step']:.8g}{unit}" if axis["step"] is not None else ""
        lines.append((name, f"{axis['first']:.8g} to {axis['last']:.8g}{unit}{step}, {axis['n']} of them"))
    if s["domain_reason"]:
        lines.append(("domain", f"{s['domain']} ({s['domain_reason']})"))
    lines += _segy_lines(s.get("segy"))
    lines += _data_lines(s["amplitude"], s["traces"])
    lines += _map_lines(s["map"])
    return lines + [("note", note) for note in s["notes"]]


# orders of traces that have no line to sort by
_ORDERS = {"unsorted": "in no order", "trace": "in one line"}


def _segy_lines(segy: dict[str, Any] | None) -> list[tuple[str, str]]:
    if segy is None:
        return []
    order = _ORDERS.get(segy["sorting"], f"{segy['sorting']}-sorted")
    lines = [
        ("format", str(segy["sample_format"])),
        ("file order", f"{segy['n_traces']} traces, {order}"),
    ]
    if segy["inline_byte"] is not None:
        where = f"inline {segy['inline_byte']}, crossline {segy['crossline_byte']} ({segy['header_bytes']})"
        lines.append(("header bytes", where))
    if segy["x_byte"] is not None:
        lines.append(("", f"x {segy['x_byte']}, y {segy['y_byte']}"))
    return lines


def _data_lines(amplitude: dict[str, Any], traces: dict[str, Any]) -> list[tuple[str, str]]:
    sampled = " (of a dozen lines spread over the cube)" if amplitude["sampled"] else ""
    if amplitude["min"] is None:
        words = "no sample with a value"
    else:
        words = f"{amplitude['min']:g} to {amplitude['max']:g}, mean {amplitude['mean']:g}, rms {amplitude['rms']:g}"
    bad = f", {amplitude['n_not_finite']} samples not finite" if amplitude["n_not_finite"] else ""
    counts = f"{traces['missing']} missing, {traces['dead']} dead{sampled}, {traces['duplicate']} duplicate"
    return [("amplitude", words + bad + sampled), ("traces", counts)]


def _map_lines(where: dict[str, Any] | None) -> list[tuple[str, str]]:
    if where is None:
        return [("map", "no map coordinates")]
    unit = where["unit"]
    if f"length_{unit}" in where:
        (x0, y0), (x1, y1) = where["first"], where["last"]
        length = f"{where[f'length_{unit}']:.0f} {unit} along the line"
        return [("map", f"({x0:.1f}, {y0:.1f}) to ({x1:.1f}, {y1:.1f}), {length}")]
    along, across = where[f"bin_size_{unit}"]
    hand = "right" if where["right_handed"] else "left"
    inlines, crosslines = where["inline_axis_azimuth_deg"], where["crossline_axis_azimuth_deg"]
    corners = " ".join(f"({x:.1f}, {y:.1f})" for x, y in where["corners"])
    return [
        ("bins", f"{along:.4g} {unit} from inline to inline, {across:.4g} {unit} from crossline to crossline"),
        (
            "azimuth",
            f"inlines grow towards {inlines:.2f} deg from north, crosslines towards {crosslines:.2f}; {hand}-handed",
        ),
        ("corners", corners),
        ("fit", f"coordinates within {where[f'fit_rms_{unit}']:.3g} {unit} rms of a regular grid"),
    ]
