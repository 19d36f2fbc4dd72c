// Second step of the choice of probes: those in the bin of upper halves in which the budget is used up are counted by the
// lower halves of their keys.

import package::probes::grid::{probe_count};
import package::sdfddgi::choice::{
    CHOICE_BINS, CHOICE_BITS, CHOICE_LOW, CHOICE_THREADS, bins, choice_boundary, keys, settings,
};

@compute @workgroup_size(CHOICE_THREADS)
fn main(@builtin(global_invocation_id) id: vec3u, @builtin(local_invocation_index) thread: u32) {
    let boundary = choice_boundary(0u, settings.budget, thread).x;
    if id.x >= probe_count() {
        return;
    }
    let key = keys[id.x];
    if key >> CHOICE_BITS == boundary {
        atomicAdd(&bins[CHOICE_BINS + (key & CHOICE_LOW)], 1u);
    }
}
