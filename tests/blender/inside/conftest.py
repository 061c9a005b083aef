"""Fixtures for tests that run where Blender is and the extension is installed and enabled (see `../run_inside.py`)."""

import importlib
from types import ModuleType

import bpy
import pytest

MODULE = "bl_ext.user_default.reshade"


@pytest.fixture(scope="session")
def addon() -> ModuleType:
    """The installed extension's package, `bl_ext.user_default.reshade`: submodules by `importlib.import_module`."""
    return importlib.import_module(MODULE)


@pytest.fixture
def fresh_scene() -> bpy.types.Scene:
    """An empty scene in a new file: no objects, no materials, factory settings; the extension stays enabled."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    return bpy.context.scene
