"""Flat fields in raw files: light by radius, the tilt of the illumination, and pictures that are of no use."""

from dataclasses import replace

import numpy as np
import pytest

from flat_pictures import NM, flat_light, mounted, write_flat
from lensfield.engine import ImageError
from lensfield.engine.fitting.flat_fields import read_flat_field
from lensfield.engine.fitting.vignetting import light_of
from lensfield.engine.library import prescription_of
from lensfield.engine.sensor.colour import channel_weights
from raw_pictures import small_camera
from refusals import refused
from seed import SEED

HELIOS, SENSOR_MM = prescription_of("helios-44-2-58mm"), (36.0, 24.0)


@pytest.fixture(scope="module")
def even():
    return flat_light(HELIOS, 2.8, SENSOR_MM)


def read(path, **given):
    return read_flat_field(path, SENSOR_MM, 58.6, **given)


@pytest.mark.parametrize("filters", [("RG", "GB"), ("G",), ()], ids=["mosaic", "monochrome", "all channels"])
def test_the_light_of_the_lens_returns_without_the_tilt(tmp_path, filters):
    tilted = flat_light(HELIOS, 2.8, SENSOR_MM, (0.11, -0.06))
    write_flat(tmp_path / "flat.dng", tilted, mounted(58.0, 2.8), filters=filters, seed=SEED)
    field = read(tmp_path / "flat.dng", focus_mm=1200.0)
    assert (field.curve.f_number, field.curve.focus_mm) == (2.8, 1200.0)
    assert field.curve.heights_mm[-1] > 0.9 * np.hypot(*SENSOR_MM) / 2
    expected, = light_of(HELIOS, [replace(field.curve, focus_mm=np.inf)])
    assert expected[-1] < 0.75 and np.abs(field.curve.light - expected).max() < 0.01
    assert field.tilt == pytest.approx(np.hypot(0.11, 0.06), abs=0.005)
    assert field.towards_deg == pytest.approx(np.degrees(np.arctan2(-0.06, 0.11)), abs=3)
    assert str(field).startswith("flat.dng: f/2.8, illumination tilted by 12")


def test_only_green_counts(tmp_path, even):
    """Red and blue light is tilted, of which green pixels collect a part."""
    tilted = even * np.linspace(0.5, 1.5, even.shape[1])
    write_flat(tmp_path / "flat.dng", np.stack([tilted, even, tilted]), mounted(58.6, 2.8), seed=SEED)
    camera = small_camera()
    blue, green, red = channel_weights(camera, NM)[camera.channels.index("G")]
    slope = 0.5 * np.hypot(*SENSOR_MM) / SENSOR_MM[0]
    assert read(tmp_path / "flat.dng").tilt == pytest.approx(slope * (blue + red) / (blue + green + red), abs=0.01)


def test_given_f_numbers_take_the_place_of_missing_ones(tmp_path, even):
    write_flat(tmp_path / "flat.dng", even)
    with refused(ImageError, field="f-number in EXIF", where="flat.dng", value="missing", match="--f-numbers"):
        read(tmp_path / "flat.dng")
    assert read(tmp_path / "flat.dng", f_number=2.8).curve.f_number == 2.8


def test_clipped_pictures_are_refused(tmp_path, even):
    write_flat(tmp_path / "flat.dng", even, mounted(58.6, 2.8), level=1.3)
    with refused(ImageError, field="exposure", where="flat.dng", match=r"of the green pixels clipped: expose a stop"):
        read(tmp_path / "flat.dng")


def test_dark_pictures_are_refused(tmp_path, even):
    write_flat(tmp_path / "flat.dng", even, mounted(58.6, 2.8), level=0.01)
    with refused(ImageError, field="exposure", where="flat.dng", match="expose longer"):
        read(tmp_path / "flat.dng")


def test_a_steep_tilt_is_refused(tmp_path):
    write_flat(tmp_path / "flat.dng", flat_light(HELIOS, 2.8, SENSOR_MM, (0.3, 0.25)), mounted(58.6, 2.8))
    with refused(ImageError, field="illumination", where="flat.dng", match="tilted by (38|39|40)%"):
        read(tmp_path / "flat.dng")


def test_a_pattern_is_not_an_even_field(tmp_path, even):
    stripes = 1 + 0.2 * np.sin(np.arange(even.shape[1]) / 25)
    write_flat(tmp_path / "flat.dng", even * stripes, mounted(58.6, 2.8))
    with refused(ImageError, field="field", where="flat.dng", match="uneven by .*: expected at most 3%"):
        read(tmp_path / "flat.dng")


def test_a_picture_with_another_focal_length_is_of_another_lens(tmp_path, even):
    write_flat(tmp_path / "flat.dng", even, mounted(85.0, 2.8))
    with refused(ImageError, field="focal length in EXIF", where="flat.dng", value="85 mm", match="about 58.6 mm"):
        read(tmp_path / "flat.dng")


@pytest.mark.parametrize("contents", [b"", b"II*\0 not a raw file at all"])
def test_other_files_are_refused(tmp_path, contents):
    (tmp_path / "flat.dng").write_bytes(contents)
    with refused(ImageError, field="raw picture", where="flat.dng"):
        read(tmp_path / "flat.dng")
