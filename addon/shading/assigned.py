"""Spectra and refractive indices that the user assigned to materials, lights and worlds, by name, file or pairs."""

import os
from functools import cache

import bpy

from lensfield.engine.runtime.errors import InputError
from lensfield.engine.spectral.refraction import load_refraction, refraction_names
from lensfield.engine.spectral.spectra import BAND_NM, is_user_file, load_spectrum

from ..scene.errors import SceneError
from ..scene.trust import check_trusted

LOADERS = {"reflectance": load_spectrum, "emission": load_spectrum, "refraction": load_refraction}
EXPECTED = dict.fromkeys(("reflectance", "emission"), "expected two columns, wavelength in nm and value") | {
    "refraction": "expected a YAML file from refractiveindex.info"}
WORDS = {"reflectance": "reflectance spectrum", "emission": "emission spectrum", "refraction": "refraction"}


class AssignedSpectra:
    """Reads the Lensfield Spectra of data-blocks, each text once.

    Parameters
    ----------
    wavelengths_nm : sequence of float
        The wavelengths for which refractive indices are needed.
    dispersion : bool
        Whether glass takes its index at each of them, or the index at the D line for all.
    """

    def __init__(self, wavelengths_nm=(), dispersion=True):
        self._read, self._wavelengths_nm, self._dispersion = {}, wavelengths_nm, dispersion

    def of(self, data_block, field):
        """The spectrum or refraction that a field of a data-block names; None if it is empty or has an error."""
        return self._outcome(data_block, field)[0]

    def error_of(self, data_block, field):
        """The SceneError of a field with an unusable text, or None.

        A text is unusable if it cannot be read, if an emission has zero power in BAND_NM, or if a refraction does not
        cover the wavelengths for which it is needed.
        """
        error = self._outcome(data_block, field)[1]
        return error and SceneError(f"{data_block.rna_type.name.lower()} {data_block.name!r}", WORDS[field],
                                    getattr(data_block.lensfield, field).strip(),
                                    f"{error.field} {error.value}: {error.remedy}")

    def errors(self, data_blocks):
        """All errors of these data-blocks."""
        field_errors = [self.error_of(block, field) for block in data_blocks for field in fields_of(block)]
        return [error for error in field_errors if error]

    def _outcome(self, data_block, field):
        text = getattr(data_block.lensfield, field).strip()
        if not text:
            return None, None
        key = field, text, data_block.library  # paths are relative to the data-block's .blend
        if key not in self._read:
            self._read[key] = self._load(data_block, field, text)
        return self._read[key]

    def _load(self, data_block, field, text):
        """The spectrum or refraction that a text names, and None; or None and the InputError."""
        try:
            if path := spectrum_path(data_block, field):
                check_trusted(path, text, WORDS[field], EXPECTED[field])
            # Blender writes paths relative to the .blend as //name.
            loaded = LOADERS[field](bpy.path.abspath(text, library=data_block.library), _folder(data_block))
            if field == "emission":
                loaded.density_at(BAND_NM)
            if field == "refraction":
                self._check_refraction(loaded)
        except InputError as error:
            return None, error
        return loaded, None

    def _check_refraction(self, refraction):
        if refraction.metal:
            refraction.reflectance_at(self._wavelengths_nm)
        elif self._dispersion and refraction.dispersive:
            refraction.n_at(self._wavelengths_nm)


def named_spectra():
    """Paths of the files that data-blocks name, without accessing them."""
    return [path for block in (*bpy.data.materials, *bpy.data.lights, *bpy.data.worlds) for field in fields_of(block)
            if (path := spectrum_path(block, field))]


def spectrum_path(data_block, field):
    """The path of the file that a field of a data-block names; "" for a library name, pairs, or an empty field."""
    text = getattr(data_block.lensfield, field).strip()
    if not text or not (text not in _refractions() if field == "refraction" else is_user_file(text)):
        return ""
    return os.path.join(_folder(data_block), bpy.path.abspath(text, library=data_block.library))


def _folder(data_block):
    """The folder that a data-block's relative paths start from."""
    return bpy.path.abspath("//", library=data_block.library)


@cache
def _refractions():
    return frozenset(refraction_names())


def fields_of(data_block):
    """The spectrum and refraction fields that a data-block has."""
    return [field for field in LOADERS if hasattr(getattr(data_block, "lensfield", None), field)]
