"""A case's radiance as a file, by the engine that Python finds, today's or an earlier one, in a process of its own.

    python benchmarks/measure_files.py '{"name": "1920x1080 x 12, 0.01, nikkor-28mm"}'

prints what writing and reading it took as a line of JSON.
"""

import json
import sys
import tempfile
import time
from pathlib import Path

from cases import CASES

from lensfield import engine
from lensfield.engine import Lens
from lensfield.engine.image.spectral_exr import read_exr, write_exr


def seconds(work):
    """Of the processor, and on the clock."""
    begin = time.process_time(), time.perf_counter()
    work()
    return time.process_time() - begin[0], time.perf_counter() - begin[1]


def main(name):
    case = CASES[name]
    radiance = case.radiance(Lens.load(case.lens))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "radiance.exr"
        written, read = seconds(lambda: write_exr(radiance, path)), seconds(lambda: read_exr(path))
        size_mb = path.stat().st_size / 1e6
    print(json.dumps({"written": written, "read": read, "size_mb": size_mb,
                      "engine": str(Path(engine.__file__).parent)}))


if __name__ == "__main__":
    main(**json.loads(sys.argv[1]))
