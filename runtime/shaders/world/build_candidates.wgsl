// Candidate lists: for each cell of the grid the primitives that can be the nearest one somewhere in it.
//
// Distances change by at most one metre a metre. With the smallest distance d at the cell's centre, no point of the
// cell is farther from the union than d + h, h being the half-diagonal; a primitive farther than d + 2 h from the
// centre is farther than d + h from every point of the cell. So it is left out, and every query stays exact.

import package::lib::primitives::{shape_distance};
import package::world::bindings::{ALL_CANDIDATES, FAR, world, world_shape};

@group(0) @binding(0) var<storage, read_write> lists: array<u32>;
@group(0) @binding(1) var<storage, read_write> longest: array<atomic<u32>, 1>;

// Half the diagonal of a unit cell, and a hair for the rounding of positions and distances.
const HALF_DIAGONAL: f32 = 0.8660254 * 1.001;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let size = world.grid_size;
    if id.x >= size.x * size.y * size.z {
        return;
    }
    let cell = vec3u(id.x % size.x, (id.x / size.x) % size.y, id.x / (size.x * size.y));
    let centre = world.grid_lower + (vec3f(cell) + 0.5) * world.grid_cell;
    var smallest = FAR;
    for (var index = 0u; index < world.finite_count; index++) {
        smallest = min(smallest, shape_distance(world_shape(index), centre));
    }
    let limit = smallest + 2.0 * HALF_DIAGONAL * world.grid_cell;
    let list = id.x * world.stride;
    var count = 0u;
    for (var index = 0u; index < world.finite_count; index++) {
        if shape_distance(world_shape(index), centre) <= limit {
            count++;
            if count < world.stride {
                lists[list + count] = index;
            }
        }
    }
    lists[list] = select(count, ALL_CANDIDATES, count >= world.stride);
    atomicMax(&longest[0], count);
}
