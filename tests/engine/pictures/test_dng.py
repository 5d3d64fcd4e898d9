"""Raw files: their fields, and what other programs make of them."""

import re
import struct
from dataclasses import replace

import numpy as np
import pytest
import rawpy
from scipy.ndimage import map_coordinates

from converters import CONVERTERS, installed
from dng_fields import fields
from lensfield.engine import InputError, Options, SpectralImage, load_lens, simulate
from lensfield.engine.field.lens_correction import LensCorrection, lens_correction
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.pictures.develop import developed
from lensfield.engine.pictures.dng import MountedLens, dng_samples, write_dng
from lensfield.engine.runtime.errors import CameraError
from lensfield.engine.sensor.colour import camera_colour, channel_weights
from lensfield.engine.sensor.electrons import response
from lensfield.engine.sensor.exposure import Exposure, expose, raw_grid
from lensfield.engine.spectral.colour import REC709_TO_XYZ
from lensfield.engine.spectral.spectra import load_spectrum
from places import ROOT
from raw_files import CHART_TABLE, LENS_TABLE, lens_row
from raw_pictures import NM, QUAD_BAYER, XTRANS, chart_error, chart_raw, small_camera, uneven_light, uneven_raw
from refusals import refused
from seed import SEED

pytestmark = pytest.mark.one_blender

PATTERNS = [("RG", "GB"), ("GR", "BG"), ("BG", "GR"), ("GB", "RG"), XTRANS, QUAD_BAYER, ("RGRG", "GBGB"), ("G",), ()]
LENS = MountedLens("Edmund 54-852", 6.0, 2.8)
DOTS_PX = 48


@pytest.mark.parametrize("filters", PATTERNS, ids=lambda filters: "-".join(filters[:2]) or "three-chip")
def test_libraw_reads_every_pixel_and_its_filter(tmp_path, filters):
    raw = uneven_raw(small_camera(filters=filters), (123, 201))
    write_dng(raw, tmp_path / "a.dng", LENS)
    with rawpy.imread(str(tmp_path / "a.dng")) as file:
        planes = raw.numbers if raw.channel is None else raw.numbers[None]
        read = np.atleast_3d(file.raw_image)
        np.testing.assert_array_equal(np.moveaxis(read, -1, 0)[:len(planes)], planes)
        if raw.channel is not None and len(filters) in (2, 6):  # it does not know Quad Bayer
            letters = np.array(list(file.color_desc.decode()))[file.raw_colors]
            np.testing.assert_array_equal(letters, np.array(list("RGB"))[raw.channel])


def test_the_file_states_levels_colours_and_how_the_picture_was_taken(tmp_path):
    camera = small_camera(black_dn=510.0, dark_current_e_per_s=40.0, filters=("GB", "RG"))
    raw = expose(uneven_light((123, 201)), camera, Exposure(1 / 8, 400.0, SEED, serial=7))
    write_dng(raw, tmp_path / "a.dng", LENS)
    tags, exif = fields(tmp_path / "a.dng")
    assert tags[50706] == bytes([1, 6, 0, 0]) and tags[50708] == "Lensfield Sony Alpha 7 IV"
    assert tuple(tags[33421]) == (2, 2) and tags[33422] == bytes([[0, 1, 2][n] for n in raw.channel[:2, :2].ravel()])
    assert tags[50714] == pytest.approx(510 + camera.gain_at(400) * 40 / 8, rel=1e-9)
    assert tags[50717] == min(2**14 - 1, int(510 + camera.gain_at(400) * camera.saturation_e))
    colour = camera_colour(camera)
    np.testing.assert_allclose(np.reshape(tags[50721], (3, 3)), colour.xyz_to_camera, atol=5e-6)
    np.testing.assert_allclose(tags[50728], colour.neutral, atol=5e-6)
    assert tags[50778] == 21 and tags[274] == 1 and tuple(tags[50829]) == (0, 0, 123, 201)
    assert (exif[33434], exif[33437], exif[34855], exif[37386], exif[42036]) == (1 / 8, 2.8, 400, 6.0, "Edmund 54-852")


def test_other_orders_of_the_channels_give_the_same_planes(tmp_path):
    camera = small_camera()
    shuffled = replace(camera, channels="BRG", quantum_efficiency=camera.quantum_efficiency[[2, 0, 1]])
    for filters in (("RG", "GB"), ()):
        for name, each in (("a", camera), ("b", shuffled)):
            write_dng(uneven_raw(replace(each, filters=filters), (40, 50), noise=False), tmp_path / f"{name}.dng")
        assert (tmp_path / "a.dng").read_bytes() == (tmp_path / "b.dng").read_bytes()


