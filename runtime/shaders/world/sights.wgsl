// What rays see of the primitives: the tracer `world`.

import package::lib::march::{Hit, trace, trace_start, trace_visibility};
import package::lib::primitives::{shape_half_thickness};
import package::lib::sight::{Sight};
import package::world::bindings::{NO_PRIMITIVE, world, world_shape};

fn sight_along(origin: vec3f, direction: vec3f, reach: f32) -> Sight {
    let hit = trace(origin, direction, reach);
    if hit.primitive == NO_PRIMITIVE {
        return Sight(reach, false, hit.position, -direction, vec3f(0.0), vec3f(0.0), 0.0, NO_PRIMITIVE, 0.0, 0.0);
    }
    let half_thickness = shape_half_thickness(world_shape(hit.primitive));
    let cosine = -dot(hit.normal, direction);
    return Sight(
        hit.t, true, hit.position, hit.normal, hit.albedo, hit.emission, half_thickness,
        hit.primitive, cosine, sight_drawn_share(hit),
    );
}

// Emitters are drawn by their power, and half-spaces never are.
fn sight_drawn_share(hit: Hit) -> f32 {
    if world.emitter_count == 0u || hit.primitive >= world.finite_count {
        return 0.0;
    }
    return dot(hit.emission, vec3f(1.0)) / world.emitter_power;
}

fn sight_is_free(origin: vec3f, direction: vec3f, reach: f32) -> bool {
    return trace_visibility(origin, direction, reach) > 0.0;
}

// Where rays from a point of the mesh start; w = 0 where primitives leave it no place.
fn sight_start(position: vec3f, normal: vec3f) -> vec4f {
    return trace_start(position, normal);
}
