"""Depth: seconds of casting, lamps out of focus against counted rays, and lamps near focus against diffraction."""

import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from cases import HD
from scipy.ndimage import gaussian_filter, uniform_filter
from scipy.signal import fftconvolve
from scipy.stats import qmc
from timing import least_s, machine, without_cache

from lensfield.engine import Lens, Options, Rings, load_lens, simulate
from lensfield.engine.bake.through_focus import landings_mm, psf_at_depth
from lensfield.engine.depth.cast import cast
from lensfield.engine.depth.depth_range import blur_per_nearness_px, focus_range_px, focus_share
from lensfield.engine.field.field_map import field_map
from lensfield.engine.field.in_capture import from_capture
from lensfield.engine.field.overscan import choose_capture, columns_for_blur
from lensfield.engine.field.radial.first_order import first_order_rays
from lensfield.engine.field.ray_blur import tangents
from lensfield.engine.image.detail import Detail, merged
from lensfield.engine.image.layers import Layer, LayeredRadiance
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.lens.entrance_pupil import focus_nearness
from lensfield.engine.lens.pinhole import fitting_pitch_um
from lensfield.engine.library.rays import lens_rays
from lensfield.engine.plan.options import TIER_ACCURACY
from lensfield.engine.rays.rings import AT_REST

CAST_LENS, FOCUS = "nikkor-58mm-f1.4", Rings(2000.0)
OVERSCAN_PX, WAVELENGTHS, FILM_MM = (40, 40), 12, 36.0
BLURS_PX = 60.0, 30.0, 15.0, 6.0, 0.5, -4.0, -10.0, -20.0  # of the layers, positive nearer than the focus
OBJECTS, OBJECT_PX, NOISE = 24, (20, 160), 0.1
LIT, LAMP_LIGHT = 40, 500.0
DISC_BLUR_PX, DISC_PLACE_PX = 26.0, (300, 700)

BLURRED = ("zeiss-biotar-50mm:1.4@2000:6000", "panavision-21mm-1.3x@2000:3000", "olympus-fisheye-8mm@2000:250")
NM, ACCURACY, PARTS, LAMP_PX = 550.0, 3e-3, 2, 3.0
FIELD, WAYS = (0.0, 0.3, 0.6, 0.85), (0.7, -0.4)  # of the half width, and of the half height for each of these
REACH_PX, BESIDE_PX = 40, 8  # of blur; around a lamp's image
LAMP_RAYS, IN_LAMP = 2**13, 64  # through the stop, and from places of the lamp along each
NEWTON_STEPS, STEP_MM, WITHIN = 6, 1e-3, 0.999  # on the sensor, and share of the field that rays start in
FOUND = 1e-5  # of a tangent: other rays land beyond the field
BLURRED_LEGEND = """\
x, y    where the lamp's light lands
blur    of a point on the axis by the complete stop, in pixels
L1      misplaced light, relative to the lamp's
radius  of the disc, RMS, relative to the rays'"""

NEAR_FOCUS = ("nikkor-z-50mm-f1.8:36:1920:2,2.8,4,5.6,8", "edmund-54852:4.8:3428")
NEAR_MM = 2000.0
BAND_NM, MIDDLE = (530.0, 540.0, 550.0, 560.0, 570.0), 2
WAVES = 0.125, 0.25, 0.5, 1, 2, 4, 8
SHARES = 0.0, 0.6
SIDES_PX = 1, 4
REPEATS = 5
RAYS = 2**15


def casting() -> Iterator[str]:
    """Processor seconds of casting a drawn scene in layers of depth, and the evenness of a lamp's disc.

    For each accuracy of the tiers: the processor seconds for 1920 x 1080 px at 12 wavelengths in 8 layers, blurred by
    up to 60 px before the focus and 20 px behind it, without the trace of the lens's rays; and the deviation of light
    inside the disc of a lamp of 3 px, blurred over 26 px by a lens without aberrations, relative to its mean. Set
    LENSFIELD_KERNELS=avx2 to compare machines.
    """
    lens = load_lens(CAST_LENS, FOCUS, quality="preview")
    rays, pitch_um = lens_rays(lens), 1e3 * FILM_MM / HD[1]
    grid = PixelGrid.around_frame(HD, pitch_um, OVERSCAN_PX)
    layers, disc = scene(lens, grid), lamp(lens, grid)
    for tier, accuracy in TIER_ACCURACY.items():
        options = Options(accuracy=accuracy)
        (picture,), _ = cast_all(disc, lens, grid, options, first_order_rays(lens))
        _, seconds = cast_all(layers, lens, grid, options, rays)
        yield f"{tier}: {seconds:.1f} processor s; inside the disc of a lamp, deviation of {unevenness(picture):.3f}"


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
            light[tuple(rng.integers(0, n, LIT) for n in shape)] = LAMP_LIGHT
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
    begin_s = time.process_time()
    planes = [plane.blurred for plane in cast(
        LayeredRadiance(layers, wavelengths_nm, grid, lens.capture_focal_length_mm), lens, lambda: rays,
        most_rays=options.most_rays, most_of_lamps=options.most_of_lamps, finest_px=options.finest_cell_px)]
    return planes, time.process_time() - begin_s


