"""Spectral EXR files: the layout, the round trip, and invalid files."""

import multiprocessing
import os
import re
from concurrent.futures import ThreadPoolExecutor
from io import BytesIO

import numpy as np
import OpenEXR
import pytest

from full_disk import room_for
from lensfield.engine import ImageError, InputError, SpectralImage
from lensfield.engine.image.projection import FISHEYE, PLANE, Projection
from lensfield.engine.pictures import spectral_exr
from lensfield.engine.pictures.spectral_exr import (
    channel_name,
    channel_wavelength_nm,
    is_spectral,
    read_exr,
    read_parts,
    write_exr,
    write_picture_exr,
)
from refusals import refused

PANORAMA = Projection((0.9, 0.1, -0.15, 1 / 3))

# Fichet, Pacanowski and Wilkie, JCGT 2021
LAYOUT = re.compile(r"^((S([0-3]))|T)\.(\d*,?\d*([Ee][+-]?\d+)?)(Y|Z|E|P|T|G|M|k|h|da|d|c|m|u|n|p)?(m|Hz)$")


def image(**changes):
    cube = np.random.default_rng(2).random((3, 11, 15), dtype=np.float32) * 1e3
    return SpectralImage(**dict(cube=cube, wavelengths_nm=[400.0, 555.5, 700.25], pitch_um=6.25) | changes)


def foreign(path, channels, **header):
    """A file from another program; its channels are 4 x 5 px, each with one value."""
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage} | header
    planes = {name: value if isinstance(value, np.ndarray) else np.full((4, 5), value, dtype=np.float32)
              for name, value in channels.items()}
    with OpenEXR.File(header, planes) as file:
        file.write(str(path))
    return path


def raw(path):
    """Header and channel names as the library returns them."""
    with OpenEXR.File(str(path), separate_channels=True) as file:
        return dict(file.parts[0].header), sorted(file.parts[0].channels)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "image.exr"


@pytest.mark.parametrize("nm, name", [(550.0, "S0.550,000000nm"), (587.6, "S0.587,600000nm"),
                                      (1013.98, "S0.1013,980000nm"), (433.0 + 1 / 3, "S0.433,333333nm")])
def test_channel_names_follow_the_layout(nm, name):
    assert channel_name(nm) == name
    assert LAYOUT.match(name)
    assert channel_wavelength_nm(name) == pytest.approx(nm, abs=1e-6)


@pytest.mark.parametrize("name, nm", [
    ("S0.550nm", 550.0), ("S0.550,5nm", 550.5), ("S0.0,55um", 550.0), ("S0.5,5E-7m", 550.0), ("T.550,0nm", 550.0),
    ("S0.,55um", 550.0), ("S0.5,5e2nm", 550.0), ("S0.500THz", 599.584916), ("S0.5,0E14Hz", 599.584916),
    ("S0.599,584916THz", 500.0), ("S0.0,00055mm", 550.0),
])
def test_all_wavelength_notations_of_the_layout_are_parsed(name, nm):
    assert LAYOUT.match(name)
    assert channel_wavelength_nm(name) == pytest.approx(nm, rel=1e-9)


@pytest.mark.parametrize("name", ["R", "Y", "S1.550nm", "S3.550,0nm", "S0.550.0nm", "S0.550", "S0.nm", "S0.,nm",
                                  "S0.0nm", "S0.550nmx", "S4.550nm", "s0.550nm", "Depth.Z", "S0.E5nm"])
def test_other_channels_have_no_wavelength(name):
    assert channel_wavelength_nm(name) is None


def test_written_file_has_the_layout_and_a_preview(path):
    write_exr(image(), path)
    header, channels = raw(path)
    assert header["spectralLayoutVersion"] == "1.0"
    assert header["emissiveUnits"] == "W.m^-2.sr^-1"
    assert {"R", "G", "B"} < set(channels)
    assert len([name for name in channels if LAYOUT.match(name)]) == 3


def test_irradiance_has_no_radiance_unit(path):
    write_exr(image(quantity="irradiance"), path)
    header = raw(path)[0]
    assert "emissiveUnits" not in header
    assert header["lensfield:quantity"] == "irradiance" and header["lensfield:units"] == "W.m^-2.nm^-1"


