// The primitive set as it is, seen from the camera: albedo shaded by the angle of view, edges of faces dark.

import package::lib::frame::{frame, frame_ray};
import package::lib::march::{trace};
import package::lib::primitives::{shape_face};
import package::world::bindings::{FAR, NO_PRIMITIVE, world_shape};

@group(0) @binding(0) var layer: texture_storage_2d<rgba32float, write>;

// The primitive and face that a pixel sees in one number.
fn seen_face(pixel: vec2u) -> u32 {
    let ray = frame_ray(min(pixel, frame.size - 1u));
    let hit = trace(ray.origin, ray.direction, FAR);
    if hit.primitive == NO_PRIMITIVE {
        return NO_PRIMITIVE;
    }
    return 8u * hit.primitive + shape_face(world_shape(hit.primitive), hit.position);
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= frame.size) {
        return;
    }
    let ray = frame_ray(id.xy);
    let hit = trace(ray.origin, ray.direction, FAR);
    if hit.primitive == NO_PRIMITIVE {
        textureStore(layer, id.xy, vec4f(0.0));
        return;
    }
    let face = 8u * hit.primitive + shape_face(world_shape(hit.primitive), hit.position);
    let is_edge = face != seen_face(id.xy + vec2u(1u, 0u)) || face != seen_face(id.xy + vec2u(0u, 1u));
    let shade = 0.35 + 0.65 * abs(dot(hit.normal, ray.direction));
    let color = select(hit.albedo * shade, hit.albedo * 0.15, is_edge);
    textureStore(layer, id.xy, vec4f(color + hit.emission, 1.0));
}
