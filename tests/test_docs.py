"""The documentation: every public name is in the reference, and pages lead to what is there."""

from __future__ import annotations

import importlib.util
import inspect
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"


@pytest.fixture(scope="module")
def reference():
    spec = importlib.util.spec_from_file_location("reference", DOCS / "reference.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def modules(reference):
    return reference.find_modules()


def test_every_public_name_is_documented(reference, modules):
    documented = reference.full_names(modules)
    page = reference.public_page(modules)
    for _, name, value in reference.public_names():
        if inspect.isfunction(value) or inspect.isclass(value):
            assert id(value) in documented, name
        if not name.startswith("__"):
            assert f"`{name}" in page


def test_every_documented_name_has_a_docstring(reference, modules):
    for module in modules:
        assert inspect.getdoc(module), module.__name__
        for name in reference.own_members(module):
            assert inspect.getdoc(getattr(module, name)), f"{module.__name__}.{name}"


def test_every_module_is_on_one_page(reference, modules):
    shown = [reference._part_of(module.__name__) for module in modules]
    assert set(shown) <= {"", *reference._PARTS}
    text = "".join(reference.part_page(part or "top", [m for m in modules if reference._part_of(m.__name__) == part])
                   for part in set(shown))  # fmt: skip
    for module in modules:
        for name in reference.own_members(module):
            assert text.count(f":: {module.__name__}.{name}\n") == 1


def test_links_and_pictures_are_there():
    for page in DOCS.rglob("*.md"):
        if {"_build", "generated"} & set(page.parts):
            continue
        for target in re.findall(r"\]\(([^)#]+)\)", page.read_text(encoding="utf-8")):
            assert target.startswith("http") or (page.parent / target).is_file(), f"{page.name}: {target}"


def test_the_measurements_are_those_of_the_readme(reference):
    page = reference.measured_page(ROOT / "README.md")
    assert page.startswith("# Faults on cubes")
    assert "| kind | F1 |" in page
    assert "## Limits" not in page


def test_every_notebook_has_its_picture(reference):
    notebooks = sorted((ROOT / "notebooks").glob("*.ipynb"))
    page = reference.gallery_page(notebooks, DOCS / "gallery")
    assert page.count("![") == len(notebooks)
    for path in notebooks:
        assert "```python" in reference.notebook_page(path, DOCS / "gallery")


def test_the_command_line_page_names_every_command():
    page = (DOCS / "command_line.md").read_text(encoding="utf-8")
    names = [path.stem for path in (ROOT / "seismo3d" / "cli").glob("[a-z]*.py") if path.stem != "app"]
    missing = [name for name in names if f"`seismo3d {name.replace('_', '-')}" not in page]
    assert missing == []
