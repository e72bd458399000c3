"""The command line.

Exit codes: 0 done, 1 a comparison failed, 2 bad input (one sentence on stderr), 3 an error of this program, 128 and its
number for a signal.
"""

import os
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from milkglass import __version__
from milkglass.core.errors import InputError
from milkglass.viewer.commands import edit as edit_command, endings
from milkglass.viewer.commands.options import PHOTO_FLAGS, scene_options
from milkglass.viewer.files.formats import PICTURE_FORMATS, check_picture_output, format_of
from milkglass.viewer.files.record import is_picture, read_record
from milkglass.viewer.scene.keys import input_files
from milkglass.viewer.scene.scene import Scene, default_scene, first_look

if TYPE_CHECKING:
    from milkglass.viewer.render.picture import Frame, Still

# OpenGL, FFTW and the window are imported inside the commands that need them: help and tables stay fast and
# work on a machine that has none of them.
DEBUG = "--debug"
PIPE_CLOSED = 141  # what a shell says of a program that wrote to a closed pipe
DEFAULT_PICTURE = "milkglass.png"
RENDERED = " or ".join(f"{suffix} ({kind.rendered})" for suffix, kind in PICTURE_FORMATS.items())
DEFAULT_SAMPLES = 4
FIRST_SAMPLES = 16  # a pixel of the default scene: nobody waits for a slider there, and edges are smooth
DEFAULT_REPORT_POINTS = 300
DEFAULT_REPORT_PHOTONS = 100_000
DEFAULT_PATHS = 256
DEFAULT_THRESHOLD = 1.0 / 255.0  # one step of 8 bits, see viewer.error.compare

app = typer.Typer(
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Translucent objects by subsurface scattering: an interactive viewer and a renderer.",
    epilog="`milkglass` alone shows the default scene.",
)
app.command()(edit_command.edit)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code; bad input gives one sentence on stderr."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    debugging = DEBUG in words
    try:
        with endings.terminated():
            code = app(args=[word for word in words if word != DEBUG], prog_name="milkglass", standalone_mode=False)
            sys.stdout.flush()
    except typer.TyperException as error:
        return _fail(usage_sentence(error))
    except InputError as error:
        return _fail(str(error))
    except MemoryError:
        return _fail("not enough memory; ask for a smaller --image-size, --resolution or --layers")
    except (KeyboardInterrupt, typer.Abort):
        return 130
    except SystemExit as ending:  # of a signal; of rich, with 1, where the pipe that it prints to is closed
        return PIPE_CLOSED if ending.code == 1 else int(ending.code or 0)
    except Exception as error:
        if isinstance(error, OSError) and (sentence := endings.of_system(error)) is not None:
            return _fail(sentence) if sentence else PIPE_CLOSED
        if debugging:
            raise
        _say(endings.of_program(error))
        return 3
    return code if isinstance(code, int) else 0


@app.callback(invoke_without_command=True)
def default(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Show the version and exit.")] = False,
    debug: Annotated[  # taken by `main`, so that it may stand anywhere
        bool, typer.Option(DEBUG, help="Show the traceback of an error of this program.")
    ] = False,
) -> None:
    """Show the default scene in a window; without a display, write a picture of it."""
    if version:
        typer.echo(f"milkglass {__version__}")
    elif context.invoked_subcommand is None:
        if has_display():
            _run_window(default_scene())
        else:
            _save(_render(default_scene(), FIRST_SAMPLES, 0, [DEFAULT_PICTURE]), [DEFAULT_PICTURE])
            typer.echo(f"There is no display for a window, so the default scene went to {DEFAULT_PICTURE}.")


