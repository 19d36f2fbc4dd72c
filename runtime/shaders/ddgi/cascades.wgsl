// Where the probes stand: in one grid, or in grids that follow the viewer, each twice as wide as the one before.

import package::structs::{DdgiCascade, DdgiInfo};

@group(2) @binding(0) var<uniform> ddgi: DdgiInfo;

// The eight probes around a point, and where among them it is.
struct CascadeCell {
    base: vec3u,
    fraction: vec3f,
}

fn cascade_cell(cascade: DdgiCascade, position: vec3f) -> CascadeCell {
    let last = vec3f(cascade.counts - 1u);
    let place = clamp((position - cascade.lower) / cascade.spacing, vec3f(0.0), last);
    let base = min(floor(place), max(last - 1.0, vec3f(0.0)));
    return CascadeCell(vec3u(base), place - base);
}

fn cascade_corner(cascade: DdgiCascade, cell: CascadeCell, corner: u32) -> vec3u {
    return min(cell.base + (vec3u(corner, corner >> 1u, corner >> 2u) & vec3u(1u)), cascade.counts - 1u);
}

fn cascade_weight(cell: CascadeCell, corner: u32) -> f32 {
    let is_far = (vec3u(corner, corner >> 1u, corner >> 2u) & vec3u(1u)) == vec3u(1u);
    let w = select(1.0 - cell.fraction, cell.fraction, is_far);
    return w.x * w.y * w.z;
}

// Share that a cascade has in the answer for a point: over its outermost cells the next one takes over.
fn cascade_share(number: u32, position: vec3f) -> f32 {
    if number + 1u == ddgi.cascade_count {
        return 1.0;
    }
    let cascade = ddgi.cascades[number];
    let place = (position - cascade.lower) / cascade.spacing;
    let depth = min(place, vec3f(cascade.counts - 1u) - place);
    return clamp(min(depth.x, min(depth.y, depth.z)), 0.0, 1.0);
}

// The probe at a place of a cascade's grid, and the place of one.
fn cascade_probe(cascade: DdgiCascade, place: vec3u) -> u32 {
    let slot = (place + cascade.turn) % cascade.counts;
    return cascade.first + slot.x + cascade.counts.x * (slot.y + cascade.counts.y * slot.z);
}

fn cascade_place(cascade: DdgiCascade, probe: u32) -> vec3u {
    let index = probe - cascade.first;
    let counts = cascade.counts;
    let slot = vec3u(index % counts.x, (index / counts.x) % counts.y, index / (counts.x * counts.y));
    return (slot + counts - cascade.turn) % counts;
}
