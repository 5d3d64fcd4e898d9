"""The sky: the hemisphere of the world in front of the camera, without the scene's objects, for worlds that nodes
compute, such as those with an HDRI."""

import numpy as np

from ...engine import SpectralImage
from ...engine.image.pixel_grid import PixelGrid
from ...engine.image.projection import FISHEYE
from ..scene.render_state import guard_render_state, read_again, rendered_layer, rendered_world, show_slab
from ..scene.undo import Journal
from ..scene.units import metres_per_unit
from .light import GatheredLight
from .slabs import BEYOND_ALL_UNITS, LOOK, Slab
from .steps import RenderPass

SIDE_PX = 512  # 0.35 degrees per pixel: the centre of at least one is in the sun
BRIGHT, SAMPLES = 8.0, 16  # samples of the region around pixels brighter than this many times the mean; others have one


def sky_steps(ready):
    """Steps that render the sky for a scene that is ready for its passes; returns a SpectralImage, an equidistant
    fisheye of the hemisphere.

    Parameters
    ----------
    ready : Ready
    """
    scene, job, plan = ready.scene, ready.job, ready.plan
    focal_mm, unit_m = job.lens.capture_focal_length_mm, metres_per_unit(scene)
    grid = PixelGrid((SIDE_PX, SIDE_PX), np.pi * focal_mm * 1e3 / SIDE_PX, projection=FISHEYE)
    slab = Slab(*(units * unit_m for units in BEYOND_ALL_UNITS), (slice(0, SIDE_PX), slice(0, SIDE_PX)), False, False)
    sky, bright = _gathered(ready, slab), None
    with Journal() as journal:
        _guard(ready, grid, journal)
        for index, band in enumerate(plan.bands):
            ready.substitution.set_wavelengths(band, plan.dispersive)
            yield from _band_steps(ready, sky, grid, index, 1, journal)
            if index == 0 and (region := _bright_region(sky.cube)):
                bright = _gathered(ready, slab.within(region))
            if bright:
                yield from _band_steps(ready, bright, grid, index, SAMPLES, journal)
    cube = sky.radiance()
    if bright:
        cube[(..., *bright.slab.region)] = bright.radiance()
    return SpectralImage(cube, job.wavelengths_nm, grid, focal_mm=focal_mm)


def _gathered(ready, slab):
    return GatheredLight(ready.plan, rendered_layer(ready.scene).name, ready.group_names, slab, None,
                         metres_per_unit(ready.scene))


def _guard(ready, grid, journal):
    """Make all settings of the sky's renders. As nothing is lit, Cycles needs no map of the world's light."""
    scene, world = ready.scene, rendered_world(ready.scene)
    guard_render_state(scene, ready.job, grid, _path(ready), journal)
    for name, value in LOOK.items():
        journal.set(scene.cycles, name, value)
    journal.set(rendered_layer(scene), "samples", 0)  # no override of the scene's samples
    journal.on_exit(world.update_tag)  # a change of this setting alone does not reach Cycles
    journal.set(world.cycles, "sampling_method", "NONE")
    world.update_tag()


def _band_steps(ready, light, grid, index, samples, journal):
    """Steps that render a part of the sky at the wavelengths of a pass."""
    scene, bands = ready.scene, ready.plan.bands
    journal.set(scene.cycles, "samples", samples)
    show_slab(scene, light.slab, grid, journal)
    read_again(scene)
    step = RenderPass(scene, f"Sky {index + 1} of {len(bands)}", 0.0, 0.0)
    planes = yield from ready.passes.planes(step, _path(ready), light.planes, "sky", index, *light.slab.facts)
    light.add(index, light.light_of(planes))


def _path(ready):
    return ready.path.with_name("sky.exr")


def _bright_region(cube):
    """The rows and columns of a cube (wavelength, row, column) around its bright pixels; None without any."""
    picture = cube.mean(axis=0)
    places = np.argwhere(picture > BRIGHT * picture.mean())
    if not len(places):
        return None
    return tuple(slice(max(int(side.min()) - 1, 0), min(int(side.max()) + 2, n))
                 for side, n in zip(places.T, picture.shape, strict=True))
