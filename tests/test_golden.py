"""Files of released versions of Lensfield stay readable, with the same contents; newer versions are refused in a line.

`tests/data/make_golden.py` writes a folder of files for each version that changes a format.
"""

import json
import re
import shutil

import numpy as np
import OpenEXR
import pytest

from golden import FACTS, FOLDERS, READERS, facts_of
from lensfield import InputError
from places import DATA, ROOT

RECORDED = {folder.name: json.loads((folder / FACTS).read_text(encoding="utf-8")) for folder in FOLDERS}
FILES = [(folder, name) for folder, files in RECORDED.items() for name in files if not name.endswith(".blend")]
FORMAT = re.compile(r'"(lensfield-(?!report)[a-z]+)"')
FIRST = DATA / "golden-0.1.0"
WITH_VERSION = [name for folder, name in FILES if folder == FIRST.name]


def assert_same(read, recorded):
    """Requires each recorded fact; today's code may know more."""
    assert recorded and recorded.keys() <= read.keys()
    for name, value in recorded.items():
        assert read[name] == pytest.approx(value, rel=1e-6, abs=1e-12) if isinstance(value, float | list) else (
            read[name] == value), name


@pytest.mark.parametrize("folder, name", FILES)
def test_an_old_file_is_read_as_it_was(folder, name):
    assert_same(facts_of(DATA / folder / name), RECORDED[folder][name])


def test_other_light_would_be_noticed(tmp_path):
    with pytest.raises(AssertionError):
        assert_same(facts_of(FIRST / "radiance.exr"), RECORDED[FIRST.name]["panorama.exr"])
    name = "film.toml"
    (tmp_path / name).write_text((FIRST / name).read_text().replace("[0.2, 0.8, 1.6]", "[0.8, 0.2, 1.6]"))
    with pytest.raises(AssertionError):
        assert_same(facts_of(tmp_path / name), RECORDED[FIRST.name][name])


def test_every_format_with_a_name_has_a_golden_file():
    named = {name for path in (ROOT / "engine").rglob("*.py") for name in FORMAT.findall(path.read_text("utf-8"))}
    texts = [path.read_bytes() for path in FIRST.rglob("*") if path.suffix in (".toml", ".json")]
    headers = [str(np.load(path)["header"]).encode() for path in FIRST.glob("*.npz")]
    assert {name for name in named if any(name.encode() in text for text in texts + headers)} == named
    assert {name.rpartition("/")[2] for name in WITH_VERSION} == READERS.keys()


@pytest.mark.parametrize("name", WITH_VERSION)
def test_a_newer_version_is_refused(name, tmp_path):
    path = shutil.copytree(FIRST, tmp_path / "golden") / name
    RAISED[path.suffix](path)
    expected = r"version is 9: expected [\d or]+; update Lensfield to read newer files$"
    with pytest.raises(InputError, match=expected) as caught:
        facts_of(path)
    assert str(path) in str(caught.value) and str(caught.value).isprintable()


def raise_in_text(path):
    text, count = re.subn(r'(version"?(?: =|:) )1\b', r"\g<1>9", path.read_text(encoding="utf-8"))
    path.write_text(text, encoding="utf-8")
    assert count == 1


def raise_in_package(path):
    with np.load(path) as file:
        arrays = dict(file)
    arrays["header"] = np.array(json.dumps(json.loads(str(arrays["header"])) | {"version": 9}))
    np.savez(path, **arrays)


def raise_in_exr(path):
    with OpenEXR.File(str(path), separate_channels=True) as file:
        file.parts[0].header["lensfield:version"] = 9
        file.write(str(path))


RAISED = {".toml": raise_in_text, ".json": raise_in_text, ".npz": raise_in_package, ".exr": raise_in_exr}


@pytest.mark.parametrize("name", ["radiance.exr", "shot_Scene_0001_report.json"])
def test_a_file_without_a_version_has_version_1(name, tmp_path):
    """Spectral files and records from before 0.1.0."""
    path = tmp_path / name
    if path.suffix == ".exr":
        with OpenEXR.File(str(FIRST / name), separate_channels=True) as file:
            del file.parts[0].header["lensfield:version"]
            file.write(str(path))
    else:
        path.write_text((FIRST / name).read_text(encoding="utf-8").replace('"version": 1,', ""), encoding="utf-8")
    assert_same(facts_of(path), RECORDED[FIRST.name][name])