@pytest.mark.parametrize("changes", [
    {}, {"quantity": "irradiance", "lens_name": "a lens", "f_number_effective": 1.8867924528301885},
    {"overscan_px": (2, 3)}, {"overscan_px": (1, 0), "centre_px": (4.25, 9.5)}, {"centre_px": (-3.0, 40.0)},
    {"pitch_um": 1 / 3}, {"wavelengths_nm": [400, 410, 420]}, {"projection": PANORAMA},
], ids=str)
def test_round_trip_is_exact(path, changes):
    written = image(**changes)
    write_exr(written, path)
    read = read_exr(path)
    np.testing.assert_array_equal(read.cube, written.cube)
    np.testing.assert_array_equal(read.wavelengths_nm, written.wavelengths_nm)
    for field in ("pitch_um", "centre_px", "quantity", "overscan_px", "projection", "lens_name", "f_number_effective"):
        assert getattr(read, field) == getattr(written, field), field


@pytest.mark.parametrize("changes, stored", [
    ({}, None), ({"projection": PANORAMA}, "polynomial"), ({"projection": PANORAMA, "quantity": "irradiance"}, None),
], ids=str)
def test_the_projection_is_stored_for_panoramic_radiance_only(path, changes, stored):
    write_exr(image(**changes), path)
    assert raw(path)[0].get("lensfield:projection") == stored


@pytest.mark.parametrize("value", ["stereographic", "Plane", "", 1.0, np.array([1.0, 2.0])], ids=str)
def test_an_unknown_projection_is_named_with_its_file(path, value):
    foreign(path, {"S0.550nm": 1.0}, **{"lensfield:pitchUm": 5.0, "lensfield:projection": value})
    message = one_line_error(path)
    assert message.startswith(f"{path}: lensfield:projection is ") and "plane, equidistant, polynomial" in message


def test_irradiance_has_no_projection(path):
    foreign(path, {"S0.550nm": 1.0}, **{"lensfield:pitchUm": 5.0, "lensfield:quantity": "irradiance",
                                        "lensfield:projection": "equidistant"})
    assert read_exr(path).projection == PLANE


def test_a_fisheye_of_an_older_file_is_read(path):
    foreign(path, {"S0.550nm": 1.0}, **{"lensfield:pitchUm": 5.0, "lensfield:projection": "equidistant"})
    assert read_exr(path).projection == FISHEYE


@pytest.mark.parametrize("squeeze", [1.0, 1.33, 2.0, 0.75])
def test_the_squeeze_of_a_capture_is_the_aspect_of_its_pixels(path, squeeze):
    write_exr(image(squeeze=squeeze), path)
    assert read_exr(path).squeeze == squeeze and raw(path)[0]["pixelAspectRatio"] == pytest.approx(squeeze)


def test_irradiance_has_no_squeeze(path):
    foreign(path, {"S0.550nm": 1.0}, **{"lensfield:pitchUm": 5.0, "lensfield:quantity": "irradiance",
                                        "pixelAspectRatio": 2.0})
    assert read_exr(path).squeeze == 1


@pytest.mark.parametrize("value", ["", "1 x", "-1 0.1", "nan", "1 0 0 0 0", 1.0, None], ids=str)
def test_a_damaged_polynomial_is_named_with_its_file(path, value):
    attributes = {"lensfield:pitchUm": 5.0, "lensfield:projection": "polynomial"}
    foreign(path, {"S0.550nm": 1.0}, **attributes | ({} if value is None else {"lensfield:anglePerRadius": value}))
    message = one_line_error(path)
    assert message.startswith(f"{path}: lensfield:anglePerRadius is ") and "1 to 4 numbers" in message


def test_overscan_is_a_data_window_beyond_the_display_window(path):
    write_exr(image(overscan_px=(2, 3)), path)  # a cube of 11 rows and 15 columns
    header = raw(path)[0]
    assert [corner.tolist() for corner in header["displayWindow"]] == [[0, 0], [8, 6]]
    assert [corner.tolist() for corner in header["dataWindow"]] == [[-3, -2], [11, 8]]


def test_the_axis_is_stored_in_window_coordinates(path):
    """Row 4.25 of 11, with 2 rows above the frame, and column 9.5 of 15, with 3 columns left of it."""
    write_exr(image(overscan_px=(2, 3), centre_px=(4.25, 9.5)), path)
    assert raw(path)[0]["lensfield:centrePx"].tolist() == [2.25, 6.5]


def test_a_handwritten_axis_is_read_in_window_coordinates(path):
    windows = {"displayWindow": (np.array([0, 0], np.int32), np.array([2, 1], np.int32)),
               "dataWindow": (np.array([-1, -1], np.int32), np.array([3, 2], np.int32))}
    foreign(path, {"S0.550nm": 1.0}, **windows, **{"lensfield:pitchUm": 5.0, "lensfield:centrePx": [0.25, 1.5]})
    read = read_exr(path)
    assert (read.cube.shape, read.overscan_px, read.centre_px) == ((1, 4, 5), (1, 1), (1.25, 2.5))


