// What rays see of the scene's triangles: the tracer `triangles`. Every face has two sides; lamps shine from their
// front, double-sided ones from both.

import package::lib::sight::{Sight};
import package::triangles::bindings::{triangle_info, triangle_materials};
import package::triangles::surface::{surface_at, surface_material};
import package::triangles::trace::{NO_TRIANGLE, triangles_trace, triangles_visible};

fn sight_along(origin: vec3f, direction: vec3f, reach: f32) -> Sight {
    let hit = triangles_trace(origin, direction, reach, false);
    if hit.triangle == NO_TRIANGLE {
        return Sight(reach, false, origin + direction * reach, -direction, vec3f(0.0), vec3f(0.0), 0.0, NO_TRIANGLE, 0.0, 0.0);
    }
    let surface = surface_at(hit.triangle, hit.place);
    let is_front = dot(hit.face, direction) < 0.0;
    let face = normalize(select(-hit.face, hit.face, is_front));
    let normal = select(-surface.normal, surface.normal, dot(surface.normal, direction) < 0.0);
    let start = origin + direction * hit.t + face * triangle_info.margin;
    let emission = select(vec3f(0.0), surface.emission, is_front || surface.is_double_sided);
    let share = select(0.0, sight_drawn_share(hit.triangle), is_front || surface.is_double_sided);
    let cosine = -dot(face, direction);
    return Sight(hit.t, true, start, normal, surface.albedo, emission, 0.0, hit.triangle, cosine, share);
}

// Emitters are drawn by the power that their materials give them; textures may make them darker.
fn sight_drawn_share(triangle: u32) -> f32 {
    if triangle_info.emitter_count == 0u {
        return 0.0;
    }
    return dot(triangle_materials[surface_material(triangle)].emission, vec3f(1.0)) / triangle_info.emitter_power;
}

fn sight_is_free(origin: vec3f, direction: vec3f, reach: f32) -> bool {
    return triangles_visible(origin, direction, reach);
}

fn sight_start(position: vec3f, normal: vec3f) -> vec4f {
    return vec4f(position + normal * triangle_info.margin, 1.0);
}
