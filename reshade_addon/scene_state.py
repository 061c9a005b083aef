"""What of a scene decides its render, as values that can be compared: equal states render the same picture.

Names do not count, so that a scene equals its copy. What is not known to be harmless counts, so that a difference may
be reported where there is none to be seen, never the reverse.
"""

import hashlib
from collections import Counter
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np

from .geometry import SOLID, SceneGeometry, read_geometry
from .render_depsgraph import with_render_depsgraph

# Of a datablock, node or socket: what only its editor shows.
_COSMETIC = {
    *("name", "label", "description", "location", "location_absolute", "width", "height", "dimensions", "select"),
    *("hide", "hide_value", "show_options", "show_preview", "show_texture", "show_expanded", "use_custom_color"),
    *("color_tag", "parent", "panel_states", "internal_links", "pin_gizmo", "display_shape", "is_icon_visible"),
    *("diffuse_color", "specular_color", "roughness", "metallic", "specular_intensity", "line_color", "line_priority"),
    *("preview_render_type", "use_preview_world", "use_fake_user", "use_extra_user", "tag", "node", "lineart"),
    *("texture_paint_images", "texture_paint_slots", "paint_active_slot", "paint_clone_slot", "warning_propagation"),
    *("library", "library_weak_reference", "override_library", "asset_data", "grease_pencil"),
    *("inputs", "outputs", "node_tree", "animation_data", "preview", "original", "rna_type", "image_user", "interface"),
}
_RAY_VISIBILITY = (
    *("visible_camera", "visible_diffuse", "visible_glossy", "visible_transmission", "visible_volume_scatter"),
    *("visible_shadow", "is_shadow_catcher", "is_holdout", "pass_index", "color"),
)


@dataclass(frozen=True, slots=True)
class SceneState:
    """A scene as its render depends on it."""

    geometry: SceneGeometry
    camera: Any
    world: Any
    lights: Counter[Any]
    surfaces: Counter[Any]  # where each is, how rays see it, its materials

    def same(self, other: "SceneState") -> bool:
        """Whether both render the same picture."""
        return (
            self.camera == other.camera
            and self.world == other.world
            and self.lights == other.lights
            and self.surfaces == other.surfaces
        )


def read_state(scene: bpy.types.Scene) -> SceneState:
    """Read what a scene's render depends on."""
    return with_render_depsgraph(scene, lambda depsgraph: _state(scene, depsgraph))


def _state(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> SceneState:
    geometry = read_geometry(depsgraph, _look)
    lights: Counter[Any] = Counter()
    surfaces: Counter[Any] = Counter(zip(geometry.shapes, geometry.notes, strict=True))
    for instance in depsgraph.object_instances:
        obj = instance.object
        matrix = np.array(instance.matrix_world).tobytes()
        if obj.type == "LIGHT":
            lights[matrix, _visibility(obj), _datablock(obj.data)] += 1
        elif obj.type not in SOLID and obj.type not in {"CAMERA", "EMPTY", "ARMATURE", "LATTICE", "SPEAKER"}:
            surfaces[matrix, obj.type, obj.data and obj.data.name] += 1
    camera = scene.camera.evaluated_get(depsgraph) if scene.camera else None
    return SceneState(
        geometry=geometry,
        camera=camera and (np.array(camera.matrix_world).tobytes(), _lens(camera.data)),
        world=_datablock(scene.world),
        lights=lights,
        surfaces=surfaces,
    )


def _look(obj: bpy.types.Object) -> Any:
    return _visibility(obj), tuple(_datablock(slot.material) for slot in obj.material_slots)


def _visibility(obj: bpy.types.Object) -> Any:
    return tuple(_value(getattr(obj, name)) for name in _RAY_VISIBILITY)


def _lens(camera: bpy.types.Camera) -> Any:
    names = ("type", "lens", "sensor_width", "sensor_height", "sensor_fit", "shift_x", "shift_y")
    focus = (camera.dof.focus_distance, camera.dof.aperture_fstop) if camera.dof.use_dof else None
    return tuple(getattr(camera, name) for name in names), camera.clip_start, camera.clip_end, focus


def _datablock(block: bpy.types.ID | None) -> Any:
    """The values of a material, light or world, with its node tree's."""
    if block is None:
        return None
    return _struct(block), _tree(block.node_tree) if block.node_tree else None


def _tree(tree: bpy.types.NodeTree) -> Any:
    nodes = tuple(
        (node.name, node.bl_idname, _struct(node), tuple(_struct(socket) for socket in (*node.inputs, *node.outputs)))
        + ((_tree(node.node_tree),) if getattr(node, "node_tree", None) else ())
        for node in tree.nodes
    )
    links = frozenset(
        (link.from_node.name, link.from_socket.identifier, link.to_node.name, link.to_socket.identifier, link.is_muted)
        for link in tree.links
    )
    return nodes, links


def _struct(struct: bpy.types.bpy_struct) -> Any:
    """The values of a struct's writable properties, and of the structs in it."""
    values = []
    for prop in struct.bl_rna.properties:
        if prop.identifier in _COSMETIC or prop.identifier.startswith("bl_") or getattr(prop, "is_deprecated", False):
            continue
        if prop.type in ("POINTER", "COLLECTION") or not prop.is_readonly:
            values.append((prop.identifier, _value(getattr(struct, prop.identifier))))
    return tuple(values)


def _value(value: Any) -> Any:
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, set):
        return frozenset(value)
    if isinstance(value, bpy.types.Image):
        return _image(value)
    if isinstance(value, bpy.types.Object):
        return np.array(value.matrix_world).tobytes()
    if isinstance(value, bpy.types.ID):
        return value.bl_rna.identifier
    if isinstance(value, bpy.types.bpy_struct):
        return _struct(value)
    return tuple(_value(item) for item in value)


def _image(image: bpy.types.Image) -> Any:
    """What a picture shows: its packed bytes, else its file; one edited and not yet saved is like no other."""
    packed = image.packed_file
    source = hashlib.blake2b(packed.data, digest_size=16).digest() if packed else bpy.path.abspath(image.filepath)
    unsaved = image.session_uid if image.is_dirty else 0
    return source, tuple(image.size), image.colorspace_settings.name, image.alpha_mode, unsaved
