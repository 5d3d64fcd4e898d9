"""Prices of work: excessive memory is refused before the start, with the number; absent or excessive light is reported.
"""

import subprocess
import sys

import numpy as np
import pytest

from lensfield.engine import ChannelCache, ImageError, Options, Report, SpectralImage, load_lens, simulate
from lensfield.engine.pictures.preview import encode_srgb, write_png
from lensfield.engine.pictures.spectral_exr import read_with_planes, write_exr
from lensfield.engine.plan import cost
from lensfield.engine.runtime import memory
from refusals import refused

LENS = load_lens("edmund-54852")


def picture(cube=None, **changes):
    cube = np.ones((2, 40, 60), np.float32) if cube is None else cube
    return SpectralImage(**dict(cube=cube, wavelengths_nm=[500.0, 600.0], pitch_um=20.0) | changes)


@pytest.fixture
def one_gigabyte(monkeypatch):
    monkeypatch.setattr(memory, "available_bytes", lambda: 10**9)


@pytest.mark.parametrize("options, changes", [
    (Options(azimuths=100_000), {}),
    (Options(method="pixels", azimuths=1000), {"pitch_um": 0.5}),
    (Options(azimuths=4, psf_energy=0.9), {"cube": np.broadcast_to(np.float32(1), (2, 12_000, 12_000)),
                                           "pitch_um": 0.3}),
], ids=["azimuths", "pitch", "size"])
def test_work_that_exceeds_memory_is_refused_with_its_size(one_gigabyte, options, changes):
    with pytest.raises(ImageError, match=r"^image: size is [\d.]+ GB in memory: 1 GB are free: give a smaller picture"):
        ChannelCache().plan(options, LENS, picture(**changes))
    with refused(ImageError, field="size", where="image"):
        simulate(picture(**changes), LENS, options)


def test_pixels_whose_psfs_alone_exceed_memory_are_refused_at_once(one_gigabyte):
    with pytest.raises(ImageError, match=r"^point spread functions: size is [\d.]+ GB in memory: .*larger pixels"):
        ChannelCache().plan(Options(), LENS, picture(pitch_um=0.05))


def test_work_that_fits_in_memory_is_accepted(one_gigabyte):
    assert simulate(picture(), LENS).cube.shape == (2, 40, 60)


def test_the_peak_is_the_memory_in_use_plus_the_memory_needed(monkeypatch):
    monkeypatch.setattr(cost, "taken_bytes", lambda: 10**8)
    plan = ChannelCache().plan(Options(), LENS, picture())
    assert plan.peak_mb == pytest.approx(100 + plan.memory_mb + 2 * 40 * 60 * 4e-6)
    assert f"{plan.peak_mb:.0f} MB" in plan.text


TAKE = """import numpy as np
from lensfield.engine.runtime.memory import taken_bytes
before = taken_bytes()
held = np.ones(2**25)
print(before, taken_bytes() - before, held.nbytes)"""


def test_memory_in_use_is_reported():
    # in a process of its own: threads of other tests may be allocating in this one
    lines = subprocess.run([sys.executable, "-c", TAKE], check=True, capture_output=True, text=True).stdout
    before, taken, held = map(int, lines.split())
    if not before:
        pytest.skip("this system does not report it")
    assert taken == pytest.approx(held, rel=0.1)


def test_each_plane_of_a_file_is_in_memory_once(tmp_path):
    write_exr(picture(), tmp_path / "picture.exr", {"Z": np.ones((40, 60), np.float32)})
    image, planes = read_with_planes(tmp_path / "picture.exr")
    assert sum(np.shares_memory(plane, image.cube) for plane in planes.values()) == len(image.cube)


@pytest.mark.parametrize("rows", [1, 63, 64, 65, 200])
def test_encoding_a_picture_by_rows_changes_nothing(tmp_path, rows):
    from PIL import Image

    rec709 = np.random.default_rng(1).random((rows, 30, 3), np.float32) * 3 - 1
    write_png(rec709, tmp_path / "picture.png", 0.7)
    with Image.open(tmp_path / "picture.png") as written:
        np.testing.assert_array_equal(written, np.round(encode_srgb(rec709 * 0.7) * 255).astype(np.uint8))


@pytest.mark.parametrize("cube, word", [
    (np.where(np.arange(60) < 6, -1, 1) * np.ones((2, 40, 1)), "11.1% of the radiance is negative, which is not"),
    (np.full((2, 40, 60), 2e36), "radiance of up to 2e+36 W m^-2 sr^-1 nm^-1 is close to the limit of"),
    (np.ones((2, 40, 60)), None)], ids=["negative", "bright", "light"])
def test_negative_or_excessive_radiance_gets_a_remark(cube, word):
    report = Report()
    simulate(picture(cube), LENS, report=report)
    remarks = [line for line in report.remarks() if "radiance" in line]
    assert [line.startswith(word) for line in remarks] == [True] if word else not remarks


def test_irradiance_written_over_its_radiance_takes_no_memory(monkeypatch):
    monkeypatch.setattr(cost, "taken_bytes", lambda: 0)
    image, reports = picture(), [Report(), Report()]
    simulate(image, LENS, report=reports[0])
    frame = tuple(slice(n, n + side) for n, side in zip(image.overscan_px, image.frame_px, strict=True))
    simulate(image, LENS, report=reports[1], out=image.cube[(slice(None), *frame)])
    apart, in_place = (report.lens_image.plan.peak_mb for report in reports)
    assert apart - in_place == pytest.approx(4e-6 * image.wavelengths_nm.size * np.prod(image.frame_px))