@app.command()
@partial(scene_options, start=first_look(), extra_flags=PHOTO_FLAGS)
def view(
    scene: Scene,
    context: typer.Context,
    record: Annotated[
        str | None, typer.Option(metavar="FILE", help="Record the interaction: frames and events.")
    ] = None,
    play: Annotated[str | None, typer.Option(metavar="FILE", help="Replay a recording, without a display too.")] = None,
    into: Annotated[
        str | None, typer.Option(metavar="DIR", help="Folder that a replay may write into; none without.")
    ] = None,
    photo: Annotated[str | None, typer.Option(metavar="FILE", help="Photograph whose object is edited.")] = None,
    mask: Annotated[str | None, typer.Option(metavar="FILE", help="Its mask; without one it is painted.")] = None,
) -> None:
    """Show a model in a window, at first in jade on a ground, or the object of a photograph in another material."""
    if any(context.params[name] is not None for name in ("photo", "mask", *(flag.parameter for flag in PHOTO_FLAGS))):
        from milkglass.viewer.commands import photograph as photo_command

        photo_command.run(context.params, has_display=has_display())
        return
    if play is not None:
        from milkglass.viewer.window import replay

        replay.play(Path(play), in_window=has_display(), into=None if into is None else Path(into))
        return
    path = context.params["scene"]
    if record is not None:
        _check_inputs_stay(scene, record, "--record", {"scene file": path})
    if not has_display():
        raise InputError("there is no display for a window; write a picture with `milkglass render --output FILE`")
    _run_window(scene, None if path is None else Path(path), None if record is None else Path(record))


@app.command()
@scene_options
def render(
    scene: Scene,
    output: Annotated[list[str], typer.Option("--output", "-o", metavar="FILE", help=f"{RENDERED}; may be repeated.")],
    context: typer.Context,
    mask: Annotated[str | None, typer.Option(metavar="FILE.png", help="Coverage by the object, 8 bits.")] = None,
    depth: Annotated[
        str | None, typer.Option(metavar="FILE", help="Distance along the camera's axis: .exr (mm), .png (16 bits).")
    ] = None,
    reference: Annotated[
        str | None, typer.Option(metavar="FILE", help="Picture to compare with; exit code 1 if they differ.")
    ] = None,
    reference_threshold: Annotated[
        float,
        typer.Option(metavar="T", min=0.0, show_default="1/255", help="Largest accepted rms difference."),
    ] = DEFAULT_THRESHOLD,
    samples: Annotated[
        int | None,
        typer.Option(metavar="N", min=1, max=256, show_default="4", help="Antialiasing samples a pixel."),
    ] = None,
    seed: Annotated[
        int | None, typer.Option(metavar="N", min=0, max=2**32 - 1, show_default="0", help="Seed of the samples.")
    ] = None,
    report: Annotated[
        str | None,
        typer.Option(metavar="FILE.json", help="Error against a reference in float64; a map beside it, .png."),
    ] = None,
    report_points: Annotated[
        int, typer.Option(metavar="N", min=1, max=100_000, help="Random visible points of the report.")
    ] = DEFAULT_REPORT_POINTS,
    report_photons: Annotated[
        int,
        typer.Option(metavar="N", min=0, max=100_000_000, help="Photons a light and mean free path; 0: none walk."),
    ] = DEFAULT_REPORT_PHOTONS,
    path_traced: Annotated[
        str | None, typer.Option(metavar="FILE.exr", help="Picture by traced paths (Mitsuba), to compare with.")
    ] = None,
    path_traced_samples: Annotated[
        int, typer.Option(metavar="N", min=2, max=1_000_000, help="Paths a pixel of that.")
    ] = DEFAULT_PATHS,
    verbose: Annotated[bool, typer.Option("--verbose", help="Show the time of each stage.")] = False,
) -> None:
    """Write pictures of a model without a window."""
    _check_outputs(scene, output, reference, report)
    _check_planes(scene, mask, depth)
    samples, seed = _sampling(context.params["scene"], samples, seed)
    compared = None if reference is None else _counterpart(reference, output)
    if path_traced is not None:
        from milkglass.viewer.error import path_traced as tracing

        tracing.check(scene, Path(path_traced), output)
        typer.echo(tracing.run(scene, Path(path_traced), path_traced_samples, seed))
    if report is None:
        frame = _render(scene, samples, seed, output, linear=mask is not None or depth is not None)
        _save(frame, output)
    else:
        frame = _render_with_report(scene, samples, seed, output, report, report_points, report_photons)
    if mask is not None:
        frame.save_mask(mask)  # type: ignore[union-attr]  # a `Frame` where one is asked for
    if depth is not None:
        frame.save_depth(depth)  # type: ignore[union-attr]
    if verbose:
        from milkglass.viewer.commands import terminal

        terminal.show_frame(frame)
    if reference is not None and compared is not None:
        _compare(Path(compared), Path(reference), reference_threshold)


