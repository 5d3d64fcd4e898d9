"""Small files that are designed to be expensive, with the size, result, processor seconds and memory of each: bombs.py

Each is read in a separate process, which may use 600 MB in addition to its initial memory. The exit status is 1 if a
file is neither read nor rejected, or takes over 600 MB or 1,000 units of work (`fuzz.py`; about 3 s).
"""

import fuzz  # first: sets the tests' module paths, and numpy's threads

# isort: split
import io
import sys
import tempfile
import zipfile
from pathlib import Path

import numpy as np
import OpenEXR
from formats import FIELD, Format, read_as_filter_does, read_full_package
from mutants import members_of, npy, packed

from exr_bytes import attribute, numbered, write_black, write_black_parts
from lens_texts import prescriptions
from lenses import gaussian_psf, make_lens
from lensfield.engine.lens_files import import_lens
from lensfield.engine.lens_files.package import package_bytes
from lensfield.engine.measured.files import read_measured
from lensfield.engine.prescription.readers import ReadingOptions, read_prescription
from lensfield.engine.spectral.refraction import load_refraction
from lensfield.engine.spectral.spectra import load_spectrum, parse_wavelengths
from measured_files import OPTIONS
from rgb_files import colours, window

MOST_UNITS = 1000


def bombs(folder):
    """(description, file, reader) of each."""
    def written(name, data):
        (folder / name).write_bytes(data if isinstance(data, bytes) else data.encode())
        return folder / name

    for what, data in packages():
        yield what, written("lens.npz", data), read_full_package
    yield "lens.toml whose key has 30,000 parts", written("lens.toml", ".".join("a" * 30000) + " = 1"), prescription
    yield "lens.toml nested 100,000 deep", written("lens.toml", "a = " + "[" * 10**5), prescription
    yield "lens.json nested 100,000 deep", written("lens.json", '{"a":' * 10**5), prescription
    for name, text in prescriptions(30_000):
        yield f"{name} of 30,000 surfaces", written(name, text), prescription
    yield ".mat that says it has 2 GB", written("optics.mat", mat_bytes()), import_lens
    picture = folder / "picture.exr"
    colours(picture, (1, 1, 1), (8, 8), displayWindow=window(0, 0, 10000, 10000))
    yield "EXR of 8 x 8 in a display window of 10,000 x 10,000", picture, read_as_filter_does
    colours(picture, (0, 0, 0), (1024, 2048), compression=OpenEXR.DWAB_COMPRESSION)
    yield "EXR of 2,048 x 1,024, black", picture, read_as_filter_does
    yield "EXR of a million channels", write_black(picture, numbered(10**6)), read_as_filter_does
    yield "EXR of 20,000 parts", write_black_parts(picture, 20_000), read_as_filter_does
    yield "EXR with a text of 50 MB", write_black(picture, [b"Y"], attribute(b"a", b"string", b"a" * (50 << 20))), \
        read_as_filter_does
    yield ".spd of one line", written("lamp.spd", "1" * 10**7), spectrum
    yield ".spd of 25 MB", written("lamp.spd", "400 1\n" * 2**21 * 2), spectrum
    yield ".yml nested 100,000 deep", written("glass.yml", "[" * 10**5), lambda path: load_refraction(str(path))
    for what, text in measured_texts():
        yield what, written(what.split()[0], text), measured
    colours(folder / "distort.exr", (0.5, 0.5, 0), (8, 8), displayWindow=window(0, 0, 10000, 10000))
    yield "STMap of 8 x 8 in a display window of 10,000 x 10,000", folder / "distort.exr", measured
    for what, text in (("a million digits", "1" * 10**6), ("a path in nobody's home", "~nobody-at-all/x.spd")):
        yield f"{what} as a spectrum", written("line.txt", text), lambda path: load_spectrum(path.read_text())
        yield f"{what} as wavelengths", written("line.txt", text), lambda path: parse_wavelengths(path.read_text())


