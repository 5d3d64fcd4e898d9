"""Measure the sharpness of in-focus light, without and with detail: misplaced light of lamps, and the MTF of an edge.

    python benchmarks/sharpness.py [LENS[:F-NUMBER] ...] [--pitches 0.5 1 2] [--parts 2]

The scene is drawn: lamps of 1.6 px at random places, and a slightly slanted edge. A patch of it, halfway to the corner
of a frame, is imaged at 550 nm from a capture in the frame's pixels, with their even light and with detail of
`--parts`. Both are compared with the image in pixels that are 6 times finer, merged. See LEGEND for the columns.
"""

import argparse

import numpy as np

from lensfield.engine import ChannelCache, Options, Rings, SpectralImage, load_lens, simulate
from lensfield.engine.field.field_map import field_map
from lensfield.engine.field.overscan import choose_capture
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.image.supersampling import merge_pixels
from lensfield.engine.lens.pinhole import fitting_pitch_um

LENSES = ("edmund-54852", "nikkor-z-50mm-f1.8:4", "nikkor-z-58mm-noct", "nikkor-z-35mm-f1.2", "olympus-fisheye-8mm",
          "apple-phone-4mm")
FRAME_PX, PATCH_PX, REACH_PX = (512, 768), (54, 66), 12
NM, ACCURACY, FINEST, OVER = 550.0, 3e-3, 6, 6
LAMP_PX, APART_PX, SLANT_RAD = 1.6, 11, np.deg2rad(6.1)
CYCLES_PER_PX = np.arange(1, 11) / 20
LEGEND = f"""\
lamps   misplaced light (L1) of lamps of {LAMP_PX} px
MTF     the largest difference in the edge's MTF, up to the Nyquist frequency
rim     the largest overshoot, or light below zero, of all pictures: relative to the edge's height"""


