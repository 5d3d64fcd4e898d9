"""The checks of `lensfield dataset` that need no Blender."""

import pytest

from lensfield.cli import main
from lensfield.commands.dataset import _formats


@pytest.mark.parametrize("option, value, expected", [
    ("--calibration", "opencv,blender", "--calibration is blender: expected none, or some of opencv, colmap"),
    ("--f-number", "2;8", "--f-number is 2;8: expected numbers such as 2,5.6")])
def test_bad_lists_are_refused(tmp_path, monkeypatch, capsys, option, value, expected):
    monkeypatch.chdir(tmp_path)
    assert main(["dataset", "shot.blend", "--lens", "tessar-50mm", "--output", "out", option, value]) == 1
    assert expected in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_formats_are_a_list():
    assert _formats("opencv, nerfstudio") == ["opencv", "nerfstudio"] and not _formats("none")
