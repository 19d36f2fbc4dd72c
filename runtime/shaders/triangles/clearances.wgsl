// How far a probe sees among the triangles, with a sign: negative where the ray meets a back, unless the surface is
// meant to be seen from both sides.

import package::triangles::bindings::{triangle_materials};
import package::triangles::surface::{surface_material};
import package::triangles::trace::{NO_TRIANGLE, triangles_trace};

fn signed_clearance(origin: vec3f, direction: vec3f, reach: f32) -> f32 {
    let hit = triangles_trace(origin, direction, reach, false);
    if hit.triangle == NO_TRIANGLE {
        return reach;
    }
    let is_back = dot(hit.face, direction) > 0.0
        && triangle_materials[surface_material(hit.triangle)].is_double_sided == 0u;
    return select(hit.t, -hit.t, is_back);
}
