// Which primitive is nearest: through the candidate list of the grid cell that holds the point, which is exact
// (world/build_candidates proves why), or, outside of the grid and in cells whose list is full, among all.

import package::lib::primitives::{shape_distance};
import package::world::bindings::{ALL_CANDIDATES, FAR, NO_PRIMITIVE, world, world_shape};

@group(1) @binding(2) var<storage, read> candidates: array<u32>;

struct Nearest {
    distance: f32,
    primitive: u32,
}

fn world_in_grid(position: vec3f) -> bool {
    return all(position >= world.grid_lower) && all(position <= world.grid_upper);
}

// First word of the list of the cell that holds a point of the grid.
fn candidates_list(position: vec3f) -> u32 {
    let cell = min(vec3u(max((position - world.grid_lower) / world.grid_cell, vec3f(0.0))), world.grid_size - 1u);
    return world.stride * (cell.x + world.grid_size.x * (cell.y + world.grid_size.y * cell.z));
}

// The finite primitive nearest to a point, leaving out one (or none: NO_PRIMITIVE).
fn nearest_finite(position: vec3f, excluded: u32) -> Nearest {
    let list = candidates_list(position);
    let count = select(ALL_CANDIDATES, candidates[list], world_in_grid(position));
    let ask_all = count == ALL_CANDIDATES;
    var nearest = Nearest(FAR, NO_PRIMITIVE);
    for (var i = 0u; i < select(count, world.finite_count, ask_all); i++) {
        var index = i;
        if !ask_all {
            index = candidates[list + 1u + i];
        }
        if index == excluded {
            continue;
        }
        let distance = shape_distance(world_shape(index), position);
        if distance < nearest.distance {
            nearest = Nearest(distance, index);
        }
    }
    return nearest;
}

// The primitive nearest to a point, half-spaces included.
fn nearest_primitive(position: vec3f) -> Nearest {
    var nearest = nearest_finite(position, NO_PRIMITIVE);
    for (var index = world.finite_count; index < world.primitive_count; index++) {
        let distance = shape_distance(world_shape(index), position);
        if distance < nearest.distance {
            nearest = Nearest(distance, index);
        }
    }
    return nearest;
}

// Signed distance to the union of all primitives.
fn world_distance(position: vec3f) -> f32 {
    return nearest_primitive(position).distance;
}
