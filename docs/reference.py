"""Pages that are made from the package itself: the reference, the measurements of the README, and the notebooks."""

from __future__ import annotations

import importlib
import inspect
import json
import pkgutil
import re
from pathlib import Path
from types import ModuleType
from typing import Any

import seismo3d

_NAMESPACES = (
    "seismo3d",
    "seismo3d.plot",
    "seismo3d.robot",
    "seismo3d.synthetic",
    "seismo3d.terrain",
    "seismo3d.viewer",
)
_PARTS = {
    "geometry": "Axes, surveys, rotations and meshes",
    "io": "Files",
    "synthetic": "Synthetic data",
    "features": "The matcher",
    "registration": "Registration",
    "graph": "The registration graph",
    "seismic": "Faults, layers and tracks",
    "terrain": "Terrain",
    "robot": "Robot",
    "plot": "Pictures",
    "viewer": "The viewer",
    "experiments": "Measurements",
}


def write_pages(docs: Path) -> None:
    """Write all generated pages; files that would not change are left alone, so that a second build is quick."""
    made = docs / "generated"
    made.mkdir(exist_ok=True)
    modules = find_modules()
    pages = {"public.md": public_page(modules)}
    for part, title in [("", "Errors and scans"), *_PARTS.items()]:
        chosen = [module for module in modules if _part_of(module.__name__) == part]
        if chosen:
            pages[f"{part or 'top'}.rst"] = part_page(title, chosen)
    parts = [name.removesuffix(".rst") for name in pages if name.endswith(".rst")]
    pages["index.md"] = index_page(parts)
    pages["measured.md"] = measured_page(docs.parent / "README.md")
    names = sorted((docs.parent / "notebooks").glob("*.ipynb"))
    for path in names:
        pages[f"{path.stem}.md"] = notebook_page(path, docs / "gallery")
    pages["gallery.md"] = gallery_page(names, docs / "gallery")
    for name, text in pages.items():
        if not (made / name).is_file() or (made / name).read_text(encoding="utf-8") != text:
            (made / name).write_text(text, encoding="utf-8")
    for path in made.iterdir():
        if path.name not in pages:
            path.unlink()


def find_modules() -> list[ModuleType]:
    """Import every public module of the package."""
    names = ["seismo3d"]
    names += [entry.name for entry in pkgutil.walk_packages(seismo3d.__path__, "seismo3d.")]
    public = [name for name in names if not any(part.startswith("_") for part in name.split("."))]
    return [importlib.import_module(name) for name in public if ".cli" not in name]


def own_members(module: ModuleType) -> list[str]:
    """Public functions and classes that a module itself defines, or is the only public one to offer."""
    members = []
    for name, value in vars(module).items():
        if name.startswith("_") or not (inspect.isfunction(value) or inspect.isclass(value)):
            continue
        origin = value.__module__
        is_private = origin.startswith("seismo3d") and any(part.startswith("_") for part in origin.split("."))
        if origin == module.__name__ or (is_private and name in getattr(module, "__all__", ())):
            members.append(name)
    return members


def full_names(modules: list[ModuleType]) -> dict[int, str]:
    """Return the documented name of every function and class, by the identity of the object."""
    return {id(getattr(m, name)): f"{m.__name__}.{name}" for m in modules for name in own_members(m)}


def public_names() -> list[tuple[str, str, Any]]:
    """Return namespace, name and object of everything in an ``__all__`` of the public interface."""
    found = []
    for namespace in _NAMESPACES:
        module = importlib.import_module(namespace)
        found += [(namespace, name, getattr(module, name)) for name in sorted(module.__all__, key=str.lower)]
    return found


def public_page(modules: list[ModuleType]) -> str:
    """Write the page that lists the public interface."""
    documented = full_names(modules)
    lines = [
        "# The public interface",
        "",
        "What `import seismo3d as s3` offers; each name is imported when it is used.",
        "",
    ]
    for namespace in _NAMESPACES:
        lines += [f"## `{namespace}`", "", "| name | what |", "| --- | --- |"]
        for space, name, value in public_names():
            if space == namespace and not name.startswith("__"):
                lines.append(f"| {_link(name, value, documented)} | {_first_sentence(value)} |")
        lines.append("")
    return "\n".join(lines)


