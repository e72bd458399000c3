"""Plot of error against time, with the Pareto front of the schemes."""

import io
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from milkglass.viewer.bench.error import ErrorRow
from milkglass.viewer.bench.schemes import PAPER, Scheme

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.transforms import Bbox

PANEL_SIZE = 4.6, 3.9  # inches
MIN_DISTANCE, MAX_DISTANCE, N_DIRECTIONS = 9.0, 60.0, 16  # of a name from its marker, in points, and directions tried
MARKERS = "osD^v"

Marker = tuple[float, float, float, float]  # time, median error, least and largest


def pareto(points: Sequence[tuple[float, float]]) -> list[int]:
    """Return the indices of the Pareto front of points (time, error), by rising time."""
    front: list[int] = []
    for i in sorted(range(len(points)), key=lambda i: points[i]):
        if not front or points[i][1] < points[front[-1]][1]:
            front.append(i)
    return front


def error_plot(rows: Sequence[ErrorRow], times: Mapping[Scheme, float]) -> bytes:
    """Return a PNG plot of error against the time of new light (scheme -> ms), both logarithmic, one panel a light.

    Raises
    ------
    ImportError
        Without matplotlib.
    """
    from matplotlib.figure import Figure

    lights = list(dict.fromkeys(r.light for r in rows))
    across = min(2, len(lights))
    down = -(-len(lights) // across)
    figure = Figure(figsize=(PANEL_SIZE[0] * across, PANEL_SIZE[1] * down), layout="constrained")
    panels = figure.subplots(down, across, sharex=True, sharey=True, squeeze=False)
    base = times.get(PAPER, next(iter(times.values())))
    markers = [
        _panel(axes, [r for r in rows if r.light == light], {scheme: ms / base for scheme, ms in times.items()})
        for axes, light in zip(panels.flat, lights, strict=False)
    ]
    for axes in panels.flat[len(lights) :]:
        axes.set_visible(False)
    for axes in panels[-1]:
        axes.set_xlabel("time of new light / the paper's 4 x 256")
    figure.supylabel("rms error of the worst channel, % (median and range over shapes and materials)", fontsize=10)
    figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=5, fontsize=9)
    figure.draw_without_rendering()  # settles the layout, in which names are placed
    for axes, named in zip(panels.flat, markers, strict=False):
        _write_names(axes, named)
    picture = io.BytesIO()
    figure.savefig(picture, format="png", dpi=110)
    return picture.getvalue()


def _panel(axes: "Axes", rows: Sequence[ErrorRow], times: Mapping[Scheme, float]) -> dict[str, Marker]:
    """Draw the panel of one light, and return the names and markers of schemes."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    errors = {scheme: 100.0 * np.array([r.rms for r in rows if r.scheme == scheme]) for scheme in times}
    middle = {scheme: (times[scheme], float(np.median(values))) for scheme, values in errors.items()}
    for i, kind in enumerate(dict.fromkeys(map(_kind, times))):
        schemes = [scheme for scheme in times if _kind(scheme) == kind]
        x, y = np.array([middle[s] for s in schemes]).T
        low, high = (np.array([end(errors[s]) for s in schemes]) for end in (np.min, np.max))
        marker, color = MARKERS[i % len(MARKERS)], f"C{i}"
        bars = y - low, high - y
        axes.errorbar(x, y, bars, fmt=marker, color=color, label=kind, capsize=2, elinewidth=0.8, markersize=5)
    points = list(middle.values())
    front = np.array([points[i] for i in pareto(points)])
    axes.step(*front.T, where="post", color="0.35", linewidth=1.2, linestyle="--", label="Pareto front", zorder=0)
    axes.set(xscale="log", yscale="log", title=rows[0].light)
    axes.grid(visible=True, which="both", alpha=0.2)
    axes.margins(x=0.2)  # room for the names
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_locator(NullLocator())
    return {
        str(scheme).removeprefix(f"{scheme.method} "): (
            *position,
            float(errors[scheme].min()),
            float(errors[scheme].max()),
        )
        for scheme, position in middle.items()
    }


def _kind(scheme: Scheme) -> str:
    """Return the legend of a scheme: its method, and how its size was chosen."""
    if scheme.resolution is None:
        return f"{scheme.method}, by error target"
    return scheme.method if scheme.assignment is None else f"{scheme.method}, {scheme.assignment}"


def _write_names(axes: "Axes", markers: Mapping[str, Marker]) -> None:
    """Write each name as near to its marker as it covers no marker, range or name."""
    from matplotlib.patheffects import AbstractPathEffect, withStroke
    from matplotlib.transforms import Bbox

    figure = axes.get_figure()
    assert figure is not None
    scale = figure.dpi / 72.0
    occupied = []
    for x, y, low, high in markers.values():
        (left, below), (right, above) = axes.transData.transform([(x, low), (x, high)])
        occupied.append(Bbox([[left - 2.0 * scale, below], [right + 2.0 * scale, above]]))
        middle = axes.transData.transform((x, y))
        occupied.append(Bbox([middle - 4.0 * scale, middle + 4.0 * scale]))
    inside = axes.get_window_extent()
    offsets = [
        (distance * np.cos(angle), distance * np.sin(angle))
        for distance in np.arange(MIN_DISTANCE, MAX_DISTANCE, 4.0)
        for angle in np.pi / 8.0 + 2.0 * np.pi * np.arange(N_DIRECTIONS) / N_DIRECTIONS
    ]
    line: dict[str, Any] = {"arrowstyle": "-", "color": "0.6", "linewidth": 0.6, "shrinkA": 0, "shrinkB": 3}
    halo: list[AbstractPathEffect] = [withStroke(linewidth=2.0, foreground="white")]
    for name, (x, y, _, _) in sorted(markers.items(), key=lambda item: item[1]):
        position = x, y
        for offset in offsets:
            align = "left" if offset[0] > 0.0 else "right"
            text = axes.annotate(name, position, offset, textcoords="offset points", fontsize=8, ha=align, va="center")
            extent = text.get_window_extent()
            if _fits(extent, inside, occupied) or offset is offsets[-1]:
                break
            text.remove()
        occupied.append(extent)
        text.set_path_effects(halo)
        if np.hypot(*offset) > 1.5 * MIN_DISTANCE:
            axes.annotate("", position, offset, textcoords="offset points", arrowprops=line)


def _fits(box: "Bbox", inside: "Bbox", occupied: Sequence["Bbox"]) -> bool:
    """Return whether a box is inside another and overlaps none of the occupied ones."""
    within = inside.x0 <= box.x0 and box.x1 <= inside.x1 and inside.y0 <= box.y0 and box.y1 <= inside.y1
    return within and not any(box.overlaps(occupied_box) for occupied_box in occupied)
