"""Report of errors relative to photons: model error, numerical error and cost of each method, and a CSV file.

Means are separate for shapes that constants of `diffusion` were fitted to or chosen on, and for held-out shapes.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict

import numpy as np

from milkglass.core.provenance import constants
from milkglass.core.transport.diffusion.constants import CONSTANTS
from milkglass.viewer.bench.report import BenchReport
from milkglass.viewer.bench.schemes import Scheme
from milkglass.viewer.bench.transport import ALBEDOS, ALL, FINER, LIGHT, LIGHTS, MATERIAL, TransportRow, is_in_sample

Text = Callable[[TransportRow, int], str]  # text of a channel
Value = Callable[[TransportRow, int], float]
Worst = Callable[[TransportRow], int]  # channel
TableLine = tuple[str, str, int | None]  # shape, material, channel; None: the worst


def report_transport(report: BenchReport, rows: Sequence[TransportRow]) -> None:
    """Report the rms and the flux of the dark side by shape and medium; then cost, and the constants of `diffusion`."""
    schemes = list(dict.fromkeys(r.scheme for r in rows))
    lights = " / ".join(light for light in LIGHTS if any(r.light == light for r in rows))
    solved = [scheme for scheme in schemes if any(r.scheme == scheme and r.products for r in rows)]
    keys = _keys(rows)
    headings = [f"{scheme}" for scheme in schemes]
    report.table(
        f"Error against photons: rms over the whole surface, % of the rms exitance; light: {lights}",
        ["object", "in the fit", *headings, *(f"{s} against {FINER} x its nodes" for s in solved)],
        [
            *(
                [
                    _name(key),
                    "yes" if is_in_sample(key[0]) else "no",
                    *(_cell(rows, scheme, key, rms_text, _largest_rms) for scheme in schemes),
                    *(_cell(rows, scheme, key, _numerical_text, _largest_numerical) for scheme in solved),
                ]
                for key in keys
            ),
            *_means(rows, keys, schemes, solved),
        ],
    )
    report.table(
        f"Error against photons: flux of the surface that no light enters, %; light: {lights}",
        ["object", *headings],
        ([_name(key), *(_cell(rows, s, key, _dark_text, _largest_dark) for s in schemes)] for key in keys),
    )
    report.table(
        "Cost of those, median over the runs",
        ["method", "new light, ms", "new material, ms", "all anew, ms", "nodes", "convolutions", "residual"],
        ([str(scheme), *_costs([r for r in rows if r.scheme == scheme])] for scheme in schemes),
    )
    if solved:
        report.table(
            "Constants of `diffusion`, and the shapes that they were fitted to or chosen on",
            ["constant", "value", "", "shapes", "meaning"],
            ([c.name, f"{c.value:g}", c.kind, ", ".join(c.shapes), c.meaning] for c in constants(CONSTANTS)),
        )
    report.csv("transport.csv", [csv_row(r) for r in rows])


def csv_row(row: TransportRow) -> dict[str, object]:
    """Return the columns of a run in transport.csv."""
    channels = {**asdict(row.error), "numerical": row.numerical}
    return {
        "transport": row.scheme.method,
        "scheme": str(row.scheme),
        "resolution": row.resolution,
        "shape": row.shape,
        "in_fit": int(is_in_sample(row.shape)),
        "material": row.material,
        "light": row.light,
        **{
            f"{name}_{c}": value if np.isfinite(value) else ""
            for name, values in channels.items()
            for c, value in zip("rgb", values, strict=True)
        },
        "changed": row.changed,
        "transport_ms": row.ms,
        "products": row.products,
        "residual": row.residual,
    }


def rms_text(row: TransportRow, channel: int) -> str:
    """Return the rms in per cent, or an upper limit where it is below the noise of the photons."""
    rms, error = row.error.rms[channel], row.error.rms_error[channel]
    return f"< {100.0 * error:.1f}" if rms < error else f"{100.0 * rms:.1f}"


def _numerical_text(row: TransportRow, channel: int) -> str:
    return f"{100.0 * row.numerical[channel]:.2f}"


def _dark_text(row: TransportRow, channel: int) -> str:
    value, error = row.error.dark[channel], row.error.dark_error[channel]
    return f"{100.0 * value:+.1f} ± {100.0 * error:.1f}" if np.isfinite(value) else "-"


def _largest_rms(row: TransportRow) -> int:
    return int(np.nanargmax(row.error.rms))


def _largest_numerical(row: TransportRow) -> int:
    return int(np.argmax(row.numerical))


def _largest_dark(row: TransportRow) -> int:
    return int(np.argmax(np.nan_to_num(np.abs(row.error.dark))))


def _means(
    rows: Sequence[TransportRow], keys: Sequence[TableLine], schemes: Sequence[Scheme], solved: Sequence[Scheme]
) -> list[list[str]]:
    """Return the last lines of the first table: means over the shapes in the fit, and over held-out shapes."""
    lines = []
    for in_sample, name in ((True, "in the fit"), (False, "kept out of it")):
        chosen = [key for key in keys if is_in_sample(key[0]) == in_sample]
        if chosen:
            count = len({shape for shape, _, _ in chosen})
            rms = (_mean(rows, scheme, chosen, lambda r, c: r.error.rms[c], _largest_rms) for scheme in schemes)
            numerical = (_mean(rows, s, chosen, lambda r, c: r.numerical[c], _largest_numerical, 2) for s in solved)
            lines.append([f"mean of {count} shapes {name}", "yes" if in_sample else "no", *rms, *numerical])
    return lines


def _mean(
    rows: Sequence[TransportRow], scheme: Scheme, keys: Sequence[TableLine], value: Value, worst: Worst, digits: int = 1
) -> str:
    """Return the mean over lines, in per cent, of each light."""
    values = [
        [value(row, worst(row) if key[2] is None else key[2]) for row in _of_lights(rows, scheme, key)] for key in keys
    ]
    return " / ".join(f"{100.0 * mean:.{digits}f}" for mean in np.nanmean(values, axis=0))


def _keys(rows: Sequence[TransportRow]) -> list[TableLine]:
    """Return the lines of the tables: the worst channel of a material, and each of the albedos."""
    pairs = dict.fromkeys((r.shape, r.material) for r in rows)
    return [(*pair, channel) for pair in pairs for channel in (range(3) if pair[1] == ALBEDOS.name else (None,))]


def _name(key: TableLine) -> str:
    shape, material, channel = key
    return f"{shape}; {material if channel is None else f'albedo {ALBEDOS.alpha_prime[channel]:g}'}"


def _cell(rows: Sequence[TransportRow], scheme: Scheme, key: TableLine, text: Text, worst: Worst) -> str:
    values = _of_lights(rows, scheme, key)
    return " / ".join(text(row, worst(row) if key[2] is None else key[2]) for row in values)


def _of_lights(rows: Sequence[TransportRow], scheme: Scheme, key: TableLine) -> list[TransportRow]:
    values = {r.light: r for r in rows if (r.scheme, r.shape, r.material) == (scheme, *key[:2])}
    return [values[light] for light in LIGHTS if light in values]


def _costs(rows: Sequence[TransportRow]) -> list[str]:
    times = ([r.ms for r in rows if r.changed == change] for change in (LIGHT, MATERIAL, ALL))
    nodes, products = [r.resolution for r in rows], [r.products for r in rows]
    return [
        *(f"{np.median(ms):.0f}" if ms else "" for ms in times),
        _span(nodes),
        _span(products) if max(products) else "",
        f"up to {max(r.residual for r in rows):.0e}" if max(products) else "",
    ]


def _span(values: Sequence[int]) -> str:
    return f"{values[0]}" if len(set(values)) == 1 else f"{min(values)} to {max(values)}"
