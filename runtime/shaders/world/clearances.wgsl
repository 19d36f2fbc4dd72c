// How far a probe sees through the primitives, with a sign: negative from inside, as far as the way out is.

import package::lib::candidates::{world_distance};
import package::lib::march::{march_ray};
import package::world::bindings::{world};

const LEAVE_STEPS: u32 = 64u;

fn signed_clearance(origin: vec3f, direction: vec3f, reach: f32) -> f32 {
    var inside = -world_distance(origin);
    if inside <= 0.0 {
        return march_ray(origin, direction, reach).t;
    }
    var t = 0.0;
    for (var step = 0u; step < LEAVE_STEPS && inside > 0.0 && t < reach; step++) {
        t += max(inside, world.hit_distance);
        inside = -world_distance(origin + direction * t);
    }
    return -max(t, world.hit_distance);
}
