"""Raw pictures as Digital Negatives (DNG 1.6), with the camera's colours and noise and the correction of its lens.

The pixels are uncompressed: a mosaic behind filters, otherwise linear planes.
"""

import struct
from dataclasses import dataclass
from fractions import Fraction
from typing import IO, Any

import numpy as np

from ..field.lens_correction import LensCorrection
from ..runtime.build_identity import software
from ..runtime.errors import CameraError, InputError, printable
from ..runtime.files import AnyPath, atomic_path
from ..sensor.camera import Camera
from ..sensor.colour import camera_colour, filter_channels
from ..sensor.exposure import RawImage

VERSION, OLDEST_READER = bytes((1, 6, 0, 0)), bytes((1, 3, 0, 0))
FILTER_CODES = "RGBCMYW"  # a filter's colour in a file is its place among these letters
MOST_CHANNELS = 4
CFA, LINEAR_RAW = 32803, 34892
D65, UPRIGHT, UNCOMPRESSED, RECTANGULAR = 21, 1, 1, 1
WARP_RECTILINEAR, FIX_VIGNETTE_RADIAL = 1, 3
OPCODE_VERSION, OPTIONAL = bytes((1, 3, 0, 0)), 1
MOST_SHORT, MOST_LONG = 2**16 - 1, 2**31 - 1
DENOMINATOR = 100000  # of colours
MARGIN_PX = 2  # of a mosaic, whose outermost pixels converters need but do not show
BYTE, ASCII, SHORT, LONG, RATIONAL, UNDEFINED, SRATIONAL, DOUBLE = 1, 2, 3, 4, 5, 7, 10, 12
FIELDS = {
    "NewSubFileType": (254, LONG), "ImageWidth": (256, LONG), "ImageLength": (257, LONG), "BitsPerSample": (258, SHORT),
    "Compression": (259, SHORT), "PhotometricInterpretation": (262, SHORT), "Make": (271, ASCII), "Model": (272, ASCII),
    "StripOffsets": (273, LONG), "Orientation": (274, SHORT), "SamplesPerPixel": (277, SHORT),
    "RowsPerStrip": (278, LONG), "StripByteCounts": (279, LONG), "PlanarConfiguration": (284, SHORT),
    "Software": (305, ASCII), "CFARepeatPatternDim": (33421, SHORT), "CFAPattern": (33422, BYTE),
    "ExposureTime": (33434, RATIONAL), "FNumber": (33437, RATIONAL), "ExifIFD": (34665, LONG),
    "ISOSpeedRatings": (34855, SHORT), "ExifVersion": (36864, UNDEFINED), "FocalLength": (37386, RATIONAL),
    "LensSpecification": (42034, RATIONAL), "LensModel": (42036, ASCII), "DNGVersion": (50706, BYTE),
    "DNGBackwardVersion": (50707, BYTE), "UniqueCameraModel": (50708, ASCII), "CFAPlaneColor": (50710, BYTE),
    "CFALayout": (50711, SHORT), "BlackLevelRepeatDim": (50713, SHORT), "BlackLevel": (50714, RATIONAL),
    "WhiteLevel": (50717, LONG), "DefaultCropOrigin": (50719, LONG), "DefaultCropSize": (50720, LONG),
    "ColorMatrix1": (50721, SRATIONAL), "AsShotNeutral": (50728, RATIONAL), "CameraSerialNumber": (50735, ASCII),
    "LensInfo": (50736, RATIONAL), "CalibrationIlluminant1": (50778, SHORT), "ActiveArea": (50829, LONG),
    "OpcodeList3": (51022, UNDEFINED), "NoiseProfile": (51041, DOUBLE),
}
"""Codes and types of the fields, by their names in the DNG specification, TIFF/EP (ISO 12234-2) and EXIF."""


@dataclass(frozen=True)
class MountedLens:
    """The lens of a photograph, as its file names it. The file leaves out fields that are "" or None.

    Raises
    ------
    InputError
        A number is not positive.
    """

    name: str
    focal_mm: float | None = None
    f_number: float | None = None

    def __post_init__(self) -> None:
        for field in ("focal_mm", "f_number"):
            value = getattr(self, field)
            if value is not None and not 0 < value < np.inf:
                raise InputError("lens", field, value, "expected a positive number")


def write_dng(raw: RawImage, path: AnyPath, lens: MountedLens | None = None,
              correction: LensCorrection | None = None) -> None:
    """Write a raw picture as a DNG file, which appears complete or not at all.

    The same picture gives the same bytes: the file has no date.

    Parameters
    ----------
    raw : RawImage
    path : path
    lens : MountedLens, optional
    correction : LensCorrection, optional
        Of its lens, in the camera's channels; for converters that apply opcodes.

    Raises
    ------
    CameraError
        DNG has no code for the camera's channels.
    """
    tags = dng_tags(raw, lens, correction)
    with atomic_path(path) as temporary, open(temporary, "wb") as stream:
        write_tiff(stream, tags, dng_samples(raw))


