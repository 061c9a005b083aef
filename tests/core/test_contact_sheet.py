"""The contact sheet shows pictures as they are, scales them in linear light and says what its colours mean."""

import numpy as np
import pytest
from PIL import Image

from core.color import linear_to_srgb
from demo_blend import contact_sheet as sheets
from demo_blend.contact_sheet import Facts, Panel


def flat(value, shape=(50, 75)):
    return np.full((*shape, 3), value)


def test_encoding_is_srgb_and_decoding_undoes_it():
    linear = np.linspace(0, 1, 1000)
    np.testing.assert_array_equal(sheets.encode(linear), np.rint(255 * linear_to_srgb(linear)))
    np.testing.assert_allclose(sheets.decode(linear_to_srgb(linear)), linear, atol=1e-6)


def test_scaling_keeps_the_light_of_a_fine_pattern():
    pattern = np.indices((64, 64)).sum(axis=0) % 2
    small = sheets.scaled(np.repeat(pattern[..., None], 3, axis=-1).astype(float), 16)
    assert small.shape == (16, 16, 3)
    np.testing.assert_allclose(small[2:-2, 2:-2], 0.5, atol=0.02)


def test_scaling_does_not_overshoot():
    edge = np.repeat(np.repeat((np.arange(20) > 9)[None, :, None], 20, 0), 3, -1).astype(float)
    large = sheets.scaled(edge, 90)
    assert large.min() == 0.0
    assert large.max() == 1.0


def test_a_residual_is_orange_where_the_photo_is_brighter_and_blue_where_it_is_darker():
    photo, render = flat(0.5), flat(0.5)
    photo[:, :25] = 0.6
    photo[:, 50:] = 0.4
    picture, extent = sheets.residual(photo, render)
    assert extent == 20  # 0.6 is 15 steps above 0.5, 0.4 is 18 below: rounded up to tens
    brighter, same, darker = picture[0, 0], picture[0, 37], picture[0, 60]
    assert brighter[0] > 2 * brighter[2]
    assert darker[2] > 2 * darker[0]
    np.testing.assert_allclose(linear_to_srgb(same), sheets.COLOURS[2], atol=1e-6)


@pytest.mark.parametrize("count", [2, 5])
def test_panels_stand_in_reading_order_with_the_facts_last(count):
    levels = np.linspace(0.1, 0.9, count)
    panels = [Panel(f"Panel {i}", "a caption " * 20, flat(level)) for i, level in enumerate(levels)]
    page = sheets.sheet("Title", "subtitle", panels, Facts("Facts", (("Label", "value"),), "A note."))
    assert page.mode == "RGB"
    assert page.width == sheets.WIDTH
    pixels = np.asarray(page)
    middles = [np.flatnonzero((pixels == sheets.encode(flat(level))[0, 0]).all(axis=-1)) for level in levels]
    places = [np.array(np.unravel_index(found, pixels.shape[:2])).mean(axis=1) for found in middles]
    columns = [place[1] for place in places[:3]]
    assert columns == sorted(columns)
    if count == 5:
        assert places[3][0] > places[0][0] + 300
        assert places[3][1] == pytest.approx(places[0][1], abs=20)


def test_a_bar_reaches_from_one_end_of_its_colours_to_the_other():
    picture, extent = sheets.residual(flat(0.2), flat(0.3))
    panels = [Panel("Residual", "steps", picture, extent)]
    page = np.asarray(sheets.sheet("T", "s", panels, Facts("F", (("a", "b"),))))
    for end in (0, -1):
        colour = sheets.encode(sheets.bar_colours(np.array([-1.0, 1.0])[end]))
        assert (page == colour).all(axis=-1).any()


def test_the_sheet_can_be_written_as_png(tmp_path):
    page = sheets.sheet("T", "s", [Panel("P", "c", flat(0.5))], Facts("F", (("a", "b", "c"), ("1", "2", "3"))))
    page.save(tmp_path / "sheet.png")
    with Image.open(tmp_path / "sheet.png") as read:
        assert read.size == page.size
