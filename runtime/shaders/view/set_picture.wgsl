// The primitive set as it is, seen through one pixel: albedo shaded by the angle of view, edges of faces dark.

import package::lib::frame::{frame, frame_ray};
import package::lib::march::{trace};
import package::lib::primitives::{shape_face};
import package::view::headlight::{headlight};
import package::world::bindings::{FAR, NO_PRIMITIVE, world_shape};

// `t` is the distance to the set along the pixel's ray; FAR, and black, where there is none.
struct SetPixel {
    color: vec3f,
    t: f32,
}

// The primitive and face that a pixel sees in one number.
fn seen_face(pixel: vec2u) -> u32 {
    let ray = frame_ray(min(pixel, frame.size - 1u));
    let hit = trace(ray.origin, ray.direction, FAR);
    if hit.primitive == NO_PRIMITIVE {
        return NO_PRIMITIVE;
    }
    return 8u * hit.primitive + shape_face(world_shape(hit.primitive), hit.position);
}

fn set_picture(pixel: vec2u) -> SetPixel {
    let ray = frame_ray(pixel);
    let hit = trace(ray.origin, ray.direction, FAR);
    if hit.primitive == NO_PRIMITIVE {
        return SetPixel(vec3f(0.0), FAR);
    }
    let face = 8u * hit.primitive + shape_face(world_shape(hit.primitive), hit.position);
    let is_edge = face != seen_face(pixel + vec2u(1u, 0u)) || face != seen_face(pixel + vec2u(0u, 1u));
    let shade = select(headlight(hit.normal, ray.direction), 0.15, is_edge);
    return SetPixel(hit.albedo * shade + hit.emission, hit.t);
}
