"""What Reshade keeps on a scene."""

import json
from typing import Any

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

MODELS = ("auto", "area", "point", "sun")


def _redraw(choices: bpy.types.PropertyGroup, context: bpy.types.Context) -> None:
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()


class SceneReshade(bpy.types.PropertyGroup):
    """A scene's photo, choices and results."""

    photo: PointerProperty(
        name="Photo", description="The photo whose light is looked for; it is kept in the file", type=bpy.types.Image
    )
    quality: EnumProperty(
        name="Quality",
        description="How much time to spend",
        items=[
            ("draft", "Draft", "Seconds: enough to see whether the camera and the geometry fit the photo"),
            ("standard", "Standard", "A good answer for most photos"),
            ("accurate", "Accurate", "More samples and shadow rays, for the last few per cent"),
        ],
        default="standard",
    )
    model: EnumProperty(
        name="Light",
        description="What kind of light to look for",
        items=[
            ("auto", "Automatic", "The simplest kind that explains the photo"),
            ("area", "Area", "A rectangle: a window, a soft box, a ceiling panel"),
            ("point", "Point", "A bare bulb"),
            ("sun", "Sun", "So far away that its rays are parallel"),
        ],
        default="auto",
    )
    fit_response: BoolProperty(
        name="Fit Response",
        description="Where shading shows that the photo's values are not what its file says (a tone curve, a film "
        "look), find the power that makes radiance of them",
    )
    response: FloatProperty(
        name="Response",
        description="Radiance is proportional to the photo's linear values to this power; 1 for a photo without a tone "
        "curve",
        default=1.0,
        min=0.2,
        max=5.0,
    )
    card: PointerProperty(
        name="White Card",
        description="A material whose reflectance you know: it gives strengths and albedos their true scale",
        type=bpy.types.Material,
    )
    card_albedo: FloatProperty(
        name="Reflectance", description="Of the white card", default=0.9, min=0.01, max=1.0, subtype="FACTOR"
    )
    hints: StringProperty(
        name="Hints",
        description="What you know of the light, with semicolons between: highlight X,Y; shadow X1,Y1 X2,Y2 (a pixel "
        "in shadow, then what casts it there); distance D; ceiling H; parallel MATERIAL; perpendicular MATERIAL",
    )
    painting: PointerProperty(
        name="Painting", description="A copy of the photo, painted on how it should look", type=bpy.types.Image
    )
    samples: IntProperty(
        name="Samples",
        description="Samples a pixel when the edited scene is rendered; more give less noise",
        default=64,
        min=1,
        soft_max=4096,
    )
    show_uncertainty: BoolProperty(
        name="Show Uncertainty",
        description="Draw how far the light may be off into the viewport: where it may stand, which way it may shine, "
        "its smallest and its largest sides; each holds the truth nine times in ten",
        update=_redraw,
    )
    report: StringProperty(name="Report", description="What was found, as JSON", options={"HIDDEN"})
    reference: PointerProperty(
        name="Reference state", description="The scene that reproduces the photo", type=bpy.types.Text
    )
    reshaded: PointerProperty(
        name="Reshaded photo", description="The photo as the edited scene would have looked", type=bpy.types.Image
    )

    def found(self) -> dict[str, Any] | None:
        """What was found, as the report has it; None before anything was."""
        return json.loads(self.report) if self.report else None


class WindowManagerReshade(bpy.types.PropertyGroup):
    """The computation under way."""

    running: StringProperty(options={"SKIP_SAVE"})  # class of the operator
    fraction: FloatProperty(min=0.0, max=1.0, options={"SKIP_SAVE"})
    message: StringProperty(options={"SKIP_SAVE"})


CLASSES = (SceneReshade, WindowManagerReshade)


def register() -> None:
    """Add `reshade` to scenes and to the window manager."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.Scene.reshade = PointerProperty(type=SceneReshade)
    bpy.types.WindowManager.reshade = PointerProperty(type=WindowManagerReshade)


def unregister() -> None:
    """Undo `register`."""
    del bpy.types.WindowManager.reshade
    del bpy.types.Scene.reshade
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
