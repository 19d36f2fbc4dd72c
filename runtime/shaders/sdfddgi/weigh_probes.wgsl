// First step of the choice of probes (SDFDDGI, section 3.2): how near each one's turn is. It comes nearer every frame by
// a rate: at least so much that the probe waits no longer than its limit, and more for those near the viewer and before him.

import package::lib::random::{random_hash, random_uniform};
import package::probes::grid::{probe_count};
import package::probes::states::{PROBE_FRESH, probe_is_placed};
import package::sdfddgi::choice::{
    CHOICE_BITS, CHOICE_THREADS, CLASS_DUE, CLASS_FRESH, CLASS_SHIFT, CLASS_WAITING, bins, keys, settings,
};
import package::structs::{ChoiceCounts, ChoiceTotals, ProbeHistory, ProbeRecord};

@group(0) @binding(3) var<storage, read_write> totals: ChoiceTotals;
@group(0) @binding(4) var<storage, read> last_totals: ChoiceCounts;
@group(0) @binding(5) var<storage, read_write> histories: array<ProbeHistory>;
@group(0) @binding(6) var<storage, read_write> chosen_groups: array<u32>;
@group(2) @binding(1) var<storage, read> probe_records: array<ProbeRecord>;

const CHOICE_KEY: u32 = 0x85ebca6bu;
const WEIGHT_UNIT: f32 = 1024.0;

// Turns are told apart by the bits of their float32 from here on: 16 of the mantissa, at least 4 of the exponent.
const FARTHEST_TURN: f32 = 1.0 / 8192.0;
const TURN_SHIFT: u32 = 7u;

var<workgroup> seen: atomic<u32>;
var<workgroup> unseen: atomic<u32>;
var<workgroup> fresh: atomic<u32>;
var<workgroup> weights: atomic<u32>;

fn is_seen(position: vec3f) -> bool {
    for (var i = 0u; i < 5u; i++) {
        if dot(settings.planes[i], vec4f(position, 1.0)) < -settings.margin {
            return false;
        }
    }
    return true;
}

// By distance and direction to the viewer, at most 1.
fn weight_of(position: vec3f) -> f32 {
    let way = position - settings.viewer;
    let away = length(way);
    if settings.half_distance <= 0.0 {
        return 1.0;
    }
    let ahead = 0.5 + 0.5 * dot(way, settings.forward) / max(away, 1e-20);
    return mix(settings.behind, 1.0, ahead) / (1.0 + away / settings.half_distance);
}

// Of the last frame's probes: the rate of a probe's turn, in turns a frame. All rates together make the budget.
fn rate_of(is_in_view: bool, weight: f32) -> f32 {
    let slowest = vec2f(1.0 / settings.longest_wait_seen, 1.0 / settings.longest_wait_unseen);
    let needed = dot(vec2f(f32(last_totals.seen), f32(last_totals.unseen)), slowest);
    let budget = f32(settings.budget);
    let own = select(slowest.y, slowest.x, is_in_view);
    if needed > budget {
        return own * budget / needed;
    }
    let all_weights = f32(last_totals.weight) / WEIGHT_UNIT;
    return own + select(0.0, (budget - needed) * weight / all_weights, all_weights > 0.0);
}

fn key_of(probe: u32, waited: f32, is_fresh: bool, position: vec3f) -> u32 {
    let is_in_view = is_seen(position);
    let weight = weight_of(position);
    let u = random_uniform(random_hash(vec3u(probe, settings.frame, settings.seed ^ CHOICE_KEY))).x;
    let turn = (waited + u) * rate_of(is_in_view, weight);
    let limit = select(settings.longest_wait_unseen, settings.longest_wait_seen, is_in_view);
    atomicAdd(&seen, select(0u, 1u, is_in_view));
    atomicAdd(&unseen, select(1u, 0u, is_in_view));
    atomicAdd(&fresh, select(0u, 1u, is_fresh));
    atomicAdd(&weights, u32(weight * WEIGHT_UNIT));
    let class_of_key = select(select(CLASS_WAITING, CLASS_DUE, waited >= limit), CLASS_FRESH, is_fresh);
    let nearness = (bitcast<u32>(max(turn, FARTHEST_TURN)) - bitcast<u32>(FARTHEST_TURN)) >> TURN_SHIFT;
    return (class_of_key << CLASS_SHIFT) | min(nearness, (1u << CLASS_SHIFT) - 1u);
}

@compute @workgroup_size(CHOICE_THREADS)
fn main(@builtin(global_invocation_id) id: vec3u, @builtin(local_invocation_index) thread: u32) {
    if thread == 0u {
        atomicStore(&seen, 0u);
        atomicStore(&unseen, 0u);
        atomicStore(&fresh, 0u);
        atomicStore(&weights, 0u);
    }
    workgroupBarrier();
    let probe = id.x;
    if probe < probe_count() {
        var key = 0u;
        let position = probe_records[probe].position;
        if probe_is_placed(position.w) {
            let waited = histories[probe].waited + 1.0;
            histories[probe].waited = waited;
            key = key_of(probe, waited, position.w == PROBE_FRESH, position.xyz);
        }
        keys[probe] = key;
        atomicAdd(&bins[key >> CHOICE_BITS], 1u);
    }
    workgroupBarrier();
    if thread == 0u {
        atomicAdd(&totals.seen, atomicLoad(&seen));
        atomicAdd(&totals.unseen, atomicLoad(&unseen));
        atomicAdd(&totals.fresh, atomicLoad(&fresh));
        atomicAdd(&totals.weight, atomicLoad(&weights));
    }
    if probe == 0u {
        chosen_groups[0] = 0u;
    }
}
