"""Processor seconds of casting a drawn scene in layers of depth, and the evenness of a lamp's disc.

    python benchmarks/casting_figures.py

prints, for each accuracy of the tiers: the processor seconds for 1920 x 1080 px at 12 wavelengths in 8 layers, blurred
by up to 60 px before the focus and 20 px behind it, without the trace of the lens's rays; and the deviation of light
inside the disc of a lamp of 3 px, blurred over 26 px by a lens without aberrations, relative to its mean. Set
LENSFIELD_KERNELS=avx2 to compare machines.
"""

import resource

import numpy as np
from scipy.ndimage import gaussian_filter, uniform_filter

from lensfield.engine import Options, Rings, load_lens
from lensfield.engine.depth.cast import cast
from lensfield.engine.depth.depth_range import blur_per_nearness_px
from lensfield.engine.field.radial.first_order import first_order_rays
from lensfield.engine.image.layers import Layer, LayeredRadiance
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.lens.entrance_pupil import focus_nearness
from lensfield.engine.library.rays import lens_rays
from lensfield.engine.plan.options import TIER_ACCURACY

LENS, FOCUS = "nikkor-58mm-f1.4", Rings(2000.0)
FRAME_PX, OVERSCAN_PX, WAVELENGTHS, FILM_MM = (1080, 1920), (40, 40), 12, 36.0
BLURS_PX = 60.0, 30.0, 15.0, 6.0, 0.5, -4.0, -10.0, -20.0  # of the layers, positive nearer than the focus
OBJECTS, OBJECT_PX, NOISE = 24, (20, 160), 0.1
LAMPS, LAMP_LIGHT = 40, 500.0
DISC_BLUR_PX, DISC_PLACE_PX = 26.0, (300, 700)


def depth_mm(lens, grid, blur_px):
    """The depth whose points blur to this diameter."""
    return 1 / (focus_nearness(lens) + blur_px / blur_per_nearness_px(lens, grid.pitch_um))


def scene(lens, grid):
    """Boxes of noisy texture in front of each other, and lamps in the farthest layer."""
    rng, shape = np.random.default_rng(1), grid.shape_px
    spectra = 0.5 + rng.random((len(BLURS_PX), WAVELENGTHS))
    layers = []
    for blur_px, spectrum in zip(BLURS_PX, spectra, strict=True):
        alpha = np.zeros(shape, np.float32)
        if blur_px == BLURS_PX[-1]:
            alpha[:] = 1
        for top, left, tall, wide in zip(*(rng.integers(0, n, OBJECTS) for n in shape),
                                         *rng.integers(*OBJECT_PX, (2, OBJECTS)), strict=True):
            alpha[top:top + tall, left:left + wide] = 1
        alpha = uniform_filter(alpha, 2)
        texture = 1 + gaussian_filter(rng.standard_normal(shape), 2) + NOISE * rng.standard_normal(shape)
        light = np.maximum(texture, 0).astype(np.float32)
        if blur_px == BLURS_PX[-1]:
            light[tuple(rng.integers(0, n, LAMPS) for n in shape)] = LAMP_LIGHT
        layers.append(Layer(spectrum[:, None, None] * light * alpha, alpha,
                            np.full(shape, depth_mm(lens, grid, blur_px), np.float32)).cropped())
    return tuple(layers)


def lamp(lens, grid):
    """A lamp of 3 px in front of darkness."""
    alpha = np.zeros(grid.shape_px, np.float32)
    alpha[tuple(slice(at, at + 3) for at in DISC_PLACE_PX)] = 1
    return (Layer(alpha[None], alpha, np.full(alpha.shape, depth_mm(lens, grid, DISC_BLUR_PX), np.float32)),)


def cast_all(layers, lens, grid, options, rays):
    """The planes of a capture, and processor seconds."""
    wavelengths_nm = np.linspace(440, 660, len(layers[0].cube))
    before = resource.getrusage(resource.RUSAGE_SELF)
    planes = [plane.blurred for plane in cast(
        LayeredRadiance(layers, wavelengths_nm, grid, lens.capture_focal_length_mm), lens, lambda: rays,
        most_rays=options.most_rays, most_of_lamps=options.most_of_lamps)]
    after = resource.getrusage(resource.RUSAGE_SELF)
    return planes, sum(getattr(after, part) - getattr(before, part) for part in ("ru_utime", "ru_stime"))


def unevenness(picture):
    """Standard deviation inside a disc, relative to the mean."""
    places = np.indices(picture.shape)
    middle = [(picture * place).sum() / picture.sum() for place in places]
    away_px = np.hypot(*(place - at for place, at in zip(places, middle, strict=True)))
    inside = picture[away_px < DISC_BLUR_PX / 2 - 5]
    return inside.std() / inside.mean()


def main():
    lens = load_lens(LENS, FOCUS, quality="preview")
    rays, pitch_um = lens_rays(lens), 1e3 * FILM_MM / FRAME_PX[1]
    grid = PixelGrid.around_frame(FRAME_PX, pitch_um, OVERSCAN_PX)
    layers, disc = scene(lens, grid), lamp(lens, grid)
    for tier, accuracy in TIER_ACCURACY.items():
        options = Options(accuracy=accuracy)
        (picture,), _ = cast_all(disc, lens, grid, options, first_order_rays(lens))
        _, seconds = cast_all(layers, lens, grid, options, rays)
        print(f"{tier}: {seconds:.1f} processor s; inside the disc of a lamp, deviation of {unevenness(picture):.3f}",
              flush=True)


if __name__ == "__main__":
    main()
