"""An interpreter for the part of ZPL that the export macro is written in, with a `LensInProgram` loaded.

Stricter than the program: an unknown word, an unset variable or a folder that is missing is an error.
"""

import json
import re
from contextlib import suppress
from pathlib import Path

from lens_program import ENTRANCE_PUPIL_MM, MARGINAL_COSINE, OUTERMOST_MM

TOKEN = re.compile(r'"[^"]*"|\$==|\$?[A-Za-z_]\w*\$?|\d+\.?\d*|\S')
FIELD_CODES = {102: "x", 103: "y", 104: "weight", 105: "vdx", 106: "vdy", 107: "vcx", 108: "vcy", 109: "van"}
FIELD_TYPES = {0: "angle", 2: "paraxial image height"}
FIELD_CODE = {kind: code for code, kind in FIELD_TYPES.items()}


def statements(text):
    """The lines of a macro that are no comments."""
    return [line.strip() for line in text.splitlines() if line.strip() and not line.strip().startswith("!")]


def words(text):
    """Every word of a macro that is neither text, nor a name of the macro's own, which has an underscore."""
    found = {token for line in statements(text) for token in TOKEN.findall(line)}
    return {token for token in found if re.fullmatch(r"\$?[A-Za-z]\w*\$?", token) and "_" not in token} \
        | {token for token in found if token.startswith("HPS_")}


def run(text, lens, lens_path, title=""):
    """Run a macro; the lines that it prints on the screen."""
    machine = _Machine(lens, Path(lens_path), title)
    main, machine.subs = _parse(statements(text))
    with suppress(_End):
        machine.execute(main)
    return machine.screen.splitlines()


class _End(Exception):
    pass


def _parse(lines):
    """Nested blocks: ("do", line), ("if", condition, block, block), ("for", variable, bounds, block)."""
    blocks, subs = [[]], {}
    for line in lines:
        word = re.match(r"\w+", line)[0]
        if word == "SUB":
            assert len(blocks) == 1, "a SUB within a block"
            blocks = [subs.setdefault(line.split()[1], [])]
        elif word == "IF":
            node = ("if", re.fullmatch(r"IF \((.*)\)", line)[1], [], [])
            blocks[-1].append(node)
            blocks += [node[3], node[2]]
        elif word == "ELSE":
            blocks.pop()
            blocks.append(blocks[-1])
        elif word == "ENDIF":
            blocks = blocks[:-2]
        elif word == "FOR":
            variable, bounds = re.fullmatch(r"FOR (\w+) = (.*)", line).groups()
            node = ("for", variable, bounds, [])
            blocks[-1].append(node)
            blocks.append(node[3])
        elif word == "NEXT":
            blocks.pop()
        else:
            blocks[-1].append(("do", line))
            if line == "END":
                assert len(blocks) == 1, "END within a block"
                main = blocks[0]
    return main, subs


class _Array:
    def __init__(self, size):
        self.values, self.size = {}, size

    def __call__(self, index):
        return self.values[index]

    def put(self, index, value):
        assert index == int(index) and 1 <= index <= self.size, f"index {index} of {self.size}"
        self.values[int(index)] = value


