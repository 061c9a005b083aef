"""The sidebar tab: the artist's story from top to bottom, a panel a step."""

import math
import textwrap
from typing import Any

import bpy

from ..core.light.uncertainty import plain
from . import missing
from .operators import (
    RESHADE_OT_estimate_light,
    RESHADE_OT_import_fspy,
    RESHADE_OT_import_photo,
    RESHADE_OT_paint_colours,
    RESHADE_OT_paint_gloss,
    RESHADE_OT_preview,
    RESHADE_OT_project_photo,
    RESHADE_OT_reshade,
    RESHADE_OT_save_reshaded,
    RESHADE_OT_solve_materials,
    RESHADE_OT_solve_painting,
)
from .scene_write import colour_socket

BIG = 1.4  # height of the one button that is a step's point
LETTER = 6.5  # pixels, about, at the interface's scale of 1


class _Step:
    """What the panels have in common."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Reshade"


class RESHADE_PT_photo(_Step, bpy.types.Panel):
    """The photo and its camera."""

    bl_label = "1  Photo"

    def draw(self, context: bpy.types.Context) -> None:
        """Import buttons, and what has been imported."""
        layout = self.layout
        photo = context.scene.reshade.photo
        if photo:
            width, height = photo.size
            row = layout.row()
            row.label(text=photo.name, icon="IMAGE_DATA")
            sub = row.row()
            sub.alignment = "RIGHT"
            sub.label(text=f"{width} × {height}")
        column = layout.column(align=True)
        main = column.column(align=True)
        main.scale_y = 1.0 if photo else BIG
        main.operator(
            RESHADE_OT_import_photo.bl_idname, text="Replace Photo" if photo else "Import Photo", icon="IMPORT"
        )
        column.operator(RESHADE_OT_import_fspy.bl_idname, icon="CAMERA_DATA")
        if photo:
            column.operator(RESHADE_OT_project_photo.bl_idname, icon="MOD_UVPROJECT")
            for check in (missing.camera, missing.geometry):
                message = check(context)
                if message:
                    _text(layout, context, message, "INFO")


class RESHADE_PT_light(_Step, bpy.types.Panel):
    """The light and how sure it is."""

    bl_label = "2  Light"

    def draw(self, context: bpy.types.Context) -> None:
        """Choices, the button, and what was found."""
        layout = self.layout
        choices = context.scene.reshade
        column = layout.column()
        column.use_property_split = True
        column.use_property_decorate = False
        column.prop(choices, "quality")
        column.prop(choices, "model")
        column.prop(choices, "hints")
        column.prop(choices, "fit_response")
        if choices.response != 1:
            column.prop(choices, "response")
        _button(layout, context, RESHADE_OT_estimate_light, "LIGHT_AREA")
        found = choices.found()
        if found:
            for light in found["lights"]:
                _light(layout, context, light)
            if any(light.get("uncertainty") for light in found["lights"]):
                layout.prop(choices, "show_uncertainty")
            for warning in found["warnings"]:
                _text(layout, context, warning, "ERROR")


class RESHADE_PT_materials(_Step, bpy.types.Panel):
    """The surfaces."""

    bl_label = "3  Materials"

    def draw(self, context: bpy.types.Context) -> None:
        """The button, and the colours that were found."""
        layout = self.layout
        choices = context.scene.reshade
        column = layout.column()
        column.use_property_split = True
        column.use_property_decorate = False
        column.prop(choices, "card")
        if choices.card:
            column.prop(choices, "card_albedo")
        _button(layout, context, RESHADE_OT_solve_materials, "MATERIAL")
        found = choices.found()
        if found:
            column = layout.column(align=True)
            for name, surface in found["surfaces"].items():
                material = bpy.data.materials.get(name)
                socket = colour_socket(material) if material else None
                if socket is None or socket.is_linked:
                    continue
                row = column.row(align=True)
                row.label(text=name, icon="TEXTURE" if surface["textured"] else "MATERIAL")
                row.prop(socket, "default_value", text="")


class RESHADE_PT_edit(_Step, bpy.types.Panel):
    """The edit, which is Blender's own business."""

    bl_label = "4  Edit"

    def draw(self, context: bpy.types.Context) -> None:
        """The lights' strengths and colours, at hand."""
        layout = self.layout
        if missing.reference_state(context):
            _text(layout, context, "First explain the photo: estimate its light.", "NONE")
            return
        for obj in context.scene.objects:
            if obj.type == "LIGHT" and not obj.hide_render:
                column = layout.column(align=True)
                column.label(text=obj.name, icon="LIGHT")
                row = column.row(align=True)
                row.prop(obj.data, "energy", text="")
                row.prop(obj.data, "color", text="")
        layout.operator(RESHADE_OT_preview.bl_idname, icon="HIDE_OFF")
        column = layout.column(align=True)
        column.prop(context.scene.reshade, "painting", text="")
        column.label(text="From the painting:")
        row = column.row(align=True)
        row.operator(RESHADE_OT_solve_painting.bl_idname, text="Lights", icon="BRUSH_DATA")
        row.operator(RESHADE_OT_paint_colours.bl_idname, text="Colours", icon="COLOR")
        row.operator(RESHADE_OT_paint_gloss.bl_idname, text="Gloss", icon="MATSPHERE")
        _text(layout, context, "Move, dim or turn the light, recolour a material, add objects.", "NONE")


