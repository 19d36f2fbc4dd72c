// Whether two points, each with its normal, may belong to one smooth surface.
// Twin: runtime/twins/surfaces.py

// How far a way between two points leaves the plane across their mean normal: 0 along a chord of a circle as well as
// along a plane.
fn surface_rise(way: vec3f, normal: vec3f, other_normal: vec3f) -> f32 {
    let sum = normal + other_normal;
    return abs(dot(way, sum)) * inverseSqrt(max(dot(sum, sum), 1e-12));
}
