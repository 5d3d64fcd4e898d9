"""Measure the errors of lens images without and with detail, at the same samples: noise and blur together.

    .venv/bin/python benchmarks/detail_figures.py [FILE.blend or cornell ...] [--samples 64 256] [--size WIDTHxHEIGHT]

Each scene, by default the sample scene and the Cornell box, is captured in *Standard* with the camera's view, and
imaged by a lens. The truth is an image of 4 x 4 times as many pixels with many samples. See LEGEND for the columns.
"""

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np
from noise_of_samples import CORNELL, drained, open_scene
from scene_figures import SCENE, colour_errors

from lensfield import addon
from lensfield.addon.capture.radiance import capture
from lensfield.addon.job.result import Result
from lensfield.addon.render.render import job_of_frame
from lensfield.commands.terminal import quiet
from lensfield.engine import Options, simulate

FINER = 4
TRUE_SAMPLES = 48  # in each of FINER x FINER parts of a pixel
LEGEND = """\
error      misplaced light (L1), relative to the light: noise, blur, and the truth's noise
noise      the part that differs between seeds
dE 50, 90  median and 90 % of the pixels' CIEDE2000
seconds    of the processor: Cycles and estimates, and the lens"""


def lens_image(scene, options, seed, samples, detail, finer=1):
    """Irradiance (wavelength, row, column) in the frame's pixels, wavelengths, and processor seconds of both parts."""
    scene.render.resolution_percentage = 100 * finer
    scene.cycles.seed, scene.cycles.samples, scene.lensfield.tier = seed, samples, "STANDARD"
    with tempfile.TemporaryDirectory() as folder, quiet(1):
        job = job_of_frame(scene, scene.frame_current, lens=options.lens, f_number=options.f_number, view="camera",
                           output_folder=Path(folder), depth="off", unfit="render", denoise="off",
                           options=Options(detail=detail), lens_quality="preview")
        captured, seconds = drained(capture(scene, job, Result.of(scene, Path(folder), job.frame), 1.0))
        radiance = captured.radiance
        if finer > 1:
            radiance = radiance.cropped([n % finer for n in radiance.overscan_px]).coarser(finer)
        begin_s = time.process_time()
        irradiance = simulate(radiance, job.lens, job.options).cube.astype(float)
    return irradiance, radiance.wavelengths_nm, (seconds, time.process_time() - begin_s)


def rows(scene, options):
    """A line for each number of samples, without and with detail."""
    truth, nm, _ = lens_image(scene, options, 99, TRUE_SAMPLES, "off", FINER)
    pixels = truth.reshape(len(nm), -1).T
    for samples in options.samples:
        for detail in ("off", "on"):
            images, _, seconds = zip(*(lens_image(scene, options, seed, samples, detail)
                                       for seed in range(1, options.seeds + 1)), strict=True)
            images = np.array(images)
            error = np.abs(images - truth).sum() / truth.sum() / len(images)
            noise = (np.abs(images - images.mean(axis=0)).sum() / truth.sum()
                     / np.sqrt(len(images) * (len(images) - 1)))
            colours = [colour_errors(pixels, image.reshape(len(nm), -1).T, nm) for image in images]
            middle, most = (np.mean([np.percentile(each, share) for each in colours]) for share in (50, 90))
            cycles_s, lens_s = np.mean(seconds, axis=0)
            yield (f"{samples:8} {detail:<4}{error:9.4f}{noise:9.4f}{middle:8.3f}{most:8.3f}{cycles_s:9.2f}"
                   f"{lens_s:8.2f}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("scenes", nargs="*", default=[SCENE, CORNELL])
    parser.add_argument("--samples", nargs="+", type=int, default=[64, 256])
    parser.add_argument("--size", type=lambda text: tuple(map(int, text.split("x"))), default=(128, 96))
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--lens", default="nikkor-z-50mm-f1.8")
    parser.add_argument("--f-number", type=float, default=4.0)
    options = parser.parse_args()
    addon.register()
    print(LEGEND)
    print(f"{'':24}{'samples':>8} {'':<4}{'error':>9}{'noise':>9}{'dE 50':>8}{'dE 90':>8}{'Cycles':>9}{'lens':>8}")
    for name in options.scenes:
        scene = open_scene(name, options.size, argparse.Namespace(samples=64, adaptive=False))
        for row in rows(scene, options):
            print(f"{Path(str(name)).stem:<24}{row}", flush=True)


if __name__ == "__main__":
    main()
