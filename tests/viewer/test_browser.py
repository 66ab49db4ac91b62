"""The page in a real Chromium: what a person does, and what is on the screen after it."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

import seismo3d as s3
from seismo3d.viewer import show
from seismo3d.viewer.storage import open_session

pytest.importorskip("trame_vtk")
playwright = pytest.importorskip("playwright.sync_api")
pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")


@pytest.fixture
def segy(tmp_path, cube):
    return s3.open_cube(s3.write_segy(tmp_path / "cube.sgy", cube.copy(data=np.nan_to_num(cube.values))))


@pytest.fixture
def faulted(segy, faults):
    names = ("likelihood", "labels", "throw")
    volumes = [segy.copy(data=np.asarray(getattr(faults, name).data)) for name in names]
    return s3.FaultSet(faults.surfaces, *volumes, settings={})


@pytest.fixture
def pages(browser):
    """Open pages of viewers, and fail where a page met an error."""
    opened, problems = [], []

    def visit(viewer):
        page = browser.new_page(viewport={"width": 1400, "height": 900})
        page.on("pageerror", lambda error: problems.append(str(error)))
        page.goto(viewer.url)
        page.wait_for_selector("[data-panel=inline] image[href^=data]", timeout=60_000)
        opened.append((page, viewer))
        return page

    yield visit
    for page, viewer in opened:
        page.close()
        viewer.stop()
    assert problems == []


def says(page, words):
    playwright.expect(page.locator(".s3-status")).to_contain_text(words, timeout=60_000)


def click(page, panel, column, row, *, times=1):
    """Click a place of a panel, in index units from the corner where its indices begin."""
    view = page.locator(f"[data-panel={panel}] svg.s3-view")
    _, _, columns, rows = (float(word) for word in view.get_attribute("viewBox").split())
    box = view.bounding_box()
    if panel == "sample":
        # the survey is right-handed: its inlines go upwards
        row = rows - row
    # at the very place, past what lies on it: the drawing has no parts that take clicks
    at = box["x"] + column / columns * box["width"], box["y"] + row / rows * box["height"]
    page.mouse.click(*at, click_count=times)


def names(page):
    return page.locator("tr[data-row] td:first-child").all_inner_texts()


def test_a_slice_moves_with_its_slider(pages, segy, faulted):
    page = pages(show(segy, faulted, open_browser=False))
    label = page.locator("[data-panel=inline] .s3-label")
    assert label.inner_text() == "Inline 130"
    image = page.locator("[data-panel=inline] image")
    before = image.get_attribute("href")
    page.locator("[data-panel=inline] .s3-slider").fill("4")
    playwright.expect(label).to_have_text("Inline 108")
    assert image.get_attribute("href") != before
    line = page.locator("[data-panel=sample] line").nth(1)
    playwright.expect(line).to_have_attribute("y1", "4.5")
    page.locator("[data-panel=inline] .s3-step").nth(1).click()
    playwright.expect(label).to_have_text("Inline 110")
    assert page.locator("[data-panel=inline] .s3-fault").count() == 2


def test_the_slice_from_above_lies_as_on_the_map(pages, segy, faulted):
    page = pages(show(segy, faulted, open_browser=False))
    assert page.locator("[data-panel=sample] .s3-sides span").all_inner_texts() == ["158", "Inline", "100"]
    # past the faults: the fifth inline and the eleventh crossline
    click(page, "sample", 10.5, 4.5)
    says(page, "slices moved")
    playwright.expect(page.locator("[data-panel=inline] .s3-label")).to_have_text("Inline 108")
    playwright.expect(page.locator("[data-panel=crossline] .s3-label")).to_have_text("Crossline 510")
    view, line = (page.locator(f"[data-panel=sample] {part}").last.bounding_box() for part in ("svg.s3-view", "line"))
    from_below = (view["y"] + view["height"] - line["y"]) / view["height"]
    assert from_below == pytest.approx(4.5 / 30, abs=0.01)


def test_a_click_on_a_reflector_traces_a_track(pages, segy):
    page = pages(show(segy, open_browser=False))
    page.locator("[data-mode=seed]").click()
    playwright.expect(page.locator("[data-mode=seed]")).to_have_class("s3-on")
    click(page, "inline", 10.5, 27.5)
    says(page, "horizon 1 traced on")
    track = page.locator("[data-panel=inline] .s3-horizon")
    assert track.get_attribute("d").startswith("M")
    assert names(page) == ["horizon 1"]
    page.locator("[data-do=undo]").click()
    says(page, "undone: trace horizon 1")
    playwright.expect(track).to_have_count(0)


def test_a_double_click_is_one_click(pages, segy, faulted):
    page = pages(show(segy, faulted, open_browser=False))
    click(page, "sample", 20.75, 5.0, times=2)
    says(page, "fault 1 selected")
    playwright.expect(page.locator("[data-panel=sample] .s3-selected")).to_have_count(1)
    page.locator("[data-mode=stick]").click()
    playwright.expect(page.locator("[data-mode=stick]")).to_have_class("s3-on")
    click(page, "inline", 10.5, 12.0, times=2)
    says(page, "1 point picked")
    click(page, "inline", 10.5, 27.5)
    says(page, "2 points picked")


def test_what_is_double_clicked_is_deleted_or_merged_once(pages, segy, faulted):
    page = pages(show(segy, faulted, open_browser=False))
    status = page.locator(".s3-status")
    for button, rows, words in (("merge", ("1", "2"), "merge 1, 2"), ("delete", ("3",), "delete 3")):
        for row in rows if button == "merge" else ():
            page.locator(f"tr[data-row='{row}']").click()
        playwright.expect(page.locator("tr.s3-chosen")).to_have_count(len(rows))
        page.locator(f"[data-do={button}]").dblclick()
        says(page, words)
        # the answer to a second click would be here by then
        page.wait_for_timeout(500)
        assert status.inner_text() == words
        assert "s3-bad" not in status.get_attribute("class")


def test_numbers_of_the_list_have_their_trailing_zeros(pages, segy, faulted):
    page = pages(show(segy, faulted, open_browser=False))
    cells = [page.locator(f"tr[data-row='{row}'] td").all_inner_texts()[2:] for row in ("1", "2")]
    assert cells == [["16.0 ms", "63.4", "0.80"], ["-8.0 ms", "75.0", "0.50"]]


def test_a_stick_is_picked_and_traced(pages, segy, faulted):
    page = pages(show(segy, faulted, open_browser=False))
    page.locator("[data-mode=stick]").click()
    trace = page.locator("[data-do=trace]")
    playwright.expect(trace).to_be_disabled()
    for row in (12.0, 25.0, 38.0):
        click(page, "inline", 20.5 + 0.5 * (row - 25.0), row)
    playwright.expect(page.locator("[data-panel=inline] .s3-point")).to_have_count(3)
    trace.click()
    says(page, "the stick lies on fault 1, which is selected now")
    playwright.expect(page.locator("[data-panel=inline] .s3-selected")).to_have_count(1)


def test_a_surface_is_deleted_brought_back_and_the_session_saved_and_reopened(pages, segy, faulted, tmp_path):
    folder = tmp_path / "kept"
    page = pages(show(segy, faulted, folder=folder, open_browser=False))
    assert names(page) == ["fault 1", "fault 2"]
    click(page, "sample", 20.75, 5.0)
    says(page, "fault 1 selected")
    page.locator("[data-do=delete]").click()
    says(page, "delete 1")
    assert names(page) == ["fault 2"]
    page.locator("[data-do=undo]").click()
    says(page, "undone: delete 1")
    assert names(page) == ["fault 1", "fault 2"]
    page.locator("[data-do=redo]").click()
    says(page, "done again: delete 1")
    page.locator("[data-do=save]").click()
    says(page, "saved in")
    playwright.expect(page.locator("[data-do=save]")).to_have_text("Saved")

    back = open_session(folder)
    again = pages(show(back.cube, back.faults, tracks=back.tracks, folder=folder, open_browser=False))
    assert names(again) == ["fault 1"]
    assert again.locator("tr[data-row] td").nth(1).inner_text() == str(round(faulted.surfaces[1].area))


def test_colours_merge_split_and_the_throw_map(pages, segy, faulted):
    page = pages(show(segy, faulted, open_browser=False))
    strokes = page.locator("[data-panel=sample] .s3-fault")
    for attribute in ("likelihood", "confidence", "dip", "strike", "fault"):
        page.locator("[data-choice=attribute]").select_option(attribute)
        page.wait_for_function("(a) => document.querySelector('[data-choice=attribute]').value === a", arg=attribute)
        assert strokes.count() >= 1
    page.locator("tr[data-row='1']").click()
    page.locator("tr[data-row='2']").click()
    page.locator("[data-do=merge]").click()
    says(page, "merge 1, 2")
    assert names(page) == ["fault 3"]
    page.locator("[data-mode=split]").click()
    click(page, "sample", 2.0, 10.5)
    click(page, "sample", 38.0, 10.5)
    says(page, "split fault 3")
    assert names(page) == ["fault 4", "fault 5"]
    page.locator("[data-view=map]").click()
    playwright.expect(page.locator("img.s3-map")).to_be_visible()


def test_the_3d_scene_is_drawn(pages, segy, faulted):
    page = pages(show(segy, faulted, open_browser=False))
    canvas = page.locator(".s3-scene canvas").first
    playwright.expect(canvas).to_be_visible(timeout=30_000)
    shades = set()
    for _ in range(40):
        picture = np.asarray(Image.open(io.BytesIO(canvas.screenshot())).convert("RGB"))
        shades = {tuple(colour) for colour in picture[::6, ::6].reshape(-1, 3)}
        if len(shades) > 40:
            break
        page.wait_for_timeout(500)
    assert len(shades) > 40


def test_a_lazy_cube_is_shown_coarse_and_then_sharp(pages, segy, monkeypatch):
    monkeypatch.setattr("seismo3d.viewer.page._COARSE", 8)
    lazy = segy.chunk({"inline": 5}).drop_vars(["live"])
    viewer = show(lazy, open_browser=False)
    assert viewer.session.reader.is_lazy
    page = pages(viewer)
    sizes = """() => new Promise((done) => { const image = new Image(); image.onload = () =>
        done([image.naturalWidth, image.naturalHeight]);
        image.src = document.querySelector('[data-panel=crossline] image').getAttribute('href'); })"""
    page.wait_for_function(f"({sizes})().then((s) => s[0] === 30 && s[1] === 50)")
    page.locator("[data-panel=crossline] .s3-slider").fill("7")
    playwright.expect(page.locator("[data-panel=crossline] .s3-label")).to_have_text("Crossline 507")
    page.wait_for_function(f"({sizes})().then((s) => s[0] === 30 && s[1] === 50)")


def test_a_page_that_is_reloaded_goes_on(pages, segy, faulted):
    page = pages(show(segy, faulted, open_browser=False))
    page.locator("tr[data-row='1']").click()
    page.locator("[data-do=delete]").click()
    says(page, "delete 1")
    page.reload()
    page.wait_for_selector("[data-panel=inline] image[href^=data]", timeout=30_000)
    assert names(page) == ["fault 2"]
    page.locator("[data-do=undo]").click()
    says(page, "undone: delete 1")


def test_without_the_token_there_is_no_page(browser, segy):
    viewer = show(segy, open_browser=False)
    page = browser.new_page()
    answer = page.goto(viewer.url.split("?")[0])
    assert answer.status == 403
    assert "token" in page.content()
    page.close()
    viewer.stop()
