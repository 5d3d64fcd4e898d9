"""The library of loops: how it is built, located, refused and selected."""

import multiprocessing
import os
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from lensfield import cli
from lensfield.engine.field.footprints import LARGEST_FOOTPRINT_PX
from lensfield.engine.kernels import build, library
from lensfield.engine.kernels.declarations import NUMBERS
from lensfield.engine.kernels.library import available, running
from lensfield.engine.kernels.turning import TurnableSamples, turn
from places import ROOT

HERE = build.this_platform()
needs_library = pytest.mark.skipif(len(available()) < 2, reason="no library of the loops: no compiler")


@pytest.fixture(autouse=True)
def variable_unset(monkeypatch):
    monkeypatch.delenv(library.VARIABLE, raising=False)


@pytest.fixture
def library_reset(monkeypatch):
    """Clear the record of the loaded library before the test, and again after it."""
    library.loaded.cache_clear()
    yield
    monkeypatch.undo()
    library.loaded.cache_clear()


def compiled(folder, target=HERE):
    """The library of a platform; skips the test if the compiler is missing."""
    try:
        return build.build(folder, target)
    except build.CompilerMissing as missing:
        pytest.skip(str(missing))


@pytest.fixture(scope="module")
def built_library(tmp_path_factory):
    """The library of this platform: the installed one, if its sources have not changed."""
    installed = library.LIBRARY_FOLDER / build.library_name(HERE)
    return installed if build.up_to_date(installed) else compiled(tmp_path_factory.mktemp("library"))


def test_the_fastest_variant_runs_by_default():
    assert available()[0] == "numpy" and running() == available()[-1]


@pytest.mark.parametrize("name", available())
def test_a_variable_selects_another_variant(name, monkeypatch):
    monkeypatch.setenv("LENSFIELD_KERNELS", name)
    assert running() == name


@pytest.mark.parametrize("name", ["mmx", "AVX2", "numpy "])
def test_an_unavailable_variant_is_a_one_line_error_at_first_use(name):
    code = ("import lensfield.engine.kernels.library as library, lensfield.engine.runtime.errors as errors\n"
            "try: library.running()\nexcept errors.InputError as error: print(error)")
    completed = subprocess.run([sys.executable, "-c", code], env=os.environ | {"LENSFIELD_KERNELS": name},
                               capture_output=True, text=True, check=True)
    assert completed.stdout == f"environment: LENSFIELD_KERNELS is {name}: this machine has {', '.join(available())}\n"


@pytest.mark.parametrize("name, status, message", [("numpy", 0, "(inner loops: numpy)"),
                                                   ("mmx", 2, "LENSFIELD_KERNELS is mmx")])
def test_the_command_names_the_running_variant(name, status, message, monkeypatch, capsys):
    monkeypatch.setenv("LENSFIELD_KERNELS", name)
    assert cli.main(["--version"]) == status
    assert message in "".join(capsys.readouterr())


def test_a_process_leaves_out_the_gpu_by_the_variable(monkeypatch):
    """Processes that it starts inherit the variable. A user's own value stays."""
    for _ in range(2):
        library.use_gpu(False)
        assert os.environ[library.VARIABLE] == running() == available()[-1]
    for _ in range(2):
        library.use_gpu(True)
        assert library.VARIABLE not in os.environ
    monkeypatch.setenv(library.VARIABLE, "numpy")
    for allowed in (False, True):
        library.use_gpu(allowed)
        assert os.environ[library.VARIABLE] == "numpy"


def test_without_a_library_numpy_runs(library_reset, monkeypatch, tmp_path, recwarn):
    monkeypatch.setattr(library, "LIBRARY_FOLDER", tmp_path)
    assert available() == ("numpy",) and running() == "numpy" and not recwarn


@needs_library
@pytest.mark.parametrize("what, value", [("sources_digest", lambda: "of other sources"), ("ABI", 0)])
def test_a_library_of_other_sources_is_not_used(what, value, library_reset, monkeypatch):
    monkeypatch.setattr(library, what, value)
    with pytest.warns(RuntimeWarning, match="built from other sources: numpy is used"):
        assert available() == ("numpy",)


@needs_library
def test_without_sources_the_library_of_the_package_is_used(library_reset, monkeypatch):
    monkeypatch.setattr(library, "sources_digest", lambda: "")
    assert len(available()) > 1


