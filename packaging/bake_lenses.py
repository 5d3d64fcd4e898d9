"""Bake the bundled lenses, in engine/library: prescriptions/*.toml to *.npz, and draw their sheets.

    python packaging/bake_lenses.py [NAME ...]

bakes those named, or all, as `make lenses` does.
"""

import sys
from dataclasses import dataclass, replace

from lensfield.commands.terminal import progress_bar
from lensfield.engine.bake.bake import bake
from lensfield.engine.bake.prescriptions import read_prescription
from lensfield.engine.lens.readers.package import write_package
from lensfield.engine.library import BUNDLED
from lensfield.engine.sheet.sheet import write_lens_plot

WAVELENGTHS_NM = (400, 410, 420, 430, 441, 453, 467, 482, 499, 518, 539, 562, 588, 618, 655, 700)
"""Denser in the blue, where glass and so blur change fastest."""
HEIGHTS = 21


@dataclass(frozen=True)
class Bundled:
    """A lens of the library: its prescription, and what it is baked with."""

    prescription: str
    samples: int = 81
    f_number: float | None = None
    pitch_um: float | None = None
    wavelengths_nm: tuple[float, ...] = WAVELENGTHS_NM


LIBRARY = {
    # So wide open that a PSF takes seconds; its blur is large at all wavelengths, and changes less with them.
    "angenieux-50mm-f1.1": Bundled("angenieux-50mm", samples=97, pitch_um=5.8,
                                   wavelengths_nm=(400, 425, 450, 480, 515, 555, 600, 650, 700)),
    "angenieux-50mm-f4": Bundled("angenieux-50mm", f_number=4.0),
    # The rim's glow asks for three times this pitch, which would swallow what the middle of a phone's picture shows.
    "apple-phone-4mm": Bundled("apple-phone-4mm", samples=121, pitch_um=1.6),
    "cooke-triplet-50mm": Bundled("cooke-triplet-50mm"),
    "edmund-54852": Bundled("edmund-54852"),
    "kodak-petzval-100mm": Bundled("kodak-petzval-100mm", samples=97),
    "muller-fisheye-25mm": Bundled("muller-fisheye-25mm"),
    "nikkor-28mm": Bundled("nikkor-28mm"),
    "tessar-50mm": Bundled("tessar-50mm"),
}


def bake_bundled(name, progress):
    """Bake and write one lens of the library, and its sheet beside it."""
    bundled = LIBRARY[name]
    path = BUNDLED / f"{name}.npz"
    prescription = read_prescription(BUNDLED / "prescriptions" / f"{bundled.prescription}.toml")
    prescription = replace(prescription, name=name)
    if bundled.f_number:
        prescription = replace(prescription, aperture=("f_number", bundled.f_number))
    lens = bake(prescription, heights=HEIGHTS, wavelengths_nm=bundled.wavelengths_nm, samples=bundled.samples,
                pitch_um=bundled.pitch_um, progress=progress)
    write_package(lens, path)
    write_lens_plot(lens, path.with_suffix(".png"))
    return lens, path


def main(names):
    for name in names or LIBRARY:
        with progress_bar() as tell:
            lens, path = bake_bundled(name, tell)
        print(f"{path.name}: {path.stat().st_size / 1e6:.2f} MB, pitch {lens.psf_pitch_um:g} um, at least "
              f"{lens.enclosed_energy.min():.2%} of the light inside")


if __name__ == "__main__":
    main(sys.argv[1:])