def _link(name: str, value: Any, documented: dict[int, str]) -> str:
    if inspect.ismodule(value):
        return f"{{py:mod}}`{name} <{value.__name__}>`"
    if id(value) not in documented:
        return f"`{name}`"
    return f"{{py:{'class' if inspect.isclass(value) else 'func'}}}`{name} <{documented[id(value)]}>`"


def _first_sentence(value: Any) -> str:
    if not (inspect.ismodule(value) or inspect.isfunction(value) or inspect.isclass(value)):
        return f"`{value!r}`"[:120]
    text = (inspect.getdoc(value) or "").split("\n\n")[0]
    return " ".join(re.sub(r":\w+:`~?([^`]+)`", r"`\1`", text).split()).replace("|", "\\|")


def _part_of(name: str) -> str:
    words = name.split(".")
    return words[1] if len(words) > 1 and words[1] in _PARTS else ""


def part_page(title: str, modules: list[ModuleType]) -> str:
    """Write the reference of some modules."""
    lines = [title, "=" * len(title), ""]
    for module in modules:
        members = own_members(module)
        if not members and module.__name__.count(".") != 1:
            continue
        lines += [module.__name__, "-" * len(module.__name__), "", f".. automodule:: {module.__name__}", ""]
        for name in members:
            value = getattr(module, name)
            kind = "autoclass" if inspect.isclass(value) else "autofunction"
            lines += [f".. {kind}:: {module.__name__}.{name}"]
            if kind == "autoclass":
                shown = _methods(value)
                lines += [f"   :members: {', '.join(shown)}"] if shown else []
            lines.append("")
    return "\n".join(lines)


def _methods(value: type) -> list[str]:
    """Return methods and properties that a class itself documents; fields are told by its own docstring."""
    kinds = (property, classmethod, staticmethod)
    return [
        name
        for name, entry in vars(value).items()
        if not name.startswith("_")
        and (inspect.isfunction(entry) or isinstance(entry, kinds))
        and inspect.getdoc(getattr(value, name))
    ]


def index_page(parts: list[str]) -> str:
    """Write the page that leads to the reference."""
    lines = ["# Reference", "", "Made from the docstrings.", "", "```{toctree}", ":maxdepth: 1", "", "public"]
    return "\n".join([*lines, *parts, "```", ""])


def measured_page(readme: Path) -> str:
    """Take the measurements out of the README, so that there is one place where they are kept."""
    text = readme.read_text(encoding="utf-8")
    section = text[text.index("\n## Measured\n") + 1 :]
    section = section[: section.index("\n## ", 4)]
    return section.replace("## Measured", "# Faults on cubes with exact truth", 1)


def notebook_page(path: Path, pictures: Path) -> str:
    """Turn a notebook into a page, with a picture that it draws."""
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    lines = []
    for cell in cells:
        source = "".join(cell["source"])
        lines += [source if cell["cell_type"] == "markdown" else f"```python\n{source}\n```", ""]
    if (pictures / f"{path.stem}.png").is_file():
        lines += [f"![A picture of this notebook](../gallery/{path.stem}.png)", ""]
    return "\n".join(lines)


def gallery_page(notebooks: list[Path], pictures: Path) -> str:
    """Write the page of pictures that lead to the notebooks."""
    lines = ["# Gallery", "", "Each picture is drawn by a notebook of the folder `notebooks`.", ""]
    for path in notebooks:
        title = _title(path)
        lines += [f"## [{title}]({path.stem}.md)", ""]
        if (pictures / f"{path.stem}.png").is_file():
            lines += [f"![{title}](../gallery/{path.stem}.png)", ""]
    lines += ["```{toctree}", ":hidden:", "", *(path.stem for path in notebooks), "```", ""]
    return "\n".join(lines)


def _title(path: Path) -> str:
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    for cell in cells:
        for line in cell["source"]:
            if line.startswith("# "):
                return line[2:].strip()
    return path.stem
