"""ISETCam's .mat: its structure, its PSFs' orientation, and damage that must not crash this process."""

import os
import struct
import subprocess
import sys
import zlib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from lensfield.engine import LensError
from lensfield.engine.lens_files import iset_mat, iset_mat_child
from lensfield.engine.lens_files.iset_mat import read_iset_mat
from refusals import refused
from vendor_files import check_same_lens, damages, exported_lens, ray_trace, saved
from waiting import LAST_RESORT_S


@pytest.fixture
def lens():
    return exported_lens()


@pytest.fixture
def in_this_process(monkeypatch):
    """Valid files may be read in this process, which is faster than in a child."""

    def parts(path):
        contents = loadmat(path, squeeze_me=True, struct_as_record=False)
        return dict(iset_mat_child._leaves(iset_mat_child._find(contents, iset_mat_child.DEPTH), ""))

    monkeypatch.setattr(iset_mat, "_parts", parts)


@pytest.mark.parametrize("program", ["Zemax", "Code V"])
def test_psfs_are_turned_outwards(tmp_path, lens, program):
    """zemaxLoad leaves the listing's rows ascending with y, for points below the axis; CODE V's are for points above.
    """
    read = read_iset_mat(saved(tmp_path / "Größe.mat", ray_trace(lens, program)))
    check_same_lens(read, lens)
    brightest = np.unravel_index(read.psf[0, 2].argmax(), read.psf.shape[2:])
    assert np.subtract(brightest, read.psf.shape[-1] // 2).tolist() == [3, 2]


def symmetric(lens):
    """The PSFs averaged with their mirror images, as for a centred lens, in an even window."""
    even = np.zeros((*lens.psf.shape[:2], 12, 12))
    even[..., 2:11, 2:11] = (lens.psf + lens.psf[..., ::-1]) / 2
    return exported_lens(psf=even)


@pytest.mark.parametrize("centre", [6, 5], ids=["Huygens: n/2", "FFT: n/2 - 1"])
def test_the_chief_ray_is_located_by_symmetry(tmp_path, lens, centre, in_this_process):
    even = symmetric(lens)
    read = read_iset_mat(saved(tmp_path / "optics.mat", ray_trace(even, centre=centre)))
    check_same_lens(read, even)


def test_first_order_data_are_read_and_assumptions_noted(tmp_path, lens, in_this_process):
    read = read_iset_mat(saved(tmp_path / "optics.mat", ray_trace(lens), within=("rt",)))
    for field in ("efl_mm", "magnification", "f_number_effective", "object_distance_mm", "reference_wavelength_nm"):
        assert getattr(read, field) == pytest.approx(getattr(lens, field)), field
    assert read.name == "EO54852" and read.entrance_pupil_mm == pytest.approx(4.0, abs=1e-9)
    assert "the orientation of its PSFs" in read.notes


def test_a_single_wavelength_is_read_though_matlab_drops_its_axis(tmp_path, in_this_process):
    lens = exported_lens(waves=1)
    check_same_lens(read_iset_mat(saved(tmp_path / "optics.mat", ray_trace(lens))), lens)


@pytest.mark.parametrize("name", ["effectiveFNumber", "mag", "objectDistance", "referenceWavelength"])
def test_a_missing_figure_is_named(tmp_path, lens, name, in_this_process):
    structure = ray_trace(lens)
    del structure[name]
    with refused(LensError, field=name, value="missing", where="optics.mat"):
        read_iset_mat(saved(tmp_path / "optics.mat", structure))


@pytest.mark.parametrize("part, name, value, field", [
    ("psf", "function", np.ones((4, 5, 3, 2)), "psf.function"), ("psf", "function", "none", "psf.function"),
    ("psf", "sampleSpacing", [[0.25e-3, 0.5e-3]], "psf.sampleSpacing"), ("psf", "sampleSpacing", 0.0, "PSF spacing"),
    ("geometry", "fieldHeight", [0.0, 1.0], "geometry.fieldHeight"), ("psf", "fieldHeight", 0.0, "psf.fieldHeight"),
    ("relIllum", "function", np.ones(5), "relIllum.function"),
    ("geometry", "function", np.full((3, 2), np.nan), "real_height_mm")],
    ids=str)
def test_inconsistent_parts_are_named(tmp_path, lens, part, name, value, field, in_this_process):
    structure = ray_trace(lens)
    structure[part] = structure[part] | {name: value}
    with refused(LensError, field=field):
        read_iset_mat(saved(tmp_path / "optics.mat", structure))


def test_other_structures_are_refused(tmp_path):
    savemat(tmp_path / "scene.mat", {"scene": {"data": {"photons": np.ones((3, 3))}}, "x": np.arange(3)})
    with refused(LensError, field=".mat file", value="not readable", where="scene.mat", match="no ray-trace structure"):
        read_iset_mat(tmp_path / "scene.mat")


@pytest.mark.parametrize("head", [b"MATLAB 7.3 MAT-file, Platform: GLNXA64", b"\x89HDF\r\n\x1a\n",
                                  b" " * 512 + b"\x89HDF\r\n\x1a\n"], ids=["text", "hdf5", "hdf5 after a block"])
def test_the_error_for_version_7_3_says_how_to_save(tmp_path, head):
    (tmp_path / "optics.mat").write_bytes(head + bytes(600))
    with refused(LensError, field=".mat file", value="version 7.3", where="optics.mat",
                 match="is version 7.3: save it from MATLAB with the option -v7"):
        read_iset_mat(tmp_path / "optics.mat")


def test_damaged_files_are_one_line_errors(tmp_path, lens):
    sound = saved(tmp_path / "optics.mat", ray_trace(lens)).read_bytes()

    def outcome(numbered):
        number, damaged = numbered
        path = tmp_path / f"{number}.mat"
        path.write_bytes(damaged)
        try:
            read_iset_mat(path)
        except LensError as error:
            return str(error)
        return "sound"

    with ThreadPoolExecutor(2) as threads:
        outcomes = list(threads.map(outcome, enumerate([b"junk" * 99, *damages(sound, 5)])))
    assert all("\n" not in text for text in outcomes)
    assert sum("not readable" in text for text in outcomes) >= 2


@pytest.mark.parametrize("program, message, timeout_s", [
    ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "its reader crashed", LAST_RESORT_S),
    ("import sys; sys.exit('what is\\nwrong')", "wrong", LAST_RESORT_S),
    ("import threading; threading.Event().wait()", "still unread after", 0.1)], ids=["crash", "message", "hang"])