class RESHADE_PT_reshade(_Step, bpy.types.Panel):
    """The reshaded photo."""

    bl_label = "5  Reshade"

    def draw(self, context: bpy.types.Context) -> None:
        """The button and its result."""
        layout = self.layout
        choices = context.scene.reshade
        column = layout.column()
        column.use_property_split = True
        column.use_property_decorate = False
        column.prop(choices, "samples")
        _button(layout, context, RESHADE_OT_reshade, "SHADING_RENDERED")
        if choices.reshaded:
            preview = choices.reshaded.preview
            if preview:
                layout.template_icon(preview.icon_id, scale=8.0)
            layout.operator(RESHADE_OT_save_reshaded.bl_idname, icon="EXPORT")


def _button(
    layout: bpy.types.UILayout, context: bpy.types.Context, operator: type[bpy.types.Operator], icon: str
) -> None:
    """A step's button; while it runs, how far it is."""
    state = context.window_manager.reshade
    if state.running == operator.__name__:
        layout.progress(factor=state.fraction, text=state.message)
        _text(layout, context, "Esc cancels and leaves the scene as it was.", "NONE")
        return
    row = layout.row()
    row.scale_y = BIG
    row.operator(operator.bl_idname, icon=icon)


def _light(layout: bpy.types.UILayout, context: bpy.types.Context, light: dict[str, Any]) -> None:
    """What was found of a light, strongest knowledge first, and how sure it is."""
    sure = light.get("uncertainty") or {}
    box = layout.box().column(align=True)
    box.label(text=light["name"], icon="LIGHT")
    unit = "W/m²" if light["type"] == "SUN" else "W"
    energy = sure.get("log_energy")
    _row(box, "Power", f"{plain(light['energy'], 3)} {unit}", f"{plain(100 * energy, 1)} %" if energy else None)
    if "centre" in light:
        _row(box, "Place", ", ".join(f"{x:.2f}" for x in light["centre"]), _length(sure.get("centre_m")))
    if light["type"] != "POINT":
        degrees = sure.get("normal_deg")
        down = math.degrees(math.asin(max(-1.0, min(1.0, -light["normal"][2]))))
        text = f"{abs(down):.0f}° {'down' if down >= 0 else 'up'}"
        _row(box, "Shines", text, f"{plain(degrees, 1)}°" if degrees else None)
    if "size" in light:
        sizes = sure.get("log_size")
        text = " × ".join(f"{x:.2f}" for x in light["size"]) + " m"
        _row(box, "Size", text, f"{plain(100 * max(sizes), 1)} %" if sizes else None)
    if sure.get("weakest"):
        _text(box, context, f"Least sure: {sure['weakest']}", "NONE")


def _row(layout: bpy.types.UILayout, name: str, value: str, uncertainty: str | None) -> None:
    split = layout.split(factor=0.25)
    split.label(text=name)
    split.label(text=f"{value}  ± {uncertainty}" if uncertainty else value)


def _length(metres: float | None) -> str | None:
    if not metres:
        return None
    return f"{plain(metres, 2)} m" if metres >= 0.1 else f"{plain(1000 * metres, 2)} mm"


def _text(layout: bpy.types.UILayout, context: bpy.types.Context, text: str, icon: str) -> None:
    """Text over as many lines as the sidebar's width asks for."""
    scale = context.preferences.system.ui_scale
    width = max(16, int((context.region.width / scale - 60) / LETTER))
    column = layout.column(align=True)
    column.scale_y = 0.8
    for number, line in enumerate(textwrap.wrap(text, width)):
        column.label(text=line, icon=icon if number == 0 else ("NONE" if icon == "NONE" else "BLANK1"))


CLASSES = (RESHADE_PT_photo, RESHADE_PT_light, RESHADE_PT_materials, RESHADE_PT_edit, RESHADE_PT_reshade)
