"""No pickle is ever loaded: read from the source of the whole package."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import seismo3d

ROOT = Path(seismo3d.__file__).parent
_MODULES = {"pickle", "cPickle", "dill", "cloudpickle", "joblib", "shelve", "marshal", "jsonpickle", "torch"}
_CALLS = {"load", "read_array", "open_memmap"}


def find_pickles(tree: ast.AST) -> list[str]:
    """Imports of modules that unpickle, and calls of NumPy's readers that do not say allow_pickle=False."""
    found = []
    for node in ast.walk(tree):
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
        found += [f"line {node.lineno}: import {name}" for name in names if name.split(".")[0] in _MODULES]
        if not isinstance(node, ast.Call):
            continue
        name, owner = _name(node.func)
        if name in ("eval", "exec") and not owner:
            found.append(f"line {node.lineno}: {name}")
        if name not in _CALLS or owner.split(".")[0] not in ("np", "numpy"):
            continue
        allowed = [word.value for word in node.keywords if word.arg == "allow_pickle"]
        if not (allowed and isinstance(allowed[0], ast.Constant) and allowed[0].value is False):
            found.append(f"line {node.lineno}: {owner}.{name} without allow_pickle=False")
    return found


def _name(func: ast.expr) -> tuple[str, str]:
    if isinstance(func, ast.Attribute):
        return func.attr, ast.unparse(func.value)
    return (func.id, "") if isinstance(func, ast.Name) else ("", "")


@pytest.mark.parametrize("path", sorted(ROOT.rglob("*.py")), ids=lambda path: str(path.relative_to(ROOT)))
def test_no_pickle(path):
    assert find_pickles(ast.parse(path.read_text(encoding="utf-8"))) == []


@pytest.mark.parametrize(
    "source",
    ["np.load(a)", "np.load(a, allow_pickle=True)", "numpy.lib.format.read_array(f)", "import pickle", "eval(a)",
     "from joblib import load", "np.load(a, allow_pickle=b)"],
)  # fmt: skip
def test_the_check_finds_them(source):
    assert find_pickles(ast.parse(source))


def test_the_check_lets_others_through():
    source = (
        "np.load(a, allow_pickle=False)\ncube.load()\njson.load(f)\nnp.lib.format.read_array(f, allow_pickle=False)"
    )
    assert find_pickles(ast.parse(source)) == []
