"""What a way of filtering will cost: seconds and memory, from counts of the work and a short look at the machine."""

import time
from functools import lru_cache

import numpy as np
from scipy import fft

# Nanoseconds on an x86-64 machine of two cores, fitted by benchmarks/calibrate_cost.py; `machine_factor` brings them to
# the machine at hand.
NANOSECONDS = {
    "picture pixel": 65,  # distortion, relative illumination, folding, cutting out the frame
    "step": 3.9e5,  # whatever its size
    "transformed value": 1.0,  # and doubling of the space
    "spectrum value": 1.7,  # weighed, filtered and summed
    "patch pixel": 6.6,  # added to the others
    "tap": 2.7,  # of a pixel's PSF
    "mixed tap": 0.5,  # of a PSF that is mixed from a polar table
    "turned sample": 65,  # of a PSF
    "table sample": 90,  # of a PSF, at one azimuth, for all heights
    "table tap": 4.7,  # at one azimuth and height, at every wavelength
}
REFERENCE_S = 2.5e-3  # of what `machine_factor` does, there
MEGABYTE = 1e6


@lru_cache
def machine_factor():
    """How much slower this machine is than the one of the constants."""
    rng = np.random.default_rng(0)
    spaces, light = rng.random((24, 96, 96), dtype=np.float32), rng.random(1 << 16, dtype=np.float32)
    best = np.inf
    for _ in range(3):
        begin = time.perf_counter()
        fft.irfft2(fft.rfft2(spaces))
        for _ in range(20):
            light * light
        best = min(best, time.perf_counter() - begin)
    return best / REFERENCE_S


class Cost:
    """Counts of one wavelength's work on a picture.

    Parameters
    ----------
    picture_px, work_px : (int, int)
        Rows and columns of the picture; and of the planes, its quadrants where it is folded.
    centre_px : (float, float)
        Row and column of the axis in the planes.
    heights, samples : int
        Field heights of the lens data, and samples of a PSF.
    height_px : float
        From one field height to the next.
    psf_radius_px : int
    tables : float
        Polar tables that each wavelength comes to: they are shared where the lens data have fewer wavelengths.
    """

    def __init__(self, picture_px, work_px, centre_px, heights, height_px, samples, psf_radius_px, tables):
        self._pixels, self._work_px, self._centre_px = picture_px[0] * picture_px[1], work_px, centre_px
        self._quadrant = work_px != picture_px
        self._planes = 4 if self._quadrant else 1
        self._heights, self._height_px, self._samples = heights, height_px, samples
        self._tables = tables
        self._taps = np.pi * (psf_radius_px + 0.5) ** 2

    def seconds(self, plan):
        """Seconds that a plan will take."""
        return machine_factor() * sum(NANOSECONDS[name] * count for name, count in self.counts(plan).items()) * 1e-9

    def counts(self, plan):
        """How much of each kind of work a plan comes to: a dict with keys of NANOSECONDS."""
        azimuths = plan.azimuths * (1 if self._quadrant else 2)
        common = {"picture pixel": self._pixels, "table sample": azimuths * self._samples * self._tables,
                  "table tap": azimuths * self._heights * self._taps}
        if plan.method == "exact":
            return common | {"turned sample": 2 * self._pixels * self._samples}  # not on all cores
        down, across = self._sections(plan.section_size)
        if plan.method == "pixels":
            return common | {"tap": self._pixels * self._taps, "step": down,
                             "mixed tap": self._pixels * self._taps / self._planes}
        if plan.method == "polar":
            weighed, nodes = self._polar_nodes(plan)
            return common | self._transforms(plan, weighed, nodes) | {"step": down * across}
        nodes = {0: 1, 2: (down + 1) * (across + 1)}.get(plan.order, down * across * plan.order**2)
        turned = {"mixed tap": nodes * self._taps} if plan.azimuths else {"turned sample": nodes * self._samples}
        weighed = down * across * max(plan.order, 1) ** 2
        return common | self._transforms(plan, weighed, nodes) | turned | {"step": down}

    def _transforms(self, plan, weighed, nodes):
        """Work on so many weighed sections of one plane, with the OTFs of so many nodes."""
        space, patches = plan.space_px**2, self._planes * np.prod(self._sections(plan.section_size))
        weighed, slowness = weighed * self._planes, 1.9 if plan.single_range == 0 else 1.0
        values = weighed * (plan.section_size * plan.space_px + space) / 2 + (patches + nodes) * space
        return {"transformed value": values * np.log2(plan.space_px) * slowness,
                "spectrum value": weighed * space / 2 * slowness, "patch pixel": patches * space}

    def _polar_nodes(self, plan):
        """How many nodes sections have around them, in all; and how many there are."""
        size = plan.section_size
        rows, columns = ((np.arange(count) + 0.5) * size - centre
                         for count, centre in zip(self._sections(size), self._centre_px))
        radius_px = np.maximum(np.hypot(rows[:, None], columns), size / 2)
        azimuths = plan.azimuths * (2 if self._quadrant else 8) + 1
        across = np.minimum(1.1 * size * plan.azimuths / (np.pi / 4 * radius_px) + 2, azimuths)
        along = min(1.1 * size / self._height_px + 2, self._heights)
        nodes = min(self._heights, radius_px.max() / self._height_px + 2) * azimuths
        return float((along * across).sum()), nodes

    def _sections(self, section_size):
        return tuple(-(-n // section_size) for n in self._work_px)

    def memory_mb(self, plan):
        """Memory beyond radiance and irradiance, with one wavelength in work."""
        value = 8 if plan.precision == "float64" else 4
        table = self._heights * (2 if self._quadrant else 8) * plan.azimuths * self._taps * value
        spectrum = plan.space_px * (plan.space_px // 2 + 1) * 2 * value
        down, across = self._sections(plan.section_size)
        otfs = {"pixels": 12 << 20, "exact": 0, "polar": self._polar_nodes(plan)[1] / 2 * spectrum}.get(
            plan.method, 2 * max(plan.order, 1) ** 2 * across * spectrum)
        return (6 * self._pixels * value + 3 * table + otfs) / MEGABYTE
