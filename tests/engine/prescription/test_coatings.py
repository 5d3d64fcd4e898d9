"""Reflectance of coated surfaces, against closed forms and another program's values."""

from dataclasses import replace

import numpy as np
import pytest

from lensfield.engine import LensError
from lensfield.engine.prescription.coatings import BUILT_IN, Coating, MeasuredReflectance, reflectance
from lensfield.engine.prescription.prescription import Prescription, Surface
from lensfield.engine.prescription.readers import read_prescription
from lensfield.engine.prescription.readers.toml import write_prescription
from lensfield.engine.prescription.system import system_of
from lensfield.engine.rays.transmission import coating_transmittance, transmittance

pytestmark = pytest.mark.one_blender
CROWN, NM = 1.5168, np.linspace(400, 700, 7)
QUARTER = Coating("quarter", ((1.38, 550 / (4 * 1.38)),))
STACK = Coating("stack", ((1.38, 97.0), (2.05, 121.0), (1.46, 33.0), (1.7, 70.0)))
SINGLET = Prescription("singlet", (Surface(40.0, 4.0, "1.5168/64.2", stop=True), Surface(-60.0, 0.0)),
                       ("f_number", 8.0), ("angle_deg", 5.0), focus="paraxial")
DOUBLET = replace(SINGLET, surfaces=(SINGLET.surfaces[0], Surface(-40.0, 2.0, "1.7/30"), Surface(-90.0, 0.0)))


def fresnel(low, high, sine):
    """Mean of Fresnel's reflectances of light from the medium of index `low`."""
    cosine, behind = np.sqrt(1 - sine**2), np.sqrt(1 - (low * sine / high)**2)
    s = (low * cosine - high * behind) / (low * cosine + high * behind)
    p = (high * cosine - low * behind) / (high * cosine + low * behind)
    return (s**2 + p**2) / 2


def test_bare_glass_reflects_as_fresnel_says():
    sine = np.sin(np.radians([0, 20, 45, 70, 89]))
    np.testing.assert_allclose(reflectance(BUILT_IN["none"], (1.0, CROWN), 550, sine**2), fresnel(1, CROWN, sine),
                               rtol=1e-12)
    assert reflectance(BUILT_IN["none"], (1.0, CROWN), 550, 0.0) == pytest.approx(0.04216, abs=5e-6)


def test_at_brewsters_angle_only_s_polarised_light_is_reflected():
    sine = np.sin(np.arctan(CROWN))
    assert reflectance(BUILT_IN["none"], (1.0, CROWN), 550, sine**2) == pytest.approx(
        ((CROWN**2 - 1) / (CROWN**2 + 1))**2 / 2, rel=1e-12)


def test_a_quarter_wave_replaces_the_index_of_the_glass():
    """By 1.38^2 / n: 1.26 % of the light on a glass of 1.52, and nothing if the layer's index is its root."""
    effective = 1.38**2 / 1.52
    assert reflectance(QUARTER, (1.0, 1.52), 550, 0.0) == pytest.approx(((1 - effective) / (1 + effective))**2)
    assert reflectance(QUARTER, (1.0, 1.52), 550, 0.0) == pytest.approx(0.0126, abs=5e-5)
    assert reflectance(QUARTER, (1.0, 1.38**2), 550, 0.0) == pytest.approx(0, abs=1e-15)
    assert BUILT_IN["single"].layers == QUARTER.layers


def test_half_waves_do_not_show():
    half = Coating("half", ((2.1, 550 / (2 * 2.1)),))
    assert reflectance(half, (1.0, CROWN), 550, 0.0) == pytest.approx(fresnel(1, CROWN, 0.0), rel=1e-12)


def test_the_minimum_of_a_quarter_wave_moves_to_the_blue_with_the_angle():
    """Its phase is proportional to the cosine in the layer."""
    nm, sine = np.linspace(350, 700, 3501), np.sin(np.radians(50))
    straight, slanted = (nm[reflectance(QUARTER, (1.0, 1.9), nm, square).argmin()] for square in (0.0, sine**2))
    assert straight == pytest.approx(550, abs=0.2)
    assert slanted == pytest.approx(550 * np.sqrt(1 - sine**2 / 1.38**2), abs=0.2)


