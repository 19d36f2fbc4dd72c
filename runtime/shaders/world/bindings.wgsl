// The world on the GPU: its primitives, and the measures of the grid of candidate lists over them.

import package::lib::primitives::{Shape, decode_shape};
import package::structs::{WorldInfo};

@group(1) @binding(0) var<uniform> world: WorldInfo;

// Four words of four for each primitive: the finite ones first, then the half-spaces.
@group(1) @binding(1) var<storage, read> primitives: array<vec4u>;

const NO_PRIMITIVE: u32 = 0xffffffffu;
const FAR: f32 = 3.0e38;

// Count of a candidate list that did not fit: its cell asks all primitives, slower but just as exact.
const ALL_CANDIDATES: u32 = 0xffffffffu;

// How far lists reach, in cells: half the diagonal of a cell, and a tenth more (lib/candidates tells what for).
const CANDIDATES_REACH: f32 = 0.8660254 * 1.1;

fn world_cell_centre(cell: vec3u) -> vec3f {
    return world.grid_lower + (vec3f(cell) + 0.5) * world.grid_cell;
}

fn world_shape(index: u32) -> Shape {
    return decode_shape(primitives[4u * index], primitives[4u * index + 1u]);
}
