"""Developed pictures: exact where light is even, in place, true in colour, and without bias in the dark."""

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from lensfield.engine import ImageError, SpectralImage
from lensfield.engine.pictures.develop import camera_rgb, developed, developed_in, signal, write_linear_exr
from lensfield.engine.pictures.rgb_picture import read_rgb_exr
from lensfield.engine.pictures.spectral_exr import read_parts
from lensfield.engine.runtime.errors import CameraError
from lensfield.engine.sensor.electrons import response
from lensfield.engine.sensor.exposure import Exposure, expose
from lensfield.engine.spectral.colour import REC709_TO_XYZ
from places import ROOT
from raw_pictures import QUAD_BAYER, XTRANS, chart_error, chart_raw, small_camera, uneven_raw
from refusals import refused
from seed import SEED

pytestmark = pytest.mark.one_blender

DEMOSAICED = [("RG", "GB"), ("GB", "RG"), XTRANS, QUAD_BAYER]
PATTERNS = [*DEMOSAICED, ()]
CAMERAS = "sony-a7-iv", "canon-eos-r5", "fujifilm-x-t4", "generic-phone-48", "generic-three-chip"
NM = np.linspace(400, 700, 16)


def ids(filters):
    return "-".join(filters[:2]) or "three-chip"


def flat_raw(camera, level, shape_px=(123, 201), **exposure):
    light = SpectralImage(np.full((16, *shape_px), level), NM, pitch_um=4.0, quantity="irradiance")
    return expose(light, camera, Exposure(1 / 60, 200.0, **exposure))


