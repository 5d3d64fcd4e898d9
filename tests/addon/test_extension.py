"""The tree as a Blender extension: built and checked by Blender's own tool, installed, enabled and used."""

import os
import shutil
import subprocess
import sys
import sysconfig
import threading
import tomllib
import zipfile
from contextlib import contextmanager
from email.parser import Parser
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from importlib import metadata
from pathlib import Path

import bpy
import pytest
from packaging.requirements import Requirement

import lensfield
from lensfield.engine.kernels.build import WHEEL_TAGS, library_name, this_platform
from places import ROOT
from scripts import script
from waiting import LAST_RESORT_S

pytestmark = pytest.mark.every_blender
TOOL = Path(bpy.utils.resource_path("LOCAL")) / "scripts" / "addons_core" / "bl_pkg" / "cli" / "blender_ext.py"

USE_INSTALLED = """
import sys
import bpy
bpy.ops.extensions.package_install_files(filepath=sys.argv[1], repo="user_default", enable_on_install=True)
module = sys.modules["bl_ext.user_default.lensfield"]
engine = sys.modules["lensfield.engine"]
assert "site-packages" not in module.__file__ and module.__file__.startswith(sys.argv[2]), module.__file__
assert "site-packages" in engine.__file__ and engine.__file__.startswith(sys.argv[2]), engine.__file__
assert not {"lensfield.addon", "lensfield.commands"} & set(sys.modules), "the extension's own are used"
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
def wheel(tmp_path_factory):
    return script("packaging/build_wheels.py").build(tmp_path_factory.mktemp("wheel"), this_platform())


@pytest.fixture(scope="module")
def build_extension():
    return script("packaging/build_extension.py")


@pytest.fixture
def without_downloads(build_extension, monkeypatch):
    """Lets zips contain no other wheels than Lensfield's."""
    monkeypatch.setattr(build_extension, "download_wheels", lambda folder, platform, python: folder.mkdir())


@pytest.fixture(scope="module")
def with_installed_packages(build_extension):
    """Lets zips contain wheels of this environment's packages, which need no download."""
    def pack_all(folder, platform, python):
        folder.mkdir()
        for requirement in (*build_extension.COMPILED, *build_extension.PURE):
            pack(metadata.distribution(Requirement(requirement).name), folder)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(build_extension, "download_wheels", pack_all)
        yield