def test_four_channels_are_four_planes(tmp_path):
    camera = small_camera()
    white = np.minimum(camera.quantum_efficiency.sum(axis=0), 1)
    camera = replace(camera, filters=("RWGW", "WRWG", "GWBW", "WGWB"), channels="RGBW",
                     quantum_efficiency=np.vstack([camera.quantum_efficiency, white]))
    raw = uneven_raw(camera, (40, 52))
    write_dng(raw, tmp_path / "a.dng")
    tags, _ = fields(tmp_path / "a.dng")
    assert tags[50710] == bytes([0, 1, 2, 6]) and len(tags[50721]) == 12 and len(tags[50728]) == 4
    pattern = np.frombuffer(tags[33422], np.uint8).reshape(tags[33421].astype(int))
    np.testing.assert_array_equal(np.tile(pattern, (10, 13)), np.array([0, 1, 2, 6])[raw.channel])


def test_the_noise_profile_is_the_variance_of_flat_pictures(tmp_path):
    camera = small_camera(filters=("G",), shape_px=(400, 400), prnu=0.0, dark_current_e_per_s=50.0, dsnu_e=4.0)
    for level in (0.0, 0.002, 0.006):
        light = SpectralImage(np.full((1, 400, 400), level), [550.0], pitch_um=4.0, quantity="irradiance")
        raw = expose(light, camera, Exposure(1 / 60, 800.0, SEED))
        write_dng(raw, tmp_path / "a.dng")
        tags, _ = fields(tmp_path / "a.dng")
        signal = (raw.numbers - tags[50714]) / (tags[50717] - tags[50714])
        slope, constant = tags[51041]
        expected = slope * signal.mean() + constant
        assert signal.var() == pytest.approx(expected, abs=5 * expected * np.sqrt(2 / signal.size))
    write_dng(replace(raw, exposure=replace(raw.exposure, noise=False)), tmp_path / "a.dng")
    assert 51041 not in fields(tmp_path / "a.dng")[0]


def test_the_noise_profile_contains_the_rounding_to_whole_numbers(tmp_path):
    """At a low gain it is a third of the variance. Together, black levels at all fractions of a number are rounded
    evenly."""
    camera = replace(small_camera(filters=("G",), shape_px=(400, 400), prnu=0.0), gain_dn_per_e=0.08, base_iso=100.0,
                     dark_noise_e=2.0, readout_noise_dn=0.0)
    irradiance = 25 * 60 / response(camera, np.array([550.0]))[1, 0]  # 25 electrons in 1/60 s
    light = SpectralImage(np.full((1, 400, 400), irradiance), [550.0], pitch_um=4.0, quantity="irradiance")
    spread, expected = [], []
    for frame, black_dn in enumerate(np.linspace(64, 65, 8, endpoint=False)):
        raw = expose(light, replace(camera, black_dn=black_dn), Exposure(1 / 60, 100.0, SEED, frame))
        write_dng(raw, tmp_path / "a.dng")
        tags, _ = fields(tmp_path / "a.dng")
        (slope, constant), span_dn = tags[51041], tags[50717] - tags[50714]
        spread.append(raw.numbers.var())
        expected.append((slope * (raw.numbers.mean() - tags[50714]) / span_dn + constant) * span_dn**2)
    assert raw.numbers.mean() == pytest.approx(64.875 + 2, abs=0.05) and 1 / 12 > 0.3 * np.mean(expected)
    assert np.mean(spread) == pytest.approx(np.mean(expected), abs=5 * np.mean(expected) * np.sqrt(2 / 8 / 400**2))


def test_the_same_picture_gives_the_same_bytes_and_other_files_stay(tmp_path):
    raw = uneven_raw(small_camera(), (40, 50))
    for name in ("a.dng", "b.dng", "b.dng"):
        write_dng(raw, tmp_path / name, LENS)
    assert (tmp_path / "a.dng").read_bytes() == (tmp_path / "b.dng").read_bytes()
    (tmp_path / "holiday.dng").write_bytes(b"II*\0 not ours")
    with refused(InputError, field="file", value="an existing file that Lensfield did not write", where="holiday.dng"):
        write_dng(raw, tmp_path / "holiday.dng")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.dng", "b.dng", "holiday.dng"]


