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
}
