"""One way through the code: the add-on imports the core, a stage imports earlier stages, nothing else."""

import ast
import sys
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

# Earlier to later: a module or package of the core may import those of the lines above its own, and inside a package no
# two modules may need each other. Put a new one on the earliest line it can stand on.
STAGES = (
    ("effort", "errors", "types"),
    ("camera", "color", "progress", "weighted"),
    ("radiance",),  # what lights send and surfaces make of it
    ("photo",),  # what a photo shows before any light is known
    ("highlights",),
    ("light",),
    ("materials",),
    ("reshading",),
    ("assembly",),
    ("settling",),
    ("pipeline",),
    ("report",),
)
RANK = {module: rank for rank, stage in enumerate(STAGES) for module in stage}
ALLOWED_IN_CORE = {"numpy", "scipy"}
ADDON_TOP = {"bpy", "bpy_extras", "mathutils", "gpu", "gpu_extras", "blf", "bl_ui", "numpy", "scipy", "OpenImageIO"}


def python_files(*folders: str) -> list[Path]:
    return sorted(path for folder in folders for path in (ROOT / folder).rglob("*.py"))


def relative(path: Path) -> str:
    return str(path.relative_to(ROOT))


def imports(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Level (0: absolute) and dotted name of each import, inside functions too; `from . import a` gives (1, "a")."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((0, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            if node.module:
                yield node.level, node.module
            else:
                yield from ((node.level, alias.name) for alias in node.names)


def resolved(path: Path, level: int, name: str) -> str:
    """The dotted path, from the extension's root, of what a relative import in the file `path` names."""
    package = path.relative_to(ROOT).parent.parts
    assert level <= len(package) + 1, f"{path}: an import leaves the extension"
    return ".".join([*package[: len(package) - level + 1], name])


def stdlib_or(allowed: set[str], name: str) -> bool:
    top = name.split(".")[0]
    return top in sys.stdlib_module_names or top in allowed


def test_every_module_of_the_core_has_its_place() -> None:
    modules = {path.relative_to(ROOT / "core").with_suffix("").parts[0] for path in python_files("core")}
    assert modules - {"__init__"} == set(RANK)


@pytest.mark.parametrize("path", python_files("core"), ids=relative)
def test_core_imports_only_earlier_stages(path: Path) -> None:
    inside = path.relative_to(ROOT / "core").with_suffix("").parts
    module = inside[0]
    for level, name in imports(ast.parse(path.read_text())):
        if level == 0:
            assert stdlib_or(ALLOWED_IN_CORE, name), f"core may not import {name}"
            continue
        target = resolved(path, level, name)
        assert target.startswith("core."), f"core may not import {target}"
        imported = target.split(".")[1]
        if imported == module:  # within a stage that is a package
            continue
        assert RANK[imported] < RANK[module], f"{module} may not import {imported}, which comes later"


@pytest.mark.parametrize("package", sorted(p.name for p in (ROOT / "core").iterdir() if (p / "__init__.py").exists()))
def test_no_two_modules_of_a_package_need_each_other(package: str) -> None:
    needs = {}
    for path in python_files(f"core/{package}"):
        found = [resolved(path, level, name) for level, name in imports(ast.parse(path.read_text())) if level]
        needs[path.stem] = {name.split(".")[2] for name in found if name.startswith(f"core.{package}.")}
    list(TopologicalSorter(needs).static_order())  # raises CycleError


@pytest.mark.parametrize("path", [ROOT / "__init__.py", *python_files("reshade_addon")], ids=relative)
def test_addon_reaches_the_core_by_relative_imports(path: Path) -> None:
    """Blender gives the extension's package its name, so an absolute import would find another or none."""
    for level, name in imports(ast.parse(path.read_text())):
        if level == 0:
            assert stdlib_or(ADDON_TOP, name), f"the add-on may not import {name}"
        else:
            assert resolved(path, level, name).split(".")[0] in {"core", "reshade_addon"}


@pytest.mark.parametrize("path", [ROOT / "__init__.py", *python_files("core", "reshade_addon")], ids=relative)
def test_nothing_edits_the_search_path(path: Path) -> None:
    """Blender's extension policy: other extensions share sys.path and sys.modules."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "sys":
            assert node.attr not in {"path", "meta_path", "path_hooks"}


def test_importing_the_root_does_not_import_blender() -> None:
    tree = ast.parse((ROOT / "__init__.py").read_text())
    assert (
        list(imports(ast.Module([node for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom)], [])))
        == []
    )
