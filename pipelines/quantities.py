"""The fit's figures in words, and how a figure is written: for tables on the terminal and on pages."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Metric:
    """A figure of `fit.measure.Metrics` in words; unit `%`: a share, shown as percent; `pct`: is percent."""

    key: str
    label: str
    unit: str
    remark: str = ""


METRICS = (
    Metric("surface_to_set_mean_m", "surface to set, mean", "m", "from the surfaces that air touches"),
    Metric("surface_to_set_p95_m", "surface to set, 95th percentile", "m"),
    Metric("surface_to_set_max_m", "surface to set, largest", "m"),
    Metric("covered_25cm", "covered within 25 cm", "%", "share of those surfaces"),
    Metric("covered_half_pct", "covered within 0.5 % of the diagonal", "%"),
    Metric("set_to_surface_mean_m", "set to surface, mean", "m", "from the set's boundary that air touches"),
    Metric("false_solid", "free air made solid", "%"),
    Metric("air_distance_error_m", "distance error in free air, mean", "m"),
    Metric("air_distance_error_pct", "the same, of the diagonal", "pct"),
    Metric("leaks", "rays that leak through", "%", "share of the rays that hit the mesh"),
    Metric("blocked", "rays that are stopped too early", "%"),
    Metric("hit_error_pct", "hit error, mean, of the diagonal", "pct"),
    Metric("largest_hole_m", "largest hole", "m", "widest cluster of leaking hits"),
    Metric("iou", "intersection over union", "", "where the mesh is closed"),
    Metric("volume_error", "volume error", "", "where the mesh is closed"),
)


def quantity(value: float | None, unit: str) -> str:
    """A figure with its unit, as in `Metric`; a dash for None."""
    if value is None:
        return "-"
    if unit == "%":
        return f"{100 * value:.2f} %"
    if unit == "pct":
        return f"{value:.3f} %"
    figure = str(value) if isinstance(value, int) else f"{value:.4g}"
    return f"{figure} {unit}".strip()
