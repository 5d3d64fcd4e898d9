"""Bake the lens packages that come with the project, in engine/library, from their prescriptions; `make lenses` does.

A package is what its prescription gives as it stands, so that who loads it need not bake it: the paper's tables, by
which Eq. 2 tells all light. `point_flux` is none of them.
"""

from dataclasses import replace

import numpy as np

from lensfield.commands.terminal import progress_bar
from lensfield.engine.lens.readers.package import write_package
from lensfield.engine.library import BUNDLED, prescription_of
from lensfield.engine.library.baked import baked_lens


def main():
    for path in sorted(BUNDLED.glob("*.npz")):
        with progress_bar() as tell:
            lens = baked_lens(prescription_of(path.stem), progress=tell)
        write_package(replace(lens, point_flux=np.ones(())), path)
        print(f"{path.name}: {path.stat().st_size / 1e6:.2f} MB, pitch {lens.psf_pitch_um:g} um, at least "
              f"{lens.enclosed_energy.min():.2%} of the light inside")


if __name__ == "__main__":
    main()
