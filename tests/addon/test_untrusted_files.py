"""Files that only a .blend names: pipes and devices, paths outside its folder, secret files, bombs."""

import json
import os
import shutil
import subprocess
import sys

import bpy
import pytest

from lensfield import addon, cli
from lensfield.addon.job.source import check_sources
from lensfield.addon.scene.trust import forget_trust
from lensfield.commands import confine
from lensfield.commands.blend_paths import _Blocks, _layouts
from lensfield.commands.confine import landlock_version
from lensfield.commands.untrusted import OF_SYSTEM
from lensfield.engine.inspection.canvas import FONTS
from lensfield.engine.runtime.errors import InputError
from refusals import refused
from small_scenes import adjust, material, set_world, wall

pytestmark = pytest.mark.skipif(os.name != "posix", reason="Windows has no such files")
LENS = "--lens", "edmund-54852", "--wavelengths", "550"
SECRET = "root:$6$salt$hash:19000:0:99999:7:::\n"
FONT = FONTS / "DejaVuSans.ttf"


@pytest.fixture
def paint(scene):
    """The material of a wall in a scene that renders quickly."""
    scene.render.resolution_x, scene.render.resolution_y, scene.cycles.samples = 12, 9, 1
    set_world(scene)
    paint, _ = material("Paint", "ShaderNodeBsdfDiffuse")
    wall(scene, paint)
    return paint


@pytest.fixture
def job(tmp_path):
    folder = tmp_path / "job"
    folder.mkdir()
    return folder


def saved(job):
    """Save the open file; no path in it then counts as chosen in this session."""
    path = job / "scene.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path), relative_remap=False, compress=False)
    forget_trust()
    return path


def lensfield(capfd, *arguments):
    """Exit status and all output of the command, in this process."""
    capfd.readouterr()
    status = cli.main([str(each) for each in arguments])
    said = capfd.readouterr()
    return status, said.out + said.err


def image_node(paint, path, source="FILE"):
    image = bpy.data.images.new("Picture", 4, 4)
    image.source, image.filepath = source, path
    node = paint.node_tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    diffuse = next(each for each in paint.node_tree.nodes if each.bl_idname == "ShaderNodeBsdfDiffuse")
    paint.node_tree.links.new(node.outputs["Color"], diffuse.inputs["Color"])


def file_node(kind):
    def add(paint, job):
        node = paint.node_tree.nodes.new(kind)
        node.mode, node.filepath = "EXTERNAL", "//file"
    return add


def library(paint, job):
    bpy.data.libraries.write(str(job / "file"), {bpy.data.materials.new("Other")})
    with bpy.data.libraries.load(str(job / "file"), link=True) as (_, into):
        into.materials = ["Other"]
    bpy.context.scene.objects[-1].data.materials.append(into.materials[0])


def font(paint, job):
    shutil.copy(FONT, job / "file")
    text = bpy.data.curves.new("Text", "FONT")
    text.font = bpy.data.fonts.load(str(job / "file"))
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("Text", text))


def sound(paint, job):
    (job / "file").write_bytes(b"RIFF")
    speaker = bpy.data.speakers.new("Speaker")
    speaker.sound = bpy.data.sounds.load(str(job / "file"))
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("Speaker", speaker))


def volume(paint, job):
    smoke = bpy.data.volumes.new("Smoke")
    smoke.filepath = "//file"
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("Smoke", smoke))


def alembic(paint, job):
    (job / "file.abc").write_bytes(b"Ogawa")
    bpy.ops.cachefile.open(filepath=str(job / "file.abc"))
    bpy.data.cache_files[0].filepath = "//file"
    modifier = bpy.context.scene.objects[-1].modifiers.new("Cache", "MESH_SEQUENCE_CACHE")
    modifier.cache_file = bpy.data.cache_files[0]


def mesh_cache(paint, job):
    bpy.context.scene.objects[-1].modifiers.new("Cache", "MESH_CACHE").filepath = "//file"


