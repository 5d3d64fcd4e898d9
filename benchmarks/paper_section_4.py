"""Section 4 of the paper, again: its checkerboard and its multispectral image through its lens.

    python benchmarks/paper_section_4.py FOLDER

writes the pictures of Figures 10 and 11 and prints seconds and errors. Times are given beside those of the exact
operator in the same run, because machines differ; the error is against that operator too.
"""

import os
import platform
import sys
import time
from pathlib import Path

import numpy as np

from lensfield.engine import Lens, Options, Report, SpectralImage, simulate
from lensfield.engine.field.distortion import FieldGeometry
from lensfield.engine.image.irradiance import irradiance_per_radiance
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.image.preview import auto_exposure, to_rec709, write_png
from lensfield.engine.spectral.spectra import blackbody

os.environ["LENSFIELD_CACHE"] = "off"  # the time to plan is part of it
PAPER = Options(method="paper")
PITCH_UM = 6.25
WAVELENGTH_NM = 587.6
SQUARE_PX = 24


def checkerboard(rows=576, columns=768):
    """The paper's 1/3 inch frame: 4.8 x 3.6 mm."""
    row, column = np.mgrid[:rows, :columns]
    return SpectralImage((row // SQUARE_PX + column // SQUARE_PX) % 2, [WAVELENGTH_NM], pitch_um=4800 / columns)


def multispectral(rows=253, columns=380):
    """31 wavelengths of tungsten light on a coarse chequered pattern, over the same sensor width."""
    nm = np.linspace(400, 700, 31)
    row, column = np.mgrid[:rows, :columns]
    pattern = 0.1 + 0.9 * ((row // 12 + column // 12) % 2)
    return SpectralImage(blackbody(2856).at(nm)[:, None, None] * pattern, nm, pitch_um=4800 / columns)


def point_energies(lens, rows=576, columns=768, spacing_px=37, reach_px=14):
    """Energy of the images of single pixels over what Eq. 2 gives for them: what resampling by distortion does."""
    optics = lens.at_wavelength(WAVELENGTH_NM)
    field = FieldGeometry(optics, lens.name)
    grid = PixelGrid((rows, columns), PITCH_UM)
    points = np.zeros((rows, columns))
    points[spacing_px // 2::spacing_px, spacing_px // 2::spacing_px] = 1
    image = simulate(SpectralImage(points, [WAVELENGTH_NM], pitch_um=PITCH_UM), lens).cube[0].astype(float)
    energies = []
    for point in np.argwhere(points):
        height_mm = np.hypot(*grid.position_mm(*point))
        if height_mm > lens.heights_mm[-2]:
            continue
        shrink = field.distortion(height_mm) / height_mm
        slope = (field.distortion(height_mm + 1e-3) - field.distortion(height_mm - 1e-3)) / 2e-3
        top, left = (round(c + (p - c) * shrink) - reach_px for p, c in zip(point, grid.centre_px, strict=True))
        energy = image[top:top + 2 * reach_px + 1, left:left + 2 * reach_px + 1].sum()
        expected = irradiance_per_radiance(optics.transmittance, lens.f_number_effective) \
            * field.relative_illumination(height_mm) * shrink * slope  # the image of a pixel has this area
        energies.append(energy / expected)
    return np.array(energies)


def even_light(lens, rows=576, columns=768, overscan_px=60):
    """Irradiance on the axis from even light, over that of Eq. 2: what the blur alone does to it."""
    shape = (1, rows + 2 * overscan_px, columns + 2 * overscan_px)
    image = SpectralImage(np.ones(shape), [WAVELENGTH_NM], pitch_um=PITCH_UM, overscan_px=(overscan_px,) * 2)
    middle = simulate(image, lens).cube[0, rows // 2 - 1:rows // 2 + 1, columns // 2 - 1:columns // 2 + 1]
    return float(middle.mean()) / irradiance_per_radiance(1.0, lens.f_number_effective)


def timed(image, lens, options):
    report = Report()
    begin = time.perf_counter()
    result = simulate(image, lens, options, report=report)
    return result, time.perf_counter() - begin, report


def relative_l2(result, exact):
    return float(np.linalg.norm(result.cube.astype(float) - exact.cube) / np.linalg.norm(exact.cube))


def save(image, path):
    picture = to_rec709(image)
    write_png(picture, path, auto_exposure(picture))


def main(folder):
    lens = Lens.load("edmund-54852")
    print(f"{platform.machine()}, Python {platform.python_version()}, numpy {np.__version__}")
    board = checkerboard()
    exact, exact_s, _ = timed(board, lens, Options(method="exact"))
    print(f"768 x 576, {WAVELENGTH_NM} nm; the exact operator: {exact_s:.1f} s")
    for name, options in (("the paper: 16 px in a space of 64 x 64", PAPER),
                          *((f"accuracy {accuracy:g}", Options(accuracy=accuracy)) for accuracy in (0.1, 0.01, 1e-3))):
        result, seconds, report = timed(board, lens, options)
        energy = report.lens_image.energy
        print(f"  {name:<42}{seconds:7.3f} s, exact / this = {exact_s / seconds:6.0f}, relative L2 "
              f"{relative_l2(result, exact):.1e}, energy out / in - 1 = "
              f"{energy.out_w_per_nm / energy.in_w_per_nm - 1:+.0e}")
    save(board, folder / "checkerboard_ideal.png")
    save(timed(board, lens, PAPER)[0], folder / "checkerboard_lens.png")

    spectral = multispectral()
    _, seconds, _ = timed(spectral, lens, PAPER)
    print(f"253 x 380, 31 wavelengths, the paper's sections: {seconds:.2f} s, {seconds / exact_s:.3f} of the exact "
          "operator's time above")
    save(timed(spectral, lens, PAPER)[0], folder / "multispectral_lens.png")

    print(f"even light on the axis, over Eq. 2: {even_light(lens):.4f}")
    energies = point_energies(lens)
    print(f"energy of {energies.size} single-pixel points after distortion: mean {energies.mean():.3f}, standard "
          f"deviation {energies.std():.4f}, {energies.min():.3f} to {energies.max():.3f}")


if __name__ == "__main__":
    output = Path(sys.argv[1])
    output.mkdir(parents=True, exist_ok=True)
    main(output)
