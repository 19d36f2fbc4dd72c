// Moves probes out of walls and away from them, by fixed rays, and switches off those that stay inside (Majercik et al.
// 2021, sections 3.1 and 3.2): a probe that is inside, which sees many backs, leaves through the nearest of them; one
// that is too near to a front goes towards where most room is; one with room to spare returns to its node. Small steps,
// a few frames long.

import package::ddgi::cascades::{cascade_place, ddgi};
import package::ddgi::states::{PROBE_ASLEEP, PROBE_FRESH, PROBE_INSIDE, PROBE_ON};
import package::lib::random::{spherical_fibonacci};
import package::structs::{RelocateSettings};
import package::tracer::clearances::{signed_clearance};

@group(0) @binding(0) var<uniform> settings: RelocateSettings;
@group(0) @binding(1) var<storage, read_write> states: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> histories: array<u32>;

const RAYS: u32 = 32u;

// Share of rays that end at backs above which a probe is inside.
const MOST_BACKS: f32 = 0.25;

var<workgroup> distances: array<f32, RAYS>;
var<workgroup> moved: vec3f;

struct Surroundings {
    is_inside: bool,
    sees_surface: bool,
    // The rays that end at the nearest back, the nearest and the farthest front.
    back: u32,
    near: u32,
    far: u32,
}

fn surroundings(spacing: f32) -> Surroundings {
    var found = Surroundings(false, false, 0u, 0u, 0u);
    var backs = 0u;
    for (var i = 0u; i < RAYS; i++) {
        let reached = abs(spherical_fibonacci(i, RAYS) * distances[i]);
        found.sees_surface = found.sees_surface || all(reached <= vec3f(spacing));
        if distances[i] < 0.0 {
            backs++;
            found.back = select(found.back, i, distances[found.back] >= 0.0 || distances[i] > distances[found.back]);
            continue;
        }
        found.near = select(found.near, i, distances[found.near] < 0.0 || distances[i] < distances[found.near]);
        found.far = select(found.far, i, distances[found.far] < 0.0 || distances[i] > distances[found.far]);
    }
    found.is_inside = f32(backs) > MOST_BACKS * f32(RAYS);
    return found;
}

// Where a new probe is looked for first: one over the scene's outermost walls would stand right behind them and serve
// nobody, so it is brought in, if it is no farther away than its neighbours would move.
fn first_place(node: vec3f) -> vec3f {
    let way = clamp(node, settings.inner_lower, settings.inner_upper) - node;
    return select(node, node + way, all(abs(way) <= vec3f(settings.lean)));
}

fn relocated(node: vec3f, place: vec3f, seen: Surroundings) -> vec3f {
    var offset = place - node;
    let near = distances[seen.near];
    if seen.is_inside {
        offset += spherical_fibonacci(seen.back, RAYS) * (0.5 * settings.clearance - distances[seen.back]);
    } else if near < settings.clearance {
        let away = spherical_fibonacci(seen.far, RAYS);
        if dot(away, spherical_fibonacci(seen.near, RAYS)) <= 0.0 {
            offset += away * min(settings.clearance - near, 0.5 * distances[seen.far]);
        }
    } else {
        let spare = min(near - settings.clearance, length(offset));
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
    let cascade = ddgi.cascades[settings.cascade];
    let probe = cascade.first + min(group.x + group.y * groups.x, settings.probe_count - 1u);
    let in_grid = cascade_place(cascade, probe);
    let node = cascade.lower + vec3f(in_grid) * cascade.spacing;
    let is_new = any(in_grid < settings.kept_lower) || any(in_grid >= settings.kept_upper);
    let place = select(states[probe].xyz, first_place(node), is_new);
    let direction = spherical_fibonacci(thread, RAYS);
    distances[thread] = signed_clearance(place, direction, settings.reach_of_rays);
    workgroupBarrier();
    if thread == 0u {
        let found = surroundings(cascade.spacing);
        moved = relocated(node, place, found);
        if is_new && found.is_inside && all(moved == place) {
            moved = node;
        }
    }
    workgroupBarrier();
    distances[thread] = signed_clearance(moved, direction, settings.reach_of_rays);
    workgroupBarrier();
    if thread > 0u || group.x + group.y * groups.x >= settings.probe_count {
        return;
    }
    let seen = surroundings(cascade.spacing);
    var state = select(PROBE_ON, PROBE_INSIDE, seen.is_inside);
    if state == PROBE_ON && !seen.sees_surface && settings.may_sleep != 0u {
        state = PROBE_ASLEEP;
    }
    if is_new || (states[probe].w == PROBE_ON) != (state == PROBE_ON) || distance(moved, place) > settings.jump {
        histories[probe] = 0u;
    }
    states[probe] = vec4f(moved, select(state, PROBE_FRESH, state == PROBE_ON && histories[probe] == 0u));
}
