"""Step 6 of the artist's story, in the 3D view and, for any image, in the Image Editor."""

import bpy

from .operators.remove_highlights import RESHADE_OT_remove_highlights, images_at_hand


class _Highlights:
    """What the two panels have in common."""

    bl_region_type = "UI"
    bl_category = "Reshade"

    def draw(self, context: bpy.types.Context) -> None:
        """The button, and for each image what was found: show, strength."""
        layout = self.layout
        state = context.window_manager.reshade
        if state.running == RESHADE_OT_remove_highlights.__name__:
            layout.progress(factor=state.fraction, text=state.message)
            return
        images = images_at_hand(context)
        row = layout.row(align=True)
        row.scale_y = 1.4
        row.operator(RESHADE_OT_remove_highlights.bl_idname, icon="SHADING_TEXTURE").method = "auto"
        # The methods of the literature, to compare it with.
        row.operator_menu_enum(RESHADE_OT_remove_highlights.bl_idname, "method", text="", icon="DOWNARROW_HLT")
        for image in images:
            kept = image.reshade_highlights
            column = layout.column(align=True)
            column.label(text=image.name, icon="IMAGE_DATA")
            if kept.removed:
                column.row(align=True).prop(kept, "show", expand=True)
                column.prop(kept, "strength")


class RESHADE_PT_highlights(_Highlights, bpy.types.Panel):
    """Highlights of the photo or of the selected surfaces' textures."""

    bl_label = "6  Highlights"
    bl_space_type = "VIEW_3D"


class RESHADE_PT_image_highlights(_Highlights, bpy.types.Panel):
    """Highlights of the image shown."""

    bl_label = "Highlights"
    bl_space_type = "IMAGE_EDITOR"


CLASSES = (RESHADE_PT_highlights, RESHADE_PT_image_highlights)