def test_row_0_is_the_top_row_of_the_file(path):
    cube = np.zeros((1, 4, 5))
    cube[0, 0, 4] = 1
    write_exr(SpectralImage(cube, [550.0], pitch_um=1.0), path)
    with OpenEXR.File(str(path), separate_channels=True) as file:
        assert np.argwhere(file.parts[0].channels["S0.550,000000nm"].pixels).tolist() == [[0, 4]]


def test_channels_are_sorted_by_wavelength_whatever_their_unit(path):
    foreign(path, {"S0.9,0E2nm": 3.0, "S0.0,65um": 2.0, "S0.599,584916THz": 1.0, "R": 9.0})
    read = read_exr(path, pitch_um=5.0)
    np.testing.assert_allclose(read.wavelengths_nm, [500, 650, 900], rtol=1e-9)
    np.testing.assert_array_equal(read.cube[:, 0, 0], [1, 2, 3])


def test_a_foreign_file_is_radiance_with_the_given_pitch(path):
    foreign(path, {"S0.550nm": 1.0})
    read = read_exr(path, pitch_um=4.5)
    assert (read.pitch_um, read.quantity, read.centre_px, read.overscan_px) == (4.5, "radiance", (1.5, 2.0), (0, 0))


def test_half_floats_are_read(path):
    foreign(path, {"S0.550nm": np.full((4, 5), 0.5, dtype=np.float16)})
    read = read_exr(path, pitch_um=1.0)
    assert read.cube.dtype == np.float32 and read.cube[0, 0, 0] == 0.5


def test_polarised_channels_are_ignored(path):
    foreign(path, {"S0.550nm": 1.0, "S1.550nm": 0.5, "S2.550nm": 0.25})
    assert read_exr(path, pitch_um=1.0).cube.shape == (1, 4, 5)


def test_a_missing_pitch_is_an_error(path):
    foreign(path, {"S0.550nm": 1.0})
    with refused(ImageError, field="lensfield:pitchUm", value="missing", where="image.exr"):
        read_exr(path)


def test_an_rgb_file_is_an_error_that_names_its_channels(path):
    foreign(path, {"R": 1.0, "G": 1.0, "B": 1.0})
    with refused(ImageError, field="channels", value="B, G, R", where="image.exr"):
        read_exr(path, pitch_um=1.0)


@pytest.mark.parametrize("channels, spectral", [(("R", "G", "B"), False), (("Y",), False), (("S0.550nm",), True),
                                                (("R", "G", "B", "T.5,5E-7m"), True), (("S1.550nm",), False)], ids=str)
def test_channels_determine_whether_a_file_is_spectral(path, channels, spectral):
    assert is_spectral(foreign(path, dict.fromkeys(channels, 1.0))) is spectral


def test_every_part_of_a_file_is_read(path):
    parts = [OpenEXR.Part({"type": OpenEXR.scanlineimage}, {f"{name}.Z": np.full((4, 5), depth, dtype="f2")}, name)
             for name, depth in (("near", 1), ("far", 2))]
    with OpenEXR.File(parts) as file:
        file.write(str(path))
    (near, near_planes), (far, far_planes) = read_parts(path)
    assert (near["name"], far["name"]) == ("near", "far")
    assert np.all(near_planes["near.Z"] == 1) and np.all(far_planes["far.Z"] == 2)


@pytest.mark.parametrize("contents", [b"", b"not an image\n", b"\x76\x2f\x31\x01", bytes(range(256)) * 20])
def test_is_spectral_rejects_garbage(path, contents, capfd):
    path.write_bytes(contents)
    with refused(ImageError, field="file", value="not readable", where="image.exr"):
        is_spectral(path)


def one_line_error(path, **arguments):
    with pytest.raises(ImageError) as error:
        read_exr(path, **arguments)
    message = str(error.value)
    assert path.name in message and "\n" not in message
    return message


@pytest.mark.parametrize("fraction", [0.0, 0.01, 0.3, 0.6, 0.9, 0.999])
def test_a_truncated_file_is_an_error(path, fraction, capfd):
    write_exr(image(cube=np.random.default_rng(0).random((3, 60, 70))), path)
    contents = path.read_bytes()
    path.write_bytes(contents[:int(fraction * len(contents))])
    one_line_error(path)


@pytest.mark.parametrize("contents", [b"", b"not an image\n", b"\x76\x2f\x31\x01", bytes(range(256)) * 20])
def test_garbage_is_an_error(path, contents, capfd):
    path.write_bytes(contents)
    one_line_error(path)


