"""Halos: highlights receive the light that trimming removes from PSFs, and other light costs nothing extra."""

from dataclasses import replace

import numpy as np
import pytest

from lenses import gaussian_psf, make_lens
from lensfield.engine import ChannelCache, Options, Report, SpectralImage, simulate
from lensfield.engine.blur.halos import HIGHLIGHT, VISIBLE, highlights
from lensfield.engine.field.radial.psf_bank import PsfBank
from lensfield.engine.plan.choose import make_plan
from lensfield.engine.plan.plan import Plan

PITCH_UM = 5.0
HALOED = make_lens([0.994 * gaussian_psf(4, 3 + h, 5.0, 41) + 0.006 * gaussian_psf(28, 25, 5.0, 41)
                    for h in range(5)], heights_mm=np.linspace(0, 0.4, 5), psf_pitch_um=5.0)


def lamp(brightness, centre_px=None, at=(40, 60)):
    """Mid-grey with noise, and four very bright pixels."""
    plane = 0.18 * np.random.default_rng(1).uniform(0.8, 1.2, (80, 111))
    plane[at[0]:at[0] + 2, at[1]:at[1] + 2] = brightness
    return SpectralImage(plane, [550], pitch_um=PITCH_UM, centre_px=centre_px)


@pytest.mark.parametrize("brightest", [1.0, HIGHLIGHT])
def test_light_without_highlights_has_no_halo(brightest):
    light = np.random.default_rng(1).uniform(0.5, 1.0, (4, 64, 96))
    light[2, 10, 20] = brightest
    assert highlights(light, 32, density=1e-4) is None
    assert highlights(np.zeros((1, 8, 8)), 4, density=1.0) is None


@pytest.mark.parametrize("times, visible", [(0.9, False), (1.1, True)])
def test_a_highlight_has_a_halo_where_it_is_visible(times, visible):
    """Its section's mean is that of light of 1: typical light is 1, and the halo is slightly above or below VISIBLE."""
    light, density = np.ones((1, 70, 100)), 1e-4
    light[0, 40, 69] = HIGHLIGHT + times * VISIBLE / density
    if not visible:
        assert highlights(light, 32, density) is None
        return
    bright, sections = highlights(light, 32, density)
    assert sections.tolist() == [[0, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 0]]
    assert np.count_nonzero(bright) == 1 and bright[0, 40, 69] == pytest.approx(times * VISIBLE / density)


@pytest.mark.parametrize("energy, wider", [(0.9, 0.99), (0.5, 0.999), (0.97, 0.97)])
def test_a_trimmed_psf_plus_its_halo_equals_the_wider_psf(energy, wider):
    bank = PsfBank.of(HALOED.at_wavelength(550), PITCH_UM)
    wide = bank.trimmed(wider)
    azimuths = np.linspace(-1, 1, 5)
    halo = bank.halo(energy, wider, wide.radius_px).at_table_heights(azimuths)
    np.testing.assert_allclose(halo.sum(axis=(2, 3)), 0, atol=1e-13)
    together = bank.trimmed(energy, wide.radius_px).at_table_heights(azimuths) + halo
    np.testing.assert_allclose(together, wide.at_table_heights(azimuths), atol=1e-13)


@pytest.mark.sample(2)
@pytest.mark.parametrize("method", ["pixels", "sections"])
@pytest.mark.parametrize("centre_px", [None, (30, 50.5)], ids=["folded", "off centre"])
def test_a_lamp_keeps_its_halo(centre_px, method, monkeypatch):
    image, options = lamp(2000, centre_px), Options(accuracy=0.01, method=method)
    exact = simulate(image, HALOED, Options(method="exact")).cube[0].astype(float)
    report = Report()
    with_halos = simulate(image, HALOED, options, report=report).cube[0]
    monkeypatch.setattr(Plan, "halo_density", 0.0)
    without = simulate(image, HALOED, options).cube[0]
    grey = np.median(exact)
    dim = (exact > 1.05 * grey) & (exact < 3 * grey)  # where the halo shows
    worst = [np.abs(picture - exact)[dim].max() / grey for picture in (with_halos, without)]
    assert worst[0] < 0.1 < 0.5 < worst[1]
    assert with_halos.sum(dtype=float) == pytest.approx(exact.sum(), rel=2e-3)
    plan = report.lens_image.plan
    light = report.lens_image.energy.in_w_per_nm / (PITCH_UM * 1e-6) ** 2
    assert np.abs(with_halos - exact).sum() / light <= plan.error_bound
    assert report.lens_image.energy.out_w_per_nm == pytest.approx(report.lens_image.energy.in_w_per_nm, rel=1e-5)


def test_a_lamp_outside_the_frame_shines_into_it():
    image = lamp(5000, at=(40, 9))
    cropped = replace(image, grid=replace(image.grid, overscan_px=(20, 20)))
    exact = simulate(cropped, HALOED, Options(method="exact")).cube[0]
    result = simulate(cropped, HALOED, Options(accuracy=0.01)).cube[0]
    plan = make_plan(Options(accuracy=0.01), HALOED, cropped.sampling)
    assert plan.psf_radius_px < 20 - 10 < plan.halo_radius_px  # from the lamp to the edge of the frame
    edge, grey = exact[18:24, :2], np.median(exact)
    assert edge.max() > 1.5 * grey
    np.testing.assert_allclose(result[18:24, :2], edge, atol=0.2 * grey)


def test_sharing_a_cache_does_not_change_halos():
    cache, options = ChannelCache(), Options(accuracy=0.01)
    dark, bright = lamp(0.2), lamp(20000)
    frames = [simulate(image, HALOED, options, cache=cache).cube for image in (dark, bright, dark, bright)]
    for image, frame in zip((dark, bright, dark, bright), frames, strict=True):
        np.testing.assert_array_equal(frame, simulate(image, HALOED, options).cube)
