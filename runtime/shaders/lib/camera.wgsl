// Pixels, depths and positions of a pinhole or an orthographic camera that looks along -Z of view space.
// Depth is reversed: 1 on the near plane, 0 far away, so that float32 keeps its precision at a distance.
// Twin: runtime/twins/camera.py

// Pixel coordinates (centres at half-integers, row 0 on top) to normalised device coordinates, y upward.
fn camera_ndc(pixel: vec2f, size: vec2f) -> vec2f {
    return vec2f(2.0, -2.0) * pixel / size + vec2f(-1.0, 1.0);
}

// Normalised device coordinates to pixel coordinates.
fn camera_pixel(ndc: vec2f, size: vec2f) -> vec2f {
    return (ndc - vec2f(-1.0, 1.0)) * size * vec2f(0.5, -0.5);
}

// Distance along the viewing axis of a stored depth. The projection stores
// depth = depth_map.x + depth_map.y / distance, or depth_map.x + depth_map.y * distance when orthographic.
fn camera_distance(depth: f32, depth_map: vec2f, orthographic: u32) -> f32 {
    let difference = depth - depth_map.x;
    return select(depth_map.y / difference, difference / depth_map.y, orthographic != 0u);
}

// View-space position at a distance along the viewing axis. extent: tangents of the half angles of view,
// or half the width and height in metres when orthographic.
fn camera_view_position(ndc: vec2f, distance: f32, extent: vec2f, orthographic: u32) -> vec3f {
    let scale = select(distance, 1.0, orthographic != 0u);
    return vec3f(ndc * extent * scale, -distance);
}

// View-space direction, of unit length, in which a pixel looks.
fn camera_view_direction(ndc: vec2f, extent: vec2f, orthographic: u32) -> vec3f {
    let slope = select(ndc * extent, vec2f(0.0), orthographic != 0u);
    return normalize(vec3f(slope, -1.0));
}
