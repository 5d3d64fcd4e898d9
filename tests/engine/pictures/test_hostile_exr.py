"""EXR files with false size claims, oversized headers and invalid names: refused before memory is allocated."""

import struct

import numpy as np
import OpenEXR
import pytest

from exr_bytes import CHANNEL, attribute, channels_attribute, numbered, write_black, write_black_parts
from lensfield.engine import ImageError, SpectralImage
from lensfield.engine.pictures import spectral_exr
from lensfield.engine.pictures.exr_header import SIZES
from lensfield.engine.pictures.rgb_picture import read_rgb_exr
from lensfield.engine.pictures.spectral_exr import is_spectral, read_exr, read_header, read_parts, write_exr
from refusals import refused
from rgb_files import colours, window


def patched(path, attribute, corners):
    """A file with one of its windows replaced: left, top, right, bottom."""
    data, mark = path.read_bytes(), attribute.encode() + b"\0box2i\0"
    at = data.index(mark) + len(mark) + 4
    path.write_bytes(data[:at] + struct.pack("<4i", *corners) + data[at + 16:])
    return path


def error_of(read, path):
    with pytest.raises(ImageError) as error:
        read(path)
    assert str(error.value).isprintable() and path.name in str(error.value)
    return str(error.value)


@pytest.fixture
def nothing_is_decoded(monkeypatch):
    """Fails the test if pixels are decoded."""

    class File(OpenEXR.File):
        def __init__(self, name, *, header_only=False, **named):
            assert header_only, "pixels were asked for"
            super().__init__(name, header_only=True, **named)

    monkeypatch.setattr(OpenEXR, "File", File)


def test_an_oversized_display_window_is_an_error(tmp_path, nothing_is_decoded):
    path = tmp_path / "small.exr"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(OpenEXR, "File", OpenEXR.File.__mro__[1])
        colours(path, (1, 1, 1), displayWindow=window(0, 0, 10000, 10000))
    assert path.stat().st_size < 1000
    assert "displayWindow is of 100 million px: expected at most 64 times the " in error_of(read_rgb_exr, path)


def test_a_trimmed_picture_in_a_usual_frame_is_read(tmp_path):
    picture = read_rgb_exr(colours(tmp_path / "trimmed.exr", (1, 2, 3), (1, 1), displayWindow=window(0, 0, 400, 300)))
    assert picture.frame_px == (300, 400) and picture.rec709.sum() == 6


@pytest.mark.parametrize("corners", [(0, 0, 9999, 9999), (-2**30, 0, 2**30 - 1, 0), (0, 0, 2**31 - 2, 2**31 - 2),
                                     (5, 5, 4, 4), (0, 0, 23, 17 * 10**6)], ids=str)
@pytest.mark.parametrize("attribute", ["dataWindow", "displayWindow"])
def test_windows_that_the_file_cannot_fill_are_errors(tmp_path, attribute, corners):
    path = patched(colours(tmp_path / "small.exr", (1, 1, 1)), attribute, corners)
    error_of(read_rgb_exr, path)


def test_a_picture_too_large_for_memory_is_an_error_with_both_sizes(tmp_path, monkeypatch):
    path = colours(tmp_path / "large.exr", (1, 1, 1), (1000, 1000))
    monkeypatch.setattr("lensfield.engine.runtime.memory.available_bytes", lambda: 10**7)
    assert "size is 0.016 GB in memory: 0.01 GB are free" in error_of(read_rgb_exr, path)
    assert read_parts(path, header_only=True)  # reading the header is allowed


@pytest.mark.parametrize("name", [b"\xff", b"M\xfcller", b"\xc3"])
def test_channel_names_that_are_not_utf_8_are_errors(tmp_path, name):
    path = tmp_path / "named.exr"
    data = colours(path, (1, 1, 1), prefix="x" * len(name)).read_bytes()
    path.write_bytes(data.replace(b"x" * len(name), name))
    for read in (is_spectral, read_rgb_exr, read_exr):
        assert "header is not in UTF-8" in error_of(read, path)


def spectral(path, lens):
    with OpenEXR.File({"type": OpenEXR.scanlineimage, "lensfield:lens": lens, "lensfield:quantity": "irradiance",
                       "lensfield:pitchUm": 5.0}, {"S0.550,000000nm": np.ones((4, 4), np.float32)}) as file:
        file.write(str(path))
    return path


