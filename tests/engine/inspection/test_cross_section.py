"""The cross section of a lens: outlines, and rays that meet the surfaces where they are traced."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import ImageColor

from lensfield.engine.inspection.canvas import Box, Page
from lensfield.engine.inspection.cross_section import (
    GLASS_COLOUR,
    cross_section,
    draw_cross_section,
    section_shapes,
)
from lensfield.engine.library import prescription_of
from lensfield.engine.prescription.prescription import Pose, Prescription, Surface
from lensfield.engine.prescription.surfaces import sag_and_slope
from lensfield.engine.prescription.system import system_of
from lensfield.engine.rays.focus import build_system
from lensfield.engine.rays.rays import HalfPupil, trace_pupil
from lensfield.engine.rays.rings import turned
from lensfield.engine.rays.trace import points_from_image
from mirror_lens import MIRROR_LENS

# flat in front, with a rear hyperboloid of conic -n^2, which focuses axial rays perfectly
HYPERBOLA = Prescription(
    "hyperbola", (Surface(thickness_mm=8.0, glass="1.5/1000", stop=True, semi_aperture_mm=7.0),
                  Surface(-10.0, 20.0, conic=-2.25, semi_aperture_mm=6.0)), ("f_number", 2.0), ("angle_deg", 10.0))


def drawn(prescription):
    """The outlines of the glasses, and the rays, stop and image plane, each an array (2, point) of z and y."""
    shapes = section_shapes(system_of(prescription))
    return outlines(shapes), [shape.points_mm.T for shape in shapes if not shape.fill]


def outlines(shapes):
    return [shape.points_mm.T for shape in shapes if shape.fill]


def test_glass_has_the_shape_of_its_surfaces():
    (outline,), _ = drawn(HYPERBOLA)
    z_mm, y_mm = outline
    assert y_mm.max() == 7.0 and set(z_mm[np.abs(y_mm) == 7.0]) == {0.0}
    sag_mm = 10.0 * (np.sqrt(1 + 1.25 * 0.36) - 1) / -1.25  # of the hyperbola at 6 mm
    np.testing.assert_allclose(z_mm[np.abs(y_mm) == 6.0], 2 * [8 + sag_mm])


def test_rays_come_from_three_fields_and_the_axial_ones_meet_at_the_focus():
    _, lines = drawn(HYPERBOLA)
    fans = [line for line in lines if line.shape[1] == 4]
    slopes = [np.diff(y_mm[:2])[0] / np.diff(z_mm[:2])[0] for z_mm, y_mm in fans]
    np.testing.assert_allclose(slopes, np.repeat(np.tan(np.radians(10)) * np.array([0, 0.7, 1]), 8), atol=1e-9)
    for z_mm, y_mm in fans[:8]:
        assert z_mm[[0, -1]] == pytest.approx([-5.6, 28.0]) and y_mm[-1] == pytest.approx(0, abs=1e-4)
    assert sorted(y_mm[0] for _, y_mm in fans[:8]) == pytest.approx([-5, -10 / 3, -5 / 3, 0, 0, 5 / 3, 10 / 3, 5])


def test_points_of_rays_are_on_the_surfaces_at_the_traced_heights():
    lens = turned(prescription_of("apple-phone-4mm")).prescription
    system, nm = system_of(lens), [lens.reference_wavelength_nm]
    rays = trace_pupil(system, [0.8 * system.last_height_mm], nm, HalfPupil(4, 3))
    start = np.stack([*rays.position_mm, np.zeros_like(rays.position_mm[0])])[:, 0, 0]
    points_mm, _ = points_from_image(lens, system.indices_at(nm)[:, 0], start, rays.direction[:, 0, 0])
    square_mm2 = points_mm[:-1, 0]**2 + points_mm[:-1, 1]**2
    np.testing.assert_allclose(square_mm2, rays.square_height_mm2[:, 0, 0], rtol=0, atol=1e-9)
    vertex_mm = 0.0
    for surface, point, square in zip(lens.surfaces, points_mm, square_mm2, strict=False):  # the last is the image
        np.testing.assert_allclose(point[2], vertex_mm + sag_and_slope(surface, square)[0], atol=1e-9)
        vertex_mm += surface.thickness_mm


def test_blocked_rays_are_left_out():
    open_lens, stopped = (drawn(replace(HYPERBOLA, surfaces=(HYPERBOLA.surfaces[0], replace(
        HYPERBOLA.surfaces[1], semi_aperture_mm=semi_mm))))[1] for semi_mm in (6.0, 2.0))
    assert sum(np.isfinite(line).all() for line in stopped) < sum(np.isfinite(line).all() for line in open_lens)


def test_a_field_that_is_too_large_leaves_the_glass():
    glasses, lines = drawn(replace(HYPERBOLA, field=("angle_deg", 89.0)))
    assert len(glasses) == 1 and all(line.shape[1] == 2 for line in lines)


def test_the_picture_is_square_and_shows_the_lens():
    picture = cross_section(system_of(HYPERBOLA), 200)
    assert picture.shape == (200, 200, 4) and picture.dtype == np.uint8
    assert (picture[..., 3] == 255).all() and 0.02 < np.mean(picture[..., :3].min(axis=-1) < 250) < 0.9


def test_pixels_are_where_the_lens_is():
    """The glass is 7 mm high, and 28 mm before the image; one millimetre is as long along the axis as across it."""
    page = Page(6, 3, 100)
    panel = draw_cross_section(page, Box(1, 0.5, 4, 2), system_of(HYPERBOLA))
    along, across = (side / (axis.high - axis.low) for side, axis in
                     ((panel.box.width, panel.x), (panel.box.height, panel.y)))
    assert along == pytest.approx(across)
    glass = np.all(page.pixels() == ImageColor.getrgb(GLASS_COLOUR), axis=-1)
    (left, _), (_, top), (right, _) = panel.places([0, 0, 8], [0, 7, 0]) * 100
    rows, columns = (np.flatnonzero(glass.any(axis=axis)) for axis in (1, 0))
    assert columns[0] == pytest.approx(left, abs=2) and rows[0] == pytest.approx(300 - top, abs=2)
    assert columns[-1] == pytest.approx(right, abs=2)


def test_displaced_surfaces_and_sensors_are_drawn_where_they_are():
    """By hand: a plane turned about x leans along the light above its vertex; a turned cylinder shows its straight
    section."""
    front = replace(HYPERBOLA.surfaces[0], pose=Pose((0.0, 0.5, 0.25), (5.0, 0.0, 0.0)))
    rear = Surface(-10.0, 20.0, radius_x_mm=np.inf, semi_aperture_mm=6.0, pose=Pose(tilt_deg=(0.0, 0.0, 90.0)))
    lens = replace(HYPERBOLA, surfaces=(front, rear, Surface(30.0, 2.0, "1.5/60"), Surface(-30.0, 15.0)),
                   image_pose=Pose(tilt_deg=(-20.0, 0.0, 0.0)))
    glasses, lines = drawn(lens)
    z_mm, y_mm = glasses[0]
    along_mm = np.array([np.sin(np.radians(5)), np.cos(np.radians(5))])
    assert any(np.allclose((z, y), (0.25, 0.5) + 7.0 * along_mm) for z, y in zip(z_mm, y_mm, strict=True))
    np.testing.assert_allclose(z_mm[np.abs(y_mm) == 6.0], 8.0, atol=1e-12)
    z_mm, y_mm = lines[-1]  # of the image plane
    assert np.ptp(y_mm) > 0 and np.diff(z_mm) == pytest.approx(-np.tan(np.radians(20)) * np.diff(y_mm))


def test_a_cylinder_is_curved_in_one_section_and_a_displaced_surface_is_drawn_displaced():
    moved = Pose(offset_mm=(0.0, 1.5, 0.25))
    cylinder = replace(HYPERBOLA, surfaces=(HYPERBOLA.surfaces[0], replace(
        HYPERBOLA.surfaces[1], radius_mm=np.inf, conic=0.0, radius_x_mm=-10.0, pose=moved)))
    for section, sag_mm, offset_mm in ((1, 0.0, 1.5), (0, -2.0, 0.0)):  # 10 - sqrt(100 - 36) at 6 mm
        shapes = section_shapes(replace(system_of(HYPERBOLA), prescription=cylinder), section)
        z_mm, height_mm = outlines(shapes)[0]
        rear = z_mm > 3
        assert (height_mm[rear].min(), height_mm[rear].max()) == pytest.approx((offset_mm - 6, offset_mm + 6))
        assert z_mm[rear][np.argmax(height_mm[rear])] == pytest.approx(8.25 + sag_mm)


def test_rays_of_both_sections_meet_their_places_on_the_sensor():
    """An f/4 singlet with a stronger section along x; half its sensor is 2 mm wide and 1.5 mm high."""
    surfaces = (Surface(40.0, 4.0, "1.5/1000", radius_x_mm=30.0, stop=True), Surface(-60.0, 40.0))
    lens = build_system(Prescription("two sections", surfaces, ("f_number", 4.0), ("angle_deg", 5.0), sensor_mm=(4, 3),
                                     focus="paraxial"))
    for section, half_mm in ((1, 1.5), (0, 2.0)):
        lines = [shape.points_mm.T for shape in section_shapes(lens, section) if not shape.fill]
        chief_mm = [line[1, -1] for line in lines if line.shape[1] == 4][::8]
        assert chief_mm == pytest.approx([0, 0.7 * half_mm, half_mm], abs=1e-4)
        spread_mm = [np.ptp([line[1, -1] for line in lines[8 * field:8 * field + 8]]) for field in range(3)]
        assert max(spread_mm) > 0.3  # the focus is between those of both sections


def test_a_lens_with_two_sections_has_both_in_its_picture():
    """The section along x, whose image is twice as wide, is in the lower half, at the same scale."""
    anamorphic = replace(HYPERBOLA, surfaces=(replace(HYPERBOLA.surfaces[0], radius_x_mm=80.0), HYPERBOLA.surfaces[1]))
    dark = cross_section(system_of(anamorphic), 300)[..., :3].min(axis=-1) < 250
    upper, lower = dark[:150], dark[150:]
    assert upper.any() and lower.any() and not np.array_equal(upper, lower)


def test_the_folded_path_of_a_mirror_lens():
    """Rays go back from one mirror to the other; glass and mirrors have their holes."""
    system = build_system(MIRROR_LENS)
    glasses, lines = drawn(system.prescription)
    vertices_mm = np.cumsum([0.0, *(surface.thickness_mm for surface in system.prescription.surfaces)])
    rays = [line for line in lines if line.shape[1] == len(vertices_mm) + 1 and np.isfinite(line).all()]
    assert len(rays) >= 10
    for z_mm, _ in rays:
        np.testing.assert_array_equal(np.sign(np.diff(z_mm[1:])), [1, 1, 1, 1, -1, -1, 1, 1, 1])
        assert z_mm[0] < 0 and z_mm[-1] == pytest.approx(vertices_mm[-1])
    least_mm = [np.abs(y_mm).min() for _, y_mm in glasses]
    assert least_mm == pytest.approx([0, 3.2, 3.2, 3.2, 3.2, 0], abs=0.05)  # two passes through the mirror's glass
    bold = [line for line in lines if line.shape[1] == 41]
    assert sorted(np.abs(y_mm).max() for _, y_mm in bold)[:2] == pytest.approx([3.6, 3.6])  # obstruction, and mirror
