"""Accuracy as a target: the bound holds for every lens and scene, and is no looser than necessary."""

from itertools import pairwise

import numpy as np
import pytest

from lenses import fine_grid_lens, gaussian_psf, make_lens, turned_coma
from lensfield.engine import InputError, Options, Report, SpectralImage, load_lens, simulate
from lensfield.engine.blur import OnePsf
from lensfield.engine.field.field_map import field_map
from lensfield.engine.field.mirror_symmetry import Planes
from lensfield.engine.field.radial.distortion import FieldGeometry
from lensfield.engine.field.radial.error_bound import AzimuthErrors, azimuth_error
from lensfield.engine.field.radial.psf_bank import PsfBank
from lensfield.engine.field.radial.psf_table import PsfTable, PsfTables
from lensfield.engine.plan import choose
from lensfield.engine.plan.choose import make_plan, priced
from refusals import refused
from varied_lenses import VARIED, varied_lens

PITCH_UM = 20.0
WINDOW = 31


def random_lens(seed, heights=7):
    """PSFs of a few blobs that stretch and move with the field and the wavelength, symmetric or not; distortion."""
    rng = np.random.default_rng(seed)
    offset = np.arange(WINDOW) - WINDOW // 2
    v, u = np.meshgrid(offset, offset, indexing="ij")
    table = np.zeros((2, heights, WINDOW, WINDOW))
    for _ in range(3):
        share, width, stretch, coma, colour = rng.random(5)
        sideways = 3 * rng.random() if seed % 2 else 0
        for wavelength, height in np.ndindex(2, heights):
            field = height / (heights - 1)
            sigma_v, sigma_u = 1 + 3 * width + 3 * stretch * field, 1 + 3 * width + wavelength * colour
            table[wavelength, height] += (0.1 + share) * np.exp(
                -(v - 6 * coma * field) ** 2 / (2 * sigma_v**2) - (u - sideways * field) ** 2 / (2 * sigma_u**2))
    table /= table.sum(axis=(2, 3), keepdims=True)
    strength = rng.uniform(-0.1, 0.05)
    return make_lens(table, lambda nm, p: p + strength * p**3 / 4, lambda nm, p: 1 - 0.1 * p**2,
                     heights_mm=np.linspace(0, 2, heights), psf_pitch_um=rng.choice([4.0, 8.0]))


def noise(rng):
    return rng.random((60, 76))


def points(rng):
    return (rng.random((60, 76)) > 0.98) * rng.random((60, 76))


def bright_range(rng):
    return 10.0 ** rng.uniform(-4, 6, (60, 76))


def edges_and_sky(rng):
    plane = np.full((60, 76), 0.2)
    plane[20:40, 10:50], plane[30:36, 30:34] = 1.0, 1e4
    return plane


SCENES = (noise, points, bright_range, edges_and_sky)


def error_over_light(options, lens, image, exact=None):
    """Sum of |error| over the light of the original picture, and the plan."""
    report = Report()
    result = simulate(image, lens, options, report=report).cube.astype(float)
    exact = simulate(image, lens, Options(method="exact")).cube if exact is None else exact
    light = report.lens_image.energy.in_w_per_nm / (image.pitch_um * 1e-6) ** 2
    return np.abs(result - exact).sum() / light, report.lens_image.plan


@pytest.mark.sample(6)
@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("seed", range(4))
def test_no_scene_exceeds_the_error_bound(seed, scene):
    rng = np.random.default_rng(100 + seed)
    centre = None if seed < 2 else (12.3, 70.8)
    image = SpectralImage(scene(rng)[None], [rng.uniform(400, 700)], pitch_um=PITCH_UM, centre_px=centre)
    lens = random_lens(seed)
    exact = simulate(image, lens, Options(method="exact")).cube
    for accuracy in (0.1, 1e-2, 1e-3):
        error, plan = error_over_light(Options(accuracy=accuracy), lens, image, exact)
        assert error <= plan.error_bound <= accuracy


def test_the_bound_holds_at_every_wavelength():
    lens = random_lens(0)
    nm = np.linspace(400, 700, 6)
    image = SpectralImage(np.random.default_rng(1).random((6, 60, 76)), nm, pitch_um=PITCH_UM)
    error, plan = error_over_light(Options(accuracy=0.01), lens, image)
    assert error <= plan.error_bound <= 0.01


