"""Discs of a distant point: raw pictures of rays traced one by one, and the cat's eyes of a lens's rims."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flat_pictures import mounted, write_flat
from lensfield.engine import ImageError, LensError
from lensfield.engine.fitting.cat_eyes import compare_points, disc_widths
from lensfield.engine.fitting.even_light import EvenField
from lensfield.engine.fitting.points import Widths, read_point
from lensfield.engine.fitting.rims import with_rims
from lensfield.engine.library import prescription_of
from point_pictures import point_light, point_rays, true_widths_mm
from refusals import refused
from seed import SEED

HELIOS, SENSOR_MM, BACKGROUND = prescription_of("helios-44-2-58mm"), (36.0, 24.0), 0.02


@pytest.fixture(scope="module")
def narrow():
    """The lens with narrower rims than in the library."""
    fields = [EvenField(HELIOS, focus_mm, np.array([0.0, 10.0, 21.6])) for focus_mm in (np.inf, 526.0)]
    return with_rims(HELIOS, fields, {2: 12.6, 10: 10.3})


@pytest.fixture(scope="module")
def rays(narrow):
    return point_rays(narrow, 2.0, 13.0)


def read(path, **given):
    return read_point(path, SENSOR_MM, 58.6, **given)


def write(path, places_mm, turn_deg=-70.0, f_number=2.0, shape_px=(480, 720), **given):
    light = point_light(places_mm, turn_deg, SENSOR_MM, shape_px, BACKGROUND)
    write_flat(path, light, mounted(58.0, f_number), **given)


@pytest.mark.parametrize("angle_deg, turn_deg, f_number, filters, level", [
    (13, -70, 2.0, ("RG", "GB"), 0.7), (13, 130, 2.0, ("RG", "GB"), 0.1), (9, 160, 2.8, ("RG", "GB"), 0.7),
    (12, 100, 2.0, ("G",), 0.7), (11, -40, 2.0, (), 0.7)])
def test_a_disc_has_the_widths_of_its_rays(tmp_path, narrow, angle_deg, turn_deg, f_number, filters, level):
    places_mm = point_rays(narrow, f_number, angle_deg)
    write(tmp_path / "point.dng", places_mm, turn_deg, f_number, level=level, filters=filters, seed=SEED)
    disc, (height_mm, radial_mm, tangential_mm) = read(tmp_path / "point.dng"), true_widths_mm(places_mm)
    truth, pixel_mm = Widths(radial_mm, tangential_mm), SENSOR_MM[0] / 720
    assert (disc.f_number, disc.is_central) == (f_number, False)
    assert abs(disc.height_mm - height_mm) < pixel_mm / 2
    assert abs(disc.widths.ratio - truth.ratio) < 5 * disc.ratio_sigma < 0.05
    assert abs(disc.widths.area_mm2 / truth.area_mm2 - 1) < 5 * disc.area_sigma < 0.05


@pytest.mark.parametrize("angle_deg, f_number", [(0.5, 2.0), (8, 2.0), (13, 2.0), (17, 2.0), (15, 2.8)])
def test_rims_shape_the_disc_that_rays_traced_one_by_one_have(narrow, angle_deg, f_number):
    height_mm, *widths_mm = true_widths_mm(point_rays(narrow, f_number, angle_deg))
    assert disc_widths(narrow, f_number, height_mm) == pytest.approx(widths_mm, rel=2e-3)


def test_a_central_obstruction_is_part_of_the_disc():
    lens = prescription_of("nikkor-reflex-500mm")
    height_mm, *widths_mm = true_widths_mm(point_rays(lens, 6.7, 1.2))
    assert disc_widths(lens, 6.7, height_mm) == pytest.approx(widths_mm, rel=2e-3)


def test_the_stated_error_is_the_one_of_the_pixels(tmp_path, rays):
    """Over turns of the camera, with discs of few pixels and little light."""
    turns_deg, truth = np.linspace(60, 120, 12), Widths(*true_widths_mm(rays)[1:]).ratio
    errors = []
    for number, turn_deg in enumerate(turns_deg):
        write(tmp_path / "point.dng", rays, turn_deg, shape_px=(240, 360), level=0.1, seed=SEED + number)
        disc = read(tmp_path / "point.dng")
        errors.append((disc.widths.ratio - truth) / disc.ratio_sigma)
    assert 0.2 < np.sqrt(np.mean(np.square(errors))) < 1.6


def test_a_lens_with_other_rims_differs(tmp_path, narrow, rays):
    write(tmp_path / "corner.dng", rays, seed=SEED)
    write(tmp_path / "middle.dng", point_rays(narrow, 2.0, 0.5), seed=SEED + 1)
    discs = [read(tmp_path / name) for name in ("corner.dng", "middle.dng")]
    corner, area, middle = compare_points(discs, {"before": HELIOS, "after": narrow})
    assert corner.startswith("corner.dng: f/2, 15.") and "radial by tangential width 0." in corner
    assert area.startswith("corner.dng: area relative to middle.dng 0.")
    assert middle.startswith("middle.dng: f/2, 0.6 mm from the axis: radial by tangential width ")
    for line in corner, area:
        sigma, before, after = figures(line)
        assert abs(after) < 5 * sigma < abs(before), line
    guide = (Path(__file__).parents[3] / "docs/guide/engineer.md").read_text()
    documented = next(line for line in guide.splitlines() if line.startswith("    corner.dng: f/2, 15."))
    assert figures(documented) == pytest.approx(figures(corner), abs=0.01)
    sigma, *differences = figures(middle)
    assert all(abs(each) < 5 * sigma for each in differences)


def figures(line):
    """The standard deviation, and the differences in brackets."""
    measured, *predicted = line.replace(";", ",").split(", ")[-3:]
    return float(measured.split()[-1]), *(float(each.split("(")[1].rstrip(")")) for each in predicted)


@pytest.mark.parametrize("angle_deg, turn_deg, given, field, match", [
    (13, -70, {"level": 4.0}, "exposure", "of the green pixels clipped: expose a stop less"),
    (13, -70, {"level": 0.01}, "exposure", "of saturation at most: expose the disc longer"),
    (13, -70, {"shape_px": (120, 180)}, "disc", "1[4-9] pixels wide: expected at least 20: set the lens to its"),
    (16, -80, {}, "disc", "cut by the border of the picture: turn the camera")])
def test_useless_pictures_are_refused(tmp_path, narrow, angle_deg, turn_deg, given, field, match):
    write(tmp_path / "point.dng", point_rays(narrow, 2.0, angle_deg), turn_deg, **given)
    with refused(ImageError, field=field, where="point.dng", match=match):
        read(tmp_path / "point.dng")


def test_several_lamps_are_refused(tmp_path, rays):
    light = point_light(rays, 70, SENSOR_MM) + 0.9 * point_light(rays, -70, SENSOR_MM)
    write_flat(tmp_path / "point.dng", light, mounted(58.0, 2.0))
    with refused(ImageError, field="discs", where="point.dng", match="another has (89|90|91)% of the light"):
        read(tmp_path / "point.dng")


def test_the_weaker_of_two_lamps_does_not_count(tmp_path, rays):
    light = point_light(rays, -70, SENSOR_MM) + 0.2 * point_light(rays, 110, SENSOR_MM) + BACKGROUND
    write_flat(tmp_path / "point.dng", light, mounted(58.0, 2.0), seed=SEED)
    disc = read(tmp_path / "point.dng")
    assert abs(disc.widths.ratio - Widths(*true_widths_mm(rays)[1:]).ratio) < 5 * disc.ratio_sigma


def test_pictures_of_another_lens_are_refused(tmp_path, rays):
    write(tmp_path / "point.dng", rays)
    disc = read(tmp_path / "point.dng")
    for f_number, end in ((1.4, "f/2"), (90.0, "f/22")):
        with refused(LensError, field="f-number", where=HELIOS.name, value=f"{f_number:g} in the photographs",
                     match=f"the lens has {end}"):
            compare_points([replace(disc, f_number=f_number)], {"this lens": HELIOS})
    with refused(LensError, field="height on the sensor", where=HELIOS.name, match="check the camera's sensor"):
        compare_points([replace(disc, height_mm=400.0)], {"this lens": HELIOS})


def test_a_lens_without_rotational_symmetry_is_refused():
    with pytest.raises(LensError, match="the disc of a point"):
        disc_widths(prescription_of("panavision-21mm-1.3x"), 2.8, 8.0)