def unevenness(picture):
    """Standard deviation inside a disc, relative to the mean."""
    places = np.indices(picture.shape)
    middle = [(picture * place).sum() / picture.sum() for place in places]
    away_px = np.hypot(*(place - at for place, at in zip(places, middle, strict=True)))
    inside = picture[away_px < DISC_BLUR_PX / 2 - 5]
    return inside.std() / inside.mean()


def blurred_lamps(cases=BLURRED, *, width: int = 384, lamps=(LAMP_PX,)) -> Iterator[str]:
    """Small lamps out of focus, without and with detail, against counted rays: misplaced light, and radius.

    Square lamps, with sides of `lamps` px, on a black wall are imaged to places on the axis and outwards, off the
    middles of pixels; a case is LENS[:F-NUMBER]@FOCUS_MM:LAMP_MM, and `width` that of the frame on the lens's sensor,
    in pixels. `simulate` takes them as a layer of depth in its capture's pixels, with their even light and with detail
    of 2 x 2 parts. They are compared with rays traced one by one from each lamp through all of the stop, at 550 nm:
    without layers, look-ups and pixels.
    """
    yield BLURRED_LEGEND
    for case in cases:
        yield (f"\n{case}, {width} px\n{'x mm':>7}{'y mm':>7}{'blur':>7}{'lamp':>6}"
               + 2 * f"{'L1':>8}{'radius':>9}")
        lens, depth_mm = case_of(case)
        for side_px in lamps:
            yield from lines(Wall.of(lens, width, depth_mm, side_px))


@dataclass(frozen=True)
class Wall:
    """A lens in front of a wall with lamps: where they are in the pixels of its capture, and about where they land.

    `places` are rows and columns of the capture in columns of the sensor, `landed_mm` x and y: arrays (2, lamp).
    """

    lens: Lens
    frame: PixelGrid
    capture: PixelGrid
    depth_mm: float
    side_px: float
    places: np.ndarray
    landed_mm: np.ndarray

    @classmethod
    def of(cls, lens, width_px, depth_mm, side_px):
        """Lamps in the frame of the lens's sensor, in two directions from the axis."""
        rows = 2 * round(width_px * lens.sensor_mm[1] / lens.sensor_mm[0] / 2)
        frame = PixelGrid((rows, width_px), fitting_pitch_um(lens, (rows, width_px)))
        capture = choose_capture(lens, frame, [NM], REACH_PX)
        half_mm = np.array([width_px, rows]) / 2 * frame.pitch_um * 1e-3
        landed_mm = np.array([[share, way * share] for share in FIELD for way in WAYS[:2 if share else 1]]).T
        landed_mm *= half_mm[:, None]
        lit = capture.index_of(*field_map(lens).at_wavelength(NM).source_mm(*landed_mm, capture))
        jitter = np.random.default_rng(5).random(landed_mm.shape) - 0.5
        return cls(lens, frame, capture, depth_mm, side_px, np.array(lit) + jitter, landed_mm)

    @property
    def blur_px(self):
        """The blur on the axis."""
        from_focus = 1 / self.depth_mm - focus_nearness(self.lens)
        return abs(from_focus) * blur_per_nearness_px(self.lens, self.frame.pitch_um)

    def layered(self, parts):
        """Its LayeredRadiance with a detail of `parts` x `parts`, drawn exactly."""
        columns = columns_for_blur(self.lens)
        down, across = (np.arange(parts * of * n + 1) / (parts * of) - 0.5
                        for n, of in zip(self.capture.shape_px, (1, columns), strict=True))
        light = np.zeros((1, down.size - 1, across.size - 1), np.float32)
        for row, column in self.places.T:
            light[0] += np.outer(lit_share(down, row, self.side_px), lit_share(across, column, self.side_px))
        cube, detail = merged(light, parts), Detail.of(light, [NM], parts) if parts > 1 else None
        shape = cube.shape[1:]
        return LayeredRadiance((Layer(cube, np.ones(shape), np.full(shape, self.depth_mm), detail=detail),), [NM],
                               self.capture.finer_across(columns))

    def tangents(self, rows, columns):
        """Tangents of angles to the right and up at places in the capture: array (2, place)."""
        x_mm, y_mm = from_capture(*self.capture.position_mm(rows, columns), self.lens, self.capture)
        return np.array([x_mm * self.lens.squeeze, y_mm]) / self.lens.capture_focal_length_mm


