"""Access to a scene exactly as the renderer sees it: render levels of modifiers, render visibility, instances.

Python can get a viewport depsgraph anywhere, but a render one only inside a render engine. So a small engine is
registered for the moment, and asked to render.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

import bpy

Result = TypeVar("Result")


@contextmanager
def settings(owner: Any, **values: Any) -> Iterator[None]:
    """Set attributes of a Blender struct, in the given order, and put the old values back afterwards."""
    before = {name: getattr(owner, name) for name in values}
    try:
        for name, value in values.items():
            setattr(owner, name, value)
        yield
    finally:
        for name, value in before.items():
            setattr(owner, name, value)


def first_layer(scene: bpy.types.Scene) -> bpy.types.ViewLayer:
    """The view layer that is rendered: the first that is enabled, or the first."""
    return next((layer for layer in scene.view_layers if layer.use), scene.view_layers[0])


def with_render_depsgraph(scene: bpy.types.Scene, read: Callable[[bpy.types.Depsgraph], Result]) -> Result:
    """Call `read` with the scene's render depsgraph and return its result; what it raises is raised here."""
    results: list[Result] = []
    errors: list[BaseException] = []

    class Reader(bpy.types.RenderEngine):
        bl_idname = "RESHADE_READER"
        bl_label = "Reshade reader"

        def render(self, depsgraph: bpy.types.Depsgraph) -> None:
            # Blender prints and drops what a render engine raises.
            try:
                results.append(read(depsgraph))
            except BaseException as error:
                errors.append(error)

    bpy.utils.register_class(Reader)
    try:
        with settings(
            scene.render,
            engine=Reader.bl_idname,
            use_compositing=False,
            use_sequencer=False,
            use_border=False,
            use_multiview=False,
            use_freestyle=False,
        ):
            bpy.ops.render.render(scene=scene.name, layer=first_layer(scene).name)
    finally:
        bpy.utils.unregister_class(Reader)
    if errors:
        raise errors[0]
    return results[0]
