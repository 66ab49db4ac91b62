from __future__ import annotations

import base64
import io
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fake_faults import make_cube, make_faults, make_section
from PIL import Image

from seismo3d import plot
from seismo3d.errors import ShapeError
from seismo3d.plot import rendering
from seismo3d.plot.network_pictures import save_network_pictures
from seismo3d.plot.picture_set import save_pictures
from seismo3d.plot.run_reports import ReportPage, network_page, write_page
from seismo3d.seismic.faultset import FaultSet
from seismo3d.seismic.network import fracture_network


class Page(HTMLParser):
    """Collects tags, texts and addresses; complains about tags that are not closed in order."""

    VOID = frozenset(("meta", "img", "br", "link", "input", "hr"))

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.counts: dict[str, int] = {}
        self.addresses: list[str] = []
        self.texts: list[str] = []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.counts[tag] = self.counts.get(tag, 0) + 1
        self.addresses += [value or "" for name, value in attrs if name in ("src", "href", "action", "srcset")]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.texts.append(data.strip())


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list]:  # type: ignore[type-arg]
    folder = tmp_path_factory.mktemp("pictures")
    cube = make_cube()
    return folder, save_pictures(folder, cube, faults=make_faults(cube))


def test_pictures_of_a_cube(drawn: tuple[Path, list]) -> None:  # type: ignore[type-arg]
    folder, pictures = drawn
    names = [picture.path.name for picture in pictures]
    assert names[0] == "scene.png"
    assert re.fullmatch(r"section_inline_\d+\.png", names[1])
    assert re.fullmatch(r"section_crossline_\d+\.png", names[2])
    assert names[3:] == ["time_slice.png", "throw_map.png", "strike.png", "throw.png"]
    assert sorted(entry.name for entry in folder.iterdir()) == sorted(names)
    # which pages show the pictures, and whether with a table in these colours, is not theirs to say
    assert pictures[3].caption == "Time 1120 ms: one colour a fault."
    for picture in pictures:
        with Image.open(picture.path) as image:
            pixels = np.asarray(image.convert("RGB")).astype(int)
        assert min(pixels.shape[:2]) >= 400
        assert (np.ptp(pixels, axis=2) > 60).mean() > 0.002  # faults are in colour
        assert picture.caption
    with Image.open(pictures[1].path) as image:
        halves = np.ptp(np.asarray(image.convert("RGB")).astype(int), axis=2) > 60
    middle = halves.shape[1] // 2
    assert halves[:, :middle].sum() == 0  # as recorded
    assert halves[:, middle:].sum() > 500


def test_report_is_self_contained_and_whole(drawn: tuple[Path, list], tmp_path: Path) -> None:  # type: ignore[type-arg]
    cube = make_cube().assign_attrs(notes=["the binary header says feet"])
    faults = make_faults(cube)
    run = {"input": {"file": "a<b>.sgy"}, "timings_s": {"scan": 12.345}, "versions": {"seismo3d": "0.1.0"}}
    path = plot.write_report(
        tmp_path / "report.html", cube, faults=faults, title="Faults in a<b>.sgy", pictures=drawn[1], run=run
    )
    text = path.read_text(encoding="utf-8")
    page = Page(text)
    assert page.counts["img"] == len(drawn[1])
    assert all(address.startswith("data:image/png;base64,") for address in page.addresses)
    assert not re.search(r"(https?:)?//[a-z]", re.sub(r"base64,[A-Za-z0-9+/=]+", "", text))
    for address in page.addresses:
        with Image.open(io.BytesIO(base64.b64decode(address.split(",", 1)[1]))) as image:
            image.verify()
    assert "<b>" not in text.split("<body>")[1].split('<div class="numbers">')[0]  # the name is escaped
    for words in (
        "Faults in a<b>.sgy",
        "the binary header says feet",
        "2",
        "faults found",
        "16 ms",
        "largest mean throw of a fault",
        "12.3 s",
        "normal",
        "reverse",
        "threshold",
        "0.62 km",
    ):
        assert words in page.texts, words
    table = text[text.index('id="faults"') : text.index("</table>", text.index('id="faults"'))]
    assert table.count("<tr>") == 3
    assert 'data-key="16.037' in table  # sorted by the whole number, shown as 16.0


def test_throws_of_a_thousand_feet_are_no_powers_of_ten(tmp_path: Path) -> None:
    cube = make_cube().rename(time="depth")
    cube.attrs["sample_unit"] = "ft"
    faults = make_faults(cube)
    high = tuple(replace(surface, sample_interval=400.0, sample_unit="ft") for surface in faults.surfaces)
    path = plot.write_report(tmp_path / "r.html", cube, faults=replace(faults, surfaces=high), pictures=[])
    assert "1,604 ft" in Page(path.read_text(encoding="utf-8")).texts


def test_strikes_that_round_to_a_full_turn_are_0(tmp_path: Path) -> None:
    cube = make_cube()
    faults = make_faults(cube)
    surface = faults.surfaces[0]
    north = replace(faults, surfaces=(replace(surface, strike_deg=np.full_like(surface.strike_deg, 359.7)),))
    path = plot.write_report(tmp_path / "r.html", cube, faults=north, pictures=[])
    text = path.read_text(encoding="utf-8")
    assert "0° / 180°" in Page(text).texts
    assert re.search(r'<td data-key="359\.[67]\d*">0</td>', text)


