"""The tables of `benchmarks.studies.performance` as Markdown."""

from __future__ import annotations

from typing import Any

from foresee.infra.markdown import markdown, span

PEERS_COLUMNS = {
    "median_ms": ("median [ms]", ".3f"),
    "mean_ms": ("mean [ms]", ".3f"),
    "p99_ms": ("p99 [ms]", ".3f"),
    "ratio": ("times ours", ".2f"),
    "excess": ("cost of the posts", ".2f"),
    "dearer_percent": ("cost above ours", "+.3f"),
    "hits": ("hits", ".0f"),
    "failures": ("failures", ".0f"),
}
"""Measure → head and number format of its column; `mean_ms` is in older results only."""


def table(stages: dict[str, dict[str, dict[str, float]]]) -> str:
    """Return the table of the times of each arm's stages."""
    rows = [["arm", "stage", "median [ms]", "p95 [ms]", "p99 [ms]", "threads", "samples"]]
    for arm, of_arm in stages.items():
        for name, s in of_arm.items():
            numbers = [f"{s[key]:.2f}" for key in ("median_ms", "p95_ms", "p99_ms")]
            rows.append([f"`{arm}`", name, *numbers, str(s["threads"]), str(s["samples"])])
    return markdown(rows)


def peers_table(stages: dict[str, dict[str, dict[str, float]]]) -> str:
    """Return the table of the comparison with other libraries; "" if none was measured."""
    if not stages:
        return ""
    heads, forms = zip(*PEERS_COLUMNS.values(), strict=True)
    rows = [["stage", "program", *heads]]
    dearer = list(PEERS_COLUMNS).index("dearer_percent")
    for stage, of_stage in stages.items():
        for name, s in of_stage.items():
            columns = zip(PEERS_COLUMNS, forms, strict=True)
            cells = [format(s[key], form) if key in s else "" for key, form in columns]
            if "dearer_low" in s:
                cells[dearer] += f" ({span((s['dearer_low'], s['dearer_high']), '+.3f')})"
            cells[dearer] += " %" if cells[dearer] else ""
            rows.append([stage, name, *cells])
    return markdown(rows)


def measures_table(measures: dict[str, dict[str, Any]]) -> str:
    """Return the table of the rates of kernels and of whole drives; "" if none was measured."""
    if not measures:
        return ""
    rows = [["measure", "value", "p99", "unit", "samples"]]
    for name, m in measures.items():
        value = f"{m['value']:.4g}"
        if "low" in m:
            value += f" ({span((m['low'], m['high']), '.4g')})"
        p99 = f"{m['p99']:.4g}" if "p99" in m else ""
        rows.append([name, value, p99, m["unit"], str(m["samples"])])
    return markdown(rows)


def tables(results: dict[str, Any]) -> str:
    """Return all tables of a results.json of `benchmarks.studies.performance`."""
    each = [
        table(results["arms"]),
        f"Peak memory {results['peak_memory_mib']:.0f} MiB.",
        measures_table(results.get("measures", {})),
        peers_table(results["peers"]),
    ]
    return "\n\n".join(part for part in each if part)
