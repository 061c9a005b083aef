"""Photos from files and back, through OpenImageIO, exactly.

Integer files (PNG, JPEG, TIFF) hold sRGB-encoded values, floating-point ones (EXR, HDR, TIFF) hold linear ones.
A photo read from 8 bits and written to 16 is each value times 257; a float32 EXR comes back as it was.
"""

import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.color import linear_to_srgb, srgb_to_linear
from ..core.errors import NothingToLearn, ReshadeError
from ..core.photo.sensor import clipping_mask
from ..core.types import Array, Photo

READABLE = (".png", ".jpg", ".jpeg", ".exr", ".tif", ".tiff", ".hdr", ".bmp", ".webp", ".tga")
WRITABLE = (".exr", ".png")

LARGE = 8_000_000  # pixels, from which on memory matters more than the last digits
SMALLEST_SIDE = 8  # pixels; below it there is no shading to speak of
BLACK = 1e-5  # linear; under a thirtieth of an 8-bit step

_ROWS = 64  # written at a time


def read_photo(path: str | Path, linear: bool | None = None, large: int = 0) -> Photo:
    """Read a photo as scene-linear Rec.709.

    linear : whether the file's values are linear; None: by its type, integers encoded and floats linear
    large : as for `read_picture`

    Grey becomes colour. Pixels that are not opaque show more than the scene; they count as clipped.
    Raises ReshadeError for a file that is missing, unreadable or holds no finite RGB picture, and NothingToLearn for
    one that is black, clipped or tiny.
    """
    photo, alpha = read_picture(path, linear, large)
    if alpha is None:
        return photo
    photo = Photo(photo.linear, photo.clipped | (alpha < 1))
    if photo.clipped.all():
        raise NothingToLearn(
            f"Every pixel of the photo '{Path(path).name}' is clipped or transparent", "Use a photo with less exposure"
        )
    return photo


def read_picture(path: str | Path, linear: bool | None = None, large: int = 0) -> tuple[Photo, Array | None]:
    """Read a photo as `read_photo` does, and its alpha (H, W) in 0..1, where the file has one: here it clips nothing.

    large : pixels from which on its values are float32, which still tells 16-bit steps apart; 0: always float64
    """
    stored, alpha = _read(Path(path))
    name = Path(path).name
    if not np.issubdtype(stored.dtype, np.integer):
        bad = ~np.isfinite(stored).all(axis=-1)
        if bad.any():
            raise ReshadeError(
                f"The photo '{name}' has NaN or infinite values in {np.count_nonzero(bad)} of its pixels",
                "Repair it in an image editor or export it again",
            )
    height, width = stored.shape[:2]
    if min(width, height) < SMALLEST_SIDE:
        raise NothingToLearn(
            f"The photo '{name}' is {width} x {height} pixels, too small to show any shading",
            f"Use one of at least {SMALLEST_SIDE} x {SMALLEST_SIDE}",
        )
    photo = _decoded(stored, linear, np.float32 if 0 < large <= width * height else np.float64)
    if photo.linear.max() <= BLACK:
        raise NothingToLearn(f"The photo '{name}' is black all over", "Use a photo that shows the lit scene")
    if photo.clipped.all():
        raise NothingToLearn(f"Every pixel of the photo '{name}' is clipped", "Use a photo with less exposure")
    return photo, alpha