def lit_share(ends, middle, side):
    """The lit share of pixels between these ends."""
    return np.diff(np.clip(ends, middle - side / 2, middle + side / 2)) / np.diff(ends)


def sources_of(rays, at_mm, stop, depth_mm):
    """The tangents at a depth of points whose light lands at places of the upright picture, and the SensorRays."""
    traced = rays.rays(0, -at_mm, stop)
    return traced.entrance_mm / depth_mm - tangents(traced), traced


def lamp_landings_mm(scene, rays, lamp):
    """Where the light of a lamp lands: x and y, array (2, ray), and the light of each ray.

    Each ray from the lamp's middle is found by Newton's method; those from around it land as its slopes say.
    """
    sample = qmc.Sobol(2, seed=1).random(LAMP_RAYS).T
    stop = np.sqrt(sample[0]) * np.array([np.cos(2 * np.pi * sample[1]), np.sin(2 * np.pi * sample[1])])
    middle = scene.places[:, lamp, None]
    wanted, at_mm = scene.tangents(*middle), np.repeat(scene.landed_mm[:, lamp, None], LAMP_RAYS, axis=1)
    for _ in range(NEWTON_STEPS):
        source, traced = sources_of(rays, at_mm, stop, scene.depth_mm)
        slopes = [(sources_of(rays, at_mm + step, stop, scene.depth_mm)[0] - source) / STEP_MM
                  for step in STEP_MM * np.eye(2)[..., None]]
        per_tangent = np.linalg.inv(np.stack(slopes, axis=1).transpose(2, 0, 1))
        at_mm = rays.inside(at_mm + np.einsum("rij,jr->ir", per_tangent, wanted - source), WITHIN)
    shift, turns = np.random.default_rng(6).random((2, LAMP_RAYS, 1)), qmc.Sobol(2, seed=2).random(IN_LAMP).T[:, None]
    around = middle[..., None] + scene.side_px * ((shift + turns) % 1 - 0.5)
    spread_mm = np.einsum("rij,jrn->irn", per_tangent, scene.tangents(*around) - wanted[..., None])
    lands = (traced.margin > 0) & (np.abs(wanted - source).max(axis=0) < FOUND)
    light = np.where(lands, traced.weight * np.abs(np.linalg.det(per_tangent)), 0)
    return (at_mm[..., None] + spread_mm).reshape(2, -1), np.repeat(light, IN_LAMP)


def counted(scene, rays, lamp):
    """The image of a lamp by its rays: array (row, column) of the frame, of unit sum."""
    places_mm, light = lamp_landings_mm(scene, rays, lamp)
    ends = [np.arange(n + 1) - 0.5 for n in scene.frame.shape_px]
    return np.histogram2d(*scene.frame.index_of(*places_mm), ends, weights=light)[0] / light.sum()


def radius_px(picture):
    """The RMS distance of light from its middle."""
    return np.sqrt(sum(np.average((axis - np.average(axis, weights=picture)) ** 2, weights=picture)
                       for axis in np.indices(picture.shape)))


def compared(picture, true):
    """Misplaced light, and the difference in radius, around the true image of a lamp."""
    around = tuple(slice(max(int(lit.min()) - BESIDE_PX, 0), int(lit.max()) + BESIDE_PX + 1)
                   for lit in np.nonzero(true))
    picture, true = (each[around] / each[around].sum() for each in (picture, true))
    return f"{np.abs(picture - true).sum():8.3f}{radius_px(picture) / radius_px(true) - 1:+9.1%}"


def lines(scene):
    """Yield a line for each lamp."""
    rays = lens_rays(scene.lens).at([NM])
    pictures = [simulate(scene.layered(parts), scene.lens, Options(accuracy=ACCURACY)).cube[0].astype(float)
                for parts in (1, PARTS)]
    for lamp, (x_mm, y_mm) in enumerate(scene.landed_mm.T):
        true = counted(scene, rays, lamp)
        yield (f"{x_mm:7.2f}{y_mm:7.2f}{scene.blur_px:7.2f}{scene.side_px:6.3g}"
               + "".join(compared(picture, true) for picture in pictures))


def case_of(text):
    """Lens and depth of LENS[:F-NUMBER]@FOCUS_MM:LAMP_MM."""
    text, _, depths = text.partition("@")
    (name, _, f_number), (focus_mm, depth_mm) = text.partition(":"), map(float, depths.split(":"))
    return load_lens(name, Rings(focus_mm, float(f_number) if f_number else None), "preview"), depth_mm


