"""Renders on a full disk: the error names the file and the system's reason, and no files remain."""

import shutil
import sys
import tempfile
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from full_disk import room_for
from lensfield.addon.capture import finished_passes, light
from lensfield.addon.render.preflight import preflight
from lensfield.addon.render.render import render_through_lens
from lensfield.addon.render.session import write_session
from lensfield.addon.scene.camera import frame_px
from lensfield.addon.scene.denoise import denoised
from lensfield.engine import InputError
from lensfield.engine.runtime.child import Child
from refusals import refused
from small_scenes import set_world
from snapshot import differences, snapshot
from waiting import LAST_RESORT_S


@pytest.fixture
def work(tmp_path, monkeypatch):
    """The folder of temporary files."""
    folder = tmp_path / "work"
    folder.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(folder))
    return folder


def render(scene, tmp_path, **options):
    return render_through_lens(scene, lens="edmund-54852", wavelengths_nm=[450, 550, 650],
                               output_folder=tmp_path / "out", **options)


@pytest.mark.parametrize("depth", ["off", "auto"], ids=["pass", "look at depth"])
@pytest.mark.parametrize("room_bytes", [0, 1_000, 8_000], ids="{} bytes".format)
def test_no_room_for_a_pass_is_reported_with_its_file(scene, tmp_path, work, depth, room_bytes):
    set_world(scene)
    scene.render.image_settings.file_format = "PNG"
    before = snapshot()
    with room_for(room_bytes), refused(InputError, field="render pass", value="incomplete",
                                      match=r"(pass|look)\.exr.*File too large"):
        render(scene, tmp_path, depth=depth)
    assert not differences(before, snapshot())
    assert not list(work.iterdir()) and not list((tmp_path / "out").iterdir())


@pytest.mark.parametrize("region", [False, True], ids=["frame", "render region"])
def test_a_full_disk_is_reported_before_the_first_pass(scene, tmp_path, monkeypatch, region):
    set_world(scene)
    scene.render.use_border, scene.render.border_max_x = region, 0.5
    rows, columns = frame_px(scene)
    least_bytes = 0.1 * 4 * 3 * rows * columns // (1 + region)
    for free_bytes, room in (least_bytes - 1, False), (4 * least_bytes, True):
        monkeypatch.setattr(shutil, "disk_usage", lambda _, free=free_bytes: SimpleNamespace(free=free))
        labels = []
        with nullcontext() if room else pytest.raises(
                InputError, match=r"out: least size of the light is [\d.e-]+ GB: only [\d.e-]+ GB are free there"):
            render(scene, tmp_path, progress=lambda _, label, labels=labels: labels.append(label))
        assert any("Pass" in label for label in labels) == room, labels
        refusals = preflight(scene, output_folder=tmp_path / "out", lens="edmund-54852",
                             wavelengths_nm=[450, 550, 650]).refusals
        assert [refusal.field for refusal in refusals] == ["least size of the light"] * (not room)


def test_no_room_for_the_denoiser_is_reported_with_its_file(scene, work):
    picture, guides = np.ones((3, 24, 32), np.float32), np.ones((6, 24, 32), np.float32)
    with room_for(8_000), refused(InputError, field="file", where="noisy.exr", match="File too large$"):
        denoised(scene, picture, picture[0], guides, work)
    assert not list(work.iterdir())


def test_a_work_folder_that_disappears_is_reported(scene, tmp_path, work, monkeypatch):
    def gone(path, needed):
        shutil.rmtree(path.parent)
        return read(path, needed)

    read = light.read_pass
    monkeypatch.setattr(finished_passes, "read_pass", gone)
    with pytest.raises(InputError, match=r"look\.exr: render pass is incomplete: No such file or directory$"):
        render(scene, tmp_path)
    assert not list(work.iterdir())


def test_no_room_for_a_picture_leaves_no_partial_file(scene, tmp_path, work):
    set_world(scene)
    result = render(scene, tmp_path)
    sizes = {path: path.stat().st_size for path in set(result.files) - {result.record}}
    shutil.rmtree(tmp_path / "out")
    most = max(sizes, key=sizes.get)
    with room_for(sizes[most] - 1):
        with refused(InputError, field="file", where=most.name, match="File too large$"):
            render(scene, tmp_path)
    assert not most.exists() and not list(work.iterdir())
    assert not list((tmp_path / "out").glob(".*"))


def test_messages_of_a_child_arrive_without_room_for_its_log(tmp_path, work):
    code = r"""print("x" * 100_000, flush=True); print('lensfield> {"messages": ["all"]}'); raise SystemExit(3)"""
    with room_for(1_000):
        heard = Child([sys.executable, "-c", code], tmp_path)
        heard._process.wait(LAST_RESORT_S)
        heard.end()
        assert heard.status["messages"] == ["all"]
        why, log = heard.death()
    assert why.startswith("exit status 3: ") and Path(log).stat().st_size == 1_000
    Path(log).unlink()
    with room_for(10):
        assert heard.death()[1] == "lost (File too large)"
    assert not list(Path(tempfile.gettempdir()).iterdir())


def test_no_room_for_the_session_file_is_reported(scene, tmp_path):
    with room_for(100), refused(InputError, field="file", where="session.npz", match="File too large$"):
        write_session(tmp_path / "session.npz")
    assert not list(tmp_path.iterdir())
