// What a ray sees, whatever the tracer: `world/sights` looks through the primitives, `triangles/sights` at the mesh.

struct Sight {
    // How far the ray went: its reach where it met nothing.
    t: f32,
    is_hit: bool,
    // From where rays may go on.
    position: vec3f,
    // On the side that the ray comes from.
    normal: vec3f,
    albedo: vec3f,
    emission: vec3f,
    // Half the smallest extent of what was hit, metres.
    half_thickness: f32,
    // Index of the primitive or triangle.
    surface: u32,
    // Of the angle between the ray and the face's normal.
    face_cosine: f32,
    // Density, 1/m2, with which draws of emitters choose the point; 0 where they never do.
    drawn_share: f32,
}