def test_a_header_cannot_control_a_terminal(tmp_path):
    image = read_exr(spectral(tmp_path / "lens.exr", "\x1b]0;owned\x07a\nlens"))
    assert image.lens_name == "?]0;owned?a lens"
    path = colours(tmp_path / "channels.exr", (1, 1, 1), prefix="\x1b[31mlayer.")
    assert read_rgb_exr(path).layer == "?[31mlayer"


def test_a_number_in_place_of_a_text_is_an_error(tmp_path):
    assert "lens_name is 5.0: expected a string" in error_of(read_exr, spectral(tmp_path / "lens.exr", 5.0))


def test_layers_far_beyond_the_frame_are_an_error(tmp_path):
    plane = np.ones((4, 4), np.float32)
    names = {"radiance": (0, 0), "layer.1": (10**6, 10**6)}
    parts = [OpenEXR.Part({"type": OpenEXR.scanlineimage, "displayWindow": window(0, 0, 4, 4), "lensfield:pitchUm": 5.0,
                           "dataWindow": window(*origin, 4, 4)},
                          {"S0.550,000000nm": plane, "A": plane, "Z": plane}, name) for name, origin in names.items()]
    with OpenEXR.File(parts) as file:
        file.write(str(tmp_path / "layers.exr"))
    assert "px beyond a frame" in error_of(spectral_exr.read_with_layers, tmp_path / "layers.exr")


def test_depths_that_overflow_are_infinitely_far(tmp_path, recwarn):
    plane = np.ones((4, 4), np.float32)
    parts = [OpenEXR.Part({"type": OpenEXR.scanlineimage, "lensfield:pitchUm": 5.0},
                          {"S0.550,000000nm": plane, "A": plane, "Z": 3e38 * plane}, name)
             for name in ("radiance", "layer.1")]
    with OpenEXR.File(parts) as file:
        file.write(str(tmp_path / "layers.exr"))
    layered = spectral_exr.read_with_layers(tmp_path / "layers.exr")[2]
    assert np.isinf(layered.layers[0].depth_mm).all() and not recwarn.list


def test_unicode_lens_names_round_trip(tmp_path):
    image = read_exr(spectral(tmp_path / "lens.exr", "Größe ½"))
    write_exr(image, tmp_path / "again.exr")
    assert read_exr(tmp_path / "again.exr").lens_name == "Größe ½"


@pytest.fixture
def nothing_is_opened(monkeypatch):
    """Fails the test if OpenEXR opens a file."""
    monkeypatch.setattr(OpenEXR, "File", lambda *_, **__: pytest.fail("the file was opened"))
    monkeypatch.setattr(OpenEXR, "InputFile", OpenEXR.File)


OVERSIZED = {
    "a million channels": lambda path: write_black(path, numbered(10**6)),
    "channels under another name": lambda path: write_black(path, [b"Y"], channels_attribute(numbered(20_000), b"a")),
    "20,000 parts": lambda path: write_black_parts(path, 20_000),
    "20,000 attributes": lambda path: write_black(
        path, [b"Y"], b"".join(attribute(name, b"int", bytes(4)) for name in numbered(20_000, b"a"))),
    "a million empty texts": lambda path: write_black(path, [b"Y"], attribute(b"a", b"stringvector", bytes(4 * 10**6))),
    "a text of 50 MB": lambda path: write_black(path, [b"Y"], attribute(b"a", b"string", b"a" * (50 << 20))),
    "50 MB of floats": lambda path: write_black(path, [b"Y"], attribute(b"a", b"floatvector", bytes(50 << 20)))}


@pytest.mark.parametrize("kind", OVERSIZED)
@pytest.mark.parametrize("read", [is_spectral, read_rgb_exr, read_exr])
def test_oversized_headers_are_errors_before_openexr_opens_the_file(tmp_path, nothing_is_opened, kind, read):
    path = OVERSIZED[kind](tmp_path / "large.exr")
    assert "header is over 32 MB: expected" in (error := error_of(read, path)) or (
        "number of channels and attributes is over " in error)


SPECIAL = {  # zeros are not valid
    "keycode": struct.pack("<7i", 0, 0, 0, 0, 0, 4, 64), "rational": struct.pack("<iI", 24, 1)}
