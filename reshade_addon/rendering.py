"""Renders by Cycles as linear float pictures, with the user's render settings untouched."""

import tempfile
from collections.abc import Generator, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core.errors import ReshadeError
from ..core.types import Array, Progress
from .photo_io import LARGE, read_linear, read_pass
from .render_depsgraph import first_layer, settings

CHUNK = 64  # samples between two looks at the clock: a picture of so many is made without a pause
TOGETHER = LARGE  # pixels of which all passes are rendered together


def render(
    scene: bpy.types.Scene, samples: int, *, seed: int = 0, direct_only: bool = False
) -> Generator[Progress, None, Array]:
    """Render a scene's linear picture (H, W, 3), in chunks, telling progress after each.

    seed : of the random numbers. The same scene, samples and seed give the same picture.
    direct_only : leave out light that was reflected more than once

    The picture is not denoised, has no compositing, and its exposure is 1.
    """
    total = np.zeros((scene.render.resolution_y, scene.render.resolution_x, 3))
    done = 0
    while done < samples:
        yield Progress(done / samples, f"Rendering, {done} of {samples} samples")
        count = min(CHUNK, samples - done)
        total += count * _render_once(scene, count, seed + done // CHUNK, direct_only)
        done += count
    # As much as a float EXR holds, so that a render that was kept equals one made anew.
    return (total / samples).astype(np.float32).astype(np.float64)


def _render_once(scene: bpy.types.Scene, samples: int, seed: int, direct_only: bool) -> Array:
    with tempfile.TemporaryDirectory() as folder, _plain_render(scene, samples, seed, direct_only):
        path = Path(folder) / "render.exr"
        scene.render.filepath = str(path)
        bpy.ops.render.render(scene=scene.name, layer=first_layer(scene).name, write_still=True)
        if not path.is_file():
            raise ReshadeError("Cycles did not render the scene", "Render it once by hand to see Blender's message")
        return read_linear(path)


def render_passes(scene: bpy.types.Scene, samples: int) -> Generator[Progress, None, dict[str, NDArray[np.float32]]]:
    """Render a scene's albedo, the light on it and its highlights, each linear (H, W, 3), by those names.

    Of a large photo all passes together take Blender gigabytes: it is rendered once for each kind of them.
    """
    yield Progress(0.0, "Rendering albedo, shading and highlights")
    together = scene.render.resolution_x * scene.render.resolution_y <= TOGETHER
    with tempfile.TemporaryDirectory() as folder:
        diffuse = glossy = Path(folder) / "passes.exr"
        if together:
            _write_passes(scene, samples, ("diffuse", "glossy"), diffuse)
        else:
            glossy = Path(folder) / "glossy.exr"
            _write_passes(scene, samples, ("diffuse",), diffuse)
            yield Progress(0.5, "Rendering albedo, shading and highlights")
            _write_passes(scene, samples, ("glossy",), glossy)
        # Read only now: nothing of one render is held during the other.
        albedo, shading = read_pass(diffuse, "Diffuse Color", "DiffCol"), _light(diffuse, "Diffuse", "Diff")
        return {"Albedo": albedo, "Shading": shading, "Specular": _mirrored(glossy)}


def render_highlights(scene: bpy.types.Scene, samples: int) -> NDArray[np.float32]:
    """Render what a scene's surfaces mirror, linear (H, W, 3)."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "passes.exr"
        _write_passes(scene, samples, ("glossy",), path)
        return _mirrored(path)


def render_as(scene: bpy.types.Scene, material: bpy.types.Material, samples: int) -> Array:
    """Render a scene whose surfaces are all of one material, in its direct light alone, linear (H, W, 3)."""
    with settings(first_layer(scene), material_override=material):
        return _render_once(scene, samples, 0, True)


def _write_passes(scene: bpy.types.Scene, samples: int, kinds: Sequence[str], path: Path) -> None:
    layer = first_layer(scene)
    wanted = {f"use_pass_{kind}_{what}": True for kind in kinds for what in ("direct", "indirect", "color")}
    with (
        _plain_render(scene, samples, 0, False),
        settings(layer, **wanted),
        _exr(scene.render.image_settings, layers=True),
    ):
        scene.render.filepath = str(path)
        bpy.ops.render.render(scene=scene.name, layer=layer.name, write_still=True)
        if not path.is_file():
            raise ReshadeError("Cycles did not render the scene", "Render it once by hand to see Blender's message")


def _light(path: Path, name: str, short: str) -> NDArray[np.float32]:
    """Direct and indirect light of a kind; before Blender 5.0 its passes have short names."""
    light = read_pass(path, f"{name} Direct", f"{short}Dir")
    light += read_pass(path, f"{name} Indirect", f"{short}Ind")
    return light


def _mirrored(path: Path) -> NDArray[np.float32]:
    glossy = _light(path, "Glossy", "Gloss")
    glossy *= read_pass(path, "Glossy Color", "GlossCol")
    return glossy


@contextmanager
def _plain_render(scene: bpy.types.Scene, samples: int, seed: int, direct_only: bool) -> Iterator[None]:
    """Settings for a plain linear picture by Cycles; the old ones return afterwards."""
    if not hasattr(scene, "cycles"):
        raise ReshadeError("Cycles is switched off", "Enable 'Cycles Render Engine' under Preferences, Add-ons")
    with ExitStack() as stack:
        stack.enter_context(
            settings(
                scene.render,
                filepath=scene.render.filepath,
                engine="CYCLES",
                resolution_percentage=100,
                use_border=False,
                use_compositing=False,
                use_sequencer=False,
                use_multiview=False,
                use_freestyle=False,
                use_motion_blur=False,
                use_file_extension=True,
                use_overwrite=True,
                film_transparent=False,
            )
        )
        stack.enter_context(_exr(scene.render.image_settings))
        cycles = scene.cycles
        stack.enter_context(
            settings(
                cycles,
                samples=samples,
                seed=seed,
                use_animated_seed=False,
                use_adaptive_sampling=False,
                use_denoising=False,
                light_sampling_threshold=0.0,
                sample_clamp_direct=0.0,
                sample_clamp_indirect=0.0,
                film_exposure=1.0,
                time_limit=0.0,
            )
        )
        if direct_only:
            stack.enter_context(settings(cycles, max_bounces=0))
        yield


@contextmanager
def _exr(image: bpy.types.ImageFormatSettings, *, layers: bool = False) -> Iterator[None]:
    """Set a float EXR as the format, of one layer or many. From 5.0 on the kind of media comes before the format."""
    with ExitStack() as stack:
        if hasattr(image, "media_type"):
            stack.enter_context(settings(image, media_type="MULTI_LAYER_IMAGE" if layers else "IMAGE"))
        stack.enter_context(settings(image, file_format="OPEN_EXR_MULTILAYER" if layers else "OPEN_EXR"))
        if not layers:
            stack.enter_context(settings(image, color_mode="RGB"))
        stack.enter_context(settings(image, color_depth="32", exr_codec="ZIP"))
        yield
