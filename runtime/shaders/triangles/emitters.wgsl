// Points on the triangles that shine.

import package::lib::emitters::{EmitterPoint, emitter_drawn};
import package::triangles::bindings::{triangle_faces, triangle_info, triangle_materials};
import package::triangles::surface::{surface_material};

fn emitter_count() -> u32 {
    return triangle_info.emitter_count;
}

fn emitter_point(origin: vec3f, u: vec3f) -> EmitterPoint {
    let triangle = emitter_drawn(u.x, triangle_info.emitter_count).surface;
    let first = triangle_faces[3u * triangle + 1u].xyz;
    let second = triangle_faces[3u * triangle + 2u].xyz;
    let root = sqrt(u.y);
    let position = triangle_faces[3u * triangle].xyz + root * ((1.0 - u.z) * first + u.z * second);
    let normal = normalize(cross(first, second));
    let is_front = dot(normal, origin - position) > 0.0;
    let is_double_sided = triangle_materials[surface_material(triangle)].is_double_sided != 0u;
    return EmitterPoint(position, normal, triangle, is_front || is_double_sided);
}
