"""Several `lensfield render` processes share a folder and its frames; one is killed. Print who rendered which frames.

    python tests/reliability/share.py 4 [FRAMES]
"""

import random
import shutil
import sys
import tempfile
from pathlib import Path

import kill

SAMPLES = 64


def main(processes=4, frames=8):
    """Print the shares, and compare with the result of a single process; returns the exit status."""
    from lensfield import addon

    addon.register()
    work, spec = Path(tempfile.mkdtemp(prefix="lensfield-share-")), f"1-{frames}"
    blend, alone, shared = work / "scene.blend", work / "alone", work / "shared"
    kill.save_scene(blend, SAMPLES)
    *others, last = (kill.start(blend, shared, spec) for _ in range(processes))
    was_at_work = kill.killed(last, True, random.random())
    outputs = [process.communicate() for process in others]
    if any(process.returncode for process in others):
        print(*(errors for _, errors in outputs), sep="\n")
        return 1
    print(f"one of {processes} processes was killed {'at work' if was_at_work else 'when it had ended'}; the others "
          f"rendered {', '.join(str(out.count('lens_image.exr')) for out, _ in outputs)} of {frames} frames")
    kill.undisturbed(blend, shared, spec)  # renders any remaining frames
    kill.undisturbed(blend, alone, spec)
    names = kill.differing(alone, shared)
    print(f"other than of one process: {', '.join(names)}; see {work}" if names else "each byte as of one process")
    if not names:
        shutil.rmtree(work)
    return bool(names)


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])))