class _Machine:
    def __init__(self, lens, lens_path, title):
        self.lens, self.lens_path = lens, lens_path
        self.screen, self.output, self.form, self.ray = "", None, ".4", None
        self.names = {
            "S_FILENAME": lambda: lens_path.name, "S_PATHNAME": lambda: str(lens_path.parent).replace("/", "\\"),
            "S_LENSNAME": lambda: title, "S_LEFTSTRING": lambda text, n: text[:n], "S_STR": self.number, "SLEN": len,
            "NFLD": lambda: len(lens.fields), "ABSO": abs,
            "NWAV": lambda: len(lens.wavelengths_nm), "PWAV": lambda: lens.primary,
            "WAVL": lambda n: lens.wavelengths_nm[n - 1] / 1000, "WWGT": lambda n: 1.0,
            "NSUR": lambda: 4, "THIC": lens.thickness, "CURV": lens.curvature, "OCOD": lambda name: name,
            "OPEV": self.operand, "RELI": self.illumination, "RAYE": lambda: self.ray["lost"],
            "SYPR": {30: lens.units, 70: int(lens.ray_aiming), 100: FIELD_CODE[lens.field_type]}.__getitem__,
            "RAYY": lambda surface: self.ray["y"], "RAYM": lambda surface: self.ray["m"]}
        for function, key in {"FLDX": "x", "FLDY": "y", "FWGT": "weight", "FVDX": "vdx", "FVDY": "vdy",
                              "FVCX": "vcx", "FVCY": "vcy", "FVAN": "van"}.items():
            self.names[function] = lambda n, key=key: lens.fields[n - 1][key]

    def execute(self, block):
        for node in block:
            if node[0] == "if":
                self.execute(node[2] if self.value(node[1]) else node[3])
            elif node[0] == "for":
                first, last, step = self.value(f"[{node[2]}]")
                for index in range(first, int(last) + 1, step):
                    self.names[node[1]] = index
                    self.execute(node[3])
            else:
                self.statement(node[1])

    def statement(self, line):
        assigned = re.fullmatch(r"(\w+\$?)(?:\((.*?)\))? = (.*)", line)
        if assigned and "_" in assigned[1]:
            name, index, value = assigned.groups()
            if index:
                self.names[name].put(self.value(index), self.value(value))
            else:
                self.names[name.replace("$", "_S")] = self.value(value)
            return
        word, _, rest = line.partition(" ")
        getattr(self, f"do_{word}")(rest)

    def value(self, expression):
        tokens = (repr(token[1:-1]) if token[0] == '"' else "==" if token == "$==" else
                  re.sub(r"^\$", "S_", re.sub(r"\$$", "_S", token)) for token in TOKEN.findall(expression))
        text = re.sub(r"([!=<>]) =", r"\1=", " ".join(tokens))
        return eval(text, {"__builtins__": {}}, self.names)

    def number(self, value):
        decimals = int(re.match(r"\d*\.(\d+)", self.form)[1])
        if not self.form.endswith("EXP"):
            return f"{value:.{decimals}f}"
        mantissa, exponent = f"{value:.{decimals}E}".split("E")
        return f"{mantissa}E{exponent[0]}{int(exponent[1:]):03d}"

    def path(self, text):
        assert self.lens_path.stem + "-lensfield\\" in text, "outside the macro's own folder"
        return Path(text.replace("\\", "/"))

    def operand(self, name, first, wave, *_):
        nm = self.lens.wavelengths_nm[wave - 1] if wave else self.lens.nm
        return {"ENPP": lambda: ENTRANCE_PUPIL_MM, "EFFL": lambda: self.lens.efl_mm(nm),
                "PMAG": lambda: self.lens.magnification(nm), "PIMH": lambda: -OUTERMOST_MM}[name]()

    def illumination(self, n):
        self.check_traceable()
        return 0.9 * self.lens.relative_illumination(self.lens.fields[n - 1]["y"])

    def check_traceable(self):
        """The program answers for one wavelength and paraxial image heights, vignetting included."""
        assert len(self.lens.wavelengths_nm) == self.lens.primary == 1
        assert self.lens.field_type == "paraxial image height" and self.lens.vignetting_set

    def do_DECLARE(self, rest):
        name, kind, dimensions, size = rest.split(", ")
        assert (kind, dimensions) == ("DOUBLE", "1")
        self.names[name] = _Array(int(size))

    def do_GOSUB(self, rest):
        assert self.subs[rest][-1] == ("do", "RETURN")
        self.execute(self.subs[rest])

    def do_RETURN(self, rest):
        pass

    def do_END(self, rest):
        raise _End

    def do_BEEP(self, rest):
        self.screen += "\a\n"

    def do_FORMAT(self, rest):
        self.form = rest

    def do_OUTPUT(self, rest):
        self.output = None if rest == "SCREEN" else self.path(self.value(rest))
        if self.output:
            self.output.write_text("", encoding="ascii")

    def do_PRINT(self, rest):
        items = self.value(f"[{rest}]")
        text = "".join(item if isinstance(item, str) else self.number(item) for item in items)
        text += "" if rest.endswith(",") else "\n"
        if self.output is None:
            self.screen += text
        else:
            with open(self.output, "a", encoding="ascii") as stream:
                stream.write(text)

    def do_SYSP(self, rest):
        code, *values = self.value(f"[{rest}]")
        if code in FIELD_CODES:
            self.lens.fields[values[0] - 1][FIELD_CODES[code]] = values[1]
        elif code == 202:
            self.lens.wavelengths_nm[values[0] - 1] = 1000 * values[1]
        elif code == 203:
            assert values[1] == 1.0
        else:
            {100: lambda kind: setattr(self.lens, "field_type", FIELD_TYPES[kind]), 101: self.do_NUMFIELD,
             201: self.do_NUMWAVE, 200: self.do_PWAV}[code](*values)

    def do_NUMFIELD(self, number):
        blank = dict.fromkeys(FIELD_CODES.values(), 0.0)
        self.lens.fields[:] = (self.lens.fields + [dict(blank) for _ in range(int(number))])[:int(number)]

    def do_NUMWAVE(self, number):
        self.lens.wavelengths_nm[:] = (self.lens.wavelengths_nm + [550.0] * int(number))[:int(number)]

    def do_PWAV(self, number):
        self.lens.primary = int(number)

    def do_WAVL(self, rest):
        number, value = rest.split(" = ")
        self.lens.wavelengths_nm[int(number) - 1] = 1000 * self.value(value)

    def set_field(self, key, rest):
        number, value = rest.split(" = ")
        self.lens.fields[int(number) - 1][key] = self.value(value)
        self.lens.vignetting_set = False

    def do_FLDX(self, rest):
        self.set_field("x", rest)

    def do_FLDY(self, rest):
        self.set_field("y", rest)

    def do_SETVIG(self, rest):
        self.lens.vignetting_set = True

    def do_UPDATE(self, rest):
        pass

    def do_RAYTRACE(self, rest):
        self.check_traceable()
        _, hy, _, py = self.value(f"[{rest}]")
        outermost = max((one["y"] for one in self.lens.fields), key=abs)
        self.ray = {"y": self.lens.real_height(hy * outermost), "m": -MARGINAL_COSINE * py,
                    "lost": 3 if self.lens.lost(hy * outermost) else 0}

    def do_MODIFYSETTINGS(self, rest):
        name, setting, value = rest.split(", ")
        path = self.path(self.value(name))
        settings = json.loads(path.read_text())
        assert setting in settings
        path.write_text(json.dumps(settings | {setting: self.value(value)}))

    def do_GETTEXTFILE(self, rest):
        name, kind, settings_name, flag = rest.split(", ")
        assert kind == "Hps"
        self.check_traceable()
        settings_path = self.path(self.value(settings_name))
        if flag == "0":
            settings_path.write_text(json.dumps({"HPS_PUPILSAMP": 1, "HPS_IMAGESAMP": 1, "HPS_IMAGEDELTA": 0}))
        settings = json.loads(settings_path.read_text())
        self.path(self.value(name)).write_bytes(self.listing(settings).encode("utf-16"))

    def listing(self, settings):
        """Field 1, as the program lists it: from the top."""
        samples, pitch_um = 16 * 2**settings["HPS_IMAGESAMP"], settings["HPS_IMAGEDELTA"] or 0.1
        height, self.form = self.lens.fields[0]["y"], ".3 EXP"
        rows = ["\t".join(map(self.number, row)) for row in self.lens.psf(height, samples, pitch_um)[::-1]]
        grid = 16 * 2**settings["HPS_PUPILSAMP"]
        return "\r\n".join([
            "Listing of Huygens PSF Data", "", "File : C:\\LENSES\\TRIPLET.ZMX", "Title: ", "Date : 1/1/2024", "",
            "Huygens PSF", f"{self.lens.nm / 1000:.4f} µm at {height:.4f} mm.", f"Data spacing is {pitch_um} µm.",
            f"Data area is {samples * pitch_um} by {samples * pitch_um} µm.", "Strehl ratio: 0.5",
            f"Pupil grid size: {grid} by {grid}", f"Image grid size: {samples} by {samples}",
            f"Center point is: {samples // 2 + 1}, {samples // 2 + 1}",
            f"Center coordinates: 0.00000000E+000, {self.number(self.lens.real_height(height))}",
            "Values are relative intensity.", "", *rows, ""])
