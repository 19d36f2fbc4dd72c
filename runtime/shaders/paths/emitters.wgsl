// Light of one point of a surface that shines, drawn by its power (next event estimation): small lamps are seldom met
// by chance.

import package::lib::sight::{Sight};
import package::tracer::emitters::{emitter_point};
import package::tracer::sights::{sight_along};

struct EmitterLight {
    direction: vec3f,
    // False where something stands before the point, or it shines to the other side.
    is_met: bool,
    seen: Sight,
}

// How far past the point the ray looks for it, of its length.
const EMITTER_PAST: f32 = 1.001;

fn emitter_light(origin: vec3f, farthest: f32, u: vec3f) -> EmitterLight {
    let chosen = emitter_point(origin, u);
    let way = chosen.position - origin;
    let reach = length(way);
    let direction = way / max(reach, 1e-20);
    if !chosen.is_facing || reach > farthest {
        return EmitterLight(direction, false, Sight());
    }
    let seen = sight_along(origin, direction, min(EMITTER_PAST * reach, farthest));
    return EmitterLight(direction, seen.is_hit && seen.surface == chosen.surface, seen);
}