@pytest.mark.parametrize("sine", [0.0, 0.6, 0.99])
def test_the_light_that_is_not_reflected_gets_through(sine):
    """Energy by fields: the transmitted flux, from the product of matrices, complements the reflectance."""
    admittances = {"s": lambda index, cosine: index * cosine, "p": lambda index, cosine: index / cosine}
    shares = []
    for admittance in admittances.values():
        ends = [admittance(index, np.sqrt(1 - (sine / index)**2)) for index in (1.0, CROWN)]
        matrix = np.eye(2, dtype=complex)
        for index, thickness_nm in STACK.layers:
            cosine = np.sqrt(1 - (sine / index)**2)
            phase, tilted = 2 * np.pi * index * thickness_nm * cosine / 480.0, admittance(index, cosine)
            matrix = matrix @ [[np.cos(phase), 1j * np.sin(phase) / tilted],
                               [1j * tilted * np.sin(phase), np.cos(phase)]]
        electric, magnetic = matrix @ [1, ends[1]]
        shares.append(4 * ends[0] * ends[1] / np.abs(ends[0] * electric + magnetic)**2)
    assert 1 - reflectance(STACK, (1.0, CROWN), 480.0, sine**2) == pytest.approx(np.mean(shares), rel=1e-12)


def test_light_from_both_sides_is_reflected_equally():
    squares = np.linspace(0, 0.99, 9)
    np.testing.assert_array_equal(reflectance(STACK, (1.0, CROWN), 450, squares),
                                  reflectance(STACK, (CROWN, 1.0), 450, squares))


@pytest.mark.parametrize("name", BUILT_IN)
def test_light_beyond_the_critical_angle_is_reflected_completely(name):
    np.testing.assert_array_equal(reflectance(BUILT_IN[name], (CROWN, 1.0), 550, np.array([1.0, 1.7, 2.3])), 1)


def test_evanescent_light_in_a_layer_tunnels():
    """A gap of air between two prisms: Hall's formula for s- and p-polarised light."""
    gap, n, sine = Coating("gap", ((1.0, 200.0),)), 1.5, np.sin(np.radians(50))
    square = (n * sine)**2
    decay, cosine = np.sqrt(square - 1), np.sqrt(1 - sine**2)
    strength = np.sinh(2 * np.pi * 200 * decay / 550)**2
    bends = [(decay**2 + (n * cosine)**2) / (2 * decay * n * cosine),
             (decay**2 * n**4 + (n * cosine)**2) / (2 * decay * n**3 * cosine)]
    expected = np.mean([bend**2 * strength / (1 + bend**2 * strength) for bend in bends])
    assert reflectance(gap, (n, n), 550, square) == pytest.approx(expected, rel=1e-12)


def test_values_of_another_program():
    """tmm 0.2.0 by S. J. Byrnes: the mean of `coh_tmm`'s R for s and p, on glass of 1.62."""
    nm, angles = np.array([400.0, 520.0, 680.0]), np.radians([0.0, 30.0, 60.0])
    expected = [[0.001574698, 0.0038950836, 0.0546810969],
                [0.0215366437, 0.0126333728, 0.0209811621],
                [0.0208103887, 0.0305139679, 0.1003038903]]
    np.testing.assert_allclose(reflectance(STACK, (1.0, 1.62), nm[:, None], np.sin(angles)**2), expected, rtol=1e-7)


def test_a_measured_reflectance_is_interpolated_and_ends_at_its_wavelengths():
    table = Coating("lab", measured=MeasuredReflectance((400.0, 600.0), (0.0, 60.0), ((0.01, 0.05), (0.03, 0.09))))
    squares = np.sin(np.radians([0.0, 30.0, 80.0]))**2
    np.testing.assert_allclose(reflectance(table, (1.0, CROWN), 500.0, squares), [0.02, 0.045, 0.07], rtol=1e-12)
    with pytest.raises(LensError, match="surface 1, coating is lab: not known at 700 nm"):
        system_of(replace(SINGLET, coating="lab", coatings=(table,))).reflectances([500.0, 700.0], [0.0])


@pytest.mark.parametrize("index", [1.46, 1.52, 1.6, 1.7, 1.8, 1.9])
def test_a_multi_coating_reflects_little_in_all_colours_on_every_glass(index):
    lens = replace(SINGLET, coating="multi", surfaces=(
        replace(SINGLET.surfaces[0], glass=f"{index}/50"), SINGLET.surfaces[1]))
    shares = system_of(lens).reflectances(np.linspace(420, 680, 27), [0.0])
    assert shares.max() < 0.0105 and shares.mean() < 0.0035


def test_cemented_surfaces_are_bare_and_unknown_ones_ideal():
    assert DOUBLET.surface_coatings == DOUBLET.coated("ideal").surface_coatings == ("ideal",) * 3
    assert DOUBLET.coated("multi").surface_coatings == ("multi", "none", "multi")
    own = replace(DOUBLET, surfaces=(replace(DOUBLET.surfaces[0], coating="single"), *DOUBLET.surfaces[1:]))
    assert own.surface_coatings == ("single", "ideal", "ideal") and own.coatings_in_air == ("single", "")
    assert own.coated("none") == DOUBLET.coated("none") and own.coated() == DOUBLET
    shares = system_of(DOUBLET.coated("multi")).reflectances([587.5618], [0.0])[:, 0, 0]
    assert shares[1] == pytest.approx((0.1832 / 3.2168)**2, rel=1e-3)