@pytest.mark.parametrize("method", ["sections", "pixels"])
def test_a_method_may_be_combined_with_an_accuracy(method):
    image = SpectralImage(np.random.default_rng(1).random((60, 76)), [550], pitch_um=PITCH_UM)
    error, plan = error_over_light(Options(accuracy=0.01, method=method), random_lens(0), image)
    assert plan.method.name == method and error <= plan.error_bound <= 0.01


def worst_point(plan, lens, radiance, places=3000):
    """The largest ||PSF used - PSF true||_1 in the picture: the share of a point's light that is misplaced."""
    nm, pitch_um = radiance.wavelengths_nm[0], radiance.pitch_um
    planes, steps = Planes(radiance.grid, False), plan.method.azimuths
    tables = PsfTables(lens, [nm], planes, plan.trimmed, steps, np.float64)
    table = PsfTable(tables.at_wavelength(nm))
    bank, field = PsfBank.of(lens.at_wavelength(nm), pitch_um), FieldGeometry(lens.at_wavelength(nm), lens.name)
    rng, (rows, columns) = np.random.default_rng(3), radiance.frame_px
    x_mm, y_mm = (rng.uniform(-n / 2, n / 2, places) * pitch_um * 1e-3 for n in (columns, rows))
    between = (np.arange(3 * steps) + 0.5) * np.pi / 12 / steps
    inside = bank.heights_mm[bank.heights_mm < field.paraxial_height_mm(np.hypot(x_mm, y_mm)).max()]
    heights_mm, azimuths = (part.ravel() for part in np.meshgrid(inside, between))
    where = (np.append(field.paraxial_height_mm(np.hypot(x_mm, y_mm)), heights_mm),
             np.append(np.arctan2(y_mm, x_mm), azimuths))
    rim = bank.radius_px - table.radius_px
    used = np.pad(table.psfs(*where), ((0, 0), (rim, rim), (rim, rim)))
    return float(np.abs(used - bank.psfs(*where)).sum(axis=(1, 2)).max())


@pytest.mark.sample(6)
@pytest.mark.parametrize("accuracy", [0.1, 0.03, 0.01, 1e-3])
@pytest.mark.parametrize("lens, pitch_um", [(load_lens("edmund-54852"), 6.25), (load_lens("edmund-54852"), 12.5),
                                            (random_lens(0), PITCH_UM), (random_lens(1), PITCH_UM)],
                         ids=["edmund", "edmund coarse", "random", "random lopsided"])
def test_the_bound_is_within_twice_the_worst_point(lens, pitch_um, accuracy):
    radiance = SpectralImage(np.zeros((1, int(2400 / pitch_um), int(3600 / pitch_um))), [587.6], pitch_um=pitch_um)
    plan = make_plan(Options(accuracy=accuracy, method="pixels"), lens, radiance.sampling)
    worst = worst_point(plan, lens, radiance)
    assert worst <= plan.error_bound <= accuracy
    if plan.method.azimuths > 2:  # the minimum may be more than necessary
        assert plan.error_bound <= 2 * worst + accuracy / 12  # plus the shares for flat light and rounding


@pytest.mark.parametrize("name", VARIED)
def test_the_bound_is_within_twice_the_worst_point_of_every_bundled_lens(name):
    lens = varied_lens(name)
    radiance = SpectralImage(np.zeros((1, 480, 640)), [550.0], pitch_um=1e3 * lens.heights_mm[-1] / 400)
    plan = make_plan(Options(accuracy=0.03, method="pixels"), lens, radiance.sampling)
    worst = worst_point(plan, lens, radiance, places=200)
    assert worst <= plan.error_bound <= 0.03
    if plan.method.azimuths > 2:  # the minimum may be more than necessary
        assert plan.error_bound <= 2 * worst + 0.03 / 12  # as above


def few_pixels(lens, width_px):
    """A dark picture of the sensor in few pixels, so large that the lens is sharper."""
    rows = round(lens.sensor_mm[1] / lens.sensor_mm[0] * width_px)
    return SpectralImage(np.zeros((1, rows, width_px)), [550.0], pitch_um=1e3 * lens.sensor_mm[0] / width_px)


