"""The report: every field of the schema, and numbers that JSON can hold."""

import json

import numpy as np
import pytest

from core.light.uncertainty import plain
from core.report import to_dict
from core.types import AreaLight, Candidate, Estimate, PointLight, SunLight, Surface, Uncertainty

AREA = AreaLight(np.array([1.0, 2, 3]), np.eye(3)[0], np.eye(3)[1], np.array([0.5, 0.2]), np.array([4.0, 3.0, 2.0]))


def estimate(light=AREA, **changes):
    sure = Uncertainty(0.01, np.radians(2), np.array([0.1, 0.2]), 0.05, "its width")
    values = {
        "lights": (light,), "ambient": np.full(3, 0.1), "surfaces": (Surface("wall", np.array([0.8, 0.7, 0.6]), 120),),
        "uncertainty": (sure,), "rms": 0.02, "noise": 0.01, "mean_abs_8bit": np.array([1.0, 2.0, 3.0]),
        "chosen": "area light", "candidates": (Candidate("area", -10.0, 1.5),), "scale": "convention",
        "seconds": {"fit": 1.0, "total": 2.0},
    }  # fmt: skip
    return Estimate(**{**values, **changes})


def test_an_area_light_in_all_its_fields():
    report = json.loads(json.dumps(to_dict(estimate(), "standard", ["Key"]), allow_nan=False))
    (light,) = report["lights"]
    assert light["type"] == "AREA" and light["name"] == "Key"
    assert light["centre"] == [1, 2, 3] and light["size"] == [0.5, 0.2]
    np.testing.assert_allclose(light["normal"], [0, 0, -1])
    np.testing.assert_allclose(light["energy"] * np.array(light["color"]), np.pi * 0.1 * AREA.radiance)
    assert light["uncertainty"]["normal_deg"] == pytest.approx(2)
    assert report["residual"]["rms_over_noise"] == pytest.approx(2)
    assert report["surfaces"]["wall"]["samples"] == 120
    assert report["ambient"]["model"] == "constant"
    assert report["model"]["candidates"] == [{"name": "area", "score": -10, "seconds": 1.5}]
    assert set(report) == {
        "schema", "quality", "seconds", "lights", "ambient", "surfaces", "residual", "model", "scale", "warnings",
    }  # fmt: skip


def test_a_sun_has_no_centre_and_an_angle():
    sun = SunLight(np.array([0.0, 0.0, -1.0]), np.full(3, 3.0), 0.02)
    (light,) = to_dict(estimate(sun), "draft", ["Sun"])["lights"]
    assert light["type"] == "SUN" and light["energy"] == 3 and light["angle"] == 0.02
    assert "centre" not in light and "size" not in light


def test_a_point_gives_its_power():
    point = PointLight(np.zeros(3), np.full(3, 2.0))
    (light,) = to_dict(estimate(point), "draft", ["Lamp"])["lights"]
    assert light["energy"] == pytest.approx(8 * np.pi) and "size" not in light


def test_no_number_is_ever_nan_or_infinite():
    broken = estimate(rms=float("nan"), noise=0.0, ambient=np.array([np.inf, 0.0, 0.0]))
    assert json.dumps(to_dict(broken, "standard", ["Key"]), allow_nan=False)


def test_a_failed_estimate_says_why():
    failed = estimate(message="No light explains it")
    assert not failed
    assert to_dict(failed, "standard", ["Key"])["warnings"][0] == "No light explains it"


@pytest.mark.parametrize(
    ("value", "digits", "written"),
    [(12.3, 1, "10"), (0.0456, 2, "0.046"), (1600.0, 2, "1600"), (1e-5, 1, "0.00001"), (0.0, 2, "0"), (3.0, 3, "3")],
)
def test_numbers_for_people_have_no_exponent(value, digits, written):
    assert plain(value, digits) == written
