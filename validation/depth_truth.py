"""Depth in layers against rays that Cycles traces through the lens itself.

    python validation/depth_truth.py FOLDER [LENS ...] [--pictures]

renders a lit room and simple scenes through lenses focused at 2 m: by `render_through_lens` in layers; by the traced
lens with little noise (the reference, cached in FOLDER); by the traced lens in the same processor time as the layers;
and by Cycles' depth of field with the lens's in-focus blur. It prints each figure with its limit. The exit status is 1
if a figure exceeds its limit. With --pictures it writes the pictures of the docs.
"""

import hashlib
import os
import platform
import sys
import tempfile
import time
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import bpy
import numpy as np
from PIL import Image

from depth_measure import edges_of, errors, lamps_of, means_of_blocks
from depth_room import FOCUS_M, build_room
from depth_scenes import LAMP_PX, LAMPS_M, body_scene, floor_scene, lamp_scene
from lensfield import addon
from lensfield.commands.terminal import quiet
from lensfield.engine import Rings, load_lens
from lensfield.engine.depth.depth_range import blur_px
from lensfield.engine.image.spectral_image import SpectralImage
from lensfield.engine.lens.entrance_pupil import entrance_pupil_size_mm
from lensfield.engine.pictures.preview import to_rec709
from lensfield.engine.pictures.spectral_exr import read_exr
from lensfield.engine.runtime.build_identity import build_identity
from lensfield.engine.runtime.files import atomic_path
from lensfield.engine.runtime.values import digest_of
from lensfield.engine.spectral.colour import encode_srgb
from lensfield.engine.stray.options import OFF, StrayOptions
from traced_lens_truth import Figure, frame_of, places_mm

LENSES = "kodak-petzval-100mm", "angenieux-50mm", "nikkor-58mm-f1.4", "cooke-42mm-2x"
FRAME_PX = 288, 384
WAVELENGTHS_NM = 453.0, 562.0, 655.0
MIDDLE_NM = WAVELENGTHS_NM[1:2]
TRUTH_SEEDS, TRUTH_SAMPLES, FIRST_SEED = 4, 128, 100
SEEDS, SAMPLES, QUICK_SAMPLES = 2, 64, 16  # of pictures in layers, and of timed pictures
PLAIN_SEEDS, PLAIN_SAMPLES = 2, 32
BODY_BLOCK_PX = 8
ROOT = Path(__file__).resolve().parents[1]
SOURCES = ROOT / "validation"
PICTURES, DOCS = "--pictures", ROOT / "docs"
EXPOSED_PERCENTILE, EXPOSED_LEVEL, QUALITY = 85, 0.6, 88  # lamps may be clipped


@cache
def sources_digest(folder=SOURCES):
    """SHA-256 of the sources of this validation: the scenes of its references and their rendering."""
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*.py")):
        digest.update(f"{path.relative_to(folder).as_posix()}\n".encode() + path.read_bytes() + b"\0")
    return digest.hexdigest()


