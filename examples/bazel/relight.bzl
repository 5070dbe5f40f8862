"""relight_bake: an asset from a capture, as an action of its own that sees only what it declares."""

def _relight_bake_impl(ctx):
    arguments = ctx.actions.args()
    arguments.add("bake")
    arguments.add(ctx.file.input)
    arguments.add("-o", ctx.outputs.out)
    arguments.add("-j", str(ctx.attr.threads))
    arguments.add_all(ctx.attr.options)
    ctx.actions.run(
        executable = ctx.executable.relight,
        arguments = [arguments],
        inputs = depset([ctx.file.input] + ctx.files.srcs),
        outputs = [ctx.outputs.out],
        mnemonic = "RelightBake",
        progress_message = "Baking %s" % ctx.outputs.out.short_path,
        execution_requirements = {"cpu:%d" % ctx.attr.threads: ""},
    )
    return [DefaultInfo(files = depset([ctx.outputs.out]))]

relight_bake = rule(
    implementation = _relight_bake_impl,
    doc = "Bakes one asset. The same inputs give the same bytes on every machine, so that remote caches may hold it.",
    attrs = {
        "input": attr.label(
            mandatory = True,
            allow_single_file = [".lp", ".toml"],
            doc = "A light file, or a job file; paths in it are relative to it.",
        ),
        "srcs": attr.label_list(
            mandatory = True,
            allow_files = True,
            doc = "All files that the bake reads besides: pictures, the light file of a job. `relight inputs JOB --format bazel` lists them.",
        ),
        "out": attr.output(mandatory = True, doc = "The asset, such as icon.ktx2."),
        "options": attr.string_list(doc = "Options of relight bake."),
        "threads": attr.int(default = 1, doc = "Threads, which Bazel counts as cores. The bytes do not depend on it."),
        "relight": attr.label(
            default = "@relight//:relight",
            executable = True,
            cfg = "exec",
            allow_files = True,
            doc = "The program.",
        ),
    },
)

def _relight_program_impl(ctx):
    program = ctx.path(ctx.attr.path) if ctx.attr.path else ctx.which("relight")
    if not program:
        fail("relight is not in PATH; give relight_program a path")
    ctx.symlink(program, "relight")
    ctx.file("BUILD.bazel", 'exports_files(["relight"], visibility = ["//visibility:public"])\n')

relight_program = repository_rule(
    implementation = _relight_program_impl,
    doc = "The program of this machine, as @relight//:relight.",
    attrs = {"path": attr.string(doc = "Where it is, instead of the first in PATH.")},
    environ = ["PATH"],
    local = True,
)
