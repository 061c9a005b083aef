"""A full copy of a scene, with all it uses, that lives as bytes or, for a while, beside the scene."""

import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import bpy

from .render_depsgraph import settings


@dataclass(frozen=True, slots=True)
class SceneCopy:
    """A scene, and its objects and materials by the names they have in the scene it is a copy of."""

    scene: bpy.types.Scene
    objects: Mapping[str, bpy.types.Object]
    materials: Mapping[str, bpy.types.Material]


def original(scene: bpy.types.Scene) -> SceneCopy:
    """The scene itself, in the form of its copies."""
    return SceneCopy(scene, bpy.data.objects, bpy.data.materials)


def packed(scene: bpy.types.Scene) -> bytes:
    """Copy a scene to the bytes of a .blend of its own, without what Reshade keeps on it."""
    with (
        tempfile.TemporaryDirectory() as folder,
        settings(scene.reshade, reference=None, photo=None, reshaded=None, card=None, painting=None, report=""),
    ):
        path = Path(folder) / "scene.blend"
        bpy.data.libraries.write(str(path), {scene}, path_remap="ABSOLUTE", compress=True)
        return path.read_bytes()


@contextmanager
def unpacked(data: bytes) -> Iterator[SceneCopy]:
    """A packed scene, beside what is open; it is gone, with all that was made meanwhile, when the block ends."""
    before = set(bpy.data.user_map())
    try:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "scene.blend"
            path.write_bytes(data)
            with bpy.data.libraries.load(str(path), link=False) as (found, wanted):
                objects, materials = list(found.objects), list(found.materials)
                # Blender puts what it loaded in place of the names in the lists it is given
                wanted.scenes, wanted.objects, wanted.materials = list(found.scenes), list(objects), list(materials)
        yield SceneCopy(
            scene=wanted.scenes[0],
            objects=dict(zip(objects, wanted.objects, strict=True)),
            materials=dict(zip(materials, wanted.materials, strict=True)),
        )
    finally:
        bpy.data.batch_remove(set(bpy.data.user_map()) - before)
