"""EXR pictures as other programs write them, and runs of the command on them."""

import numpy as np
import OpenEXR

from lensfield import cli


def colours(path, rgb, shape=(18, 24), prefix="", kind=np.float32, **header):
    """A file with a picture of one colour, or with the given picture."""
    planes = np.moveaxis(np.broadcast_to(np.asarray(rgb), (*shape, 3)) if np.ndim(rgb) < 3 else rgb, -1, 0)
    channels = {f"{prefix}{name}": np.ascontiguousarray(plane, dtype=kind)
                for name, plane in zip("RGB", planes, strict=True)}
    return planes_exr(path, channels, **header)


def planes_exr(path, channels, **header):
    with OpenEXR.File({"type": OpenEXR.scanlineimage} | header, channels) as file:
        file.write(str(path))
    return path


def parts_exr(path, parts):
    """A multi-part file, from the channels of each part and the value of each channel."""
    exr_parts = [OpenEXR.Part({"type": OpenEXR.scanlineimage},
                              {f"{name}.{channel}": np.full((6, 8), value, dtype=np.float16)
                               for channel, value in channels.items()}, name) for name, channels in parts.items()]
    with OpenEXR.File(exr_parts) as file:
        file.write(str(path))
    return path


def window(left, top, columns, rows):
    return np.array([left, top], dtype=np.int32), np.array([left + columns - 1, top + rows - 1], dtype=np.int32)


def run(*arguments):
    return cli.main([str(argument) for argument in arguments])


def failure(capsys, *arguments):
    """The single line that a failing run prints."""
    assert run(*arguments) == 1
    line = capsys.readouterr().err
    assert line.count("\n") == 1
    return line
