"""The sky: a world that nodes compute, such as one with an HDRI, rendered without the scene's objects.

Stray light needs the hemisphere in front of the camera. The contrast of the complete sphere decides how Cycles samples
the world's light.
"""

import numpy as np

from lensfield.engine import SpectralImage
from lensfield.engine.image.directions import solid_angles_sr
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.image.projection import FISHEYE

from ..job.steps import RenderPass
from ..scene.render_state import guard_render_state, read_again, rendered_layer, rendered_world, show_slab
from ..scene.undo import Journal
from ..scene.units import metres_per_unit
from .light import GatheredLight
from .slabs import BEYOND_ALL_UNITS, LOOK, Slab

SIDE_PX = 512  # 0.35 degrees per pixel: the centre of at least one is in the sun
MAP_PX, SUN_MAP_PX = 512, 2048  # width of the map for a world without bright places, and with these
BRIGHT, SAMPLES = 8.0, 16  # samples of the region around pixels brighter than this many times the mean; others have one


def sky_steps(ready):
    """Steps that render the sky for a scene that is ready for its passes; returns a SpectralImage, an equidistant
    fisheye of the hemisphere.

    Parameters
    ----------
    ready : Ready
    """
    job, plan = ready.job, ready.plan
    grid = _fisheye(job, np.pi, SIDE_PX)
    sky, bright = _gathered(ready, grid), None
    with Journal() as journal:
        _guard(ready, grid, journal)
        for index in range(len(plan.bands)):
            yield from _band_steps(ready, "Sky", sky, grid, index, 1, journal)
            if index == 0 and (region := _bright_region(sky.cube, grid)):
                bright = _gathered(ready, grid, region)
            if bright:
                yield from _band_steps(ready, "Sky", bright, grid, index, SAMPLES, journal)
    cube = sky.radiance()
    if bright:
        cube[(..., *bright.slab.region)] = bright.radiance()
    return SpectralImage(cube, job.wavelengths_nm, grid, focal_mm=job.lens.capture_focal_length_mm)


def is_computed(ready):
    """Whether nodes compute the light of the rendered world."""
    world = rendered_world(ready.scene)
    return world is not None and ready.substitution.emission_at(world, ready.job.wavelengths_nm) is None


def map_steps(ready, journal):
    """Steps that look at the world of a scene that is ready for its passes, and choose the size of its map.

    By this map, Cycles samples a world's light. It is built anew for the wavelengths of each pass, 4096 px wide by
    default. A sun of half a degree needs 2048 px: with fewer, too few samples reach its edges, and pixels sparkle; with
    more, they do not sparkle less. Cycles samples the sun of a Sky Texture apart from its own small map.
    """
    world = rendered_world(ready.scene)
    if not is_computed(ready) or world.cycles.sampling_method != "AUTOMATIC" or uses_light_paths(world.node_tree):
        return
    grid = _fisheye(ready.job, 2 * np.pi, 2 * SIDE_PX)
    light = _gathered(ready, grid)
    with Journal() as of_look:
        _guard(ready, grid, of_look)
        of_look.set(world.cycles_visibility, "camera", True)
        yield from _band_steps(ready, "World", light, grid, 0, 1, of_look)
    bright = _bright_region(light.cube, grid)
    if not (bright and _has_sky(world.node_tree)):
        journal.on_exit(world.update_tag)
        for name, value in (("sampling_method", "MANUAL"), ("sample_map_resolution", SUN_MAP_PX if bright else MAP_PX)):
            journal.set(world.cycles, name, value)
        world.update_tag()


def _has_sky(tree):
    """Whether a node tree, or a group in it, has a Sky Texture."""
    return any(node.bl_idname == "ShaderNodeTexSky" or (
        node.bl_idname == "ShaderNodeGroup" and node.node_tree and _has_sky(node.node_tree)) for node in tree.nodes)


def uses_light_paths(tree):
    """Whether a node tree, or a group in it, depends on the kind of ray: the camera may see another world then."""
    return any(node.bl_idname == "ShaderNodeLightPath" or (
        node.bl_idname == "ShaderNodeGroup" and node.node_tree and uses_light_paths(node.node_tree))
        for node in tree.nodes)


def _fisheye(job, view_rad, side_px):
    """The pixels of an equidistant fisheye with this angle of view: a PixelGrid."""
    focal_mm = job.lens.capture_focal_length_mm
    return PixelGrid((side_px, side_px), view_rad * focal_mm * 1e3 / side_px, projection=FISHEYE, focal_mm=focal_mm)


def _gathered(ready, grid, region=None):
    """A GatheredLight of the world alone, in a region of these pixels or in all."""
    unit_m = metres_per_unit(ready.scene)
    region = region or tuple(slice(0, n) for n in grid.shape_px)
    slab = Slab(*(units * unit_m for units in BEYOND_ALL_UNITS), region, False, False)
    return GatheredLight(ready.plan, rendered_layer(ready.scene).name, ready.group_names, slab, None, unit_m)


def _guard(ready, grid, journal):
    """Make all settings for renders of the world alone. They light nothing, so Cycles need not map its light."""
    scene, world = ready.scene, rendered_world(ready.scene)
    guard_render_state(scene, ready.job, grid, _path(ready), journal)
    for name, value in LOOK.items():
        journal.set(scene.cycles, name, value)
    journal.set(rendered_layer(scene), "samples", 0)  # no override of the scene's samples
    journal.on_exit(world.update_tag)  # a change of this setting alone does not reach Cycles
    journal.set(world.cycles, "sampling_method", "NONE")
    world.update_tag()


def _band_steps(ready, label, light, grid, index, samples, journal):
    """Steps that render a part of the sky at the wavelengths of a pass."""
    scene, plan = ready.scene, ready.plan
    ready.substitution.set_wavelengths(plan.bands[index], plan.dispersive)
    journal.set(scene.cycles, "samples", samples)
    show_slab(scene, light.slab, grid, journal)
    read_again(scene)
    step = RenderPass(scene, f"{label} {index + 1} of {len(plan.bands)}", 0.0, 0.0)
    planes = yield from ready.passes.planes(step, _path(ready), light.planes, "sky", index, *light.slab.facts)
    light.add(index, light.light_of(planes), 1.0)


def _path(ready):
    return ready.path.with_name("sky.exr")


def _bright_region(cube, grid):
    """The rows and columns of a fisheye's cube (wavelength, row, column) around its bright pixels; None without any."""
    picture = cube.mean(axis=0)
    sr = solid_angles_sr(grid, *np.indices(picture.shape))
    places = np.argwhere(picture > BRIGHT * np.average(picture, weights=sr))
    if not len(places):
        return None
    return tuple(slice(max(int(side.min()) - 1, 0), min(int(side.max()) + 2, n))
                 for side, n in zip(places.T, picture.shape, strict=True))
