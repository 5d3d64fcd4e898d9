"""An interpreter for the part of Code V's macro language that the export macro is written in.

It has a `LensInProgram` loaded, and is stricter than the program: an unknown word, an unset variable or a folder that
is missing is an error.
"""

import re
from copy import deepcopy
from pathlib import Path

from lens_program import ENTRANCE_PUPIL_MM, MARGINAL_COSINE

QUOTED = re.compile(r""""[^"]*"|'[^']*'""")
ITEM = re.compile(r"\(([A-Z]+(?:\.[A-Z]+)?)((?: [A-Z]+(?:\^\w+|\d+)?)*)\)")


def statements(text):
    """The commands of a macro that are no comments, one by one."""
    lines = [line.strip() for line in text.splitlines()]
    return [command.strip() for line in lines if line and not line.startswith("!")
            for command in ([line] if '"' in line else line.split(";"))]


def words(text):
    """Every word of a macro that is neither text nor a variable; numbered ones, such as R1, without their numbers."""
    return {re.sub(r"\d+$", "", word) for command in statements(text)
            for word in re.findall(r"(?<![\^$\w])[A-Z][\w.]*", QUOTED.sub("", command).replace("..", " "))}


def run(text, lens, folder, title="Triplet"):
    """Run a macro in this folder; the lines that it writes on the screen."""
    machine = _Machine(lens, Path(folder), title)
    machine.execute(_parse(statements(text)))
    return machine.screen


def _parse(commands):
    """Nested blocks: ("do", command), ("if", condition, block, block), ("for", variable, first, last, block)."""
    blocks, ends = [[]], []
    for command in commands:
        if command.startswith("IF "):
            node = ("if", command[3:], [], [])
            blocks[-1].append(node)
            blocks += [node[3], node[2]]
            ends.append("END IF")
        elif command == "ELS":
            assert ends[-1] == "END IF"
            blocks.pop()
            blocks.append(blocks[-1])
        elif command.startswith("FOR "):
            node = ("for", *command.split()[1:], [])
            blocks[-1].append(node)
            blocks.append(node[4])
            ends.append("END FOR")
        elif command.startswith("END"):
            assert command == ends.pop()
            blocks = blocks[:-2 if command == "END IF" else -1]
        else:
            blocks[-1].append(("do", command))
    assert len(blocks) == 1
    return blocks[0]


