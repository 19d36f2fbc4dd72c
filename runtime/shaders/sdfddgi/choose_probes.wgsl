// Last step of the choice of probes: lists those with the highest keys, and counts the workgroups that update them. Of
// probes with the same key, of which there is room for some alone, none is taken: who is chosen does not depend on the
// order in which threads run.

import package::probes::grid::{probe_count};
import package::sdfddgi::choice::{
    CHOICE_BINS, CHOICE_BITS, CHOICE_LOW, CHOICE_THREADS, CLASS_SHIFT, choice_boundary, keys, settings,
};

@group(0) @binding(3) var<storage, read_write> chosen: array<u32>;
@group(0) @binding(4) var<storage, read_write> chosen_groups: array<atomic<u32>>;

@compute @workgroup_size(CHOICE_THREADS)
fn main(@builtin(global_invocation_id) id: vec3u, @builtin(local_invocation_index) thread: u32) {
    let upper = choice_boundary(0u, settings.budget, thread);
    let lower = choice_boundary(CHOICE_BINS, upper.y, thread);
    let probe = id.x;
    if probe == 0u {
        // The sky's own probe is no part of the budget.
        chosen[atomicAdd(&chosen_groups[0], 1u)] = probe_count();
        atomicStore(&chosen_groups[1], 1u);
    }
    if probe >= probe_count() {
        return;
    }
    let key = keys[probe];
    // The lowest bin is above the boundary where the budget is enough for all.
    let last = (upper.x << CHOICE_BITS) | lower.x;
    if key >> CLASS_SHIFT > 0u && key > last {
        chosen[atomicAdd(&chosen_groups[0], 1u)] = probe;
    }
}