@pytest.mark.parametrize("channels, message", [("RGX", "channels is X: a DNG has only R, G, B"),
                                               ("RGBCM", "channels is RGBCM: a DNG has at most 4")])
def test_channels_without_a_code_are_refused(tmp_path, channels, message):
    camera = small_camera()
    efficiency = np.resize(camera.quantum_efficiency, (len(channels), camera.wavelengths_nm.size))
    camera = replace(camera, filters=(channels,), channels=channels, quantum_efficiency=efficiency)
    with pytest.raises(CameraError, match=message):
        write_dng(uneven_raw(camera, (40, 50)), tmp_path / "a.dng")
    assert not any(tmp_path.iterdir())


def opcodes(path):
    """{number: (flags, doubles after any count of planes)} of the third opcode list, by the specification."""
    data, found = fields(path)[0][51022], {}
    count, place = struct.unpack_from(">I", data)[0], 4
    for _ in range(count):
        number, _, flags, size = struct.unpack_from(">I4s2I", data, place)
        begin = 4 if number == 1 else 0
        found[number] = flags, struct.unpack_from(f">{(size - begin) // 8}d", data, place + 16 + begin)
        place += 16 + size
    assert place == len(data)
    return found


def test_opcodes_are_stored_as_the_specification_says(tmp_path):
    correction = LensCorrection((0.25, 0.75), np.arange(12.0).reshape(3, 4), np.arange(5.0), -0.1, 0.0, 0.0, 1.0)
    write_dng(uneven_raw(small_camera(), (40, 50)), tmp_path / "a.dng", correction=correction)
    assert list(opcodes(tmp_path / "a.dng").items()) == [
        (3, (1, (0, 1, 2, 3, 4, 0.25, 0.75))),
        (1, (1, (0, 1, 2, 3, 0, 0, 4, 5, 6, 7, 0, 0, 8, 9, 10, 11, 0, 0, 0.25, 0.75)))]
    write_dng(uneven_raw(small_camera(), (40, 50)), tmp_path / "b.dng", correction=replace(correction, warp=None,
                                                                                         gain=None))
    assert 51022 not in fields(tmp_path / "b.dng")[0]


def corrected(planes, path):
    """Planes (row, column, channel) with the opcodes of a file applied: first the gain, then the warp."""
    found = opcodes(path)
    *gain, right, down = found[3][1]
    warp = np.reshape(found[1][1][:-2], (planes.shape[-1], 6))
    last = np.subtract(planes.shape[:2], 1)
    centre = np.array([down, right]) * last
    rows, columns = np.indices(planes.shape[:2]) - centre[:, None, None]
    r2 = (rows**2 + columns**2) / np.sum(np.maximum(centre, last - centre)**2)
    even = planes * (1 + np.polyval([*gain[::-1], 0], r2))[..., None]
    sources = [np.polyval(terms[3::-1], r2) * [rows, columns] + centre[:, None, None] for terms in warp]
    return np.dstack([map_coordinates(even[..., channel], source) for channel, source in enumerate(sources)])


def test_the_opcodes_straighten_the_papers_lens(tmp_path):
    """Dots on a grid under daylight, through the lens and the camera, are on the grid again in every channel."""
    lens, nm = load_lens("edmund-54852"), np.linspace(420, 680, 9)
    frame = PixelGrid((384, 512), 9.375, centre_px=(199.5, 247.5))
    radiance = SpectralImage(load_spectrum("illuminant-d65").at(nm)[:, None, None] * dots(frame.framed(60)), nm,
                             grid=frame.framed(60))
    irradiance = simulate(radiance, lens, Options(accuracy=0.03))
    camera = replace(small_camera(filters=(), shape_px=frame.shape_px), pitch_um=9.375)
    raw = expose(irradiance, camera, Exposure(1.5e-7, 100.0, noise=False))
    grid = raw_grid(irradiance.grid, camera)
    correction = lens_correction(lens, grid, NM, channel_weights(camera, NM))
    write_dng(raw, tmp_path / "a.dng", correction=correction)
    plain = dng_samples(raw) - camera.black_dn
    straight = corrected(plain, tmp_path / "a.dng")
    assert grid.centre_px == frame.centre_px and not raw.saturated
    for channel in range(3):  # with the PSFs' coma, which moves the middle of dots by up to 0.1 px
        errors, light = np.transpose(list(displacements(straight[..., channel], grid)))
        assert errors.size > 60 and errors.max() < 1.2e-3 and np.ptp(light) < 0.05 * light.mean()
    errors, light = np.transpose(list(displacements(plain[..., 1], grid)))
    assert errors.max() > 0.05 and np.ptp(light) > 0.2 * light.mean()