@pytest.mark.skipif(os.name == "nt", reason="Windows has no such signals")
def test_a_child_that_crashes_or_hangs_is_a_lens_error(tmp_path, lens, monkeypatch, program, message, timeout_s):
    (tmp_path / "child.py").write_text(program)
    monkeypatch.setattr(iset_mat, "CHILD", tmp_path / "child.py")
    monkeypatch.setattr(iset_mat, "TIMEOUT_S", timeout_s)
    with refused(LensError, field=".mat file", where="optics.mat", match=message):
        read_iset_mat(saved(tmp_path / "optics.mat", ray_trace(lens)))


def test_scipys_reader_stays_in_the_child():
    folder = Path(iset_mat.__file__).parent
    assert {path.name for path in folder.glob("*.py") if "scipy.io" in path.read_text(encoding="utf-8")} == {
        "iset_mat_child.py"}


def with_stated_size(path, size):
    """A file with one compressed variable that declares this many bytes."""
    body = zlib.compress(struct.pack("<II", 14, size) + bytes(2**20))
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1IM" + struct.pack("<II", 15, len(body)) + body)
    return path


def test_a_bomb_is_refused_by_its_size_without_decoding(tmp_path, monkeypatch):
    monkeypatch.setattr(iset_mat, "_run_child", lambda *_: pytest.fail("decoded"))
    with refused(LensError, field=".mat file", value="2147 MB according to its tags", where="optics.mat",
                 match="2147 MB according to its tags: expected at most 17 MB"):
        read_iset_mat(with_stated_size(tmp_path / "optics.mat", 2**31))


@pytest.mark.parametrize("compress", [False, True])
def test_the_stated_size_is_that_of_the_arrays(tmp_path, compress):
    savemat(tmp_path / "optics.mat", {"a": np.zeros(10**5), "b": np.zeros(10**4)}, do_compression=compress)
    assert iset_mat._stated_bytes(tmp_path / "optics.mat") == pytest.approx(880_000, abs=300)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems do not limit address space so")
def test_a_memory_limit_set_by_the_user_is_respected(tmp_path, lens):
    """`ulimit -v` cannot be raised again, and this is not necessary."""
    saved(tmp_path / "optics.mat", ray_trace(lens))
    code = f"""if True:
        import resource
        resource.setrlimit(resource.RLIMIT_AS, (3 * 2**30, 3 * 2**30))
        from lensfield.engine.lens_files.iset_mat import read_iset_mat
        print(read_iset_mat({str(tmp_path / "optics.mat")!r}).name)"""
    completed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (completed.stdout, completed.stderr) == ("EO54852\n", "")


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems do not limit address space so")
def test_a_damaged_array_cannot_allocate_excessive_memory(tmp_path, lens):
    """It declares some thousand million cells, in a file that declares itself small."""
    sound = saved(tmp_path / "optics.mat", ray_trace(lens)).read_bytes()
    cells = struct.pack("<II4i", 5, 16, 1, 2**30, 1, 1)  # an array's dimensions, between its flags and its name
    flags, name = struct.pack("<IIII", 6, 8, 1, 0), struct.pack("<HH4s", 1, 4, b"cell")
    body = flags + cells + name
    (tmp_path / "optics.mat").write_bytes(sound[:128] + struct.pack("<II", 14, len(body)) + body)
    with refused(LensError, field=".mat file", value="not readable", where="optics.mat",
                 match="not readable.*(allocate|MemoryError)"):
        read_iset_mat(tmp_path / "optics.mat")