def near_focus(cases=NEAR_FOCUS) -> Iterator[str]:
    """Lamps near focus: errors of the in-focus PSF, of rays, and of their blend, against diffraction at their depth.

    A case is LENS:WIDTH_MM:PIXELS[:F,F...], focused at 2 m if f-numbers are given. Lamps are squares of pixels; each
    pixel emits from its centre. L1 is the sum of the absolute differences between the pixels of two pictures, relative
    to the lamp's light: 2 if all light is misplaced. Each row is a depth in front of the plane of focus, in waves of
    defocus: the blur; the share of the in-focus PSF in the blend; L1 of the in-focus PSF, of rays and of the blend, for
    lamps of 1 and of 4 pixels a side in light of 550 nm; and L1 of the blend in a band of 40 nm. Each error is the
    larger of those on the axis and at 60 % of the field. The last lines are the time of a PSF at a depth.
    """
    without_cache()
    yield machine()
    for case in cases:
        name, width_mm, across, *stops = case.split(":")
        pitch_um = 1e3 * float(width_mm) / int(across)
        for stop in stops[0].split(",") if stops else [None]:
            rings = Rings(NEAR_MM, float(stop)) if stop else AT_REST
            yield from near_focus_lines(load_lens(name, rings, "preview"), pitch_um)


def psf_of_rays(rays, nm, height_mm, depth_mm, pitch_um, samples):
    """Geometric PSF: each pixel's fraction of the light through a densely sampled stop."""
    across = qmc.Sobol(2, seed=1).random(RAYS).T
    stop = np.sqrt(across[0]) * np.stack([np.sin(2 * np.pi * across[1]), np.cos(2 * np.pi * across[1])])
    landed_mm, passing = landings_mm(rays, nm, height_mm, depth_mm, stop)
    u_mm, v_mm = landed_mm[:, passing]
    ends_mm = (np.arange(samples + 1) - samples / 2) * pitch_um * 1e-3
    return np.histogram2d(v_mm, u_mm, [ends_mm, ends_mm])[0] / np.count_nonzero(passing)


def psfs(rays, height_mm, depth_mm, focus_mm, pitch_um, samples):
    """PSFs by diffraction, at a depth and in focus, and by rays, over the band: arrays (wavelength, v, u)."""
    arguments = [(rays, nm, height_mm, depth_mm, pitch_um, samples) for nm in BAND_NM]
    return (np.array([psf_at_depth(*each) for each in arguments]),
            np.array([psf_at_depth(rays, nm, height_mm, focus_mm, pitch_um, samples) for nm in BAND_NM]),
            np.array([psf_of_rays(*each) for each in arguments]))


def defocused(lens, pitch_um, waves):
    """Blur in pixels, and the depth in mm, for a number of waves."""
    blur = waves * 8e-3 * BAND_NM[MIDDLE] * lens.f_number_effective / pitch_um
    return blur, 1 / (focus_nearness(lens) + blur / blur_per_nearness_px(lens, pitch_um))


def off(psf, truth, lamp_px):
    return np.abs(fftconvolve(psf - truth, np.full((lamp_px, lamp_px), lamp_px**-2))).sum()


def row(lens, rays, pitch_um, waves):
    (blur, depth_mm), (_, focus_mm) = defocused(lens, pitch_um, waves), defocused(lens, pitch_um, 0)
    samples = 2 * int(blur * (1 + 0.75 / waves) + 16) + 1
    in_focus = float(focus_share(blur, focus_range_px(lens, pitch_um)))
    errors = []
    for share in SHARES:
        truth, focus, by_rays = psfs(rays, share * rays.last_height_mm, depth_mm, focus_mm, pitch_um, samples)
        blend = in_focus * focus + (1 - in_focus) * by_rays
        errors.append([[*(off(each[MIDDLE], truth[MIDDLE], lamp) for each in (focus, by_rays, blend)),
                        off(blend.mean(axis=0), truth.mean(axis=0), lamp)] for lamp in SIDES_PX])
    texts = [" ".join(f"{each:5.2f}" for each in lamp) for lamp in np.max(errors, axis=0)]
    return f"{waves:6.3f} waves {blur:6.2f} px {in_focus:5.2f}   " + "   ".join(texts)


def near_focus_lines(lens, pitch_um):
    rays = lens_rays(lens)
    yield (f"\n{lens.name} at f/{lens.f_number_effective:.2g}, {pitch_um:.3g} um; focus, rays, blend, in the band: "
           + ", ".join(f"{lamp} px" for lamp in SIDES_PX))
    for waves in WAVES:
        yield row(lens, rays, pitch_um, waves)
    for waves in (1, 32):
        yield f"a PSF of 65 x 65 at {waves} waves: {1e3 * seconds(lens, rays, pitch_um, waves):.0f} ms"


def seconds(lens, rays, pitch_um, waves):
    """Processor seconds for one PSF: the minimum of several runs."""
    _, depth_mm = defocused(lens, pitch_um, waves)
    return least_s(lambda: psf_at_depth(rays, BAND_NM[MIDDLE], 0.5 * rays.last_height_mm, depth_mm, pitch_um, 65),
                   REPEATS)[0]
