"""`lensfield render --scheduler ADDRESS`: frames as tasks for the workers of a Dask cluster.

A worker renders a task in a child process (`child.py`), which always ends with the worker. The scheduler then gives the
task to another worker, which resumes from the saved passes.
"""

import json
import platform
import uuid
from pathlib import Path
from queue import SimpleQueue

from lensfield.engine import InputError
from lensfield.engine.runtime.child import Child
from lensfield.engine.runtime.errors import shown
from lensfield.engine.runtime.files import temporary_folder
from lensfield.engine.runtime.messages import paced
from lensfield.engine.simulation.report import together

from .farm_log import LENS_IMAGE
from .sequence import frames_text
from .task import frames_by_task, lensfield_in, scene_path, task_arguments
from .terminal import progress_bar, say

RETRIES = 2  # of a task whose render has crashed: another machine may have more memory, for example
LOOK_S = 0.5  # between checks for a cancelled task
NO_MODULE = "pip install lensfield[farm]"
FOR_WINDOWS = "picture", "blend_folder", "scene_state", "scene_source", "session"
"""Options of `lensfield render` for programs that follow a render on this machine."""


def render_on_cluster(options, write):
    """Render the missing frames on the cluster; returns the report of all frames, and remarks.

    Raises
    ------
    InputError
        The scheduler does not answer; or frames failed, raised after all others are finished.
    """
    for name in FOR_WINDOWS:
        if getattr(options, name) is not None:
            raise InputError("options", "--" + name.replace("_", "-"), str(getattr(options, name)),
                             "not possible with --scheduler: leave it out")
    tasks = frames_by_task(options)
    arguments = ["render", scene_path(options), *task_arguments(options), "--wait", "--progress=lines",
                 "--end-with-stdin"]
    images, failures = {}, {}
    with _client(options.scheduler) as client, progress_bar() as bar:
        on_progress = bar if options.progress == "bar" else paced(write)
        for frames, outcome in _finished_tasks(client, tasks, arguments, options.blender, on_progress):
            for frame, image in outcome["frames"]:
                images[frame] = image
                say(f"frame {frame}: {image}")
                write(lens_image=image, frame=frame)
            if "error" in outcome and (lost := [frame for frame in frames if frame not in images]):
                failures |= dict.fromkeys(lost, outcome["error"])
                say(f"{_named(lost)}: {outcome['error']}")
    if failures:
        first = next(iter(failures.values()))
        raise InputError(_named(failures), "render", "incomplete",
                         f"{len(images)} of {sum(map(len, tasks))} frames are finished: {first}")
    remarks = [f"{len(images)} frame{'s' * (len(images) != 1)} finished"]
    if older := sorted({frame for task in tasks for frame in task} - images.keys()):
        remarks.append(f"the scene has changed since {len(older)} of the finished frames, from frame {older[0]} on: "
                       "--overwrite renders them again")
    say(*remarks)
    return together({}, {frame: _record(image) for frame, image in images.items()} if options.report else {}), remarks


def _named(frames):
    return f"frame{'s' * (len(frames) != 1)} {frames_text(sorted(frames))}"


def _record(image):
    return json.loads(Path(image.removesuffix(LENS_IMAGE) + "report.json").read_text(encoding="utf-8"))


def _client(address):
    try:
        from distributed import Client
    except ImportError:
        raise InputError("distributed", "module", "not installed", NO_MODULE) from None
    try:
        client = Client(address, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise InputError("options", "--scheduler", address, f"no scheduler answers at this address: {error}") from None
    for worker, threads in client.nthreads().items():
        if threads > 1:
            say(f"{worker} renders {threads} tasks at once: start workers with --nthreads 1")
    return client


def _finished_tasks(client, tasks, arguments, blender, on_progress):
    """Yield each task when it ends: (frames, result of `render_frames`)."""
    heard, run = SimpleQueue(), uuid.uuid4().hex
    client.subscribe_topic(run, lambda event: heard.put(event[1]))
    futures = {}
    for frames in tasks:
        future = client.submit(render_frames, arguments, frames, blender, run, retries=RETRIES, pure=False,
                               key=f"lensfield {frames_text(frames)} {run}")
        futures[future.key] = future, frames
        future.add_done_callback(heard.put)
    shares, total = {}, sum(map(len, tasks))
    while futures:
        news = heard.get()
        if isinstance(news, dict):
            shares[news["frames"]] = news["fraction"] * news["count"]
            on_progress(min(sum(shares.values()) / total, 1.0), news["label"])
        elif news.key in futures:
            _, frames = futures.pop(news.key)
            shares[frames_text(frames)] = len(frames)
            on_progress(min(sum(shares.values()) / total, 1.0), f"frames {frames_text(frames)}: finished")
            yield frames, _outcome(news)


def _outcome(future):
    if future.status == "finished":
        return future.result()
    error = future.exception() if future.status == "error" else None
    return {"frames": [], "error": shown(str(error or f"the task was {future.status}"), 400)}


def render_frames(arguments, frames, blender, topic):
    """Render the frames of a task in a child process, on a worker.

    Parameters
    ----------
    arguments : list of str
        Arguments of `lensfield`, except the frames.
    frames : list of int
    blender : str or None
    topic : str
        Topic of the progress events.

    Returns
    -------
    dict
        frames: [(frame, its lens image), ...] of the existing frames; error, if the child reported one.

    Raises
    ------
    RuntimeError
        The child has crashed.
    """
    from distributed import get_worker

    worker, images, text = get_worker(), {}, frames_text(frames)
    key = worker.get_current_task()
    on_progress = paced(lambda **facts: worker.log_event(topic, facts | {"frames": text, "count": len(frames)}),
                        1.0, 1.0)

    def hear(facts):
        if "fraction" in facts:
            on_progress(facts["fraction"], facts["label"])
        if "frame" in facts:
            images[facts["frame"]] = facts["lens_image"]

    with temporary_folder() as folder:
        child = Child([*lensfield_in(blender), *arguments, f"--frames={text}"], folder, hear)
        try:
            while not child.ended_within(LOOK_S):
                if worker.state.tasks[key].state == "cancelled":  # the client is gone
                    return {"frames": []}
        finally:
            child.end()
        if "error" not in child.status and "messages" not in child.status:
            why, log = child.death()
            raise RuntimeError(f"{why} (log: {log} on {platform.node()})")
    return {"frames": sorted(images.items())} | ({"error": child.status["error"]} if "error" in child.status else {})
