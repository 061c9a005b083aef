"""Photos come in as they are and go out as they came, and what is no photo is told apart."""

import numpy as np
import OpenImageIO as oiio
import pytest


@pytest.fixture
def io(load):
    return load("reshade_addon.photo_io")


@pytest.fixture
def errors(load):
    return load("core.errors")


def write(path, pixels, names=("R", "G", "B", "A")):
    """Write an array (H, W, C) in its own type, unassociated alpha and all, without the module under test."""
    pixels = np.atleast_3d(pixels)
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], str(pixels.dtype).replace("32", ""))
    if pixels.shape[2] > 2:
        spec.channelnames = names[: pixels.shape[2]]
    spec.attribute("oiio:UnassociatedAlpha", 1)
    file = oiio.ImageOutput.create(str(path))
    assert file.open(str(path), spec), file.geterror()
    assert file.write_image(np.ascontiguousarray(pixels)), file.geterror()
    file.close()


def stored(path, kind):
    file = oiio.ImageInput.open(str(path))
    pixels = file.read_image(0, 0, 0, file.spec().nchannels, kind)
    file.close()
    return pixels


@pytest.fixture
def noise():
    return np.random.default_rng(7)


def test_eight_bits_become_sixteen_exactly(io, tmp_path, noise):
    values = np.arange(768).reshape(16, 16, 3) % 256
    write(tmp_path / "in.png", values.astype(np.uint8))
    io.write_picture(tmp_path / "out.png", io.read_photo(tmp_path / "in.png").linear)
    np.testing.assert_array_equal(stored(tmp_path / "out.png", "uint16"), values * 257)


@pytest.mark.parametrize("large", [0, 1])
def test_all_sixteen_bit_values_come_back(io, tmp_path, large):
    values = np.arange(65536, dtype=np.uint16).reshape(256, 256, 1).repeat(3, axis=2)
    write(tmp_path / "in.png", values)
    linear = io.read_photo(tmp_path / "in.png", large=large).linear
    assert linear.dtype == (np.float32 if large else np.float64)
    io.write_picture(tmp_path / "out.png", linear)
    np.testing.assert_array_equal(stored(tmp_path / "out.png", "uint16"), values)


def test_exr_comes_back_with_negatives_and_highlights(io, tmp_path, noise):
    values = (noise.normal(size=(20, 30, 3)) * 50).astype(np.float32)
    write(tmp_path / "in.exr", values)
    photo = io.read_photo(tmp_path / "in.exr")
    np.testing.assert_array_equal(photo.linear, values)
    assert not photo.clipped.any()
    io.write_picture(tmp_path / "out.exr", photo.linear)
    np.testing.assert_array_equal(stored(tmp_path / "out.exr", "float"), values)


def test_half_float_exr_is_linear(io, tmp_path, noise):
    values = noise.random((16, 16, 3)).astype(np.float16)
    spec = oiio.ImageSpec(16, 16, 3, "half")
    file = oiio.ImageOutput.create(str(tmp_path / "in.exr"))
    file.open(str(tmp_path / "in.exr"), spec)
    file.write_image(values)
    file.close()
    np.testing.assert_array_equal(io.read_photo(tmp_path / "in.exr").linear, values)


def test_multilayer_exr_gives_its_combined_picture(io, tmp_path, noise):
    values = noise.random((16, 16, 4)).astype(np.float32)
    names = tuple(f"ViewLayer.Combined.{channel}" for channel in "RGBA")
    write(tmp_path / "in.exr", np.dstack([values[..., :3], np.ones((16, 16), np.float32)]), names)
    np.testing.assert_allclose(io.read_photo(tmp_path / "in.exr").linear, values[..., :3])


def test_png_is_decoded(io, tmp_path):
    write(tmp_path / "in.png", np.full((16, 16, 3), 188, np.uint8))
    np.testing.assert_allclose(io.read_photo(tmp_path / "in.png").linear, 0.5, atol=0.005)
    np.testing.assert_allclose(io.read_photo(tmp_path / "in.png", linear=True).linear, 188 / 255)