def write_tiff(stream: IO[bytes], tags: dict[str, Any], samples: np.ndarray) -> None:
    """Write a little-endian TIFF with one strip of uint16 samples (row, column), or (row, column, channel).

    Parameters
    ----------
    stream : binary file
    tags : dict
        Values of FIELDS, by name; of `ExifIFD`, a dictionary of the same kind.
    samples : array
    """
    from PIL.TiffImagePlugin import ImageFileDirectory_v2  # only needed here, and rarely

    directory = ImageFileDirectory_v2(prefix=b"II")
    for name, value in tags.items():
        code, directory.tagtype[code] = FIELDS[name]
        directory[code] = {FIELDS[each][0]: of for each, of in value.items()} if isinstance(value, dict) else value
    directory.save(stream)
    stream.write(np.ascontiguousarray(samples, "<u2").data)


def dng_tags(raw: RawImage, lens: MountedLens | None = None, correction: LensCorrection | None = None
             ) -> dict[str, Any]:
    """The values of the fields of a raw picture's file, by name."""
    camera = raw.camera
    tags = _layout(raw) | _identity(camera) | _levels(raw) | _taking(raw, lens)
    order = plane_order(camera)
    if order:
        tags |= _colour(camera, order)
    if raw.exposure.noise:
        tags |= _noise(raw, max(1, len(order)))
    if len(order) > 1 and raw.channel is not None:
        tags |= _mosaic(raw, order)
    if correction and (opcodes := _opcodes(correction, order)):
        tags["OpcodeList3"] = opcodes
    return tags


def plane_order(camera: Camera) -> list[int]:
    """Positions of a camera's channels in the order of a file's planes: red, green, blue. Monochrome: none.

    Raises
    ------
    CameraError
        DNG has no code for a channel, or fewer planes.
    """
    channels = filter_channels(camera)
    if len(channels) == 1:
        return []
    for letter in channels:
        if letter not in FILTER_CODES:
            raise CameraError(f"camera {camera.name}", "channels", letter, f"a DNG has only {', '.join(FILTER_CODES)}")
    if len(channels) > MOST_CHANNELS:
        raise CameraError(f"camera {camera.name}", "channels", channels, f"a DNG has at most {MOST_CHANNELS}")
    return sorted(range(len(channels)), key=lambda index: FILTER_CODES.index(channels[index]))


def check_channels(camera: Camera) -> None:
    """Raise a CameraError unless a file can state a camera's channels and their colours."""
    if plane_order(camera):
        camera_colour(camera)


def dng_samples(raw: RawImage) -> np.ndarray:
    """The samples of a raw picture's file: uint16 array (row, column), or (row, column, plane) without filters."""
    if raw.channel is not None:
        return raw.numbers
    return raw.numbers[plane_order(raw.camera) or [0]].transpose(1, 2, 0)


def _layout(raw):
    rows, columns = raw.numbers.shape[-2:]
    planes = 1 if raw.channel is not None else len(raw.numbers)
    mosaic = raw.channel is not None and len(filter_channels(raw.camera)) > 1
    margin = MARGIN_PX if mosaic and min(rows, columns) > 2 * MARGIN_PX else 0
    return {
        "NewSubFileType": 0, "ImageWidth": columns, "ImageLength": rows, "BitsPerSample": (16,) * planes,
        "Compression": UNCOMPRESSED, "PhotometricInterpretation": CFA if mosaic else LINEAR_RAW,
        "StripOffsets": 0,  # from the end of the directory, to which Pillow adds its place
        "Orientation": UPRIGHT, "SamplesPerPixel": planes, "RowsPerStrip": rows,
        "StripByteCounts": 2 * planes * rows * columns, "PlanarConfiguration": 1,
        "ActiveArea": (0, 0, rows, columns), "DefaultCropOrigin": (margin, margin),
        "DefaultCropSize": (columns - 2 * margin, rows - 2 * margin)}


def _identity(camera):
    """The name of a simulated camera, for which converters have only the data in the file."""
    name = _ascii(camera.title or camera.name)
    return {"Make": "Lensfield", "Model": name, "UniqueCameraModel": f"Lensfield {name}", "Software": software(),
            "DNGVersion": VERSION, "DNGBackwardVersion": OLDEST_READER}


def _ascii(text):
    return printable(text).encode("ascii", "replace").decode()


