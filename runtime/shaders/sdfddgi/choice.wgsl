// What the three steps of the choice of probes share. A key is a class and, within the class, how near a probe's turn is;
// the highest keys are chosen. Two steps of CHOICE_BINS bins each find the lowest of them.

import package::structs::{ChoiceSettings};

@group(0) @binding(0) var<uniform> settings: ChoiceSettings;
@group(0) @binding(1) var<storage, read_write> keys: array<u32>;

// Probes by the upper half of their keys; then, of the bin that the budget ends in, by the lower half.
@group(0) @binding(2) var<storage, read_write> bins: array<atomic<u32>>;

const CHOICE_BITS: u32 = 11u;
const CHOICE_BINS: u32 = 1u << CHOICE_BITS;
const CHOICE_LOW: u32 = CHOICE_BINS - 1u;
const CHOICE_THREADS: u32 = 256u;
const CHOICE_SHARE: u32 = CHOICE_BINS / CHOICE_THREADS;

// A probe without a place has the key 0.
const CLASS_SHIFT: u32 = 20u;
const CLASS_WAITING: u32 = 1u;
const CLASS_DUE: u32 = 2u;
const CLASS_FRESH: u32 = 3u;

var<workgroup> choice_sums: array<u32, CHOICE_THREADS>;
var<workgroup> choice_end: vec2u;

// The bin in which a budget is used up, counted from the highest, and what is left of the budget for that bin; bin 0 where
// the budget is enough for all. `first`: of the half. All threads of the workgroup must call.
fn choice_boundary(first: u32, budget: u32, thread: u32) -> vec2u {
    // Thread 0 has the highest bins.
    let top = first + CHOICE_BINS - 1u - thread * CHOICE_SHARE;
    var sum = 0u;
    for (var i = 0u; i < CHOICE_SHARE; i++) {
        sum += atomicLoad(&bins[top - i]);
    }
    choice_sums[thread] = sum;
    if thread == 0u {
        choice_end = vec2u(0u, budget);
    }
    workgroupBarrier();
    for (var step = 1u; step < CHOICE_THREADS; step *= 2u) {
        let before = select(0u, choice_sums[thread - min(step, thread)], thread >= step);
        workgroupBarrier();
        choice_sums[thread] += before;
        workgroupBarrier();
    }
    var above = choice_sums[thread] - sum;
    if above <= budget && choice_sums[thread] > budget {
        for (var i = 0u; i < CHOICE_SHARE; i++) {
            let count = atomicLoad(&bins[top - i]);
            if above + count > budget {
                choice_end = vec2u(top - i - first, budget - above);
                break;
            }
            above += count;
        }
    }
    workgroupBarrier();
    let found = choice_end;
    workgroupBarrier();
    return found;
}
