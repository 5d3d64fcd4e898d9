"""`lensfield coco`: the objects in rendered lens images as annotations in the layout of COCO."""

import json
import os
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from lensfield.engine import ImageError, InputError
from lensfield.engine.pictures.frame_record import PICTURE_END, TRUTH_END
from lensfield.engine.pictures.spectral_exr import read_parts
from lensfield.engine.runtime.build_identity import software
from lensfield.engine.runtime.errors import absence
from lensfield.engine.runtime.files import atomic_path
from lensfield.engine.truth.captured_truth import OBJECT, ShownObject
from lensfield.engine.truth.coco import OBJECTS, annotations_of, mask_coder, objects_from

from .arguments import check_outputs
from .terminal import progress_bar, say

FRAME = re.compile(rf"(.+)_(-?\d+)_{re.escape(TRUTH_END)}")
BY_CATEGORY, BY_OBJECT = "id", "object"
RENDER = "render with --truth object"


@dataclass(frozen=True)
class Frame:
    """A rendered frame with ground truth: the files, the channel of its objects, and the objects by name."""

    truth: Path
    picture: Path
    channel: str
    objects: dict[str, ShownObject]

    def ids(self):
        """The Cryptomatte ids of the objects in its pixels."""
        (_, channels), *_ = read_parts(self.truth)
        return np.asarray(channels[self.channel], np.float32)

    def annotations(self, ids, categories):
        """Its annotations, as of `annotations_of`."""
        try:
            return list(annotations_of(ids, self.objects, categories))
        except ImageError as error:
            raise error.at(self.truth) from None


def add_options(coco):
    coco.description = (
        "Write boxes and run-length masks of the objects in lens images that were rendered with --truth object, in the "
        "layout of COCO (docs/truth.md).")
    coco.add_argument("folders", type=Path, nargs="+", metavar="DIR", help="folder of lens images, with its subfolders")
    coco.add_argument("-o", "--output", type=Path, required=True, metavar="FILE.json",
                      help="file to write; names of pictures in it are relative to its folder")
    coco.add_argument("--category", choices=(BY_CATEGORY, BY_OBJECT), default=BY_CATEGORY, metavar="KIND",
                      help="id: each object's custom property category_id, as in BlenderProc, or its pass index; 0 is "
                           "background. object: each object is a category of its own (default: %(default)s)")
    coco.add_argument("--names", metavar="LIST",
                      help="names of the categories, such as 1=chair,2=lamp (default: their numbers)")
    coco.set_defaults(run=_coco)


def _coco(options):
    check_outputs([(options.output, ".json")])
    mask_coder()
    names = _given_names(options)
    frames = [_frame(path) for path in _truths(options.folders)]
    categories = _categories(options, frames)
    images, annotations = [], []
    with progress_bar() as on_progress:
        for number, (frame, of_frame) in enumerate(zip(frames, categories, strict=True), 1):
            on_progress(number / len(frames), f"Annotating {frame.picture.name}")
            ids = frame.ids()
            images.append(_image(number, frame, ids.shape, options.output.parent))
            annotations += [{"id": len(annotations) + place, "image_id": number, **each}
                            for place, each in enumerate(frame.annotations(ids, of_frame), 1)]
    _write(options.output, images, annotations, _listed(options, categories, names))
    say(f"{options.output}: pictures: {len(images)}, annotations: {len(annotations)}")


def _truths(folders):
    """The files with ground truth in folders, in the order of their names and frames."""
    places = {}
    for folder in folders:
        paths = list(folder.rglob(f"*_{TRUTH_END}")) if folder.is_dir() else []
        matches = {path: FRAME.fullmatch(path.name) for path in paths}
        if not any(matches.values()):
            if not folder.is_dir():
                raise InputError(folder, "folder", absence(folder), "expected a folder of renders with --truth object")
            raise InputError(folder, "ground truth", "missing", RENDER)
        places |= {path: (str(path.parent), match[1], int(match[2])) for path, match in matches.items() if match}
    return sorted(places, key=places.get)


def _frame(truth):
    """The Frame of a file, from its header."""
    (header, _), *_ = read_parts(truth, header_only=True)
    channels = [name for name in header["channel names"] if name == OBJECT or name.endswith(f".{OBJECT}")]
    if len(channels) != 1:
        raise ImageError(truth, f"channel {OBJECT}", "missing", RENDER)
    try:
        objects = objects_from(str(header.get(OBJECTS, "{}")))
    except ValueError:
        raise ImageError(truth, OBJECTS, "damaged", f"{RENDER} again") from None
    picture = truth.with_name(truth.name.removesuffix(TRUTH_END) + PICTURE_END)
    if not picture.is_file():
        raise InputError(picture, "file", absence(picture), "render the frame again, or remove its ground truth")
    return Frame(truth, picture, channels[0], objects)


def _given_names(options):
    """{category: name} of --names."""
    if options.names is None:
        return {}
    pairs = [part.partition("=") for part in options.names.split(",")]
    if not all(number.strip().isdecimal() and name.strip() for number, _, name in pairs):
        raise InputError("options", "--names", options.names, "expected numbers and names, such as 1=chair,2=lamp")
    if options.category != BY_CATEGORY:
        raise InputError("options", "--names", options.names, f"leave it out, or use --category {BY_CATEGORY}")
    return {int(number): name.strip() for number, _, name in pairs}


def _categories(options, frames):
    """{object: category} of the annotated objects of each frame."""
    if options.category == BY_OBJECT:
        names = sorted({name for frame in frames for name in frame.objects})
        return [{name: number for number, name in enumerate(names, 1)}] * len(frames)
    categories = [{name: each.category_id for name, each in frame.objects.items() if each.category_id}
                  for frame in frames]
    if not any(categories):
        raise InputError("options", "--category", BY_CATEGORY,
                         "no object has a pass index or a category_id: set them and render again, or use --category "
                         f"{BY_OBJECT}")
    return categories


def _listed(options, categories, names):
    """The categories of the file."""
    if options.category == BY_OBJECT:
        named = {number: name for name, number in categories[0].items()}
    else:
        numbers = {number for of_frame in categories for number in of_frame.values()} | names.keys()
        named = {number: names.get(number, str(number)) for number in sorted(numbers)}
    return [{"id": number, "name": name, "supercategory": ""} for number, name in named.items()]


def _image(number, frame, shape_px, folder):
    """The entry of a picture; raises an InputError if it has another size than its ground truth."""
    rows, columns = shape_px
    if (size := _size(frame.picture)) != (columns, rows):
        raise InputError(frame.picture, "size", "{} x {}".format(*size),
                         f"expected the {columns} x {rows} px of its ground truth: render the frame again")
    name = Path(os.path.relpath(frame.picture.resolve(), folder.resolve())).as_posix()
    return {"id": number, "file_name": name, "width": columns, "height": rows}


def _size(picture):
    """Width and height of a PNG."""
    try:
        with Image.open(picture, formats=["PNG"]) as opened:
            return opened.size
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError):
        raise InputError(picture, "file", "not readable", "expected a PNG: render the frame again") from None


def _write(path, images, annotations, categories):
    contents = {"info": {"description": software()}, "licenses": [], "images": images,
                "annotations": annotations, "categories": categories}
    with atomic_path(path, overwrite=True) as temporary:
        temporary.write_text(json.dumps(contents) + "\n", encoding="utf-8")
