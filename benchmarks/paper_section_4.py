"""Section 4 of the paper, again: its checkerboard and its multispectral image through its lens.

    python benchmarks/paper_section_4.py FOLDER

writes the pictures of Figures 10 and 11 and tells what became of the light: in points, in even light, and in all.
What it takes is told by bench.py.
"""

import sys
from pathlib import Path

import numpy as np
from cases import NM, PAPER, PAPER_LENS, SENSOR_UM, checkerboard, multispectral, points

from lensfield.engine import Lens, Options, Report, SpectralImage, simulate
from lensfield.engine.field.distortion import FieldGeometry
from lensfield.engine.image.irradiance import irradiance_per_radiance
from lensfield.engine.image.preview import auto_exposure, to_rec709, write_png


def point_energies(lens, reach_px=14):
    """Energy of the images of single pixels over what Eq. 2 gives for them: what resampling by distortion does."""
    optics, radiance = lens.at_wavelength(NM), points()
    field, grid = FieldGeometry(optics, lens.name), radiance.grid
    image = simulate(radiance, lens).cube[0].astype(float)
    energies = []
    for point in np.argwhere(radiance.cube[0]):
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
    image = SpectralImage(np.ones(shape), [NM], pitch_um=SENSOR_UM / columns, overscan_px=(overscan_px,) * 2)
    middle = simulate(image, lens).cube[0, rows // 2 - 1:rows // 2 + 1, columns // 2 - 1:columns // 2 + 1]
    return float(middle.mean()) / irradiance_per_radiance(1.0, lens.f_number_effective)


def energy_kept(radiance, lens, options):
    """By how much the light that comes out of the blur differs from what goes in, relative to this."""
    report = Report()
    simulate(radiance, lens, options, report=report)
    energy = report.lens_image.energy
    return energy.out_w_per_nm / energy.in_w_per_nm - 1


def save(image, path):
    picture = to_rec709(image)
    write_png(picture, path, auto_exposure(picture))


def main(folder):
    folder.mkdir(parents=True, exist_ok=True)
    lens, board = Lens.load(PAPER_LENS), checkerboard()
    save(board, folder / "checkerboard_ideal.png")
    for name, radiance in (("checkerboard", board), ("multispectral", multispectral())):
        save(simulate(radiance, lens, PAPER), folder / f"{name}_lens.png")
    for name, options in (("the paper's method", PAPER),
                          *((f"accuracy {each:g}", Options(accuracy=each)) for each in (0.1, 0.01, 1e-3))):
        print(f"light after the blur over light before it, less 1, by {name}: {energy_kept(board, lens, options):+.0e}")
    print(f"even light on the axis, over Eq. 2: {even_light(lens):.4f}")
    energies = point_energies(lens)
    print(f"energy of {energies.size} points of a pixel after distortion: mean {energies.mean():.3f}, standard "
          f"deviation {energies.std():.4f}, {energies.min():.3f} to {energies.max():.3f}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
