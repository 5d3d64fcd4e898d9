"""Look in the extension for what the moderators of extensions.blender.org refuse.

    python packaging/moderate.py [FOLDER]

lists findings in the files that the manifest of a folder (default: this tree) puts into the zips, and in the engine,
whose wheel the zips contain. Each line has the file, the line, the finding, the reason why moderators refuse it, and
the remedy. The exit status is 1 if there are findings. Python is parsed: neither comments nor documents count.

The rules come from these pages, as of November 2026:

* Terms of service, https://extensions.blender.org/terms-of-service/: no logos of others without evidence that their
  owners allow it (2.4), reviewable code (3.5), no external functional components that users must download.
* Moderation guidelines, https://developer.blender.org/docs/features/extensions/moderation/guidelines/: correct
  permissions; no updater; a self-contained add-on, without "functionality which is extended by external software";
  every use of `__file__` (for `sys.path`, or for writing next to the code), `open` and `__name__` is checked.
* Canned responses of moderators, …/moderation/canned_responses/: updaters, external components.
* Add-on guidelines, https://developer.blender.org/docs/handbook/extensions/addon_guidelines/: add-ons do not connect to
  the internet without permission, change other add-ons, install modules, or change how Blender loads modules.
* Threads, https://docs.blender.org/api/current/info_gotchas_threading.html: they crash Blender if they use its API.
* What moderators wrote to authors: no `threading`, updater, reload of add-ons or donation links
  (https://github.com/Weisl/simple_renaming/issues/242), nor links, logos and programs of others
  (https://github.com/natapol2547/paintsystem/pull/134); no `eval` and `exec`
  (https://github.com/RivinHD/ScriptToButton/issues/30); no import of add-ons that may be missing
  (https://github.com/KhronosGroup/glTF-Blender-IO/issues/2640); no change of `sys.path` and `sys.modules`
  (https://github.com/poly-hammer/BlenderTools/issues/55).

The engine starts the threads, reads data next to its code, and compiles its loops. For it, the rules on connections,
installations, other add-ons, advertising, Python's module search and code that is not in the files hold.
"""

import ast
import re
import sys
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
BLENDERS = {"_cycles", "addon_utils", "bl_operators", "bl_ui", "blf", "bpy", "bpy_extras", "gpu", "gpu_extras",
            "mathutils", "numpy", "zstandard"}
"""Modules that Blender contains and extensions may import."""
WHEELS = {"OpenEXR", "PIL", "lensfield", "rawpy", "scipy", "wgpu", "yaml"}
"""Modules in the zips' wheels (packaging/build_extension.py)."""
THREADS = {"_thread", "concurrent", "threading"}
NETWORK = {"aiohttp", "ftplib", "http", "httpx", "requests", "smtplib", "socket", "socketserver", "ssl", "telnetlib",
           "urllib3", "webbrowser", "xmlrpc"}
URLS = {"urllib", "urllib.request"}
INSTALLERS = {"ensurepip", "pip", "setuptools"}
EVALUATORS = {"__import__", "compile", "eval", "exec"}
UNIMPORTABLE = {"BaseException", "Exception", "ImportError", "ModuleNotFoundError"}
CHANGES = {"append", "clear", "extend", "insert", "pop", "remove", "setdefault", "update"}
SAFE_WRITERS = {"atomic_path", "temporary_folder"}
MODE = re.compile("[rbt+]*[wax+][wabtx+]*")  # of `open`, for writing
PICTURES = {".bmp", ".gif", ".ico", ".jpeg", ".jpg", ".png", ".svg", ".webp"}
COMPILED = {".a", ".dll", ".dylib", ".exe", ".o", ".pyd", ".so"}
OWN_PICTURES = "engine/library/pictures/"  # taken by Lensfield
ADVERTISING = re.compile(r"patreon|ko-?fi\b|gumroad|paypal|liberapay|buymeacoffee|opencollective|superhivemarket"
                         r"|blendermarket|github\.com/sponsors|discord\.(gg|com)|\bdonat(e|ion)", re.IGNORECASE)
OTHER_PROGRAMS = {"os.popen", "os.startfile", "os.system", "shutil.which"}
OTHERS_CLASS = re.compile("(?!LENSFIELD_)[A-Z][A-Z0-9_]*_OT_[a-z0-9_]+")  # how Blender names operators' classes
OTHER_ADDONS = ("addon_utils.", "bpy.ops.extensions.", "bpy.ops.preferences.addon_", "bpy.ops.script.reload",
                "importlib.reload", "importlib.util.find_spec")


