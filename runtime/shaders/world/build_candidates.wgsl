// Candidate lists: for each cell of the grid the primitives that can be the nearest one somewhere in it.
//
// Distances change by at most one metre a metre. With the smallest distance d at the cell's centre, no point of the
// cell is farther from the union than d + h, h being the half-diagonal; a primitive farther than d + 2 h from the
// centre is farther than d + h from every point of the cell. So it may be left out, and every query stays exact. The
// lists reach a tenth farther (CANDIDATES_REACH), which also covers the rounding of positions and distances.

import package::lib::primitives::{shape_distance};
import package::world::bindings::{ALL_CANDIDATES, CANDIDATES_REACH, FAR, world, world_cell_centre, world_shape};

@group(0) @binding(0) var<storage, read_write> lists: array<u32>;
@group(0) @binding(1) var<storage, read_write> longest: array<atomic<u32>, 1>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let size = world.grid_size;
    if id.x >= size.x * size.y * size.z {
        return;
    }
    let cell = vec3u(id.x % size.x, (id.x / size.x) % size.y, id.x / (size.x * size.y));
    let centre = world_cell_centre(cell);
    var smallest = FAR;
    for (var index = 0u; index < world.finite_count; index++) {
        smallest = min(smallest, shape_distance(world_shape(index), centre));
    }
    let limit = smallest + 2.0 * CANDIDATES_REACH * world.grid_cell;
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