class Bench:
    """A lens focused on the middle of the room, and the ways to take a picture through it."""

    def __init__(self, name, folder, first_seed=0):
        self.name, self.folder, self.first_seed = name, Path(folder), first_seed
        self.lens = load_lens(name, Rings(1e3 * FOCUS_M))
        self.frame = frame_of(self.lens, FRAME_PX)

    def picture(self, scene, samples, seed, wavelengths_nm=MIDDLE_NM, depth="auto"):
        """Spectral irradiance (wavelength, row, column), and the total processor seconds."""
        scene.render.resolution_y, scene.render.resolution_x = FRAME_PX
        scene.cycles.samples, scene.cycles.seed = samples, self.first_seed + seed
        begin_s = time.process_time()
        with tempfile.TemporaryDirectory() as folder, quiet(1):  # suppresses Blender's messages about saved passes
            result = addon.render_through_lens(scene, lens=self.lens, wavelengths_nm=wavelengths_nm,
                                               output_folder=folder, depth=depth, stray=StrayOptions(OFF))
            cube = read_exr(result.irradiance).cube.astype(float)
        return cube, time.process_time() - begin_s

    def pictures(self, scene, samples, seeds, wavelengths_nm=MIDDLE_NM, depth="auto"):
        """Pictures with several seeds: (wavelength, seed, row, column), and the mean of their seconds."""
        taken = [self.picture(scene, samples, seed, wavelengths_nm, depth) for seed in range(seeds)]
        return np.stack([cube for cube, _ in taken], axis=1), np.mean([seconds for _, seconds in taken])

    def truth(self, what, scene, wavelengths_nm=MIDDLE_NM, seeds=TRUTH_SEEDS, samples=TRUTH_SAMPLES):
        """A scene rendered by rays through the lens: (wavelength, seed, row, column), cached in the folder."""
        return np.stack([[self._cached(what, nm, samples, FIRST_SEED + seed, lambda nm=nm, seed=seed: self.picture(
            scene, samples, FIRST_SEED + seed, [nm], "traced")[0][0]) for seed in range(seeds)]
            for nm in wavelengths_nm])

    def _cached(self, what, nm, samples, seed, make):
        """A picture from the folder; renders it unless it exists for this code, prescription and parameters."""
        blender = bpy.app.version_string, bpy.app.build_hash.decode(errors="replace")
        facts = (build_identity(), sources_digest(), blender, self.lens.prescription, FRAME_PX, FOCUS_M, what, nm,
                 samples, self.first_seed + seed)
        path = self.folder / f"{self.name}_{what}_{nm:.0f}_{samples}_{seed}_{digest_of(facts).hex()[:16]}.npy"
        if not path.is_file():
            with atomic_path(path, overwrite=True) as temporary:
                np.save(temporary, make())
        return np.load(path).astype(float)

    @contextmanager
    def cycles_depth_of_field(self):
        """Enable Cycles' depth of field in all captures, for a lens with this pupil."""
        def begin(scene, _):
            dof = scene.camera.data.dof
            dof.use_dof, dof.focus_distance = True, FOCUS_M
            camera_mm = scene.camera.data.lens  # the aperture's diameter is this over the f-number, in Blender's mm
            width_mm, height_mm = entrance_pupil_size_mm(self.lens)
            dof.aperture_fstop, dof.aperture_ratio = camera_mm / height_mm, height_mm / width_mm

        bpy.app.handlers.render_init.append(begin)
        try:
            yield
        finally:
            bpy.app.handlers.render_init.remove(begin)

    def samples_for(self, scene, seconds, wavelengths_nm):
        """Samples that the traced lens renders in these seconds."""
        few, many = 2, 10
        took = [self.picture(scene, samples, 0, wavelengths_nm, "traced")[1] for samples in (few, many)]
        return max(1, round(few + (seconds - took[0]) * (many - few) / (took[1] - took[0])))


def room_figures(bench, pictures):
    """The room: errors of layers, and their ratio to the traced lens's errors in the same seconds."""
    scene = build_room()
    truth = bench.truth("room", scene, WAVELENGTHS_NM)
    bench.picture(scene, 1, 0, WAVELENGTHS_NM)  # fills the caches
    ours, _ = bench.pictures(scene, SAMPLES, SEEDS, WAVELENGTHS_NM)
    overall = [errors(*both) for both in zip(ours, truth, strict=True)]
    edges, lamps = ([errors(*both, mask(both[1].mean(axis=0))) for both in zip(ours, truth, strict=True)]
                    for mask in (edges_of, lamps_of))
    wavelengths = ", ".join(f"{nm:g}" for nm in WAVELENGTHS_NM)
    yield Figure(f"room: L2 bias, worst of {wavelengths} nm", max(each.l2_bias for each in overall), 0.025)
    yield Figure("room: L1 bias, the same", max(each.l1_bias for each in overall), 0.025)
    yield Figure("room, edges: L1 bias", max(each.l1_bias for each in edges), 0.04)
    yield Figure("room, edges: L2 bias", max(each.l2_bias for each in edges), 0.06)
    yield Figure("room, lamps and their rims: L2 bias", max(each.l2_bias for each in lamps), None)
    for nm, mine, theirs in zip(WAVELENGTHS_NM, ours, truth, strict=True):
        yield Figure(f"room, total light at {nm:g} nm: from the truth's", mine.mean() / theirs.mean() - 1, None)
    pictures["truth"] = truth.mean(axis=1)
    yield from _at_equal_seconds(bench, scene, truth, pictures)
    with bench.cycles_depth_of_field():
        thin, _ = bench.pictures(scene, QUICK_SAMPLES, SEEDS, WAVELENGTHS_NM, "off")
    pictures["thin"] = thin[:, 0]
    yield Figure("room: L2 bias of Cycles' depth of field",
                 max(errors(*both).l2_bias for both in zip(thin, truth, strict=True)), None)


