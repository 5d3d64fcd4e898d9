"""Lens data as lens-design programs and their macros write them, for tests of the readers."""

import json
from functools import partial

import numpy as np
import pytest
from scipy.io import savemat

from lenses import gaussian_psf, make_lens
from lensfield.engine import LensError
from places import SHARED_DATA

VENDOR_EXPORTS = SHARED_DATA / "vendor_exports"
ENCODINGS = ("utf-8", "utf-8-sig", "latin-1", "utf-16", "utf-16-le", "utf-16-be")


def vendor_export(name):
    """A real export; the test is skipped if it is not available."""
    path = VENDOR_EXPORTS / name
    if not path.exists():
        pytest.skip(f"the vendor exports are not in {VENDOR_EXPORTS}")
    return path


def exported_lens(waves=2, heights=3, window=9, **changes):
    """A small lens whose tables differ everywhere and whose PSFs distinguish up from down and left from right."""
    nm, heights_mm = np.linspace(450.0, 650.0, waves), np.linspace(0, 3, heights)
    mark = np.zeros((waves, heights, window, window))
    mark[..., window // 2 + 3, window // 2 + 2] = 0.2 + 0.1 * np.arange(heights)
    mark[..., window // 2 + 2, window // 2 - 1] = 0.1 * np.arange(1, waves + 1)[:, None]
    psf = gaussian_psf(0.6, 0.4, 0.5, window) + mark
    facts = dict(psf=psf / psf.sum(axis=(2, 3), keepdims=True), wavelengths_nm=nm, heights_mm=heights_mm,
                 real_height_mm=lambda nm, p: p * (1 - 0.01 * p - nm / 1e5),
                 relative_illumination=lambda nm, p: 1 - 0.02 * p**2 - nm * p / 1e5, psf_pitch_um=0.5,
                 entrance_pupil_mm=4.0, sensor_mm=(4.8, 3.6))
    return make_lens(**facts | changes)


def upright(psf, image_side):
    """A PSF (v, u) as in the image plane, rows ascending with y, for an image point on that side of the axis."""
    return psf if image_side == "+y" else np.roll(psf[::-1, ::-1], 1 - psf.shape[0] % 2, axis=(0, 1))


def matrix_text(values, digits=6, comma=False, separator="\t"):
    """Rows of numbers with three-digit exponents, as Zemax writes them."""
    lines = [separator.join(f"{value:.{digits}E}".replace("E-", "E-0").replace("E+", "E+0") for value in row)
             for row in values]
    text = "\n".join(lines) + "\n"
    return text.replace(".", ",") if comma else text


def huygens_listing(values, pitch_um, wavelength_nm, y_mm, comma=False, leave_out=(), units=""):
    """A Huygens listing of an upright PSF with its chief ray at [n // 2, n // 2].

    OpticStudio's own listings have the largest y first, and their centre, "33, 33" of 64, is column 33 from the left
    and row 33 *from the bottom*: about that point, and not about row 33 from the top, PSFs on the axis are symmetric,
    and off-axis PSFs have the centroid that the listing itself states.
    """
    n = len(values)
    header = [
        "Listing of Huygens PSF Data", "", "File : C:\\ZEMAX\\LENS.ZMX", "Title: a lens", "Date : TUE AUG 30 2005", "",
        "", "HUYGENS PSF", f"{wavelength_nm / 1e3:.4f} µm at {-27.38 if y_mm < 0 else 27.38:.2f} deg.",
        f"Data spacing is {pitch_um:.3f} µm.", f"Data area is {n * pitch_um:.3f} by {n * pitch_um:.3f} µm.",
        "Strehl ratio: 0.486", "Pupil grid size: 32 by 32", f"Image grid size: {n} by {n}",
        f"Center point is: {n // 2 + 1}, {n // 2 + 1}", f"Center coordinates: 0.00000000E+000, {y_mm:.8E}{units}",
        "Values are relative intensity.", ""]
    lines = [line for line in header if not any(line.startswith(start) for start in leave_out)]
    text = "\n".join(lines) + "\n"
    return (_with_commas(text) if comma else text) + matrix_text(values[::-1], comma=comma)


def fft_listing(values, pitch_um, wavelength_nm, y_mm, comma=False, full=None):
    """An FFT listing of an upright PSF with its chief ray at [n // 2 - 1, n // 2 - 1].

    OpticStudio counts the row from the top and the column from the left: "row 33, column 32" of 64. `full` is the size
    of the grid; the listing contains its middle.
    """
    n = len(values)
    full = full or n
    header = "\n".join([
        "Listing of FFT PSF Data", "", "File : C:\\ZEMAX\\LENS.ZMX", "", "FFT PSF",
        f"{wavelength_nm / 1e3:.4f} to {wavelength_nm / 1e3:.4f} µm at 0.0000, 1.2250 (deg).",
        f"Data spacing is {pitch_um:.3f} µm.", f"Data area is {n * pitch_um:.3f} µm wide.", "Surface: Image",
        f"Reference Coordinates: 0.00000E+00, {y_mm:.5E}", "Pupil grid size: 32 by 32",
        f"Image grid size: {full} by {full}", f"Center point is: row {full // 2 + 1}, column {full // 2}",
        "Values are not normalized.", "", ""])
    return (_with_commas(header) if comma else header) + matrix_text(values[::-1], comma=comma)


def _with_commas(text):
    """Replace decimal points between digits by commas."""
    return "".join("," if letter == "." and text[at - 1].isdigit() and text[at + 1:at + 2].isdigit() else letter
                   for at, letter in enumerate(text))


def table_text(table, columns=True):
    """A table (wavelength, height) as macros write it: a row for each height, or one value on each line."""
    return matrix_text(table.T, separator=" ") if columns else matrix_text(table.T.reshape(-1, 1))


def iset_bundle(folder, lens, image_side="-y", encoding="latin-1", columns=True, base="LENS", two_d=False):
    """A bundle as the macros for Zemax write it; returns its parameter file."""
    folder.mkdir(parents=True, exist_ok=True)
    waves, heights = lens.wavelengths_nm, lens.heights_mm
    fov = np.degrees(np.arctan(heights[-1] / lens.capture_focal_length_mm))
    distance = min(lens.object_distance_mm, 1e10)
    files = {
        "ISETPARMS.TXT": f"%   C:\\PROGRAM FILES\\ZEMAX\\LENSES\\{base}.ZMX\n"
                         f"lensFile='{base}.ZMX';     %Lens file name\n"
                         f"psfSize={lens.psf.shape[-1]};                 % PSF ROW AND COL SIZE\n"
                         f"psfSpacing={lens.psf_pitch_um / 1e3:.7f};   % PSF GRID SPACING IN MM\n"
                         f"wave={waves[0]:.0f}:{waves[1] - waves[0]:.0f}:{waves[-1]:.0f};        % WAVELENGTHS (NM)\n"
                         f"imgHeightNum={heights.size};             % Number of IMAGE HEIGHTS\n"
                         f"imgHeightMax={heights[-1]:.7f};     % Maximum IMAGE HEIGHT (MM)\n"
                         f"objDist={distance:.3f};                 % OBJECT DISTANCE (MM)\n"
                         f"mag={lens.magnification:.6f};          % OPTICAL SYSTEM MAGNIFICATION\n"
                         f"baseLensFileName='C:\\Program Files\\ZEMAX\\ISET\\{base}\\{base}'\n"
                         f"refWave={lens.reference_wavelength_nm:.3f};          % REFERENCE WAVELENGTH (NM)\n"
                         f"fov={fov:.6f};          % MAXIMUM DIAGONAL HALF FOV (DEGREE)\n"
                         f"efl={lens.efl_mm:.6f};          % EFFECTIVE FOCAL LENGTH\n"
                         f"fnumber_eff={lens.f_number_effective:.6f};          % EFFECTIVE F-NUMBER\n"
                         "fnumber=1.774644;          % F-NUMBER",
        f"{base}_DI_.dat": table_text(lens.real_height_mm, columns),
        f"{base}_RI_.dat": table_text(lens.relative_illumination, columns),
        f"{base}_CRA_.dat": table_text(np.zeros_like(lens.real_height_mm), columns)}
    name = "{}_2D_PSF_Fld{}_Wave{}.dat" if two_d else "{}_PSF_{}_{}.dat"
    sign = 1 if image_side == "+y" else -1
    for w, nm in enumerate(waves):
        for h in range(heights.size):
            values = upright(lens.psf[w, h], image_side)
            files[name.format(base, h + 1, w + 1)] = huygens_listing(values, lens.psf_pitch_um, nm,
                                                                     sign * lens.real_height_mm[w, h])
    for file, text in files.items():
        (folder / file).write_bytes(text.encode(encoding))
    return folder / "ISETPARMS.TXT"


def code_v_bundle(folder, lens, base="rtLENS"):
    """A bundle as the macro for CODE V writes it; returns its parameter file."""
    folder.mkdir(parents=True, exist_ok=True)
    waves, heights = lens.wavelengths_nm, lens.heights_mm
    fov = np.degrees(np.arctan(heights[-1] / lens.capture_focal_length_mm))
    lines = [
        "%   C:\\ORA\\CODEV\\LENS\\LENS", "lensFile='LENS'",
        f"psfSize={lens.psf.shape[-1]}\t     % PSF ROW AND COL SIZE",
        f"psfSpacing={lens.psf_pitch_um / 1e3}\t   % PSF GRID SPACING IN MM",
        f"wave={waves[0]:g}:{waves[1] - waves[0]:g}:{waves[-1]:g}\t            % WAVELENGTH SAMPLES (NM)",
        f"imgHeight=0:{heights[1]:.4g}:{heights[-1]:g}\t     % PARAXIAL IMAGE HEIGHTS (MM)",
        f"objDist={lens.object_distance_mm:g}", f"mag={lens.magnification}", f"baseLensFileName='{base}'",
        f"refWave={lens.reference_wavelength_nm}", f"fov={fov}", f"efl={lens.efl_mm}", "fnumber=1.9",
        f"fnumber_eff={lens.f_number_effective}"]
    (folder / f"{base}_ISETPARMS.TXT").write_text("\r\n".join(lines), encoding="ascii")
    (folder / f"{base}_DI_.dat").write_text(table_text(lens.real_height_mm))
    (folder / f"{base}_RI_.dat").write_text(table_text(lens.relative_illumination))
    for w in range(waves.size):
        for h in range(heights.size):
            (folder / f"{base}_PSF_{h + 1}_{w + 1}.dat").write_text(matrix_text(100 * lens.psf[w, h]))
    return folder / f"{base}_ISETPARMS.TXT"


def export_folder(folder, lens, program="zemax", image_side="+y", overrides=(), **changes):
    """An export folder with plain tables; returns its lens.toml. `overrides` replaces fields; None omits them."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "real_height.txt").write_text(table_text((-1 if image_side == "-y" else 1) * lens.real_height_mm))
    (folder / "ri.txt").write_text(table_text(lens.relative_illumination))
    ending = "json" if program == "zospy" else "txt"
    for w, nm in enumerate(lens.wavelengths_nm):
        for h in range(lens.heights_mm.size):
            values = upright(lens.psf[w, h], image_side)
            y_mm = (-1 if image_side == "-y" else 1) * lens.real_height_mm[w, h]
            text = (huygens_listing(values, lens.psf_pitch_um, nm, y_mm) if program == "zemax" else
                    matrix_text(100 * values, separator="  ") if program == "codev" else
                    zospy_json(values, lens.psf_pitch_um))
            (folder / f"psf_{h + 1}_{w + 1}.{ending}").write_text(text, encoding="utf-8")
    fields = {"format": "lensfield-export", "version": 1, "program": program, "name": "Tessar ½", "source": "a patent",
              "image_side": image_side, "real_height": "real_height.txt", "relative_illumination": "ri.txt",
              "psf": f"psf_{{height}}_{{wavelength}}.{ending}", "wavelengths_nm": lens.wavelengths_nm.tolist(),
              "heights_mm": lens.heights_mm.tolist(), "psf_pitch_um": lens.psf_pitch_um,
              **{field: getattr(lens, field) for field in (
                  "efl_mm", "magnification", "f_number_effective", "entrance_pupil_mm", "object_distance_mm",
                  "reference_wavelength_nm")}}
    write_description(folder / "lens.toml", fields | changes | dict(overrides))
    return folder / "lens.toml"


def write_description(path, fields):
    """TOML of plain values."""
    lines = [f"{field} = {json.dumps(value, ensure_ascii=False) if isinstance(value, str) else value}"
             for field, value in fields.items() if value is not None]
    path.write_text("\n".join(lines).replace("True", "true") + "\n", encoding="utf-8")


def zospy_labels(count, pitch_um, centre):
    """ZOSPy's labels for the samples of an axis: the chief ray's is half a sample."""
    return ((np.arange(count) - centre + 0.5) * pitch_um).round(10)


def zospy_json(values, pitch_um=1.0, index=None, columns=None, header=(), **settings):
    """The JSON of a Huygens result, for an upright PSF with its chief ray at [n // 2, n // 2].

    `index` and `columns` replace the labels of its rows and columns.
    """
    usual = zospy_labels(len(values), pitch_um, len(values) // 2)
    return json.dumps({
        "data": {"index": np.asarray(usual if index is None else index).tolist(),
                 "columns": np.asarray(usual if columns is None else columns).tolist(),
                 "data": np.asarray(values).tolist(), "index_names": ["y"], "column_names": ["x"]},
        "settings": {"pupil_sampling": "64x64", "psf_type": "Linear", "rotation": 0, "use_centroid": False} | settings,
        "metadata": {"FeatureDescription": "Listing of Huygens PSF Data\n\n"}, "header": list(header), "messages": []})


def damages(data, count, seed=3):
    """Yield `count` variants of data with bytes changed, inserted, removed or cut off."""
    rng = np.random.default_rng(seed)
    for number in range(count):
        damaged = bytearray(data)
        at = int(rng.integers(len(damaged)))
        kind = number % 6
        if kind == 0:
            damaged[at] ^= int(rng.integers(1, 256))
        elif kind == 1:
            del damaged[at:]
        elif kind == 2:
            for place in rng.integers(len(damaged), size=20):
                damaged[place] = int(rng.integers(256))
        elif kind == 3:
            damaged[at:at] = [b"nan", b"-1e999", b"9" * 400, b"\0", b"\n\n", b"1 2 3", b";" * 9, b"'"][number // 6 % 8]
        elif kind == 4:
            del damaged[at:at + int(rng.integers(1, 40))]
        else:
            damaged[at:at + 8] = rng.bytes(8)
        yield bytes(damaged)


def _mat(folder, lens):
    folder.mkdir(exist_ok=True)
    return saved(folder / "optics.mat", ray_trace(lens))


EXPORTS = {
    "ISET bundle": iset_bundle,
    "ISET bundle of 2013": partial(iset_bundle, columns=False, two_d=True, encoding="utf-16"),
    "Code V bundle": code_v_bundle,
    "ISETCam .mat": _mat,
    "export folder of zemax": partial(export_folder, program="zemax", image_side="-y"),
    "export folder of codev": partial(export_folder, program="codev"),
    "export folder of zospy": partial(export_folder, program="zospy")}
"""Functions (folder, lens) that write every kind of file that `import_lens` reads, and return its path."""


def check_that_damage_is_harmless(path, read, count=200):
    """Check that damaged versions of a file are read, or rejected by a LensError of one line; then restore the file."""
    sound = path.read_bytes()
    for damaged in damages(sound, count):
        path.write_bytes(damaged)
        try:
            read()
        except LensError as error:
            assert "\n" not in str(error) and "\r" not in str(error)
    path.write_bytes(sound)


def check_same_lens(read, lens, digits=6):
    """Compare the tables of a lens, to the precision of listings; PSF windows may differ in size."""
    np.testing.assert_allclose(read.wavelengths_nm, lens.wavelengths_nm)
    np.testing.assert_allclose(read.heights_mm, lens.heights_mm, atol=1e-6)
    np.testing.assert_allclose(read.real_height_mm, lens.real_height_mm, atol=2 * 10.0**-digits)
    np.testing.assert_allclose(read.relative_illumination, lens.relative_illumination, atol=2 * 10.0**-digits)
    assert read.psf_pitch_um == pytest.approx(lens.psf_pitch_um)
    reach = min(read.psf.shape[-1] // 2, (lens.psf.shape[-1] - 1) // 2)
    np.testing.assert_allclose(_about_centre(read.psf, reach), _about_centre(lens.psf, reach), atol=2e-6)


def _about_centre(psf, reach):
    """PSFs in a window about the chief ray, normalised to unit sum there."""
    centre = psf.shape[-1] // 2
    window = psf[..., centre - reach:centre + reach + 1, centre - reach:centre + reach + 1].astype(float)
    return window / window.sum(axis=(2, 3), keepdims=True)


def ray_trace(lens, program="Zemax", centre=None):
    """The structure that ISETCam's rtImportData creates."""
    side = "+y" if program == "Code V" else "-y"
    axes = {"fieldHeight": lens.heights_mm[:, None], "wavelength": lens.wavelengths_nm[:, None]}
    psf = np.stack([[upright(lens.psf[w, h], side) for w in range(lens.wavelengths_nm.size)]
                    for h in range(lens.heights_mm.size)]).transpose(2, 3, 0, 1)  # (row, column, height, wavelength)
    if centre is not None:
        psf = np.roll(psf, centre - psf.shape[0] // 2, axis=(0, 1))
    half_field = np.degrees(np.arctan(lens.heights_mm[-1] / lens.capture_focal_length_mm))
    return {"program": program, "lensFile": "EO54852.ZMX", "referenceWavelength": lens.reference_wavelength_nm,
            "objectDistance": lens.object_distance_mm, "mag": lens.magnification, "fNumber": 1.77,
            "effectiveFocalLength": lens.efl_mm, "effectiveFNumber": lens.f_number_effective, "maxfov": half_field,
            "geometry": axes | {"function": lens.real_height_mm.T},
            "relIllum": axes | {"function": lens.relative_illumination.T},
            "psf": axes | {"function": psf.astype(float), "sampleSpacing": np.full((1, 2), lens.psf_pitch_um / 1e3)}}


def saved(path, structure, within=("optics", "rayTrace")):
    for name in reversed(within):
        structure = {name: structure, "name": "raytrace", "model": "rayTrace"}
    savemat(path, structure)
    return path