def test_a_stop_in_air_reflects_nothing():
    lens = replace(SINGLET, surfaces=(Surface(thickness_mm=1.0, stop=True),
                                      replace(SINGLET.surfaces[0], stop=False), SINGLET.surfaces[1]))
    assert not system_of(lens.coated("single")).reflectances(NM, [0.0, 0.5])[0].any()


@pytest.mark.parametrize("change, message", [
    (dict(coating="gold"), "coating is gold: expected one of ideal, none, single, multi"),
    (dict(surfaces=(replace(SINGLET.surfaces[0], coating="gold"), SINGLET.surfaces[1])), "surface 1, coating is gold"),
    (dict(coatings=(Coating("multi"),)), "coatings is multi: expected a name of its own"),
    (dict(coatings=(QUARTER, QUARTER)), "coatings is quarter: expected a name of its own")])
def test_unknown_coatings_are_errors(change, message):
    with pytest.raises(LensError, match=f"singlet: {message}"):
        replace(SINGLET, **change)


@pytest.mark.parametrize("given, message", [
    (dict(name=""), "coating without a name, name is empty"),
    (dict(layers=((0.9, 100.0),)), "coating x, layer 1, index is 0.9: expected 1 to 4"),
    (dict(layers=((1.4, 100.0), (1.4, -1.0))), "layer 2, thickness is -1.0: expected 0 to 100000 nm"),
    (dict(measured=MeasuredReflectance((500.0, 400.0), (0.0,), ((0.1,), (0.1,)))), "wavelengths_nm is .*ascending"),
    (dict(measured=MeasuredReflectance((400.0,), (0.0, 91.0), ((0.1, 0.1),))), "angles_deg is 91.0: expected at most"),
    (dict(measured=MeasuredReflectance((400.0,), (0.0,), ((0.1,), (0.1,)))), "reflectance is 2 rows: expected 1 rows"),
    (dict(measured=MeasuredReflectance((400.0,), (0.0,), ((1.1,),))), "reflectance is out of range")])
def test_invalid_coatings_are_errors(given, message):
    with pytest.raises(LensError, match=message):
        Coating(**{"name": "x"} | given)


def test_coatings_return_from_a_file(tmp_path):
    lab = Coating("lab", measured=MeasuredReflectance((400.0, 700.0), (0.0, 45.0), ((0.01, 0.02), (0.03, 0.04))))
    front, back = DOUBLET.coated("multi").surfaces[::2]
    lens = replace(DOUBLET, coating="multi", coatings=(STACK, lab), surfaces=(
        replace(front, coating="stack"), DOUBLET.surfaces[1], replace(back, coating="lab")))
    (tmp_path / "lens.toml").write_text(write_prescription(lens))
    assert read_prescription(tmp_path / "lens.toml") == lens


def test_the_transmittance_of_a_lens_is_the_product_of_its_surfaces():
    """At a high f-number, all rays meet the surfaces almost perpendicularly."""
    lens = replace(DOUBLET, aperture=("f_number", 100.0))
    for name in BUILT_IN:
        system = system_of(lens.coated(name))
        expected = np.prod(1 - system.reflectances(NM, [0.0])[..., 0], axis=0)
        np.testing.assert_allclose(coating_transmittance(system, NM), expected, rtol=1e-4)
    np.testing.assert_array_equal(transmittance(system_of(lens), NM), system_of(lens).glass_transmittance(NM))


def test_rays_near_the_rim_are_reflected_more():
    """Parallel light through a plane front meets the sphere behind it at angles that follow from the height."""
    plane = Prescription("plane", (Surface(np.inf, 1.0, "1.5/60", stop=True), Surface(-20.0, 0.0)), ("f_number", 1.0),
                         ("angle_deg", 5.0), focus="paraxial", coating="none")
    wide, narrow = (coating_transmittance(system_of(replace(plane, aperture=("f_number", number))), [587.5618])[0]
                    for number in (2.0, 50.0))
    system = system_of(replace(plane, aperture=("f_number", 2.0)))
    radii_mm = system.stop_semi_aperture_mm * np.sqrt((np.arange(4000) + 0.5) / 4000)
    inner = radii_mm / 20.0  # sine of the angle in the glass, to the normal of the sphere
    expected = (1 - fresnel(1, 1.5, 0.0)) * np.mean(1 - fresnel(1, 1.5, 1.5 * inner))
    assert wide == pytest.approx(expected, rel=1e-4) and wide < narrow - 1e-4