def _at_equal_seconds(bench, scene, truth, pictures):
    """Ratios of one picture's total errors to the traced lens's errors, at one wavelength and in colour."""
    for what, truths, nm, limit in (("at one wavelength", truth[1:2], MIDDLE_NM, 1 / 5),
                                    ("in colour", truth, WAVELENGTHS_NM, 1 / 10)):
        layered, layered_s = bench.pictures(scene, QUICK_SAMPLES, SEEDS, nm)
        samples = bench.samples_for(scene, layered_s, nm)
        traced, traced_s = bench.pictures(scene, samples, SEEDS, nm, "traced")
        mine, theirs = ([errors(*both) for both in zip(each, truths, strict=True)] for each in (layered, traced))
        for norm in ("l1", "l2"):
            error, traced_error = (np.mean([getattr(each, norm) for each in side]) for side in (mine, theirs))
            yield Figure(f"room {what}: {norm.upper()} with noise {error:.1%} in {layered_s:.0f} processor s, traced "
                         f"{traced_error:.1%} in {traced_s:.0f} s ({samples} samples): ratio", error / traced_error,
                         limit)
        pictures["layers"], pictures["traced"] = layered[:, 0], traced[:, 0]


def floor_figures(bench):
    """A slanted floor through the focus: every row has the right brightness."""
    scene = floor_scene(bench.lens)
    truth, (ours, _) = bench.truth("floor", scene, seeds=2)[0], bench.pictures(scene, PLAIN_SAMPLES, PLAIN_SEEDS)
    ours, level = ours[0], truth.mean(axis=(0, 2))
    rows = slice(4, -4)
    off = (ours.mean(axis=(0, 2)) - level)[rows] / level[rows]
    yield Figure("floor: largest error of a row's mean", np.abs(off).max(), 0.02)
    overall = errors(ours, truth)
    yield Figure("floor: L1 bias", overall.l1_bias, None)
    yield Figure("floor: L2 bias", overall.l2_bias, None)


def body_figures(bench):
    """A closed body through the focus: borders of layers do not show its dark inside."""
    scene = body_scene(bench.lens)
    truth, (ours, _) = bench.truth("body", scene, seeds=2)[0], bench.pictures(scene, PLAIN_SAMPLES, PLAIN_SEEDS)
    blocks, true = (means_of_blocks(each, BODY_BLOCK_PX) for each in (ours[0], truth))
    lit = true.mean(axis=0) > 0.5 * true.max()
    darker = 1 - blocks.mean(axis=0)[lit] / true.mean(axis=0)[lit]
    yield Figure(f"closed body: a block of {BODY_BLOCK_PX} px of it, darkest against the truth", darker.max(), 0.05)
    yield Figure("closed body: total light", abs(darker.mean()), 0.01)