def test_scene_falls_back_to_a_sketch_and_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rendering, "find_windowless", lambda: ("", "no OpenGL here"))
    cube = make_cube()
    faults = make_faults(cube)
    pictures = save_pictures(tmp_path, cube, faults=faults)
    assert "without OpenGL" in pictures[0].note
    with Image.open(pictures[0].path) as image:
        assert (np.ptp(np.asarray(image.convert("RGB")).astype(int), axis=2) > 60).mean() > 0.01
    text = plot.write_report(tmp_path / "r.html", cube, faults=faults, pictures=pictures).read_text(encoding="utf-8")
    assert "no OpenGL here" in text
    assert 'class="note"' in text


def test_report_of_a_section_and_of_no_faults(tmp_path: Path) -> None:
    section, faults = make_section()
    text = plot.write_report(tmp_path / "a.html", section, faults=faults).read_text(encoding="utf-8")
    page = Page(text)
    assert page.counts["img"] == 2
    assert "fault found" in page.texts
    empty = FaultSet((), *(section.copy(data=np.zeros(section.shape, t)) for t in ("f4", "i4", "f4")))
    text = plot.write_report(tmp_path / "b.html", section, faults=empty).read_text(encoding="utf-8")
    assert "No fault was found" in text
    assert '<table class="faults"' not in text


def test_bare_array_in_depthless_samples(tmp_path: Path) -> None:
    values = make_cube().values
    faults = make_faults(values)
    pictures = save_pictures(tmp_path, values, faults=faults)
    assert "from the inline axis" in pictures[5].caption


def test_report_refuses_faults_of_another_cube(tmp_path: Path) -> None:
    cube = make_cube()
    with pytest.raises(ShapeError, match="Give the cube"):
        plot.write_report(tmp_path / "r.html", cube[:4], faults=make_faults(cube))


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")
@pytest.mark.parametrize("width", [1300, 900, 400])
def test_key_numbers_stay_within_their_tiles(browser: Any, tmp_path: Path, width: int) -> None:
    numbers = [(value, "what it is") for value in ("12,345", "-1,230 ft", "12.35 km", "51°", "134° / 314°", "2.73 %")]
    path = write_page(tmp_path / "report.html", ReportPage("Faults", "in a cube", numbers))
    page = browser.new_page(viewport={"width": width, "height": 900})
    page.goto(path.as_uri())
    rooms = page.evaluate("""() => [...document.querySelectorAll(".numbers b")].map((number) => {
        const text = document.createRange();
        text.selectNodeContents(number);
        return number.getBoundingClientRect().right - text.getBoundingClientRect().right;
    })""")
    page.close()
    assert len(rooms) == 6
    assert min(rooms) >= 0


def test_pictures_of_a_cube_without_faults_promise_none(tmp_path: Path) -> None:
    cube = make_cube()
    none = FaultSet((), *(cube.copy(data=np.zeros(cube.shape, t)) for t in ("f4", "i4", "f4")))
    pictures = save_pictures(tmp_path, cube, faults=none)
    assert [picture.path.name for picture in pictures] == [
        "scene.png", "section_inline_128.png", "section_crossline_519.png", "time_slice.png",
    ]  # fmt: skip
    assert not any("fault" in picture.caption.lower() for picture in pictures)
    section = make_section()[0]
    none = FaultSet((), *(section.copy(data=np.zeros(section.shape, t)) for t in ("f4", "i4", "f4")))
    assert [picture.caption for picture in save_pictures(tmp_path, section, faults=none)] == ["The section."]


def test_colours_of_the_table_are_said_to_be_where_they_are(tmp_path: Path) -> None:
    cube = make_cube()
    in_depth = cube.rename(time="depth")
    section, of_section = make_section()
    for number, (shown, faults, place) in enumerate(
        ((cube, make_faults(cube), "time slice"), (in_depth, make_faults(in_depth), "depth slice"),
         (section, of_section, None))
    ):  # fmt: skip
        path = plot.write_report(tmp_path / f"{number}.html", shown, faults=faults, pictures=[])
        text = path.read_text(encoding="utf-8")
        assert re.findall(r"its colour on the (\w+ \w+)", text) == ([place] if place else [])
        assert ('class="chip"' in text) == (place is not None)


def test_the_report_of_a_network_says_what_its_dips_are(tmp_path: Path) -> None:
    in_time = make_cube()
    in_depth = in_time.rename(time="depth").assign_attrs(sample_unit="m")
    for cube, is_true in ((in_time, False), (in_depth, True), (in_depth.drop_vars(["cdp_x", "cdp_y"]), False)):
        faults = make_faults(cube)
        network = fracture_network(faults)
        pictures = save_network_pictures(tmp_path, network, faults)
        page = network_page(network, None, cube, title="Network", pictures=pictures, run={})
        assert ("in bins and samples" in dict(page.meanings)["Strike and dip"]) is not is_true
        (net,) = (picture for picture in pictures if picture.path.name == "stereonet.png")
        assert net.caption.endswith("dips in bins and samples.") is not is_true
