"""The end of the light on the sensor: lens data reach the corner of the frame, or end in the dark."""

from dataclasses import replace

import numpy as np
import pytest

from counted_light import counted_light
from lenses import tinted
from lensfield.engine import Options, Report, SpectralImage, simulate
from lensfield.engine.field.overscan import choose_capture
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.library import load_lens, prescription_of
from lensfield.engine.prescription.system import system_of
from lensfield.engine.rays.focus import build_system
from lensfield.engine.rays.light_end import WIDEST_RAD, light_end
from lensfield.engine.rays.rays import HalfPupil, trace_pupil
from lensfield.engine.rays.rings import AT_REST, Rings, turned

FISHEYE = "olympus-fisheye-8mm"
SHORT = ("apple-phone-4mm", "canon-55mm-f1.2-aspheric", "edmund-54852", "leica-noctilux-50mm", "nikkor-28mm",
         "nikkor-ultra-micro-29mm", FISHEYE)  # their prescriptions' fields end before the corner
NM, RINGS, FRAME_PX, SHIFT_PX = 550.0, 24, (90, 132), (4.5, -7.0)
MOST = 0.01


def system_of_lens(name, rings=AT_REST):
    return build_system(turned(prescription_of(name), rings).prescription)


def corner_mm(system):
    return np.hypot(*system.prescription.sensor_mm) / 2


def real_mm(system, height_mm):
    return trace_pupil(system, [height_mm], [NM], HalfPupil(1, 1)).chief_height_mm[0, 0]


def white_wall(lens, radiance=3.0):
    """Irradiance over radiance, T excluded, and distances from the axis of the pixels of a frame that is not centred;
    and the report."""
    pitch_um = 2e3 * np.hypot(*lens.sensor_mm) / 2 / np.hypot(*FRAME_PX)
    middle_px = (np.array(FRAME_PX) - 1) / 2
    frame = PixelGrid(FRAME_PX, pitch_um, tuple((middle_px + SHIFT_PX).tolist()))
    capture, report = choose_capture(lens, frame, [NM], 30), Report()
    wall = SpectralImage(np.full((1, *capture.shape_px), radiance), [NM], capture)
    irradiance = simulate(wall, lens, Options(), report=report).cube[0]
    x_mm, y_mm = frame.axes_mm()
    transmittance = lens.at_wavelength(NM).transmittance
    return irradiance / (radiance * transmittance), np.hypot(x_mm, y_mm[:, None]), report.lens_image


@pytest.mark.sample(2)
@pytest.mark.parametrize("name", SHORT)
def test_a_white_wall_is_as_bright_as_counted_rays_up_to_the_corner(name):
    """On rings whose pixels are compared with counted rays on the same rings; a fisheye's last one has the horizon."""
    lens = tinted(load_lens(prescription_of(name), quality="preview", wavelengths_nm=[NM]))
    system = build_system(lens.prescription)
    edges_mm = np.linspace(0, corner_mm(system), RINGS + 1)
    counted, error = counted_light(system, edges_mm, NM)
    light, distance_mm, _ = white_wall(lens)
    ring, middles_mm = np.digitize(distance_mm, edges_mm) - 1, (edges_mm[1:] + edges_mm[:-1]) / 2
    slopes = np.append(np.gradient(counted, middles_mm), np.nan)
    at_middle = light - slopes[ring] * (distance_mm - np.append(middles_mm, np.nan)[ring])
    seen = np.array([at_middle[ring == number].mean() for number in range(RINGS)])
    lit = edges_mm[1:] < (0.99 * lens.real_height_mm[0, -1] if lens.dark_beyond else np.inf)
    np.testing.assert_array_less(np.abs(seen - counted)[lit], MOST * counted[lit] + 5 * error[lit])
    assert lit.sum() >= 0.8 * RINGS
    if lens.dark_beyond:
        black = edges_mm[:-1] > 1.02 * lens.real_height_mm[0, -1]
        assert black.sum() >= 2 and counted[black].max() == 0 and seen[black].max() < 1e-4 * seen[0]


def test_nothing_is_reported_missing_where_the_light_ends():
    lens = load_lens(FISHEYE, quality="preview", wavelengths_nm=[NM])
    light, distance_mm, report = white_wall(lens)
    assert lens.dark_beyond and report.out_of_field_fraction == 0
    assert np.all(light[distance_mm > 11.6] < 1e-4 * light.max())


@pytest.mark.parametrize("name", SHORT)
def test_the_light_is_followed_to_the_corner_of_the_frame(name):
    system = system_of_lens(name)
    end = light_end(system, (450.0, 650.0))
    assert end.height_mm > system.last_height_mm and end.dark == (name == FISHEYE)
    if name == FISHEYE:
        assert np.arctan(end.height_mm / system.efl_mm) == pytest.approx(WIDEST_RAD) and counted_dark(system, end)
    else:
        assert 1 < real_mm(system, end.height_mm) / corner_mm(system) < 1.005


def counted_dark(system, end):
    """Whether rays from in front of the lens end within 0.1 mm of the light."""
    last_mm = real_mm(system, end.height_mm)
    inside, beyond = counted_light(system, last_mm + np.array([-0.1, 0.0, 0.1, 0.4]), NM)[0][[0, 2]]
    return beyond < 1e-3 * inside


def test_a_field_that_reaches_the_corner_stays_as_it_is():
    system = system_of_lens("zeiss-biotar-50mm")
    assert light_end(system, (NM,)) == (system.last_height_mm, False)
    no_frame = system_of(replace(system_of_lens("nikkor-28mm").prescription, sensor_mm=None))
    assert light_end(no_frame, (NM,)) == (no_frame.last_height_mm, False)


def test_a_near_focus_is_followed_to_the_corner():
    """Focused near, a prescription's field in mm may end closer to the axis."""
    system = system_of_lens("edmund-54852", Rings(focus_mm=120.0))
    assert 1 < real_mm(system, light_end(system, (NM,)).height_mm) / corner_mm(system) < 1.005


def test_apertures_end_the_light_before_the_corner():
    """A narrow rear element in front of a large sensor: the end is dark, and rays are counted up to there."""
    design = prescription_of("nikkor-28mm")
    *before, last = design.surfaces
    narrow = replace(design, sensor_mm=(60.0, 45.0), surfaces=(*before, replace(last, semi_aperture_mm=5.0)))
    system = build_system(turned(narrow).prescription)
    end = light_end(system, (NM,))
    end_mm = real_mm(system, end.height_mm)
    assert end.dark and end_mm < 0.95 * corner_mm(system)
    edges_mm = np.array([0.0, 0.1, 0.95, 0.98, 1.02, 1.1]) * end_mm
    light, _ = counted_light(system, edges_mm, NM)
    assert light[2] > 0 and light[-1] < 1e-3 * light[0]
