"""Input files: checked before they are opened, and quoted only if the user names them."""

import os

import pytest

from lensfield.engine.library import load_lens
from lensfield.engine.runtime import inputs
from lensfield.engine.runtime.errors import InputError, quoted, withheld
from lensfield.engine.runtime.files import atomic_path
from lensfield.engine.runtime.inputs import check_input, check_named, confine, note_who_names, open_input, release
from lensfield.engine.spectral.refraction import load_refraction
from lensfield.engine.spectral.spectra import load_spectrum
from refusals import refused

posix = pytest.mark.skipif(os.name != "posix", reason="Windows has no pipes and devices among files")
SECRET = "root:$6$salt$hash:19000:0:99999:7:::\n"
KINDS = "toml", "json", "zmx", "dat", "seq", "lens", "txt", "npz"
REMEDY = "the scene names it"


def pipe(path):
    os.mkfifo(path)


def device(path):
    path.symlink_to("/dev/zero")


def sparse(path):
    with open(path, "wb") as file:
        file.truncate(inputs.MOST_BYTES + 1)


@posix
@pytest.mark.parametrize("make, reason", [(pipe, "a device or pipe"), (device, "a device or pipe"),
                                          (sparse, "65536 MB"), (os.mkdir, "a folder"), (lambda _: None, "missing")])
def test_an_unfit_file_is_named_and_not_opened(tmp_path, make, reason):
    path = tmp_path / "file.exr"
    make(path)
    with refused(InputError, field="picture", value=reason, where="file.exr"):
        check_input(path, "picture", "expected an EXR")


@posix
@pytest.mark.parametrize("make", [pipe, device])
@pytest.mark.parametrize("read, name, field", [
    (load_lens, "lens.toml", "lens"), (load_lens, "lens.npz", "lens"), (load_lens, "lens.zmx", "lens"),
    (load_spectrum, "paint.spd", "spectrum"), (load_refraction, "glass.yml", "refraction")])
def test_no_reader_waits_for_a_pipe(tmp_path, make, read, name, field):
    make(tmp_path / name)
    with refused(InputError, field=field, value="a device or pipe", where=name):
        read(str(tmp_path / name))


@posix
def test_a_pipe_that_replaces_a_checked_file_does_not_block(tmp_path):
    pipe(tmp_path / "swapped")
    with open_input(tmp_path / "swapped") as file:
        assert not file.read(1)


@posix
def test_a_scene_may_name_missing_files_and_videos_of_any_size(tmp_path):
    check_named(tmp_path / "missing.png", "image", "scene.blend")
    sparse(tmp_path / "video.mov")
    check_named(tmp_path / "video.mov", "movie clip", "scene.blend", None)
    with refused(InputError, field="image", value="65536 MB", where="video.mov",
                 match="65536 MB: expected at most 65536 MB"):
        check_named(tmp_path / "video.mov", "image", "scene.blend")


@pytest.mark.parametrize("read, name", [*((load_lens, f"own.{kind}") for kind in KINDS), (load_spectrum, "paint.spd"),
                                        (load_refraction, "glass.yml")])
@pytest.mark.parametrize("form", ["{}", '"{}"', "DATA: [{{type: '{}'}}]", "format = '{}'\nversion = 1\n"])
def test_files_that_the_user_does_not_name_are_not_quoted(tmp_path, read, name, form):
    path = tmp_path / name
    path.write_text(form.format(SECRET.strip()))
    note_who_names(path, REMEDY)
    with pytest.raises(InputError, match=f"{name}: content is not valid: {REMEDY}$") as error:
        read(str(path))
    assert not any(word in str(error.value).replace(str(path), "") for word in ("root", "salt", "hash", "19000"))
    note_who_names(path, None)
    with pytest.raises(InputError) as error:
        read(str(path))
    assert REMEDY not in str(error.value)


def test_errors_of_any_kind_are_withheld():
    with pytest.raises(InputError, match="^secret: content is not valid: look$"), withheld("secret", "look"):
        raise ZeroDivisionError(SECRET)
    with pytest.raises(InputError, match="^secret: content is not valid: look$"), withheld("secret", "look"):
        raise InputError(SECRET, SECRET, SECRET, SECRET)
    with pytest.raises(InputError, match="^where: field is value: remedy$"), withheld("secret", "look"), quoted():
        raise InputError("where", "field", "value", "remedy")


@pytest.fixture
def confined(tmp_path):
    for name in ("scene", "root", "out", "away"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "file.exr").write_text("")
    confine([tmp_path / "scene", tmp_path / "root"], [tmp_path / "out"])
    yield tmp_path
    release()


def test_confined_work_reads_only_below_its_folders(confined):
    for path in ("scene/file.exr", "root/file.exr", "scene/../root/file.exr"):
        check_input(confined / path, "picture", "")
    (confined / "scene" / "link.exr").symlink_to(confined / "away" / "file.exr")
    (confined / "scene" / "folder").symlink_to(confined / "away")
    for path in ("away/file.exr", "scene/../away/file.exr", "scene/link.exr", "scene/folder/file.exr",
                 "scene/folder/missing.exr", "out/file.exr", "scene-too/file.exr"):
        with refused(InputError, field="file", value="outside the scene's folder and --root"):
            check_named(confined / path, "picture", "scene.blend")


def test_confined_work_writes_only_below_its_output(confined):
    with atomic_path(confined / "out" / "new" / "picture.exr") as path:
        path.write_text("")
    (confined / "out" / "link.exr").symlink_to(confined / "away" / "new.exr")
    (confined / "out" / "folder").symlink_to(confined / "away")
    for path in ("away/new.exr", "scene/new.exr", "out/../away/new.exr", "out/link.exr", "out/folder/new.exr"):
        with pytest.raises(InputError, match="file is outside --output: --untrusted writes files below --output only"):
            with atomic_path(confined / path):
                raise AssertionError(path)
    assert sorted(path.name for path in (confined / "away").iterdir()) == ["file.exr"]