KINDS = SIZES.keys() - {"deepImageState"}  # OpenEXR's Python cannot show the latter
WITHIN_LIMITS = {
    "text": ([b"Y"], attribute(b"text", b"string", b"a" * (8 << 20))), "channels": (numbered(10_000), b""),
    "attributes": ([b"Y"], b"".join(attribute(name, b"int", bytes(4)) for name in numbered(5000, b"a"))),
    "types": ([b"Y"], b"".join(attribute(b"a" + kind.encode(), kind.encode(), SPECIAL.get(kind, bytes(SIZES[kind])))
                               for kind in sorted(KINDS))),
    "lists": ([b"Y"], attribute(b"preview", b"preview", struct.pack("<2I", 2, 3) + bytes(24)) + attribute(
        b"texts", b"stringvector", struct.pack("<i", 2) + b"ab" + bytes(4)) + attribute(b"own", b"owntype", b"abc"))}


@pytest.mark.parametrize("names, more", WITHIN_LIMITS.values(), ids=list(WITHIN_LIMITS))
def test_headers_within_the_limits_are_read(tmp_path, names, more):
    (header, channels), = read_parts(write_black(tmp_path / "plain.exr", names, more))
    assert channels.keys() == {name.decode() for name in names} and header


def test_many_parts_are_read(tmp_path):
    assert len(read_parts(write_black_parts(tmp_path / "parts.exr", 1000))) == 1000


HIDDEN = channels_attribute(numbered(20_000), b"b")
CONTRADICTORY = {
    "a number of another size": attribute(b"a", b"int", HIDDEN), "no number": attribute(b"a", b"int", HIDDEN, size=0),
    "floats of a broken size": attribute(b"a", b"floatvector", bytes(3 - len(HIDDEN) % 4) + HIDDEN),
    "a preview of another size": attribute(b"a", b"preview", struct.pack("<2I", 1, 1) + HIDDEN),
    "texts of another size": attribute(b"a", b"stringvector", struct.pack("<i", 2**31 - 1) + HIDDEN),
    "a negative size": attribute(b"a", b"string", HIDDEN, size=-1),
    "two types under one name": attribute(b"a", b"int", bytes(4)) + attribute(b"a", b"string", HIDDEN),
    "a long name": attribute(b"a" * 300, b"string", HIDDEN), "a long type": attribute(b"a", b"s" * 300, HIDDEN),
    "an empty type": attribute(b"a", b"", HIDDEN),
    "a channel with a long name": channels_attribute([b"c" * 300], b"a") + HIDDEN,
    "channels of another size": attribute(b"a", b"chlist", b"c\0" + CHANNEL[:5]) + HIDDEN}


@pytest.mark.parametrize("kind", CONTRADICTORY)
def test_attributes_that_hide_others_are_errors(tmp_path, nothing_is_opened, kind):
    """OpenEXR would continue inside the first, and find channels there."""
    path = write_black(tmp_path / "damaged.exr", [b"Y"], CONTRADICTORY[kind])
    assert "file is not readable: expected an EXR picture (" in error_of(is_spectral, path)


@pytest.mark.parametrize("kind, value", [("rational", bytes(8)), ("keycode", bytes(28))])
def test_values_that_openexr_cannot_show_are_errors(tmp_path, kind, value):
    path = write_black(tmp_path / "strange.exr", [b"Y"], attribute(b"a", kind.encode(), value))
    for read in (is_spectral, read_rgb_exr, read_exr):
        assert "file is not readable: expected an EXR picture (" in error_of(read, path)


@pytest.mark.parametrize("length", [0, 3, 4, 7, 8, 30, 200])
def test_headers_that_are_cut_off_are_errors(tmp_path, length):
    path = write_black(tmp_path / "cut.exr", [b"Y"])
    path.write_bytes(path.read_bytes()[:length])
    error_of(is_spectral, path)


@pytest.mark.parametrize("name, value", [("focalMm", 1e-30), ("focalMm", 1e30), ("pitchUm", 1e30), ("pitchUm", 1e12)])
@pytest.mark.parametrize("read", [read_header, read_exr])
def test_implausible_sizes_are_errors(tmp_path, read, name, value):
    path, focal_mm, pitch_um = tmp_path / "radiance.exr", 49.375, 9.0625
    write_exr(SpectralImage(np.ones((1, 6, 8)), [550.0], pitch_um=pitch_um, focal_mm=focal_mm), path)
    stated = struct.pack("<d", focal_mm if name == "focalMm" else pitch_um)
    data = path.read_bytes()
    assert data.count(stated) == 1
    path.write_bytes(data.replace(stated, struct.pack("<d", value)))
    with refused(ImageError, field="focal_mm" if name == "focalMm" else "pitch_um", value=value, where="radiance.exr"):
        read(path)