def test_clipped_and_transparent_pixels_are_marked(io, tmp_path):
    values = np.full((16, 16, 4), 100, np.uint8)
    values[..., 3] = 255
    values[2, 3, 1] = 255
    values[5, 6, 3] = 254
    write(tmp_path / "in.png", values)
    photo = io.read_photo(tmp_path / "in.png")
    assert sorted(zip(*np.nonzero(photo.clipped), strict=True)) == [(2, 3), (5, 6)]
    np.testing.assert_array_equal(photo.linear[5, 6], photo.linear[0, 0])  # not multiplied by alpha


def test_grey_becomes_colour(io, tmp_path):
    write(tmp_path / "in.png", (np.arange(256).reshape(16, 16, 1) // 2).astype(np.uint8))
    linear = io.read_photo(tmp_path / "in.png").linear
    assert linear.shape == (16, 16, 3)
    np.testing.assert_array_equal(linear[..., 0], linear[..., 2])


def bad_files(folder, noise):
    """Every bad photo, by what is bad about it."""
    fine = (noise.random((16, 16, 3)) * 200).astype(np.uint8)
    nan = fine.astype(np.float32)
    nan[3, 4, 1] = np.nan
    infinite = fine.astype(np.float32)
    infinite[3, 4, 1] = np.inf
    write(folder / "nan.exr", nan)
    write(folder / "infinite.exr", infinite)
    write(folder / "black.png", fine * 0)
    write(folder / "black.exr", np.zeros((16, 16, 3), np.float32))
    write(folder / "clipped.png", fine * 0 + 255)
    write(folder / "one.png", fine[:1, :1])
    write(folder / "strip.png", fine[:1])
    (folder / "text.png").write_text("no picture")
    (folder / "empty.png").write_bytes(b"")
    write(folder / "whole.png", fine)
    (folder / "cut.png").write_bytes((folder / "whole.png").read_bytes()[:100])
    write(folder / "vectors.exr", fine.astype(np.float32), ("U", "V", "W"))
    (folder / "folder.png").mkdir()


@pytest.mark.parametrize(
    ("name", "kind", "words"),
    [
        ("missing.png", "ReshadeError", "There is no photo"),
        ("folder.png", "ReshadeError", "There is no photo"),
        ("text.png", "ReshadeError", "cannot be read"),
        ("empty.png", "ReshadeError", "cannot be read"),
        ("cut.png", "ReshadeError", "cannot be read"),
        ("vectors.exr", "ReshadeError", "Export it as RGB"),
        ("nan.exr", "ReshadeError", "NaN or infinite values in 1 of its pixels"),
        ("infinite.exr", "ReshadeError", "NaN or infinite values in 1 of its pixels"),
        ("black.png", "NothingToLearn", "black all over"),
        ("black.exr", "NothingToLearn", "black all over"),
        ("clipped.png", "NothingToLearn", "clipped"),
        ("one.png", "NothingToLearn", "1 x 1 pixels"),
        ("strip.png", "NothingToLearn", "16 x 1 pixels"),
    ],
)
def test_bad_photos_say_what_to_do(io, errors, tmp_path, noise, name, kind, words):
    bad_files(tmp_path, noise)
    with pytest.raises(errors.ReshadeError) as caught:
        io.read_photo(tmp_path / name)
    assert type(caught.value).__name__ == kind
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
    assert caught.value.remedy


def test_files_appear_whole_or_not_at_all(load, errors, tmp_path):
    files = load("reshade_addon.files")
    (tmp_path / "old.txt").write_text("old")

    def attempt(error):
        with files.Outputs() as outputs:
            for name in ("old.txt", "new.txt"):
                outputs.path(tmp_path / name).write_text("new")
            outputs.path(tmp_path / "never written.txt")
            if error:
                raise error

    for error in (ValueError, KeyboardInterrupt):
        with pytest.raises(error):
            attempt(error)
        assert [path.name for path in tmp_path.iterdir()] == ["old.txt"]
        assert (tmp_path / "old.txt").read_text() == "old"
    attempt(None)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["new.txt", "old.txt"]
    assert (tmp_path / "old.txt").read_text() == "new"


@pytest.mark.parametrize("name", ["missing/x.png", "file.txt/x.png", "."])
def test_an_output_that_cannot_be_is_refused_beforehand(load, errors, tmp_path, name):
    (tmp_path / "file.txt").write_text("")
    with load("reshade_addon.files").Outputs() as outputs, pytest.raises(errors.ReshadeError, match="output"):
        outputs.path(tmp_path / name)
