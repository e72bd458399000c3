"""`milkglass render --report`: checks of its paths, a progress bar on a terminal, and a summary."""

import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from milkglass.core.errors import InputError
from milkglass.viewer.scene.keys import input_files
from milkglass.viewer.scene.scene import Scene

if TYPE_CHECKING:
    from milkglass.viewer.error.report import ErrorReport
    from milkglass.viewer.render.picture import Frame

EYE_PARTS = ("whole", "mirror", "unscattered", "once", "often")


def check_report(path: str, scene: Scene, outputs: Sequence[str], reference: str | None) -> None:
    """Raise InputError for a report that cannot be written, or that would overwrite a picture or an input."""
    from milkglass.viewer.error.report import check_report_path, map_path

    check_report_path(path)
    protected: list[tuple[str, str | Path]] = [(f"--output {output}", output) for output in outputs]
    protected += [(f"the {role}", file) for role, file in input_files(scene).items()]
    protected += [] if reference is None else [("the reference", reference)]
    check_stay(protected, f"--report {path}", (path, map_path(path)))


def check_stay(
    protected: Sequence[tuple[str, str | Path]], option: str, written: Iterable[str | os.PathLike[str]]
) -> None:
    """Raise InputError where an option would have a file written over a protected one; pairs of a role and a file."""
    for target in written:
        for role, file in protected:
            if os.path.realpath(file) == os.path.realpath(target):
                raise InputError(f"{option} would write {target} over {role}; choose another name")


def run(scene: Scene, samples: int, seed: int, points: int, photons: int) -> "tuple[Frame, ErrorReport]":
    """Render a scene and return its picture and error report, with a progress bar on a terminal."""
    from rich.console import Console
    from rich.progress import Progress

    from milkglass.viewer.commands.terminal import progress_callback
    from milkglass.viewer.error.report import error_report
    from milkglass.viewer.gl.context import headless_context
    from milkglass.viewer.render.renderer import Renderer

    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("starting", total=None)
        renderer = Renderer(headless_context())
        frame = renderer.render(scene, samples=samples, seed=seed, progress=progress_callback(progress, task))
        progress.update(task, description="summing the reference", total=1.0, completed=0.0)
        report = error_report(
            renderer,
            scene,
            points=points,
            photons=photons,
            seed=seed,
            timings=frame.timings,
            progress=lambda share: progress.update(task, completed=share),
            photon_progress=lambda share: progress.update(task, description="photons walk", completed=share),
        )
    return frame, report


def summary(report: "ErrorReport", path: str) -> str:
    """Return a line for the terminal on each measured error."""
    points, transport = report.content["reference"]["points"], report.content.get("transport_error")
    rms, p99 = (_percents(shares) for shares in (report.deviation.rms, report.deviation.p99))
    subject = "Error of exitance"
    if "difference" in report.content:
        subject = "Difference of exitance from equation (1), which this transport does not solve,"
    lines = [f"{subject} at {points} visible points: rms {rms} %, 99th percentile {p99} % (R, G, B); see {path}."]
    if "rms" in (environment := report.content.get("environment", {})):
        rms = _percents(environment["rms"])
        lines.append(
            f"Irradiance of the occluded environment at {environment['points']} points against rays: rms {rms} %."
        )
    if transport is not None:
        lines.append(_transport_line(transport))
        if "why" in transport:
            lines[-1] += f" By {transport['by']}, since {transport['why']}."
    return "\n".join(lines)


def _transport_line(content: dict[str, Any]) -> str:
    if "not_measured" in content:
        return f"Error against transport was not measured: {content['not_measured']}."
    if "paths" in content:
        parts = (f"{name} {_part_line(content[name])}" for name in EYE_PARTS)
        return (
            f"Radiance of {content['blocks']} blocks of pixels against {content['paths']} paths from the eye (R, G, B; "
            f"share, ratio of means, rms, noise in %): {'; '.join(parts)}."
        )
    between = content["between_parts"]
    inside, outside, whole = (_percents(part["rms"]) for part in (content, between, content["whole"]))
    return (
        f"Error against a walk of photons, over the whole surface: transport inside rms {inside} %, "
        f"light between parts {outside} % (which is {_percents(between['share'])} % of the light), both {whole} %, "
        f"flux {_percents(content['whole']['bias'])} %."
    )


def _part_line(content: dict[str, Any]) -> str:
    return " | ".join(
        "/".join("-" if value is None else f"{100.0 * value:.0f}" for value in content[name])
        for name in ("share", "ratio", "rms", "noise")
    )


def _percents(shares: Sequence[float | None]) -> str:
    return ", ".join("-" if share is None else f"{100.0 * share:.2f}" for share in shares)
