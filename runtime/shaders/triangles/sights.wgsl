// What rays see of the scene's triangles: the tracer `triangles`. Every face has two sides; lamps shine from their
// front, double-sided ones from both.

import package::lib::sight::{Sight};
import package::triangles::bindings::{triangle_info};
import package::triangles::surface::{surface_at};
import package::triangles::trace::{NO_TRIANGLE, triangles_trace, triangles_visible};

fn sight_along(origin: vec3f, direction: vec3f, reach: f32) -> Sight {
    let hit = triangles_trace(origin, direction, reach, false);
    if hit.triangle == NO_TRIANGLE {
        return Sight(reach, false, origin + direction * reach, -direction, vec3f(0.0), vec3f(0.0), 0.0);
    }
    let surface = surface_at(hit.triangle, hit.place);
    let is_front = dot(hit.face, direction) < 0.0;
    let face = normalize(select(-hit.face, hit.face, is_front));
    let normal = select(-surface.normal, surface.normal, dot(surface.normal, direction) < 0.0);
    let start = origin + direction * hit.t + face * triangle_info.margin;
    let emission = select(vec3f(0.0), surface.emission, is_front || surface.is_double_sided);
    return Sight(hit.t, true, start, normal, surface.albedo, emission, 0.0);
}

fn sight_is_free(origin: vec3f, direction: vec3f, reach: f32) -> bool {
    return triangles_visible(origin, direction, reach);
}

fn sight_start(position: vec3f, normal: vec3f) -> vec4f {
    return vec4f(position + normal * triangle_info.margin, 1.0);
}
