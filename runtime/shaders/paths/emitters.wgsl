// Light of one point of a surface that shines, drawn by its power (next event estimation): small lamps are seldom met
// by chance.

import package::lib::emitters::{emitter_density};
import package::lib::sight::{Sight};
import package::tracer::emitters::{emitter_point};
import package::tracer::sights::{sight_along};

struct EmitterLight {
    direction: vec3f,
    // Of the draw, 1/sr, at the point itself: sphere tracing ends a hair before a surface, where a ball's rim looks less
    // slanted. What weighs draws against rays must be the same for both, and is told of the hit.
    density: f32,
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
        return EmitterLight(direction, 0.0, false, Sight());
    }
    let seen = sight_along(origin, direction, min(EMITTER_PAST * reach, farthest));
    let density = emitter_density(seen.drawn_share, reach, abs(dot(chosen.normal, direction)));
    // On an edge, the hit may belong to a face that is dark.
    let is_met = seen.is_hit && seen.surface == chosen.surface && seen.drawn_share > 0.0;
    return EmitterLight(direction, density, is_met, seen);
}
