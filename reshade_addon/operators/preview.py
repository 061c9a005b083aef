"""Preview: the edited photo in closed form, kept up to date while lights are moved."""

import bpy

from ...core.errors import ReshadeError
from ...core.progress import drain
from .. import missing
from ..photo_image import picture_image, read_image
from ..previewing import Live, begin

RESULT = "Reshade preview"
EVERY = 0.15  # seconds between two looks at the scene


class RESHADE_OT_preview(bpy.types.Operator):
    """Show at once how edits of lights, colours and the world change the photo; says what it leaves out"""

    bl_idname = "reshade.preview"
    bl_label = "Live Preview"
    bl_options = {"REGISTER"}

    _live: Live | None = None
    _timer: bpy.types.Timer | None = None

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """With a photo and a reference state."""
        return missing.nothing(cls, context, missing.mode, missing.photo, missing.camera, missing.reference_state)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Make one picture: for scripts and without an interface."""
        try:
            self._live = drain(begin(context.scene, read_image(context.scene.reshade.photo)))
            self._show(context)
        except ReshadeError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        without = self._live.unshown(context.scene)
        if without:
            self.report({"WARNING"}, f"The image '{RESULT}' does not show {', '.join(without)}; Reshade does")
        else:
            self.report({"INFO"}, f"The preview is the image '{RESULT}'")
        return {"FINISHED"}

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Make a picture now, and again whenever the scene has changed."""
        done = self.execute(context)
        if bpy.app.background or "FINISHED" not in done:
            return done
        self._timer = context.window_manager.event_timer_add(EVERY, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Look at the scene on each tick; everything else goes on as usual."""
        if event.type == "ESC" and event.value == "PRESS":
            self.cancel(context)
            return {"FINISHED"}
        if event.type == "TIMER":
            try:
                self._show(context)
            except ReshadeError as error:
                self.cancel(context)
                self.report({"ERROR"}, str(error))
                return {"CANCELLED"}
        return {"PASS_THROUGH"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Called by Blender when the window goes away."""
        if self._timer is not None:
            context.window_manager.event_timer_remove(self._timer)
        self._timer = self._live = None
        context.workspace.status_text_set(None)

    def _show(self, context: bpy.types.Context) -> None:
        without = ", ".join(("bounced light", *self._live.unshown(context.scene)))
        if self._timer is not None:
            context.workspace.status_text_set(f"Live preview, without {without}     Esc: end")
        image = picture_image(RESULT, self._live.picture(context.scene), bpy.data.images.get(RESULT))
        for area in context.screen.areas if context.screen else ():
            if area.type == "IMAGE_EDITOR" and area.spaces.active.image in (None, image):
                area.spaces.active.image = image
                area.tag_redraw()