@dataclass(frozen=True)
class Rule:
    """What moderators refuse.

    Attributes
    ----------
    find : callable
        Yields (node, name of the finding) for a list of a module's nodes.
    why, remedy : str
    of_engine : bool
        Whether the engine must keep it, too.
    """

    find: Callable[[list[ast.AST]], Iterator[tuple[ast.AST, str]]]
    why: str
    remedy: str
    of_engine: bool = False


def _dotted(node):
    """The text of a name such as os.path; "" for other expressions."""
    return ast.unparse(node) if isinstance(node, (ast.Attribute, ast.Name)) else ""


def _imported(node):
    """The names of the modules that a node imports, without this package."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    return [node.module] if isinstance(node, ast.ImportFrom) and not node.level else []


def _imports(nodes, refused):
    return ((node, f"import {name}") for node in nodes for name in _imported(node) if refused(name))


def _threads(nodes):
    return _imports(nodes, lambda name: name.partition(".")[0] in THREADS)


def _network(nodes):
    return _imports(nodes, lambda name: name in URLS or name.partition(".")[0] in NETWORK)


def _missing_modules(nodes):
    return _imports(nodes, lambda name: name.partition(".")[0] not in sys.stdlib_module_names | BLENDERS | WHEELS)


def _installers(nodes):
    return _imports(nodes, lambda name: name.partition(".")[0] in INSTALLERS)


def _import_guards(nodes):
    """Imports that may fail in silence: a guard that raises another error is harmless."""
    for node in nodes:
        if isinstance(node, ast.Try):
            caught = [handler.type or ast.Name("Exception") for handler in node.handlers
                      if not isinstance(handler.body[-1], ast.Raise)]
        elif isinstance(node, ast.With):
            caught = [item.context_expr for item in node.items]
        else:
            continue
        if any(_imported(inner) for part in node.body for inner in ast.walk(part)) and any(
                name.id in UNIMPORTABLE for each in caught for name in ast.walk(each) if isinstance(name, ast.Name)):
            yield node, "import guard"


def _calls(nodes, refused):
    return ((node, f"{name}()") for node in nodes if isinstance(node, ast.Call)
            and refused(name := _dotted(node.func)))


def _evaluations(nodes):
    return _calls(nodes, EVALUATORS.__contains__)


def _other_addons(nodes):
    return _calls(nodes, lambda name: name.startswith(OTHER_ADDONS))


def _other_software(nodes):
    """Calls of other programs, and questions whether another add-on is enabled."""
    yield from _calls(nodes, OTHER_PROGRAMS.__contains__)
    for node in nodes:
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and OTHERS_CLASS.fullmatch(node.value):
            yield node, repr(node.value)


def _module_search(nodes):
    """Changes of sys.path and sys.modules; reading them is harmless."""
    for node in nodes:
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in CHANGES:
            targets = [node.func.value]
        else:
            targets = getattr(node, "targets", None) or [getattr(node, "target", None)]
        for target in targets:
            name = _dotted(target.value if isinstance(target, ast.Subscript) else target)
            if name in ("sys.path", "sys.modules"):
                yield node, f"change of {name}"


def _file_variables(nodes):
    return ((node, "__file__") for node in nodes if _dotted(node) == "__file__")


def _name_variables(nodes):
    """`__name__`, except in the question whether a file is run as a program."""
    compared = {node.left for node in nodes if isinstance(node, ast.Compare)}
    return ((node, "__name__") for node in nodes if _dotted(node) == "__name__" and node not in compared)


def _writing(nodes):
    """Files that are written in place, except the null device."""
    safe = {inner for node in nodes if isinstance(node, ast.With)
            and any(_dotted(getattr(item.context_expr, "func", None)) in SAFE_WRITERS for item in node.items)
            for inner in ast.walk(node)}
    for node in nodes:
        if isinstance(node, ast.Call) and node not in safe:
            called = _dotted(node.func).rpartition(".")[2]
            if called in ("write_bytes", "write_text") or called == "open" and _opens_to_write(node):
                yield node, f"{called}() to write"


def _opens_to_write(call):
    given = [*call.args, *(word.value for word in call.keywords if word.arg == "mode")]
    texts = [each.value for each in given if isinstance(each, ast.Constant) and isinstance(each.value, str)]
    return any(MODE.fullmatch(text) for text in texts) and "os.devnull" not in map(_dotted, given)


def _advertising(nodes):
    return ((node, repr(match[0])) for node in nodes if isinstance(node, ast.Constant)
            and isinstance(node.value, str) and (match := ADVERTISING.search(node.value)))


RULES = (
    Rule(_threads, "threads that use Blender's API crash it", "let engine/runtime start the thread"),
    Rule(_evaluations, "code that is not in the files cannot be reviewed", "write the code out", of_engine=True),
    Rule(_module_search, "it changes which modules other add-ons import", "import relatively, or add a wheel",
         of_engine=True),
    Rule(_file_variables, "the folder of the code may be read-only, and updates empty it",
         "read with importlib.resources, write to bpy.utils.extension_path_user"),
    Rule(_name_variables, "an extension's name differs with its repository", "use __package__"),
    Rule(_writing, "files may only be written where users or Blender choose",
         "write within atomic_path or temporary_folder of engine/runtime/files.py"),
    Rule(_import_guards, "an extension contains all that it needs", "import without a guard, and add the wheel"),
    Rule(_missing_modules, "an extension contains all that it needs", "add the wheel, or leave the function out"),
    Rule(_installers, "extensions must not install modules", "add the wheel", of_engine=True),
    Rule(_network, "Lensfield works offline, and Blender updates extensions itself", "leave it out", of_engine=True),
    Rule(_other_software, "other software must not extend an extension", "document a script that users run themselves"),
    Rule(_other_addons, "it interferes with other add-ons", "leave it out", of_engine=True),
    Rule(_advertising, "extensions must not advertise", "leave it to the platform's page", of_engine=True),
)


def findings_in(source, of_engine=False):
    """Findings in the source of a module: sorted list of (line, text)."""
    nodes = list(ast.walk(ast.parse(source)))
    return sorted((node.lineno, f"{what}: {rule.why}; {rule.remedy}") for rule in RULES
                  if rule.of_engine or not of_engine for node, what in rule.find(nodes))


def manifest_findings(manifest):
    """Findings in the manifest: list of texts."""
    permissions = manifest.get("permissions", {})
    found = [f"permission {name!r}: Lensfield needs only files; leave it out" for name in permissions
             if name != "files"]
    if not permissions.get("files"):
        found.append("permission 'files': missing; state why Lensfield reads and writes files")
    if "blender" in manifest["name"].lower():
        found.append(f"name {manifest['name']!r}: the name Blender is a trademark; choose another")
    return found + [f"{name} {match[0]!r}: extensions must not advertise; leave it to the platform's page"
                    for name, value in manifest.items() if (match := ADVERTISING.search(str(value)))]


def packaged_files(folder, manifest):
    """Files that the manifest's patterns put into the zip: names with slashes, of existing files."""
    patterns = manifest["build"]["paths_exclude_pattern"]
    included = [pattern[2:] for pattern in patterns if pattern.startswith("!/")]
    excluded = {pattern[1:] for pattern in patterns if pattern.startswith("/")}
    return sorted(path for name in included for path in files_in(folder, name) if path not in excluded)