class _Machine:
    def __init__(self, lens, folder, title):
        self.lens, self.folder, self.title = lens, folder, title
        self.buffers, self.formats, self.arrays, self.saved, self.screen = {}, {}, {}, {}, []
        self.option, self.settings, self.logging, self.found = None, {}, False, []
        self.names = {"ABSF": abs, "CONCAT": lambda a, b: a + b, "NUM_TO_STR": lambda n: f"{n:g}", "item": self.item}

    def execute(self, block):
        for node in block:
            if node[0] == "if":
                self.execute(node[2] if self.value(node[1]) else node[3])
            elif node[0] == "for":
                for index in range(int(self.value(node[2])), int(self.value(node[3])) + 1):
                    self.names["v_" + node[1][1:]] = index
                    self.execute(node[4])
            else:
                self.command(node[1])

    def command(self, command):
        assigned = re.fullmatch(r"\^(\w+)(?:\((\d+)\))? == (.*)", command)
        if assigned:
            name, index, value = assigned.groups()
            if index:
                assert 1 <= int(index) <= self.arrays[name]
                self.names["v_" + name].update({int(index): self.value(value)})
            else:
                self.names["v_" + name] = self.value(value)
            return
        word, _, rest = command.partition(" ")
        getattr(self, f"do_{word}")(rest)

    def value(self, expression):
        """The value of an expression, by way of Python's."""
        def replaced(text):
            text = ITEM.sub(lambda match: f"item({', '.join(map(self.word, (match[1] + match[2]).split()))})", text)
            for name in self.arrays:
                text = re.sub(rf"\^{name}\((.*?)\)", rf"v_{name}[\1]", text)
            return re.sub(r"(?<![<>])=", "==", text.replace("^", "v_")).replace("<>", "!=")

        parts, last = [], 0
        for match in QUOTED.finditer(expression):
            parts += [replaced(expression[last:match.start()]), repr(match[0][1:-1])]
            last = match.end()
        return eval("".join([*parts, replaced(expression[last:])]), {"__builtins__": {}}, self.names)

    @staticmethod
    def word(text):
        """A word of a database item as an f-string: its number may be a variable."""
        return 'f"' + re.sub(r"\^(\w+)", r"{v_\1:g}", text) + '"'

    def item(self, name, *words):
        matches = (re.fullmatch(r"([A-Z]+)(\d+)", word) for word in words)
        numbers = {match[1]: int(match[2]) for match in matches if match}
        if name == "RER":
            return 5 if self.lost else 0
        if name in ("Y", "Z", "M", "N"):
            return self.ray(name, numbers, at_image="SI" in words)
        if name in ("THI", "CUY"):
            return {"THI": self.lens.thickness, "CUY": self.lens.curvature}[name](numbers["S"])
        if name == "NUM":
            return {"S": 4, "F": len(self.lens.fields)}[words[0]]
        if name.startswith("BUF"):
            buffer = self.buffers[numbers["B"]]
            return self.found[0] if name == "BUF.I" else buffer[numbers["I"], numbers["J"]]
        return {"DIM": "M" if self.lens.units == 0 else "I", "TIT": self.title, "REF": self.lens.primary,
                "WL": self.lens.wavelengths_nm[numbers.get("W", 1) - 1], "RED": self.lens.magnification(self.lens.nm),
                "EFL": self.lens.efl_mm(self.lens.nm)}[name]

    def ray(self, name, numbers, at_image):
        """Reference rays 1 and 2 of a field, before surface 1, at its flat vertex and at the image."""
        field = self.lens.fields[numbers["F"] - 1]
        if numbers["R"] == 2:
            assert at_image and field["y"] == 0 and name == "M"
            return -MARGINAL_COSINE
        if at_image:
            self.check_traceable()
            return self.lens.real_height(field["y"])
        slope = self.slope(field["y"])
        along = 1 / (1 + slope**2)**0.5
        return {"M": slope * along, "N": along, "Y": -ENTRANCE_PUPIL_MM * slope, "Z": 0.0}[name]

    def slope(self, height):
        """Of the chief ray before the lens: through the middle of the entrance pupil."""
        if self.lens.object_mm > 1e9:
            return height / self.lens.efl_mm(self.lens.nm)
        return -height / self.lens.magnification(self.lens.nm) / (self.lens.object_mm + ENTRANCE_PUPIL_MM)

    def check_traceable(self):
        """The program answers for one wavelength and paraxial image heights, vignetting included."""
        assert len(self.lens.wavelengths_nm) == self.lens.primary == 1
        assert self.lens.field_type == "paraxial image height" and self.lens.vignetting_set

    def path(self, text):
        name = self.value("^" + text.removeprefix("$"))
        assert name.startswith("lensfield_export\\"), "outside the macro's own folder"
        return self.folder / name.replace("\\", "/")

    def numbers_of(self, words):
        """{"I": (first, last), ...} from words such as I1..^N."""
        ranges = {}
        for word in words:
            first, _, last = word[1:].partition("..")
            ranges[word[0]] = (int(self.value(first)), int(self.value(last or first)))
        return ranges

    def do_STR(self, rest):
        assert rest[0] == "^"

    def do_LCL(self, rest):
        name, size = re.fullmatch(r"NUM \^(\w+)\((\d+)\)", rest).groups()
        self.arrays[name], self.names["v_" + name] = int(size), {}

    def do_BUF(self, rest):
        word, _, rest = rest.partition(" ")
        getattr(self, f"buf_{word}")(rest)

    def buf_DEL(self, rest):
        self.buffers[int(rest[1:])] = {}
        self.formats.pop(int(rest[1:]), None)

    def buf_PUT(self, rest):
        buffer, row, column, value = rest.split(" ", 3)
        at = self.numbers_of([row, column])
        self.buffers[int(buffer[1:])][at["I"][0], at["J"][0]] = self.value(value)

    def buf_FMT(self, rest):
        buffer, *words, form = rest.split(" ")
        assert form == "'5e.17e'"
        self.formats[int(buffer[1:])] = self.numbers_of(words)

    def buf_EXP(self, rest):
        buffer, rows, columns, separated, name = rest.split(" ")
        assert separated == "SEP"
        number, at = int(buffer[1:]), self.numbers_of([rows, columns])
        lines = ["\t".join(self.cell(number, i, j) for j in range(at["J"][0], at["J"][1] + 1))
                 for i in range(at["I"][0], at["I"][1] + 1)]
        self.path(name).write_text("\n".join(lines) + "\n", encoding="ascii")

    def cell(self, number, i, j):
        value, form = self.buffers[number].get((i, j), ""), self.formats.get(number)
        if isinstance(value, str):
            return value
        inside = form and all(form[axis][0] <= at <= form[axis][1] for axis, at in (("I", i), ("J", j)))
        return f"{value:.17e}" if inside else f"{value:.6f}"

    def buf_YES(self, rest):
        self.logging = True

    def buf_NO(self, rest):
        self.logging = False

    def buf_FND(self, rest):
        if rest:
            number, text = rest.split(" ", 1)
            buffer = self.buffers[int(number[1:])]
            self.found = [0] + [i for (i, j), value in buffer.items() if value == self.value(text)]
        self.found = self.found[1:]

    def do_WRI(self, rest):
        self.screen.append(re.fullmatch('Q"(.*)"', rest)[1])

    def do_RSI(self, rest):
        assert rest == "S^IMAGE Z1 W1 F1 R1" and self.value("^IMAGE") == 4
        self.lost = self.lens.lost(self.lens.fields[0]["y"])

    def do_SAV(self, rest):
        self.path(rest).with_suffix(".len").write_text("saved")
        self.saved[rest] = deepcopy(self.lens.__dict__)

    def do_RES(self, rest):
        self.lens.__dict__ = self.saved[rest]

    def do_WL(self, rest):
        self.lens.wavelengths_nm, self.lens.primary = [self.value(rest)], 1

    def set_fields(self, key, rest):
        values = [self.value(word) for word in rest.split()]
        old = self.lens.fields
        self.lens.fields = [{"x": 0, "y": 0} | (old[n] if n < len(old) else {}) | {key: value}
                            for n, value in enumerate(values)]
        self.lens.field_type, self.lens.vignetting_set = "paraxial image height", False

    def do_XIM(self, rest):
        self.set_fields("x", rest)

    def do_YIM(self, rest):
        self.set_fields("y", rest)

    def do_SET(self, rest):
        assert rest == "VIG"
        self.lens.vignetting_set = True

    def do_PSF(self, rest):
        self.option, self.settings = "PSF", {}

    def do_TRA(self, rest):
        self.option, self.settings = "TRA", {}

    def set_option(self, word, rest):
        self.settings[word] = rest

    def __getattr__(self, name):
        if name in ("do_TGR", "do_GRI", "do_LIS", "do_INT", "do_WBF", "do_FUL", "do_NRD"):
            return lambda rest: self.set_option(name[3:], rest)
        raise AttributeError(name)

    def do_GO(self, rest):
        self.check_traceable()
        settings = self.settings
        if self.option == "PSF":
            assert settings.keys() == {"TGR", "GRI", "LIS", "INT", "WBF"} and len(self.lens.fields) == 1
            assert (settings["LIS"], settings["INT"]) == ("N", "STR")
            psf = 100 * self.lens.psf(self.lens.fields[0]["y"], self.value(settings["TGR"]),
                                      1000 * self.value(settings["GRI"]))
            self.buffers[int(settings["WBF"][1:])] |= {
                (11 + i, 1 + j): value for i, row in enumerate(psf.tolist()) for j, value in enumerate(row)}
        else:
            assert settings.keys() == {"FUL", "NRD"} and self.logging and settings["FUL"] == "NO"
            for n, field in enumerate(self.lens.fields):
                percent = 100 * self.lens.relative_illumination(field["y"])
                self.buffers[0] |= {(20 * n + 9, 1): "RELATIVE ILLUM:", (20 * n + 9, 2): percent}
