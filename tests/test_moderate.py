"""The script finds code that moderators of Blender's extensions refuse, and finds none in the extension."""

import subprocess
import sys
import tomllib

import pytest

from places import ROOT
from scripts import script

SCRIPT = ROOT / "packaging" / "moderate.py"
REFUSED = {
    "import threading": "import threading",
    "def work():\n    from concurrent.futures import ThreadPoolExecutor": "import concurrent.futures",
    "area = eval(text)": "eval()",
    "__import__(name)": "__import__()",
    "import sys\nsys.path.insert(0, folder)": "change of sys.path",
    "import sys\nsys.path[:0] = [folder]": "change of sys.path",
    "import sys\nsys.path += [folder]": "change of sys.path",
    "import sys\ndel sys.modules[name]": "change of sys.modules",
    "FOLDER = Path(__file__).parent": "__file__",
    "preferences = context.preferences.addons[__name__]": "__name__",
    "open(path, 'wb')": "open() to write",
    "path.open(mode='a')": "open() to write",
    "open(path, 'r+')": "open() to write",
    "(folder / name).write_text(text)": "write_text() to write",
    "with lock():\n    path.write_bytes(data)": "write_bytes() to write",
    "try:\n    import yaml\nexcept ImportError:\n    yaml = None": "import guard",
    "try:\n    import yaml\nexcept (OSError, ModuleNotFoundError):\n    pass": "import guard",
    "try:\n    import yaml\nexcept:\n    pass": "import guard",
    "from contextlib import suppress\nwith suppress(ImportError):\n    import yaml": "import guard",
    "from distributed import Client": "import distributed",
    "import pip": "import pip",
    "import urllib.request": "import urllib.request",
    "from http.client import HTTPSConnection": "import http.client",
    "import webbrowser": "import webbrowser",
    "shutil.which('dcraw')": "shutil.which()",
    "hasattr(bpy.types, 'FLAMENCO_OT_submit_job')": "'FLAMENCO_OT_submit_job'",
    "bpy.ops.preferences.addon_enable(module='io_scene_fbx')": "bpy.ops.preferences.addon_enable()",
    "importlib.reload(panels)": "importlib.reload()",
    "layout.operator('wm.url_open').url = 'https://www.patreon.com/us'": "'patreon'",
    "layout.label(text='Please donate')": "'donate'",
}
"""Code, and how it is named."""
HARMLESS = [
    "# import threading, eval(text), __file__, patreon",
    "'''Nothing is evaluated with eval(); see threading.'''",
    "import os.path, numpy, scipy, bpy\nfrom PIL import Image\nfrom urllib.parse import quote\nfrom . import threading",
    "import sys\nif 'bpy' in sys.modules:\n    print(*sys.path)",
    "model.eval()\nre.compile('x')\nmodes.append('w')",
    "if __name__ == '__main__':\n    main()",
    "open(path)\nopen(path, 'rb')\nopen(path, encoding='utf-8')\nopen(os.devnull, 'w')",
    "Image.open(path, formats=['PNG'])",
    "with atomic_path(path, overwrite=True) as temporary:\n    temporary.write_text(text)",
    "with temporary_folder() as folder:\n    with open(folder / 'log', 'w') as log:\n        log.write(text)",
    "try:\n    import yaml\nexcept ImportError as error:\n    raise InputError('yaml', 'module', 'missing') from error",
    "try:\n    text = path.read_text()\nexcept Exception:\n    text = ''",
    "getattr(bpy.types, 'LENSFIELD_OT_render')",
]


@pytest.fixture(scope="module")
def moderate():
    return script("packaging/moderate.py")


@pytest.fixture
def extension(tmp_path):
    """A folder with the manifest."""
    (tmp_path / "blender_manifest.toml").write_bytes((ROOT / "blender_manifest.toml").read_bytes())
    return tmp_path


@pytest.fixture
def manifest():
    return tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))


@pytest.mark.parametrize("source", REFUSED)
def test_each_refused_construct_is_reported_with_its_line(moderate, source):
    found = [(line, text.partition(": ")[0]) for line, text in moderate.findings_in(source)]
    lines = {number for number, line in enumerate(source.splitlines(), 1) if not line.startswith("import sys")}
    assert REFUSED[source] in {what for _, what in found} and {line for line, _ in found} <= lines


@pytest.mark.parametrize("source", HARMLESS)
def test_comments_reading_and_checked_writing_are_no_findings(moderate, source):
    assert moderate.findings_in(source) == []


def test_the_engine_may_start_threads_but_not_connect_or_evaluate(moderate):
    assert moderate.findings_in("import threading\nFOLDER = __file__", of_engine=True) == []
    for source in ("import socket", "exec(text)", "import sys\nsys.path.append(folder)"):
        assert len(moderate.findings_in(source, of_engine=True)) == 1


@pytest.mark.parametrize("change, words", [
    ({"permissions": {"files": "Write EXR files", "network": "Look for lenses"}}, "permission 'network'"),
    ({"permissions": {}}, "permission 'files': missing"),
    ({"name": "Lensfield for Blender"}, "name 'Lensfield for Blender'"),
    ({"website": "https://ko-fi.com/lensfield"}, "website 'ko-fi'")])
def test_permissions_name_and_links_of_the_manifest_are_checked(moderate, manifest, change, words):
    assert moderate.manifest_findings(manifest) == []
    found, = moderate.manifest_findings(manifest | change)
    assert found.startswith(words)


def test_the_packaged_files_and_the_engine_are_searched_and_listed_by_line(extension):
    for name in ("addon/ui/panels.py", "addon/__pycache__/panels.py", "commands/cluster.py", "tests/test_panels.py"):
        (extension / name).parent.mkdir(parents=True, exist_ok=True)
        (extension / name).write_text("import bpy\n\nimport threading\n")
    (extension / "addon" / "logo.PNG").touch()
    (extension / "addon" / "loops.so").touch()
    for name in ("kernels.so", "threads.py", "evaluate.py"):
        (extension / "engine" / name).parent.mkdir(exist_ok=True)
        (extension / "engine" / name).write_text("import threading\n" + "eval(text)\n" * (name == "evaluate.py"))
    completed = subprocess.run([sys.executable, SCRIPT, extension], capture_output=True, text=True)
    assert completed.returncode == 1 and completed.stdout.splitlines() == [
        "addon/loops.so: compiled code: the platform accepts it only in wheels from PyPI; move it to the engine",
        "addon/logo.PNG: picture: logos need their owners' permission; use Blender's icons",
        "addon/ui/panels.py:3: import threading: threads that use Blender's API crash it; let engine/runtime start the "
        "thread",
        "engine/evaluate.py:2: eval(): code that is not in the files cannot be reviewed; write the code out",
        "4 findings for moderators"]


def test_the_extension_has_no_findings():
    completed = subprocess.run([sys.executable, SCRIPT], capture_output=True, text=True)
    assert (completed.returncode, completed.stdout) == (0, "0 findings for moderators\n"), completed.stdout
