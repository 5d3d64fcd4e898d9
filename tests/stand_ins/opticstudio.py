"""A stand-in for zospy, connected to an OpticStudio that has a `LensInProgram` loaded.

It knows what the export script may use, by the names in zospy 2.2 and its stubs of the ZOS-API; anything else is an
AttributeError or TypeError.
"""

import json
from types import ModuleType, SimpleNamespace

from lens_program import ENTRANCE_PUPIL_MM, MARGINAL_COSINE, OUTERMOST_MM

OPERANDS = ("EFFL", "PMAG", "ENPP", "PIMH", "REAB", "REAY", "RELI")
FIELD_VALUES = {"X": 0.0, "Y": 0.0, "Weight": 1.0, "VDX": 0.0, "VDY": 0.0, "VCX": 0.0, "VCY": 0.0, "VAN": 0.0,
                "TAN": 0.0, "Comment": "", "Ignore": False}
HUYGENS_SETTINGS = {"pupil_sampling": "32x32", "image_sampling": "32x32", "image_delta": 0.0, "rotation": 0,
                    "wavelength": "All", "field": 1, "psf_type": "Linear", "show_as": "Surface",
                    "use_polarization": False, "use_centroid": False, "normalize": False}


def zospy_modules(studio):
    """{name: module} to stand in for zospy and the submodules that the script imports."""
    zospy, analyses, psf = (ModuleType(name) for name in ("zospy", "zospy.analyses", "zospy.analyses.psf"))
    zospy.ZOS = lambda: SimpleNamespace(connect=studio.connect)
    zospy.constants = SimpleNamespace(
        Editors=SimpleNamespace(MFE=SimpleNamespace(MeritOperandType=SimpleNamespace(**{n: n for n in OPERANDS}))),
        SystemData=SimpleNamespace(FieldType=SimpleNamespace(ParaxialImageHeight="paraxial image height"),
                                   ZemaxSystemUnits=SimpleNamespace(Millimeters=0)))
    psf.HuygensPSF = HuygensPSF
    return {"zospy": zospy, "zospy.analyses": analyses, "zospy.analyses.psf": psf}


class OpticStudio:
    """What `zos.connect` returns; `connections`, `loaded` and `psfs` tell what was asked of it."""

    def __init__(self, lens, system_file, title=""):
        self.lens, self.SystemFile = lens, system_file
        self.connections, self.loaded, self.psfs = [], [], []
        self.SystemData = SimpleNamespace(
            Fields=Fields(lens), Wavelengths=Wavelengths(lens), Units=SimpleNamespace(LensUnits=lens.units),
            TitleNotes=SimpleNamespace(Title=title))
        self.LDE = SimpleNamespace(NumberOfSurfaces=5, GetSurfaceAt=lambda n: SimpleNamespace(
            Thickness=lens.thickness(n), Radius=1 / (lens.curvature(n) or 1e-99)))
        self.MFE = SimpleNamespace(GetOperandValue=self.operand)

    def connect(self, mode):
        self.connections.append(mode)
        return self

    def load(self, path):
        self.loaded.append(path)

    def operand(self, kind, surface, wave, hx, hy, px, py, ex, ey):
        nm = self.lens.wavelengths_nm[wave - 1] if wave else self.lens.nm
        heights = [field.Y for field in self.SystemData.Fields.all]
        if kind in ("REAB", "REAY", "RELI"):
            self.check_traceable()
        if kind == "RELI":
            return 0.9 * self.lens.relative_illumination(heights[int(hx) - 1])
        if kind in ("REAB", "REAY"):
            assert surface == 4
        return {"EFFL": lambda: self.lens.efl_mm(nm), "PMAG": lambda: self.lens.magnification(nm),
                "ENPP": lambda: ENTRANCE_PUPIL_MM, "PIMH": lambda: -OUTERMOST_MM,
                "REAB": lambda: -MARGINAL_COSINE * py,
                "REAY": lambda: self.image_y(hy * max(heights, key=abs))}[kind]()

    def image_y(self, height):
        return 0.0 if self.lens.lost(height) else self.lens.real_height(height)

    def check_traceable(self):
        """The program answers for one wavelength and paraxial image heights, vignetting included."""
        assert len(self.lens.wavelengths_nm) == self.lens.primary == 1
        assert self.lens.field_type == "paraxial image height" and self.lens.vignetting_set