@pytest.mark.sample(2)
@pytest.mark.parametrize("accuracy", [0.1, 0.01])
@pytest.mark.parametrize("width_px", [32, 64, 128])
@pytest.mark.parametrize("name", ["apple-phone-4mm", "tessar-50mm", "nikkor-28mm"])
def test_the_bound_is_within_twice_the_worst_point_of_psfs_in_a_few_pixels(name, width_px, accuracy):
    """Much of the light that trimming moves stays in its pixel, from a lens that is sharper than the pixels."""
    lens = varied_lens(name)
    radiance = few_pixels(lens, width_px)
    plan = make_plan(Options(accuracy=accuracy, method="pixels"), lens, radiance.sampling)
    worst = worst_point(plan, lens, radiance, places=500)
    assert worst <= plan.error_bound <= min(accuracy, 2 * worst)


def worst_of_one_psf(plan, lens, radiance):
    """The largest ||the middle's PSF - PSF true||_1 of the pixels of a plane, which may be a quadrant."""
    field, planes = field_map(lens).at_wavelength(radiance.wavelengths_nm[0]), plan.planes(radiance.grid)
    used, true = (field.psfs(part, planes) for part in (plan.trimmed, lambda psfs: psfs))
    (psf,) = used.psfs(*(np.array([(n - 1) / 2]) for n in planes.grid.shape_px))
    psfs = true.psfs(*(each.ravel() for each in np.indices(planes.grid.shape_px)))
    return np.abs(psfs - np.pad(psf, (psfs.shape[-1] - len(psf)) // 2)).sum(axis=(1, 2)).max()


@pytest.mark.sample(3)
@pytest.mark.parametrize("width_px", [8, 12, 16, 24, 32, 48])
@pytest.mark.parametrize("name", ["apple-phone-4mm", "tessar-50mm", "nikkor-28mm", "cooke-triplet-50mm", "a grid"])
def test_the_bound_of_one_psf_is_within_twice_the_worst_point(name, width_px):
    """The lens is sharper than the pixels."""
    lens = fine_grid_lens(turned_coma) if name == "a grid" else varied_lens(name)
    radiance = few_pixels(lens, width_px)
    plan = make_plan(Options(accuracy=0.1), lens, radiance.sampling)
    if plan.method.name == OnePsf.name:
        worst = worst_of_one_psf(plan, lens, radiance)
        assert worst <= plan.error_bound <= min(0.1, 2 * worst)


def test_each_height_and_wavelength_is_trimmed_separately():
    """A lens that is sharp except in the corners in violet: elsewhere hardly a pixel remains."""
    table = np.stack([[gaussian_psf(40 if (w, h) == (0, 6) else 5, 5, 10.0, 31) for h in range(7)] for w in range(2)])
    lens = make_lens(table, heights_mm=np.linspace(0, 1, 7), psf_pitch_um=10.0)
    picture = np.zeros((1, 60, 76))
    violet, red = (make_plan(Options(accuracy=0.01), lens, SpectralImage(picture, [nm], pitch_um=PITCH_UM).sampling)
                   for nm in lens.wavelengths_nm)
    assert violet.psf_radius_px > red.psf_radius_px and red.taps < violet.taps < 25 < np.pi * violet.psf_radius_px**2


def worst_between(bank, azimuths):
    """The largest interpolation error at all heights and at eighths of all steps up to 45 degrees, or 90."""
    worst, share = 0.0, np.arange(9)[:, None, None, None] / 8
    for step in range(azimuths if bank.mirror_symmetric else 2 * azimuths):
        psfs = bank.at_table_heights(-(step + np.arange(9) / 8) * np.pi / 4 / azimuths)
        worst = max(worst, np.abs((1 - share) * psfs[:1] + share * psfs[-1:] - psfs).sum(axis=(2, 3)).max())
    return worst


def test_the_error_between_azimuths_falls_with_the_square_of_their_number():
    bank = PsfBank.of(load_lens("edmund-54852").at_wavelength(587.6), 6.25).up_to(3.0)
    errors = [worst_between(bank, azimuths) for azimuths in (8, 16, 32, 64)]  # with fewer, higher orders count
    assert all(after < before / 3.5 for before, after in pairwise(errors))


@pytest.mark.sample(4)
@pytest.mark.parametrize("azimuths", [3, 45])
@pytest.mark.parametrize("name, pitch_um", [("edmund-54852", 3.0), ("edmund-54852", 6.25), ("edmund-54852", 12.0),
                                            ("cooke-triplet-50mm", 94.7), ("tessar-50mm", 46.9),
                                            ("random lopsided", PITCH_UM)])
def test_sampled_azimuths_bound_the_error_at_every_wavelength(name, pitch_um, azimuths):
    lens = random_lens(1) if name == "random lopsided" else varied_lens(name)
    banks = [PsfBank.of(lens.at_wavelength(nm), pitch_um) for nm in lens.wavelengths_nm[::5]]
    estimate = azimuth_error([AzimuthErrors(bank, PsfBank, np.inf) for bank in banks], azimuths)
    worst = max(worst_between(bank, azimuths) for bank in banks)
    assert worst <= estimate <= 1.25 * worst


def test_a_constant_psf_takes_one_convolution():
    lens = make_lens(gaussian_psf(30, 30, 10.0, 25), psf_pitch_um=10.0)
    image = SpectralImage(np.random.default_rng(1).random((60, 76)), [550], pitch_um=PITCH_UM)
    error, plan = error_over_light(Options(accuracy=0.03), lens, image)
    assert (plan.method.name, plan.method.azimuths) == ("one PSF", 0)
    assert error <= plan.error_bound <= 0.03


@pytest.mark.parametrize("accuracy", [0.3, 0.2, 0.1, 0.05])
def test_one_psf_is_chosen_only_where_it_suffices(accuracy):
    """A lens whose blur grows with the field, and points all over the picture: a single PSF is wrong in the corners."""
    heights = np.linspace(0, 2, 7)
    table = np.stack([gaussian_psf(8 + h, 8, 4.0, 31) for h in heights])
    lens = make_lens(np.stack([table, table]), heights_mm=heights, psf_pitch_um=4.0)
    plane = np.zeros((60, 76))
    plane[2::7, 2::7] = 1
    error, plan = error_over_light(Options(accuracy=accuracy), lens, SpectralImage(plane, [550], pitch_um=PITCH_UM))
    assert error <= plan.error_bound <= accuracy


def test_an_extreme_accuracy_uses_the_exact_method():
    image = SpectralImage(np.random.default_rng(1).random((20, 24)), [550], pitch_um=PITCH_UM)
    error, plan = error_over_light(Options(accuracy=1e-9), random_lens(0), image)
    assert plan.method.name == "exact" and error < 1e-7


def test_less_trimming_is_tried_before_the_exact_method(monkeypatch):
    image = SpectralImage(np.random.default_rng(1).random((60, 76)), [550], pitch_um=PITCH_UM)
    wanted = make_plan(Options(accuracy=1e-3), random_lens(0), image.sampling)
    monkeypatch.setattr(choose, "STEP_CHOICES", tuple(range(2, wanted.method.azimuths * 5 // 6)))
    error, plan = error_over_light(Options(accuracy=1e-3), random_lens(0), image)
    assert 0 < plan.method.azimuths < wanted.method.azimuths and plan.psf_energy > wanted.psf_energy
    assert error <= plan.error_bound <= 1e-3


def test_the_default_accuracy_is_one_hundredth():
    image = SpectralImage(np.ones((20, 24)), [550], pitch_um=PITCH_UM)
    plan = make_plan(Options(), random_lens(0), image.sampling)
    assert plan == make_plan(Options(accuracy=0.01), random_lens(0), image.sampling) or plan.error_bound <= 0.01


def test_the_plan_predicts_more_time_for_more_light():
    lens, plans = random_lens(0), []
    for cube, nm in ((np.ones((1, 50, 50)), [550]), (np.ones((1, 500, 500)), [550]),
                     (np.ones((9, 500, 500)), np.linspace(400, 700, 9))):
        image = SpectralImage(cube, nm, pitch_um=PITCH_UM)
        plan = make_plan(Options(), lens, image.sampling)
        plans.append(priced(plan, lens, image.sampling))  # without the time for creating it
    small, large, many = plans
    assert small.seconds < large.seconds < many.seconds and small.memory_mb < large.memory_mb


@pytest.mark.parametrize("accuracy", [0, -1, 2, np.nan, "fine", True])
def test_an_invalid_accuracy_is_named(accuracy):
    with refused(InputError, field="accuracy"):
        Options(accuracy=accuracy)