def pack(installed, folder):
    """Write the wheel of an installed package."""
    tag = Parser().parsestr(installed.read_text("WHEEL"))["Tag"]
    name = f"{installed.name.replace('-', '_')}-{installed.version}-{tag}.whl"
    with zipfile.ZipFile(folder / name, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as package:
        for file in installed.files:
            if file.parts[0] != ".." and file.suffix != ".pyc":
                package.write(file.locate(), file)


@pytest.fixture(scope="module")
def package(build_extension, wheel, with_installed_packages):
    """The zip for this Blender, with all wheels."""
    return build_extension.build(wheel.parent, fitting(build_extension)[0])


def fitting(build_extension):
    """The zips of this platform for this Blender."""
    def numbers(version):
        return tuple(map(int, version.split(".")))

    return [f"{this_platform()}-{name}" for name, each in build_extension.GENERATIONS.items()
            if name.startswith("blender")
            and numbers(each.first) <= bpy.app.version < (numbers(each.end) if each.end else (99,))]


@pytest.fixture
def run_in_blender(tmp_path):
    """Runs code in this Python, but without the packages that are installed in it, except Blender and what its wheel
    requires: a function of (code, arguments) that returns what it printed. Blender's folder of the user is `user` in
    tmp_path."""
    libraries = tmp_path / "libraries"
    libraries.mkdir()
    tops = {file.parts[0] for name in required_by("bpy") for file in metadata.files(name)}
    for top in tops - {"..", "__pycache__"}:
        (libraries / top).symlink_to(Path(sysconfig.get_path("platlib"), top))
    environment = os.environ | {"BLENDER_USER_RESOURCES": str(tmp_path / "user"), "LENSFIELD_CACHE": "",
                                "PYTHONPATH": str(libraries), "no_proxy": "127.0.0.1"}

    def run(code, *arguments):
        completed = subprocess.run([sys.executable, "-S", "-c", code, *map(str, arguments)], capture_output=True,
                                   text=True, timeout=LAST_RESORT_S, env=environment, cwd=tmp_path)
        assert completed.returncode == 0, completed.stdout[-2000:] + completed.stderr
        return completed.stdout

    return run


def required_by(name):
    """The names of an installed package and of all that it requires."""
    names, left = set(), [name]
    while left:
        names.add(name := left.pop())
        requirements = (Requirement(text) for text in metadata.requires(name) or [])
        left += {each.name for each in requirements if not each.marker or each.marker.evaluate({"extra": ""})} - names
    return names


def test_manifest_is_valid():
    completed = subprocess.run([sys.executable, TOOL, "validate", ROOT], capture_output=True, text=True)
    assert completed.returncode == 0, completed.stdout + completed.stderr


def test_a_zip_contains_python_and_the_wheel_of_the_engine(package, wheel):
    names = zipfile.ZipFile(package).namelist()
    assert {"blender_manifest.toml", "__init__.py", "cli.py", "request.py", "restart.py", "commands/render.py",
            "addon/render/render.py", "addon/scene/traced_camera.osl", "LICENSE", f"wheels/{wheel.name}"} <= set(names)
    left_out = (".", "engine", "tests", "sample_scenes", "packaging", "docs", "validation", "benchmarks",
                "commands/cluster.py")
    assert not [name for name in names if name.startswith(left_out)]
    assert {Path(name).suffix for name in names} <= {".py", ".toml", ".osl", ".glsl", ".md", ".whl", ""}


def test_the_wheel_contains_the_runtime_files(wheel):
    names = [name.removeprefix("lensfield/") for name in zipfile.ZipFile(wheel).namelist()]
    assert {"__init__.py", "commands/render.py", "addon/scene/traced_camera.osl", "engine/simulation/simulate.py",
            f"engine/kernels/lib/{library_name(this_platform())}", "engine/runtime/build_identity.txt",
            "engine/library/edmund-54852.npz", "engine/library/prescriptions/tessar-50mm.toml",
            "engine/library/pictures/tessar-50mm.jpg", "engine/spectral/data/cie1931_2deg.csv",
            "engine/spectral/data/refraction/gold.yml", "engine/spectral/data/spectra/lights/led-b3.spd"} <= set(names)
    assert not {"setup.py", "tests/conftest.py"} & set(names)


@pytest.mark.one_blender
def test_a_wheel_has_the_same_bytes_when_it_is_built_again_elsewhere(wheel, tmp_path):
    assert script("packaging/build_wheels.py").build(tmp_path, this_platform()).read_bytes() == wheel.read_bytes()


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


def test_a_zip_installs_enables_and_renders_with_the_engine_of_its_wheel(package, run_in_blender, tmp_path):
    assert "installed and used" in run_in_blender(USE_INSTALLED, package, tmp_path / "user", tmp_path / "out")
    assert (tmp_path / "out" / "unsaved_Scene_0001_lens_image.exr").is_file()
    plans = tmp_path / "user" / "extensions" / ".user" / "user_default" / "lensfield" / "cache" / "plans"
    assert list(plans.iterdir())


NEXT = "99.0.0"
START = """
import sys
from pathlib import Path
import bpy
bpy.ops.wm.read_userpref()  # Blender as a module starts without
repositories = bpy.context.preferences.extensions.repos
if "shop" not in repositories:
    bpy.context.preferences.system.use_online_access = True
    repositories.new(name="shop", module="shop", remote_url=sys.argv[1]).use_remote_url = True
place = {"repo_index": repositories.find("shop")}
bpy.ops.extensions.repo_sync(**place)
extension, newer = "bl_ext.shop.lensfield", sys.argv[2]
def versions():
    return [sys.modules[name].__version__ for name in (extension, "lensfield")]
def files():
    presets = Path(bpy.utils.user_resource("SCRIPTS", path="presets/lensfield"))
    return [presets / "camera" / "Portrait.py", Path(bpy.utils.extension_path_user(extension, path="cache"), "lens")]
"""
INSTALL = """
assert bpy.ops.extensions.package_install(pkg_id="lensfield", **place) == {"FINISHED"}
assert versions() == [sys.argv[3]] * 2
bpy.context.scene.camera.data.lensfield.lens = "tessar-50mm"
assert bpy.ops.lensfield.favourite() == {"FINISHED"}
assert bpy.ops.lensfield.add_camera_preset(name="Portrait") == {"FINISHED"}
preset, cached = files()
cached.parent.mkdir(parents=True, exist_ok=True)
cached.touch()
assert preset.is_file()
"""
UPDATE = """
assert versions() == [sys.argv[3]] * 2 and hasattr(bpy.types, "LENSFIELD_OT_render")
bpy.ops.extensions.package_upgrade_all()
assert versions() == [newer, sys.argv[3]]
assert hasattr(bpy.types, "LENSFIELD_PT_restart") and not hasattr(bpy.types, "LENSFIELD_OT_render")
"""
REMOVE = """
assert versions() == [newer] * 2
assert hasattr(bpy.types, "LENSFIELD_OT_render") and not hasattr(bpy.types, "LENSFIELD_PT_restart")
offered = sys.modules[extension + ".addon.ui.common.properties"].offered_lenses()
assert offered[0][0] == "tessar-50mm", "the favourite comes first"
preset, cached = files()
assert preset.is_file() and cached.is_file()
assert bpy.ops.extensions.package_uninstall(pkg_id="lensfield", **place) == {"FINISHED"}
assert not hasattr(bpy.types, "LENSFIELD_OT_render") and not Path(repositories["shop"].directory, "lensfield").exists()
assert preset.is_file() and not cached.exists(), "the caches are of no use without the extension"
"""
END = """
bpy.ops.wm.save_userpref()
print("done", flush=True)
import os
os._exit(0)  # some wheels crash while the interpreter exits
"""


def test_a_repository_installs_updates_and_removes_the_extension(package, build_extension, wheel, tmp_path,
                                                                 monkeypatch, run_in_blender):
    shop = tmp_path / "shop"
    shop.mkdir()
    (shop / package.name).symlink_to(package)
    with served(shop) as address:
        arguments = f"{address}/index.json", NEXT, lensfield.__version__
        index(shop)
        run_in_blender(START + INSTALL + END, *arguments)
        monkeypatch.setattr(build_extension, "__version__", NEXT)
        monkeypatch.setattr(build_extension, "ROOT", newer_tree(tmp_path / "tree"))
        newer_wheel(wheel, shop)
        (shop / package.name).unlink()  # of two versions, Blender would not choose the newer one
        build_extension.build(shop, fitting(build_extension)[0])
        index(shop)
        for step in (UPDATE, REMOVE):
            assert "done" in run_in_blender(START + step + END, *arguments)


def newer_tree(folder):
    """A copy of the extension's source with the version NEXT."""
    folder.mkdir()
    manifest = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))
    for pattern in manifest["build"]["paths_exclude_pattern"]:
        path = ROOT / pattern.removeprefix("!/")
        if pattern.startswith("!/"):
            (shutil.copytree if path.is_dir() else shutil.copy)(path, folder / path.name)
    shutil.copy(ROOT / "blender_manifest.toml", folder)
    source = folder / "__init__.py"
    source.write_text(source.read_text().replace(lensfield.__version__, NEXT))
    return folder


