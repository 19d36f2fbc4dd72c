// The 64-byte primitive record, four vec4u (docs/formats.md gives the bits), and what is asked of a primitive.
// Positions are in local space: world minus the scene's origin.

import package::lib::quaternion::{quat_rotate, quat_rotate_inverse};
import package::lib::sdf::{sd_box, sd_sphere, sd_cylinder, sd_half_space, sd_box_gradient, sd_sphere_gradient, sd_cylinder_gradient, sd_half_space_gradient};

const BOX: u32 = 0u;
const SPHERE: u32 = 1u;
const CYLINDER: u32 = 2u;
const PLANE: u32 = 3u;

struct Shape {
    position: vec3f,
    kind: u32,
    half: vec3f,
    rotation: vec4f,
}

// "Smallest three": the component left out is the largest, and positive.
fn decode_rotation(words: vec2u) -> vec4f {
    let code = vec3u((words.x >> 4u) & 0xfffffu, (words.x >> 24u) | ((words.y & 0xfffu) << 8u), words.y >> 12u);
    let v = (vec3f(code) - 524288.0) * (0.70710678118655 / 524287.0);
    let w = sqrt(max(1.0 - dot(v, v), 0.0));
    switch (words.x >> 2u) & 3u {
        case 0u: { return vec4f(w, v); }
        case 1u: { return vec4f(v.x, w, v.yz); }
        case 2u: { return vec4f(v.xy, w, v.z); }
        default: { return vec4f(v, w); }
    }
}

fn decode_albedo(face: u32) -> vec3f {
    let root = vec3f(vec3u(face, face >> 10u, face >> 20u) & vec3u(1023u)) * (1.0 / 1023.0);
    return root * root;
}

fn decode_rgb9e5(word: u32) -> vec3f {
    let mantissa = vec3f(vec3u(word, word >> 9u, word >> 18u) & vec3u(511u));
    return mantissa * exp2(f32(word >> 27u) - 24.0);
}

// The face's emission is none, A, B or both, by its two highest bits.
fn decode_emission(face: u32, a: u32, b: u32) -> vec3f {
    let none = vec3f(0.0);
    return select(none, decode_rgb9e5(a), (face & 0x40000000u) != 0u)
        + select(none, decode_rgb9e5(b), (face & 0x80000000u) != 0u);
}

fn decode_shape(first: vec4u, second: vec4u) -> Shape {
    let position = bitcast<vec3f>(first.xyz);
    let half = vec3f(bitcast<f32>(first.w), bitcast<vec2f>(second.xy));
    return Shape(position, second.z & 3u, half, decode_rotation(second.zw));
}

// Centre and radius of the ball around a finite primitive, from the same words; its rotation is not asked.
fn decode_bounds(first: vec4u, second: vec4u) -> vec4f {
    let half = vec3f(bitcast<f32>(first.w), bitcast<vec2f>(second.xy));
    let kind = second.z & 3u;
    let across = select(half, vec3f(half.xy, 0.0), kind == CYLINDER);
    return vec4f(bitcast<vec3f>(first.xyz), select(length(across), half.x, kind == SPHERE));
}

fn shape_is_half_space(shape: Shape) -> bool {
    return shape.half.x < 0.0;
}

fn shape_distance(shape: Shape, position: vec3f) -> f32 {
    let p = quat_rotate_inverse(shape.rotation, position - shape.position);
    if shape.kind == SPHERE {
        return sd_sphere(p, shape.half.x);
    }
    if shape.kind == CYLINDER {
        return sd_cylinder(p, shape.half.x, shape.half.y);
    }
    if shape_is_half_space(shape) {
        return sd_half_space(p);
    }
    return sd_box(p, shape.half);
}

fn shape_gradient(shape: Shape, position: vec3f) -> vec3f {
    let p = quat_rotate_inverse(shape.rotation, position - shape.position);
    var gradient = sd_half_space_gradient(p);
    if shape.kind == SPHERE {
        gradient = sd_sphere_gradient(p, shape.half.x);
    } else if shape.kind == CYLINDER {
        gradient = sd_cylinder_gradient(p, shape.half.x, shape.half.y);
    } else if !shape_is_half_space(shape) {
        gradient = sd_box_gradient(p, shape.half);
    }
    return quat_rotate(shape.rotation, gradient);
}

// Which of the six faces (+x, -x, +y, -y, +z, -z) colours a hit: the one that lies farthest outwards.
fn shape_face(shape: Shape, position: vec3f) -> u32 {
    if shape.kind == SPHERE {
        return 0u;
    }
    if shape_is_half_space(shape) {
        return 2u;
    }
    let p = quat_rotate_inverse(shape.rotation, position - shape.position);
    let q = abs(p) - shape.half;
    if shape.kind == CYLINDER {
        let cap = q.y > length(p.xz) - shape.half.x;
        return select(0u, select(2u, 3u, p.y < 0.0), cap);
    }
    if q.x >= max(q.y, q.z) {
        return select(0u, 1u, p.x < 0.0);
    }
    if q.y >= q.z {
        return select(2u, 3u, p.y < 0.0);
    }
    return select(4u, 5u, p.z < 0.0);
}

// Half the smallest extent: how far under its surface a primitive surely is solid.
fn shape_half_thickness(shape: Shape) -> f32 {
    return select(min(shape.half.x, min(shape.half.y, shape.half.z)), 3.0e38, shape_is_half_space(shape));
}
