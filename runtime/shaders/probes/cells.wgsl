// Grids of probes, whatever the technique: the cell around a point, and the slots of probes in a grid that moves by whole
// spacings. A probe keeps its slot while it is in the grid; turn: the slot of the probe at place 0, 0, 0.

// The eight probes around a point, and where among them it is.
struct ProbeCell {
    base: vec3u,
    fraction: vec3f,
}

// `place`: of the point, in spacings from the grid's first probe. Outside of the grid, the cell nearest to the point.
fn cell_around(place: vec3f, counts: vec3u) -> ProbeCell {
    let last = vec3f(counts - 1u);
    let inside = clamp(place, vec3f(0.0), last);
    let base = min(floor(inside), max(last - 1.0, vec3f(0.0)));
    return ProbeCell(vec3u(base), inside - base);
}

fn cell_corner(cell: ProbeCell, corner: u32, counts: vec3u) -> vec3u {
    return min(cell.base + (vec3u(corner, corner >> 1u, corner >> 2u) & vec3u(1u)), counts - 1u);
}

fn cell_weight(cell: ProbeCell, corner: u32) -> f32 {
    let is_far = (vec3u(corner, corner >> 1u, corner >> 2u) & vec3u(1u)) == vec3u(1u);
    let w = select(1.0 - cell.fraction, cell.fraction, is_far);
    return w.x * w.y * w.z;
}

// How far inside of the grid a place is, in spacings, 1 at most: 0 on its border and outside.
fn cell_share(place: vec3f, counts: vec3u) -> f32 {
    let depth = min(place, vec3f(counts - 1u) - place);
    return clamp(min(depth.x, min(depth.y, depth.z)), 0.0, 1.0);
}

fn slot_at(place: vec3u, turn: vec3u, counts: vec3u) -> u32 {
    let slot = (place + turn) % counts;
    return slot.x + counts.x * (slot.y + counts.y * slot.z);
}

fn slot_place(index: u32, turn: vec3u, counts: vec3u) -> vec3u {
    let slot = vec3u(index % counts.x, (index / counts.x) % counts.y, index / (counts.x * counts.y));
    return (slot + counts - turn) % counts;
}
