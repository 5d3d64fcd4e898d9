"""The tree as a Blender extension: built and checked by Blender's own tool, installed, enabled and used."""

import importlib.util
import os
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import bpy
import pytest

from lensfield.engine.kernels import build as kernels
from places import ROOT
from waiting import LAST_RESORT_S

pytestmark = pytest.mark.every_blender
TOOL = Path(bpy.utils.resource_path("LOCAL")) / "scripts" / "addons_core" / "bl_pkg" / "cli" / "blender_ext.py"

USE_INSTALLED = """
import sys
import bpy
bpy.ops.extensions.package_install_files(filepath=sys.argv[1], repo="user_default", enable_on_install=True)
module = sys.modules["bl_ext.user_default.lensfield"]
assert "site-packages" not in module.__file__ and module.__file__.startswith(sys.argv[2]), module.__file__
scene = bpy.context.scene
scene.cycles.samples = 1
scene.render.resolution_x, scene.render.resolution_y = 16, 12
scene.lensfield.wavelength_mode = "LIST"
scene.lensfield.wavelength_list = "550"
scene.lensfield.output_folder = sys.argv[3]
assert bpy.ops.lensfield.render() == {"FINISHED"}
assert module.cli.main(["render", "a.blend", "--scheduler=tcp://127.0.0.1:1"]) == 2, "Dask is not in the zip"
bpy.ops.preferences.addon_disable(module="bl_ext.user_default.lensfield")
assert not hasattr(scene, "lensfield")
print("installed and used")
sys.stdout.flush()
import os
os._exit(0)  # some wheels crash while the interpreter exits
"""


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    folder = tmp_path_factory.mktemp("extension")
    subprocess.run([sys.executable, TOOL, "build", "--source-dir", ROOT, "--output-dir", folder], check=True,
                   capture_output=True)
    return next(folder.glob("lensfield-*.zip"))


def test_manifest_is_valid():
    completed = subprocess.run([sys.executable, TOOL, "validate", ROOT], capture_output=True, text=True)
    assert completed.returncode == 0, completed.stdout + completed.stderr


def test_package_is_valid_and_contains_the_runtime_files(package):
    completed = subprocess.run([sys.executable, TOOL, "validate", package], capture_output=True, text=True)
    assert completed.returncode == 0, completed.stdout + completed.stderr
    names = zipfile.ZipFile(package).namelist()
    assert {"blender_manifest.toml", "__init__.py", "cli.py", "request.py", "commands/render.py",
            "engine/simulation/simulate.py",
            "addon/render/render.py", "engine/library/edmund-54852.npz",
            "addon/scene/traced_camera.osl",
            "engine/library/prescriptions/tessar-50mm.toml", "engine/library/pictures/tessar-50mm.jpg",
            "engine/spectral/data/cie1931_2deg.csv",
            "engine/spectral/data/refraction/gold.yml",
            "engine/spectral/data/spectra/lights/led-b3.spd", "LICENSE"} <= set(names)
    left_out = (".", "tests", "sample_scenes", "packaging", "docs", "validation", "benchmarks", "commands/cluster.py")
    assert not [name for name in names if name.startswith(left_out)]


def test_unrelated_files_in_the_tree_are_not_packaged(tmp_path):
    tree, belongs = tmp_path / "tree", {"blender_manifest.toml", "__init__.py", "addon/ui/panels.py", "LICENSE"}
    for name in (*belongs, "pictures/addon/frame.exr", "notes.txt", ".git/config",
                 "addon/.swp", "addon/ui/__pycache__/panels.pyc", "lensfield.egg-info/PKG-INFO", "tests/addon/test.py"):
        (tree / name).parent.mkdir(parents=True, exist_ok=True)
        (tree / name).touch()
    shutil.copy(ROOT / "blender_manifest.toml", tree)
    subprocess.run([sys.executable, TOOL, "build", "--source-dir", tree, "--output-filepath", tmp_path / "made.zip"],
                   check=True, capture_output=True)
    assert set(zipfile.ZipFile(tmp_path / "made.zip").namelist()) == belongs


def test_package_installs_enables_and_renders(package, tmp_path):
    environment = os.environ | {"BLENDER_USER_RESOURCES": str(tmp_path / "user"), "LENSFIELD_CACHE": ""}
    completed = subprocess.run([sys.executable, "-c", USE_INSTALLED, package, str(tmp_path / "user"), tmp_path / "out"],
                               capture_output=True, text=True, timeout=LAST_RESORT_S, env=environment, cwd=tmp_path)
    assert completed.returncode == 0 and "installed and used" in completed.stdout, completed.stdout + completed.stderr
    assert (tmp_path / "out" / "unsaved_Scene_0001_lens_image.exr").is_file()
    plans = tmp_path / "user" / "extensions" / ".user" / "user_default" / "lensfield" / "cache" / "plans"
    assert list(plans.iterdir())


@pytest.fixture
def build_extension(monkeypatch):
    """packaging/build_extension.py without wheels, to avoid downloads."""
    spec = importlib.util.spec_from_file_location("build_extension", ROOT / "packaging" / "build_extension.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setattr(module, "download_wheels", download_nothing)
    return module


def download_nothing(folder, platform, python):
    folder.mkdir()
    (folder / f"package-1.0-cp{python.replace('.', '')}-none-any.whl").touch()


@pytest.mark.sample(1)
@pytest.mark.one_blender
@pytest.mark.parametrize("name", ["linux-x64-blender4.5", "linux-x64-python3.14", "windows-x64-blender5.1",
                                  "macos-arm64-blender4.5"])
def test_a_zip_is_valid_with_only_its_platforms_kernels_and_its_generations_wheels(name, build_extension, tmp_path):
    platform, generation = build_extension.ZIPS[name]
    try:
        package = zipfile.ZipFile(build_extension.build(tmp_path, name))
    except kernels.CompilerMissing as missing:
        pytest.skip(str(missing))
    assert [Path(path).name for path in package.namelist() if "kernels-" in path] == [kernels.library_name(platform)]
    manifest = tomllib.loads(package.read("blender_manifest.toml").decode())
    assert manifest["platforms"] == [platform]
    assert manifest["blender_version_min"] == generation.first
    assert manifest.get("blender_version_max") == generation.end
    assert manifest["wheels"] == [f"./wheels/package-1.0-cp{generation.python.replace('.', '')}-none-any.whl"]


def test_one_zip_of_each_platform_is_for_this_blender_and_its_python(build_extension):
    def numbers(version):
        return tuple(map(int, version.split(".")))

    fitting = [each for name, each in build_extension.GENERATIONS.items() if name.startswith("blender")
               and numbers(each.first) <= bpy.app.version < (numbers(each.end) if each.end else (99,))]
    assert [numbers(each.python) for each in fitting] == [sys.version_info[:2]]
    assert all(each.platforms == tuple(build_extension.PLATFORMS) for each in fitting)


def test_an_unknown_zip_is_reported_with_those_that_exist(build_extension, tmp_path):
    with pytest.raises(SystemExit, match="unknown zip linux-x64: expected linux-x64-blender4.5, "):
        build_extension.main([str(tmp_path), "linux-x64"])


def test_no_zip_is_built_without_its_kernels(build_extension, monkeypatch, tmp_path):
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with pytest.raises(SystemExit, match="without the C loops: x86_64-w64-mingw32-gcc is not installed"):
        build_extension.main([str(tmp_path), "windows-x64-blender5.1"])
    assert not list(tmp_path.glob("*.zip"))
