"""A case's radiance as a file, by the engine that Python finds, today's or an earlier one, in a process of its own.

    python benchmarks/measure_files.py '{"name": "1920x1080 x 12, 0.01, nikkor-28mm"}'

prints what writing and reading it took as a line of JSON.
"""

import json
import sys
import tempfile
from pathlib import Path

from cases import CASES
from timing import least_s

from lensfield import engine
from lensfield.engine import Lens
from lensfield.engine.image.spectral_exr import read_exr, write_exr


def main(name):
    case = CASES[name]
    radiance = case.radiance(Lens.load(case.lens))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "radiance.exr"
        written, read = least_s(lambda: write_exr(radiance, path), 1), least_s(lambda: read_exr(path), 1)
        size_mb = path.stat().st_size / 1e6
    print(json.dumps({"written": written, "read": read, "size_mb": size_mb,
                      "engine": str(Path(engine.__file__).parent)}))


if __name__ == "__main__":
    main(**json.loads(sys.argv[1]))