class Field:
    __slots__ = (*FIELD_VALUES, "lens")

    def __init__(self, lens, **values):
        object.__setattr__(self, "lens", lens)
        for name, value in (FIELD_VALUES | values).items():
            object.__setattr__(self, name, value)

    def __setattr__(self, name, value):
        if not isinstance(value, type(FIELD_VALUES[name])):
            raise TypeError(f"{name}: {value!r}")  # as .NET does
        object.__setattr__(self, name, value)
        self.lens.vignetting_set = False

    def values(self):
        return {name: getattr(self, name) for name in FIELD_VALUES}


class Fields:
    def __init__(self, lens):
        self.lens, self.all = lens, [Field(lens, **values) for values in lens.fields]

    @property
    def NumberOfFields(self):
        return len(self.all)

    def GetField(self, n):
        return self.all[n - 1] if 1 <= n <= len(self.all) else None

    def AddField(self, x, y, weight):
        self.all.append(Field(self.lens, X=x, Y=y, Weight=weight))

    def RemoveField(self, n):
        del self.all[n - 1]
        return True

    def GetFieldType(self):
        return self.lens.field_type

    def SetFieldType(self, kind):
        self.lens.field_type = kind

    def SetVignetting(self):
        for field in self.all:
            object.__setattr__(field, "VCY", abs(field.Y) / 100)
        self.lens.vignetting_set = True


class Wavelength:
    def __init__(self, lens, n):
        self.__dict__.update(lens=lens, n=n)

    def __getattr__(self, name):
        return {"Wavelength": self.lens.wavelengths_nm[self.n - 1] / 1000, "Weight": 1.0,
                "IsPrimary": self.n == self.lens.primary}[name]

    def __setattr__(self, name, value):
        if name == "Weight":
            assert value == 1.0
        else:
            assert name == "Wavelength"
            self.lens.wavelengths_nm[self.n - 1] = 1000 * value

    def MakePrimary(self):
        self.lens.primary = self.n


class Wavelengths:
    def __init__(self, lens):
        self.lens = lens

    @property
    def NumberOfWavelengths(self):
        return len(self.lens.wavelengths_nm)

    def GetWavelength(self, n):
        return Wavelength(self.lens, n)

    def AddWavelength(self, um, weight):
        assert weight == 1.0
        self.lens.wavelengths_nm.append(1000 * um)

    def RemoveWavelength(self, n):
        assert n != self.lens.primary
        del self.lens.wavelengths_nm[n - 1]
        return True


class HuygensPSF:
    def __init__(self, **settings):
        assert settings.keys() <= HUYGENS_SETTINGS.keys()
        self.settings = HUYGENS_SETTINGS | settings

    def run(self, oss):
        oss.check_traceable()
        height = oss.SystemData.Fields.GetField(self.settings["field"]).Y
        oss.psfs.append((oss.lens.nm, height, self.settings))
        samples, pitch_um = int(self.settings["image_sampling"].split("x")[0]), self.settings["image_delta"]
        psf = oss.lens.psf(height, samples, pitch_um).tolist()
        return SimpleNamespace(data=psf, to_json=lambda: json.dumps(as_recorded(psf, pitch_um, self.settings)))


def as_recorded(psf, pitch_um, settings):
    """The tree that zospy 2 writes for a Huygens PSF of OpticStudio 24."""
    labels = [(n - (len(psf) - 1) / 2) * pitch_um for n in range(len(psf))]
    return {"data": {"index": labels, "columns": labels, "data": psf, "index_names": ["y"], "column_names": ["x"]},
            "settings": settings,
            "metadata": {"DateTime": "2025-03-17T10:18:58", "FeatureDescription": "Listing of Huygens PSF Data",
                         "LensFile": "triplet.zmx", "LensTitle": ""},
            "header": [], "messages": [], "__analysis_data__": {"data_type": "dataframe"},
            "__analysis_settings__": {"data_type": "zospy_class", "name": "HuygensPSFSettings",
                                      "module": "zospy.analyses.psf.huygens_psf"}}