def patch_grid(lens, frame):
    """A patch halfway to the corner with enough overscan, PixelGrid; and the middle of the patch in its capture."""
    capture = choose_capture(lens, frame, [NM], REACH_PX)
    centre = [(side - 1) / 2 - n / 4 for side, n in zip(PATCH_PX, frame.shape_px, strict=True)]
    grid = PixelGrid(PATCH_PX, frame.pitch_um, tuple(centre), projection=capture.projection)
    x_mm, y_mm = grid.axes_mm()
    place = field_map(lens).at_wavelength(NM).source_mm(x_mm, y_mm[:, None], grid)
    rows, columns = (np.broadcast_to(each, PATCH_PX) for each in grid.index_of(*place))
    moved = max(np.abs(rows - np.arange(PATCH_PX[0])[:, None]).max(), np.abs(columns - np.arange(PATCH_PX[1])).max())
    middle = [each[PATCH_PX[0] // 2, PATCH_PX[1] // 2] for each in (rows, columns)]
    return grid.framed(int(np.ceil(moved)) + REACH_PX), middle


def lamps(grid, times):
    """Lamps in pixels of `times` finer pixels, drawn exactly: array (row, column)."""
    rng = np.random.default_rng(5)
    ends = [np.arange(times * n + 1) / times - 0.5 for n in grid.shape_px]
    picture = np.zeros([times * n for n in grid.shape_px], np.float32)
    for row in np.arange(8, grid.shape_px[0] - 8, APART_PX):
        for column in np.arange(8, grid.shape_px[1] - 8, APART_PX):
            place = np.array([row, column]) + 2 * rng.random(2)
            down, across = (times * np.diff(np.clip(end, at - LAMP_PX / 2, at + LAMP_PX / 2))
                            for end, at in zip(ends, place, strict=True))
            picture += np.outer(down, across).astype(np.float32)
    return picture


def edge(grid, times, middle):
    """An edge through the middle of the patch, in `times` finer pixels: array (row, column)."""
    fine = 24 // times
    rows, columns = ((np.arange(24 * n) + 0.5) / 24 - 0.5 - overscan - at
                     for n, overscan, at in zip(grid.shape_px, grid.overscan_px, middle, strict=True))
    distance = columns * np.cos(SLANT_RAD) + rows[:, None] * np.sin(SLANT_RAD)
    return merge_pixels(np.clip(24 * distance + 0.5, 0, 1), fine).astype(np.float32)


def response(picture):
    """The MTF of a nearly vertical edge at CYCLES_PER_PX, from pixels by their distance to the edge."""
    columns, steps = np.arange(picture.shape[1]), np.diff(picture, axis=1)
    rows = np.arange(len(steps))
    line = np.polyfit(rows, (steps * (columns[1:] - 0.5)).sum(axis=1) / steps.sum(axis=1), 2)
    slope = np.polyval(np.polyder(line), rows)
    distance = (columns - np.polyval(line, rows)[:, None]) / np.hypot(1, slope)[:, None]
    bins = np.round(OVER * distance).astype(int)
    first, bins = bins.min(), bins - bins.min()
    count = np.bincount(bins.ravel())
    profile = np.bincount(bins.ravel(), picture.ravel())[count > 0] / count[count > 0]
    spread = np.diff(profile[np.abs((np.flatnonzero(count) + first) / OVER) < REACH_PX])
    waves = np.exp(-2j * np.pi * np.outer(CYCLES_PER_PX, np.arange(spread.size) / OVER))
    return np.abs(waves @ spread) / spread.sum() / np.sinc(CYCLES_PER_PX / OVER)**2  # of bins and differences


def images(lens, grid, middle, times, finer=False):
    """The lens images of lamps and edge from a capture with `times` parts of each pixel; with `finer`, of such pixels,
    merged."""
    cache = ChannelCache()
    for picture in (lamps(grid, times), edge(grid, times, middle)):
        radiance = SpectralImage(picture[None], [NM], grid.finer(times))
        image = radiance if finer or times == 1 else radiance.coarser(times)
        irradiance = simulate(image, lens, Options(accuracy=ACCURACY), cache=cache).cube[0].astype(float)
        yield merge_pixels(irradiance, times) if finer else irradiance


def figures(lens, frame, parts):
    """A row of cells: for even pixels and for detail."""
    grid, middle = patch_grid(lens, frame)
    true = list(images(lens, grid, middle, FINEST, finer=True))
    cells = ""
    for times in (1, parts):
        lamp, edges = images(lens, grid, middle, times)
        misplaced = np.abs(lamp - true[0]).sum() / true[0].sum()
        error = np.abs(response(edges[6:-6, 6:-6]) - response(true[1][6:-6, 6:-6])).max()
        rim = max(edges.max() - true[1].max(), -edges.min(), -lamp.min()) / true[1].max()
        cells += f"{misplaced:8.3f}{error:8.3f}{max(0.0, rim):8.1%}"
    return cells


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("lenses", nargs="*", default=LENSES, metavar="LENS[:F-NUMBER]")
    parser.add_argument("--pitches", nargs="+", type=float, default=[1.0],
                        help="pixel pitches, relative to {1} x {0} px on the lens's sensor".format(*FRAME_PX))
    parser.add_argument("--parts", type=int, default=2, help="parts of a pixel, down and across, with detail")
    options = parser.parse_args()
    print(LEGEND)
    print(f"{'':<24}{'um/px':>7}" + "".join(f"{name:>24}" for name in ("without detail", f"{options.parts} x "
                                                                       f"{options.parts} parts")))
    print(" " * 31 + 2 * f"{'lamps':>8}{'MTF':>8}{'rim':>8}")
    for name in options.lenses:
        name, _, f_number = name.partition(":")
        lens = load_lens(name, Rings(f_number=float(f_number) if f_number else None), "preview")
        for pitch in options.pitches:
            frame = PixelGrid([round(n / pitch) for n in FRAME_PX], pitch * fitting_pitch_um(lens, FRAME_PX))
            print(f"{name:<24}{frame.pitch_um:7.2f}{figures(lens, frame, options.parts)}", flush=True)


if __name__ == "__main__":
    main()
