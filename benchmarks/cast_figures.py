"""What casting a layered capture along a lens's rays takes: a room in 8 layers, 1080p, 12 wavelengths.

    python benchmarks/cast_figures.py [LENS [MOST_RAYS ...]]

The room is drawn here: a floor from slab to slab, a wall, cards and bars at all depths, far lamps; the lens is focused
at 2 m. Told are the processor's seconds of all cores together, rays a pixel, nanoseconds for each of them and each
wavelength, how many tiles take no rays as all that they meet is in focus, how many layers the others meet, and what
casting needs of memory beside the layers.
"""

import argparse
import time
import tracemalloc

import numpy as np
from timing import machine

from lensfield.engine.depth.cast import cast
from lensfield.engine.depth.meetings import plan_meetings
from lensfield.engine.depth.pencils import pencils
from lensfield.engine.depth.seen import seen
from lensfield.engine.image.layers import Layer, LayeredRadiance
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.kernels import running
from lensfield.engine.library import Rings, load
from lensfield.engine.library.rays import lens_rays

FRAME_PX, OVERSCAN_PX, WAVELENGTHS_NM = (1080, 1920), (90, 160), np.linspace(440, 660, 12)
BORDERS_MM = (0, 900, 1200, 1500, 1900, 2600, 3600, 6000, np.inf)
CARDS = 60


def room(lens):
    """The room, as a pinhole in the lens's entrance pupil sees it slab by slab."""
    rng = np.random.default_rng(1)
    grid = PixelGrid.around_frame(FRAME_PX, lens.sensor_mm[0] * 1e3 / FRAME_PX[1], OVERSCAN_PX)
    x, y = np.meshgrid(*(axis.astype(np.float32) / lens.capture_focal_length_mm for axis in grid.axes_mm()))
    slabs = list(zip(BORDERS_MM, BORDERS_MM[1:], strict=False))
    cubes = [np.zeros((WAVELENGTHS_NM.size, *x.shape), np.float32) for _ in slabs]
    depths = [np.full(x.shape, np.inf, np.float32) for _ in slabs]
    for depth, u, v in _things(x, y, rng):
        scale, spectrum = rng.uniform(0.02, 0.2), rng.random(WAVELENGTHS_NM.size, np.float32)
        light = np.where((np.floor(u * scale) + np.floor(v * scale)) % 2, np.float32(1), np.float32(0.2))
        for (near_mm, far_mm), cube, nearest in zip(slabs, cubes, depths, strict=True):
            first = (depth >= near_mm) & (depth < far_mm) & (depth < nearest)
            nearest[first] = depth[first]
            cube[:, first] = spectrum[:, None] * light[first]
    alphas = [np.isfinite(nearest).astype(np.float32) for nearest in depths]
    cubes[-1] += (1 - alphas[-1]) * (0.05 + 500 * (rng.random(x.shape) > 0.99995)).astype(np.float32)
    alphas[-1][:] = 1
    layers = [Layer(*parts).cropped() for parts in zip(cubes, alphas, depths, strict=True)]
    return LayeredRadiance(layers, WAVELENGTHS_NM, grid, lens.capture_focal_length_mm)


def _things(x, y, rng):
    """Depth, and two coordinates on it, of a floor, a wall, cards and bars; inf beside them."""
    floor_mm = 750 * y.min() / np.minimum(y, -1e-6)
    yield floor_mm, x * floor_mm, floor_mm
    yield np.where(y > y.max() / 2, np.inf, 8000.0), 8000 * x, 8000 * y
    for card in range(CARDS):
        at_mm, across, up = 700 * 8 ** rng.random(), rng.uniform(x.min(), x.max()), rng.uniform(y.min(), y.max())
        wide = (rng.uniform(5, 60) if card % 3 else rng.uniform(0.5, 3)) / at_mm
        inside = (np.abs(x - across) < wide) & (np.abs(y - up) < (wide if card % 3 else 1))
        yield np.where(inside, at_mm * (1 + x - across), np.inf), x * at_mm, y * at_mm


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("lens", nargs="?", default="kodak-petzval-100mm")
    parser.add_argument("most_rays", nargs="*", type=int, default=[256])
    asked = parser.parse_args()
    lens = load(asked.lens, Rings(focus_mm=2000), "preview")
    rays, layered = lens_rays(lens), room(lens)
    print(machine(), f"loops: {running()}; {lens.name}; layers of {layered.nbytes / 1e9:.2f} GB", sep="\n")
    sensor = layered.grid.frame()
    for most_rays in asked.most_rays:
        begun = time.process_time()
        ends = pencils(rays, WAVELENGTHS_NM[[0, -1]], sensor, lens.capture_focal_length_mm, 256)
        layers = [seen(layer, layered.grid, lens, ends) for layer in layered.layers]
        ready = time.process_time()
        meetings = plan_meetings(layers, ends, sensor, 0.0, most_rays, most_rays)
        planned = time.process_time()
        del layers
        tracemalloc.start()
        for _ in cast(layered, lens, rays, most_rays=most_rays):
            pass
        whole, most_bytes = time.process_time() - planned, tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        a_pixel = 8 * meetings.eights.mean()
        print(f"{most_rays} rays: {whole:.1f} s, of which layers {ready - begun:.1f}, tiles {planned - ready:.1f}; "
              f"{a_pixel:.0f} rays a pixel; "
              f"{whole / (a_pixel * np.prod(FRAME_PX) * WAVELENGTHS_NM.size) * 1e9:.1f} ns a ray and wavelength; "
              f"{(meetings.eights == 0).mean():.0%} of tiles need none; layers met: "
              f"{(meetings.found['steps'] >= 0).sum(axis=-1)[meetings.eights > 0].mean():.1f}; "
              f"{most_bytes / 1e9:.2f} GB of memory beside the layers")


if __name__ == "__main__":
    main()
