// What every pass of contact GI knows: its settings, and where its texels lie. One texel stands for a block of
// `scale` x `scale` pixels, and is what the block's first pixel sees.

import package::lib::camera::{camera_distance, camera_ndc, camera_view_position};
import package::lib::frame::{frame};
import package::primary::gbuffer::{gbuffer_depth};
import package::structs::{ContactInfo};

@group(0) @binding(8) var<uniform> contact: ContactInfo;

// The pixel that a texel stands for.
fn contact_pixel(texel: vec2u) -> vec2u {
    return contact.scale * texel;
}

// Where a place of the picture, in pixels, lies among the texels, whose centres are at whole numbers.
fn contact_place(pixel: vec2f) -> vec2f {
    return (pixel - 0.5) / f32(contact.scale);
}

// Distance along the viewing axis of a stored depth, metres.
fn contact_distance(depth: f32) -> f32 {
    return camera_distance(depth, frame.depth_map, frame.orthographic);
}

// View-space position of what is seen at a place of the picture, in pixels, at a distance along the axis.
fn contact_view_position(place: vec2f, distance: f32) -> vec3f {
    return camera_view_position(camera_ndc(place, vec2f(frame.size)), distance, frame.extent, frame.orthographic);
}

// A direction of local space in view space.
fn contact_view_direction(direction: vec3f) -> vec3f {
    let m = frame.local_from_view;
    return direction * mat3x3f(m[0].xyz, m[1].xyz, m[2].xyz);
}

// Unit vector in view space from a position to the viewer.
fn contact_towards_viewer(position: vec3f) -> vec3f {
    return select(normalize(-position), vec3f(0.0, 0.0, 1.0), frame.orthographic != 0u);
}