def read_packed(data: bytes, suffix: str, large: int = 0) -> Photo:
    """Read a photo from a file's bytes, as a .blend packs them; `suffix` is the file's extension."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"photo{suffix}"
        path.write_bytes(data)
        return read_photo(path, large=large)


def read_linear(path: str | Path) -> Array:
    """Read the values (H, W, 3) of a file as they are stored, unchecked: for renders, where black is a fair answer."""
    return _read(Path(path))[0].astype(np.float64)


def read_pass(path: str | Path, *names: str) -> NDArray[np.float32]:
    """Read the first of these passes that a multilayer EXR has, (H, W, 3), and nothing else of it.

    Blender writes each pass as a part, or all as one. Raises KeyError where the file has none of them.
    """
    import OpenImageIO as oiio

    file = oiio.ImageInput.open(str(path))
    try:
        part = 0
        while file.seek_subimage(part, 0):
            channels = file.spec().channelnames
            for channel in channels:
                if any(f".{channel}".endswith(f".{name}.R") for name in names):
                    order = [channels.index(channel[:-1] + letter) for letter in "RGB"]
                    first, last = min(order), max(order) + 1
                    pixels = file.read_image(part, 0, first, last, oiio.FLOAT)
                    return np.ascontiguousarray(pixels[..., [at - first for at in order]])
            part += 1
    finally:
        file.close()
    raise KeyError(f"{path} has no pass {' or '.join(names)}")


def write_layers(path: str | Path, layers: Mapping[str, ArrayLike]) -> None:
    """Write pictures (H, W, 3) and masks (H, W) as one EXR of many layers; the first is also the file's own picture.

    Channels are named as compositors expect them: R, G, B, then `Name.R` and so on, masks `Name.A`. Pictures are
    halves beyond the first, which keeps its 32 bits: 24 megapixels take 1 GB less.
    Raises ReshadeError where the file is no EXR or cannot be written.
    """
    import OpenImageIO as oiio

    path = Path(path)
    if path.suffix.lower() != ".exr":
        raise ReshadeError(f"Layers cannot be written to '{path.name}'", "Name the file .exr")
    check_writable(path)
    pictures = {name: np.asarray(layer) for name, layer in layers.items()}
    first = next(iter(pictures))
    names, planes, kinds = [], [], []
    for channel, letter in enumerate("RGB"):
        names.append(letter)
        planes.append(pictures[first][..., channel])
        kinds.append("float")
    for name, picture in pictures.items():
        for channel, letter in enumerate("RGB" if picture.ndim == 3 else "A"):
            names.append(f"{name}.{letter}")
            planes.append(picture[..., channel] if picture.ndim == 3 else picture)
            kinds.append("float" if name in (first, "Photo") else "half")
    height, width = planes[0].shape
    spec = oiio.ImageSpec(width, height, len(names), "float")
    spec.channelnames = tuple(names)
    spec.channelformats = tuple(oiio.TypeDesc(kind) for kind in kinds)
    spec.attribute("compression", "zip")
    spec.attribute("oiio:ColorSpace", "lin_rec709")
    _write_rows(path, spec, lambda rows: np.stack([plane[rows].astype(np.float32) for plane in planes], axis=-1))


def write_picture(path: str | Path, linear: ArrayLike, alpha: Array | None = None) -> None:
    """Write a scene-linear picture (H, W, 3) by the extension of `path`: .exr float32 linear, .png 16-bit encoded.

    alpha : (H, W) in 0..1, written with it where given; EXR gets colours multiplied by it, as its standard asks

    Raises ReshadeError for another extension or where the file cannot be written.
    """
    path = Path(path)
    check_writable(path)
    linear = np.asarray(linear)

    def floats(rows: slice) -> np.ndarray:
        pixels = linear[rows].astype(np.float32)
        return pixels if alpha is None else np.dstack([pixels * alpha[rows][..., None], alpha[rows]]).astype(np.float32)

    def integers(rows: slice) -> np.ndarray:
        encoded = np.clip(linear_to_srgb(linear[rows]), 0.0, 1.0)
        encoded = encoded if alpha is None else np.dstack([encoded, alpha[rows]])
        return np.rint(encoded * 65535).astype(np.uint16)

    size = (*linear.shape[:2], 3 if alpha is None else 4)
    if path.suffix.lower() == ".exr":
        _write(path, size, floats, "float", {"compression": "zip", "oiio:ColorSpace": "lin_rec709"})
    else:
        _write(path, size, integers, "uint16", {"oiio:ColorSpace": "sRGB", "oiio:UnassociatedAlpha": 1})


def write_encoded(path: str | Path, encoded: ArrayLike) -> None:
    """Write sRGB-encoded values in 0..1 (H, W, 3) as an 8-bit PNG: for diagrams, which are made encoded."""
    encoded = np.asarray(encoded)

    def bytes_of(rows: slice) -> np.ndarray:
        return np.rint(np.clip(encoded[rows].astype(np.float64), 0.0, 1.0) * 255).astype(np.uint8)

    _write(Path(path), encoded.shape, bytes_of, "uint8", {"oiio:ColorSpace": "sRGB"})


def check_writable(path: str | Path) -> None:
    """Raise ReshadeError unless the extension of `path` is one that `write_picture` writes."""
    if Path(path).suffix.lower() not in WRITABLE:
        raise ReshadeError(f"The output '{Path(path).name}' is of no known kind", "Name it .exr or .png")


def _read(path: Path) -> tuple[np.ndarray, np.ndarray | None]:
    """Read a file's stored RGB values (H, W, 3), in their own type, and its alpha (H, W) in 0..1, if it has one."""
    import OpenImageIO as oiio

    if not path.is_file():
        raise ReshadeError(f"There is no photo '{path}'", "Check the path")
    asked = oiio.ImageSpec()
    asked.attribute("oiio:UnassociatedAlpha", 1)
    file = oiio.ImageInput.open(str(path), asked)
    if file is None:
        raise _unreadable(path, oiio.geterror())
    try:
        spec = file.spec()
        kind = {"uint8": "uint8", "uint16": "uint16", "half": "float", "float": "float", "double": "double"}.get(
            str(spec.format)
        )
        if kind is None:
            raise ReshadeError(
                f"The photo '{path.name}' stores its values as {spec.format}", "Export it with 8 or 16 bits, or as EXR"
            )
        pixels = file.read_image(0, 0, 0, spec.nchannels, kind)
        if pixels is None:
            raise _unreadable(path, file.geterror())
    finally:
        file.close()
    pixels = pixels.reshape(spec.height, spec.width, spec.nchannels)
    colour, alpha = _channels(tuple(spec.channelnames), path)
    full = np.iinfo(pixels.dtype).max if np.issubdtype(pixels.dtype, np.integer) else 1.0
    return pixels[..., colour], None if alpha is None else pixels[..., alpha].astype(np.float64) / full


