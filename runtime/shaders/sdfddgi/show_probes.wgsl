// The probes where they stand, as small balls in the picture, which dims behind them. Each pixel asks all of them: a picture
// for people, not for every frame.

import package::lib::frame::{frame, frame_position, frame_ray};
import package::primary::gbuffer::{gbuffer_depth};
import package::probes::grid::{probe_count, probe_grid};
import package::probes::states::{PROBE_OFF, probe_is_lit};
import package::sdfddgi::lookup::{GI_PI, probe_irradiance, probe_records};
import package::structs::{ProbeHistory};
import package::view::headlight::{headlight};
import package::world::bindings::{FAR};

@group(0) @binding(10) var layer: texture_storage_2d<rgba32float, write>;
@group(0) @binding(11) var radiance: texture_2d<f32>;
@group(0) @binding(12) var<storage, read> probe_histories: array<ProbeHistory>;

// What the colour of a ball tells.
override SHOWN: u32 = 0u;

const STATE = 0u;
const AGE = 1u;
const UPDATES = 2u;
const REFUSED = 3u;

// Radius of a ball, in spacings, and what is left of the picture behind.
const BALL: f32 = 0.08;
const DIMMED: f32 = 0.35;

// Frames since the last update, and updates, that are shown as most.
const OLDEST: f32 = 16.0;
const MOST_UPDATES: f32 = 256.0;

// Blue, green, yellow, red over [0, 1].
fn show_share(share: f32) -> vec3f {
    let s = clamp(share, 0.0, 1.0);
    return clamp(vec3f(3.0 * s - 1.0, min(3.0 * s, 3.0 - 3.0 * s), 1.0 - 3.0 * s), vec3f(0.02), vec3f(1.0));
}

fn show_probe(probe: u32, normal: vec3f) -> vec3f {
    let state = probe_records[probe].position.w;
    let history = probe_histories[probe];
    if state == PROBE_OFF {
        return vec3f(0.6, 0.0, 0.0);
    }
    switch SHOWN {
        case STATE: { return select(vec3f(0.0, 0.2, 1.0), vec3f(0.0, 0.7, 0.1), probe_is_lit(state)); }
        case AGE: { return show_share(history.waited / OLDEST); }
        case UPDATES: { return show_share(log2(1.0 + f32(history.updates)) / log2(1.0 + MOST_UPDATES)); }
        case REFUSED: { return show_share(f32(history.rsm_refused) / max(f32(history.rsm_asked), 1.0)); }
        default: { return probe_irradiance(probe, normal) / GI_PI; }
    }
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= frame.size) {
        return;
    }
    let ray = frame_ray(id.xy);
    let depth = textureLoad(gbuffer_depth, id.xy, 0);
    var nearest = FAR;
    if depth > 0.0 {
        nearest = distance(frame_position(id.xy, depth), ray.origin);
    }
    var shown = probe_count();
    let radius = BALL * probe_grid.spacing;
    for (var probe = 0u; probe < probe_count(); probe++) {
        let way = probe_records[probe].position.xyz - ray.origin;
        let along = dot(way, ray.direction);
        let inside = radius * radius - dot(way, way) + along * along;
        let t = along - sqrt(max(inside, 0.0));
        if inside > 0.0 && t > 0.0 && t < nearest {
            nearest = t;
            shown = probe;
        }
    }
    var color = DIMMED * textureLoad(radiance, id.xy, 0).rgb;
    if shown < probe_count() {
        let normal = normalize(ray.origin + ray.direction * nearest - probe_records[shown].position.xyz);
        let shade = select(headlight(normal, ray.direction), 1.0, SHOWN > REFUSED);
        color = show_probe(shown, normal) * shade;
    }
    textureStore(layer, id.xy, vec4f(color, select(0.0, 1.0, shown < probe_count() || depth > 0.0)));
}
