"""Rays of the camera shader against the compiled loops, which trace the same rays from the stop."""

from dataclasses import replace

import numpy as np
import pytest

import cycles_pictures
import truth_scenes
from crooked_lens import CROOKED
from lensfield.addon.scene.traced_camera import shader_text, use_shader
from lensfield.addon.scene.undo import Journal
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.prescription.prescription import Pose
from lensfield.engine.rays.fields import aim_at_places, find_fields, view_of
from lensfield.engine.rays.focus import build_system
from lensfield.engine.rays.from_sensor import lens_from_sensor
from lensfield.engine.rays.trace import trace_both_ways
from mirror_lens import MIRROR_LENS, SURFACES
from small_scenes import material, wall

pytestmark = pytest.mark.one_blender
NM, UNIT_MM = 600.0, 10.0
FILM = PixelGrid((4, 6), 900.0, centre_px=(2.5, 1.7))
AIM_MM = 1e-3  # half of a rectangle's sides
ASIDE = 100.0  # added to places, which are then positive colours
TURNED = replace(CROOKED.surfaces[3], radius_mm=150.0)  # the profile along x
POSED = replace(CROOKED, surfaces=(*CROOKED.surfaces[:3], TURNED, CROOKED.surfaces[4]), focus="paraxial")
CENTRED = replace(POSED, image_pose=None, surfaces=tuple(
    replace(surface, pose=None, odd_aspheric=() if surface.radius_x_mm else (1e-4, 2e-5)) for surface in
    POSED.surfaces))
MIRRORS = replace(MIRROR_LENS, focus="paraxial", surfaces=tuple(
    replace(surface, pose=Pose((0.05, -0.1, 0.0), (0.2, 0.1, 0.0))) if number == 6 else surface
    for number, surface in enumerate(SURFACES)))


def rays_from_the_stop(lens):
    """A ray to the middle of each pixel, through its own point of the stop, by the compiled loops.

    Returns its place on the sensor (2, pixel) and direction there (3, pixel), its position (3, pixel) and direction in
    front of the lens, relative to the camera, whether it passes (pixel,), and its squared places on rectangular
    apertures.
    """
    system = build_system(lens)
    view, right_up_mm = view_of(system), np.stack(np.meshgrid(*FILM.axes_mm())).reshape(2, -1)
    stop_mm = np.random.default_rng(3).uniform(-0.6, 0.6, right_up_mm.shape) * system.stop_semi_aperture_mm
    slope, aimed = aim_at_places(system, view, find_fields(system, view, -right_up_mm, [NM]), -right_up_mm, *stop_mm)
    own = np.arange(right_up_mm.shape[1])
    assert aimed[0, own, own].all()
    traced = trace_both_ways(system.prescription, system.indices_at([NM])[..., None], *stop_mm, *slope[..., own, own])
    entry = view.turned(traced.entry[:, 0] - view.viewpoint_mm[:, None])
    passes = np.all(system.limits(traced.square_mm2[:, 0]) <= 1, axis=0)
    return (traced.position[:2, 0], traced.direction[:, 0], entry, view.turned(traced.before[:, 0]), passes,
            traced.square_mm2[len(lens.surfaces):, 0])


def aimed_along(optics, place_mm, direction):
    """The optics with a cell for each pixel, whose rectangle is tiny and around that pixel's ray."""
    aim, pitch_mm = optics.aim, FILM.pitch_um * 1e-3
    beyond_mm = place_mm - aim.away_mm * direction[:2] / direction[2] - aim.to_pupil[:, None] * place_mm
    place_mm, beyond_mm = (each.reshape(2, *FILM.shape_px)[..., ::-1] for each in (place_mm, beyond_mm))  # x ascends
    return replace(optics, aim=replace(aim, first_mm=place_mm[:, 0, 0] - pitch_mm / 2, cell_mm=np.full(2, pitch_mm),
                                       low_mm=beyond_mm - AIM_MM, high_mm=beyond_mm + AIM_MM))