def files_in(folder, name):
    """A file or all files in a subfolder: sorted names with slashes, relative to the folder."""
    paths = (path for path in (folder / name, *(folder / name).rglob("*")) if path.is_file())
    return sorted(path.relative_to(folder).as_posix() for path in paths if "__pycache__" not in path.parts)


def findings(folder):
    """Yield the findings in a folder's extension, one line each."""
    manifest = tomllib.loads((folder / "blender_manifest.toml").read_text(encoding="utf-8"))
    for text in manifest_findings(manifest):
        yield f"blender_manifest.toml: {text}"
    packaged = packaged_files(folder, manifest)
    for name in packaged:
        if Path(name).suffix.lower() in COMPILED:
            yield f"{name}: compiled code: the platform accepts it only in wheels from PyPI; move it to the engine"
    for name in [*packaged, *files_in(folder, "engine")]:
        if Path(name).suffix.lower() in PICTURES and not name.startswith(OWN_PICTURES):
            yield f"{name}: picture: logos need their owners' permission; use Blender's icons"
        elif name.endswith(".py"):
            source = (folder / name).read_text(encoding="utf-8")
            for line, text in findings_in(source, of_engine=name.startswith("engine/")):
                yield f"{name}:{line}: {text}"


def main(arguments):
    found = list(findings(Path(arguments[0]) if arguments else ROOT))
    print(*found, f"{len(found)} finding{'s' * (len(found) != 1)} for moderators", sep="\n")
    sys.exit(bool(found))


if __name__ == "__main__":
    main(sys.argv[1:])
