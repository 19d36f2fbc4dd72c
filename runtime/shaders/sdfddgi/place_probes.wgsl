// Finds a place for every probe (SDFDDGI, section 3.2 and Fig. 5). A node of the grid that is nearer to a primitive
// than the clearance ascends the distance to the best position in reach; one that is a little farther descends to the
// clearance, since what lights a wall is known best near the wall. A probe that stays too near, or finds itself inside
// a primitive, is off; one that jumps loses its history.

import package::lib::candidates::{nearest_primitive};
import package::lib::march::{trace_visibility};
import package::lib::primitives::{shape_gradient};
import package::structs::{PlaceSettings, ProbeHistory, ProbeRecord};
import package::world::bindings::{world, world_shape};

@group(0) @binding(0) var<uniform> settings: PlaceSettings;
@group(0) @binding(1) var<storage, read_write> records: array<ProbeRecord>;
@group(0) @binding(2) var<storage, read_write> histories: array<ProbeHistory>;

const PLACE_STEPS: u32 = 12u;
const OFF: f32 = -1.0;

// Of the spacing: so far into the grid a node is moved before it ascends. One that lies on a face or an edge, as all
// outermost ones of a grid over a room do, else goes to either side, and those behind the wall serve nobody.
const PLACE_INWARD: f32 = 0.01;

// Position and distance to the nearest primitive. inward: towards the middle of the grid, by signs.
fn place_probe(start: vec3f, inward: vec3f) -> vec4f {
    var position = start;
    var nearest = nearest_primitive(position);
    var best = vec4f(position, nearest.distance);
    let surplus = nearest.distance - settings.clearance;
    if surplus > 0.0 && surplus < settings.attraction {
        let uphill = shape_gradient(world_shape(nearest.primitive), position);
        // Only where the next probe stands on the other side: a lone probe serves the whole gap best from where it is.
        // The ball around the node is free, so on the way down nothing is crossed.
        if trace_visibility(position, uphill, settings.spacing) > 0.0 {
            return vec4f(position - uphill * surplus, settings.clearance);
        }
    }
    if nearest.distance < settings.clearance {
        position += inward * (PLACE_INWARD * settings.spacing);
        nearest = nearest_primitive(position);
    }
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
    let inward = sign(vec3f(counts - 1u) - 2.0 * vec3f(node));
    let place = place_probe(settings.lower + vec3f(node) * settings.spacing, inward);
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
