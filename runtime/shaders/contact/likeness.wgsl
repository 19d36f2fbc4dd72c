// How alike the surfaces of two texels or pixels are: what contact light may be shared between.

import package::contact::info::{contact_distance, contact_view_direction, contact_view_position};
import package::primary::gbuffer::{gbuffer_depth, gbuffer_normal};

// How far, as a share of the distance to the viewer, another surface may lie off the plane of one's own, and the power of
// the cosine between their normals.
const PLANE_SHARE: f32 = 0.005;
const NORMAL_POWER: f32 = 16.0;

// A point of view space and its normal; none of it where there is no surface.
struct Guide {
    position: vec3f,
    normal: vec3f,
}

fn guide_of(pixel: vec2u) -> Guide {
    let depth = textureLoad(gbuffer_depth, pixel, 0);
    if depth == 0.0 {
        return Guide(vec3f(0.0), vec3f(0.0));
    }
    let position = contact_view_position(vec2f(pixel) + 0.5, contact_distance(depth));
    return Guide(position, contact_view_direction(gbuffer_normal(pixel)));
}

// In [0, 1]; 0 for what is no surface.
fn likeness(own: Guide, other: Guide) -> f32 {
    let off_plane = abs(dot(other.position - own.position, own.normal)) / (PLANE_SHARE * abs(own.position.z) + 1e-20);
    return exp(-off_plane) * pow(max(dot(own.normal, other.normal), 0.0), NORMAL_POWER);
}
