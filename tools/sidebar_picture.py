"""Run by a real Blender with a screen: opens the sidebar on the Reshade tab, photographs it, checks it, quits.

    blender SCENE.blend --python tools/sidebar_picture.py -- PICTURE.png

Blender draws between the ticks of a timer, so each step waits for the next. Blender's own screenshot comes out black
without a compositor; ImageMagick's `import` takes what is on the screen.
"""

import os
import subprocess
import sys
import traceback
from collections.abc import Iterator

import bpy

TICK = 0.5  # seconds
RENDERING = 30  # ticks, for Cycles to draw the view
TAB = "Reshade"
LEAST_TEXT = 500  # light pixels in the sidebar left of its tabs; a panel that failed to draw is one title
TABS_WIDTH = 30  # pixels
COUNT = ["-format", "%[fx:round(mean*w*h)]", "info:"]  # prints how many pixels are white


def steps(picture: str) -> Iterator[None]:
    """What is done at each tick."""
    window = bpy.context.window_manager.windows[0]
    area = next(area for area in window.screen.areas if area.type == "VIEW_3D")
    area.spaces.active.show_region_ui = True
    view = area.spaces.active.region_3d
    view.view_perspective = "CAMERA"
    view.view_camera_zoom = 12
    view.view_camera_offset = (0.08, 0.0)  # out from under the sidebar
    bpy.context.scene.camera.data.passepartout_alpha = 0.95
    area.spaces.active.shading.type = "RENDERED"
    yield
    sidebar = next(region for region in area.regions if region.type == "UI")
    sidebar.active_panel_category = TAB
    area.tag_redraw()
    yield
    assert sidebar.active_panel_category == TAB, "there is no such tab"
    yield from [None] * RENDERING
    subprocess.run(["import", "-window", "root", picture], check=True, timeout=60)
    top = window.height - sidebar.y - sidebar.height
    crop = f"{sidebar.width - TABS_WIDTH}x{sidebar.height}+{sidebar.x}+{top}"
    light = subprocess.run(
        ["convert", picture, "-crop", crop, "-colorspace", "gray", "-threshold", "70%", *COUNT],
        check=True,
        capture_output=True,
        text=True,
        timeout=60,
    ).stdout
    print(f"{light} light pixels in the sidebar, {crop}")
    assert int(light) >= LEAST_TEXT, "the sidebar is blank"


def run(picture: str) -> None:
    """Take the steps, one a tick, then leave with 0, or with 1 and the reason."""
    bpy.context.preferences.view.show_splash = False
    remaining = steps(picture)

    def tick() -> float:
        try:
            next(remaining)
        except StopIteration:
            leave(0)
        except BaseException:
            traceback.print_exc()
            leave(1)
        return TICK

    bpy.app.timers.register(tick, first_interval=1.0)


def leave(code: int) -> None:
    """End the process with this code: `quit_blender` would always give 0, and asks about unsaved changes."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


if __name__ == "__main__":
    run(sys.argv[sys.argv.index("--") + 1])
