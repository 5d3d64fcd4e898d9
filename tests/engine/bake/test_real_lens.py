"""The paper's lens, traced, against its maker's figures, a second tracer, and a Huygens sum computed by hand."""

from dataclasses import replace

import numpy as np
import pytest

from lensfield.engine.bake.diffraction import point_spread
from lensfield.engine.bake.quality import QUALITIES
from lensfield.engine.bake.wavefront import trace_wavefronts
from lensfield.engine.library import BUNDLED, prescription_of
from lensfield.engine.prescription.readers import read_prescription
from lensfield.engine.rays.focus import build_system, focused
from lensfield.engine.rays.rays import HalfPupil, trace_pupil
from lensfield.engine.rays.rings import turned
from places import DATA

CHIEF_RAYS = DATA / "edmund_chief_rays.csv"


@pytest.fixture(scope="module")
def edmund():
    return build_system(read_prescription(BUNDLED / "prescriptions" / "edmund-54852.toml"))


def test_first_order_figures_match_the_makers(edmund):
    assert edmund.efl_mm == pytest.approx(5.99997, abs=1e-4)
    assert edmund.magnification == pytest.approx(-0.023954, abs=1e-6)
    assert edmund.entrance_pupil_mm == pytest.approx(4.0579476, abs=1e-5)


def test_chief_rays_match_a_second_tracer(edmund):
    """From rayoptics, by rayoptics_witness.py, at wavelengths between the traced ones."""
    rows = np.loadtxt(CHIEF_RAYS, delimiter=",", comments=("#", "p"))
    traced = trace_wavefronts(edmund, rows[:, 0], 1e3 / np.linspace(1 / 0.39, 1 / 0.71, 7), HalfPupil(2, 5))
    chief_mm = traced.at([400.0, 486.1, 587.5618, 656.3, 700.0]).chief_height_mm
    np.testing.assert_allclose(chief_mm.T, rows[:, 1:], atol=1e-5)


def huygens_by_hand(system, height_mm, nm, offsets_mm):
    """|sum over the pupil of exp(i k r)|^2 at positions (v, u) about the chief ray's image point, in double precision.

    Rays are traced on a dense grid of the stop, and the spheres have their true radii: no splines, no plane waves, no
    transform. Only the sphere of integration and the light of each ray are the same as in the engine.
    """
    pupil = HalfPupil(81, 161)
    rays = trace_pupil(system, [height_mm], [nm], pupil)
    position, direction, ray_path, source = (values[..., 0, 0, :, :] for values in (
        rays.position_mm, rays.direction, rays.path_mm, rays.source))
    centre = position[:, :1, :1]
    sphere_mm = np.hypot(system.exit_pupil_distance_mm, centre[1, 0, 0])
    about = np.concatenate([position - centre, np.zeros((1, *pupil.shape))])
    along = np.sum(about * direction, axis=0)
    back = along + np.sqrt(along**2 - np.sum(about**2, axis=0) + sphere_mm**2)
    points, path = about - back * direction, ray_path - back

    def cells(first, second):
        """Areas of the grid's cells, from their corners."""
        (x1, x2), (y1, y2) = [(values[1:, 1:] - values[:-1, :-1], values[1:, :-1] - values[:-1, 1:])
                              for values in (first, second)]
        return np.abs(x1 * y2 - x2 * y1) / 2

    def middles(values):
        return (values[..., 1:, 1:] + values[..., 1:, :-1] + values[..., :-1, 1:] + values[..., :-1, :-1]) / 4

    weight = np.sqrt(cells(points[0], points[1]) * cells(*source))
    points, path = middles(points), middles(path)
    points *= sphere_mm / np.linalg.norm(points, axis=0)  # the middles of chords are slightly inside the sphere
    light = np.zeros((offsets_mm.size, offsets_mm.size))
    for row, v in enumerate(offsets_mm):
        for column, u in enumerate(offsets_mm):
            total = 0
            for side in (1, -1):
                distance = np.sqrt((side * points[0] - u)**2 + (points[1] - v)**2 + points[2]**2)
                total += np.sum(weight * np.exp(2j * np.pi / (nm * 1e-6) * (path + distance)))
            light[row, column] = abs(total) ** 2
    return light


def psf_of(system, height_mm, nm, pitch_um, samples, quality="reference", pupil=None):
    quality = QUALITIES[quality]
    wavefronts = trace_wavefronts(system, [height_mm], [nm], pupil or quality.pupil)
    return point_spread(wavefronts.one(0, 0), pitch_um, samples, quality.sums)


