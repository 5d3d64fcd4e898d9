"""Estimate a film on a farm, 10,000 frames of 31 wavelengths at 4K, from two small renders of the sample scene.

    python benchmarks/farm_on_paper.py [SLABS MACHINES CORES DOLLARS_PER_CORE_HOUR]

Bytes and processor seconds per pixel come from the difference between a larger and a smaller render, which eliminates
the constant overhead. Both renders are too coarse to need slabs of depth. `lensfield lint` reports the number of slabs
at 4K; radiance, passes and Cycles's time are multiplied by it, which is an upper limit.
"""

import json
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

SCENE = Path(__file__).resolve().parents[1] / "sample_scenes" / "evening_chess.blend"
SIZES = (128, 72), (256, 144)
FILM_PX, FRAMES, WAVELENGTHS, PASSES = 3840 * 2160, 10_000, "400:700:31", 4  # passes of tier standard
PASS_BYTES = 20  # per pixel (docs/guide/scripts.md)
GIGA, TERA, HOUR_S, DAY_S = 1e9, 1e12, 3600.0, 86400.0


def main(slabs=4.0, machines=100.0, cores=32.0, dollars=0.04):
    with tempfile.TemporaryDirectory() as folder:
        rendered(Path(folder) / "bakes", SIZES[0])
        small, large = (rendered(Path(folder) / f"{size[0]}", size) for size in SIZES)
    more_px = SIZES[1][0] * SIZES[1][1] - SIZES[0][0] * SIZES[0][1]
    film = {name: (large[name] - small[name]) / more_px * FILM_PX for name in large}
    film["radiance.exr"] *= slabs
    seconds = film.pop("cycles_s") * slabs + film.pop("lens_s")
    for name, size in sorted(film.items(), key=lambda each: -each[1]):
        if size >= GIGA / 100:
            print(f"{name:<16}{size / GIGA:8.2f} GB per frame{size * FRAMES / TERA:8.1f} TB in total")
    total, passes = sum(film.values()), PASSES * slabs * PASS_BYTES * FILM_PX
    print(f"{'all':<16}{total / GIGA:8.2f} GB per frame{total * FRAMES / TERA:8.1f} TB in total")
    print(f"passes of a frame in progress: {passes / GIGA:.2f} GB; {passes * machines / TERA:.2f} TB on all machines")
    hours, frame_s = seconds * FRAMES / HOUR_S, seconds / cores
    print(f"{seconds / HOUR_S:.2f} core hours per frame, {hours:,.0f} in total: ${hours * dollars:,.0f} at "
          f"${dollars} each")
    written = machines * (total + passes) / frame_s
    print(f"{machines:g} machines of {cores:g} cores: {frame_s / 60:.1f} min per frame, "
          f"{frame_s * FRAMES / machines / DAY_S:.1f} days, {written / GIGA:.2f} GB/s written")


def rendered(folder, size):
    """Render the sample scene; returns bytes by kind of file, and the processor seconds of Cycles and of the rest."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(
        [sys.executable, "-c", "from lensfield.cli import console; console()", "render", str(SCENE), "--frames", "1",
         "--wavelengths", WAVELENGTHS, "--tier", "standard", "--resolution", "{}x{}".format(*size), "--output",
         str(folder)], check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    record, = folder.glob("*_0001_report.json")
    stages = json.loads(record.read_text())["stages_s"]
    share = stages["multispectral render"] / sum(stages.values())  # of wall-clock time
    sizes = {path.name.partition("_0001_")[2]: path.stat().st_size for path in folder.glob("*_0001_*")}
    return sizes | {"cycles_s": seconds * share, "lens_s": seconds * (1 - share)}


if __name__ == "__main__":
    main(*map(float, sys.argv[1:]))