@pytest.mark.parametrize("filters, bits", [*zip(PATTERNS, (12, 16, 14, 16, 12), strict=True)])
def test_even_light_has_the_signal_of_its_electrons_in_every_pixel(filters, bits):
    camera = small_camera(filters=filters, bits=bits, black_dn=200.0, gain_dn_per_e=0.1 * 2**(bits - 12),
                          dark_current_e_per_s=60.0)
    picture = camera_rgb(flat_raw(camera, 1e-4, noise=False))
    electrons = response(camera, NM).sum(axis=1) * 1e-4 / 60
    full_e = min(camera.saturation_e, (2**bits - 1 - 200) / (0.2 * 2**(bits - 12))) - 1
    half = 2 if filters == QUAD_BAYER else 1
    assert abs(picture.shape[0] - 123 // half) <= 1 and abs(picture.shape[1] - 201 // half) <= 1
    np.testing.assert_allclose(picture, np.broadcast_to(electrons / full_e, picture.shape), atol=6e-4)


@pytest.mark.parametrize("filters", DEMOSAICED, ids=ids)
def test_demosaicing_returns_what_three_chips_see(filters):
    """A picture without symmetry: its mosaic is in place, unmirrored, and its channels are not exchanged."""
    plain, mosaic = (camera_rgb(uneven_raw(small_camera(filters=each), (122, 202), noise=False))
                     for each in ((), filters))
    if filters == QUAD_BAYER:
        above, left = ((n - part) // 2 % 2 for n, part in zip((301, 402), (122, 202), strict=True))
        plain = plain[above:, left:][:2 * len(mosaic), :2 * mosaic.shape[1]]
        plain = plain.reshape(len(mosaic), 2, -1, 2, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(mosaic[4:-4, 4:-4], plain[4:-4, 4:-4], rtol=0.02, atol=1e-3)


@pytest.mark.parametrize("filters", [("RG", "GB"), XTRANS], ids=ids)
def test_noise_in_the_dark_has_no_bias(filters):
    picture = camera_rgb(flat_raw(small_camera(filters=filters, dark_noise_e=20.0), 0.0, seed=SEED))
    deviations = picture.std(axis=(0, 1)) * np.sqrt(40 / picture[..., 0].size)  # neighbours share their noise
    assert np.all(np.abs(picture.mean(axis=(0, 1))) < 5 * deviations) and picture.min() < 0


@pytest.mark.parametrize("name, filters", [*zip(CAMERAS, PATTERNS, strict=True)])
def test_the_chart_has_its_colours(name, filters):
    picture = developed(chart_raw(small_camera(name, filters)))
    if filters == QUAD_BAYER:
        picture = picture.repeat(2, 0).repeat(2, 1)
    errors = chart_error(picture @ REC709_TO_XYZ.T)
    assert np.median(errors) < 1.5 and errors.max() < 6


def test_saturated_light_is_white_and_monochrome_pictures_are_grey():
    assert developed(flat_raw(small_camera(), 1.0))[5:-5, 5:-5] == pytest.approx(1, abs=2e-3)
    raw = uneven_raw(small_camera(filters=("G",)), (7, 9))
    np.testing.assert_array_equal(developed(raw), np.repeat(signal(raw)[..., None], 3, axis=-1))


def test_patterns_that_libraw_would_get_wrong_are_refused():
    camera = small_camera()
    white = replace(camera, filters=("RW", "WB"), channels="RGBW",
                    quantum_efficiency=np.vstack([camera.quantum_efficiency, camera.quantum_efficiency[1]]))
    for each in (white, replace(camera, filters=("RGB",)), replace(camera, filters=("RRGG", "GGBB"))):
        with pytest.raises(CameraError, match=f"filters is {'/'.join(each.filters)}: expected a Bayer, Quad Bayer"):
            developed(uneven_raw(each, (40, 50)))
    with refused(ImageError, field="size", where="raw picture", match="expected at least 12 rows"):
        developed(uneven_raw(camera, (5, 50)))


@pytest.mark.parametrize("filters, mosaic, names", [(("RG", "GB"), True, "Y"), (("RG", "GB"), False, "RGB"),
                                                   ((), False, "RGB"), (("G",), False, "Y")])
def test_linear_pictures_are_no_colours_of_another_space(tmp_path, filters, mosaic, names):
    raw = uneven_raw(small_camera(filters=filters), (41, 50))
    light = signal(raw) if mosaic else camera_rgb(raw)
    write_linear_exr(light, raw.camera, tmp_path / "a.exr")
    (_, planes), = read_parts(tmp_path / "a.exr")
    assert set(planes) == set(names)
    np.testing.assert_array_equal(np.dstack([planes[name] for name in names]), np.atleast_3d(light))
    with refused(ImageError, field="colorInteropID", value="data", where="a.exr"):
        read_rgb_exr(tmp_path / "a.exr")


TWICE = """
import numpy as np
from lensfield.engine.library.bodies import load_camera
from lensfield.engine.pictures.develop import developed
from lensfield.engine.sensor.exposure import Exposure, RawImage, channels_of
from raw_pictures import small_camera

camera = small_camera("fujifilm-x-t4", load_camera("fujifilm-x-t4").filters, (1300, 1500))
numbers = np.random.default_rng(1).integers(500, 15000, camera.shape_px).astype(np.uint16)
raw = RawImage(numbers, channels_of(camera, camera.shape_px), camera, Exposure(1 / 60, 100.0), None)
assert np.array_equal(developed(raw), developed(raw))
"""


def test_x_trans_is_developed_in_the_same_way_each_time():
    """In a process of its own: the tests load LibRaw with as many threads as there are processors."""
    subprocess.run([sys.executable, "-c", TWICE], check=True,
                   env=os.environ | {"PYTHONPATH": str(ROOT / "tests" / "support")})


@pytest.mark.parametrize("filters", [*PATTERNS, ("RGWG", "BWGR")], ids=ids)
def test_larger_pixels_have_the_means_of_each_channel(filters):
    """A square of 20 pixels with other light around it looks like a picture of its light alone."""
    camera = small_camera(filters=(), shape_px=(200, 280))
    camera = replace(camera, filters=filters, channels="RGBW", quantum_efficiency=np.vstack([
        camera.quantum_efficiency, camera.quantum_efficiency.max(axis=0)])) if "W" in "".join(filters) else replace(
            camera, filters=filters)
    electrons = np.random.default_rng(SEED).uniform(0.01, 0.03, (NM.size, 10, 14)).astype(np.float32)
    image = SpectralImage(electrons.repeat(20, 1).repeat(20, 2), NM, pitch_um=camera.pitch_um, quantity="irradiance")
    raw = expose(image, camera, Exposure(1e-4, 100.0, noise=False))
    assert raw.saturated == 0
    larger = developed_in(raw, (10, 14), 20 * camera.pitch_um)
    square = replace(image, cube=np.broadcast_to(image.cube[:, 30:31, 250:251], image.cube.shape))
    alone = developed_in(expose(square, camera, raw.exposure), (10, 14), 20 * camera.pitch_um)
    np.testing.assert_allclose(larger[1, 12], alone[4, 4], atol=2e-3 * larger.max())
    assert larger.shape == (10, 14, 3) and np.ptp(larger) > 0.1 * larger.max()
