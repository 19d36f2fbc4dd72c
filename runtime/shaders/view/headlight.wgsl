// Light from the viewer, so that the faces of a corner differ.
fn headlight(normal: vec3f, direction: vec3f) -> f32 {
    return 0.35 + 0.65 * abs(dot(normal, direction));
}
