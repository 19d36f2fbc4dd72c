// Finds a place for every probe (SDFDDGI, section 3.2 and Fig. 5). A node of the grid that is nearer to a primitive
// than the clearance ascends the distance to the best position in reach; one that is a little farther descends to the
// clearance, since what lights a wall is known best near the wall. A probe that stays too near, or finds itself inside
// a primitive, is off; one that jumps, or came in as the grid moved, loses its history. The others are asked only where
// the world changed.

import package::lib::candidates::{nearest_primitive};
import package::lib::march::{trace_visibility};
import package::lib::primitives::{shape_gradient};
import package::probes::grid::{probe_count, probe_grid, probe_place};
import package::probes::states::{PROBE_FRESH, PROBE_OFF, probe_is_placed};
import package::structs::{PlaceSettings, ProbeHistory, ProbeRecord};
import package::world::bindings::{world, world_shape};

@group(0) @binding(0) var<uniform> settings: PlaceSettings;
@group(0) @binding(1) var<storage, read_write> records: array<ProbeRecord>;
@group(0) @binding(2) var<storage, read_write> histories: array<ProbeHistory>;

const PLACE_STEPS: u32 = 12u;

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
        if trace_visibility(position, uphill, probe_grid.spacing) > 0.0 {
            return vec4f(position - uphill * surplus, settings.clearance);
        }
    }
    if nearest.distance < settings.clearance {
        position += inward * (PLACE_INWARD * probe_grid.spacing);
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
    if id.x >= probe_count() {
        return;
    }
    let in_grid = probe_place(id.x);
    let is_new = any(in_grid < settings.kept_lower) || any(in_grid >= settings.kept_upper);
    if !is_new && settings.world_has_changed == 0u {
        return;
    }
    // Counted from where the grid began: a node is at the same place, to the bit, wherever the grid stands.
    let node = vec3i(in_grid) + settings.steps;
    let inward = sign(vec3f(vec3i(probe_grid.counts) - 1 - 2 * node));
    let place = place_probe(settings.start + vec3f(node) * probe_grid.spacing, inward);
    let before = records[id.x].position;
    var state = before.w;
    if place.w < min(settings.clearance, settings.smallest_clearance) {
        state = PROBE_OFF;
    } else if is_new || !probe_is_placed(state) || distance(before.xyz, place.xyz) > settings.jump {
        state = PROBE_FRESH;
    }
    if state < 0.0 {
        histories[id.x] = ProbeHistory();
    }
    records[id.x].position = vec4f(place.xyz, state);
}