def test_an_invalid_library_causes_a_warning(library_reset, monkeypatch, tmp_path):
    (tmp_path / build.library_name(HERE)).write_bytes(b"no library")
    monkeypatch.setattr(library, "LIBRARY_FOLDER", tmp_path)
    with pytest.warns(RuntimeWarning, match="cannot be loaded"):
        assert available() == ("numpy",)


@pytest.mark.sample(2)
@pytest.mark.parametrize("part", [0.1, 0.5, 0.97, 0.9999])
def test_a_truncated_library_causes_a_one_line_warning(part, built_library, tmp_path):
    """In a separate process, because loading half a library crashes it on Linux."""
    cut = tmp_path / built_library.name
    cut.write_bytes(built_library.read_bytes()[:int(part * built_library.stat().st_size)])
    code = ("import sys, pathlib, lensfield.engine.kernels.library as library\n"
            "library.LIBRARY_FOLDER = pathlib.Path(sys.argv[1])\nprint(library.available())")
    completed = subprocess.run([sys.executable, "-c", code, tmp_path], capture_output=True, text=True, check=True)
    assert completed.stdout == "('numpy',)\n"
    assert completed.stderr.startswith(f"{cut}:0: RuntimeWarning: cannot be loaded (")
    assert completed.stderr.count("\n") == 1


@pytest.mark.parametrize("target", build.COMPILERS)
def test_builds_are_reproducible_in_any_folder(target, tmp_path):
    elsewhere = tmp_path / "else where"
    elsewhere.mkdir()
    for path in (*build.HERE.glob("*.[ch]"), build.HERE / "build.py"):
        shutil.copy(path, elsewhere)
    contents = compiled(tmp_path / "here", target).read_bytes()
    environment = {name: value for name, value in os.environ.items() if name != "CC"} | {"TMPDIR": str(tmp_path)}
    subprocess.run([sys.executable, elsewhere / "build.py", tmp_path / "there", target], check=True, env=environment)
    assert (tmp_path / "there" / build.library_name(target)).read_bytes() == contents
    assert not [place for place in (tmp_path, ROOT, os.path.expanduser("~")) if str(place).encode() in contents]
    assert b"GLIBC" not in contents and build.sources_digest().encode() in contents


def test_a_build_is_up_to_date_until_its_sources_change(built_library, tmp_path, monkeypatch):
    assert build.up_to_date(built_library) and not build.up_to_date(tmp_path / "nothing")
    monkeypatch.setattr(build, "sources_digest", lambda: "0" * 16)
    assert not build.up_to_date(built_library)


@pytest.mark.parametrize("compiler, problem", [("/no/where/cc -O2", "/no/where/cc -O2 is not installed"),
                                               ("false", "false cannot compile the C loops")])
def test_a_missing_compiler_is_a_one_line_error(compiler, problem, monkeypatch, tmp_path, capfd):
    monkeypatch.setenv("CC", compiler)
    assert build.main([str(tmp_path)]) == 1
    assert capfd.readouterr().err == f"lensfield: the C loops are unavailable, so numpy is used: {problem}\n"
    assert not list(tmp_path.iterdir())


def test_an_unknown_platform_has_no_loops(tmp_path):
    with pytest.raises(build.CompilerMissing, match="plan9-mips"):
        build.build(tmp_path, "plan9-mips")


def test_python_and_c_have_the_same_largest_footprint():
    assert NUMBERS["LARGEST_FOOTPRINT"] == LARGEST_FOOTPRINT_PX


def turned(_=None):
    random = np.random.default_rng(1)
    samples = TurnableSamples.of(random.random((9, 500)), *random.uniform(-5, 5, (2, 500)), 0.3)
    return turn(samples, [0.4], 21)


@needs_library
def test_threads_and_forked_processes_may_call_concurrently():
    expected = turned()
    with ThreadPoolExecutor(8) as pool:
        for result in pool.map(turned, range(64)):
            np.testing.assert_array_equal(result, expected)
    if "fork" in multiprocessing.get_all_start_methods():
        with multiprocessing.get_context("fork").Pool(2) as pool:
            for result in pool.map(turned, range(4)):
                np.testing.assert_array_equal(result, expected)