@app.command()
def sweep(
    file: Annotated[str, typer.Argument(metavar="SWEEP.toml", help="A base scene, and what varies.")],
    output: Annotated[
        str, typer.Option("--output", "-o", metavar="DIR", help="Folder of the pictures; what is there stays.")
    ],
    workers: Annotated[int, typer.Option(metavar="N", min=1, max=1024, help="Processes that render.")] = 1,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Dask scheduler whose workers render.")
    ] = None,
    shard: Annotated[str | None, typer.Option(metavar="I/N", help="Make the I-th of N shares alone.")] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Say how many, how long and how large, and stop.")] = False,
    yes: Annotated[bool, typer.Option("--yes", help="Make more than a million pictures.")] = False,
) -> None:
    """Write many pictures of a scene; what is there already is not made again."""
    from milkglass.viewer.commands import sweep as sweeping

    sweeping.run(file, output, workers, scheduler, shard, dry=dry_run, yes=yes)


@app.command()
def fit(
    pictures: Annotated[list[str], typer.Argument(metavar="PICTURE...", help="EXR (linear), or PNG, JPEG (sRGB).")],
    scene: Annotated[
        list[str], typer.Option("--scene", metavar="FILE.toml", help="Model, camera, lights; one, or one a picture.")
    ],
    output: Annotated[str, typer.Option("--output", "-o", metavar="FILE.toml", help="The scene, of that material.")],
    mask: Annotated[
        list[str] | None, typer.Option(metavar="FILE", help="White where a picture counts; one a picture.")
    ] = None,
    exposure: Annotated[
        str, typer.Option(metavar="lights|free|known", help="What is unknown: each light, one factor, or nothing.")
    ] = "lights",
    name: Annotated[str | None, typer.Option(metavar="NAME", help="Keep the material among your own.")] = None,
) -> None:
    """Find the coefficients of a material by pictures of an object, and how sure they are."""
    from milkglass.viewer.commands import fit as fitting

    fitting.run(pictures, scene, output, mask or [], exposure, name)


@app.command()
def bench(
    quick: Annotated[bool, typer.Option("--quick", help="A small selection, for a first look.")] = False,
    output: Annotated[str | None, typer.Option(metavar="DIR", help="Folder for tables and the plot.")] = None,
    model: Annotated[
        str | None,
        typer.Option(metavar="FILE", help="Mesh of the frames and the error; the built-in sculpture's frames without."),
    ] = None,
    only: Annotated[
        str | None, typer.Option(metavar="NAME[,NAME]", help="Parts to run, such as window or exchange; all without.")
    ] = None,
) -> None:
    """Measure speed against error, and write tables and a plot."""
    from milkglass.viewer.bench import run as benchmark

    folder, file = (None if name is None else Path(name) for name in (output, model))
    parts = benchmark.PARTS if only is None else [name.strip() for name in only.split(",")]
    benchmark.run(folder, file, quick=quick, only=parts)


@app.command()
def materials(
    name: Annotated[str | None, typer.Argument(metavar="NAME", help="One material; all without.")] = None,
    only: Annotated[str, typer.Option(metavar="KIND", help="all|valid|thin|JMLH01|NGD06|milkglass|own.")] = "all",
    add: Annotated[str | None, typer.Option("--import", metavar="FILE", help="Add a file to your own.")] = None,
    export: Annotated[str | None, typer.Option(metavar="FILE", help="Write your own to a file.")] = None,
) -> None:
    """List materials, your own too: coefficients, mean free path, diffuse reflectance, validity."""
    from milkglass.viewer.commands import materials as materials_table

    materials_table.run(name, only, add, export)


