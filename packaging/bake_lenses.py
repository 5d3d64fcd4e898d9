"""Bake the bundled lens packages in engine/library from their prescriptions, as `make lenses` does.

A package contains the lens as its prescription states it, so loading it does not require a bake. It has the paper's
tables, with which Eq. 2 accounts for all light; `point_flux` is not one of them.
"""

from dataclasses import replace

import numpy as np

from lensfield.commands.terminal import progress_bar
from lensfield.engine.lens_files.package import write_package
from lensfield.engine.library import BUNDLED, prescription_of
from lensfield.engine.library.baked import baked_lens


def main():
    for path in sorted(BUNDLED.glob("*.npz")):
        with progress_bar() as report:
            lens = baked_lens(prescription_of(path.stem), progress=report)
        write_package(replace(lens, point_flux=np.ones(())), path)
        print(f"{path.name}: {path.stat().st_size / 1e6:.2f} MB, pitch {lens.psf_pitch_um:g} um, at least "
              f"{lens.enclosed_energy.min():.2%} of the light in the window")


if __name__ == "__main__":
    main()
