"""The checks of `lensfield compare` that need neither Blender nor a file."""

import pytest

from lensfield.cli import main
from lensfield.commands.compare import _lenses

FILE = "Scene_0001_radiance.exr"


def refusal(capsys, *arguments):
    assert main(["compare", *arguments, "--output", "out"]) == 1
    return capsys.readouterr().err


@pytest.mark.parametrize("option, value", [("--samples", "4"), ("--resolution", "64x48"), ("--wavelengths", "450,650"),
                                           ("--scene-name", "Night"), ("--colour-error", "0.5"), ("--room", "0.1")])
def test_an_option_of_renders_is_refused_for_a_radiance_file(tmp_path, monkeypatch, capsys, option, value):
    monkeypatch.chdir(tmp_path)
    assert f"{option} is {value}: leave it out: the file's light is rendered already" in refusal(
        capsys, FILE, "--lens", "tessar-50mm", option, value)
    assert not list(tmp_path.iterdir())


def test_lenses_and_f_numbers_are_lists(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert "--f-number is 2;5.6: expected numbers such as 2,5.6" in refusal(
        capsys, FILE, "--lens", "tessar-50mm", "--f-number", "2;5.6")
    assert "--lens is tessar-50mm,: expected names or files between commas" in refusal(
        capsys, FILE, "--lens", "tessar-50mm,")
    (tmp_path / "a,b.toml").touch()
    assert _lenses("a,b.toml") == ["a,b.toml"] and _lenses("a, b.toml") == ["a", "b.toml"]


def test_an_output_folder_and_a_lens_are_required(capsys):
    assert main(["compare", FILE, "--lens", "tessar-50mm"]) == 2
    assert "--output" in capsys.readouterr().err
    assert main(["compare", FILE, "--output", "out"]) == 2
    assert "--lens" in capsys.readouterr().err