def places_seen(scene, folder, depth):
    """Where the ray of each pixel meets a wall at this distance, array (2, row, column), and its throughput."""
    lit, shader = material("Places", "ShaderNodeEmission")
    nodes, links = lit.node_tree.nodes, lit.node_tree.links
    geometry, shift = nodes.new("ShaderNodeNewGeometry"), nodes.new("ShaderNodeVectorMath")
    shift.operation = "MULTIPLY_ADD"
    shift.inputs[1].default_value, shift.inputs[2].default_value = (1, 1, 0), (ASIDE, ASIDE, 1)
    links.new(geometry.outputs["Position"], shift.inputs[0])
    links.new(shift.outputs[0], shader.inputs["Color"])
    wall(scene, lit, depth, side_m=1e3)
    rows, columns = FILM.shape_px
    pictures = cycles_pictures.picture(scene, folder, samples=1, columns=columns, rows=rows).astype(float)
    with np.errstate(invalid="ignore"):  # where the picture is black
        return pictures[:2] / pictures[2] - ASIDE, pictures[2]


@pytest.mark.parametrize("depth", [30.0, 200.0])
@pytest.mark.parametrize("lens", [POSED, CENTRED, MIRRORS], ids=["posed", "centred", "mirrors"])
def test_rays_through_every_kind_of_surface_are_those_of_the_compiled_loops(lens, depth, tmp_path):
    place_mm, direction, entry, before, passes, _ = rays_from_the_stop(lens)
    optics = aimed_along(lens_from_sensor(lens, NM, FILM.edges_mm), place_mm, direction)
    scene = truth_scenes.empty_scene()
    use_shader(scene.camera.data, shader_text(optics, FILM, UNIT_MM), Journal())
    found, light = places_seen(scene, tmp_path, depth)
    entry = entry / UNIT_MM
    expected = (entry - (depth + entry[2]) / before[2] * before)[:2].reshape(found.shape)
    lit = passes.reshape(light.shape)
    np.testing.assert_allclose(found[:, lit], expected[:, lit], rtol=0, atol=3 * AIM_MM / optics.aim.away_mm * depth)
    box = (2 * AIM_MM)**2 / optics.aim.away_mm**2 * direction[2].reshape(light.shape)**4
    reflected = np.prod([surface.reflectance for surface in lens.surfaces if surface.mirror])
    np.testing.assert_allclose(light, reflected * lit * box, rtol=5e-3)  # of a small difference, in single precision
    assert lit.sum() > lit.size / 4 and lit.all() == (lens is not MIRRORS)


@pytest.mark.parametrize("number", [1, 2], ids=["toroid", "stop"])
@pytest.mark.parametrize("lens", [POSED, CENTRED], ids=["posed", "centred"])
def test_rays_beyond_a_rectangle_are_black(lens, number, tmp_path):
    def with_rectangle(halves_mm):
        surfaces = list(lens.surfaces)
        surfaces[number] = replace(surfaces[number], half_widths_mm=tuple(halves_mm))
        return replace(lens, surfaces=tuple(surfaces))

    place_mm, direction, _, _, _, squares_mm2 = rays_from_the_stop(with_rectangle((9.0, 9.0)))
    halves_mm = np.quantile(np.sqrt(squares_mm2), 0.7, axis=1)
    optics = aimed_along(lens_from_sensor(with_rectangle(halves_mm), NM, FILM.edges_mm), place_mm, direction)
    scene = truth_scenes.empty_scene()
    use_shader(scene.camera.data, shader_text(optics, FILM, UNIT_MM), Journal())
    _, light = places_seen(scene, tmp_path, 30.0)
    passing = np.all(squares_mm2 < halves_mm[:, None]**2, axis=0)
    assert 4 < passing.sum() < passing.size - 4
    np.testing.assert_array_equal(light.ravel() > 0, passing)