@pytest.mark.sample(1)
@pytest.mark.parametrize("height_mm", [0.0, 1.5, 2.4])
def test_psfs_match_huygens_sum(edmund, height_mm):
    """At 0.25 um, finer than the detail of the light; up to 2.4 mm nothing is clipped.

    The mean over a square is the light at its middle plus a 24th of the second differences.
    """
    psf = psf_of(edmund, height_mm, 550.0, 0.25, 33)
    points = huygens_by_hand(edmund, height_mm, 550.0, 0.25e-3 * (np.arange(35) - 17))
    bends = [np.diff(points, 2, axis=axis) for axis in (0, 1)]
    expected = points[1:-1, 1:-1] + (bends[0][:, 1:-1] + bends[1][1:-1]) / 24
    assert np.abs(psf / psf.sum() - expected / expected.sum()).sum() < 3e-3


@pytest.mark.parametrize("height_mm", [0.0, 2.4, 3.0])
@pytest.mark.parametrize("quality, promised", [("preview", 0.03), ("standard", 0.01)])
def test_each_quality_stays_close_to_the_reference(edmund, quality, promised, height_mm):
    for nm in (420.0, 650.0):
        ours, reference = (psf_of(edmund, height_mm, nm, 1.4, 81, each) for each in (quality, "reference"))
        assert np.abs(ours - reference).sum() < promised


def test_more_rays_change_nothing(edmund):
    for height_mm in (0.0, 3.0):
        few, many = (psf_of(edmund, height_mm, 450.0, 1.0, 65, pupil=HalfPupil(*rays)) for rays in ((31, 45), (61, 89)))
        assert np.abs(few - many).sum() < 2e-3


def test_the_window_of_the_sum_does_not_wrap(edmund):
    """The same image position, in a window twice as wide, whose sum repeats at twice the distance."""
    narrow, wide = (psf_of(edmund, 2.5, 400.0, 1.4, samples) for samples in (65, 131))
    assert np.abs(wide[33:98, 33:98] - narrow).sum() < 2e-3
    assert wide.sum() > narrow.sum()


def test_illumination_is_the_area_of_the_transmitted_bundle(edmund):
    """Counted ray by ray on a dense grid, at 3 mm, where the edge of surface 9 blocks some rays."""
    heights_mm = np.array([0.0, 3.0])
    rays = trace_pupil(edmund, heights_mm, [550.0], HalfPupil(201, 401))
    passing = np.all(rays.square_height_mm2 <= edmund.semi_apertures_mm[:, None, None, None, None]**2, axis=0)
    slopes = [np.gradient(values, axis=axis) for values in rays.direction[:2] for axis in (2, 3)]
    cells = np.abs(slopes[0] * slopes[3] - slopes[1] * slopes[2]) * passing
    cells = (cells[..., 1:, 1:] + cells[..., 1:, :-1] + cells[..., :-1, 1:] + cells[..., :-1, :-1]) / 4
    area = cells.sum(axis=(2, 3))[0]
    assert area[1] / area[0] == pytest.approx(1.038, abs=1e-3)
    for quality in QUALITIES.values():
        ours = trace_wavefronts(edmund, heights_mm, [550.0], quality.pupil).areas(*quality.edges)[0][0]
        assert ours[1] / ours[0] == pytest.approx(area[1] / area[0], abs=1e-3)


@pytest.mark.parametrize("quality", QUALITIES)
def test_lost_rays_do_not_disturb_illumination(quality):
    """Beyond other apertures, rays of this lens miss a surface: up to a third of the pupil, with steep aberrations at
    their edge."""
    system = build_system(turned(prescription_of("nikkor-58mm-f1.4")).prescription)
    wavefronts = trace_wavefronts(system, np.linspace(0, system.last_height_mm, 17), [550.0], QUALITIES[quality].pupil)
    ours, fine = (wavefronts.areas(*edges)[0][0] for edges in (QUALITIES[quality].edges, (300, 400)))
    assert np.any(wavefronts.limits[-1] == 2.0)
    np.testing.assert_allclose(ours, fine, rtol=2e-3)


def test_the_bulk_glass_absorbs_some_blue(edmund):
    blue, green = edmund.glass_transmittance([400.0, 550.0])
    assert 0.9 < blue < green < 1


def test_a_set_of_distances_shares_stop_focus_and_picture(edmund):
    prescription = focused(edmund.prescription)
    near = build_system(replace(prescription, object_distance_mm=100.0))
    assert near.stop_semi_aperture_mm == edmund.stop_semi_aperture_mm
    assert near.last_height_mm == edmund.last_height_mm
    assert near.prescription.surfaces == edmund.prescription.surfaces