def _levels(raw):
    planes = 1 if raw.channel is not None else len(raw.numbers)
    return {"BlackLevel": (_rational(raw.dark_dn),) * planes, "WhiteLevel": (raw.highest_dn,) * planes}


def _colour(camera, order):
    colour = camera_colour(camera)
    return {"ColorMatrix1": _decimals(colour.xyz_to_camera[order]), "CalibrationIlluminant1": D65,
            "AsShotNeutral": _decimals(colour.neutral[order])}


def _mosaic(raw, order):
    cell, letters = filter_cell(raw.camera, raw.channel), filter_channels(raw.camera)
    codes = np.array([FILTER_CODES.find(letter) for letter in raw.camera.channels])
    return {"CFARepeatPatternDim": cell.shape, "CFAPattern": codes[cell].astype(np.uint8).tobytes(),
            "CFAPlaneColor": bytes(FILTER_CODES.index(letters[index]) for index in order), "CFALayout": RECTANGULAR,
            "BlackLevelRepeatDim": (1, 1)}  # the default, which RawTherapee 5.9 needs here, and misreads in planes


def filter_cell(camera: Camera, channel: np.ndarray) -> np.ndarray:
    """The smallest cell that repeats over a mosaic from its first pixel: indices of the camera's channels."""
    cell = channel[:len(camera.filters), :len(camera.filters[0])]
    for axis, size in enumerate(cell.shape):
        period = next(n for n in range(1, size + 1)
                      if size % n == 0 and np.array_equal(cell, np.roll(cell, n, axis)))
        cell = cell.take(range(period), axis)
    return cell


def _noise(raw, planes):
    """Variance of the signal x = (number - black) / (white - black): S x + O, the same in all planes."""
    camera, exposure = raw.camera, raw.exposure
    gain, span_dn = camera.gain_at(exposure.iso), raw.highest_dn - raw.dark_dn
    dark_e2 = (camera.dark_noise_at(exposure.iso)**2 + camera.dsnu_e**2
               + camera.dark_current_e_per_s * exposure.shutter_s)
    constant_dn2 = gain**2 * dark_e2 + 1 / 12  # the last from rounding
    return {"NoiseProfile": (gain / span_dn, constant_dn2 / span_dn**2) * planes}


def _taking(raw, lens):
    """How the picture was taken."""
    exposure = raw.exposure
    exif = {"ExifVersion": b"0232", "ExposureTime": _rational(exposure.shutter_s),
            "ISOSpeedRatings": min(max(1, round(exposure.iso)), MOST_SHORT)}
    tags = {"CameraSerialNumber": str(exposure.serial), "ExifIFD": exif}
    if lens and lens.name:
        exif["LensModel"] = _ascii(lens.name)
    if lens and lens.f_number:
        exif["FNumber"] = _rational(lens.f_number)
    if lens and lens.focal_mm:
        exif["FocalLength"] = _rational(lens.focal_mm)
    if lens and lens.focal_mm and lens.f_number:
        tags["LensInfo"] = exif["LensSpecification"] = (exif["FocalLength"],) * 2 + (exif["FNumber"],) * 2
    return tags


def _decimals(values):
    """Fractions of few digits, which are the same on all platforms."""
    return tuple(_ratio(round(float(value) * DENOMINATOR), DENOMINATOR) for value in np.ravel(values))


def _rational(value):
    """The nearest ratio of two integers that a file can hold."""
    value = min(float(value), float(MOST_LONG))
    fraction = Fraction(value).limit_denominator(int(MOST_LONG / max(1.0, value)))
    return _ratio(fraction.numerator, fraction.denominator)


def _ratio(numerator, denominator):
    from PIL.TiffImagePlugin import IFDRational

    return IFDRational(numerator, denominator)


def _opcodes(correction, order):
    """The opcodes of a correction, in big-endian order as in every DNG; empty without any.

    Falloff comes first, because it belongs to the places in the lens's own picture.
    """
    opcodes, centre = [], struct.pack(">2d", *correction.centre)
    if correction.gain is not None:
        opcodes.append(_opcode(FIX_VIGNETTE_RADIAL, struct.pack(">5d", *correction.gain) + centre))
    if correction.warp is not None:
        planes = correction.warp[order or [0]]
        terms = b"".join(struct.pack(">6d", *radial, 0, 0) for radial in planes)  # without tangential terms
        opcodes.append(_opcode(WARP_RECTILINEAR, struct.pack(">I", len(planes)) + terms + centre))
    return struct.pack(">I", len(opcodes)) + b"".join(opcodes) if opcodes else b""


def _opcode(number, parameters):
    return struct.pack(">I4s2I", number, OPCODE_VERSION, OPTIONAL, len(parameters)) + parameters
