"""The checks of `lensfield compare` that need neither Blender nor a file, and the options that commands share."""

from argparse import ArgumentParser

import pytest

from lensfield.cli import main
from lensfield.commands import compare, dataset, lint, preview, render
from lensfield.commands.compare import _lenses
from lensfield.commands.prescription_file import NAMES

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


OF_FARMS = {"--scheduler", "--frames-per-task", "--blender"}
OF_FRAMES = {"--frames", "--overwrite", "--any-build", "--wait", *OF_FARMS}
OF_FOLLOWERS = {"--picture", "--scene-state", "--scene-source", "--view-settings", "--progress", "--end-with-stdin",
                "--blend-folder", "--session"}
OF_CAMERA = {"--camera", "--iso", "--shutter", *(f"--{no}{each}" for no in ("", "no-")
                                                 for each in ("noise", "develop", "dng"))}
OF_READING = {f"--{name.replace('_', '-')}" for name in NAMES}


@pytest.mark.parametrize("command, lacking", [
    (compare, OF_FRAMES | OF_CAMERA | OF_READING | {"--view", "--truth"}),
    (dataset, OF_FARMS | OF_READING | {"--view", "--report"}), (preview, OF_FRAMES | OF_FOLLOWERS),
    (lint, OF_FRAMES | OF_FOLLOWERS)])
def test_commands_take_the_options_of_renders(command, lacking):
    """As the guide for scripts promises."""
    def options(module):
        parser = ArgumentParser()
        module.add_options(parser)
        return set(parser._option_string_actions)

    assert options(render) - options(command) <= lacking


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
