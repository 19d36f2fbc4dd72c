// Which primitive is nearest: through the candidate list of the grid cell that holds the point, which is exact
// (world/build_candidates proves why), or, outside of the grid and in cells whose list is full, among all.

import package::lib::primitives::{shape_distance};
import package::world::bindings::{ALL_CANDIDATES, CANDIDATES_REACH, FAR, NO_PRIMITIVE, world, world_cell_centre, world_shape};

@group(1) @binding(2) var<storage, read> candidates: array<u32>;

struct Nearest {
    distance: f32,
    primitive: u32,
}

fn world_in_grid(position: vec3f) -> bool {
    return all(position >= world.grid_lower) && all(position <= world.grid_upper);
}

fn candidates_cell(position: vec3f) -> vec3u {
    return min(vec3u(max((position - world.grid_lower) / world.grid_cell, vec3f(0.0))), world.grid_size - 1u);
}

// The finite primitive nearest to a point, leaving out one (or none: NO_PRIMITIVE).
//
// With one left out, its cell's list may lack the next nearest. A primitive that is not listed is farther from the
// cell's centre than the nearest one by 2 CANDIDATES_REACH cells, so it is farther from a point p in the cell, c from
// the centre, than the nearest of all by 2 (CANDIDATES_REACH - c): that much, at least a tenth of a cell, is surely
// free, and is the answer, with no primitive, where no listed one is nearer.
fn nearest_finite(position: vec3f, excluded: u32) -> Nearest {
    let cell = candidates_cell(position);
    let list = world.stride * (cell.x + world.grid_size.x * (cell.y + world.grid_size.y * cell.z));
    let count = select(ALL_CANDIDATES, candidates[list], world_in_grid(position));
    let ask_all = count == ALL_CANDIDATES;
    var nearest = Nearest(FAR, NO_PRIMITIVE);
    var left_out = FAR;
    for (var i = 0u; i < select(count, world.finite_count, ask_all); i++) {
        var index = i;
        if !ask_all {
            index = candidates[list + 1u + i];
        }
        let away = shape_distance(world_shape(index), position);
        if index == excluded {
            left_out = away;
        } else if away < nearest.distance {
            nearest = Nearest(away, index);
        }
    }
    if left_out < nearest.distance && !ask_all {
        let from_centre = distance(position, world_cell_centre(cell));
        let free = left_out + 2.0 * (CANDIDATES_REACH * world.grid_cell - from_centre);
        if free < nearest.distance {
            return Nearest(free, NO_PRIMITIVE);
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
