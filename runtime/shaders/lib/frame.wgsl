// The frame that is drawn: its camera, now and one frame ago. Positions are local: world minus the scene's origin.

import package::structs::{Frame};
import package::lib::camera::{camera_ndc, camera_distance, camera_view_position, camera_view_direction};

@group(3) @binding(0) var<uniform> frame: Frame;

struct FrameRay {
    origin: vec3f,
    direction: vec3f,
}

// Local position of the surface that a pixel's depth stands for.
fn frame_position(pixel: vec2u, depth: f32) -> vec3f {
    let ndc = camera_ndc(vec2f(pixel) + 0.5, vec2f(frame.size));
    let distance = camera_distance(depth, frame.depth_map, frame.orthographic);
    let view = camera_view_position(ndc, distance, frame.extent, frame.orthographic);
    return (frame.local_from_view * vec4f(view, 1.0)).xyz;
}

// The ray through a pixel's centre, from the camera (perspective) or its plane (orthographic).
fn frame_ray(pixel: vec2u) -> FrameRay {
    let ndc = camera_ndc(vec2f(pixel) + 0.5, vec2f(frame.size));
    let origin = camera_view_position(ndc, 0.0, frame.extent, frame.orthographic);
    let direction = camera_view_direction(ndc, frame.extent, frame.orthographic);
    return FrameRay(
        (frame.local_from_view * vec4f(origin, 1.0)).xyz,
        (frame.local_from_view * vec4f(direction, 0.0)).xyz,
    );
}

// Unit vector from a local position to the viewer.
fn frame_towards_viewer(position: vec3f) -> vec3f {
    let backward = frame.local_from_view[2].xyz;
    let way = frame.local_from_view[3].xyz - position;
    return select(normalize(way), backward, frame.orthographic != 0u);
}