def dots(grid, step_px=DOTS_PX):
    """Round dots, of 2 px standard deviation, on a square grid about the axis: array (row, column)."""
    down, across = (np.exp(-((np.arange(n) - axis + step_px / 2) % step_px - step_px / 2)**2 / 8)
                    for n, axis in zip(grid.shape_px, grid.centre_px, strict=True))
    return down[:, None] * across


def displacements(plane, grid, reach_px=14):
    """(distance of a dot from its place relative to the distance from the axis, its light) of the dots well inside."""
    for steps in np.ndindex(15, 15):
        offset = DOTS_PX * (np.array(steps) - 7)
        place = np.array(grid.centre_px) + offset
        first = np.rint(place).astype(int) - reach_px
        if np.hypot(*offset) > 90 and np.all(first > 2) and np.all(first + 2 * reach_px < np.subtract(plane.shape, 2)):
            dot = plane[first[0]:first[0] + 2 * reach_px + 1, first[1]:first[1] + 2 * reach_px + 1]
            mean = first + [dot.sum(axis=1 - axis) @ np.arange(2 * reach_px + 1) / dot.sum() for axis in (0, 1)]
            yield np.hypot(*(mean - place)) / np.hypot(*offset), dot.sum()


def adobe(path, capfd):
    """A file as Adobe's DNG SDK reads it; it prints warnings about files that violate the specification."""
    dngpy = pytest.importorskip("dngpy", reason="needs dngpy (pip install dngpy): Adobe's DNG SDK")
    capfd.readouterr()
    file = dngpy.Dng(str(path))
    assert "***" not in "".join(capfd.readouterr())
    return file


@pytest.mark.parametrize("filters", PATTERNS, ids=lambda filters: "-".join(filters[:2]) or "three-chip")
def test_adobes_sdk_validates_the_file(tmp_path, capfd, filters):
    raw = uneven_raw(small_camera(filters=filters), (123, 201))
    correction = LensCorrection((0.4, 0.6), np.tile([1, -0.1, 0.01, 0], (3, 1))[:1 if filters == ("G",) else 3],
                                np.full(5, 0.1), -0.1, 0.0, 0.0, 1.0)
    write_dng(raw, tmp_path / "a.dng", LENS, correction)
    file = adobe(tmp_path / "a.dng", capfd)
    np.testing.assert_array_equal(np.squeeze(file.raw_pixels), dng_samples(raw))
    taken = file.metadata
    assert (taken.exposure_time, taken.f_number, taken.iso, taken.focal_length) == (1 / 60, 2.8, 200, 6.0)
    assert taken.is_monochrome == (filters == ("G",))
    if not taken.is_monochrome:
        np.testing.assert_allclose(file.get_white_balance(), camera_colour(raw.camera).neutral, atol=1e-5)


@pytest.mark.parametrize("converter, name, filters", [
    *((converter, *camera) for converter in CONVERTERS for camera in (
        ("sony-a7-iv", ("RG", "GB")), ("fujifilm-x-t4", XTRANS), ("canon-eos-5d-iv", ("GB", "RG")))),
    ("RawTherapee", "generic-three-chip", ())])
def test_converters_show_the_charts_colours(tmp_path, converter, name, filters):
    if not installed(converter):
        pytest.skip(f"needs {converter} (apt-get install {converter.lower()})")
    write_dng(chart_raw(small_camera(name, filters)), tmp_path / "a.dng", LENS)
    assert np.median(chart_error(CONVERTERS[converter](tmp_path) @ REC709_TO_XYZ.T)) < 2


def test_the_page_has_the_figures_of_this_tree():
    page = (ROOT / "docs/camera.md").read_text(encoding="utf-8")
    stated = re.search(r"\| Sony Alpha 7 IV \| ([0-9.]+), ([0-9.]+) ", CHART_TABLE.search(page)[0]).groups()
    errors = chart_error(developed(chart_raw(small_camera("sony-a7-iv"))) @ REC709_TO_XYZ.T)
    assert [np.median(errors), errors.max()] == pytest.approx([float(figure) for figure in stated], abs=0.06)
    assert f"| {' | '.join(lens_row('edmund-54852'))} |" in LENS_TABLE.search(page)[0]
