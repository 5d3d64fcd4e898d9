"""Options for reading the prescription file of a lens: in every command with a lens, and for no other lens."""

import pytest

from lens_texts import DOT_LENS
from lenses import make_lens
from lensfield.cli import _parser
from lensfield.commands.prescription_file import reading_options
from lensfield.commands.task import task_arguments
from lensfield.engine import ReadingOptions
from lensfield.engine.lens_files.package import write_package
from rgb_files import colours, failure, run

GIVEN = ["--field-angle=14", "--which=2", "--glass=1.5168/64.2=N-BK7", "--glass=SF2=1.65/33.8", "--stop=3",
         "--image-plane=best", "--sensor=12x8", "--semi-diameters=ignore", "--allow-mismatch"]
READ = ReadingOptions(("angle_deg", 14.0), "2", "ignore", ("1.5168/64.2=N-BK7", "SF2=1.65/33.8"), 3, "best",
                      (12.0, 8.0), True)
COMMANDS = ("render S.blend", "lint S.blend", "farm openjd S.blend --job D", "apply R.exr --lens L",
            "filter R.exr --lens L --output E.exr", "tradeoff --lens L --output D", "lens info L", "lens check L",
            "lens plot L", "lens stmap L --resolution 9x9 --output D", "lens bake L -o P.npz",
            "lens convert L -o T.toml", "lens fit L --vignetting V.csv -o T.toml")


@pytest.fixture
def singlet(tmp_path):
    """Its file does not state the end of the field."""
    path = tmp_path / "singlet.lens"
    path.write_text(DOT_LENS)
    return path


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_with_a_lens_takes_them(command):
    assert reading_options(_parser().parse_args([*command.split(), *GIVEN])) == READ
    assert reading_options(_parser().parse_args(command.split())) == ReadingOptions()


def test_farms_pass_them_on():
    parsed = _parser().parse_args(["render", "S.blend", *GIVEN])
    assert reading_options(_parser().parse_args(["render", "S.blend", *task_arguments(parsed)])) == READ


@pytest.mark.parametrize("lens", ["tessar-50mm", "lens.npz"])
def test_other_lenses_have_nothing_to_read(lens, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_package(make_lens(), tmp_path / "lens.npz")
    for option in GIVEN:
        name, _, value = option.partition("=")
        line = failure(capsys, "lens", "info", lens, option)
        assert line.startswith(f"lensfield: {lens}: {name} is {value}") and line.endswith(
            ": applies to prescription files only: leave it out\n")


def test_frames_are_filtered_again_for_another_field(singlet, tmp_path, capsys):
    for frame in (1, 2):
        colours(tmp_path / f"in_{frame}.exr", (0.5, 0.4, 0.3))

    def filtered(*options):
        assert run("filter", tmp_path / "in_#.exr", "--lens", singlet, "--output", tmp_path / "out_#.exr",
                   "--wavelengths", 550, "--lens-quality", "preview", "--f-number", 16, "--iris-blades", 5,
                   *options) == 0
        return capsys.readouterr().out

    assert "finished" not in filtered("--field-height", 12)
    assert "2 of 2 frames are finished" in filtered("--field-height", 12)
    assert "finished" not in filtered("--field-height", 9)
    line = failure(capsys, "filter", tmp_path / "in_#.exr", "--lens", singlet, "--output", tmp_path / "out_#.exr")
    assert f"{singlet}: field is missing" in line


def test_errors_name_the_file(singlet, capsys):
    assert f"{singlet}: field, angle_deg is 95.0" in failure(capsys, "lens", "info", singlet, "--field-angle", 95)
    assert f"{singlet}: --glass is F2=SF2" in failure(capsys, "lens", "info", singlet, "--field-angle", 9, "--glass",
                                                      "F2=SF2")
