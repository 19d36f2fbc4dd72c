// The world on the GPU: its primitives, and the measures of what finds the nearest of them.

import package::lib::primitives::{Shape, decode_bounds, decode_shape};
import package::structs::{WorldInfo};

@group(1) @binding(0) var<uniform> world: WorldInfo;

// Four words of four for each primitive: the finite ones first, then the half-spaces.
@group(1) @binding(1) var<storage, read> primitives: array<vec4u>;

const NO_PRIMITIVE: u32 = 0xffffffffu;
const FAR: f32 = 3.0e38;

// `world.culling`, in the order of CULLINGS in runtime/settings.py.
const CULLING_GRID: u32 = 0u;
const CULLING_CLUSTERS: u32 = 1u;

// Length of a candidate list that had no room: its cell asks all primitives, slower but just as exact.
const ALL_CANDIDATES: u32 = 0xffffffffu;

// How far lists reach, in cells: half the diagonal of a cell, and a tenth more (lib/candidates tells what for).
const CANDIDATES_REACH: f32 = 0.8660254 * 1.1;

// Of a cell: a point this far outside of the grid is taken for one on its face. Rounding puts rays' ends there.
const CANDIDATES_RIM: f32 = 0.01;

fn world_cell_centre(cell: vec3u) -> vec3f {
    return world.grid_lower + (vec3f(cell) + 0.5) * world.grid_cell;
}

fn world_shape(index: u32) -> Shape {
    return decode_shape(primitives[4u * index], primitives[4u * index + 1u]);
}

// Centre and radius of a ball around a finite primitive: its distance is at least that of the ball, at a fifth of the
// operations.
fn world_ball_distance(index: u32, position: vec3f) -> f32 {
    let ball = decode_bounds(primitives[4u * index], primitives[4u * index + 1u]);
    return distance(ball.xyz, position) - ball.w;
}
