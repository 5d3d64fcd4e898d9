"""Lens packages: the round trip, and files that are damaged or hostile."""

import io
import json
import pickle
import tracemalloc
import zipfile
from dataclasses import fields

import numpy as np
import pytest

from lenses import gaussian_psf, lopsided_grid, make_lens
from lensfield.engine import LensError, load_lens
from lensfield.engine.lens import GridLens, RadialLens
from lensfield.engine.lens_files.package import read_package, write_package
from refusals import refused

ARRAY_FIELDS = [field.name for field in fields(RadialLens) if isinstance(getattr(make_lens(), field.name), np.ndarray)]
HEADER_FIELDS = [field.name for field in fields(RadialLens) if field.name not in (*ARRAY_FIELDS, "prescription")]
STORED_ARRAYS = [name for name in ARRAY_FIELDS if name != "psf"] + ["psf_amplitude"]


def sample_lens(**changes):
    return make_lens(gaussian_psf(2, 3, 1.0, 8), lambda nm, p: p * (0.9 + nm / 1e5),
                     lambda nm, p: 1 - 0.02 * p**2, transmittance=(0.8, 0.95), psf_pitch_um=1 / 3,
                     source="a patent", notes="glass assumed: ½ of it", **changes)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "sample.npz"


def parts(path):
    with np.load(path, allow_pickle=False) as archive:
        return dict(archive)


def rewritten(path, header=None, drop=(), **changes):
    """A valid package with some of its parts replaced."""
    write_package(sample_lens(), path)
    contents = parts(path)
    if header:
        old = json.loads(str(contents["header"]))
        contents["header"] = np.array(json.dumps({k: v for k, v in (old | header).items() if v is not Ellipsis}))
    np.savez(path, **{name: value for name, value in (contents | changes).items() if name not in drop})
    return path


def error_of(path):
    with pytest.raises(LensError) as error:
        read_package(path)
    assert path.name in str(error.value) and "\n" not in str(error.value)
    return error.value


@pytest.mark.parametrize("changes", [{}, {"object_distance_mm": np.inf, "magnification": 0.0},
                                     {"enclosed_energy": np.full((2, 11), np.nan)}], ids=["near", "infinity", "nan"])
def test_round_trip_keeps_every_field(path, changes):
    lens = sample_lens(**changes)
    write_package(lens, path)
    read = read_package(path)
    for field in fields(RadialLens):
        after, before = getattr(read, field.name), getattr(lens, field.name)
        if field.name == "psf":
            np.testing.assert_allclose(after, before, atol=1e-5)
        else:
            np.testing.assert_array_equal(after, before, err_msg=field.name)
        assert type(after) is type(before)


@pytest.mark.parametrize("changes", [{"squeeze": 1.5, "focus_slope": (1e-4, -2e-5)}, {"mirrored": (True, True)}],
                         ids=str)
def test_a_lens_over_x_and_y_keeps_every_field(path, changes):
    lens = lopsided_grid(maker="A. Maker", transmittance=(0.8, 0.95), **changes)
    write_package(lens, path)
    read = read_package(path)
    assert type(read) is GridLens and json.loads(str(parts(path)["header"]))["version"] == 3
    for field in fields(GridLens):
        after, before = getattr(read, field.name), getattr(lens, field.name)
        if field.name == "psf":
            np.testing.assert_allclose(after, before, atol=1e-5)
        else:
            np.testing.assert_array_equal(after, before, err_msg=field.name)
        assert type(after) is type(before)


@pytest.mark.parametrize("header", [{"mirrored": 3}, {"mirrored": [True]}, {"focus_slope": "up"}, {"squeeze": None},
                                    {"squeeze": -1}, {"version": 2}, {"version": 4}], ids=str)
def test_damaged_figures_of_a_lens_over_x_and_y_are_named(path, header):
    write_package(lopsided_grid(), path)
    contents = parts(path)
    facts = json.loads(str(contents["header"])) | header
    np.savez(path, **contents | {"header": np.array(json.dumps(facts))})
    error_of(path)


def test_load_accepts_a_path(path):
    write_package(sample_lens(), path)
    assert load_lens(path).name == load_lens(str(path)).name == "hand-made"


def test_bundled_lens_is_loaded_by_its_name():
    assert load_lens("edmund-54852").name == "edmund-54852"


def test_the_error_for_an_unknown_name_says_where_to_list_names():
    with pytest.raises(LensError, match="no-such-lens.*`lensfield lens list`"):
        load_lens("no-such-lens")


@pytest.mark.parametrize("name", ["x" * 5000, "nul\0byte", ""], ids=["long", "nul", "empty"])
def test_a_name_that_cannot_be_a_path_is_a_lens_error(name):
    with pytest.raises(LensError):
        load_lens(name)


def test_other_kinds_of_file_are_refused(tmp_path):
    path = tmp_path / "lens.zmx"
    path.write_text("VERS 1")
    with refused(LensError, field="surfaces", value="0", where="lens.zmx"):
        load_lens(path)


