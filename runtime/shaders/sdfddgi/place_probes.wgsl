// Finds a place for every probe (SDFDDGI, Fig. 5): its grid position, or, where that is nearer to a primitive than the
// clearance, the best position that ascending the distance leads to. A probe that stays too near, or that finds itself
// inside a primitive, is off; one that jumps loses its history.

import package::lib::candidates::{nearest_primitive};
import package::lib::primitives::{shape_gradient};
import package::structs::{PlaceSettings, ProbeHistory, ProbeRecord};
import package::world::bindings::{world, world_shape};

@group(0) @binding(0) var<uniform> settings: PlaceSettings;
@group(0) @binding(1) var<storage, read_write> records: array<ProbeRecord>;
@group(0) @binding(2) var<storage, read_write> histories: array<ProbeHistory>;

const PLACE_STEPS: u32 = 12u;
const OFF: f32 = -1.0;

// Position and distance to the nearest primitive.
fn place_probe(start: vec3f) -> vec4f {
    var position = start;
    var nearest = nearest_primitive(position);
    var best = vec4f(position, nearest.distance);
    for (var step = 0u; step < PLACE_STEPS && nearest.distance < settings.clearance; step++) {
        let uphill = shape_gradient(world_shape(nearest.primitive), position);
        position += uphill * (settings.clearance - nearest.distance) * 1.05;
        let way = position - start;
        position = start + way * min(1.0, settings.reach / max(length(way), 1e-20));
        nearest = nearest_primitive(position);
        if nearest.distance > best.w {
            best = vec4f(position, nearest.distance);
        }
    }
    return best;
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let counts = settings.counts;
    if id.x >= counts.x * counts.y * counts.z {
        return;
    }
    let node = vec3u(id.x % counts.x, (id.x / counts.x) % counts.y, id.x / (counts.x * counts.y));
    let place = place_probe(settings.lower + vec3f(node) * settings.spacing);
    let before = records[id.x].position;
    if place.w < min(settings.clearance, settings.smallest_clearance) {
        records[id.x].position = vec4f(place.xyz, OFF);
        histories[id.x].frames = 0.0;
        return;
    }
    let has_jumped = before.w < 0.0 || distance(before.xyz, place.xyz) > settings.jump;
    if has_jumped {
        histories[id.x].frames = 0.0;
    }
    records[id.x].position = vec4f(place.xyz, max(before.w, 0.0));
}
