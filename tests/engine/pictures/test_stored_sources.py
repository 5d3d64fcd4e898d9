"""Sources of stray light in radiance files."""

from dataclasses import replace

import numpy as np
import OpenEXR
import pytest

from lensfield.engine import ImageError
from lensfield.engine.image.sources import Sources
from lensfield.engine.image.spectral_image import SpectralImage
from lensfield.engine.pictures.spectral_exr import read_exr, read_sources, write_exr
from lensfield.engine.pictures.stored_sources import ATTRIBUTE
from refusals import refused

NM = np.array([450.0, 1e3 / 3 + 200])
PICTURE = SpectralImage(np.ones((2, 4, 6), np.float32), NM, pitch_um=5.0, overscan_px=(1, 1))


def some_sources(count):
    rng = np.random.default_rng(4)
    distance_mm = np.where(np.arange(count) % 2, np.inf, rng.random(count))
    return Sources(rng.normal(size=(count, 3)), distance_mm, 10.0**rng.normal(0, 30, (count, 2)), NM,
                   rng.random(count), tuple(f'lamp "{index}",\n λ' for index in range(count)))


@pytest.mark.parametrize("count", [0, 1, 300])
def test_sources_are_read_back_bit_for_bit(tmp_path, count):
    path, written = tmp_path / "a.exr", some_sources(count)
    write_exr(PICTURE, path, outside=written)
    read = read_sources(path)
    assert read.names == written.names
    for name in ("directions", "distance_mm", "irradiance", "radius_rad"):
        assert np.array_equal(getattr(read, name), getattr(written, name)), name
    picture = read_exr(path)
    assert np.array_equal(picture.cube, PICTURE.cube)
    assert np.array_equal(read.wavelengths_nm, picture.wavelengths_nm), "as the names of channels round them"


def test_sources_at_other_wavelengths_than_the_picture_are_refused(tmp_path):
    for nm in (NM + 1e-5, NM[:1]):
        sources = replace(some_sources(3), wavelengths_nm=nm, irradiance=np.ones((3, len(nm))))
        write_exr(PICTURE, tmp_path / "a.exr", outside=sources)
        with refused(ImageError, field="wavelengths in lensfield:sources", where="a.exr"):
            read_sources(tmp_path / "a.exr")


def test_files_without_sources(tmp_path):
    write_exr(PICTURE, tmp_path / "a.exr")
    assert read_sources(tmp_path / "a.exr") is None


@pytest.mark.parametrize("text", [
    "", "{", "[]", "3", '{"wavelengths_nm": [500]}', '{"wavelengths_nm": [500], "sources": [{"name": "a"}]}',
    '{"wavelengths_nm": [500], "sources": [{"name": "a", "direction": [0, 0], "distance_mm": null, "radius_rad": 0, '
    '"irradiance": [1]}]}',
    '{"wavelengths_nm": [500], "sources": [{"name": "a", "direction": [0, 0, 1], "distance_mm": -1, "radius_rad": 0, '
    '"irradiance": [1]}]}', 10**5 * "["])
def test_damaged_sources_are_refused(tmp_path, text):
    path = tmp_path / "a.exr"
    with OpenEXR.File({ATTRIBUTE: text}, {"Y": np.ones((2, 2), np.float32)}) as file:
        file.write(str(path))
    with pytest.raises(ImageError) as error:
        read_sources(path)
    assert "a.exr" in str(error.value) and "\n" not in str(error.value)