def test_a_missing_file_is_an_error(path):
    assert "missing" in one_line_error(path)


def test_a_folder_is_an_error(tmp_path):
    one_line_error(tmp_path)


def test_a_duplicate_wavelength_is_an_error_that_names_it(path):
    foreign(path, {"S0.550nm": 1.0, "S0.550,0nm": 2.0})
    assert "550" in one_line_error(path, pitch_um=1.0)


@pytest.mark.parametrize("attribute, value", [
    ("lensfield:pitchUm", "abc"), ("lensfield:pitchUm", -1.0), ("lensfield:pitchUm", float("nan")),
    ("lensfield:quantity", "luminance"), ("lensfield:centrePx", np.array([1.0, 2.0, 3.0])),
    ("lensfield:centrePx", np.array([np.nan, 2.0])), ("lensfield:centrePx", "middle"),
    ("lensfield:fNumberEffective", "wide"), ("lensfield:fNumberEffective", -2.0),
])
def test_a_wrong_attribute_is_an_error(path, attribute, value):
    foreign(path, {"S0.550nm": 1.0}, **{"lensfield:pitchUm": 5.0} | {attribute: value})
    one_line_error(path)


def test_a_failed_write_leaves_no_file(tmp_path, monkeypatch):
    def fail(self, stream):
        stream.write(b"half a file")
        raise RuntimeError("disk full")

    monkeypatch.setattr(OpenEXR.File, "write", fail)
    with refused(InputError, field="file", where="image.exr", match="disk full"):
        write_exr(image(), tmp_path / "image.exr")
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_renamed_meanwhile_is_the_reason(tmp_path, monkeypatch):
    write = OpenEXR.File.write

    def write_and_rename(self, stream):
        write(self, stream)
        (tmp_path / "shots").rename(tmp_path / "renamed")

    monkeypatch.setattr(OpenEXR.File, "write", write_and_rename)
    (tmp_path / "shots").mkdir()
    with refused(InputError, field="file", where="image.exr", match="No such file or directory$"):
        write_exr(image(), tmp_path / "shots" / "image.exr")
    assert not (tmp_path / "shots").exists()


@pytest.mark.parametrize("lacking", [1, 500, 4000, 100_000, 200_000], ids=str)
@pytest.mark.parametrize("write", [lambda path: write_exr(big(), path),
                                   lambda path: write_picture_exr(np.moveaxis(big().cube, 0, -1), path)],
                         ids=["spectral", "rgb"])
def test_a_full_disk_is_an_error_even_at_the_last_byte(tmp_path, write, lacking):
    write(tmp_path / "image.exr")
    size = (tmp_path / "image.exr").stat().st_size
    (tmp_path / "image.exr").unlink()
    with room_for(max(size - lacking, 1)):
        with refused(InputError, field="file", where="image.exr", match="File too large$"):
            write(tmp_path / "image.exr")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("garble", [lambda content: b"", lambda content: bytes(len(content)),
                                    lambda content: content.replace(b"S0.400", b"S0.401")],
                         ids=["none", "zeros", "other"])
def test_a_file_that_reads_back_differently_is_removed(tmp_path, monkeypatch, garble):
    """As on a disk that loses written data."""
    write = OpenEXR.File.write

    def write_garbled(self, stream):
        written = BytesIO()
        write(self, written)
        stream.write(garble(written.getvalue()))

    monkeypatch.setattr(OpenEXR.File, "write", write_garbled)
    with refused(InputError, field="file", where="image.exr", match="the file's headers differ"):
        write_exr(image(), tmp_path / "image.exr")
    assert list(tmp_path.iterdir()) == []