class Bomb:
    """Fails the test if it is unpickled."""

    def __reduce__(self):
        return pytest.fail, ("a pickle was loaded",)


def test_a_pickled_array_is_refused(path):
    error_of(rewritten(path, psf_amplitude=np.array([Bomb()], dtype=object)))


def test_a_bare_pickle_is_refused(path):
    path.write_bytes(pickle.dumps(Bomb()))
    error_of(path)


def test_a_bare_array_is_refused(path):
    stream = io.BytesIO()
    np.save(stream, np.zeros(3))
    path.write_bytes(stream.getvalue())
    error_of(path)


def test_some_other_zip_is_refused(path):
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("readme.txt", "hello")
    error_of(path)


@pytest.mark.parametrize("field", [name for name in STORED_ARRAYS if name != "point_flux"])
def test_a_missing_array_is_named(path, field):
    assert error_of(rewritten(path, drop=[field])).field == field


def test_an_older_package_gets_a_default_point_flux(path):
    lens = read_package(rewritten(path, drop=["point_flux"]))
    assert np.all(lens.point_flux == 1) and lens.point_flux.shape == lens.relative_illumination.shape


def test_an_older_package_has_no_central_obstruction(path):
    assert read_package(rewritten(path, header={"central_obstruction": ...})).central_obstruction == 0


@pytest.mark.parametrize("field", [name for name in HEADER_FIELDS if name != "central_obstruction"])
def test_a_missing_figure_is_named(path, field):
    assert error_of(rewritten(path, header={field: ...})).field == field


@pytest.mark.parametrize("field", STORED_ARRAYS)
def test_an_array_of_the_wrong_shape_is_named(path, field):
    error = error_of(rewritten(path, **{field: np.ones((5, 3, 1))}))
    if field == "psf_amplitude":
        assert field in str(error)
    else:
        assert "shape" in str(error)
    if field not in ("wavelengths_nm", "heights_mm", "psf_amplitude"):
        assert error.field == field


@pytest.mark.parametrize("amplitudes", [np.zeros((2, 11, 8, 8), np.uint16), np.ones((2, 11, 8, 8), np.float32),
                                        np.ones((2, 11, 8, 3), np.uint16), np.ones((2, 11, 0, 0), np.uint16)],
                         ids=["dark", "float", "narrow", "empty"])
def test_amplitudes_that_are_not_psfs_are_refused(path, amplitudes):
    assert "psf" in str(error_of(rewritten(path, psf_amplitude=amplitudes)))


@pytest.mark.parametrize("window", [8, 9])
def test_psfs_lose_little_light_when_written_and_none_when_rewritten(path, window):
    rng = np.random.default_rng(1)
    psf = rng.random((2, 11, window, window)) ** 12  # seven decades of range
    lens = make_lens(psf / psf.sum(axis=(2, 3), keepdims=True))
    write_package(lens, path)
    once = read_package(path)
    write_package(once, path)
    assert np.abs(once.psf - lens.psf).sum(axis=(2, 3)).max() < 1e-4
    np.testing.assert_allclose(read_package(path).psf, once.psf, atol=1e-7)


def test_one_half_of_mirror_symmetric_psfs_is_stored(path):
    lens = make_lens(gaussian_psf(2, 3, 1.0, 9))
    write_package(lens, path)
    assert parts(path)["psf_amplitude"].shape == (2, 11, 9, 5)
    np.testing.assert_allclose(read_package(path).psf, lens.psf, atol=1e-5)


@pytest.mark.parametrize("field, value", [("efl_mm", -6.0), ("efl_mm", float("nan")), ("psf_pitch_um", 0),
                                          ("sensor_mm", [1.0]), ("sensor_mm", [1.0, 1e300]),
                                          ("f_number_effective", 0), ("efl_mm", 1e300),
                                          ("entrance_pupil_mm", -1e300), ("object_distance_mm", 1e300)])
def test_an_impossible_figure_is_named(path, field, value):
    assert error_of(rewritten(path, header={field: value})).field == field


@pytest.mark.parametrize("field", ["heights_mm", "real_height_mm", "relative_illumination", "wavelengths_nm"])
def test_excessive_numbers_are_named(path, field):
    table = getattr(sample_lens(), field).copy()
    table.flat[-1] = 1e300
    assert error_of(rewritten(path, **{field: table})).field == field


@pytest.mark.parametrize("header", [{"efl_mm": "six"}, {"efl_mm": None}, {"sensor_mm": 5}, {"sensor_mm": "wide"},
                                    {"psf_pitch_um": [1]}, {"magnification": {}}], ids=str)
def test_a_figure_of_the_wrong_kind_is_an_error(path, header):
    error_of(rewritten(path, header=header))


@pytest.mark.parametrize("header", [{"name": 0.5}, {"maker": ["x"]}, {"notes": None}, {"magnification": [1]},
                                    {"efl_mm": True}, {"efl_mm": 10**400}, {"sensor_mm": [[4.8], [3.6]]},
                                    {"sensor_mm": ["4.8", "3.6"]}, {"sensor_mm": 4.8}], ids=str)
