"""Raw files of a scene, judged by raw converters and by their own noise; and the sample scene's figures on the page."""

import re
from dataclasses import replace

import numpy as np
import pytest

from converters import CONVERTERS, installed
from lensfield.engine import SpectralImage, load_camera, photograph
from lensfield.engine.pictures.develop import developed
from lensfield.engine.pictures.dng import write_dng
from lensfield.engine.spectral.spectra import load_spectrum
from places import ROOT
from raw_pictures import CHART, NM, small_camera
from raw_scene import (
    CAMERAS,
    CHART_LIMIT,
    LIGHTS,
    PICTURE_LIMIT,
    TABLE,
    adobe_warnings,
    chart_figures,
    judged,
    noise_figures,
)

pytestmark = pytest.mark.one_blender

CELL = re.compile(r"\*\*([\d.]+)\*\*<br>([\d.]+) to ([\d.]+)")
PROGRAMS = ["LibRaw", *CONVERTERS]
NOISES = [f"noise of {letter}, {light}" for letter in "RGB" for light in LIGHTS]
PATCH_PX, ROOM_PX = 20, (32, 44)  # pixels of the lens image: a patch, and the room above and to the left of the chart
SHAPE_PX, RAW_PX = (150, 200), (600, 800)  # LibRaw does not develop fewer of X-Trans
PLACE = (np.array([[[0.5, 0.5], [0.5, 5.5]], [[3.5, 0.5], [3.5, 5.5]]]) * PATCH_PX + ROOM_PX) / SHAPE_PX


@pytest.fixture(scope="module")
def scene():
    """The chart under daylight, off-centre, in front of a wall that is brighter to the right."""
    light = load_spectrum("illuminant-d65").at(NM)[:, None, None] * 1e-5
    cube = light * np.tile(np.linspace(0.02, 0.3, SHAPE_PX[1]), (SHAPE_PX[0], 1))
    patches = np.stack([load_spectrum(name).at(NM) for name in CHART]).T.reshape(-1, 4, 6)
    down, right = ROOM_PX
    cube[:, down:down + 4 * PATCH_PX, right:right + 6 * PATCH_PX] = (
        light * patches.repeat(PATCH_PX, 1).repeat(PATCH_PX, 2))
    return SpectralImage(cube, NM, pitch_um=16.0, quantity="irradiance", lens_name="any", f_number_effective=2.8)


@pytest.mark.parametrize("name", ["sony-a7-iv", "fujifilm-x-t4"])
def test_all_judges_accept_the_files_of_a_small_scene(scene, name, tmp_path):
    camera = small_camera(name, load_camera(name).filters, RAW_PX)
    raw, figures = judged(scene, PLACE, camera, tmp_path)
    programs = ["LibRaw", *filter(installed, CONVERTERS)]
    assert raw.resampled == 4 and [figure.name for figure in figures] == [
        *(f"{each}, picture" for each in programs), *(f"{each}, chart" for each in ("developed", *programs)), *NOISES]
    assert not [figure for figure in figures if figure.missed]


def test_other_noise_and_a_mirrored_picture_are_noticed(scene, tmp_path):
    camera = small_camera(shape_px=RAW_PX)
    raw = photograph(scene, camera)
    noisy = replace(camera, prnu=4 * camera.prnu)
    write_dng(raw, tmp_path / "a.dng")
    write_dng(photograph(scene, noisy, serial=1), tmp_path / "b.dng")
    assert any(figure.missed for figure in noise_figures(tmp_path / "a.dng", tmp_path / "b.dng", raw))
    picture = developed(raw)
    upright, mirrored = chart_figures({"upright": picture, "mirrored": picture[:, ::-1]}, scene, PLACE, camera)
    assert mirrored.missed and not upright.missed


def test_adobes_sdk_accepts_the_file_of_a_small_scene(scene, tmp_path):
    pytest.importorskip("dngpy", reason="needs dngpy (pip install dngpy): Adobe's DNG SDK")
    judged(scene, PLACE, small_camera(shape_px=RAW_PX), tmp_path)
    assert adobe_warnings(tmp_path / "a.dng") == ""
    (tmp_path / "b.dng").write_bytes((tmp_path / "a.dng").read_bytes()[:-1000])
    assert adobe_warnings(tmp_path / "b.dng") != ""


def test_the_page_has_the_figures_of_three_cameras_within_their_limits():
    lines = TABLE.search((ROOT / "docs/camera.md").read_text(encoding="utf-8"))[2].splitlines()
    head, _, _, *rows = ([cell.strip() for cell in line.strip("|").split("|")] for line in lines)
    assert head[1:] == [load_camera(name).title for name in CAMERAS]
    limits = ({f"{program}, picture": PICTURE_LIMIT for program in PROGRAMS}
              | {f"{program}, chart": CHART_LIMIT for program in ("developed", *PROGRAMS)})
    assert [row[0] for row in rows] == [*limits, *NOISES]
    for name, *cells in rows:
        for value, low, high in (map(float, CELL.fullmatch(cell).groups()) for cell in cells):
            assert low <= value <= high
            assert (low, high) == (0, limits[name]) if name in limits else 0.95 < low < 1 < high < 1.05
