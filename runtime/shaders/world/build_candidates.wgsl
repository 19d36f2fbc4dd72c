// Candidate lists: for each cell of the grid the primitives that can be the nearest one somewhere in it.
//
// Distances change by at most one metre a metre. With the smallest distance d at the cell's centre, no point of the
// cell is farther from the union than d + h, h being the half-diagonal; a primitive farther than d + 2 h from the
// centre is farther than d + h from every point of the cell. So it may be left out, and every query stays exact. The
// lists reach a tenth farther (CANDIDATES_REACH), which also covers the rounding of positions and distances.
//
// In two levels: a workgroup lists a block of 4 x 4 x 4 cells, one thread a share of the primitives, then its cells from
// that list, one thread a cell. Nothing is lost on the way. A primitive that the block's list lacks is farther from
// the block's centre than the nearest one by 2 REACH 4 cells; a cell's centre is off the block's by at most 0.866 (4 - 1)
// cells, and both distances change by no more than that on the way: 2 REACH 4 - 2 (0.866) 3 > 2 REACH cells are left.
//
// Lists go into one pool, those of a block side by side, in the order of their primitives.

import package::lib::primitives::{shape_distance};
import package::structs::{ListUse};
import package::world::bindings::{ALL_CANDIDATES, CANDIDATES_REACH, FAR, world, world_ball_distance, world_cell_centre, world_shape};

@group(0) @binding(0) var<storage, read_write> lists: array<u32>;
@group(0) @binding(1) var<storage, read_write> list_use: ListUse;

const BLOCK: u32 = 4u;
const THREADS: u32 = BLOCK * BLOCK * BLOCK;

// Room for a block's list. One that is longer is not made: the block's cells then look at all primitives themselves.
const BLOCK_ROOM: u32 = 2048u;

var<workgroup> block_list: array<u32, BLOCK_ROOM>;
var<workgroup> smallest_of: array<f32, THREADS>;
var<workgroup> ends: array<u32, THREADS>;
var<workgroup> block_start: u32;

// Primitives to choose from: of a block's list, or all.
struct Choice {
    count: u32,
    is_listed: bool,
}

fn chosen(choice: Choice, i: u32) -> u32 {
    if choice.is_listed {
        return block_list[i];
    }
    return i;
}

fn smallest_distance(choice: Choice, first: u32, last: u32, centre: vec3f) -> f32 {
    var smallest = FAR;
    for (var i = first; i < last; i++) {
        let index = chosen(choice, i);
        if world_ball_distance(index, centre) < smallest {
            smallest = min(smallest, shape_distance(world_shape(index), centre));
        }
    }
    return smallest;
}

fn is_candidate(index: u32, centre: vec3f, limit: f32) -> bool {
    return world_ball_distance(index, centre) <= limit && shape_distance(world_shape(index), centre) <= limit;
}

fn count_candidates(choice: Choice, first: u32, last: u32, centre: vec3f, limit: f32) -> u32 {
    var count = 0u;
    for (var i = first; i < last; i++) {
        count += select(0u, 1u, is_candidate(chosen(choice, i), centre, limit));
    }
    return count;
}

// Running sums over the workgroup: `ends[t]` is then the sum of the counts of threads 0 to t.
fn sum_up(thread: u32, count: u32) {
    ends[thread] = count;
    workgroupBarrier();
    for (var step = 1u; step < THREADS; step *= 2u) {
        var before = 0u;
        if thread >= step {
            before = ends[thread - step];
        }
        workgroupBarrier();
        ends[thread] += before;
        workgroupBarrier();
    }
}

// Lists the block's candidates in workgroup memory.
fn list_block(thread: u32, centre: vec3f) -> Choice {
    let all = Choice(world.finite_count, false);
    let share = (world.finite_count + THREADS - 1u) / THREADS;
    let first = min(thread * share, world.finite_count);
    let last = min(first + share, world.finite_count);
    smallest_of[thread] = smallest_distance(all, first, last, centre);
    workgroupBarrier();
    for (var half = THREADS / 2u; half > 0u; half /= 2u) {
        if thread < half {
            smallest_of[thread] = min(smallest_of[thread], smallest_of[thread + half]);
        }
        workgroupBarrier();
    }
    let limit = smallest_of[0] + 2.0 * CANDIDATES_REACH * f32(BLOCK) * world.grid_cell;
    let count = count_candidates(all, first, last, centre, limit);
    sum_up(thread, count);
    let total = ends[THREADS - 1u];
    if thread == 0u {
        atomicAdd(&list_use.block_entries, total);
    }
    if total <= BLOCK_ROOM {
        var place = ends[thread] - count;
        for (var index = first; index < last && place < ends[thread]; index++) {
            if is_candidate(index, centre, limit) {
                block_list[place] = index;
                place++;
            }
        }
    }
    workgroupBarrier();
    if total > BLOCK_ROOM {
        return all;
    }
    return Choice(total, true);
}

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let size = world.grid_size;
    let blocks = (size + BLOCK - 1u) / BLOCK;
    let number = group.x + group.y * groups.x;
    if number >= blocks.x * blocks.y * blocks.z {
        return;
    }
    let corner = BLOCK * vec3u(number % blocks.x, (number / blocks.x) % blocks.y, number / (blocks.x * blocks.y));
    let block_centre = world.grid_lower + (vec3f(corner) + 0.5 * f32(BLOCK)) * world.grid_cell;
    let choice = list_block(thread, block_centre);

    let cell = corner + vec3u(thread % BLOCK, (thread / BLOCK) % BLOCK, thread / (BLOCK * BLOCK));
    let is_inside = all(cell < size);
    let centre = world_cell_centre(cell);
    var limit = 0.0;
    var count = 0u;
    if is_inside {
        let reach = 2.0 * CANDIDATES_REACH * world.grid_cell;
        limit = smallest_distance(choice, 0u, choice.count, centre) + reach;
        count = count_candidates(choice, 0u, choice.count, centre, limit);
        atomicMax(&list_use.longest, count);
    }
    sum_up(thread, count);
    let total = ends[THREADS - 1u];
    if thread == 0u {
        block_start = 2u * size.x * size.y * size.z + atomicAdd(&list_use.entries, total);
    }
    workgroupBarrier();
    if !is_inside {
        return;
    }
    let header = 2u * (cell.x + size.x * (cell.y + size.y * cell.z));
    if block_start + total > arrayLength(&lists) {
        lists[header + 1u] = ALL_CANDIDATES;
        atomicAdd(&list_use.overflowing, 1u);
        return;
    }
    var place = block_start + ends[thread] - count;
    lists[header] = place;
    lists[header + 1u] = count;
    let end = block_start + ends[thread];
    for (var i = 0u; i < choice.count && place < end; i++) {
        let index = chosen(choice, i);
        if is_candidate(index, centre, limit) {
            lists[place] = index;
            place++;
        }
    }
}
