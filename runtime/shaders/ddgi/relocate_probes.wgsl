// Moves probes out of walls and away from them, by fixed rays, and switches off those that stay inside (Majercik et al.
// 2021, sections 3.1 and 3.2): a probe that is inside leaves through the nearest back; one that is too near to a front
// goes towards where most room is; one with room to spare returns to its node. Small steps, a few frames long.

import package::ddgi::probe_rays::{signed_distance};
import package::lib::candidates::{world_distance};
import package::lib::random::{spherical_fibonacci};
import package::probes::grid::{probe_grid};
import package::structs::{RelocateSettings};

@group(0) @binding(0) var<uniform> settings: RelocateSettings;
@group(0) @binding(1) var<storage, read_write> states: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> histories: array<u32>;

const RAYS: u32 = 32u;

const PROBE_ON: f32 = 1.0;
const PROBE_ASLEEP: f32 = 0.5;
const PROBE_INSIDE: f32 = 0.0;

var<workgroup> distances: array<f32, RAYS>;

fn relocated(node: vec3f, place: vec3f, is_inside: bool, back: u32, near: u32, far: u32) -> vec3f {
    var offset = place - node;
    if is_inside {
        offset += spherical_fibonacci(back, RAYS) * (0.5 * settings.clearance - distances[back]);
    } else if distances[near] < settings.clearance {
        let away = spherical_fibonacci(far, RAYS);
        if dot(away, spherical_fibonacci(near, RAYS)) <= 0.0 {
            offset += away * min(settings.clearance - distances[near], 0.5 * distances[far]);
        }
    } else {
        let spare = min(distances[near] - settings.clearance, length(offset));
        offset -= spare * offset / max(length(offset), 1e-20);
    }
    return select(place, node + offset, all(abs(offset) <= vec3f(settings.reach)));
}

@compute @workgroup_size(32)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let probe = min(group.x + group.y * groups.x, settings.probe_count - 1u);
    let counts = probe_grid.counts;
    let cell = vec3u(probe % counts.x, (probe / counts.x) % counts.y, probe / (counts.x * counts.y));
    let node = probe_grid.lower + vec3f(cell) * probe_grid.spacing;
    let place = select(states[probe].xyz, node, settings.is_first != 0u);
    distances[thread] = signed_distance(place, spherical_fibonacci(thread, RAYS), settings.reach_of_rays);
    workgroupBarrier();
    if thread > 0u || group.x + group.y * groups.x >= settings.probe_count {
        return;
    }
    var is_inside = false;
    var back = 0u;
    var near = 0u;
    var far = 0u;
    var sees_surface = false;
    for (var i = 0u; i < RAYS; i++) {
        let reached = abs(spherical_fibonacci(i, RAYS) * distances[i]);
        sees_surface = sees_surface || all(reached <= vec3f(probe_grid.spacing));
        if distances[i] < 0.0 {
            is_inside = true;  // as every ray then says
            back = select(back, i, distances[back] >= 0.0 || distances[i] > distances[back]);
            continue;
        }
        near = select(near, i, distances[near] < 0.0 || distances[i] < distances[near]);
        far = select(far, i, distances[far] < 0.0 || distances[i] > distances[far]);
    }
    let moved = relocated(node, place, is_inside, back, near, far);
    var state = select(PROBE_ON, PROBE_INSIDE, world_distance(moved) < 0.0);
    if state == PROBE_ON && !sees_surface && settings.may_sleep != 0u {
        state = PROBE_ASLEEP;
    }
    if settings.is_first != 0u || states[probe].w != state || distance(moved, place) > settings.jump {
        histories[probe] = 0u;
    }
    states[probe] = vec4f(moved, state);
}
