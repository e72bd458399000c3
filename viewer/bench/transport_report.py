"""What the error against transport came to: tables of the model's and of the numbers' error, of cost, a CSV file."""

from collections.abc import Callable, Sequence
from dataclasses import asdict

import numpy as np

from milkglass.viewer.bench.report import Report
from milkglass.viewer.bench.schemes import Scheme
from milkglass.viewer.bench.transport import ALBEDOS, ALL, FINER, LIGHT, LIGHTS, MATERIAL, TransportRow

Value = Callable[[TransportRow, int], str]  # of a channel
Key = tuple[str, str, int | None]  # shape, material, channel; None: the worst


def report_transport(report: Report, rows: Sequence[TransportRow]) -> None:
    """Rms and the flux of the dark side by shape and medium; then what each method costs."""
    schemes = list(dict.fromkeys(r.scheme for r in rows))
    lights = " / ".join(light for light in LIGHTS if any(r.light == light for r in rows))
    solved = [scheme for scheme in schemes if any(r.scheme == scheme and r.products for r in rows)]
    keys = _keys(rows)
    headings = [f"{scheme}" for scheme in schemes]
    report.table(
        f"Error against photons: rms over the whole surface, % of the rms exitance; light: {lights}",
        ["object", *headings, *(f"{s} against {FINER} x its nodes" for s in solved)],
        (
            [
                _name(key),
                *(_cell(rows, scheme, key, rms_text, _largest_rms) for scheme in schemes),
                *(_cell(rows, scheme, key, _numerical_text, _largest_numerical) for scheme in solved),
            ]
            for key in keys
        ),
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
    report.csv("transport.csv", [csv_row(r) for r in rows])


def csv_row(row: TransportRow) -> dict[str, object]:
    """One run; the README says what the columns are."""
    channels = {**asdict(row.error), "numerical": row.numerical}
    return {
        "transport": row.scheme.method,
        "scheme": str(row.scheme),
        "resolution": row.resolution,
        "shape": row.shape,
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
    """Rms in per cent; below the noise of the photons an upper limit."""
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


def _keys(rows: Sequence[TransportRow]) -> list[Key]:
    """Lines of the tables: a material's worst channel, but each of the albedos."""
    pairs = dict.fromkeys((r.shape, r.material) for r in rows)
    return [(*pair, channel) for pair in pairs for channel in (range(3) if pair[1] == ALBEDOS.name else (None,))]


def _name(key: Key) -> str:
    shape, material, channel = key
    return f"{shape}; {material if channel is None else f'albedo {ALBEDOS.alpha_prime[channel]:g}'}"


def _cell(
    rows: Sequence[TransportRow], scheme: Scheme, key: Key, text: Value, worst: Callable[[TransportRow], int]
) -> str:
    shape, material, channel = key
    found = {r.light: r for r in rows if (r.scheme, r.shape, r.material) == (scheme, shape, material)}
    own = [found[light] for light in LIGHTS if light in found]
    return " / ".join(text(row, worst(row) if channel is None else channel) for row in own)


def _costs(rows: Sequence[TransportRow]) -> list[str]:
    times = ([r.ms for r in rows if r.changed == what] for what in (LIGHT, MATERIAL, ALL))
    nodes, products = [r.resolution for r in rows], [r.products for r in rows]
    return [
        *(f"{np.median(ms):.0f}" if ms else "" for ms in times),
        _span(nodes),
        _span(products) if max(products) else "",
        f"up to {max(r.residual for r in rows):.0e}" if max(products) else "",
    ]


def _span(values: Sequence[int]) -> str:
    return f"{values[0]}" if len(set(values)) == 1 else f"{min(values)} to {max(values)}"