def packages():
    """Lens packages: with an unknown member, with enormous PSFs, with a deeply nested header."""
    members = members_of(package_bytes(make_lens(gaussian_psf(2, 3, 1.0, 9))))
    yield "lens package with 270 MB of junk", with_member(members, "junk.npy", (2**28,), 2**28)
    psf = {name: data for name, data in members.items() if name != "psf_amplitude.npy"}
    yield "lens package with 275 MB of PSFs", with_member(psf, "psf_amplitude.npy", (2, 11, 2500, 2500), 275_000_000)
    header = np.load(io.BytesIO(members["header.npy"])).item().replace('"efl_mm": ', '"efl_mm": ' + "[" * 10**5)
    yield "lens package with a header nested 100,000 deep", packed(members | {"header.npy": npy(np.array(header))})


def measured_texts():
    """Files of measured lenses: nested deeply, with aliases or entities that expand, and with many entries."""
    aliases = "\n".join(f"a{number}: &a{number} [{', '.join(9 * [f'*a{number - 1}'])}]" for number in range(1, 12))
    yield "aliases.yml with 9^11 aliases", f"a0: &a0 x\n{aliases}\nwidth: 9\nheight: 9\ncamera_matrix: *a11\n"
    yield "deep.yml nested 100,000 deep", "[" * 10**5
    yield "deep.json nested 100,000 deep", '{"a":' * 10**5
    yield "deep.xml nested 100,000 deep", "<a>" * 10**5 + "</a>" * 10**5
    entities = "".join(f'<!ENTITY e{number} "{9 * f"&e{number - 1};"}">' for number in range(1, 12))
    yield ("entities.xml with 9^11 entities",
           f'<!DOCTYPE a [<!ENTITY e0 "x">{entities}]><lensdatabase>&e11;</lensdatabase>')
    yield "lenses.xml of 30,000 lenses", f"<lensdatabase>{30_000 * '<lens><model>A</model></lens>'}</lensdatabase>"
    yield "cameras.txt of 200,000 cameras", "".join(f"{number} PINHOLE 9 9 1 1 1 1\n" for number in range(200_000))


def with_member(members, name, shape, size):
    """A package with a member that contains `size` zero bytes."""
    header = io.BytesIO()
    kind = "|u1" if name == "junk.npy" else "<u2"
    np.lib.format.write_array_header_1_0(header, {"descr": kind, "fortran_order": False, "shape": shape})
    stream = io.BytesIO(packed(members))
    with zipfile.ZipFile(stream, "a", zipfile.ZIP_DEFLATED) as archive:
        with archive.open(name, "w", force_zip64=True) as member:
            member.write(header.getvalue())
            for begin in range(0, size, 2**24):
                member.write(bytes(min(2**24, size - begin)))
    return stream.getvalue()


def mat_bytes():
    from test_iset_mat import with_stated_size

    with tempfile.TemporaryDirectory() as folder:
        return with_stated_size(Path(folder) / "optics.mat", 2**31).read_bytes()


def prescription(path):
    return read_prescription(path, ReadingOptions(FIELD))


def measured(path):
    return read_measured(path, OPTIONS)


def spectrum(path):
    return load_spectrum(str(path))


def main():
    sys.path.insert(0, str(fuzz.TESTS / "engine/lens_files"))
    bad = 0
    with tempfile.TemporaryDirectory(prefix="lensfield-bombs-") as folder:
        for what, path, read in bombs(Path(folder)):
            kind = Format([], read, chatters=True)
            outcome, taken_s, taken_bytes = fuzz.read_within(MOST_UNITS, kind, (path.name, {}), path.parent)
            verdict = outcome.partition(": ")[0]
            bad += verdict not in (fuzz.READ, fuzz.REJECTED)
            print(f"{what:<52}{path.stat().st_size / 1e3:10.1f} kB   {verdict:<8} {taken_s:5.2f} s "
                  f"{taken_bytes / 2**20:5.0f} MB", flush=True)
    sys.exit(bad > 0)


if __name__ == "__main__":
    main()