def import_node(paint, job):
    group = bpy.data.node_groups.new("Import", "GeometryNodeTree")
    group.interface.new_socket(name="Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    node = group.nodes.new("GeometryNodeImportPLY")
    node.inputs[0].default_value = str(job / "file")
    group.links.new(node.outputs[0], group.nodes.new("NodeGroupOutput").inputs[0])
    bpy.context.scene.objects[-1].modifiers.new("Import", "NODES").node_group = group


NAMING = {"image": lambda paint, job: image_node(paint, "//file"), "library": library, "font": font, "sound": sound,
          "volume": volume, "cache": alembic, "mesh cache": mesh_cache, "IES lamp": file_node("ShaderNodeTexIES"),
          "shader script": file_node("ShaderNodeScript"), "file of a node": import_node}


@pytest.mark.parametrize("special_file", ["pipe", "device"])
@pytest.mark.parametrize("kind", NAMING)
def test_a_pipe_or_device_is_rejected_before_blender_opens_it(paint, job, capfd, kind, special_file):
    NAMING[kind](paint, job)
    blend, file = saved(job), job / "file"
    file.unlink(missing_ok=True)
    os.mkfifo(file) if special_file == "pipe" else file.symlink_to("/dev/zero")
    status, said = lensfield(capfd, "lint", blend, *LENS)
    assert status == 1 and f"{file}: {kind} is a device or pipe: {blend} names it: expected a regular file" in said


@pytest.mark.parametrize("command", ["lint", "render"])
@pytest.mark.parametrize("source, named, number", [("SEQUENCE", "//tex0001.png", "0007"), ("TILED", "//tex<UDIM>.png",
                                                                                         "1002")])
def test_pipes_among_frames_and_tiles_are_rejected(paint, job, capfd, command, source, named, number):
    image_node(paint, named, source)
    blend = saved(job)
    os.mkfifo(job / f"tex{number}.png")
    status, said = lensfield(capfd, command, blend, *LENS)
    assert status == 1 and f"tex{number}.png: image is a device or pipe: image 'Picture' names it" in said


def test_pipes_among_simulation_caches_are_rejected(paint, job, capfd):
    blend = saved(job)
    (job / "blendcache_scene").mkdir()
    os.mkfifo(job / "blendcache_scene" / "0001.bphys")
    status, said = lensfield(capfd, "lint", blend, *LENS)
    assert status == 1 and "0001.bphys: cache is a device or pipe" in said


def particles(modifiers):
    """The point cache of new particles, external, in a folder."""
    modifiers.new("Particles", "PARTICLE_SYSTEM")
    cache = bpy.context.scene.objects[-1].particle_systems[0].point_cache
    cache.use_external, cache.filepath = True, "//caches"
    return cache


def smoke(modifiers):
    modifiers.new("Fluid", "FLUID").fluid_type = "DOMAIN"
    modifiers["Fluid"].domain_settings.cache_directory = "//caches"


def ocean(modifiers):
    modifiers.new("Ocean", "OCEAN").filepath = "//caches"


def bake(modifiers):
    modifiers.new("Nodes", "NODES").bake_directory = "//caches"


CACHES = {"point cache": (particles, "a_000001_00.bphys"), "fluid": (smoke, "data/fluid_data_0001.vdb"),
          "mesh of a fluid": (smoke, "mesh/lMesh_0001.bobj.gz"), "bake": (bake, "12/meta/000001_00000.json"),
          "blob": (bake, "12/blobs/000001_00000.blob")}


def cache_job(paint, job, kind):
    """A saved scene with a modifier, and a pipe in the place of one of its caches."""
    add, name = CACHES[kind]
    add(bpy.context.scene.objects[-1].modifiers)
    blend = saved(job)
    (job / "caches" / name).parent.mkdir(parents=True)
    os.mkfifo(job / "caches" / name)
    return blend, job / "caches" / name


@pytest.mark.parametrize("kind", CACHES)
def test_pipes_among_named_caches_are_rejected(paint, job, capfd, kind):
    blend, cache = cache_job(paint, job, kind)
    status, said = lensfield(capfd, "lint", blend, *LENS)
    assert status == 1 and f"{cache}: cache is a device or pipe" in said
    with refused(InputError, field="cache", value="a device or pipe"):
        check_sources(bpy.context.scene)


@pytest.mark.parametrize("name", ["tools/queue", "queue", "tools/a_000001_00.bphys", "data/queue",
                                  "tools/disp_0001.exr"])
@pytest.mark.parametrize("add", [particles, smoke, ocean, bake])
def test_other_files_in_a_cache_folder_are_left_alone(paint, job, capfd, add, name):
    """The folder may be the project's own."""
    add(bpy.context.scene.objects[-1].modifiers)
    blend = saved(job)
    (job / "caches" / name).parent.mkdir(parents=True)
    os.mkfifo(job / "caches" / name)
    check_sources(bpy.context.scene)
    status, said = lensfield(capfd, "lint", blend, *LENS)
    assert status == 0, said


def test_the_folder_of_a_cache_that_is_not_in_use_is_left_alone(paint, job, capfd):
    """Particles are cached in memory, and the ocean is not baked."""
    modifiers = bpy.context.scene.objects[-1].modifiers
    particles(modifiers).use_external = False
    ocean(modifiers)
    blend = saved(job)
    (job / "caches").mkdir()
    for name in ("a_000001_00.bphys", "disp_0001.exr"):
        os.mkfifo(job / "caches" / name)
    check_sources(bpy.context.scene)
    status, said = lensfield(capfd, "lint", blend, *LENS)
    assert status == 0, said


def test_pipes_among_the_caches_of_a_baked_ocean_are_rejected(paint, job, capfd):
    """Only a window can mark an ocean as baked, so its mark is set in the file."""
    ocean(bpy.context.scene.objects[-1].modifiers)
    blend = saved(job)
    _mark_ocean_as_baked(blend)
    (job / "caches").mkdir()
    os.mkfifo(job / "caches" / "disp_0001.exr")
    status, said = lensfield(capfd, "lint", blend, *LENS)
    assert status == 1 and "disp_0001.exr: cache is a device or pipe" in said


def _mark_ocean_as_baked(blend):
    with open(blend, "rb") as file:
        layouts = _layouts(_Blocks(blend, file))
    with open(blend, "rb") as file:
        before, = (data for number, _, data in _Blocks(blend, file).read(layouts)
                   if layouts[number].name == "OceanModifierData")
    place, _ = next(each.fields["cached"] for each in layouts.values() if each.name == "OceanModifierData")
    after = before[:place] + b"\1" + before[place + 1:]
    blend.write_bytes(blend.read_bytes().replace(before, after))


def test_a_scene_that_is_a_pipe_is_rejected(job, capfd):
    os.mkfifo(job / "scene.blend")
    for command in ("lint", "render"):
        status, said = lensfield(capfd, command, job / "scene.blend", *LENS)
        assert status == 1 and "scene.blend: scene is a device or pipe: expected a .blend file" in said


def test_a_pipe_linked_through_a_library_is_rejected(paint, job, capfd):
    library(paint, job)
    middle = saved(job).rename(job / "middle.blend")
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    with bpy.data.libraries.load(str(middle), link=True) as (_, into):
        into.materials = ["Paint"]
    wall(bpy.context.scene, into.materials[0])
    blend = saved(job)
    (job / "file").unlink()
    os.mkfifo(job / "file")
    status, said = lensfield(capfd, "lint", blend, *LENS)
    assert status == 1 and f"{job / 'file'}: library is a device or pipe: {middle} names it" in said


def test_a_window_also_rejects_pipes(paint, job):
    """Blender has opened the file, but reads its images only for display."""
    image_node(paint, str(job / "file"))
    os.mkfifo(job / "file")
    with pytest.raises(InputError, match="file: image is a device or pipe: image 'Picture' names it"):
        check_sources(bpy.context.scene)
    refusals = addon.preflight(bpy.context.scene, output_folder=job, lens="edmund-54852",
                               wavelengths_nm=[550.0]).refusals
    assert any("image is a device or pipe" in str(each) for each in refusals)


def test_a_file_of_a_terabyte_is_rejected(paint, job, capfd):
    image_node(paint, "//file")
    blend = saved(job)
    with open(job / "file", "wb") as file:
        file.truncate(2**40)
    status, said = lensfield(capfd, "lint", blend, *LENS)
    assert status == 1 and "image is 1048576 MB: expected at most 65536 MB" in said


@pytest.mark.parametrize("compress", [True, False])
def test_a_missing_texture_is_not_rejected(paint, job, capfd, compress):
    image_node(paint, "//file")
    bpy.ops.wm.save_as_mainfile(filepath=str(job / "scene.blend"), compress=compress)
    status, said = lensfield(capfd, "lint", job / "scene.blend", *LENS)
    assert status == 0 and f"output: {job / 'lensfield'}" in said


@pytest.mark.parametrize("damage", [lambda data: data[:len(data) // 2], lambda data: b"BLENDER" + data[60:],
                                    lambda data: data.replace(b"DNA1", b"DNA2"), lambda _: b"", lambda _: b"text"])
def test_a_damaged_blend_is_reported_in_one_line(paint, job, capfd, damage):
    bpy.ops.wm.save_as_mainfile(filepath=str(job / "scene.blend"), compress=False)
    (job / "scene.blend").write_bytes(damage((job / "scene.blend").read_bytes()))
    status, said = lensfield(capfd, "lint", job / "scene.blend", *LENS)
    assert status == 1 and "scene.blend: scene is not readable: expected a .blend file (" in said
    assert len(said.splitlines()) == 1


@pytest.mark.parametrize("folder", ["/", "//..", "//../", "//a/../../b", "//link/", "//link/below", "/tmp", "~/x", "~",
                                    "C:\\renders\\", "\\\\server\\share", "//..\\..\\x", "renders"])
def test_a_blend_cannot_write_outside_its_folder(paint, job, tmp_path, monkeypatch, capfd, folder):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "away").mkdir()
    (job / "link").symlink_to(tmp_path / "away")
    bpy.context.scene.lensfield.output_folder = folder
    blend = saved(job)
    for command in (("lint",), ("render",), ("render", "--frames", "1-2")):
        status, said = lensfield(capfd, command[0], blend, *command[1:], *LENS)
        assert status == 1 and "scene settings: output folder is " in said and "--output" in said, said
    paths = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*")}
    assert paths == {"away", "job", "job/link", "job/scene.blend"}


@pytest.mark.parametrize("folder, name", [("//", "."), ("//renders/shot", "renders/shot"),
                                          ("//renders\\shot\\", "renders/shot"), ("//a/../b", "b")])
def test_a_blend_can_write_below_its_folder(paint, job, capfd, folder, name):
    bpy.context.scene.lensfield.output_folder = folder
    status, said = lensfield(capfd, "lint", saved(job), *LENS)
    assert status == 0 and f"output: {(job / name).resolve()}\n" in said


def test_escape_sequences_in_names_do_not_reach_the_terminal(paint, job, capfd):
    """They could change the terminal's title, colours and keys, or hide a line."""
    bpy.context.scene.lensfield.output_folder = "//a\x1b]0;owned\x07\nrefused: b\x9b31m"
    paint.name = "Paint\x1b[2J"
    blend = saved(job)
    for command, *more in (("lint",), ("render", "--frames", "1"), ("render", "--frames", "1")):
        status, said = lensfield(capfd, command, blend, *more, *LENS)
        assert status == 0 and "owned" in said, said
        assert not set(said) & {"\x1b", "\x07", "\x9b"} and "\nrefused" not in said


def test_one_line_states_the_output_folder(paint, job, tmp_path, capfd):
    bpy.context.scene.lensfield.output_folder = "/"
    status, said = lensfield(capfd, "render", saved(job), *LENS, "--output", tmp_path / "out")
    assert status == 0 and said.count("output: ") == 1 and f"output: {tmp_path / 'out'}\n" in said
    assert (tmp_path / "out" / "scene_Scene_0001_lens_image.exr").is_file()


def test_output_does_not_follow_a_link(paint, job, tmp_path, capfd):
    blend = saved(job)
    (job / "lensfield").mkdir()
    (job / "lensfield" / "scene_Scene_0001_before.png").symlink_to(tmp_path / "away.png")
    for command in ("lint", "render"):
        status, said = lensfield(capfd, command, blend, *LENS)
        assert status == 1 and "scene_Scene_0001_before.png: file is a link that leaves its folder: remove it" in said
    assert not (tmp_path / "away.png").exists()


@pytest.mark.parametrize("link", [True, False])
@pytest.mark.parametrize("field", ["lens", "camera", "reflectance"])
def test_file_contents_are_not_quoted_in_the_log(paint, job, tmp_path, capfd, field, link):
    secret = tmp_path / "shadow.toml"
    secret.write_text(SECRET)
    named = job / "own.toml" if link else secret
    if link:
        named.symlink_to(secret)
    if field in ("lens", "camera"):
        name = "body" if field == "camera" else field
        adjust(bpy.context.scene, **{name: "FILE", f"{name}_file": str(named)})
        given = () if field == "lens" else LENS
    else:
        paint.lensfield.reflectance, given = str(named), LENS
    blend = saved(job)
    for command in ("lint", "render"):
        status, said = lensfield(capfd, command, blend, *given)
        assert status == 1 and "not valid: the .blend names the file, so its content is not quoted" in said
        assert "salt" not in said and "root:" not in said
    status, said = lensfield(capfd, "lint", blend, f"--{'camera' if field == 'camera' else 'lens'}", named, *given)
    assert "salt" not in said if field == "reflectance" else "not quoted" not in said


@pytest.fixture
def untrusted(job, tmp_path, capfd):
    """A function that runs a command with --untrusted: returns the exit status and all output."""
    def run(command, *more):
        output = ("--output", tmp_path / "out") if command == "render" else ()
        return lensfield(capfd, command, job / "scene.blend", *LENS, "--untrusted", *output, *more)
    return run


@pytest.mark.sample(1)
@pytest.mark.parametrize("kind", ["image", "library", "link"])
def test_untrusted_jobs_read_only_below_their_folders(paint, job, tmp_path, untrusted, kind):
    away = tmp_path / "away"
    away.mkdir()
    if kind == "library":
        library(paint, away)
    else:
        bpy.data.images.new("Other", 4, 4).save(filepath=str(away / "file"))
        image_node(paint, str(away / "file") if kind == "image" else "//link.png")
        (job / "link.png").symlink_to(away / "file")
    saved(job)
    status, said = untrusted("lint")
    assert status == 1 and "file is outside the scene's folder and --root: --untrusted reads files below" in said
    status, said = untrusted("lint", "--root", away)
    assert status == 0, said


def test_untrusted_jobs_require_output_and_run_no_scripts(paint, job, tmp_path, capfd, untrusted):
    driver = bpy.context.scene.camera.driver_add("location", 0).driver
    driver.expression = f"__import__('pathlib').Path({str(tmp_path / 'ran')!r}).touch() or 0"
    saved(job)
    status, said = lensfield(capfd, "render", job / "scene.blend", *LENS, "--untrusted")
    assert status == 1 and "--output is not given: required, because --untrusted writes only below it" in said
    status, said = untrusted("render", "--report", tmp_path / "report.json")
    assert status == 1 and "report.json: file is outside --output" in said
    status, said = untrusted("render")
    assert status == 0 and (tmp_path / "out" / "scene_Scene_0001_lens_image.exr").is_file()
    assert not (tmp_path / "ran").exists()


def test_untrusted_jobs_reject_import_nodes(paint, job, untrusted):
    import_node(paint, job)
    saved(job)
    status, said = untrusted("lint")
    assert status == 1 and "node is GeometryNodeImportPLY: --untrusted refuses import nodes" in said


def test_an_endless_render_stops_at_the_time_limit(paint, job, untrusted):
    """With 2^24 samples for each of four million pixels: years of work on any machine."""
    saved(job)
    status, said = untrusted("render", "--samples", 1 << 24, "--resolution", "2000x2000", "--time-limit", 5)
    assert status == 1 and said.splitlines()[-1].endswith("scene.blend: time limit is 5 s: exceeded: --time-limit")


@pytest.mark.skipif(sys.platform == "darwin", reason="macOS does not keep this limit")
def test_a_memory_bomb_stops_at_the_memory_limit(paint, job, untrusted):
    bpy.context.scene.objects[-1].modifiers.new("Bomb", "SUBSURF").levels = 0
    bpy.context.scene.objects[-1].modifiers["Bomb"].render_levels = 11
    bpy.context.scene.objects[-1].modifiers["Bomb"].subdivision_type = "SIMPLE"
    saved(job)
    status, said = untrusted("render", "--memory-limit", 2.5)
    assert status == 1 and said.splitlines()[-1].endswith(
        "it may have reached the memory limit of 2.5 GB: --memory-limit")


@pytest.mark.skipif(not landlock_version(), reason="this system has no Landlock")
def test_the_operating_system_confines_untrusted_jobs(tmp_path):
    """Whatever a damaged .blend does to Blender."""
    for name in ("read", "write", "away"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "file").write_text(name)
    attempts = (("read/file", "r"), ("write/file", "a"), ("away/file", "r"), ("read/file", "a"), ("away/new", "w"),
                ("new", "w"))
    code = "import socket\n" + "".join(
        f"try: open({str(tmp_path / path)!r}, {mode!r}); print('open')\nexcept PermissionError: print('denied')\n"
        for path, mode in attempts) + (
        "try: socket.create_connection(('127.0.0.1', 9))\n"
        "except OSError as error: print(type(error).__name__)\n"
        "import os\n"
        "try: os.kill(os.getppid(), 0); print('signalled')\n"
        "except PermissionError: print('denied')\n")
    limits = tmp_path / "limits.json"
    limits.write_text(json.dumps({
        "read": [*OF_SYSTEM, sys.prefix, sys.base_prefix, str(tmp_path / "read")], "write": [str(tmp_path / "write")],
        "memory_bytes": 4 * 10**9, "cpu_s": 60}))
    completed = subprocess.run([sys.executable, "-I", confine.__file__, str(limits), sys.executable, "-c", code],
                               capture_output=True, text=True)
    connected = ["PermissionError" if landlock_version() >= confine.TCP_SINCE else "ConnectionRefusedError"]
    signalled = ["denied" if landlock_version() >= confine.SCOPES_SINCE else "signalled"]
    assert completed.stdout.split() == ["open", "open", *["denied"] * 4, *connected, *signalled], completed.stderr