def test_a_failed_write_leaves_the_old_file_unchanged(path, monkeypatch):
    write_exr(image(), path)
    before = path.read_bytes()
    monkeypatch.setattr(OpenEXR.File, "write", lambda self, stream: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        write_exr(image(pitch_um=1.0), path)
    assert path.read_bytes() == before
    assert list(path.parent.iterdir()) == [path]


def test_an_existing_folder_is_not_replaced(path):
    path.mkdir()
    with refused(InputError, field="file", value="a folder", where="image.exr"):
        write_exr(image(), path)
    assert list(path.parent.iterdir()) == [path] and path.is_dir()


def test_trimming_the_data_window_does_not_move_the_axis(path):
    """Compositors trim black borders. The axis is stored in pixels of the windows, which stay the same."""
    untrimmed = SpectralImage(np.ones((1, 20, 30)), [550], pitch_um=5.0, overscan_px=(2, 3))
    write_exr(untrimmed, path)
    with OpenEXR.File(str(path), separate_channels=True) as file:
        header = dict(file.header())
        planes = {name: channel.pixels[4:, 1:].copy() for name, channel in file.channels().items()}
    header["dataWindow"] = (np.array([-2, 2], dtype=np.int32), np.array([26, 17], dtype=np.int32))
    with OpenEXR.File(header, planes) as file:
        file.write(str(path))
    trimmed = read_exr(path)
    assert trimmed.cube.shape == (1, 16, 29) and trimmed.overscan_px == (0, 0)
    assert trimmed.centre_px == (untrimmed.centre_px[0] - 4, untrimmed.centre_px[1] - 1)


def test_wavelengths_that_share_a_channel_name_are_refused(path):
    close = SpectralImage(np.ones((2, 4, 4)), [550, 550.0000001], pitch_um=5.0)
    with refused(ImageError, field="wavelengths_nm", where="image.exr", match="millionth"):
        write_exr(close, path)
    assert not path.exists()


def big():
    """With enough rows that each thread has its own share."""
    return image(cube=np.random.default_rng(5).random((3, 200, 70), dtype=np.float32))


@pytest.mark.parametrize("brightest, dtype", [(65504, np.float16), (65536, np.float32), (np.inf, np.float32)])
def test_pictures_are_in_half_precision_unless_they_are_too_bright(path, brightest, dtype):
    picture = np.random.default_rng(3).random((7, 9, 3), dtype=np.float32)
    picture[2, 5, 1] = brightest
    write_picture_exr(picture, path, alpha=picture[..., 0])
    planes = read_parts(path)[0][1]
    assert {plane.dtype for plane in planes.values()} == {np.dtype(dtype)}
    stored = np.stack([planes[name] for name in "RGBA"], axis=-1)
    np.testing.assert_allclose(stored, np.dstack([picture, picture[..., 0]]), rtol=2.0**-11, atol=2.0**-25)


def test_all_threads_read_and_write_a_file_and_none_remains(path, monkeypatch):
    monkeypatch.setattr(spectral_exr, "thread_count", lambda: 3)
    thread_counts = []

    class File(OpenEXR.File):
        def __init__(self, *arguments, **named):
            thread_counts.append(OpenEXR.global_thread_count())
            super().__init__(*arguments, **named)

    monkeypatch.setattr(OpenEXR, "File", File)
    write_exr(big(), path)
    np.testing.assert_array_equal(read_exr(path).cube, big().cube)
    assert set(thread_counts) == {3} and OpenEXR.global_thread_count() == 0


def test_a_failed_write_leaves_no_thread(path, monkeypatch):
    monkeypatch.setattr(OpenEXR.File, "write", lambda self, stream: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        write_exr(image(), path)
    assert OpenEXR.global_thread_count() == 0


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
def test_a_forked_process_can_write(path, monkeypatch):
    """The child does not have the parent's threads, and would wait for them for ever."""
    monkeypatch.setattr(spectral_exr, "thread_count", lambda: 3)
    write_exr(big(), path)
    path.unlink()
    writer = multiprocessing.get_context("fork").Process(target=write_exr, args=(big(), path))
    writer.start()
    writer.join(60)
    writer.kill()
    assert writer.exitcode == 0
    np.testing.assert_array_equal(read_exr(path).cube, big().cube)


def test_black_rows_take_no_disk_space(path):
    size = {}
    for name, rows in (("whole", 200), ("half", 100)):
        cube = big().cube
        cube[:, rows:] = 0
        write_exr(image(cube=cube), path)
        size[name] = path.stat().st_size
    assert size["half"] < 0.55 * size["whole"]


def test_the_threads_start_with_their_first_user_and_end_with_the_last(monkeypatch):
    counts = []
    monkeypatch.setattr(spectral_exr.OpenEXR, "set_global_thread_count", counts.append)
    monkeypatch.setattr(spectral_exr, "thread_count", lambda: 3)
    with spectral_exr.exr_threads():
        with spectral_exr.exr_threads():
            pass
        assert counts == [3]
    assert counts == [3, 0]
    with pytest.raises(OSError), spectral_exr.exr_threads():
        raise OSError
    assert counts == [3, 0, 3, 0]


def test_threads_can_write_concurrently(tmp_path, monkeypatch):
    monkeypatch.setattr(spectral_exr, "thread_count", lambda: 3)

    def round_trips(number):
        picture = image(cube=np.full((3, 200, 70), number))
        write_exr(picture, tmp_path / f"{number}.exr")
        return np.array_equal(read_exr(tmp_path / f"{number}.exr").cube, picture.cube)

    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(round_trips, range(40)))
