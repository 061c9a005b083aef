"""Remove highlights from the photo, from the selected surfaces' textures, or from any image."""

from collections.abc import Generator

import bpy

from ...core.errors import ReshadeError
from ...core.highlights import METHODS, Split, split
from ...core.progress import shifted
from ...core.types import Progress
from .. import highlights, missing, reference
from ..highlights_scene import split_scene
from ..jobs import Job

Found = list[tuple[bpy.types.Image, Split, str]]  # and what else there is to say


class RESHADE_OT_remove_highlights(Job, bpy.types.Operator):
    """Take the highlights out of the image shown here; in the 3D view out of the selected surfaces' textures, or, with
    none selected, out of the photo. The image itself is kept"""

    bl_idname = "reshade.remove_highlights"
    bl_label = "Remove Highlights"
    bl_options = {"REGISTER", "UNDO"}

    image: bpy.props.StringProperty(name="Image", description="The image's name; empty: the one at hand")
    method: bpy.props.EnumProperty(
        name="Method",
        description="Automatic, or one from the literature to compare it with",
        items=[(name, "Automatic" if name == "auto" else name.title(), "") for name in METHODS],
        default="auto",
    )
    use_scene: bpy.props.BoolProperty(
        name="Use Scene",
        description="Let the estimated light and the modelled geometry say where the photo's highlights are",
        default=True,
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """With an image at hand, or any at all for a script to name."""
        if context.window_manager.reshade.running:
            return missing.nothing(cls, context, missing.mode)
        if images_at_hand(context) or bpy.data.images:
            return True
        cls.poll_message_set("Import the photo, or open an image in an Image Editor")
        return False

    def steps(self, context: bpy.types.Context) -> Generator[Progress, None, Found]:
        """Split each image; nothing is changed."""
        images = [bpy.data.images.get(self.image)] if self.image else images_at_hand(context)
        if not images or images[0] is None:
            missing_one = f"There is no image '{self.image}'" if self.image else "There is no image at hand"
            raise ReshadeError(missing_one, "Import the photo, or open an image in an Image Editor")
        found = []
        for number, image in enumerate(images):
            photo, alpha = highlights.read(image)
            share = number / len(images), (number + 1) / len(images)
            if self._solved(context.scene, image):
                result = yield from shifted(split_scene(context.scene, photo), *share)
                gloss = ", ".join(one.in_words() for one in result.gloss)
                found.append((image, result.split, f" ({gloss})"))
            else:
                result = yield from shifted(split(photo, self.method, alpha > 0), *share)
                found.append((image, result, ""))
        return found

    def _solved(self, scene: bpy.types.Scene, image: bpy.types.Image) -> bool:
        """Whether a reference state tells more of this image than it does itself."""
        return self.use_scene and self.method == "auto" and image == scene.reshade.photo and reference.has(scene)

    def finish(self, context: bpy.types.Context, result: Found) -> str:
        """Keep what was found beside each image; where nothing was, leave the image."""
        said = []
        for image, found, more in result:
            if found.message:
                said.append(f"{image.name}: {found.message}")
            else:
                highlights.keep(image, found)
                said.append(f"{image.name}: highlights on {100 * float(found.mask().mean()):.2g} %{more}")
        return "; ".join(said)


def images_at_hand(context: bpy.types.Context) -> list[bpy.types.Image]:
    """The Image Editor's image; in a 3D view the textures of the selected objects' materials, else the photo."""
    space = context.space_data
    if space is not None and space.type == "IMAGE_EDITOR":
        return [highlights.original(space.image)] if space.image else []
    images = {}
    for obj in context.selected_objects if hasattr(context, "selected_objects") else ():
        for slot in obj.material_slots:
            for node in slot.material.node_tree.nodes if slot.material and slot.material.node_tree else ():
                if node.type == "TEX_IMAGE" and node.image:
                    image = highlights.original(node.image)
                    images[image.name] = image
    photo = context.scene.reshade.photo
    return list(images.values()) or ([photo] if photo else [])