def _channels(names: tuple[str, ...], path: Path) -> tuple[list[int], int | None]:
    """Find the positions of red, green, blue and, if there is one, alpha among a file's channels.

    A multilayer EXR's combined picture has names such as 'ViewLayer.Combined.R'; the first such layer is meant.
    """
    last = [name.rsplit(".", 1)[-1].upper() for name in names]
    alpha = last.index("A") if "A" in last else None
    if {"R", "G", "B"} <= set(last):
        return [last.index("R"), last.index("G"), last.index("B")], alpha
    if last[0] in ("Y", "I", "L") or len(names) <= 2:
        return [0, 0, 0], alpha if len(names) > 1 else None
    raise ReshadeError(
        f"The photo '{path.name}' has the channels {', '.join(names)}, not red, green and blue", "Export it as RGB"
    )


def _decoded(stored: np.ndarray, linear: bool | None, kind: type[np.floating]) -> Photo:
    if not np.issubdtype(stored.dtype, np.integer):
        values = stored.astype(kind)
        if linear is False:
            return Photo(srgb_to_linear(values), clipping_mask(values))
        return Photo(values, np.zeros(values.shape[:2], dtype=bool))
    ceiling = np.iinfo(stored.dtype).max
    encoded = np.arange(ceiling + 1) / ceiling
    table = encoded if linear else srgb_to_linear(encoded)
    at_ceiling = clipping_mask(encoded[:, None])
    return Photo(table.astype(kind)[stored], at_ceiling[stored].any(axis=-1))


def _write(
    path: Path,
    size: tuple[int, ...],
    pixels: Callable[[slice], np.ndarray],
    kind: str,
    attributes: Mapping[str, str | int],
) -> None:
    """Write a file of (height, width, channels), a few rows at a time: the whole is never held in another type."""
    import OpenImageIO as oiio

    height, width, channels = size
    spec = oiio.ImageSpec(width, height, channels, kind)
    for name, value in attributes.items():
        spec.attribute(name, value)
    _write_rows(path, spec, pixels)


def _write_rows(path: Path, spec: Any, pixels: Callable[[slice], np.ndarray]) -> None:
    """Write a file, a few rows at a time. Raises ReshadeError where it cannot be written."""
    import OpenImageIO as oiio

    file = oiio.ImageOutput.create(str(path))
    written = file.open(str(path), spec)
    for row in range(0, spec.height, _ROWS):
        rows = slice(row, min(row + _ROWS, spec.height))
        written = written and file.write_scanlines(rows.start, rows.stop, 0, np.ascontiguousarray(pixels(rows)))
    # The last bytes are written on closing: a full disk shows only there.
    if not (file.close() and written):
        raise ReshadeError(f"'{path}' cannot be written ({file.geterror().strip()})", "Check the folder and the disk")


def _unreadable(path: Path, why: str) -> ReshadeError:
    # OpenImageIO's message may have several lines; ours has one.
    reason = "; ".join(line.strip() for line in why.splitlines() if line.strip()) or "unknown format"
    return ReshadeError(
        f"The photo '{path.name}' cannot be read ({reason.rstrip('.')})", "Open it in an image editor and save it again"
    )