def test_types_are_checked_field_by_field(path, header):
    assert error_of(rewritten(path, header=header)).field in header


def test_texts_cannot_control_a_terminal(path):
    lens = read_package(rewritten(path, header={"name": "\x1b]0;owned\x07lens", "notes": "one\ntwo\x1b[31m"}))
    assert lens.name == "?]0;owned?lens" and lens.notes == "one\ntwo?[31m"


@pytest.mark.parametrize("field", ["efl_mm", "name", "sensor_mm"])
def test_a_header_nested_100_000_deep_is_refused(path, field):
    write_package(sample_lens(), path)
    header = parts(path)["header"].item()
    value = json.loads(header)[field]
    deep = header.replace(f'"{field}": {json.dumps(value)}', f'"{field}": {"[" * 10**5}{"]" * 10**5}')
    np.savez(path, **parts(path) | {"header": np.array(deep)})
    assert deep != header and error_of(path).field == "header"


def memory_taken(read):
    """The peak memory of Python and numpy during a read."""
    tracemalloc.start()
    try:
        read()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_unknown_parts_of_a_package_are_not_read(path):
    rewritten(path, junk=np.zeros(2**25))
    assert memory_taken(lambda: read_package(path)) < 2**24


def npy(kind, shape, data=b"", version=(1, 0)):
    """The bytes of a .npy file, with a header that may be false."""
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": kind, "fortran_order": False, "shape": shape})
    return b"\x93NUMPY" + bytes(version) + stream.getvalue()[8:] + data


HEADERS = {"more than it holds": npy("<u2", (2, 11, 10**4, 10**4)), "beyond all numbers": npy("<u2", (2**40, 2**40)),
           "negative": npy("<u2", (-1, -1), bytes(2)), "less than it holds": npy("<u2", (2, 2), bytes(9)),
           "records": npy([("a", "<f8")], (1,), bytes(8)), "objects": npy("|O", (1,), bytes(8)),
           "version": npy("<u2", (1,), bytes(2), (9, 9)), "nothing": b"", "no magic": bytes(200)}


@pytest.mark.parametrize("contents", HEADERS.values(), ids=HEADERS)
def test_arrays_with_false_headers_are_refused_before_reading(path, contents):
    rewritten(path, drop=["psf_amplitude"])
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("psf_amplitude.npy", contents)
    assert memory_taken(lambda: error_of(path)) < 2**22


def test_a_bomb_is_refused_before_decompression(path):
    """Half a gigabyte of PSFs in half a megabyte; one sample of each is lit, so that they could be PSFs."""
    rewritten(path, drop=["psf_amplitude"])
    row = np.zeros((1, 2048, 2048), np.uint16)
    row[0, 0, 0] = 1
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive, archive.open("psf_amplitude.npy", "w") as member:
        member.write(npy("<u2", (6, 11, 2048, 2048)))
        for _ in range(66):
            member.write(row.tobytes())
    assert path.stat().st_size < 2**20
    assert memory_taken(lambda: error_of(path)) < 2**22
    assert "would take 554 MB" in str(error_of(path))


def test_other_compression_methods_are_refused(path):
    """Their dictionaries alone can take gigabytes."""
    write_package(sample_lens(), path)
    contents = {name: (io.BytesIO(), value) for name, value in parts(path).items()}
    with zipfile.ZipFile(path, "w", zipfile.ZIP_LZMA) as archive:
        for name, (stream, value) in contents.items():
            np.save(stream, value)
            archive.writestr(f"{name}.npy", stream.getvalue())
    error_of(path)


@pytest.mark.parametrize("header", [{"format": "something else"}, {"version": 1}, {"version": ...}], ids=str)
def test_another_format_is_refused(path, header):
    error_of(rewritten(path, header=header))


@pytest.mark.parametrize("header", ["", "{", "[1, 2]", "null", "{}"])
def test_a_damaged_header_is_refused(path, header):
    write_package(sample_lens(), path)
    np.savez(path, **parts(path) | {"header": np.array(header)})
    assert error_of(path).field == "header"


@pytest.mark.parametrize("fraction", [0.0, 0.1, 0.5, 0.9, 0.99])
def test_a_truncated_package_is_refused(path, fraction):
    write_package(sample_lens(), path)
    contents = path.read_bytes()
    path.write_bytes(contents[:int(fraction * len(contents))])
    error_of(path)


def test_damage_of_any_byte_is_harmless_or_a_lens_error(path):
    write_package(sample_lens(), path)
    sound = path.read_bytes()
    rng = np.random.default_rng(4)
    for position in rng.integers(0, len(sound), 300):
        damaged = bytearray(sound)
        damaged[position] ^= int(rng.integers(1, 256))
        path.write_bytes(damaged)
        try:
            read_package(path)
        except LensError:
            pass