def lamp_figures(bench):
    """Small lamps out of focus: position and width of their light."""
    for distance_m in LAMPS_M:
        scene, ideal_mm = lamp_scene(bench.lens, bench.frame.pitch_um * 1e-3, distance_m)
        truth = bench.truth(f"lamps at {distance_m:g} m", scene, seeds=2, samples=4 * TRUTH_SAMPLES)[0]
        ours = bench.pictures(scene, PLAIN_SAMPLES, 2)[0][0].mean(axis=0)
        width_px = abs(float(blur_px(bench.lens, bench.frame.pitch_um, 1e3 * distance_m)))
        spots = [tuple(spot_px(picture, bench.frame, place, width_px) for picture in (ours, truth.mean(axis=0)))
                 for place in ideal_mm]
        away = max(np.hypot(*(ours[:2] - true[:2])) for ours, true in spots) / width_px
        wider = max(abs(ours[2] / true[2] - 1) for ours, true in spots)
        squeeze = bench.lens.squeeze
        blur2, lamp2 = width_px**2 * (1 + squeeze**-4), LAMP_PX**2 * (1 + squeeze**2)  # along the height and the width
        first = np.sqrt((blur2 + lamp2) / 16 + 1 / 6)
        where = f"lamps {distance_m:g} m away, {width_px:.1f} px wide"
        yield Figure(f"{where}: difference of centroids, over the width", away, 0.02)
        yield Figure(f"{where}: difference of RMS radii", wider, 0.02)
        yield Figure(f"{where}: RMS radius on the axis {spots[0][0][2]:.2f} px, traced {spots[0][1][2]:.2f} px, first "
                     f"order {first:.2f} px: difference from first order", abs(spots[0][0][2] / first - 1), None)


def spot_px(picture, frame, ideal_mm, width_px):
    """Centroid (x, y) relative to the ideal image, and RMS radius of the light around it, in pixels."""
    x, y = ((places - middle) * 1e3 / frame.pitch_um for places, middle in
            zip(places_mm(frame), ideal_mm, strict=True))
    light = picture * (np.hypot(x, y) < 0.75 * width_px + 8)
    centre = np.array([np.average(place, weights=light) for place in (x, y)])
    return np.array([*centre, np.sqrt(np.average((x - centre[0])**2 + (y - centre[1])**2, weights=light))])


def write_pictures(bench, pictures, folder):
    """Write the room by layers and the reference; below them, the traced lens in the layers' time and Cycles' depth of
    field. All have the same exposure."""
    linear = [to_rec709(SpectralImage(pictures[name], WAVELENGTHS_NM, bench.frame))
              for name in ("layers", "truth", "traced", "thin")]
    exposure = EXPOSED_LEVEL / np.percentile(linear[1], EXPOSED_PERCENTILE)
    shown = [np.round(encode_srgb(picture * exposure) * 255).astype(np.uint8) for picture in linear]
    sheet = np.vstack([np.hstack(shown[:2]), np.hstack(shown[2:])])
    Image.fromarray(sheet).save(Path(folder) / f"depth_{bench.name}.jpg", quality=QUALITY)


def main(arguments):
    folder, *names = (each for each in arguments if not each.startswith("--"))
    addon.register()
    missed = 0
    print(f"{platform.machine()}, Python {platform.python_version()}, Blender {bpy.app.version_string}, "
          "{1} x {0} px, focus {2:g} m".format(*FRAME_PX, FOCUS_M))
    for name in names or LENSES:
        bench, pictures = Bench(name, folder), {}
        print(f"\n{name}: layers of depth against rays through the lens", flush=True)
        for figures in (room_figures(bench, pictures), floor_figures(bench), body_figures(bench), lamp_figures(bench)):
            for figure in figures:
                print(figure, flush=True)
                missed += figure.missed
        if PICTURES in arguments:
            write_pictures(bench, pictures, DOCS)
    return 1 if missed else 0


if __name__ == "__main__":
    status = main(sys.argv[1:])
    sys.stdout.flush()
    os._exit(status)  # some of Blender's wheels crash while the interpreter exits
