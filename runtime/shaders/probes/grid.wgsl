// The grid that probes stand on, shared by every technique with probes.

import package::structs::{ProbeGridInfo};

@group(2) @binding(0) var<uniform> probe_grid: ProbeGridInfo;

// The cell of eight probes around a point, and where in it the point is.
struct ProbeCell {
    base: vec3u,
    fraction: vec3f,
}

fn probe_cell(position: vec3f) -> ProbeCell {
    let last = vec3f(probe_grid.counts - 1u);
    let place = clamp((position - probe_grid.lower) / probe_grid.spacing, vec3f(0.0), last);
    let base = min(floor(place), max(last - 1.0, vec3f(0.0)));
    return ProbeCell(vec3u(base), place - base);
}

fn probe_corner(cell: ProbeCell, corner: u32) -> vec3u {
    return min(cell.base + (vec3u(corner, corner >> 1u, corner >> 2u) & vec3u(1u)), probe_grid.counts - 1u);
}

fn probe_weight(cell: ProbeCell, corner: u32) -> f32 {
    let is_far = ((vec3u(corner, corner >> 1u, corner >> 2u)) & vec3u(1u)) == vec3u(1u);
    let w = select(1.0 - cell.fraction, cell.fraction, is_far);
    return w.x * w.y * w.z;
}

fn probe_index(place: vec3u) -> u32 {
    return place.x + probe_grid.counts.x * (place.y + probe_grid.counts.y * place.z);
}
