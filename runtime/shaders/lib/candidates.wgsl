// Which primitive is nearest: through the candidate list of the grid cell that holds the point, which is exact
// (world/build_candidates proves why), through clusters (SDFDDGI, section 3.1), or among all, which is also what a point
// outside of the grid does and one in a cell whose list had no room.

import package::lib::primitives::{shape_distance};
import package::world::bindings::{ALL_CANDIDATES, CANDIDATES_REACH, CANDIDATES_RIM, CULLING_CLUSTERS, CULLING_GRID, FAR, NO_PRIMITIVE, world, world_cell_centre, world_shape};

// For each cell where its list starts and how long it is, then all lists; or the words of each `Cluster` (a buffer of
// their own would be one more of the few that a kernel may bind).
@group(1) @binding(2) var<storage, read> candidates: array<u32>;

const CLUSTER_WORDS: u32 = 8u;

struct Nearest {
    distance: f32,
    primitive: u32,
    // How many primitives' distances it took to know.
    asked: u32,
}

// Primitives to ask: so many from one of them on, or from a place in the lists on.
struct Span {
    first: u32,
    count: u32,
    is_list: bool,
}

fn world_in_grid(position: vec3f) -> bool {
    let rim = CANDIDATES_RIM * world.grid_cell;
    return all(position >= world.grid_lower - rim) && all(position <= world.grid_upper + rim);
}

fn candidates_cell(position: vec3f) -> vec3u {
    return min(vec3u(max((position - world.grid_lower) / world.grid_cell, vec3f(0.0))), world.grid_size - 1u);
}

// The finite primitive nearest to a point, leaving out one (or none: NO_PRIMITIVE).
fn nearest_finite(position: vec3f, excluded: u32) -> Nearest {
    return nearest_finite_within(position, excluded, FAR);
}

// The same where it is known to be nearer than `bound`, which spares clusters that are not. With no primitive in the
// answer, the way is free for its distance at least.
//
// A cluster is passed by when its ball is not nearer than the nearest primitive so far: the distance to what a ball
// holds is at least that to the ball, inside of it too. A bound that all clusters lie beyond is itself the answer.
fn nearest_finite_within(position: vec3f, excluded: u32, bound: f32) -> Nearest {
    let is_clustered = world.culling == CULLING_CLUSTERS;
    let rounds = select(1u, world.cluster_count, is_clustered);
    let cell = candidates_cell(position);
    var span = candidates_span(cell, position);
    var nearest = Nearest(select(FAR, bound, is_clustered), NO_PRIMITIVE, 0u);
    var left_out = FAR;
    for (var round = 0u; round < rounds; round++) {
        if is_clustered {
            let words = CLUSTER_WORDS * round;
            let ball = bitcast<vec4f>(
                vec4u(candidates[words], candidates[words + 1u], candidates[words + 2u], candidates[words + 3u]),
            );
            if distance(position, ball.xyz) - ball.w >= nearest.distance {
                continue;
            }
            span = Span(candidates[words + 4u], candidates[words + 5u], false);
        }
        for (var i = span.first; i < span.first + span.count; i++) {
            var index = i;
            if span.is_list {
                index = candidates[i];
            }
            let away = shape_distance(world_shape(index), position);
            if index == excluded {
                left_out = away;
            } else if away < nearest.distance {
                nearest.distance = away;
                nearest.primitive = index;
            }
        }
        nearest.asked += span.count;
    }
    if span.is_list && left_out < nearest.distance {
        let free = left_out + candidates_free(cell, position);
        if free < nearest.distance {
            return Nearest(free, NO_PRIMITIVE, nearest.asked);
        }
    }
    return nearest;
}

// What to ask at a point without clusters: its cell's list, or all finite primitives.
fn candidates_span(cell: vec3u, position: vec3f) -> Span {
    if world.culling == CULLING_GRID && world_in_grid(position) {
        let header = 2u * (cell.x + world.grid_size.x * (cell.y + world.grid_size.y * cell.z));
        let count = candidates[header + 1u];
        if count != ALL_CANDIDATES {
            return Span(candidates[header], count, true);
        }
    }
    return Span(0u, world.finite_count, false);
}

// With one left out, its cell's list may lack the next nearest. A primitive that is not listed is farther from the
// cell's centre than the nearest one by 2 CANDIDATES_REACH cells, so it is farther from a point p in the cell, c from
// the centre, than the nearest of all by 2 (CANDIDATES_REACH - c): that much, at least a tenth of a cell, is surely
// free, and is the answer, with no primitive, where no listed one is nearer.
fn candidates_free(cell: vec3u, position: vec3f) -> f32 {
    return 2.0 * (CANDIDATES_REACH * world.grid_cell - distance(position, world_cell_centre(cell)));
}

// The primitive nearest to a point, half-spaces included.
fn nearest_primitive(position: vec3f) -> Nearest {
    var nearest = nearest_finite(position, NO_PRIMITIVE);
    for (var index = world.finite_count; index < world.primitive_count; index++) {
        let away = shape_distance(world_shape(index), position);
        if away < nearest.distance {
            nearest.distance = away;
            nearest.primitive = index;
        }
    }
    return nearest;
}

// Signed distance to the union of all primitives.
fn world_distance(position: vec3f) -> f32 {
    return nearest_primitive(position).distance;
}