def newer_wheel(wheel, folder):
    """Write a copy of a wheel with the version NEXT."""
    with zipfile.ZipFile(wheel) as old, zipfile.ZipFile(folder / renamed(wheel.name), "w") as new:
        for name in old.namelist():
            content = old.read(name)
            if ".dist-info/" in name or name == "lensfield/__init__.py":
                content = content.replace(lensfield.__version__.encode(), NEXT.encode())
            new.writestr(renamed(name), content)


def renamed(name):
    return name.replace(f"lensfield-{lensfield.__version__}", f"lensfield-{NEXT}")


def index(folder):
    """Write the index of a repository, as `make release` does."""
    subprocess.run([sys.executable, TOOL, "server-generate", "--repo-dir", folder], check=True, capture_output=True)


@contextmanager
def served(folder):
    """Serve a folder on this machine; its address."""
    class Quiet(SimpleHTTPRequestHandler):
        def log_message(self, *words):
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=folder)) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


@pytest.mark.sample(1)
@pytest.mark.one_blender
@pytest.mark.parametrize("name", ["linux-x64-blender4.5", "linux-x64-python3.14", "windows-x64-blender5.1",
                                  "macos-arm64-blender4.5"])
def test_a_zip_has_only_its_platforms_wheels_and_its_generations_versions(name, build_extension, without_downloads,
                                                                          tmp_path):
    platform, generation = build_extension.ZIPS[name]
    wheel = tmp_path / f"lensfield-{lensfield.__version__}-py3-none-{WHEEL_TAGS[platform]}.whl"
    wheel.touch()
    package = zipfile.ZipFile(build_extension.build(tmp_path, name))
    manifest = tomllib.loads(package.read("blender_manifest.toml").decode())
    assert manifest["platforms"] == [platform]
    assert manifest["version"] == lensfield.__version__ + generation.suffix
    assert manifest["blender_version_min"] == generation.first
    assert manifest.get("blender_version_max") == generation.end
    assert manifest["wheels"] == [f"./wheels/{wheel.name}"]


def test_one_zip_of_each_platform_is_for_this_blender_and_its_python(build_extension):
    name, = fitting(build_extension)
    _, generation = build_extension.ZIPS[name]
    assert generation.python == ".".join(map(str, sys.version_info[:2]))
    assert generation.platforms == tuple(build_extension.PLATFORMS)


def test_an_unknown_zip_is_reported_with_those_that_exist(build_extension, tmp_path):
    with pytest.raises(SystemExit, match="unknown zip linux-x64: expected linux-x64-blender4.5, "):
        build_extension.main([str(tmp_path), "linux-x64"])


def test_no_zip_is_built_without_the_wheel_of_its_platform(build_extension, tmp_path):
    with pytest.raises(SystemExit, match="-win_amd64.whl: missing: build it with packaging/build_wheels.py"):
        build_extension.main([str(tmp_path), "windows-x64-blender5.1"])
    assert not list(tmp_path.glob("*.zip"))


def test_no_wheel_is_built_without_its_compiler(tmp_path):
    environment = os.environ | {"PATH": str(Path(sys.executable).parent)}
    completed = subprocess.run([sys.executable, ROOT / "packaging" / "build_wheels.py", tmp_path, "windows-x64"],
                               capture_output=True, text=True, env=environment)
    assert completed.returncode and "no wheel for windows-x64: x86_64-w64-mingw32-gcc" in completed.stderr
    assert not list(tmp_path.iterdir())