def has_display() -> bool:
    """Return whether a window can be shown, without opening one."""
    if sys.platform in ("win32", "darwin"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _run_window(scene: Scene, path: Path | None = None, record: Path | None = None) -> None:
    from milkglass.viewer.commands.show import show

    show(scene, path, record)


def _sampling(scene: str | None, samples: int | None, seed: int | None) -> tuple[int, int]:
    """Return the samples and the seed: those given, else those of the picture that the scene was read from."""
    usual, usual_seed = DEFAULT_SAMPLES, 0
    if scene is not None and is_picture(scene):
        _, usual, usual_seed = read_record(scene)
    return usual if samples is None else samples, usual_seed if seed is None else seed


def _render(scene: Scene, samples: int, seed: int, outputs: Sequence[str], *, linear: bool = False) -> "Frame | Still":
    """Return the picture of a scene, tone-mapped alone where nothing and no output holds linear data."""
    from rich.console import Console

    from milkglass.viewer.commands import terminal
    from milkglass.viewer.render import memory, renderer as frame

    memory.share_heap()
    linear = linear or any(format_of(output).linear for output in outputs)
    draw = frame.render if linear else frame.render_image
    with terminal.progress_bar(Console(stderr=True)) as tell:
        picture = draw(scene, samples=samples, seed=seed, progress=tell)
    for warning in picture.warnings:
        _say(f"warning: {warning}")
    return picture


def _render_with_report(
    scene: Scene, samples: int, seed: int, outputs: Sequence[str], path: str, points: int, photons: int
) -> "Frame":
    """Write pictures and the report of their error, and return the picture; nothing is written if rendering fails."""
    from milkglass.viewer.commands import report as report_command

    frame, report = report_command.run(scene, samples, seed, points, photons)
    for warning in frame.warnings:
        _say(f"warning: {warning}")
    _save(frame, outputs)
    report.save(path)
    typer.echo(report_command.summary(report, path))
    return frame


def _check_outputs(scene: Scene, outputs: Sequence[str], reference: str | None, report: str | None = None) -> None:
    """Raise InputError for outputs that cannot be written or would overwrite an input, before any work."""
    if report is not None:
        from milkglass.viewer.commands.report import check_report

        check_report(report, scene, outputs, reference)
    for output in outputs:
        check_picture_output(output)
        _check_inputs_stay(scene, output, "--output", {"reference": reference})


def _check_planes(scene: Scene, mask: str | None, depth: str | None) -> None:
    """Raise InputError for a mask or a depth that cannot be written, or would overwrite an input, before any work."""
    from milkglass.viewer.files.images import check_output
    from milkglass.viewer.render.planes import DEPTH_SUFFIXES, MASK_SUFFIXES

    for option, target, suffixes in (("--mask", mask, MASK_SUFFIXES), ("--depth", depth, DEPTH_SUFFIXES)):
        if target is not None:
            check_output(target, suffixes)
            _check_inputs_stay(scene, target, option, {})


def _check_inputs_stay(scene: Scene, target: str, option: str, more: Mapping[str, str | None]) -> None:
    """Raise InputError for a file to write that is one of those a scene or an option reads."""
    for role, path in (*input_files(scene).items(), *more.items()):
        if path is not None and os.path.realpath(path) == os.path.realpath(target):
            raise InputError(f"{option} {target} would overwrite the {role}; choose another name")


def _counterpart(reference: str, outputs: Sequence[str]) -> str:
    """Return the output to compare with the reference: the first of its type."""
    if not Path(reference).is_file():
        raise InputError(f"--reference {reference}: there is no such file; name a picture to compare with")
    suffix = Path(reference).suffix.lower()
    for output in outputs:
        if Path(output).suffix.lower() == suffix:
            return output
    raise InputError(f"--reference {reference} can only be compared with an --output that ends in {suffix}")


def _save(frame: "Frame | Still", outputs: Sequence[str]) -> None:
    for output in outputs:
        frame.save(output)


def _compare(picture: Path, reference: Path, threshold: float) -> None:
    """Print the comparison of a picture with its reference; if it fails, write the difference and exit with 1."""
    from milkglass.viewer.error import compare
    from milkglass.viewer.files import images

    result = compare.compare_files(picture, reference)
    if result.passes(threshold):
        typer.echo(f"{picture} agrees with {reference}: {result}")
        return
    difference = compare.difference_path(picture)
    images.write_png(difference, result.difference)
    _say(f"{picture} differs from {reference}: {result}, accepted rms {threshold:.4g}; see {difference}")
    raise typer.Exit(1)


def _fail(sentence: str) -> int:
    _say(sentence)
    return 2


def _say(sentence: str) -> None:
    sentence = " ".join(sentence.split())
    typer.echo(f"milkglass: {sentence}" + ("" if sentence.endswith((".", "?", "!")) else "."), err=True)


def usage_sentence(error: typer.TyperException) -> str:
    """Return an error of typer as one sentence, with the nearest options where there are any."""
    possibilities = getattr(error, "possibilities", None)
    text = error.message if possibilities else error.format_message()
    text = text[:1].lower() + text[1:].rstrip(". ")
    if possibilities:
        return f"{text}; did you mean {' or '.join(sorted(possibilities))}?"
    if text.startswith("no such command") and "Did you mean" not in text:
        return f"{text}; to show a model, write `milkglass view MODEL`"
    return text


if __name__ == "__main__":
    sys.exit(main())
