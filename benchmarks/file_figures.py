"""Measure a frame's files by compression: processor and wall-clock seconds to write and to read them, and MB.

    lensfield render sample_scenes/evening_chess.blend --wavelengths 400:700:12 --resolution 1920x1080 --samples 16 \\
        --denoise off --output build/noisy            # a noisy frame; without --samples and --denoise, a cleaner one
    python benchmarks/file_figures.py build/noisy [...]
"""

import sys
import tempfile
from pathlib import Path

import numpy as np
import OpenEXR
from PIL import Image
from timing import least_s

from lensfield.engine.pictures.spectral_exr import exr_threads, read_parts

COMPRESSIONS = {"none": OpenEXR.NO_COMPRESSION, "RLE": OpenEXR.RLE_COMPRESSION, "ZIPS": OpenEXR.ZIPS_COMPRESSION,
                "ZIP": OpenEXR.ZIP_COMPRESSION, "PIZ": OpenEXR.PIZ_COMPRESSION}  # lossless, supported by Blender 5.0
PNG_LEVELS = 0, 1, 3, 6, 9
TIMES = 3


def print_row(what, written, path, read):
    print(f"  {what:<13}{written[0]:8.2f}{written[1]:8.2f}{read[0]:8.2f}{read[1]:8.2f}{path.stat().st_size / 1e6:9.2f}",
          flush=True)


def measure_exr(planes, copy):
    """Measure the planes of an EXR with each compression."""
    for name, compression in COMPRESSIONS.items():
        header = {"type": OpenEXR.scanlineimage, "compression": compression}

        def write(header=header):
            with exr_threads(), OpenEXR.File(header, dict(planes)) as file:
                file.write(str(copy))

        print_row(name, least_s(write, TIMES), copy, least_s(lambda: read_parts(copy), TIMES))


def measure_png(original, copy):
    """Measure a PNG with each compression level."""
    picture = Image.open(original)
    picture.load()
    for level in PNG_LEVELS:
        print_row(f"PNG, level {level}", least_s(lambda level=level: picture.save(copy, compress_level=level), TIMES),
                  copy, least_s(lambda: Image.open(copy).load(), TIMES))


def main(folders):
    with tempfile.TemporaryDirectory() as temporary:
        for path in sorted(path for folder in folders for path in Path(folder).iterdir()):
            if path.suffix in (".exr", ".png"):
                print(f"{path}\n  {'':<13}{'written':>16}{'read':>16}\n  {'':<13}" + f"{'cpu s':>8}{'s':>8}" * 2
                      + f"{'MB':>9}")
                copy = Path(temporary) / path.name
                if path.suffix == ".png":
                    measure_png(path, copy)
                    continue
                planes = read_parts(path)[0][1]
                measure_exr(planes, copy)
                if path.name.endswith("radiance.exr"):
                    print("  with its lower half black")
                    measure_exr({name: np.where(np.arange(len(plane))[:, None] < len(plane) // 2, plane, 0)
                                 for name, plane in planes.items()}, copy)


if __name__ == "__main__":
    main(sys.argv[1:] or sys.exit(__doc__))
