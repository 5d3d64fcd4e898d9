// SPDX-License-Identifier: GPL-3.0-or-later
// Made by Lensfield: its job type for Flamenco 3.8 and later. Renders frames of a .blend through its lens. Put this
// file into the folder `scripts` next to flamenco-manager. All other settings are the .blend's own Lensfield settings.

const JOB_TYPE = {
    label: "Lensfield Render",
    description: "Render frames through the lens of the scene's Lensfield settings",
    settings: [
        { key: "frames", type: "string", required: true,
          eval: "f'{C.scene.frame_start}-{C.scene.frame_end}' if C.scene.frame_step == 1 else "
              + "','.join(map(str, range(C.scene.frame_start, C.scene.frame_end + 1, C.scene.frame_step)))",
          evalInfo: { showLinkButton: true, description: "Scene frame range" },
          description: "Frames to render, such as 47, or 1-30, or 3, 5-10" },
        { key: "chunk_size", type: "int32", default: 1, propargs: { min: 1 }, visible: "submission",
          description: "Frames in each task; they share the start of Blender and the preparation of the lens" },
        { key: "output_folder", type: "string", subtype: "dir_path", required: true,
          eval: "str(abspath(C.scene.lensfield.output_folder))",
          description: "Folder for the pictures; every worker must find it at this path" },
        { key: "overwrite", type: "bool", default: false,
          description: "Render existing frames again" },
        { key: "any_build", type: "bool", default: false,
          description: "Accept finished frames from other builds of Lensfield" },
        { key: "scene_name", type: "string", required: true, visible: "hidden",
          eval: "C.scene.name" },
        { key: "lens", type: "string", required: true, visible: "hidden",
          eval: "C.scene.lensfield.lens_name_or_path()" },
        { key: "blendfile", type: "string", required: true, visible: "web",
          description: "The .blend to render" },
    ]
};

function compileJob(job) {
    for (const chunk of frameChunker(job.settings.frames, job.settings.chunk_size)) {
        const task = author.Task(`render-${chunk}`, "blender");
        task.addCommand(renderCommand(job.settings, chunk));
        job.addTask(task);
    }
}

// Separate arguments, without a shell: paths may contain any characters.
function renderCommand(settings, chunk) {
    const args = [
        `--frames=${chunk}`, "--wait", "--progress=flamenco", `--output=${settings.output_folder}`,
        `--scene-name=${settings.scene_name}`, `--lens=${settings.lens}`,
    ];
    if (settings.overwrite) {
        args.push("--overwrite");
    }
    if (settings.any_build) {
        args.push("--any-build");
    }
    return author.Command("blender-render", {
        exe: "{blender}",
        exeArgs: "{blenderArgs}",
        argsBefore: ["--background", "--command", "lensfield", "render"],
        blendfile: settings.blendfile,
        args: args,
    }, frameCount(chunk));
}
